//! What a checked specification comes to, told without a solve.

use super::checked::Specification;
use super::model::Sizes;
use analysis::Analysis;
use serde::Serialize;
use solution::{Warning, uniqueness_caveat};

/// Sizes, what the theory says, and what a solve would build.
#[derive(Clone, Debug, Serialize)]
pub struct Summary {
    /// The user's own words for it.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub label: Option<String>,
    /// The number of states.
    pub states: usize,
    /// The number of variables of the variational inequality.
    pub variables: usize,
    /// The bounds that vary with time or states.
    pub moving_bounds: usize,
    /// The places of the Jacobian that may be nonzero.
    pub jacobian_nonzeros: usize,
    /// Whether the Jacobian is the same everywhere.
    pub constant_jacobian: bool,
    /// Memory that a solve is known to take before it runs, in bytes.
    pub memory_bytes: usize,
    /// Index and uniqueness at the start, and why.
    #[serde(flatten)]
    pub analysis: Analysis,
    /// The method that a solve would take.
    pub method: &'static str,
    /// The parts that it would build.
    pub built: Vec<&'static str>,
    /// The parts that the problem does not need, each with the reason.
    pub left_out: Vec<String>,
    /// What the user should know.
    pub warnings: Vec<Warning>,
}

impl Specification {
    /// What this specification comes to.
    pub fn summary(&self) -> Summary {
        let model = self.model();
        let Sizes { states, variables, moving_bounds, jacobian_nonzeros, constant_jacobian } = model.sizes();
        let described = model.describe(self);
        let mut warnings = described.warnings;
        if model.has_theory_of_uniqueness() {
            warnings.extend(uniqueness_caveat(self.analysis()));
        }
        warnings.extend(self.warnings().cloned());
        Summary {
            label: self.label().map(str::to_owned),
            states,
            variables,
            moving_bounds,
            jacobian_nonzeros,
            constant_jacobian,
            memory_bytes: self.memory_bytes(),
            analysis: self.analysis().clone(),
            method: described.method,
            built: described.built,
            left_out: described.left_out,
            warnings,
        }
    }
}
