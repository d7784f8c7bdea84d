//! Circuits that have no equations, or none that determine them.

/// What is wrong with a circuit, by the indices of its elements or nodes.
#[derive(Clone, Debug, PartialEq)]
pub enum Fault {
    /// Nodes that no element connects to ground.
    Floating(Vec<usize>),
    /// Voltage sources that form a loop: their voltages contradict each other, or leave a current undetermined.
    SourceLoop(Vec<usize>),
    /// A switch in a loop of voltage sources, capacitors and switches: closed, it is a short circuit.
    SwitchLoop(Vec<usize>),
    /// Current sources that are all that connects two parts.
    SourceCutSet(Vec<usize>),
    /// The loops, or what depends on what, have more entries than this.
    TooIntertwined(usize),
    /// A source that jumps, in a loop with capacitors alone or in a cut set with inductors alone: the current of the
    /// former, the voltage of the latter is an impulse.
    Impulse {
        /// The source.
        source: usize,
        /// The capacitor or inductor that its derivative reaches.
        element: usize,
    },
    /// A dependent source in a loop with capacitors alone or in a cut set with inductors alone, which answer to its derivative.
    Derivative(usize),
    /// A start that Kirchhoff's laws contradict.
    InconsistentStart {
        /// The capacitor or inductor.
        element: usize,
        /// Its voltage or current at the start, as it is given.
        given: f64,
        /// As it follows from the others.
        implied: f64,
    },
    /// Nothing that stores energy, and no source.
    Dead,
    /// Values too far apart for the equations to be solved.
    Singular,
}
