//! Warnings about a problem or its solution that do not stop the solve.

use serde::Serialize;
use utoipa::ToSchema;

/// Something the user should know though the solve went on.
#[derive(Clone, Debug, PartialEq, Serialize, ToSchema)]
pub struct Warning {
    /// A stable code for programs.
    pub code: &'static str,
    /// For people, with the remedy.
    pub message: String,
}
