//! Sources and switches that voltages and currents decide.
//!
//! The value of a source is a variable `z` of its own. That of a controlled source is free and `G = z - f`; with limits it is
//! `f` between these. An ideal amplifier is the limit of `z = a u` for a large gain `a`: `G = -u`, so that `u = 0` where `z` is
//! free and `z` is at a limit where `u` is not zero. The same law with limits alone is a comparator; with hysteresis of half
//! width `h` it follows `u + h w`, where `w` is -1 at the lower limit and 1 at the upper: where it has been in force since
//! the start both `w = -1` and `w = 1` are solutions for `-h < u < h`, and steps go on with the one that they have.
//! At the start there is none yet: there `w` is given.
//!
//! A switch has a variable `s` that is 1 where it is closed, 0 where it is open, and follows a comparator. Its voltage is a
//! free variable with `G = s v + (1 - s) R i`, for any resistance `R`: closed, `v = 0`; open, `i = 0`; and where sliding
//! holds the comparator at zero, a resistance in between.

use expression::{Graph, Node};

/// What decides the value of a variable.
#[derive(Clone, Copy, Debug)]
pub enum DependentLaw {
    /// `z = f`, or what of `f` is between the bounds.
    Follows(Node),
    /// `u = 0`, or `z` at the upper bound where `u > 0`, at the lower where `u < 0`.
    Amplifies(Node),
    /// The same with hysteresis.
    Remembers {
        /// What is compared with zero.
        u: Node,
        /// Half the width of the hysteresis, not negative.
        h: Node,
        /// `w` at the start, -1 or 1.
        begin: f64,
        /// The time of the start.
        start: f64,
        /// The values of `z` at `w = -1` and `w = 1`.
        limits: [Node; 2],
    },
}

/// A law that is not linear in voltages and currents, or that depends on others than those of its element.
#[derive(Clone, Debug)]
pub enum Dependent {
    /// Of a source.
    Source {
        /// The element.
        element: usize,
        /// What its value is.
        law: DependentLaw,
        /// The least and the largest value.
        bounds: [Option<Node>; 2],
    },
    /// Of a switch.
    Switch {
        /// The element.
        element: usize,
        /// Whether it is closed: 1 or 0.
        law: DependentLaw,
        /// A resistance of the size of those in the circuit.
        scale: f64,
    },
}

impl DependentLaw {
    /// `G`, for the variable `z`.
    pub(super) fn inequality(self, graph: &mut Graph, z: Node) -> Node {
        match self {
            Self::Follows(f) => graph.subtract(z, f),
            Self::Amplifies(u) => graph.negate(u),
            Self::Remembers { u, h, begin, start, limits: [low, high] } => {
                // w = (2 z - low - high)/(high - low)
                let (two, sum, span) = (graph.constant(2.0), graph.add(low, high), graph.subtract(high, low));
                let twice = graph.multiply(two, z);
                let above = graph.subtract(twice, sum);
                let w = graph.divide(above, span);
                let (t, start, begin) = (graph.input(0), graph.constant(start), graph.constant(begin));
                let before = graph.subtract(start, t);
                let at_start = graph.heaviside(before);
                let jump = graph.subtract(begin, w);
                let given = graph.multiply(at_start, jump);
                let w = graph.add(w, given);
                let shift = graph.multiply(h, w);
                let sum = graph.add(u, shift);
                graph.negate(sum)
            }
        }
    }
}
