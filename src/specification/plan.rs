//! From a checked specification to what the integration is told.

use super::checked::Specification;
use super::method::{Method, Switches, ViSolverName};
use super::stages::Stages;
use crate::radau::{self, Settings, StageChoice};
use crate::solution::Plan;
use crate::vi::SolverKind;

/// The steps that a run may make unless `limits.steps` says less.
pub(super) const MOST_STEPS: u64 = 10_000_000;
/// The numbers that a trajectory may hold: 256 MiB of them.
pub(super) const MOST_VALUES: usize = 1 << 25;
/// The natural-map residual to reach where none is given, relative to the terms of `G`.
const VI_TOLERANCE: f64 = 1e-10;

impl Specification {
    /// What to run and what to keep of it.
    pub fn plan(&self) -> Plan {
        let model = self.model();
        Plan {
            names: model.names().cloned().collect(),
            outputs: model.outputs.clone(),
            initial: model.initial.clone(),
            start: self.time().start,
            end: self.time().end,
            times: self.output_times().map(<[f64]>::to_vec),
            fields: self.output_fields().to_vec(),
            global_error: self.estimates_global_error(),
            analysis: self.analysis().clone(),
            settings: settings(self.method(), self.absolute_tolerances()),
            most_steps: self.step_limit().unwrap_or(MOST_STEPS),
            most_values: MOST_VALUES,
        }
    }
}

fn settings(method: &Method, atol: &[f64]) -> Settings {
    Settings {
        stages: match method.stages {
            Stages::Fixed(s) => StageChoice::Fixed(s as usize),
            Stages::Auto if method.step.is_some() => StageChoice::Fixed(3),
            Stages::Auto => StageChoice::Auto,
        },
        rtol: method.rtol,
        atol: atol.to_vec(),
        step: method.step,
        first_step: method.first_step,
        max_step: method.max_step.unwrap_or(f64::INFINITY),
        min_step: method.min_step.unwrap_or(0.0),
        switches: match method.switches {
            Switches::Locate => radau::Switches::Locate,
            Switches::StepOver => radau::Switches::StepOver,
        },
        vi_solver: match method.vi_solver {
            ViSolverName::Auto => SolverKind::Auto,
            ViSolverName::Lemke => SolverKind::Lemke,
            ViSolverName::SemismoothNewton => SolverKind::SemismoothNewton,
            ViSolverName::ActiveSet => SolverKind::ActiveSet,
            ViSolverName::Conic => SolverKind::Conic,
            ViSolverName::BlockGaussSeidel => SolverKind::BlockGaussSeidel,
        },
        vi_tolerance: method.vi_tolerance.unwrap_or(VI_TOLERANCE),
    }
}
