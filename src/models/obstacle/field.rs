//! A function of time and place, from an expression.

use expression::{Graph, IntervalWorkspace, Node, Tape};
use numerics::Interval;

/// A function of `t` and `x`, `y`, `z`, which are the inputs 0 to 3 of its expression.
#[derive(Clone, Debug)]
pub struct Field {
    tape: Tape,
    enclosures: IntervalWorkspace,
    constant: Option<f64>,
    varies_in_time: bool,
}

impl Field {
    /// The function that a node of the graph is.
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

    /// Its value, if it is the same at all times and places.
    pub fn constant(&self) -> Option<f64> {
        self.constant
    }

    /// Whether it depends on time.
    pub fn varies_in_time(&self) -> bool {
        self.varies_in_time
    }

    /// An interval that holds its values at these times, all over a box.
    pub fn over(&mut self, t: Interval, at: &[Interval; 3]) -> Interval {
        let mut value = [Interval::EMPTY];
        self.tape.enclose(t, at, &mut self.enclosures, &mut value);
        value[0]
    }

    /// Its value at a time and a place; what is not defined comes out as NaN or an infinity.
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
