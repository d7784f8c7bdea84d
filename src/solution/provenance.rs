//! The provenance of an answer, by which it can be traced to its specification and program.

use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;
use utoipa::ToSchema;

/// The specification and the program that produced an answer.
#[derive(Clone, Debug, Default, PartialEq, Deserialize, Serialize, ToSchema)]
pub struct Provenance {
    /// The program and its version, as `dvi 0.1.0`.
    pub program: String,
    /// The user's label of the specification.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub label: Option<String>,
    /// The key of the problem type in the specification.
    pub problem: String,
    /// The SHA-256 of the text of the specification, in hexadecimal; for a SPICE deck, of the document that it is
    /// converted to.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub digest: Option<String>,
    /// The relative tolerance of the run.
    pub rtol: f64,
    /// The absolute tolerance of the run, if it is equal for all states.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub atol: Option<f64>,
    /// The fixed step size, if one was given.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub step: Option<f64>,
    /// The units of time, as `t`, and of fields by name, for types of problems in SI units: circuits and rigid
    /// bodies. For other types the units are the user's.
    #[serde(default, skip_serializing_if = "BTreeMap::is_empty")]
    pub units: BTreeMap<String, String>,
}
