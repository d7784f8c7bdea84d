//! The method of solution: stages, tolerances, step sizes, treatment of switches, the solver of the stage problems.

use super::choices::choices;
use super::error::{Errors, SpecificationError};
use super::plan::MOST_STEPS;
use super::pointer::Pointer;
use super::stages::Stages;
use super::tolerance::AbsoluteTolerance;
use radau::MOST_STAGES;
use serde::Deserialize;
use utoipa::ToSchema;

/// The numerical method and its settings. Every key is optional.
#[derive(Clone, Debug, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct Method {
    /// The family of numerical methods. Default `auto`.
    #[serde(default)]
    pub name: MethodName,
    /// Number of stages of Radau IIA, of order `2s - 1`: any `s` from 1 to 9 with a fixed `step`; without it, an odd
    /// `s` or `auto`. Default `auto`.
    #[serde(default)]
    pub stages: Stages,
    /// Relative tolerance of the local error, from 1e-14 to 0.1. Default 1e-6.
    #[serde(default = "default_rtol")]
    #[schema(minimum = 1e-14, maximum = 0.1, default = 1e-6)]
    pub rtol: f64,
    /// Absolute tolerance of the local error, one number or one per state. Default `rtol/1000`, also for states that
    /// are not named. It should be below the smallest value of interest.
    pub atol: Option<AbsoluteTolerance>,
    /// Fixed step size. Default: the step size follows from the error estimate; for problems with memory, the step
    /// size is halved until two runs agree.
    #[schema(exclusive_minimum = 0.0)]
    pub step: Option<f64>,
    /// Size of the first step to try.
    #[schema(exclusive_minimum = 0.0)]
    pub first_step: Option<f64>,
    /// Maximum step size.
    #[schema(exclusive_minimum = 0.0)]
    pub max_step: Option<f64>,
    /// Minimum step size; a solve that needs a smaller step fails.
    #[schema(exclusive_minimum = 0.0)]
    pub min_step: Option<f64>,
    /// The treatment of changes of the active set. Default `locate`.
    #[serde(default)]
    pub switches: Switches,
    /// The solver of the variational inequalities at the stages. Default `auto`.
    #[serde(default)]
    pub vi_solver: ViSolverName,
    /// Tolerance of the natural-map residual at which a variational inequality counts as solved.
    #[schema(exclusive_minimum = 0.0, maximum = 0.01)]
    pub vi_tolerance: Option<f64>,
    /// Treatment of impacts of mechanical systems and rigid bodies. Default for mechanical systems: `time_stepping`
    /// if `step` is given and `stages` is not, else `locate`. Default for rigid bodies: `time_stepping` if more than
    /// 100 bodies move, if a moving body has edges, or with joints, forces besides gravity or friction on patches;
    /// else located impacts, with time stepping while impacts are too many.
    pub impacts: Option<Impacts>,
    /// Law for simultaneous impacts of mechanical systems. Default `simultaneous`.
    pub impact_law: Option<ImpactLawName>,
    /// Whether to solve a problem of index three or more, which is refused by default: solutions exist for special
    /// data only.
    #[serde(default)]
    pub accept_index_three: bool,
}

impl Default for Method {
    fn default() -> Self {
        Self {
            name: MethodName::default(),
            stages: Stages::default(),
            rtol: default_rtol(),
            atol: None,
            step: None,
            first_step: None,
            max_step: None,
            min_step: None,
            switches: Switches::default(),
            vi_solver: ViSolverName::default(),
            vi_tolerance: None,
            impacts: None,
            impact_law: None,
            accept_index_three: false,
        }
    }
}

fn default_rtol() -> f64 {
    1e-6
}

choices! {
    /// The families of numerical methods.
    MethodName {
        "auto" Auto: "The method that suits the problem type."
        "radau" Radau: "Radau IIA with a variational inequality at every stage, of order 2s - 1 for s stages."
        "tr_bdf2" TrBdf2: "The trapezoidal rule with backward differences, of order 2; for obstacle problems on grids."
        "contact" Contact: "The steppers of mechanical systems with impacts and friction."
        "convolution" Convolution: "Convolution quadrature on Radau IIA with a fixed step, for problems with memory."
    }
}

choices! {
    /// The treatment of impacts.
    Impacts {
        "time_stepping" TimeStepping: "Fixed steps over the impacts (Moreau): any number of impacts, first order."
        "locate" Locate: "Smooth motion by Radau IIA between impacts, each located in time; time stepping where they \
                          accumulate. For rigid bodies without joints: fixed steps that end at impacts, second order."
    }
}

choices! {
    /// The law for simultaneous impacts at several contacts.
    ImpactLawName {
        "simultaneous" Simultaneous: "One impact problem for all contacts together."
        "sequential" Sequential: "One contact after another, as a shock travels through a row of balls."
    }
}

choices! {
    /// The treatment of changes of the active set.
    Switches {
        "locate" Locate: "End a step at every change: full order throughout."
        "step_over" StepOver: "Step over the changes: cheaper per step, of low order in a step with a change."
    }
}

choices! {
    /// The solvers of the variational inequalities at the stages.
    ViSolverName {
        "auto" Auto: "Solvers chosen by structure and size; if one fails, the next is tried."
        "lemke" Lemke: "Lemke's pivoting, with lexicographic resolution of ties."
        "semismooth_newton" SemismoothNewton: "Newton's method on the natural map."
        "active_set" ActiveSet: "The primal-dual active set method, sparse; for intervals and a positive diagonal."
        "conic" Conic: "An interior-point method; for symmetric inequalities."
        "block_gauss_seidel" BlockGaussSeidel: "Block Gauss-Seidel sweeps over the blocks of the set."
    }
}

impl ViSolverName {
    /// Whether the solver of variational inequalities also handles balls, cones, simplices and polyhedra.
    pub(super) fn takes_blocks(self) -> bool {
        !matches!(self, Self::Lemke | Self::ActiveSet)
    }
}

impl Method {
    /// Checks all settings of the method except the absolute tolerances; `horizon` is the length of the time horizon,
    /// if that is known.
    pub(super) fn check(&self, place: &Pointer<'_>, horizon: Option<f64>, errors: &mut Errors) {
        check_stages(self.stages, self.step.is_some(), &place.key("stages"), errors);
        check_rtol(self.rtol, &place.key("rtol"), errors);
        if let Some(tolerance) = self.vi_tolerance.filter(|tolerance| !(*tolerance > 0.0 && *tolerance <= 0.01)) {
            out_of_range(&place.key("vi_tolerance"), tolerance, "above 0, at most 0.01", errors);
        }
        self.check_steps(place, horizon, errors);
    }

    fn check_steps(&self, place: &Pointer<'_>, horizon: Option<f64>, errors: &mut Errors) {
        let adaptive = [("first_step", self.first_step), ("max_step", self.max_step), ("min_step", self.min_step)];
        for (key, step) in adaptive {
            if let Some(step) = step.filter(|step| *step <= 0.0) {
                out_of_range(&place.key(key), step, "above 0", errors);
            }
        }
        if let Some(step) = self.step {
            check_step(step, horizon, &place.key("step"), errors);
        }
        if self.step.is_some_and(|step| step > 0.0) {
            for (key, _) in adaptive.iter().filter(|(_, step)| step.is_some()) {
                let detail = format!("`{key}` has no effect beside a fixed `step`");
                errors.report(&place.key(key), "conflict", detail);
            }
        }
        if let (Some(min), Some(max)) = (self.min_step, self.max_step)
            && min > max
        {
            let detail = format!("the shortest step {min} is longer than the longest {max}");
            errors.report(&place.key("min_step"), "out_of_range", detail);
        }
        if let Some(first) = self.first_step
            && !(self.min_step.is_none_or(|min| min <= first) && self.max_step.is_none_or(|max| first <= max))
        {
            let detail = format!("the first step {first} does not lie between `min_step` and `max_step`");
            errors.report(&place.key("first_step"), "out_of_range", detail);
        }
    }
}

impl Method {
    /// Returns the treatment of impacts of mechanical systems, or its default.
    pub(super) fn impacts(&self) -> Impacts {
        let stepped = self.step.is_some() && self.stages == Stages::Auto;
        self.impacts.unwrap_or(if stepped { Impacts::TimeStepping } else { Impacts::Locate })
    }

    /// Returns the keys given by the user that control the error of a step. A tolerance equal to its default counts as
    /// not given.
    pub(super) fn error_controls(&self) -> impl Iterator<Item = &'static str> {
        let given = [
            ("rtol", self.rtol != default_rtol()),
            ("atol", self.atol.is_some()),
            ("first_step", self.first_step.is_some()),
            ("max_step", self.max_step.is_some()),
            ("min_step", self.min_step.is_some()),
        ];
        given.into_iter().filter(|(_, given)| *given).map(|(key, _)| key)
    }
}

/// Checks a number of Radau IIA stages, with or without a fixed step.
pub(super) fn check_stages(stages: Stages, fixed: bool, place: &Pointer<'_>, errors: &mut Errors) {
    let Stages::Fixed(stages) = stages else { return };
    if !(1..=MOST_STAGES as u64).contains(&stages) {
        let detail = format!("Radau IIA with {stages} stages is not available");
        let error = SpecificationError::new(place.to_string(), "out_of_range", detail);
        errors.push(error.expected(format!("1 to {MOST_STAGES}, or \"auto\"")));
    } else if stages % 2 == 0 && !fixed {
        let detail = format!(
            "{stages} stages need a fixed `step`: for an even number of stages Radau IIA has no real \
             eigenvalue, and so no embedded error estimate for a choice of the step"
        );
        let error = SpecificationError::new(place.to_string(), "even_stages_need_step", detail);
        errors.push(error.expected("1, 3, 5, 7, 9 or \"auto\", or a fixed `step`"));
    }
}

/// Checks a relative tolerance of the local error.
pub(super) fn check_rtol(rtol: f64, place: &Pointer<'_>, errors: &mut Errors) {
    if !(1e-14..=0.1).contains(&rtol) {
        out_of_range(place, rtol, "from 1e-14 to 0.1", errors);
    }
}

/// Checks a fixed step size; `horizon` is the length of the time horizon, if that is known.
pub(super) fn check_step(step: f64, horizon: Option<f64>, place: &Pointer<'_>, errors: &mut Errors) {
    if step <= 0.0 {
        out_of_range(place, step, "above 0", errors);
    } else if let Some(steps) = horizon.map(|horizon| horizon / step).filter(|steps| *steps > MOST_STEPS as f64) {
        let detail = format!("a step of {step} makes {steps:.3e} steps");
        let error = SpecificationError::new(place.to_string(), "too_many_steps", detail);
        errors.push(error.expected(format!("at most {MOST_STEPS} steps")));
    }
}

/// Reports a number in `method` that is outside its admissible range.
pub(super) fn out_of_range(place: &Pointer<'_>, value: f64, range: &str, errors: &mut Errors) {
    let error = SpecificationError::new(place.to_string(), "out_of_range", format!("{value} is out of range"));
    errors.push(error.expected(range));
}
