//! The summary of a checked specification, without a solve.

use super::checked::Specification;
use super::model::Sizes;
use analysis::Analysis;
use serde::Serialize;
use solution::{Warning, uniqueness_caveat};

/// The summary of a specification: sizes, structural analysis, and the parts of the solver that a solve would build.
#[derive(Clone, Debug, Serialize)]
pub struct Summary {
    /// The user's label of the specification.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub label: Option<String>,
    /// The number of states of the problem.
    pub states: usize,
    /// The number of variables of the variational inequality.
    pub variables: usize,
    /// The number of bounds of variables that vary with time or states.
    pub moving_bounds: usize,
    /// The number of structural nonzeros of the Jacobian of the equations.
    pub jacobian_nonzeros: usize,
    /// Whether the Jacobian of the equations is constant.
    pub constant_jacobian: bool,
    /// Estimated memory of a solve in bytes, as far as it is known in advance.
    pub memory_bytes: usize,
    /// Index of the problem and uniqueness of its solution at the start, with the reasons.
    #[serde(flatten)]
    pub analysis: Analysis,
    /// The numerical method that a solve would use.
    pub method: &'static str,
    /// The parts of the solver that a solve would build.
    pub built: Vec<&'static str>,
    /// The parts of the solver that are not built because the problem does not need them, each with the reason.
    pub left_out: Vec<String>,
    /// Warnings about the specification for the user.
    pub warnings: Vec<Warning>,
}

impl Specification {
    /// Summarises the specification without a solve.
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
