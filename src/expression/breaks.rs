//! Breaks: kinks and jumps of expressions at times that do not depend on states. Breaks are sign changes of those
//! [switches](super::switches) that depend on input 0 (time) alone.

use super::enclosure::IntervalWorkspace;
use super::graph::{Graph, Node};
use super::operator::Operator;
use super::tape::Tape;
use numerics::Interval;

/// The compiled event functions of time whose sign changes are the breaks (kinks and jumps in time) of some
/// expressions.
#[derive(Clone, Debug)]
pub struct Breaks {
    tape: Tape,
    values: Vec<f64>,
    /// For each event function of time, a quantity that is continuous where the event function changes sign.
    courses: Tape,
    workspace: IntervalWorkspace,
    ranges: Vec<Interval>,
}

impl Breaks {
    /// Compiles the event functions of `nodes` that depend on input 0 (time) alone.
    pub fn new(graph: &mut Graph, nodes: &[Node]) -> Self {
        let quantities = graph.breaks(nodes);
        let tape = Tape::compile(graph, &quantities);
        let courses: Vec<Node> = quantities.iter().map(|quantity| graph.course_of_break(*quantity)).collect();
        let courses = Tape::compile(graph, &courses);
        let (values, ranges) = (vec![0.0; quantities.len()], vec![Interval::LINE; quantities.len()]);
        Self { values, workspace: IntervalWorkspace::new(&tape), ranges, tape, courses }
    }

    /// Binds new parameter values to the compiled event functions, whose sign changes in time are kinks or jumps.
    pub fn bind(&mut self, parameters: &[f64]) {
        self.tape.bind(parameters);
        self.courses.bind(parameters);
        self.workspace.bind(&self.tape);
    }

    /// Returns the values at the time `t` (input 0) of the event functions, whose sign changes are kinks or jumps.
    pub fn at(&mut self, t: f64) -> &[f64] {
        self.tape.evaluate(t, &[], &mut self.values);
        &self.values
    }

    /// Returns, for each event function, a quantity that is continuous through its sign changes, at input 0 equal to
    /// `t`: the argument of `floor` if the event function jumps there, else the event function itself. Its value at a
    /// sign change is arbitrary; its slopes give the derivative of the time of the sign change by parameters.
    pub fn courses(&mut self, t: f64) -> &[f64] {
        self.courses.evaluate(t, &[], &mut self.values);
        &self.values
    }

    /// Encloses the event functions, whose sign changes are kinks or jumps, over an interval of time (input 0).
    pub fn over(&mut self, t: Interval) -> &[Interval] {
        self.tape.enclose(t, &[], &mut self.workspace, &mut self.ranges);
        &self.ranges
    }
}

impl Graph {
    /// Returns a quantity of an event function that is continuous where the event function changes sign.
    fn course_of_break(&self, quantity: Node) -> Node {
        match self.operation(quantity) {
            Some((Operator::Parity, whole, _)) => match self.operation(whole) {
                Some((Operator::Floor | Operator::Round | Operator::Piece, argument, _)) => argument,
                _ => whole,
            },
            _ => quantity,
        }
    }

    fn breaks(&mut self, nodes: &[Node]) -> Vec<Node> {
        let mut found = Vec::new();
        for node in self.terms_below(nodes) {
            if let Some((_, quantity)) = self.switch(node)
                && self.inputs(quantity) == [0]
            {
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
        // Breaks at t - 2, 2 t - 5, and t - 3 from the inner min(t, 3); the other switch of `min` depends on x.
        let mut values: Vec<f64> = breaks.at(2.25).iter().map(|value| value.abs()).collect();
        values.sort_by(f64::total_cmp);
        assert_eq!(values, [0.25, 0.5, 0.75]);
        let signs: Vec<bool> = breaks.over(Interval::new(2.125, 2.25)).iter().map(|range| range.lo > 0.0).collect();
        assert_eq!(signs.iter().filter(|sign| **sign).count(), 1, "of t - 2 alone");
        assert!(breaks.over(Interval::new(1.0, 4.0)).iter().all(|range| range.contains(0.0)));
    }

    /// Returns the times in `[0, 10]` at which an event function of the expression `text` changes sign, located by
    /// bisection of the enclosures of the event functions.
    fn changes(text: &str) -> Vec<f64> {
        let (mut graph, mut scope) = (Graph::new(), Scope::new());
        scope.bind("t", graph.input(0)).unwrap();
        let node = graph.parse(text, &scope).unwrap();
        let mut breaks = Breaks::new(&mut graph, &[node]);
        let (mut found, mut open) = (Vec::new(), vec![(0.0, 10.0)]);
        while let Some((a, b)) = open.pop() {
            let signs = |values: &[f64]| values.iter().map(|value| *value >= 0.0).collect::<Vec<_>>();
            let middle = a + 0.5 * (b - a);
            if breaks.over(Interval::new(a, b)).iter().all(|range| range.lo >= 0.0 || range.hi < 0.0) {
                continue;
            } else if middle > a && middle < b {
                open.extend([(middle, b), (a, middle)]);
            } else if signs(breaks.at(a)) != signs(breaks.at(b)) {
                found.push(b);
            }
        }
        found.dedup_by(|b, a| *b - *a < 1e-14);
        found
    }

    #[test]
    fn every_edge_is_a_break_and_none_is_two() {
        let to_ten = |from: i32| (from..=10).map(f64::from).collect::<Vec<_>>();
        assert_eq!(changes("floor(t)"), to_ten(1));
        // The pieces of `ceil` include their upper ends.
        assert_eq!(changes("ceil(t)").iter().map(|t| t.floor()).collect::<Vec<_>>(), to_ten(0)[..10]);
        assert_eq!(changes("round(t)"), to_ten(0)[..10].iter().map(|t| t + 0.5).collect::<Vec<_>>());
        assert_eq!(changes("mod(t, 2.5)"), [2.5, 5.0, 7.5, 10.0]);
        assert_eq!(changes("sawtooth(t, 2.5)"), [2.5, 5.0, 7.5, 10.0]);
        assert_eq!(changes("pwm(t, 4, 0.25)"), [1.0, 4.0, 5.0, 8.0, 9.0]);
        assert_eq!(changes("pwm(t, 4, 0)"), [4.0, 8.0], "at which nothing happens");
        assert_eq!(changes("triangle(t, 5)"), [2.5, 5.0, 7.5, 10.0]);
        assert_eq!(changes("pulse(t, 1, 0.5) + if(t >= 1.5 and t < 7, t, 0)"), [1.0, 1.5, 7.0]);
        assert_eq!(changes("if(mod(floor(t), 2) == 0, 1, -1)"), to_ten(1));
        assert_eq!(changes("floor(1000*t)").len(), 10_000);
        // A duty cycle that depends on time: t/4 - k < 0.5 + t/40 until t = 40 (k + 0.5)/9.
        let ends = [0.5, 1.5].map(|k: f64| 40.0 * k / 9.0);
        assert!(
            changes("pwm(t, 4, 0.5 + t/40)")
                .iter()
                .zip([ends[0], 4.0, ends[1], 8.0])
                .all(|(a, b)| (a - b).abs() < 1e-14)
        );
    }
}
