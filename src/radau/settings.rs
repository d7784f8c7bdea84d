//! The settings of the method Radau IIA, and the errors of a run.

use problem::Side;
use vi::SolverKind;

/// The number of stages per step, or how it is chosen.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum StageChoice {
    /// The same number of stages in every step; odd, unless the step size is fixed.
    Fixed(usize),
    /// 3, 5 or 7 stages, chosen by the convergence of Newton's method.
    Auto,
}

/// What happens at a switch, a change of the active face of `K`.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Switches {
    /// The step ends at the switch: full order over the whole trajectory.
    Locate,
    /// The step goes on across the switch, with the variational inequality solved at every stage.
    StepOver,
}

/// The settings of a run of Radau IIA.
#[derive(Clone, Debug)]
pub struct Settings {
    /// The number of stages per step, or how it is chosen.
    pub stages: StageChoice,
    /// Relative tolerance on the states `x`.
    pub rtol: f64,
    /// Absolute tolerance of each state, in the unit of the state.
    pub atol: Vec<f64>,
    /// Fixed step size of the run; `None` for adaptive steps.
    pub step: Option<f64>,
    /// The first step size to try; with a fixed step size, an upper bound on the time over which the first active face
    /// of `K` is looked for.
    pub first_step: Option<f64>,
    /// The largest step size that the run may take.
    pub max_step: f64,
    /// The smallest step size at which a run may continue; a smaller one makes it fail.
    pub min_step: f64,
    /// Whether output between the ends of steps is requested: the step size is then limited so that the polynomial of a
    /// step follows the solution in between.
    pub interpolated: bool,
    /// Treatment of switches, the changes of the active face of `K`.
    pub switches: Switches,
    /// The solver of the affine variational inequalities.
    pub vi_solver: SolverKind,
    /// Tolerance on the residual of the natural map, relative to the terms of `G`.
    pub vi_tolerance: f64,
}

impl Settings {
    /// Returns the tolerances `atol + rtol |x|` of the states `x` with indices from `first` on.
    pub fn tolerances(&self, first: usize, x: &[f64]) -> Vec<f64> {
        x.iter().zip(&self.atol[first..]).map(|(x, atol)| atol + self.rtol * x.abs()).collect()
    }
}

/// The reason why a step, and with it the run, failed.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum StepError {
    /// A rate, a `G` or a bound is not finite at the beginning of a step.
    #[error(
        "{what} number {component} (counted from 0) is not finite at t = {t:?}: a division by zero, a function outside \
         its domain, or a number too large"
    )]
    NotFinite {
        /// Kind of the row: `rate`, `inequality` or `bound`, or the derivative of one of these.
        what: &'static str,
        /// Index of the row that is not finite among the rows of its kind.
        component: usize,
        /// Time at the beginning of the step that failed.
        t: f64,
    },
    /// The step size fell to the rounding level of `t`, or to `min_step`.
    #[error("the step size fell to {h:e} at t = {t:?}{}: {cause}", limit(*least))]
    StepTooSmall {
        /// Time that the run had reached when the step size became too small.
        t: f64,
        /// The step size that became too small.
        h: f64,
        /// Smallest step size that the settings allow; zero if none was given.
        least: f64,
        /// Cause of the last rejections of the step.
        cause: RejectionCause,
    },
    /// The steps cross a kink of the problem back and forth, along which the solution slides.
    #[error(
        "a rate jumps where its switching quantity {kink} (counted from 0) changes sign, and from t = {t:?} on \
         the solution slides along the jump, which steps cannot follow; write the jump as a set"
    )]
    Chattering {
        /// Time from which on the solution slides along the kink.
        t: f64,
        /// Index of the kink among the kinks of the problem.
        kink: usize,
    },
    /// Functions of time jump or bend so often that the end of the run is out of reach.
    #[error(
        "up to t = {t:?} functions of time jump or bend every {distance:e}, and a step ends at each: there are too many up to the \
         end; write what is so fast as its mean, or take a shorter time"
    )]
    DenseBreaks {
        /// Time that the run had reached.
        t: f64,
        /// Mean time between successive jumps or bends of functions of time.
        distance: f64,
    },
    /// A variable changes its activity again and again within noise.
    #[error(
        "variable {variable} (counted from 0) switches repeatedly from t = {t:?} on, while the values that decide it \
         stay below the resolution of the tolerances"
    )]
    Unresolved {
        /// Time from which on the variable switches again and again.
        t: f64,
        /// Index of the variable that switches again and again.
        variable: usize,
    },
    /// The lower bound of a variable rises above its upper bound, or the radius of its ball falls below zero.
    #[error(
        "the {} of variable {variable} (counted from 0) is empty from t = {t:?} on: {}", side.emptiness().0, side.emptiness().1
    )]
    EmptySet {
        /// Index of the variable whose set is empty; for a ball, that of its first member.
        variable: usize,
        /// The end of the interval, or the radius, whose value made the set of the variable empty.
        side: Side,
        /// Last time at which the set of the variable was not empty.
        t: f64,
    },
    /// Newton's method on the stages failed with a fixed step size.
    #[error(
        "Newton's method on the stages does not converge with the fixed step {h:e} at t = {t:?}; choose a smaller \
         step, or leave `step` out"
    )]
    NewtonFailed {
        /// Time at the beginning of the step whose stages were not solved.
        t: f64,
        /// The fixed step size of the run.
        h: f64,
    },
    /// The initial states of a problem without bounds violate its constraints, whatever the values of the variables.
    #[error("the start is inconsistent: the constraints require a jump of state {state} (counted from 0) by {jump:e}")]
    InconsistentStart {
        /// Index of the state that would jump most, in units of its tolerance.
        state: usize,
        /// Size of the jump of that state at the start.
        jump: f64,
    },
    /// The problem needs more memory than one run may take.
    #[error("{what} for {unknowns} unknowns do not fit into the memory that one run may take (2 GiB for each)")]
    TooLarge {
        /// Name of the data of the run that do not fit into memory.
        what: &'static str,
        /// Number of coupled unknowns, which determines the size of these data.
        unknowns: usize,
    },
    /// The caller asked to stop the run in the middle of a step.
    #[error("stopped at t = {t:?}")]
    Interrupted {
        /// Time that the run had reached when it was interrupted.
        t: f64,
    },
    /// The solver found no solution of the VI at the start or behind a breakpoint; one may exist.
    #[error(
        "no solution of the variational inequality was found at t = {t:?}, nor a proof that there is \
         none; if it is nonlinear in its variables, try another form, and if several conditions are active at once, \
         other initial values"
    )]
    NoStart {
        /// Time at which no solution of the variational inequality was found.
        t: f64,
    },
    /// The inequality of one variable is violated for all values of the variables: the variational inequality, as
    /// posed or as linearised by Newton's method, has no solution.
    #[error(
        "the variational inequality has no solution at t = {t:?}: the inequality of variable {variable} (counted from \
         0), {}, is violated for all values of the variables", if *.linear { "as posed" } else { "linearised" }
    )]
    NoSolution {
        /// Time at which the variational inequality has no solution.
        t: f64,
        /// Index of the variable whose inequality is violated.
        variable: usize,
        /// Whether the problem is linear, so that its variational inequality is proven to have no solution.
        linear: bool,
    },
}

/// Describes the lower limit `least` on the step size for the message of an error; empty if there is none.
fn limit(least: f64) -> String {
    if least > 0.0 { format!(", below `min_step` = {least:e}, and a smaller one is needed") } else { String::new() }
}

impl StepError {
    /// Stable identifier of the error for programs.
    pub fn code(&self) -> &'static str {
        match self {
            Self::NotFinite { .. } => "not_finite",
            Self::StepTooSmall { .. } => "step_too_small",
            Self::Chattering { .. } => "chattering",
            Self::DenseBreaks { .. } => "dense_breaks",
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

/// Why a step is rejected and repeated with a smaller size.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum RejectionCause {
    /// The error estimate of the step is above the tolerance.
    Error,
    /// The increments of Newton's method on the stages grow from one iteration to the next.
    Diverged,
    /// Newton's method would need more iterations than a smaller step is worth.
    Slow,
    /// A matrix of the stage equations is singular.
    Singular,
    /// A rate, a `G` or a bound at a stage is not finite.
    NotFinite,
    /// The variational inequality of the stages has no solution, or none was found.
    Unsolved,
}

impl RejectionCause {
    /// Every cause of a rejection, in the order of declaration.
    pub const ALL: [Self; 6] =
        [Self::Error, Self::Diverged, Self::Slow, Self::Singular, Self::NotFinite, Self::Unsolved];

    /// Stable identifier of the cause of a rejection for programs.
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
            Self::NotFinite => "a stage has a value that is not finite (a blow-up, or the edge of a function's domain)",
            Self::Unsolved => {
                "the variational inequality of the stages has no solution, or none was found (G must increase with \
                 z, with D or CB positive definite: check its sign)"
            }
        })
    }
}
