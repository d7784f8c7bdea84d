//! The interface of problem types: names and initial state, sizes, structural analysis, suitable methods, study
//! options, and the run.
//!
//! A problem type consists of the user's notation (a file of this crate), its equations (in [`models`]), its answer (in
//! [`solution`]), and one implementation of [`Model`], which joins the three. No other code distinguishes problem
//! types.

mod convolution;
mod dvi;
mod mechanical;
mod obstacle;
mod rigid_bodies;
mod static_vi;

use super::checked::Specification;
use super::document::Time;
use super::error::{Errors, SpecificationError};
use super::method::Method;
use super::pointer::Pointer;
use super::stages::Stages;
use analysis::Analysis;
use models::rigid_bodies::Load;
use models::{DviModel, MechanicalModel, Parameters, Unbindable};
use problem::{Control, ConvexSet, Warning};
use solution::{Diagnostics, Plan, Solution};
use std::any::Any;
use std::fmt::Debug;
use std::ops::Range;
use std::sync::Arc;

/// A problem with its names and initial state, to be solved any number of times.
pub trait Model: Any + Debug + Send + Sync {
    /// Names of the states; for problems with memory, which have no states, of the variables.
    fn state_names(&self) -> Vec<String>;

    /// Names of all outputs of the problem, states first.
    fn output_names(&self) -> Vec<String>;

    /// Range of the outputs that are kept in the trajectory by default.
    fn default_outputs(&self) -> Range<usize> {
        0..self.output_names().len()
    }

    /// Initial values of the states; zeros for problems with memory.
    fn initial(&self) -> Vec<f64>;

    /// Warnings about the problem to report before the solve.
    fn warnings(&self) -> &[Warning];

    /// Numbers of states and variables of the problem, and structure of its Jacobian.
    fn sizes(&self) -> Sizes;

    /// The convex set `K` of the variables of the variational inequality, if the user gives one.
    fn set(&self) -> Option<&ConvexSet> {
        None
    }

    /// The differential variational inequality, if the problem is formulated as one.
    fn dvi(&self) -> Option<&DviModel> {
        None
    }

    /// The mechanical system in generalised coordinates, if the problem is formulated as one.
    fn mechanical(&self) -> Option<&MechanicalModel> {
        None
    }

    /// Parameters that can be bound to new values. `dvi`, `lcs`, `filippov`, `circuit` and `mechanical` have them;
    /// `rigid_bodies`, `elastic`, `obstacle` and `convolution` fold parameters into constants, and are lowered anew
    /// for new values.
    fn parameters(&self) -> Option<&Parameters> {
        None
    }

    /// Returns the model with new values of all its parameters, in their order.
    ///
    /// # Errors
    /// Values that cannot be bound; any values if parameters are folded into constants.
    fn with_parameters(&self, _values: &[f64]) -> Result<Arc<dyn Model>, Unbindable> {
        Err(Unbindable::Folded)
    }

    /// Checks the initial values at time `t` after new parameter values have been bound; reports errors at the JSON
    /// pointer `problem`.
    fn check_start(&self, _t: f64, _problem: &Pointer<'_>, _errors: &mut Errors) {}

    /// Structural analysis (index, uniqueness) at time `t` and the initial states.
    fn analyse(&self, t: f64) -> Analysis;

    /// Whether the structural analysis covers uniqueness of solutions.
    fn has_theory_of_uniqueness(&self) -> bool {
        false
    }

    /// Refuses problems that no method solves as posed, and methods unsuitable for the problem type.
    fn check_method(&self, asked: &Request<'_>, errors: &mut Errors);

    /// The reason why user-defined events may not end a run early; `None` if they may.
    fn no_stop(&self) -> Option<&'static str> {
        None
    }

    /// The reason why the global error of a run cannot be estimated; `None` if it can.
    fn no_global_error(&self) -> Option<&'static str>;

    /// Estimates the memory for the contacts of rigid bodies at the start; contacts are counted until the estimate is
    /// far beyond `most` bytes.
    fn load(&self, _most: usize, _control: &Control) -> Load {
        Load::default()
    }

    /// Number of runs solved side by side: two if a second run with longer steps estimates the error of the first.
    fn runs(&self, _specification: &Specification) -> usize {
        1
    }

    /// Number of `f64` values in the matrices and the stored history of a run, as far as it is known in advance.
    fn numbers(&self, specification: &Specification) -> usize;

    /// Describes the solvers and matrix structures that a run would use.
    fn describe(&self, specification: &Specification) -> Diagnostics;

    /// Solves the problem; stops at the next step if `control` asks for it.
    fn run(&self, specification: &Specification, plan: &Plan, control: &Control) -> Solution;

    /// Short name of the method with the given choice of Radau IIA stages, for a table.
    fn method_name(&self, stages: Stages) -> String;

    /// Returns the quantities (tolerance, step size, stages) that a work-precision study of the problem may vary.
    fn varied(&self) -> Varied;
}

/// Numbers of states and variables of a problem, and structure of its Jacobian.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Sizes {
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
}

/// The accuracy setting that a work-precision study refines from run to run.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum By {
    /// Refinement of the relative tolerance from run to run.
    Tolerance,
    /// Refinement of the fixed step size from run to run.
    Step,
}

/// The quantities that a work-precision study of a problem type may vary.
#[derive(Clone, Copy, Debug)]
pub struct Varied {
    /// Whether the steps of runs can be controlled by a tolerance.
    pub tolerance: bool,
    /// The runs in which the number of Radau IIA stages can be chosen.
    pub stages: WithStages,
    /// Accuracy setting of the reference solution for runs with fixed steps: a tight tolerance, or a smaller step
    /// size.
    pub reference: By,
    /// The families of runs of the problem type in the work-precision report.
    pub ladders: &'static [Ladder],
    /// Accuracy settings of the runs whose energy balances are compared.
    pub balances: &'static [By],
}

/// The runs of a problem type in which the number of Radau IIA stages can be chosen.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum WithStages {
    /// The number of Radau IIA stages can be chosen in every run.
    Always,
    /// The number of Radau IIA stages can be chosen in runs that locate impacts.
    Located,
    /// The number of Radau IIA stages can be chosen in no run.
    Never,
}

/// A family of increasingly accurate runs of a work-precision study.
#[derive(Clone, Copy, Debug)]
pub struct Ladder {
    /// The accuracy setting that is refined from run to run.
    pub by: By,
    /// Suffix that is appended to the name of the method to name the family of runs.
    pub name: &'static str,
    /// Numbers of Radau IIA stages to compare; if empty, the stages of the specified method.
    pub stages: &'static [Stages],
}

/// Analysis, method and time horizon of a requested solve, for the checks of the method.
#[derive(Clone, Copy, Debug)]
pub struct Request<'a> {
    pub analysis: &'a Analysis,
    pub method: &'a Method,
    pub time: Time,
}

/// Suffix of a method's name for a family of runs with fixed steps.
const FIXED: &str = " at fixed steps";

/// Reports a conflict at a key of `method` in the specification.
fn refuse(key: &str, detail: &str, expected: &str, errors: &mut Errors) {
    let error = SpecificationError::new(Pointer::Root.key("method").key(key).to_string(), "conflict", detail);
    errors.push(error.expected(expected));
}

/// Refuses the keys of `method` for impacts, in a problem other than a mechanical system.
fn refuse_impacts(method: &Method, errors: &mut Errors) {
    for (key, given) in [("impacts", method.impacts.is_some()), ("impact_law", method.impact_law.is_some())] {
        if given {
            refuse(key, "only mechanical systems have impacts", "to be left out", errors);
        }
    }
}

/// Returns the name of a number of Radau IIA stages; `chosen` names an automatic choice.
fn name_of_stages(stages: Stages, chosen: &str) -> String {
    match stages {
        Stages::Auto => chosen.to_owned(),
        Stages::Fixed(1) => "1 stage".to_owned(),
        Stages::Fixed(stages) => format!("{stages} stages"),
    }
}
