//! What a type of problem says of itself: names and start, sizes, the theory, the methods that fit it, what a study of it
//! varies, its run.
//!
//! A type is what the user writes (a file of this crate), its equations (in [`models`]), its answer (in [`solution`]), and
//! one implementation of [`Model`], which joins the three. Nobody else asks which type a problem has.

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

/// A problem with its names and its start, to be solved any number of times.
pub trait Model: Any + Debug + Send + Sync {
    /// The names of the states; with memory, which has none, of the variables.
    fn state_names(&self) -> Vec<String>;

    /// The names of all outputs, those of the states first.
    fn output_names(&self) -> Vec<String>;

    /// The outputs that are kept where nothing is asked for, as places in their names.
    fn default_outputs(&self) -> Range<usize> {
        0..self.output_names().len()
    }

    /// The states at the start; with memory zeros, as nothing is given there.
    fn initial(&self) -> Vec<f64>;

    /// What the user should know before it is solved.
    fn warnings(&self) -> &[Warning];

    /// How large it is.
    fn sizes(&self) -> Sizes;

    /// The set that variables are in, where the user gives one.
    fn set(&self) -> Option<&ConvexSet> {
        None
    }

    /// The differential variational inequality, if it is posed as one.
    fn dvi(&self) -> Option<&DviModel> {
        None
    }

    /// The mechanical system in generalised coordinates, if it is posed as one.
    fn mechanical(&self) -> Option<&MechanicalModel> {
        None
    }

    /// The parameters that are inputs of its programs. `dvi`, `lcs`, `filippov`, `circuit` and `mechanical` have them;
    /// `rigid_bodies`, `elastic`, `obstacle` and `convolution` keep theirs as constants, and are lowered anew for others.
    fn parameters(&self) -> Option<&Parameters> {
        None
    }

    /// The same problem with these values of its parameters, in their order.
    ///
    /// # Errors
    /// Values that cannot be bound; all of them, where parameters are constants.
    fn with_parameters(&self, _values: &[f64]) -> Result<Arc<dyn Model>, Unbindable> {
        Err(Unbindable::Folded)
    }

    /// What is wrong with its start at time `t`, once other parameters are bound. It is reported at the problem.
    fn check_start(&self, _t: f64, _problem: &Pointer<'_>, _errors: &mut Errors) {}

    /// What the theory says of it at time `t` and its initial states.
    fn analyse(&self, t: f64) -> Analysis;

    /// Whether the analysis tells if a solution is unique.
    fn has_theory_of_uniqueness(&self) -> bool {
        false
    }

    /// Refuses what no method here solves as it is posed, and methods that are not for it.
    fn check_method(&self, asked: &Request<'_>, errors: &mut Errors);

    /// Why nothing may end a run of it before its end; `None` where it may.
    fn no_stop(&self) -> Option<&'static str> {
        None
    }

    /// Why the error at the end is not estimated; `None` where it is.
    fn no_global_error(&self) -> Option<&'static str>;

    /// What its bodies come to where they touch at the start, counted until it is far beyond so many bytes.
    fn load(&self, _most: usize, _control: &Control) -> Load {
        Load::default()
    }

    /// The numbers in its matrices and in what a run remembers, as far as they are known before it.
    fn numbers(&self, specification: &Specification) -> usize;

    /// What a run would build.
    fn describe(&self, specification: &Specification) -> Diagnostics;

    /// Solves it. Stops at the next step when `control` says so.
    fn run(&self, specification: &Specification, plan: &Plan, control: &Control) -> Solution;

    /// How it is solved with this choice of stages, in a word or two.
    fn method_name(&self, stages: Stages) -> String;

    /// What a study of it may vary.
    fn varied(&self) -> Varied;
}

/// How large a problem is.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Sizes {
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
}

/// What makes one run of a study more accurate than another.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum By {
    /// Its relative tolerance.
    Tolerance,
    /// Its fixed step.
    Step,
}

/// What a study of a type of problem may vary.
#[derive(Clone, Copy, Debug)]
pub struct Varied {
    /// Whether its runs can be asked for by tolerance.
    pub tolerance: bool,
    /// Whether Radau IIA solves it, with stages to choose.
    pub stages: WithStages,
    /// Whether a run to a tolerance is the reference of runs with fixed steps; else it is one with a finer step.
    pub reference: By,
    /// The families of runs of the report.
    pub ladders: &'static [Ladder],
    /// How runs are chosen whose balance of energy is compared.
    pub balances: &'static [By],
}

/// Where stages are chosen.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum WithStages {
    /// In every run.
    Always,
    /// Where impacts are located.
    Located,
    /// Nowhere.
    Never,
}

/// A family of runs that become more accurate.
#[derive(Clone, Copy, Debug)]
pub struct Ladder {
    /// What is varied.
    pub by: By,
    /// What is added to the name of the method.
    pub name: &'static str,
    /// The stages to compare; none is those of the method.
    pub stages: &'static [Stages],
}

/// What was asked of a problem.
#[derive(Clone, Copy, Debug)]
pub struct Request<'a> {
    pub analysis: &'a Analysis,
    pub method: &'a Method,
    pub time: Time,
}

/// What a ladder of fixed steps adds to the name of a method.
const FIXED: &str = " at fixed steps";

/// Refuses a key of the method.
fn refuse(key: &str, detail: &str, expected: &str, errors: &mut Errors) {
    let error = SpecificationError::new(Pointer::Root.key("method").key(key).to_string(), "conflict", detail);
    errors.push(error.expected(expected));
}

/// Refuses what only mechanical systems have.
fn refuse_impacts(method: &Method, errors: &mut Errors) {
    for (key, given) in [("impacts", method.impacts.is_some()), ("impact_law", method.impact_law.is_some())] {
        if given {
            refuse(key, "only mechanical systems have impacts", "to be left out", errors);
        }
    }
}

/// The name of Radau IIA with these stages, or of what chooses them.
fn name_of_stages(stages: Stages, chosen: &str) -> String {
    match stages {
        Stages::Auto => chosen.to_owned(),
        Stages::Fixed(1) => "1 stage".to_owned(),
        Stages::Fixed(stages) => format!("{stages} stages"),
    }
}
