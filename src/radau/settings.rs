//! What a user may choose of the method, and how a run can fail.

use problem::Side;
use vi::SolverKind;

/// How many stages a step has.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum StageChoice {
    /// Always so many; odd, unless the step is fixed.
    Fixed(usize),
    /// 3, 5 or 7, by the convergence of Newton's method.
    Auto,
}

/// What happens at a change of the active face of `K`.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Switches {
    /// The step ends there: full order over the whole trajectory.
    Locate,
    /// The step goes on across it, with the VI at every stage.
    StepOver,
}

/// The choices of a run.
#[derive(Clone, Debug)]
pub struct Settings {
    /// Stages a step.
    pub stages: StageChoice,
    /// Relative tolerance on `x`.
    pub rtol: f64,
    /// Absolute tolerance, one a state, in its unit.
    pub atol: Vec<f64>,
    /// A fixed step size; none is adaptive.
    pub step: Option<f64>,
    /// The first step size to try.
    pub first_step: Option<f64>,
    /// The largest step size.
    pub max_step: f64,
    /// The smallest step size before the run fails.
    pub min_step: f64,
    /// Whether values between the ends of steps are asked for: then no step is so long that its polynomial leaves the
    /// solution in between.
    pub interpolated: bool,
    /// What happens at switches.
    pub switches: Switches,
    /// The solver of the affine VIs.
    pub vi_solver: SolverKind,
    /// The natural-map residual to reach, relative to the terms of `G`.
    pub vi_tolerance: f64,
}

impl Settings {
    /// `atol + rtol |x|` of the states from number `first` on, where these are `x`.
    pub fn tolerances(&self, first: usize, x: &[f64]) -> Vec<f64> {
        x.iter().zip(&self.atol[first..]).map(|(x, atol)| atol + self.rtol * x.abs()).collect()
    }
}

/// Why a step could not be made.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum StepError {
    /// A rate, a `G` or a bound is not a number at the beginning of a step.
    #[error(
        "{what} number {component} (counted from 0) is not finite at t = {t:?}: a division by zero, a function outside \
         its domain, or a number too large"
    )]
    NotFinite {
        /// `rate`, `inequality` or `bound`, or the derivative of one.
        what: &'static str,
        /// Its index.
        component: usize,
        /// When.
        t: f64,
    },
    /// The step size fell to the rounding level of `t`, or to `min_step`.
    #[error("the step size fell to {h:e} at t = {t:?}{}: {cause}", limit(*least))]
    StepTooSmall {
        /// When.
        t: f64,
        /// The step size.
        h: f64,
        /// The step size that was allowed at least, if one was given; zero otherwise.
        least: f64,
        /// What the last rejections were for.
        cause: RejectionCause,
    },
    /// The steps cross a kink of the problem to and fro, along which the solution slides.
    #[error(
        "a rate jumps where quantity {kink} (counted from 0) of those that it switches on changes its sign, and from t = {t:?} on \
         the solution slides along that jump, which steps cannot follow; write the jump as a set"
    )]
    Chattering {
        /// When.
        t: f64,
        /// Which of the kinks of the problem.
        kink: usize,
    },
    /// A variable switches again and again within noise.
    #[error(
        "variable {variable} (counted from 0) switches again and again, from t = {t:?} on, while what decides it stays below what \
         the tolerances resolve"
    )]
    Unresolved {
        /// When.
        t: f64,
        /// The variable.
        variable: usize,
    },
    /// The lower bound of a variable rises above its upper bound, or the radius of its ball falls below zero.
    #[error(
        "the {} of variable {variable} (counted from 0) is empty from t = {t:?} on: {}", side.emptiness().0, side.emptiness().1
    )]
    EmptySet {
        /// The variable, the first of a ball.
        variable: usize,
        /// What moved there.
        side: Side,
        /// The last time at which it held a number.
        t: f64,
    },
    /// Newton's method failed where the step is fixed.
    #[error(
        "Newton's method on the stages does not converge with the fixed step {h:e} at t = {t:?}; take a smaller step, or leave `step` out"
    )]
    NewtonFailed {
        /// When.
        t: f64,
        /// The step size.
        h: f64,
    },
    /// The equations of the free variables do not hold at the start, and no value of theirs makes them hold.
    #[error("the start is inconsistent: the constraints ask for a jump of state {state} (counted from 0) by {jump:e}")]
    InconsistentStart {
        /// The state that would jump most, in units of its tolerance.
        state: usize,
        /// By how much.
        jump: f64,
    },
    /// The problem needs more memory than one run may take.
    #[error("{what} for {unknowns} unknowns do not fit into the memory that one run may take (2 GiB for each)")]
    TooLarge {
        /// What does not fit.
        what: &'static str,
        /// How many unknowns are coupled by it.
        unknowns: usize,
    },
    /// The outside asked to stop in the middle of a step.
    #[error("stopped at t = {t:?}")]
    Interrupted {
        /// When.
        t: f64,
    },
    /// The solver found no solution of the VI at the start, or behind a break; there may be one.
    #[error(
        "no variables were found that satisfy the variational inequality at t = {t:?}, though nothing shows that there are \
         none; where it is nonlinear in them, another form of it may be easier, and where several conditions hold at once, \
         other initial values"
    )]
    NoStart {
        /// When.
        t: f64,
    },
    /// Whatever the variables are, one inequality fails, as it is or linearised: then the VI, or that of Newton's method,
    /// has no solution.
    #[error(
        "the variational inequality has no solution at t = {t:?}: the inequality of variable {variable} (counted from 0), \
         {}, fails whatever the variables are", if *.linear { "as it is" } else { "linearised" }
    )]
    NoSolution {
        /// When.
        t: f64,
        /// The variable.
        variable: usize,
        /// Whether the problem is linear, so that this is a proof.
        linear: bool,
    },
}

/// Says that a step size was not allowed to fall further.
fn limit(least: f64) -> String {
    if least > 0.0 { format!(", below `min_step` = {least:e}, and only a smaller one would do") } else { String::new() }
}

impl StepError {
    /// A stable word for programs.
    pub fn code(&self) -> &'static str {
        match self {
            Self::NotFinite { .. } => "not_finite",
            Self::StepTooSmall { .. } => "step_too_small",
            Self::Chattering { .. } => "chattering",
            Self::Unresolved { .. } => "switches_unresolved",
            Self::EmptySet { .. } => "empty_set",
            Self::NewtonFailed { .. } => "newton_failed",
            Self::InconsistentStart { .. } => "inconsistent_start",
            Self::TooLarge { .. } => "too_large",
            Self::Interrupted { .. } => "interrupted",
            Self::NoStart { .. } => "start_not_found",
            Self::NoSolution { .. } => "no_solution",
        }
    }
}

/// Why a step is done again, smaller.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum RejectionCause {
    /// The error estimate is above the tolerance.
    Error,
    /// The increments of Newton's method on the stages grow.
    Diverged,
    /// Newton's method would need more iterations than a smaller step is worth.
    Slow,
    /// A matrix of the stage equations is singular.
    Singular,
    /// A rate, a `G` or a bound at a stage is not a number.
    NotFinite,
    /// The variational inequality of the stages has no solution, or none was found.
    Unsolved,
}

impl RejectionCause {
    /// Every cause, in the order of declaration.
    pub const ALL: [Self; 6] =
        [Self::Error, Self::Diverged, Self::Slow, Self::Singular, Self::NotFinite, Self::Unsolved];

    /// A stable word for programs.
    pub fn name(self) -> &'static str {
        match self {
            Self::Error => "error_test",
            Self::Diverged => "newton_diverged",
            Self::Slow => "newton_slow",
            Self::Singular => "singular_matrix",
            Self::NotFinite => "not_finite",
            Self::Unsolved => "inequality_unsolved",
        }
    }
}

impl std::fmt::Display for RejectionCause {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(match self {
            Self::Error => "the error stays above the tolerance (a blow-up, a jump, or tolerances too tight for doubles)",
            Self::Diverged | Self::Slow => {
                "Newton's method on the stages does not converge (a singularity, a blow-up, or an equation with no solution)"
            }
            Self::Singular => "the equations of the stages are singular (an equation that does not determine its unknown)",
            Self::NotFinite => "a stage meets a value that is not finite (a blow-up, or the edge of a function's domain)",
            Self::Unsolved => {
                "the variational inequality of the stages has no solution, or none was found (raising a variable should \
                 raise its inequality, at once or in time: look at its sign)"
            }
        })
    }
}
