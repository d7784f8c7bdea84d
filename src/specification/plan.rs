//! Settings of a run from a checked specification.

use super::checked::Specification;
use super::method::{ImpactLawName, Switches, ViSolverName};
use super::stages::Stages;
use models::obstacle;
use radau::{self, Settings, StageChoice};
use solution::Plan;
use vi::SolverKind;

/// Largest number of steps of a run, unless `limits.steps` is smaller.
pub(super) const MOST_STEPS: u64 = 10_000_000;
/// Largest number of values in a trajectory: 256 MiB.
pub(super) const MOST_VALUES: usize = 1 << 25;
/// Default tolerance of the natural-map residual, relative to the terms of `G`.
pub(super) const VI_TOLERANCE: f64 = 1e-10;
/// Admissible deviation of an interpolant from the run, as a fraction of the relative tolerance.
const INTERPOLANT: f64 = 1e-2;
/// Default number of fixed steps of time stepping over the horizon.
const DEFAULT_STEPS: f64 = 10_000.0;

impl Specification {
    /// Returns the plan of the run: its initial values, time horizon, output times and columns, sensitivities and
    /// limits.
    pub fn plan(&self) -> Plan {
        let model = self.model();
        Plan {
            names: model.output_names(),
            observables: self.observables().clone(),
            sensitivities: self.sensitivities().cloned(),
            initial: model.initial(),
            start: self.time().start,
            end: self.time().end,
            times: self.output_times().map(<[f64]>::to_vec),
            fields: self.output_fields().to_vec(),
            global_error: self.estimates_global_error(),
            statistics: false,
            reducers: None,
            interpolants: self.interpolants(),
            most_steps: self.step_limit().unwrap_or(MOST_STEPS),
            most_values: MOST_VALUES,
            most_memory: self.most_memory,
        }
    }

    /// Returns the admissible deviation of interpolants of the output fields from the run, if interpolants are
    /// requested and possible.
    fn interpolants(&self) -> Option<f64> {
        let is_run = self.search().is_none() && self.sweep().is_none() && self.sensitivities().is_none();
        let is_asked = self.keeps_interpolants && is_run && self.observables().integrals == 0;
        is_asked.then(|| if self.method().step.is_some() { 0.0 } else { INTERPOLANT * self.method().rtol })
    }

    /// Returns the settings of a Radau IIA run.
    pub fn settings(&self) -> Settings {
        let method = self.method();
        let is_inside = |t: f64| t > self.time().start && t < self.time().end;
        Settings {
            stages: match method.stages {
                Stages::Fixed(s) => StageChoice::Fixed(s as usize),
                Stages::Auto if method.step.is_some() => StageChoice::Fixed(3),
                Stages::Auto => StageChoice::Auto,
            },
            rtol: method.rtol,
            atol: self.absolute_tolerances().to_vec(),
            step: method.step,
            first_step: method.first_step,
            max_step: method.max_step.unwrap_or(f64::INFINITY),
            min_step: method.min_step.unwrap_or(0.0),
            interpolated: (self.sweep().is_none_or(|sweep| sweep.kept.is_some())
                && self.output_times().is_some_and(|times| times.iter().any(|t| is_inside(*t))))
                || self.keeps_interpolants
                || self.observables().is_followed()
                || self.integrates_objective()
                || self.search().is_some()
                || self.sweep().is_some_and(|sweep| sweep.reducers.is_dense()),
            switches: match method.switches {
                Switches::Locate => radau::Switches::Locate,
                Switches::StepOver => radau::Switches::StepOver,
            },
            vi_solver: solver(method.vi_solver),
            vi_tolerance: method.vi_tolerance.unwrap_or(VI_TOLERANCE),
        }
    }

    /// Whether the objective of adjoint mode is an integral.
    fn integrates_objective(&self) -> bool {
        let objective = self.sensitivities().and_then(|asked| asked.objective.as_ref());
        objective.is_some_and(|objective| objective.observables.integrals > 0)
    }

    /// Returns the settings of the solver of obstacle problems.
    pub fn obstacle_settings(&self) -> obstacle::Settings {
        let method = self.method();
        obstacle::Settings {
            rtol: method.rtol,
            atol: self.absolute_tolerances()[0],
            step: method.step,
            first_step: method.first_step,
            max_step: method.max_step.unwrap_or(f64::INFINITY),
            min_step: method.min_step.unwrap_or(0.0),
            vi_tolerance: method.vi_tolerance.unwrap_or(VI_TOLERANCE),
        }
    }

    /// Returns the settings of the contact steppers; `tolerance` is the default relative residual of the contact law.
    pub(super) fn contact_settings(&self, tolerance: f64) -> contact::Settings {
        let (method, time) = (self.method(), self.time());
        contact::Settings {
            step: method.step.unwrap_or((time.end - time.start) / DEFAULT_STEPS),
            default_step: method.step.is_none(),
            impact_law: match method.impact_law.unwrap_or_default() {
                ImpactLawName::Simultaneous => contact::ImpactLaw::Simultaneous,
                ImpactLawName::Sequential => contact::ImpactLaw::Sequential,
            },
            tolerance: method.vi_tolerance.unwrap_or(tolerance),
        }
    }
}

/// Returns the solver of variational inequalities with the given name.
pub(super) fn solver(name: ViSolverName) -> SolverKind {
    match name {
        ViSolverName::Auto => SolverKind::Auto,
        ViSolverName::Lemke => SolverKind::Lemke,
        ViSolverName::SemismoothNewton => SolverKind::SemismoothNewton,
        ViSolverName::ActiveSet => SolverKind::ActiveSet,
        ViSolverName::Conic => SolverKind::Conic,
        ViSolverName::BlockGaussSeidel => SolverKind::BlockGaussSeidel,
    }
}
