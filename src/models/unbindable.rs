//! Errors of binding new parameter values to a compiled problem.

/// Why parameter values cannot be bound.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum Unbindable {
    /// The parameters of the problem were folded into constants.
    #[error("the values of parameters are constants in this problem type")]
    Folded,
    /// The number of values differs from the number of parameters.
    #[error("{found} values for {expected} parameters")]
    Count {
        /// The number of parameters.
        expected: usize,
        /// The number of values.
        found: usize,
    },
    /// A parameter, or a constant that depends on parameters, is not finite.
    #[error("with {parameters} {what} is {value}, which is not finite")]
    NotFinite {
        /// The parameters that the quantity depends on, with their values.
        parameters: String,
        /// The name of the quantity.
        what: String,
        /// The value of the quantity.
        value: f64,
    },
    /// A quantity is out of range.
    #[error("with {parameters} {what}")]
    OutOfRange {
        /// The parameters that the quantity depends on, with their values.
        parameters: String,
        /// The quantity and its value, as a clause.
        what: String,
    },
    /// The convex set is empty.
    #[error("with {parameters} the set is empty: {what}")]
    EmptySet {
        /// The parameters that the bounds depend on, with their values.
        parameters: String,
        /// The contradictory bounds.
        what: String,
    },
    /// The structure would change.
    #[error("{parameters} changes the structure: {what}")]
    Structure {
        /// The parameters that decide the structure, with their values.
        parameters: String,
        /// The structural property that would change.
        what: String,
    },
}
