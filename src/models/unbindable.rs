//! Errors of binding new parameter values to a compiled problem.

/// Why new parameter values cannot be bound to a compiled problem.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum Unbindable {
    /// The parameters of the problem were folded into constants when it was compiled.
    #[error("the values of parameters are constants in this problem type")]
    Folded,
    /// The number of given values differs from the number of parameters of the problem.
    #[error("{found} values for {expected} parameters")]
    Count {
        /// The number of parameters of the problem.
        expected: usize,
        /// The number of parameter values that were given.
        found: usize,
    },
    /// A parameter, or a constant of the problem that depends on parameters, is not finite.
    #[error("with {parameters} {what} is {value}, which is not finite")]
    NotFinite {
        /// The parameters on which the quantity that is not finite depends, with their values.
        parameters: String,
        /// The name of the parameter or constant that is not finite.
        what: String,
        /// The value of the parameter or constant that is not finite.
        value: f64,
    },
    /// A quantity of the problem that depends on parameters is out of its admissible range.
    #[error("with {parameters} {what}")]
    OutOfRange {
        /// The parameters on which the quantity that is out of range depends, with their values.
        parameters: String,
        /// The quantity that is out of range and its value, as a clause for messages.
        what: String,
    },
    /// The convex set `K` is empty for the new parameter values.
    #[error("with {parameters} the set is empty: {what}")]
    EmptySet {
        /// The parameters on which the contradictory bounds depend, with their values.
        parameters: String,
        /// The bounds of `K` that contradict each other, as a clause for messages.
        what: String,
    },
    /// The new parameter values would change the structure of the problem, such as its sparsity.
    #[error("{parameters} changes the structure: {what}")]
    Structure {
        /// The parameters that determine the structure of the problem, with their values.
        parameters: String,
        /// The property of the problem's structure, such as its sparsity, that new parameter values would change, as
        /// text for messages.
        what: String,
    },
}
