//! Where expressions are not locally Lipschitz: by the ranges of the arguments of those functions that have a jump, an
//! infinite slope or a pole somewhere.
//!
//! - `sign`, `heaviside` and `atan2` jump; `sqrt`, `cbrt`, `asin`, `acos` and powers below one have an infinite slope.
//! - The root of a nonnegative function with Lipschitz derivatives is Lipschitz (Glaeser 1963, Racine carree d'une fonction
//!   differentiable): `sqrt(x^2 + y^2)` is, `sqrt(abs(x))` is not. Of `acos(f)` with `|f| <= 1` the same holds.
//! - At a pole an expression has no value, so that a differential equation ends there and remains Lipschitz before,
//!   unless another function has a finite value at infinity: `atan(1/x)` jumps.
//! - `abs`, `min` and `max` are Lipschitz.
//!
//! What depends on input 0 alone, time, does not matter: a differential equation may jump in time.

use super::enclosure::IntervalWorkspace;
use super::graph::{Graph, Node, Term};
use super::operator::Operator;
use super::tape::Tape;
use numerics::Interval;
use rustc_hash::{FxHashMap, FxHashSet};

/// A function in an expression that is not Lipschitz at some of its arguments.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Irregularity {
    /// The function as the language calls it, or `/` and `^`.
    pub function: &'static str,
    /// The inputs that its arguments depend on, sorted.
    pub inputs: Vec<usize>,
    /// Whether it jumps there; otherwise it is continuous, or the expression may be.
    pub jumps: bool,
    points: Points,
}

/// The arguments at which a function is not Lipschitz.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Points {
    /// Zero.
    Zero,
    /// Zero and below.
    NotPositive,
    /// The ends of `[-1, 1]` and what is outside.
    NotInsideUnit,
    /// A first argument of zero beside a second that is not positive.
    Cut,
}

impl Points {
    fn meet(self, a: Interval, b: Interval) -> bool {
        match self {
            Self::Zero => a.contains(0.0),
            Self::NotPositive => a.lo <= 0.0,
            Self::NotInsideUnit => a.lo <= -1.0 || a.hi >= 1.0,
            Self::Cut => a.contains(0.0) && b.lo <= 0.0,
        }
    }
}

/// The functions in some expressions that are not Lipschitz everywhere, with their arguments compiled.
#[derive(Clone, Debug, Default)]
pub struct Irregularities {
    found: Vec<Irregularity>,
    /// Two arguments of each.
    arguments: Tape,
    workspace: IntervalWorkspace,
    ranges: Vec<Interval>,
}

impl Irregularities {
    /// Those of `nodes` that depend on another input than 0, and that no bound of their arguments excludes.
    pub fn new(graph: &Graph, nodes: &[Node]) -> Self {
        let mut pairs = graph.irregularities(nodes);
        let mut all = Self::compiled(graph, &pairs);
        let lines = vec![Interval::LINE; all.arguments.program.inputs];
        let met = all.met(Interval::LINE, lines.get(1..).unwrap_or_default());
        if met.contains(&false) {
            let mut met = met.into_iter();
            pairs.retain(|_| met.next() == Some(true));
            all = Self::compiled(graph, &pairs);
        }
        all
    }

    fn compiled(graph: &Graph, pairs: &[(Irregularity, [Node; 2])]) -> Self {
        let arguments: Vec<Node> = pairs.iter().flat_map(|(_, arguments)| *arguments).collect();
        let tape = Tape::compile(graph, &arguments);
        Self {
            found: pairs.iter().map(|(found, _)| found.clone()).collect(),
            workspace: IntervalWorkspace::new(&tape),
            arguments: tape,
            ranges: vec![Interval::EMPTY; arguments.len()],
        }
    }

    /// Whether the expressions are locally Lipschitz wherever they have a value.
    pub fn is_empty(&self) -> bool {
        self.found.is_empty()
    }

    /// One that arguments over the box meet, a jump before anything else. The first input, time, is in `first`.
    pub fn over(&mut self, first: Interval, rest: &[Interval]) -> Option<&Irregularity> {
        let met = self.met(first, rest);
        let among = || self.found.iter().zip(&met).filter(|(_, met)| **met).map(|(found, _)| found);
        among().find(|found| found.jumps).or_else(|| among().next())
    }

    fn met(&mut self, first: Interval, rest: &[Interval]) -> Vec<bool> {
        self.arguments.enclose(first, rest, &mut self.workspace, &mut self.ranges);
        let pairs = self.found.iter().zip(self.ranges.chunks(2));
        pairs.map(|(found, pair)| found.points.meet(pair[0], pair[1])).collect()
    }
}

impl Graph {
    /// The functions that are not Lipschitz at some arguments, with their arguments, the only one twice.
    fn irregularities(&self, nodes: &[Node]) -> Vec<(Irregularity, [Node; 2])> {
        let mut terms = self.terms_below(nodes);
        if !terms
            .iter()
            .any(|y| matches!(self.terms[y.place()], Term::Apply(operator, ..) if operator.may_be_irregular()))
        {
            return Vec::new();
        }
        terms.sort_unstable();
        let of_states = self.of_states(&terms);
        let (known, hidden) = (self.regularities(&terms, &of_states), self.hidden(&terms));
        let (half_line, unit) = (Interval::new(0.0, f64::INFINITY), Interval::new(-1.0, 1.0));
        let mut found = Vec::new();
        for &y in &terms {
            let Term::Apply(operator, a, b) = self.terms[y.place()] else { continue };
            let pole = hidden.contains(&y);
            let touches = |domain| known[&a].touches_only(domain);
            let exponent = self.value(b).filter(|_| operator == Operator::Power);
            let (function, arguments, points, jumps) = match operator {
                Operator::Sign => ("sign", [a, a], Points::Zero, true),
                Operator::Heaviside => ("heaviside", [a, a], Points::Zero, true),
                Operator::Atan2 => ("atan2", [a, b], Points::Cut, true),
                Operator::Cbrt => ("cbrt", [a, a], Points::Zero, false),
                Operator::Sqrt if !touches(half_line) => ("sqrt", [a, a], Points::NotPositive, false),
                Operator::Asin if !touches(unit) => ("asin", [a, a], Points::NotInsideUnit, false),
                Operator::Acos if !touches(unit) => ("acos", [a, a], Points::NotInsideUnit, false),
                Operator::Power => match exponent {
                    Some(exponent) if exponent >= 1.0 || (exponent >= 0.5 && touches(half_line)) => continue,
                    Some(exponent) if exponent < 0.0 && !pole => continue,
                    _ => ("^", [a, a], Points::NotPositive, exponent.is_some_and(|exponent| exponent < 0.0)),
                },
                Operator::Divide if pole => ("/", [b, b], Points::Zero, true),
                Operator::Ln if pole => ("ln", [a, a], Points::NotPositive, true),
                Operator::Log10 if pole => ("log10", [a, a], Points::NotPositive, true),
                _ => continue,
            };
            if arguments.iter().any(|node| of_states.contains(node)) {
                let inputs = self.inputs_of(&arguments);
                found.push((Irregularity { function, inputs, jumps, points }, arguments));
            }
        }
        found
    }

    /// The terms that depend on another input than time.
    fn of_states(&self, terms: &[Node]) -> FxHashSet<Node> {
        let mut found = FxHashSet::default();
        for &y in terms {
            let depends = match self.terms[y.place()] {
                Term::Constant(_) => false,
                Term::Input(index) => index > 0,
                Term::Apply(_, a, b) => found.contains(&a) || found.contains(&b),
            };
            if depends {
                found.insert(y);
            }
        }
        found
    }

    /// What is known of each term on the whole space.
    fn regularities(&self, terms: &[Node], of_states: &FxHashSet<Node>) -> FxHashMap<Node, Regularity> {
        let mut known: FxHashMap<Node, Regularity> = FxHashMap::default();
        for &y in terms {
            let regularity = match self.terms[y.place()] {
                Term::Constant(bits) => Regularity { range: Interval::point(f64::from_bits(bits)), smooth: true },
                Term::Input(_) => Regularity { range: Interval::LINE, smooth: true },
                Term::Apply(operator, a, b) => {
                    let (first, second) = (known[&a], known[&b]);
                    let range = operator.enclose(first.range, second.range, a == b);
                    let smooth = first.smooth && second.smooth && operator.is_smooth(first.range, second.range);
                    Regularity { range, smooth: smooth || !of_states.contains(&y) }
                }
            };
            known.insert(y, regularity);
        }
        known
    }

    /// The terms that reach a function with a finite value at infinity, so that their poles are hidden.
    fn hidden(&self, terms: &[Node]) -> FxHashSet<Node> {
        let mut hidden = FxHashSet::default();
        for &y in terms.iter().rev() {
            let Term::Apply(operator, a, b) = self.terms[y.place()] else { continue };
            let (first, second) = match operator {
                Operator::Atan
                | Operator::Tanh
                | Operator::Exp
                | Operator::Sign
                | Operator::Heaviside
                | Operator::Power
                | Operator::Atan2
                | Operator::Min
                | Operator::Max
                | Operator::Greater
                | Operator::Gate => (true, true),
                Operator::Divide => (false, true),
                _ => (false, false),
            };
            for (operand, hides) in [(a, first), (b, second && !operator.is_unary())] {
                if hides || hidden.contains(&y) {
                    hidden.insert(operand);
                }
            }
        }
        hidden
    }
}

/// What is known of a term on the whole space.
#[derive(Clone, Copy)]
struct Regularity {
    range: Interval,
    /// Whether it has Lipschitz derivatives, by other inputs than time, wherever it has a value.
    smooth: bool,
}

impl Regularity {
    /// Whether the term never leaves `domain`, and reaches its ends only as a smooth function touches an extremum.
    fn touches_only(self, domain: Interval) -> bool {
        self.smooth && self.range.defined && domain.contains(self.range.lo) && domain.contains(self.range.hi)
    }
}

impl Operator {
    /// Whether it is not Lipschitz at some arguments, or has a pole.
    fn may_be_irregular(self) -> bool {
        matches!(
            self,
            Self::Sign
                | Self::Heaviside
                | Self::Atan2
                | Self::Cbrt
                | Self::Sqrt
                | Self::Asin
                | Self::Acos
                | Self::Power
                | Self::Divide
                | Self::Ln
                | Self::Log10
        )
    }

    /// Whether it has Lipschitz derivatives at all arguments in these ranges at which it has a value.
    fn is_smooth(self, a: Interval, b: Interval) -> bool {
        match self {
            Self::Abs | Self::Sign | Self::Heaviside | Self::Cbrt => !a.contains(0.0),
            Self::Sqrt => a.lo > 0.0,
            Self::Asin | Self::Acos => a.lo > -1.0 && a.hi < 1.0,
            Self::Power => a.lo > 0.0 || (b.lo == b.hi && b.lo >= 2.0),
            Self::Min | Self::Max => a.hi < b.lo || b.hi < a.lo,
            Self::Atan2 => b.lo > 0.0,
            Self::Greater | Self::Gate => false,
            _ => true,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::super::Scope;
    use super::*;

    /// The function that is not Lipschitz where `x` is in an interval and `y` anywhere, and whether it jumps.
    fn met(text: &str, x: Interval) -> Option<(&'static str, bool)> {
        let (mut graph, mut scope) = (Graph::new(), Scope::new());
        for (index, name) in ["t", "x", "y"].into_iter().enumerate() {
            scope.bind(name, graph.input(index)).unwrap();
        }
        let node = graph.parse(text, &scope).unwrap();
        let mut irregularities = Irregularities::new(&graph, &[node]);
        irregularities.over(Interval::LINE, &[x, Interval::LINE]).map(|found| (found.function, found.jumps))
    }

    #[test]
    fn textbook_examples_are_found() {
        for (text, function, jumps) in [
            ("sign(x)", "sign", true),
            ("2*sqrt(abs(x))", "sqrt", false),
            ("3*cbrt(x)^2", "cbrt", false),
            ("abs(x)^0.7", "^", false),
            ("abs(x)^(2/3)*y", "^", false),
            ("x^y", "^", false),
            ("heaviside(x - t)", "heaviside", true),
            ("atan2(x, y)", "atan2", true),
            ("asin(x)", "asin", false),
            ("sqrt(1 - x^2)", "sqrt", false),
            // -1/ln(x) vanishes at 0 with an infinite slope; x is 0 or leaves it.
            ("-1/ln(x)", "ln", true),
            ("atan(1/x)", "/", true),
            ("y*sqrt(x)", "sqrt", false),
        ] {
            assert_eq!(met(text, Interval::LINE), Some((function, jumps)), "{text}");
        }
    }

    #[test]
    fn what_is_lipschitz_is_not() {
        for text in [
            "abs(x) + min(x, y) + max(x, 0)",
            "sqrt(1 + x^2)",
            "-sqrt(x^2 + y^2)*x",
            "sqrt(1 - cos(x)) + acos(cos(x))",
            "(x^2 + y^2)^0.75",
            "abs(x)^1.5",
            "sqrt(t)*x + heaviside(t - 1)*y + sign(sin(t))",
            "x/(x^2 + y^2)^1.5",
            "ln(x) + 1/y",
            "cbrt(1 + x^2) + atan2(x, 1 + y^2)",
            "exp(-x^2)/(1 + exp(-y))",
            "asin(0.9*sin(x))",
        ] {
            assert_eq!(met(text, Interval::LINE), None, "{text}");
        }
    }

    #[test]
    fn the_range_of_the_arguments_decides() {
        assert_eq!(met("sqrt(x)", Interval::new(1.0, 2.0)), None);
        assert_eq!(met("sqrt(x)", Interval::new(0.0, 2.0)), Some(("sqrt", false)));
        assert_eq!(met("sign(x - 3)", Interval::new(1.0, 2.0)), None);
        assert_eq!(met("exp(-1/x)", Interval::new(250.0, 400.0)), None);
        assert_eq!(met("atan2(y, x)", Interval::new(0.5, 1.0)), None);
    }
}
