//! Warnings about a problem or its solution that do not stop the solve.

use serde::Serialize;
use utoipa::ToSchema;

/// A warning to the user about a solve that was nevertheless carried out.
#[derive(Clone, Debug, PartialEq, Serialize, ToSchema)]
pub struct Warning {
    /// A machine-readable code of the warning, which does not change between versions.
    pub code: &'static str,
    /// The text of the warning for the user, with the remedy.
    pub message: String,
}
