//! Functions of time and position, given as expressions.

use expression::{Graph, IntervalWorkspace, Node, Tape};
use numerics::Interval;

/// A function of `t`, `x`, `y`, `z`, which are inputs 0 to 3 of its expression.
#[derive(Clone, Debug)]
pub struct Field {
    tape: Tape,
    enclosures: IntervalWorkspace,
    constant: Option<f64>,
    varies_in_time: bool,
}

impl Field {
    /// Compiles a node of the graph.
    pub fn new(graph: &Graph, node: Node) -> Self {
        let inputs = graph.inputs(node);
        let tape = Tape::compile(graph, &[node]);
        Self {
            enclosures: IntervalWorkspace::new(&tape),
            tape,
            constant: graph.value(node),
            varies_in_time: inputs.contains(&0),
        }
    }

    /// The value, if the function is constant in time and space.
    pub fn constant(&self) -> Option<f64> {
        self.constant
    }

    /// Whether the function depends on time.
    pub fn varies_in_time(&self) -> bool {
        self.varies_in_time
    }

    /// Encloses the values over a time interval and a box.
    pub fn over(&mut self, t: Interval, at: &[Interval; 3]) -> Interval {
        let mut value = [Interval::EMPTY];
        self.tape.enclose(t, at, &mut self.enclosures, &mut value);
        value[0]
    }

    /// The value at a time and a position; NaN or infinite outside the domain of the expression.
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
