//! Errors of expressions, with their position in the text.

/// The reason why a text is not a valid expression, or why an expression exceeds a limit.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[error("{message}")]
pub struct ExpressionError {
    /// A stable error code for programs: `syntax`, `unknown_name`, `unknown_function`, `wrong_arity`,
    /// `number_out_of_range`, `out_of_range`, `misplaced_condition`, `jump_of_unknown`, `not_ascii`, `too_long`,
    /// `too_deep` or `too_many_nodes`.
    pub code: &'static str,
    /// The byte offset of the error in the text; the length of the text if it ends too early.
    pub offset: usize,
    /// The message for users: what was expected and what was found.
    pub message: String,
    /// A valid alternative to the erroneous text, if known.
    pub expected: Option<String>,
    /// The nearest valid spelling of an unknown name, if any.
    pub did_you_mean: Option<String>,
}

impl ExpressionError {
    pub(super) fn new(code: &'static str, offset: usize, message: String) -> Self {
        Self { code, offset, message, expected: None, did_you_mean: None }
    }

    pub(super) fn expected(self, expected: &str) -> Self {
        Self { expected: Some(expected.to_owned()), ..self }
    }

    pub(super) fn too_many_nodes(offset: usize) -> Self {
        let message = "all expressions and their derivatives together have more than two million terms";
        Self::new("too_many_nodes", offset, message.to_owned())
    }
}
