//! The functions of the language by name.

use super::graph::{Graph, Node};
use super::operator::Operator;

/// How a function makes a term of its arguments.
#[derive(Clone, Copy, Debug)]
pub(super) enum Function {
    Unary(Operator),
    Binary(Operator),
    /// `x^y` as C writes it.
    Power,
    /// `min` or `max` of two or more arguments.
    Extremum(Operator),
}

const FUNCTIONS: [(&str, Function); 21] = [
    ("sin", Function::Unary(Operator::Sin)),
    ("cos", Function::Unary(Operator::Cos)),
    ("tan", Function::Unary(Operator::Tan)),
    ("asin", Function::Unary(Operator::Asin)),
    ("acos", Function::Unary(Operator::Acos)),
    ("atan", Function::Unary(Operator::Atan)),
    ("atan2", Function::Binary(Operator::Atan2)),
    ("sinh", Function::Unary(Operator::Sinh)),
    ("cosh", Function::Unary(Operator::Cosh)),
    ("tanh", Function::Unary(Operator::Tanh)),
    ("exp", Function::Unary(Operator::Exp)),
    ("ln", Function::Unary(Operator::Ln)),
    ("log10", Function::Unary(Operator::Log10)),
    ("sqrt", Function::Unary(Operator::Sqrt)),
    ("cbrt", Function::Unary(Operator::Cbrt)),
    ("abs", Function::Unary(Operator::Abs)),
    ("sign", Function::Unary(Operator::Sign)),
    ("min", Function::Extremum(Operator::Min)),
    ("max", Function::Extremum(Operator::Max)),
    ("heaviside", Function::Unary(Operator::Heaviside)),
    ("pow", Function::Power),
];

/// What other languages call a function, and what it is called here.
const FUNCTION_SYNONYMS: [(&str, &str); 6] =
    [("log", "ln"), ("arcsin", "asin"), ("arccos", "acos"), ("arctan", "atan"), ("arctan2", "atan2"), ("sgn", "sign")];

impl Function {
    pub(super) fn named(name: &str) -> Option<Self> {
        FUNCTIONS.iter().find(|(known, _)| *known == name).map(|&(_, function)| function)
    }

    pub(super) fn names() -> impl Iterator<Item = &'static str> {
        FUNCTIONS.iter().map(|&(name, _)| name)
    }

    /// The number of arguments, in words.
    pub(super) fn arity(self) -> &'static str {
        match self {
            Self::Unary(_) => "one argument",
            Self::Binary(_) | Self::Power => "two arguments",
            Self::Extremum(_) => "two or more arguments",
        }
    }

    /// Whether it may have so many arguments.
    pub(super) fn takes(self, arguments: usize) -> bool {
        match self {
            Self::Unary(_) => arguments == 1,
            Self::Binary(_) | Self::Power => arguments == 2,
            Self::Extremum(_) => arguments >= 2,
        }
    }

    /// The term of as many arguments as it takes.
    pub(super) fn apply(self, graph: &mut Graph, arguments: &[Node]) -> Node {
        let a = arguments[0];
        match self {
            Self::Unary(operator) => graph.unary(operator, a),
            Self::Binary(operator) => graph.binary(operator, a, arguments[1]),
            Self::Power => graph.power(a, arguments[1]),
            Self::Extremum(operator) => {
                arguments[1..].iter().fold(a, |extremum, &b| graph.extremum(operator, extremum, b))
            }
        }
    }
}

impl Graph {
    /// `min` or `max`. Where the arguments are equal the second one gives the derivative; a constant is put there, so
    /// that `sqrt(max(x, 0))` has the derivative 0 at 0 and not infinity.
    fn extremum(&mut self, operator: Operator, a: Node, b: Node) -> Node {
        match self.value(a) {
            Some(_) => self.binary(operator, b, a),
            None => self.binary(operator, a, b),
        }
    }
}

/// The spelling of this language for a foreign one.
pub(super) fn synonym(name: &str, called: bool) -> Option<&'static str> {
    let function = FUNCTION_SYNONYMS.iter().find(|(foreign, _)| called && *foreign == name).map(|&(_, ours)| ours);
    function.or((name == "e" && !called).then_some("exp(1)"))
}
