//! The document of a specification as a user posts it, before it is checked.

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

/// A problem, the time to solve it over, and the method. Only `problem` and `time.end` are required; `periodic`,
/// `steady_state` and a problem of type `vi` need no time.
#[derive(Debug, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
#[schema(as = Specification)]
pub struct Document {
    /// The address of the JSON Schema of specifications, for editors with completion. The solver ignores it.
    #[serde(rename = "$schema", default)]
    pub schema: Option<String>,
    /// The version of the specification language: 1, which is also the default.
    #[schema(minimum = 1, maximum = 1)]
    pub version: Option<u64>,
    /// The problem to solve.
    pub problem: Problem,
    /// The time horizon. Required, except beside `periodic` and `steady_state`, and for `vi`, which has no time.
    pub time: Option<Time>,
    /// The numerical method and its settings.
    #[serde(default)]
    pub method: Method,
    /// The part of the trajectory to keep.
    #[serde(default)]
    pub output: Output,
    /// Limits of wall-clock time and steps, at which to stop early.
    #[serde(default)]
    pub limits: Limits,
    /// User-defined events, which end the run before `time.end` or are only recorded.
    #[serde(default)]
    pub stop: Vec<Stop>,
    /// Derivatives with respect to parameters and initial values.
    pub sensitivities: Option<SensitivitiesRequest>,
    /// A periodic orbit, computed in place of a run over `time`.
    pub periodic: Option<PeriodicRequest>,
    /// A steady state, computed in place of a run over `time`.
    pub steady_state: Option<SteadyStateRequest>,
    /// A parameter sweep: the problem solved for many values of some of its numbers.
    pub sweep: Option<SweepRequest>,
    /// Parameters to fit to data, with runs over `time`.
    pub fit: Option<FitRequest>,
    /// A study of error against run time.
    pub study: Option<StudyRequest>,
    /// The drawing of a plane system on the page.
    pub view: Option<View>,
    /// A label of the solve: free text of at most 200 characters.
    #[schema(max_length = 200)]
    pub label: Option<String>,
}

/// Exactly one problem type. Each is a way to write `M x' = f(t,x) + B(t,x) z`, `z in K`, `<G(t,x,z), z~ - z> >= 0` for
/// all `z~ in K`.
///
/// Vectors: a member `"x[1..n]": ...` of parameters, definitions, integrals, states, variables or coordinates declares
/// one member per index, `x[1]` to `x[n]`, with `i` as the index in its expressions. `"x[k in 0..n+1]"` names the index
/// `k`, and `"x[1..3, 1..4]"` has two indices, `i` and `j`. Sizes are whole numbers, or parameters that are whole
/// numbers. A list in the place of an expression gives one value for each element. `"x[0]"` and `"x[n+1]"` may be
/// declared beside them under `definitions`, as the ends of a chain, `"x[0, 1..n]"` as an edge of a grid. In lists of
/// names, as of a set or of `output.fields`, `"x[1..n]"` stands for all elements; a list entry whose `name` or `label`
/// has a range, or a `box` whose `of` is a single name with a range, stands for one entry per element.
#[derive(Debug, Deserialize, ToSchema)]
#[serde(rename_all = "snake_case")]
pub enum Problem {
    /// A differential variational inequality in its general form, given by expressions.
    Dvi(DviProblem),
    /// A linear complementarity system, given by matrices.
    Lcs(Box<LcsProblem>),
    /// A mechanical system with impacts and friction, in generalised coordinates.
    Mechanical(Box<MechanicalProblem>),
    /// Rigid bodies in space, with contacts, friction and joints.
    RigidBodies(Box<RigidBodiesProblem>),
    /// A Filippov system: rates that jump at the borders of regions, with sliding along them.
    Filippov(FilippovProblem),
    /// An electrical circuit with ideal diodes and switches, as components or as a netlist.
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
    /// Returns the key of the problem type in the document, such as `dvi`.
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
    /// The time of the initial values.
    #[serde(default)]
    #[schema(default = 0.0)]
    pub start: f64,
    /// The end of the solve, after `start`. It may be written as `until`, for programs in which `end` is a reserved
    /// word.
    pub end: f64,
}

/// Limits at which to stop early, with the trajectory computed so far.
#[derive(Clone, Copy, Debug, Default, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct Limits {
    /// Wall-clock time at which to stop, in seconds. If the server has a limit as well, the smaller one applies.
    #[schema(exclusive_minimum = 0.0)]
    pub wall_seconds: Option<f64>,
    /// Number of steps at which to stop, accepted and rejected together.
    #[schema(minimum = 1, maximum = 10_000_000)]
    pub steps: Option<u64>,
}
