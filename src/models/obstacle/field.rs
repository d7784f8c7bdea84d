//! Functions of time and position, given as symbolic expressions: the coefficients, source, obstacles, initial and
//! boundary values of an obstacle problem.

use expression::{Graph, IntervalWorkspace, Node, Tape};
use numerics::Interval;

/// A function of time `t` and position `x`, `y`, `z`, which are inputs 0 to 3 of its expression.
#[derive(Clone, Debug)]
pub struct Field {
    tape: Tape,
    enclosures: IntervalWorkspace,
    constant: Option<f64>,
    inputs: Vec<usize>,
    node: Node,
    /// The compiled time derivative of the function with its workspace; `None` if the function does not depend on time
    /// or is not smooth.
    rate: Option<(Tape, IntervalWorkspace)>,
}

impl Field {
    /// Compiles a node of the expression graph to a function of time and position.
    pub fn new(graph: &mut Graph, node: Node) -> Self {
        let inputs = graph.inputs(node);
        let tape = Tape::compile(graph, &[node]);
        let is_smooth = inputs.contains(&0) && graph.is_smooth(node);
        let gradient = is_smooth.then(|| graph.gradient(node).ok()).flatten();
        let rate =
            gradient.and_then(|gradient| gradient.into_iter().find(|(input, _)| *input == 0)).map(|(_, rate)| {
                let tape = Tape::compile(graph, &[rate]);
                (tape.clone(), IntervalWorkspace::new(&tape))
            });
        Self { enclosures: IntervalWorkspace::new(&tape), tape, constant: graph.value(node), rate, inputs, node }
    }

    /// Returns the value of the function if it is constant in time and space; otherwise `None`.
    pub fn constant(&self) -> Option<f64> {
        self.constant
    }

    /// Returns whether the function depends on time.
    pub fn varies_in_time(&self) -> bool {
        self.inputs.contains(&0)
    }

    /// Returns whether the function depends on position.
    pub fn varies_in_space(&self) -> bool {
        self.inputs.iter().any(|&input| input > 0)
    }

    /// Returns the node of the expression graph from which the function was compiled.
    pub fn node(&self) -> Node {
        self.node
    }

    /// Encloses the values of the function over a time interval at a point; narrower than [`over`](Self::over) if the
    /// time derivative can be enclosed.
    pub fn over_time(&mut self, t: Interval, at: [f64; 3]) -> Interval {
        let at = at.map(Interval::point);
        let direct = self.over(t, &at);
        let Some((tape, workspace)) = &mut self.rate else { return direct };
        let mut rate = [Interval::EMPTY];
        tape.enclose(t, &at, workspace, &mut rate);
        let [rate] = rate;
        if !(direct.defined && rate.defined && rate.size().is_finite()) {
            return direct;
        }
        let middle = Interval::point(0.5 * (t.lo + t.hi));
        let by_rate = self.over(middle, &at) + rate * (t - middle);
        Interval { lo: direct.lo.max(by_rate.lo), hi: direct.hi.min(by_rate.hi), defined: true }
    }

    /// Encloses the values of the function over a time interval and a box of positions.
    pub fn over(&mut self, t: Interval, at: &[Interval; 3]) -> Interval {
        let mut value = [Interval::EMPTY];
        self.tape.enclose(t, at, &mut self.enclosures, &mut value);
        value[0]
    }

    /// Returns the value of the function at a time and a position; NaN or infinite outside the domain of the function's
    /// expression.
    pub fn at(&mut self, t: f64, [x, y, z]: [f64; 3]) -> f64 {
        match self.constant {
            Some(value) => value,
            None => {
                let mut value = [0.0];
                self.tape.evaluate(t, &[x, y, z], &mut value);
                value[0]
            }
        }
    }
}
