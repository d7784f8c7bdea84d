//! Sources and switches controlled by voltages and currents.
//!
//! The value of a dependent source is a variable `z`. For a controlled source with `z = f`, `z` is free and `G = z -
//! f`; with limits, `z` is the projection of `f` onto the limits. An ideal amplifier is the limit of `z = a u` for
//! large gain `a` and input `u`: `G = -u`, so that `u = 0` while `z` is between its limits, and `z` is at a limit if
//! `u` is not zero. An amplifier with limits is a comparator. A comparator with hysteresis of half width `h` uses `G
//! = -(u + h w)`, where `w` is -1 at the lower limit and 1 at the upper. For `-h < u < h` both `w = -1` and `w = 1`
//! are solutions, and a step continues with the solution of the previous step. At the initial time there is no
//! previous solution: `w` is prescribed.
//!
//! A dependent switch has a variable `s` that is 1 if the switch is closed and 0 if it is open, given by a
//! comparator. The voltage `v` of the switch is a free variable with `G = s v - (1 - s) R i`, where `i` is its
//! current, for any resistance `R`: `v = 0` if closed, `i = 0` if open. In a sliding mode, where the input of the
//! comparator stays at zero, the switch is the resistance `R (1 - s)/s`. With the opposite sign of `R` it would be a
//! negative resistance, which supplies energy, and would admit a sliding mode where the input of the comparator
//! crosses zero.

use expression::{Graph, Node};

/// The law that determines the variable `z` of a dependent source or switch.
#[derive(Clone, Copy, Debug)]
pub enum DependentLaw {
    /// A controlled source: `z = f` with an expression `f` in voltages and currents, or the projection of `f` onto the
    /// bounds of `z`.
    Follows(Node),
    /// An amplifier or comparator with input `u`: `u = 0`, or `z` at its upper bound if `u > 0`, at its lower bound if
    /// `u < 0`.
    Amplifies(Node),
    /// A comparator with hysteresis, with input `u` and output state `w` in `[-1, 1]`.
    Remembers {
        /// The input `u` of the comparator with hysteresis, which compares it with zero.
        u: Node,
        /// Half the width `h` of the comparator's hysteresis, nonnegative.
        h: Node,
        /// The output `w` of the comparator at the initial time: -1 (lower limit) or 1 (upper limit).
        begin: f64,
        /// The initial time of the simulation, at which the output `w` of the comparator is prescribed.
        start: f64,
        /// The lower and the upper limit of the comparator: the values of `z` at `w = -1` and `w = 1`.
        limits: [Node; 2],
    },
}

/// A circuit element whose law is nonlinear in voltages and currents, or depends on voltages and currents of other
/// elements.
#[derive(Clone, Debug)]
pub enum Dependent {
    /// A voltage or current source that depends on voltages and currents.
    Source {
        /// The index of the source among the circuit elements.
        element: usize,
        /// The law of the voltage or current of the source.
        law: DependentLaw,
        /// The lower and the upper limit of the voltage or current of the source.
        bounds: [Option<Node>; 2],
    },
    /// A switch that is controlled by voltages and currents of the circuit.
    Switch {
        /// The index of the switch among the circuit elements.
        element: usize,
        /// The law of the switch variable `s`, which is 1 if the switch is closed and 0 if it is open.
        law: DependentLaw,
        /// The resistance `R` in the equation `G = s v - (1 - s) R i` of the switch, of the order of magnitude of the
        /// resistances in the circuit.
        scale: f64,
    },
}

impl DependentLaw {
    /// Returns the inequality function `G` that the law of a dependent source or switch gives for its variable `z`.
    pub(super) fn inequality(self, graph: &mut Graph, z: Node) -> Node {
        match self {
            Self::Follows(f) => graph.subtract(z, f),
            Self::Amplifies(u) => graph.negate(u),
            Self::Remembers { u, h, begin, start, limits: [low, high] } => {
                // The output of the comparator, `w = (2 z - low - high)/(high - low)`, in `[-1, 1]`.
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
