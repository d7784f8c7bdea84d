//! The functions of the language by name.

use super::discontinuous::Discontinuous;
use super::graph::{Graph, Node};
use super::operator::Operator;

/// A function of the language, by the way in which a call of it becomes a term of the graph.
#[derive(Clone, Copy, Debug)]
pub(super) enum Function {
    Unary(Operator),
    Binary(Operator),
    /// `pow(x, y)`, the power as a function.
    Power,
    /// `min` or `max` of two or more arguments.
    Extremum(Operator),
    /// A discontinuous function of time and parameters, such as `floor` or a pulse.
    Discontinuous(Discontinuous),
}

const FUNCTIONS: [(&str, Function); 30] = [
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
    ("floor", Function::Discontinuous(Discontinuous::Floor)),
    ("ceil", Function::Discontinuous(Discontinuous::Ceil)),
    ("round", Function::Discontinuous(Discontinuous::Round)),
    ("mod", Function::Discontinuous(Discontinuous::Modulo)),
    ("if", Function::Discontinuous(Discontinuous::If)),
    ("pwm", Function::Discontinuous(Discontinuous::Pwm)),
    ("sawtooth", Function::Discontinuous(Discontinuous::Sawtooth)),
    ("triangle", Function::Discontinuous(Discontinuous::Triangle)),
    ("pulse", Function::Discontinuous(Discontinuous::Pulse)),
];

/// Names of functions in other languages, with their equivalents in this language.
const FUNCTION_SYNONYMS: [(&str, &str); 39] = [
    ("log", "ln"),
    ("sqr", "a^2"),
    ("tg", "tan"),
    ("ctg", "1/tan(a)"),
    ("arcsin", "asin"),
    ("arccos", "acos"),
    ("arctan", "atan"),
    ("arctan2", "atan2"),
    ("sgn", "sign"),
    ("fabs", "abs"),
    ("log2", "ln(a)/ln(2)"),
    ("square", "pwm(t, period, 0.5)"),
    ("saw", "sawtooth"),
    ("tri", "triangle"),
    ("rect", "pulse"),
    ("rectpuls", "pulse"),
    ("trapezoid", "a table, under `tables`"),
    ("pwl", "a table, under `tables`"),
    ("interp", "a table, under `tables`"),
    ("interp1", "a table, under `tables`"),
    ("interpolate", "a table, under `tables`"),
    ("lookup", "a table, under `tables`"),
    ("table", "a table, under `tables`"),
    ("spline", "a table, under `tables`"),
    ("step", "heaviside"),
    ("theta", "heaviside"),
    ("ceiling", "ceil"),
    ("trunc", "sign(a)*floor(abs(a))"),
    ("fix", "sign(a)*floor(abs(a))"),
    ("int", "floor"),
    ("fmod", "mod"),
    ("rem", "mod"),
    ("modulo", "mod"),
    ("ifelse", "if"),
    ("where", "if"),
    ("piecewise", "if"),
    ("clip", "min(max(a, low), high)"),
    ("sat", "min(max(a, low), high)"),
    ("limit", "min(max(a, low), high)"),
];

impl Function {
    pub(super) fn named(name: &str) -> Option<Self> {
        FUNCTIONS.iter().find(|(known, _)| *known == name).map(|&(_, function)| function)
    }

    pub(super) fn names<'a>() -> impl Iterator<Item = &'a str> {
        FUNCTIONS.iter().map(|&(name, _)| name)
    }

    /// Whether users cannot define this name. Names of discontinuous functions are not reserved, so that users may
    /// bind them: before a parenthesis they denote the function, otherwise the user's name.
    pub(super) fn is_reserved(self) -> bool {
        !matches!(self, Self::Discontinuous(_))
    }

    /// Returns the number of arguments that the function takes, in words.
    pub(super) fn arity(self) -> &'static str {
        match self {
            Self::Unary(_) => "one argument",
            Self::Binary(_) | Self::Power => "two arguments",
            Self::Extremum(_) => "two or more arguments",
            Self::Discontinuous(stepped) => stepped.arity().0,
        }
    }

    /// Whether the function accepts `arguments` as its number of arguments.
    pub(super) fn takes(self, arguments: usize) -> bool {
        match self {
            Self::Unary(_) => arguments == 1,
            Self::Binary(_) | Self::Power => arguments == 2,
            Self::Extremum(_) => arguments >= 2,
            Self::Discontinuous(stepped) => arguments == stepped.arity().1,
        }
    }

    /// Builds the term of the function for an accepted number of arguments.
    pub(super) fn apply(self, graph: &mut Graph, arguments: &[Node]) -> Node {
        let a = arguments[0];
        match self {
            Self::Unary(operator) => graph.unary(operator, a),
            Self::Binary(operator) => graph.binary(operator, a, arguments[1]),
            Self::Power => graph.power(a, arguments[1]),
            Self::Extremum(operator) => {
                arguments[1..].iter().fold(a, |extremum, &b| graph.extremum(operator, extremum, b))
            }
            Self::Discontinuous(stepped) => stepped.apply(graph, arguments),
        }
    }
}

impl Graph {
    /// Builds `min` or `max` of two terms. For equal arguments the derivative is that of the second argument;
    /// constants become the second argument, so that `sqrt(max(x, 0))` has the derivative 0 at 0 and not infinity.
    fn extremum(&mut self, operator: Operator, a: Node, b: Node) -> Node {
        match self.value(a) {
            Some(_) => self.binary(operator, b, a),
            None => self.binary(operator, a, b),
        }
    }
}

/// Returns the equivalent in this language of a name from another language.
pub(super) fn synonym(name: &str, called: bool) -> Option<&'static str> {
    let function = FUNCTION_SYNONYMS.iter().find(|(foreign, _)| called && *foreign == name).map(|&(_, ours)| ours);
    function.or((name == "e" && !called).then_some("exp(1)"))
}
