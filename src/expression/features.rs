//! Features that evaluation at a few points may miss: nonpolynomial dependence (or dependence of high degree) on the
//! inputs after the first, jumps, and the knots of tables.

use super::enclosure::IntervalWorkspace;
use super::graph::{Graph, Node, Term};
use super::operator::Operator;
use super::tape::Tape;
use numerics::Interval;
use rustc_hash::FxHashMap;

/// Compiled terms of a graph, with the enclosures of their values over a box of inputs.
#[derive(Clone, Debug, Default)]
struct Ranges {
    tape: Tape,
    workspace: IntervalWorkspace,
    ranges: Vec<Interval>,
}

impl Ranges {
    fn new(graph: &Graph, mut quantities: Vec<Node>) -> Self {
        quantities.sort_unstable();
        quantities.dedup();
        let tape = Tape::compile(graph, &quantities);
        Self { workspace: IntervalWorkspace::new(&tape), ranges: vec![Interval::LINE; quantities.len()], tape }
    }

    fn bind(&mut self, parameters: &[f64]) {
        self.tape.bind(parameters);
        self.workspace.bind(&self.tape);
    }

    /// Whether `is_such` holds for the range of any compiled term, or a range is unknown, over the box of inputs with
    /// the first input in `t` and the others in `rest`.
    fn any(&mut self, t: Interval, rest: &[Interval], is_such: impl Fn(&Interval) -> bool) -> bool {
        if self.ranges.is_empty() {
            return false;
        }
        self.tape.enclose(t, rest, &mut self.workspace, &mut self.ranges);
        self.ranges.iter().any(|range| !range.defined || is_such(range))
    }
}

/// The compiled event functions at whose sign changes some expressions jump: switches of discontinuous functions and
/// first arguments of `atan2`, if they depend on inputs after the first.
#[derive(Clone, Debug, Default)]
pub struct Jumps(Ranges);

impl Jumps {
    /// Compiles the event functions at which `nodes` jump.
    pub fn new(graph: &mut Graph, nodes: &[Node]) -> Self {
        let terms = graph.terms_below(nodes);
        let jump = |node: Node| match graph.operation(node)? {
            (Operator::Atan2, quantity, _) => Some(quantity),
            (operator, ..) if operator.jumps() => graph.switch(node).map(|(_, quantity)| quantity),
            _ => None,
        };
        let mut quantities: Vec<Node> = terms.into_iter().filter_map(jump).collect();
        quantities.retain(|&quantity| graph.inputs(quantity).iter().any(|&input| input > 0));
        Self(Ranges::new(graph, quantities))
    }

    /// Binds new parameter values to the compiled event functions at whose sign changes expressions jump.
    pub fn bind(&mut self, parameters: &[f64]) {
        self.0.bind(parameters);
    }

    /// Whether an event function may change sign, so that an expression jumps, in the box with the first input in `t`
    /// and the others in `rest`.
    pub fn may_be_in(&mut self, t: Interval, rest: &[Interval]) -> bool {
        self.0.any(t, rest, |range| range.contains(0.0))
    }
}

/// The knots of tables of inputs after the first. At a knot one polynomial piece of a table ends and the next begins,
/// so that the value or a derivative of some order jumps.
#[derive(Clone, Debug, Default)]
pub struct Knots(Ranges);

impl Knots {
    /// Compiles, for each table in `nodes`, the number of the polynomial piece to which its argument belongs.
    pub fn new(graph: &mut Graph, nodes: &[Node]) -> Self {
        let terms = graph.terms_below(nodes);
        let piece = |node: Node| match graph.operation(node)? {
            (Operator::Lookup, a, place) if graph.inputs(a).iter().any(|&input| input > 0) => {
                let table = graph.table_of(Operator::Lookup, place)?.clone();
                Some(graph.of_table(Operator::Piece, &table, a))
            }
            _ => None,
        };
        let pieces = terms.into_iter().filter_map(piece).collect();
        Self(Ranges::new(graph, pieces))
    }

    /// Binds new parameter values to the compiled numbers of the pieces of the tables.
    pub fn bind(&mut self, parameters: &[f64]) {
        self.0.bind(parameters);
    }

    /// Whether the argument of a table may pass a knot (an end of a polynomial piece) in the box with the first input
    /// in `t` and the others in `rest`.
    pub fn may_be_in(&mut self, t: Interval, rest: &[Interval]) -> bool {
        self.0.any(t, rest, |range| range.lo < range.hi)
    }
}

impl Graph {
    /// Whether no term of `node` has a kink or a jump, so that its derivatives hold everywhere.
    pub fn is_smooth(&mut self, node: Node) -> bool {
        let is_atan2 = |graph: &Self, term| matches!(graph.operation(term), Some((Operator::Atan2, ..)));
        self.terms_below(&[node]).into_iter().all(|term| !is_atan2(self, term) && self.switch(term).is_none())
    }

    /// Returns the indices of those `nodes` that are not polynomials of at most the given degree in the inputs after
    /// the first.
    pub fn beyond_degree(&self, nodes: &[Node], degree: u32) -> Vec<usize> {
        let mut terms = self.terms_below(nodes);
        terms.sort_unstable();
        // Operands come before the terms that use them; nonpolynomial terms have the degree `None`.
        let mut degrees: FxHashMap<Node, Option<u32>> = FxHashMap::default();
        for node in terms {
            let degree = match (self.terms[node.place()], self.operation(node)) {
                (Term::Input(index), _) => Some(u32::from(index > 0)),
                (_, None) => Some(0),
                (_, Some((operator, a, b))) => {
                    let of_b = if operator.is_unary() { Some(0) } else { degrees[&b] };
                    degree_of(operator, degrees[&a], of_b, self.number(b))
                }
            };
            degrees.insert(node, degree);
        }
        (0..nodes.len()).filter(|&i| degrees[&nodes[i]].is_none_or(|found| found > degree)).collect()
    }
}

/// Returns the degree of the result of an operator on polynomials of degrees `a` and `b`; `number` is the value of a
/// constant second operand. Returns `None` if an operand or the result is not a polynomial.
fn degree_of(operator: Operator, a: Option<u32>, b: Option<u32>, number: Option<f64>) -> Option<u32> {
    let (a, b) = (a?, b?);
    match operator {
        Operator::Negate | Operator::Expanded => Some(a),
        Operator::Add | Operator::Subtract => Some(a.max(b)),
        Operator::Multiply => Some(a.saturating_add(b)),
        Operator::Divide if b == 0 => Some(a),
        Operator::Power => match number {
            Some(exponent) if exponent >= 0.0 && exponent.fract() == 0.0 => {
                Some((f64::from(a) * exponent).min(f64::from(u32::MAX)) as u32)
            }
            _ => (a == 0 && b == 0).then_some(0),
        },
        _ => (a == 0 && b == 0).then_some(0),
    }
}

#[cfg(test)]
mod tests {
    use super::super::Scope;
    use super::*;

    fn read(texts: &[&str]) -> (Graph, Vec<Node>) {
        let (mut graph, mut scope) = (Graph::new(), Scope::new());
        for (index, name) in ["t", "x", "y"].into_iter().enumerate() {
            scope.bind(name, graph.input(index)).unwrap();
        }
        let nodes = texts.iter().map(|text| graph.parse(text, &scope).unwrap()).collect();
        (graph, nodes)
    }

    #[test]
    fn polynomials_are_told_by_their_degree_and_time_has_none() {
        let texts = ["sin(t)*x^2*y", "x^3/(2 + t^2)", "(x*y)^2*x", "1/x", "exp(-x^2)", "2*x^y", "heaviside(x - t)"];
        let (graph, nodes) = read(&texts);
        assert_eq!(graph.beyond_degree(&nodes, 3), [2, 3, 4, 5, 6]);
        assert_eq!(graph.beyond_degree(&nodes, 5), [3, 4, 5, 6]);
    }

    #[test]
    fn jumps_are_told_from_kinks_and_from_breaks() {
        let (mut graph, nodes) = read(&["heaviside(x - 2*y) + abs(x) + sign(t - 1)"]);
        let mut jumps = Jumps::new(&mut graph, &nodes);
        let unit = Interval::new(0.0, 1.0);
        assert!(!jumps.may_be_in(Interval::new(0.0, 2.0), &[Interval::new(-1.0, -0.5), unit]));
        assert!(jumps.may_be_in(unit, &[unit, unit]));
    }
}
