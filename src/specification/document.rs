//! The document as a whole: what a user posts, before it is checked.

use super::circuit::CircuitProblem;
use super::convolution::ConvolutionProblem;
use super::dvi::DviProblem;
use super::elastic::ElasticProblem;
use super::filippov::FilippovProblem;
use super::fit::FitRequest;
use super::lcs::LcsProblem;
use super::mechanical::MechanicalProblem;
use super::method::Method;
use super::observables::Stop;
use super::obstacle::ObstacleProblem;
use super::output::Output;
use super::rigid_bodies::RigidBodiesProblem;
use super::search::{PeriodicRequest, SteadyStateRequest};
use super::sensitivities::SensitivitiesRequest;
use super::static_vi::ViProblem;
use super::study::StudyRequest;
use super::sweep::SweepRequest;
use super::view::View;
use super::written::Written;
use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

/// A problem, the time to solve it over, and how. Only `problem` and `time.end` are required; `periodic`, `steady_state`
/// and a problem of type `vi` need no time.
#[derive(Debug, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
#[schema(as = Specification)]
pub struct Document {
    /// The address of the schema of specifications, for editors that complete and explain them. Nothing else looks at it.
    #[serde(rename = "$schema", default)]
    pub schema: Option<String>,
    /// The version of the language of specifications: 1, as where it is absent.
    #[schema(minimum = 1, maximum = 1)]
    pub version: Option<u64>,
    /// What is to be solved.
    pub problem: Problem,
    /// The time horizon. Required, but beside `periodic` and `steady_state`, and for `vi`, which has none.
    pub time: Option<Time>,
    /// How it is solved.
    #[serde(default)]
    pub method: Method,
    /// What is kept of the trajectory.
    #[serde(default)]
    pub output: Output,
    /// When to stop early.
    #[serde(default)]
    pub limits: Limits,
    /// What ends the run before `time.end`, or is only told as an event.
    #[serde(default)]
    pub stop: Vec<Stop>,
    /// Derivatives by parameters and initial values.
    pub sensitivities: Option<SensitivitiesRequest>,
    /// A periodic orbit, in place of a run over `time`.
    pub periodic: Option<PeriodicRequest>,
    /// A state of rest, in place of a run over `time`.
    pub steady_state: Option<SteadyStateRequest>,
    /// The same problem for many values of some of its numbers.
    pub sweep: Option<SweepRequest>,
    /// Parameters fitted to data, with runs over `time`.
    pub fit: Option<FitRequest>,
    /// A study of error against run time.
    pub study: Option<StudyRequest>,
    /// How a system in a plane is drawn on the page.
    pub view: Option<View>,
    /// Free text, at most 200 characters.
    #[schema(max_length = 200)]
    pub label: Option<String>,
}

/// Exactly one type of problem. Each is a way to write `M x' = f(t,x) + B(t,x) z`, `z in K`,
/// `<G(t,x,z), z~ - z> >= 0` for all `z~ in K`.
///
/// Vectors: a member `"x[1..n]": ...` of parameters, definitions, integrals, states, variables or coordinates stands for one
/// member for each index, `x[1]` to `x[n]`, in which `i` is the index; `"x[k in 0..n+1]"` names it otherwise, and
/// `"x[1..3, 1..4]"` has two, `i` and `j`. Sizes are whole numbers, and parameters that are whole numbers. A list in the place
/// of an expression has one value for each element. `"x[0]"` and `"x[n+1]"` may be declared beside them, as ends of a chain
/// under `definitions`. In lists of names, as of a set or of `output.fields`, `"x[1..n]"` stands for all elements; an entry of
/// a list whose `name` or `label` has a range, and a `box` whose `of` is one name with a range, for one entry an element.
#[derive(Debug, Deserialize, ToSchema)]
#[serde(rename_all = "snake_case")]
pub enum Problem {
    /// The general form, in expressions.
    Dvi(DviProblem),
    /// A linear complementarity system, in matrices.
    Lcs(Box<LcsProblem>),
    /// A mechanical system with impacts and friction, in generalised coordinates.
    Mechanical(Box<MechanicalProblem>),
    /// Rigid bodies in space.
    RigidBodies(Box<RigidBodiesProblem>),
    /// A Filippov system: rates that jump between regions, and slide on their borders.
    Filippov(FilippovProblem),
    /// An electrical circuit with ideal diodes and switches, in components or as a netlist.
    Circuit(CircuitProblem),
    /// A parabolic equation above an obstacle, on an interval, a rectangle or a box.
    Obstacle(Box<ObstacleProblem>),
    /// A problem with memory: an inequality for the convolution of the variables with a kernel.
    Convolution(ConvolutionProblem),
    /// An elastic or viscoelastic body in dynamic contact with obstacles.
    Elastic(Box<ElasticProblem>),
    /// A static variational inequality, without states and time.
    Vi(ViProblem),
}

impl Problem {
    /// The key of its type.
    pub fn name(&self) -> &'static str {
        self.written().key()
    }

    pub(super) fn written(&self) -> &dyn Written {
        match self {
            Self::Dvi(problem) => problem,
            Self::Lcs(problem) => &**problem,
            Self::Mechanical(problem) => &**problem,
            Self::RigidBodies(problem) => &**problem,
            Self::Filippov(problem) => problem,
            Self::Obstacle(problem) => &**problem,
            Self::Circuit(problem) => problem,
            Self::Convolution(problem) => problem,
            Self::Elastic(problem) => &**problem,
            Self::Vi(problem) => problem,
        }
    }
}

/// The time horizon, in seconds unless the model says otherwise.
#[derive(Clone, Copy, Debug, Deserialize, Serialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct Time {
    /// Where the initial values hold.
    #[serde(default)]
    #[schema(default = 0.0)]
    pub start: f64,
    /// Where the solve ends; after `start`. It may be written as `until`, for programs that reserve the word `end`.
    pub end: f64,
}

/// When to stop early, with the trajectory so far.
#[derive(Clone, Copy, Debug, Default, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct Limits {
    /// Wall-clock time, in seconds. The server has a limit of its own, and the lesser counts.
    #[schema(exclusive_minimum = 0.0)]
    pub wall_seconds: Option<f64>,
    /// Accepted and rejected steps.
    #[schema(minimum = 1, maximum = 10_000_000)]
    pub steps: Option<u64>,
}
