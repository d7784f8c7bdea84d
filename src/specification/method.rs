//! How a problem is solved: stages, tolerances, step sizes, switches, the solver of the stage problems.

use super::choices::choices;
use super::error::{Errors, SpecificationError};
use super::plan::MOST_STEPS;
use super::pointer::Pointer;
use super::stages::Stages;
use super::tolerance::AbsoluteTolerance;
use radau::MOST_STAGES;
use serde::Deserialize;
use utoipa::ToSchema;

/// How the problem is solved. Every key may be left out.
#[derive(Clone, Debug, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct Method {
    /// The family of methods. Default `auto`.
    #[serde(default)]
    pub name: MethodName,
    /// Stages of Radau IIA, of order `2s - 1`: any `s` from 1 to 9 with a fixed `step`, an odd one without, or `auto`,
    /// the default.
    #[serde(default)]
    pub stages: Stages,
    /// Relative tolerance of the local error, from 1e-14 to 0.1. Default 1e-6.
    #[serde(default = "default_rtol")]
    #[schema(minimum = 1e-14, maximum = 0.1, default = 1e-6)]
    pub rtol: f64,
    /// Absolute tolerance of the local error, one number or one for each state. Default `rtol/1000`, which also holds
    /// for the states that are not named. It should lie below the smallest value that matters.
    pub atol: Option<AbsoluteTolerance>,
    /// A fixed step. Without it the step follows the error; with memory, it is halved until runs agree.
    #[schema(exclusive_minimum = 0.0)]
    pub step: Option<f64>,
    /// The first step to try.
    #[schema(exclusive_minimum = 0.0)]
    pub first_step: Option<f64>,
    /// The longest step.
    #[schema(exclusive_minimum = 0.0)]
    pub max_step: Option<f64>,
    /// The shortest step; a solve that needs a shorter one fails.
    #[schema(exclusive_minimum = 0.0)]
    pub min_step: Option<f64>,
    /// What to do where the active set changes. Default `locate`.
    #[serde(default)]
    pub switches: Switches,
    /// The solver of the variational inequalities at the stages. Default `auto`.
    #[serde(default)]
    pub vi_solver: ViSolverName,
    /// Natural-map residual below which a variational inequality is solved.
    #[schema(exclusive_minimum = 0.0, maximum = 0.01)]
    pub vi_tolerance: Option<f64>,
    /// How impacts of mechanical systems are met. Default `time_stepping` where a `step` is given and `stages` are not, else
    /// `locate`.
    pub impacts: Option<Impacts>,
    /// How simultaneous impacts of mechanical systems come about. Default `simultaneous`.
    pub impact_law: Option<ImpactLawName>,
    /// Solve a problem of index three or more, which is refused otherwise: its solutions exist for special data only.
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
    /// The families of methods.
    MethodName {
        "auto" Auto: "The one that fits the problem."
        "radau" Radau: "Radau IIA with a variational inequality at every stage, of order 2s - 1 for s stages."
        "tr_bdf2" TrBdf2: "The trapezoidal rule with backward differences, of order 2; for obstacle problems on grids."
        "contact" Contact: "The steppers of mechanical systems with impacts and friction."
        "convolution" Convolution: "Convolution quadrature on Radau IIA with a fixed step, for problems with memory."
    }
}

choices! {
    /// How impacts are met.
    Impacts {
        "time_stepping" TimeStepping: "Steps of one size go over them: any number of impacts, first order."
        "locate" Locate: "Smooth motion by Radau IIA from impact to impact, each at its time; time stepping where they accumulate."
    }
}

choices! {
    /// How impacts at several contacts at once come about.
    ImpactLawName {
        "simultaneous" Simultaneous: "All at once: every body takes its share."
        "sequential" Sequential: "One after the other, as a shock runs through a row of balls."
    }
}

choices! {
    /// What to do where the active set changes.
    Switches {
        "locate" Locate: "End a step on every change: full order throughout."
        "step_over" StepOver: "Step over them: cheaper a step, of low order where there is one."
    }
}

choices! {
    /// The solvers of the variational inequalities at the stages.
    ViSolverName {
        "auto" Auto: "By structure and size; where one fails, the next."
        "lemke" Lemke: "Lemke's pivoting, with lexicographic ties."
        "semismooth_newton" SemismoothNewton: "Newton's method on the natural map."
        "active_set" ActiveSet: "The primal-dual active set method, sparse; for intervals and a positive diagonal."
        "conic" Conic: "An interior-point method; where the inequality is symmetric."
        "block_gauss_seidel" BlockGaussSeidel: "Sweeps over the blocks of the set."
    }
}

impl ViSolverName {
    /// Whether it solves over balls, cones, simplices and polyhedra too.
    pub(super) fn takes_blocks(self) -> bool {
        !matches!(self, Self::Lemke | Self::ActiveSet)
    }
}

impl Method {
    /// Checks everything but the absolute tolerances, over a horizon of the given length where that is known.
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
                let detail = format!("`{key}` has no meaning beside a fixed `step`");
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
    /// How impacts of mechanical systems are met.
    pub(super) fn impacts(&self) -> Impacts {
        let stepped = self.step.is_some() && self.stages == Stages::Auto;
        self.impacts.unwrap_or(if stepped { Impacts::TimeStepping } else { Impacts::Locate })
    }

    /// The keys that say what error a step may have, as far as they were given. A tolerance that is the default may not
    /// have been.
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

/// Checks a number of stages, beside a fixed step or not.
pub(super) fn check_stages(stages: Stages, fixed: bool, place: &Pointer<'_>, errors: &mut Errors) {
    let Stages::Fixed(stages) = stages else { return };
    if !(1..=MOST_STAGES as u64).contains(&stages) {
        let detail = format!("{stages} stages are not on offer");
        let error = SpecificationError::new(place.to_string(), "out_of_range", detail);
        errors.push(error.expected(format!("1 to {MOST_STAGES}, or \"auto\"")));
    } else if stages % 2 == 0 && !fixed {
        let detail = format!(
            "{stages} stages need a fixed `step`: for an even number of stages Radau IIA has no real \
             eigenvalue, so there is no embedded error estimate to choose the step by"
        );
        let error = SpecificationError::new(place.to_string(), "even_stages_need_step", detail);
        errors.push(error.expected("1, 3, 5, 7, 9 or \"auto\", or a fixed `step`"));
    }
}

/// Checks a relative tolerance.
pub(super) fn check_rtol(rtol: f64, place: &Pointer<'_>, errors: &mut Errors) {
    if !(1e-14..=0.1).contains(&rtol) {
        out_of_range(place, rtol, "from 1e-14 to 0.1", errors);
    }
}

/// Checks a fixed step, over a horizon of the given length where that is known.
pub(super) fn check_step(step: f64, horizon: Option<f64>, place: &Pointer<'_>, errors: &mut Errors) {
    if step <= 0.0 {
        out_of_range(place, step, "above 0", errors);
    } else if let Some(steps) = horizon.map(|horizon| horizon / step).filter(|steps| *steps > MOST_STEPS as f64) {
        let detail = format!("a step of {step} makes {steps:.3e} steps");
        let error = SpecificationError::new(place.to_string(), "too_many_steps", detail);
        errors.push(error.expected(format!("at most {MOST_STEPS} steps")));
    }
}

/// Reports a number outside its range.
pub(super) fn out_of_range(place: &Pointer<'_>, value: f64, range: &str, errors: &mut Errors) {
    let error = SpecificationError::new(place.to_string(), "out_of_range", format!("{value} is out of range"));
    errors.push(error.expected(range));
}
