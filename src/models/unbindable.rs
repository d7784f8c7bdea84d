//! Errors of binding new parameter values to a compiled problem.

/// Why new parameter values cannot be bound to a compiled problem.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum Unbindable {
    /// The parameters of the problem were folded into constants.
    #[error("the values of parameters are constants in this problem type")]
    Folded,
    /// The number of values differs from the number of parameters.
    #[error("{found} values for {expected} parameters")]
    Count {
        /// The number of parameters of the problem.
        expected: usize,
        /// The number of parameter values that were given.
        found: usize,
    },
    /// A parameter, or a constant that depends on parameters, is not finite.
    #[error("with {parameters} {what} is {value}, which is not finite")]
    NotFinite {
        /// The parameters on which the quantity depends, with their values.
        parameters: String,
        /// The name of the quantity that is not finite.
        what: String,
        /// The value of the quantity that is not finite.
        value: f64,
    },
    /// A quantity that depends on parameters is out of its admissible range.
    #[error("with {parameters} {what}")]
    OutOfRange {
        /// The parameters on which the quantity depends, with their values.
        parameters: String,
        /// The quantity that is out of range and its value, as a clause.
        what: String,
    },
    /// The convex set `K` is empty with the new values.
    #[error("with {parameters} the set is empty: {what}")]
    EmptySet {
        /// The parameters on which the bounds depend, with their values.
        parameters: String,
        /// The bounds that contradict each other, as a clause for messages.
        what: String,
    },
    /// The new values would change the structure of the problem, such as its sparsity.
    #[error("{parameters} changes the structure: {what}")]
    Structure {
        /// The parameters that determine the structure, with their values.
        parameters: String,
        /// The property of the structure, such as its sparsity, that would change.
        what: String,
    },
}
