//! Errors of circuits whose equations are contradictory, underdetermined or too large.

/// An error in the equations of a circuit, with the indices of the circuit elements or nodes concerned.
#[derive(Clone, Debug, PartialEq)]
pub enum Fault {
    /// The circuit has these nodes without a path to ground.
    Floating(Vec<usize>),
    /// Voltage sources that form a loop: their voltages contradict each other, or leave a current undetermined.
    SourceLoop(Vec<usize>),
    /// A switch in a loop of voltage sources, capacitors and switches, which is a short circuit if the switch is
    /// closed.
    SwitchLoop(Vec<usize>),
    /// Current sources alone form a cut set: their currents contradict each other, or leave a voltage undetermined.
    SourceCutSet(Vec<usize>),
    /// The circuit is coupled too densely: the number of entries of its loops or coupling matrices exceeds the given
    /// limit.
    TooIntertwined(usize),
    /// A discontinuous source in a loop with capacitors alone or in a cut set with inductors alone: the capacitor
    /// current or the inductor voltage is an impulse.
    Impulse {
        /// The index of the discontinuous source.
        source: usize,
        /// The index of the capacitor or inductor whose current or voltage contains the derivative of the source.
        element: usize,
    },
    /// A dependent source in a loop with capacitors alone or in a cut set with inductors alone, so that the equations
    /// contain the time derivative of the source.
    Derivative(usize),
    /// An initial voltage or current given by the user violates Kirchhoff's laws.
    InconsistentStart {
        /// The index of the capacitor or inductor to which the initial value was given.
        element: usize,
        /// The initial voltage or current given by the user.
        given: f64,
        /// The initial voltage or current implied by the other initial values.
        implied: f64,
    },
    /// The circuit has no state: it has neither energy storage nor sources.
    Dead,
    /// The element values differ so much in magnitude that a matrix of the circuit is singular up to rounding.
    Singular,
}
