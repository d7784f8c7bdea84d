//! Signals: functions of time that drive joints and bodies, with their time derivatives. A step is driven by the
//! integrals of its signals between their breakpoints (edges of pulses, knots of tables), so that no pulse is missed,
//! however short it is.

use expression::{Breaks, Graph, Node, Tape};
use hybrid::Breaking;
use numerics::Interval;

/// The nodes and weights of Gauss quadrature of order six on the unit interval, for the integrals of signals over a
/// step: more accurate than the time stepping.
const GAUSS: [(f64, f64); 3] =
    [(0.112_701_665_379_258_3, 5.0 / 18.0), (0.5, 8.0 / 18.0), (0.887_298_334_620_741_7, 5.0 / 18.0)];

/// Rounding error of a signal (function of time), relative to the largest intermediate result of its expression.
const ROUNDING: f64 = 64.0 * f64::EPSILON;

/// Largest number of parts between breakpoints into which a step is divided for the integrals of its signals; the rest
/// of the step is integrated as one part.
const MOST_PARTS: usize = 1000;

/// The signals of a multibody system, compiled to one program.
#[derive(Clone, Debug, Default)]
pub struct Signals {
    /// The compiled expressions of all signals (functions of time), each followed by its time derivative.
    pub program: Tape,
    /// The number of signals (functions of time) of the multibody system.
    pub count: usize,
    /// The event functions of time at whose sign changes a signal has a kink or a jump; `None` if there are none.
    edges: Option<Edges>,
}

/// Event functions of time, searched for breakpoints.
#[derive(Clone, Debug)]
struct Edges(Breaks);

impl Breaking for Edges {
    fn breaks(&mut self, t: f64) -> &[f64] {
        self.0.at(t)
    }

    fn enclose_breaks(&mut self, t: Interval) -> &[Interval] {
        self.0.over(t)
    }
}

/// Values, rates and integrals of the signals (functions of time) over one time step.
#[derive(Clone, Debug, Default)]
pub struct SignalStep {
    /// The values of the signals (functions of time) at the beginning of the step.
    pub start: Vec<f64>,
    /// The mean values of the signals over the step.
    pub means: Vec<f64>,
    /// The values of the signals at the end of the step.
    pub end: Vec<f64>,
    /// The time derivatives of the signals (functions of time) at the end of the step.
    pub rates: Vec<f64>,
    /// The integrals of the signals (functions of time) over the time step.
    pub integrals: Vec<f64>,
    /// The parts of the step between breakpoints of the signals, as pairs of times.
    pub parts: Vec<[f64; 2]>,
    /// The length of the time step over which the signals are integrated.
    pub h: f64,
}

impl Signals {
    /// Compiles signals given as nodes of a graph, each followed by its time derivative.
    pub fn new(graph: &mut Graph, nodes: &[Node]) -> Self {
        let values: Vec<Node> = nodes.iter().copied().step_by(2).collect();
        let mut breaks = Breaks::new(graph, &values);
        let edges = (!breaks.at(0.0).is_empty()).then_some(Edges(breaks));
        Self { program: Tape::compile(graph, nodes), count: values.len(), edges }
    }

    /// Returns the values and the time derivatives of the signals at a time.
    pub fn at(&self, t: f64) -> (Vec<f64>, Vec<f64>) {
        if self.count == 0 {
            return Default::default();
        }
        let mut both = vec![0.0; 2 * self.count];
        self.program.clone().evaluate(t, &[], &mut both);
        both.chunks_exact(2).map(|pair| (pair[0], pair[1])).unzip()
    }

    /// Returns the rounding error of values and derivatives of the signals at a time, estimated from the largest
    /// intermediate result of their expressions (cancellation).
    pub fn rounding(&self, t: f64) -> f64 {
        let mut program = self.program.clone();
        program.evaluate(t, &[], &mut vec![0.0; 2 * self.count]);
        ROUNDING * program.largest()
    }

    /// Evaluates and integrates the signals (functions of time) over a step of length `h` from time `t`.
    pub fn over(&self, t: f64, h: f64) -> SignalStep {
        if self.count == 0 {
            return SignalStep { h, ..SignalStep::default() };
        }
        let (end, rates) = self.at(t + h);
        let start = self.at(t).0;
        let parts = self.parts(t, h);
        let (mut program, mut both) = (self.program.clone(), vec![0.0; 2 * self.count]);
        let mut integrals = vec![0.0; self.count];
        for [from, to] in &parts {
            for (node, weight) in GAUSS {
                program.evaluate(from + node * (to - from), &[], &mut both);
                let values = both.iter().step_by(2);
                integrals.iter_mut().zip(values).for_each(|(sum, value)| *sum += weight * (to - from) * value);
            }
        }
        let means = if h > 0.0 { integrals.iter().map(|integral| integral / h).collect() } else { start.clone() };
        SignalStep { start, means, end, rates, integrals, parts, h }
    }

    /// Returns the parts of a step of length `h` from time `t` between the breakpoints of the signals, as pairs of times.
    fn parts(&self, t: f64, h: f64) -> Vec<[f64; 2]> {
        let end = t + h;
        let mut parts = Vec::new();
        let mut from = t;
        if let Some(mut edges) = self.edges.clone() {
            let mut search = hybrid::Breaks::new(t);
            for _ in 0..MOST_PARTS {
                let before = from + search.up_to_break(&mut edges, from, end - from);
                let Some(after) = search.after().filter(|after| *after < end) else { break };
                if before > from {
                    parts.push([from, before]);
                }
                search.pass(after);
                from = after;
            }
        }
        if from < end {
            parts.push([from, end]);
        }
        parts
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use expression::Scope;

    fn signals(text: &str) -> Signals {
        let mut graph = Graph::new();
        let mut scope = Scope::new();
        scope.bind("t", graph.input(0)).expect("a name");
        let node = graph.parse(text, &scope).expect("an expression");
        let rate = graph.constant(0.0);
        Signals::new(&mut graph, &[node, rate])
    }

    #[test]
    fn pulses_shorter_than_a_step_are_integrated_exactly() {
        for (text, exact) in [
            ("1000*pulse(t, 0.303, 0.001)", 1.0),
            ("1e9*pulse(t, 0.7, 1e-9)", 1.0),
            ("pwm(t + 0.003, 0.01, 0.1)", 0.1),
            ("floor(10*t)", 4.5),
            ("t^2", 1.0 / 3.0),
        ] {
            let found = signals(text).over(0.0, 1.0);
            // The edges of a pulse of 1e-9 at 0.7 are known to 1e-16 of time, 1e-7 of its width.
            assert!((found.integrals[0] - exact).abs() < 1e-6, "{text}: {}", found.integrals[0]);
            assert_eq!(found.means, found.integrals);
        }
        assert_eq!(signals("heaviside(t - 1)").over(1.5, 0.0).means, [1.0]);
    }
}
