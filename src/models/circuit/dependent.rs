//! Sources and switches controlled by voltages and currents.
//!
//! The value of a dependent source is a variable `z`. For a controlled source, `z` is free and `G = z - f`; with
//! limits, `z` is the projection of `f` onto the limits. An ideal amplifier is the limit of `z = a u` for large gain
//! `a`: `G = -u`, so that `u = 0` while `z` is between its limits, and `z` is at a limit if `u` is not zero. With
//! limits this law is a comparator. A comparator with hysteresis of half width `h` uses `G = -(u + h w)`, where `w` is
//! -1 at the lower limit and 1 at the upper. For `-h < u < h` both `w = -1` and `w = 1` are solutions, and a step
//! continues with the solution of the previous step. At the initial time there is no previous solution: `w` is
//! prescribed.
//!
//! A switch has a variable `s` that is 1 if it is closed and 0 if it is open, given by a comparator. Its voltage is a
//! free variable with `G = s v - (1 - s) R i`, for any resistance `R`: `v = 0` if closed, `i = 0` if open. In a sliding
//! mode, where the comparator stays at zero, the switch is the resistance `R (1 - s)/s`. With the opposite sign it would be
//! a negative resistance, which supplies energy, and admits a sliding mode where the comparator crosses zero.

use expression::{Graph, Node};

/// The law that determines the variable of a dependent element.
#[derive(Clone, Copy, Debug)]
pub enum DependentLaw {
    /// `z = f`, or the projection of `f` onto the bounds.
    Follows(Node),
    /// Amplifier or comparator: `u = 0`, or `z` at the upper bound if `u > 0`, at the lower bound if `u < 0`.
    Amplifies(Node),
    /// Comparator with hysteresis.
    Remembers {
        /// The input, compared with zero.
        u: Node,
        /// Half the width of the hysteresis, not negative.
        h: Node,
        /// `w` at the initial time, -1 or 1.
        begin: f64,
        /// The initial time.
        start: f64,
        /// The values of `z` at `w = -1` and `w = 1`.
        limits: [Node; 2],
    },
}

/// A law that is nonlinear in voltages and currents, or that depends on voltages and currents of other elements.
#[derive(Clone, Debug)]
pub enum Dependent {
    /// The law of a dependent source.
    Source {
        /// The index of the element.
        element: usize,
        /// The law of the voltage or current.
        law: DependentLaw,
        /// The lower and the upper limit.
        bounds: [Option<Node>; 2],
    },
    /// The law of a dependent switch.
    Switch {
        /// The index of the element.
        element: usize,
        /// The law of `s`: 1 if closed, 0 if open.
        law: DependentLaw,
        /// The resistance `R`, of the order of magnitude of the resistances in the circuit.
        scale: f64,
    },
}

impl DependentLaw {
    /// The inequality function `G` for the variable `z`.
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
