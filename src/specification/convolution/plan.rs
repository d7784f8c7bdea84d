//! Settings of a run from a checked problem with memory. The whole history is kept, so memory limits the number of
//! steps.

use crate::checked::Specification;
use crate::document::Time;
use crate::error::{Errors, SpecificationError};
use crate::method::Method;
use crate::plan::{VI_TOLERANCE, solver};
use crate::stages::Stages;
use convolution::{SegmentSettings, Segments, Settings};
use models::ConvolutionModel;
use solution::{ConvolutionPlan, Mesh};

/// Largest number of values that a run of a problem with memory may store: 512 MiB.
const MOST_NUMBERS: usize = 1 << 26;
/// Largest number of unknowns (stages times variables) of a step of a problem with memory, whose matrix is dense.
const MOST_UNKNOWNS: usize = 2_000;
/// Default number of steps of the first run of a problem with memory, and of the last run of a sequence of halved step
/// sizes.
const FIRST_MESH: usize = 64;
const LAST_MESH: usize = 1 << 17;
/// Default number of polynomials per element of the adaptive time mesh of a problem with memory.
const POLYNOMIALS: usize = 5;

/// Returns the settings of a run of a problem with memory.
pub fn plan_of(model: &ConvolutionModel, specification: &Specification) -> ConvolutionPlan {
    let (method, time) = (specification.method(), specification.time());
    let within = |step: Option<f64>| step.map(|step| steps_of(time, step));
    let most = most_steps(model, method.stages);
    let mesh = match within(method.step) {
        Some(steps) => Mesh::Fixed(steps),
        None => {
            let first = within(method.first_step.or(method.max_step)).unwrap_or(FIRST_MESH);
            let last = within(method.min_step).unwrap_or(LAST_MESH).min(most);
            let (rtol, atol) = (method.rtol, specification.absolute_tolerances().to_vec());
            Mesh::Halved { first: first.min(last), most: last, rtol, atol }
        }
    };
    let settings = Settings {
        stages: stages(method.stages),
        vi_solver: solver(method.vi_solver),
        vi_tolerance: method.vi_tolerance.unwrap_or(VI_TOLERANCE),
    };
    let segments = segments_of(model, specification);
    ConvolutionPlan { settings, mesh, segments, most }
}

/// Returns settings for integration in segments between located switches; `None` if the user gives a step or a
/// minimum step, if the set does not suit, or if the variables are unbounded at the start.
fn segments_of(model: &ConvolutionModel, specification: &Specification) -> Option<SegmentSettings> {
    let (method, time) = (specification.method(), specification.time());
    let stages = match method.stages {
        Stages::Fixed(s) => s as usize,
        Stages::Auto => POLYNOMIALS,
    };
    let is_fit = method.step.is_none()
        && method.min_step.is_none()
        && Segments::suit(model.forcing.structure(), stages)
        && model.forcing.warnings.iter().all(|warning| warning.code != "impulse_at_start");
    is_fit.then(|| SegmentSettings {
        stages,
        rtol: method.rtol,
        atol: specification.absolute_tolerances().to_vec(),
        tolerance: 1.0,
        first: method.first_step.unwrap_or((time.end - time.start) / FIRST_MESH as f64),
        longest: method.max_step.unwrap_or(f64::INFINITY),
        before: Vec::new(),
    })
}

/// Number of values that the first run of a problem with memory stores: those of its whole history.
pub fn numbers(model: &ConvolutionModel, specification: &Specification) -> usize {
    let steps = match plan_of(model, specification).mesh {
        Mesh::Fixed(steps) | Mesh::Halved { first: steps, .. } => steps,
    };
    let adapted = if specification.method().step.is_none() { OF_MESHES * model.variables() } else { 0 };
    steps.saturating_mul(numbers_a_step(model, specification.method().stages)).saturating_add(adapted)
}

/// Measured number of values that an adaptive run stores per variable, for its meshes and singular functions.
const OF_MESHES: usize = 4000;

/// Refuses a run of a problem with memory whose history or whose steps would be too large to store.
pub fn check(model: &ConvolutionModel, method: &Method, time: Time, errors: &mut Errors) {
    let most = most_steps(model, method.stages);
    if most == 0 {
        let detail = format!("{} variables make variational inequalities too large to be solved", model.variables());
        errors.push(SpecificationError::new("/problem/convolution/variables", "too_many_unknowns", detail));
    } else if let Some(steps) = method.step.map(|step| steps_of(time, step)).filter(|steps| *steps > most) {
        let detail = format!("{steps} steps, all kept as history, take more memory than a run may have");
        let error = SpecificationError::new("/method/step", "too_many_steps", detail);
        errors.push(error.expected(format!("at most {most} steps")));
    }
}

fn stages(stages: Stages) -> usize {
    match stages {
        Stages::Fixed(s) => s as usize,
        Stages::Auto => 3,
    }
}

/// Largest number of steps of a problem with memory whose history may be stored; zero if even one step is too large.
fn most_steps(model: &ConvolutionModel, chosen: Stages) -> usize {
    if stages(chosen) * model.variables() > MOST_UNKNOWNS {
        return 0;
    }
    MOST_NUMBERS / numbers_a_step(model, chosen)
}

/// Number of values stored per step of a problem with memory: two per stage and variable, and the weights and their
/// transforms per kernel term.
fn numbers_a_step(model: &ConvolutionModel, chosen: Stages) -> usize {
    let (s, m) = (stages(chosen), model.variables());
    (2 * s * m + 3 * s * s * model.kernel.terms.len()).max(1)
}

/// Number of equal steps, at most `step` long, that cover the time horizon.
fn steps_of(time: Time, step: f64) -> usize {
    ((time.end - time.start) / step * (1.0 - 4.0 * f64::EPSILON)).ceil().max(1.0) as usize
}
