//! Errors of circuits whose equations are contradictory, underdetermined or too large.

/// An error of a circuit, with the indices of its elements or nodes.
#[derive(Clone, Debug, PartialEq)]
pub enum Fault {
    /// Nodes without a path to ground.
    Floating(Vec<usize>),
    /// Voltage sources that form a loop: their voltages contradict each other, or leave a current undetermined.
    SourceLoop(Vec<usize>),
    /// A switch in a loop of voltage sources, capacitors and switches: a short circuit if the switch is closed.
    SwitchLoop(Vec<usize>),
    /// A cut set of current sources alone.
    SourceCutSet(Vec<usize>),
    /// The loops or the coupling matrices exceed this number of entries.
    TooIntertwined(usize),
    /// A discontinuous source in a loop with capacitors alone or in a cut set with inductors alone: the capacitor
    /// current or the inductor voltage is an impulse.
    Impulse {
        /// The source.
        source: usize,
        /// The capacitor or inductor whose current or voltage contains the derivative of the source.
        element: usize,
    },
    /// A dependent source in a loop with capacitors alone or in a cut set with inductors alone: the equations contain
    /// its time derivative.
    Derivative(usize),
    /// An initial value that violates Kirchhoff's laws.
    InconsistentStart {
        /// The capacitor or inductor.
        element: usize,
        /// The initial voltage or current given by the user.
        given: f64,
        /// The initial voltage or current implied by the other initial values.
        implied: f64,
    },
    /// A circuit without energy storage and without sources.
    Dead,
    /// Element values of such different magnitudes that a matrix is singular to rounding.
    Singular,
}
