//! Where expressions have a kink or a jump at a time that no state decides: at the changes of sign of the arguments of
//! `abs`, `sign` and `heaviside`, and of the differences of those of `min` and `max`, that depend on one input alone.

use super::enclosure::IntervalWorkspace;
use super::graph::{Graph, Node};
use super::operator::Operator;
use super::tape::Tape;
use numerics::Interval;

/// The quantities whose changes of sign are the breaks of some expressions, compiled.
#[derive(Clone, Debug)]
pub struct Breaks {
    tape: Tape,
    values: Vec<f64>,
    workspace: IntervalWorkspace,
    ranges: Vec<Interval>,
}

impl Breaks {
    /// Those of `nodes` that depend on input 0 alone.
    pub fn new(graph: &mut Graph, nodes: &[Node]) -> Self {
        let quantities = graph.breaks(nodes);
        let tape = Tape::compile(graph, &quantities);
        let (values, ranges) = (vec![0.0; quantities.len()], vec![Interval::LINE; quantities.len()]);
        Self { values, workspace: IntervalWorkspace::new(&tape), ranges, tape }
    }

    /// Takes over other parameters.
    pub fn bind(&mut self, parameters: &[f64]) {
        self.tape.bind(parameters);
        self.workspace.bind(&self.tape);
    }

    /// Their values where input 0 is `t`.
    pub fn at(&mut self, t: f64) -> &[f64] {
        self.tape.evaluate(t, &[], &mut self.values);
        &self.values
    }

    /// Intervals that hold them wherever input 0 is in an interval.
    pub fn over(&mut self, t: Interval) -> &[Interval] {
        self.tape.enclose(t, &[], &mut self.workspace, &mut self.ranges);
        &self.ranges
    }
}

impl Graph {
    fn breaks(&mut self, nodes: &[Node]) -> Vec<Node> {
        let mut found = Vec::new();
        for node in self.terms_below(nodes) {
            let Some((operator, a, b)) = self.operation(node) else { continue };
            let quantity = match operator {
                Operator::Abs | Operator::Sign | Operator::Heaviside => a,
                Operator::Min | Operator::Max => self.subtract(a, b),
                _ => continue,
            };
            if self.inputs(quantity) == [0] {
                found.push(quantity);
            }
        }
        found.sort_unstable();
        found.dedup();
        found
    }
}

#[cfg(test)]
mod tests {
    use super::super::Scope;
    use super::*;

    #[test]
    fn what_depends_on_time_alone_breaks() {
        let (mut graph, mut scope) = (Graph::new(), Scope::new());
        for (index, name) in ["t", "x"].into_iter().enumerate() {
            scope.bind(name, graph.input(index)).unwrap();
        }
        let text = "x*heaviside(t - 2) + abs(x - t) + min(t, 3, x) + max(2*t, 5) + abs(-4) + sign(x)";
        let node = graph.parse(text, &scope).unwrap();
        let mut breaks = Breaks::new(&mut graph, &[node]);
        // t - 2 and 2 t - 5; of the min only that of t and 3 is known without x.
        let mut values: Vec<f64> = breaks.at(2.25).iter().map(|value| value.abs()).collect();
        values.sort_by(f64::total_cmp);
        assert_eq!(values, [0.25, 0.5, 0.75]);
        let signs: Vec<bool> = breaks.over(Interval::new(2.125, 2.25)).iter().map(|range| range.lo > 0.0).collect();
        assert_eq!(signs.iter().filter(|sign| **sign).count(), 1, "of t - 2 alone");
        assert!(breaks.over(Interval::new(1.0, 4.0)).iter().all(|range| range.contains(0.0)));
    }
}
