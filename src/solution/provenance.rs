//! What an answer is the answer to: a file of it alone can be traced to the specification and the program that it came of.

use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

/// The specification and the program that an answer came of.
#[derive(Clone, Debug, Default, PartialEq, Deserialize, Serialize, ToSchema)]
pub struct Provenance {
    /// The program and its version, as `dvi 0.1.0`.
    pub program: String,
    /// The user's own words for the specification.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub label: Option<String>,
    /// The type of the problem, by its key.
    pub problem: String,
    /// The SHA-256 of the text of the specification, in hexadecimal digits; of a deck, of the document that it becomes.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub digest: Option<String>,
    /// The relative tolerance.
    pub rtol: f64,
    /// The absolute tolerance, where that of all states is the same.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub atol: Option<f64>,
    /// The fixed step, where one is asked for.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub step: Option<f64>,
}
