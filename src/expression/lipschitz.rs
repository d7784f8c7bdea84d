//! Irregularities: points where expressions are not locally Lipschitz, found from the ranges of the arguments of
//! functions with a jump, an infinite slope or a pole.
//!
//! - `sign`, `heaviside`, `floor`, `round`, `mod` and `atan2` jump.
//! - `sqrt`, `cbrt`, `asin`, `acos` and powers below one have an infinite slope.
//! - The root of a nonnegative function with Lipschitz derivatives is Lipschitz (Glaeser 1963, Racine carree d'une
//!   fonction differentiable): `sqrt(x^2 + y^2)` is, `sqrt(abs(x))` is not. This also holds for `acos(f)` with
//!   `|f| <= 1`.
//! - At a pole an expression has no value: the solution of a differential equation ends at the pole and is Lipschitz
//!   before it, unless another function has a finite value at infinity, as in `atan(1/x)`, which jumps.
//! - `abs`, `min` and `max` are Lipschitz.
//!
//! Terms in input 0 (time) alone are ignored: a differential equation may jump in time.
//!
//! Irregularities that depend on parameters (`sqrt(x^2 + c)` is Lipschitz for positive `c`) are updated when parameters
//! are bound.

use super::enclosure::IntervalWorkspace;
use super::graph::{Graph, Node};
use super::operator::Operator;
use super::tape::Tape;
use numerics::Interval;
use rustc_hash::FxHashSet;

/// A function in an expression that is not Lipschitz at some arguments.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Irregularity {
    /// The name of the function in the language, or `/` or `^`.
    pub function: &'static str,
    /// The inputs that the arguments of the function depend on, sorted.
    pub inputs: Vec<usize>,
    /// Whether the expression jumps at the irregular arguments; otherwise it is continuous, or may be continuous.
    pub jumps: bool,
    points: Points,
}

/// The arguments at which a function is not Lipschitz.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Points {
    /// Zero: the function is not Lipschitz where its argument is zero.
    Zero,
    /// Zero and all negative arguments: the function is not Lipschitz there.
    NotPositive,
    /// All points outside the open interval `(-1, 1)`: the function is not Lipschitz there.
    NotInsideUnit,
    /// The branch cut of `atan2`, where it jumps: first argument zero, second argument not positive.
    Cut,
    /// Unknown points: any argument may be irregular.
    Anywhere,
}

impl Points {
    fn meet(self, a: Interval, b: Interval) -> bool {
        match self {
            Self::Zero => a.contains(0.0),
            Self::NotPositive => a.lo <= 0.0,
            Self::NotInsideUnit => a.lo <= -1.0 || a.hi >= 1.0,
            Self::Cut => a.contains(0.0) && b.lo <= 0.0,
            Self::Anywhere => true,
        }
    }
}

/// A function in an expression that is not Lipschitz at some values of its arguments, whether or not these values
/// occur.
#[derive(Clone, Debug)]
struct Candidate {
    operator: Operator,
    /// Whether another function with a finite value at infinity, such as `atan`, takes the term as its argument and so
    /// hides its pole.
    pole: bool,
    /// Whether the operator of the function is a power with a constant exponent.
    has_constant_exponent: bool,
    inputs: Vec<usize>,
}

/// The functions in some expressions that are not Lipschitz everywhere, with their arguments compiled.
#[derive(Clone, Debug, Default)]
pub struct Irregularities {
    candidates: Vec<Candidate>,
    /// The irregularities that the ranges of the arguments over the whole space do not exclude, each with its index
    /// into `candidates`.
    found: Vec<(usize, Irregularity)>,
    /// The compiled arguments of the candidates, two for each.
    arguments: Tape,
    workspace: IntervalWorkspace,
    ranges: Vec<Interval>,
}

impl Irregularities {
    /// Finds the irregularities of `nodes` (functions that are not Lipschitz at some arguments) that depend on inputs
    /// other than 0 (time).
    pub fn new(graph: &Graph, nodes: &[Node]) -> Self {
        let (candidates, arguments): (Vec<Candidate>, Vec<[Node; 2]>) = graph.candidates(nodes).into_iter().unzip();
        let arguments = arguments.concat();
        let tape = Tape::compile(graph, &arguments);
        let mut all = Self {
            candidates,
            found: Vec::new(),
            workspace: IntervalWorkspace::new(&tape),
            arguments: tape,
            ranges: vec![Interval::EMPTY; arguments.len()],
        };
        all.decide();
        all
    }

    /// Binds new parameter values and updates the irregularities (points where expressions are not Lipschitz).
    pub fn bind(&mut self, parameters: &[f64]) {
        if !self.candidates.is_empty() {
            self.arguments.bind(parameters);
            self.workspace.bind(&self.arguments);
            self.decide();
        }
    }

    /// Sets `found` to those candidates (functions that are not Lipschitz everywhere) whose arguments may reach an
    /// irregular point for some inputs in the whole space.
    fn decide(&mut self) {
        let known = self.arguments.regularities();
        let pairs = self.arguments.program.outputs.chunks(2);
        let judged = self.candidates.iter().zip(pairs).enumerate().filter_map(|(k, (candidate, pair))| {
            let [a, b] = [pair[0], pair[1]].map(|register| known[register as usize]);
            candidate.judged(a, b).map(|found| (k, found))
        });
        self.found = judged.collect();
    }

    /// Whether the expressions are locally Lipschitz on their domain.
    pub fn is_empty(&self) -> bool {
        self.found.is_empty()
    }

    /// Returns an irregularity (a function that is not Lipschitz) that may occur in a box of inputs, jumps first. The
    /// first input (time) lies in `first`, the others in `rest`.
    pub fn over(&mut self, first: Interval, rest: &[Interval]) -> Option<&Irregularity> {
        self.arguments.enclose(first, rest, &mut self.workspace, &mut self.ranges);
        let ranges = &self.ranges;
        let met = |found: &(usize, Irregularity)| {
            let (k, irregularity) = found;
            irregularity.points.meet(ranges[2 * k], ranges[2 * k + 1])
        };
        let among = || self.found.iter().filter(|found| met(found)).map(|(_, found)| found);
        among().find(|found| found.jumps).or_else(|| among().next())
    }
}

impl Candidate {
    /// Returns the irregularity of the candidate (the points at which its function is not Lipschitz), if arguments
    /// with the given ranges and smoothness may reach it.
    fn judged(&self, a: Regularity, b: Regularity) -> Option<Irregularity> {
        let (half_line, unit) = (Interval::new(0.0, f64::INFINITY), Interval::new(-1.0, 1.0));
        let exponent = (self.has_constant_exponent && b.range.lo == b.range.hi).then_some(b.range.lo);
        let (function, points, jumps) = match self.operator {
            Operator::Sign => ("sign", Points::Zero, true),
            Operator::Heaviside => ("heaviside", Points::Zero, true),
            Operator::Atan2 => ("atan2", Points::Cut, true),
            Operator::Floor => ("floor", Points::Anywhere, true),
            Operator::Round => ("round", Points::Anywhere, true),
            Operator::Modulo => ("mod", Points::Anywhere, true),
            Operator::Cbrt => ("cbrt", Points::Zero, false),
            Operator::Sqrt if !a.touches_only(half_line) => ("sqrt", Points::NotPositive, false),
            Operator::Asin if !a.touches_only(unit) => ("asin", Points::NotInsideUnit, false),
            Operator::Acos if !a.touches_only(unit) => ("acos", Points::NotInsideUnit, false),
            Operator::Power => match exponent {
                Some(exponent) if exponent >= 1.0 || (exponent >= 0.5 && a.touches_only(half_line)) => return None,
                Some(exponent) if exponent < 0.0 && !self.pole => return None,
                _ => ("^", Points::NotPositive, exponent.is_some_and(|exponent| exponent < 0.0)),
            },
            Operator::Divide if self.pole => ("/", Points::Zero, true),
            Operator::Ln if self.pole => ("ln", Points::NotPositive, true),
            Operator::Log10 if self.pole => ("log10", Points::NotPositive, true),
            _ => return None,
        };
        points.meet(a.range, b.range).then(|| Irregularity { function, inputs: self.inputs.clone(), jumps, points })
    }
}

impl Tape {
    /// Returns range and smoothness of each register of the program, for inputs in the whole space.
    fn regularities(&self) -> Vec<Regularity> {
        let (inputs, first) = (self.program.inputs, self.program.first);
        let leaf = |(register, &value): (usize, &f64)| match register < inputs {
            true => Regularity { range: Interval::LINE, smooth: true, of_states: register > 0 },
            false => Regularity { range: Interval::point(value), smooth: true, of_states: false },
        };
        let mut known: Vec<Regularity> = self.registers[..first].iter().enumerate().map(leaf).collect();
        self.for_each_operation(|operator, a, b| {
            let (first, second) = (known[a], known[b]);
            let range = self.program.tables.enclose(operator, first.range, second.range, a == b);
            let of_states = first.of_states || second.of_states;
            let smooth = first.smooth && second.smooth && operator.is_smooth(first.range, second.range);
            known.push(Regularity { range, smooth: smooth || !of_states, of_states });
        });
        known
    }
}

impl Graph {
    /// Returns the functions that may not be Lipschitz, each with two arguments: a single argument is repeated, and a
    /// power with constant exponent has its exponent as second argument.
    fn candidates(&self, nodes: &[Node]) -> Vec<(Candidate, [Node; 2])> {
        let mut terms = self.terms_below(nodes);
        let operator = |y: Node| self.operation(y).map(|(operator, ..)| operator);
        if !terms.iter().any(|&y| operator(y).is_some_and(Operator::may_be_irregular)) {
            return Vec::new();
        }
        terms.sort_unstable();
        let of_states = self.of_states(&terms);
        let hidden = self.hidden(&terms);
        let mut found = Vec::new();
        for &y in &terms {
            let Some((operator, a, b)) = self.operation(y) else { continue };
            let pole = hidden.contains(&y);
            let has_constant_exponent = operator == Operator::Power && self.value(b).is_some();
            let arguments = match operator {
                Operator::Divide | Operator::Ln | Operator::Log10 if !pole => continue,
                Operator::Divide => [b, b],
                Operator::Atan2 | Operator::Modulo => [a, b],
                Operator::Power if has_constant_exponent => [a, b],
                _ => [a, a],
            };
            if operator.may_be_irregular() && arguments.iter().any(|node| of_states.contains(node)) {
                let inputs = self.inputs_of(&arguments);
                found.push((Candidate { operator, pole, has_constant_exponent, inputs }, arguments));
            }
        }
        found
    }

    /// Returns the terms that depend on inputs other than time.
    fn of_states(&self, terms: &[Node]) -> FxHashSet<Node> {
        let mut found = FxHashSet::default();
        for &y in terms {
            let depends = match self.operation(y) {
                Some((_, a, b)) => found.contains(&a) || found.contains(&b),
                None => self.is_input(y, |index| index > 0),
            };
            if depends {
                found.insert(y);
            }
        }
        found
    }

    /// Returns the terms whose poles are hidden because a function with a finite value at infinity, such as `atan`,
    /// uses them.
    fn hidden(&self, terms: &[Node]) -> FxHashSet<Node> {
        let mut hidden = FxHashSet::default();
        for &y in terms.iter().rev() {
            let Some((operator, a, b)) = self.operation(y) else { continue };
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
                | Operator::Gate
                | Operator::Choose
                | Operator::Parity
                | Operator::Modulo
                | Operator::Lookup
                | Operator::Piece => (true, true),
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

/// Range and smoothness of a term, for inputs in the whole space.
#[derive(Clone, Copy)]
struct Regularity {
    range: Interval,
    /// Whether the term has Lipschitz derivatives with respect to inputs other than time, on its domain.
    smooth: bool,
    /// Whether the term depends on inputs other than time.
    of_states: bool,
}

impl Regularity {
    /// Whether the term stays in `domain` and is smooth, so that it touches the ends of the domain only at its
    /// extrema.
    fn touches_only(self, domain: Interval) -> bool {
        self.smooth && self.range.defined && domain.contains(self.range.lo) && domain.contains(self.range.hi)
    }
}

impl Operator {
    /// Whether the operator is not Lipschitz at some arguments, or has a pole.
    fn may_be_irregular(self) -> bool {
        matches!(
            self,
            Self::Sign
                | Self::Heaviside
                | Self::Floor
                | Self::Round
                | Self::Modulo
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

    /// Whether the operator has Lipschitz derivatives at all arguments in the given ranges at which it has a value.
    fn is_smooth(self, a: Interval, b: Interval) -> bool {
        match self {
            Self::Abs | Self::Sign | Self::Heaviside | Self::Cbrt => !a.contains(0.0),
            Self::Sqrt => a.lo > 0.0,
            Self::Asin | Self::Acos => a.lo > -1.0 && a.hi < 1.0,
            Self::Power => a.lo > 0.0 || (b.lo == b.hi && b.lo >= 2.0),
            Self::Min | Self::Max => a.hi < b.lo || b.hi < a.lo,
            Self::Atan2 => b.lo > 0.0,
            Self::Greater | Self::Gate => false,
            Self::Floor | Self::Round | Self::Parity | Self::Modulo | Self::Lookup | Self::Piece => false,
            // Conditions never depend on states, only on time, in which jumps are admissible.
            Self::Choose => true,
            _ => true,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::super::Scope;
    use super::*;

    /// Returns the name of a function in `text` that is not Lipschitz for `x` in an interval and any `y`, and whether
    /// it jumps.
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
            // -1/ln(x) vanishes at 0 with an infinite slope: the solution x = 0 is not unique.
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
