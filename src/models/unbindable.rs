//! Why other values of parameters cannot be bound to a problem.

/// Why values cannot be bound.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum Unbindable {
    /// The problem has no parameters that stay inputs.
    #[error("this type of problem keeps its parameters as constants: it is to be compiled anew for others")]
    Folded,
    /// Not as many values as parameters.
    #[error("{found} values for {expected} parameters")]
    Count {
        /// The number of parameters.
        expected: usize,
        /// The number of values.
        found: usize,
    },
    /// Something that has to be finite is not.
    #[error("with {parameters} {what} is {value}, which is not finite")]
    NotFinite {
        /// The parameters that it depends on, with their values.
        parameters: String,
        /// What it is.
        what: String,
        /// Its value.
        value: f64,
    },
    /// A value is not in its range.
    #[error("with {parameters} {what}")]
    OutOfRange {
        /// The parameters that it depends on, with their values.
        parameters: String,
        /// What it is.
        what: String,
    },
    /// The set is empty.
    #[error("with {parameters} the set is empty: {what}")]
    EmptySet {
        /// The parameters that it depends on, with their values.
        parameters: String,
        /// Where.
        what: String,
    },
    /// The structure would change.
    #[error("{parameters} changes the structure: {what}; the problem is to be compiled anew with this value")]
    Structure {
        /// The parameters that decide it, with their values.
        parameters: String,
        /// What would change.
        what: String,
    },
}
