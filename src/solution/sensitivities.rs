//! Derivatives of states, definitions and integrals with respect to parameters and initial values. Forward mode
//! propagates columns `dx/dm` along the run ([`radau::Tangents`], [`contact::tangents::Tangents`]), and compares them
//! with finite differences of runs in one direction, at the end and at earlier times. Adjoint mode computes the
//! gradient of one number with respect to many parameters ([`radau::Adjoint`]), and compares it with the same kind of
//! difference.

mod adjoint;
mod motion;
mod observed;

pub(super) use adjoint::Resolution;
pub use adjoint::{AdjointWork, Gradient, Objective};
pub(super) use motion::{FollowedMotion, directions as directions_of_motion};

use super::contact::{ContactPlan, integrate_contact_once};
use super::integrate::integrate_once;
use super::run::Ended;
use super::{CheckCode, Failure, Plan, Status};
use adjoint::SweptBack;
use analysis::Analysis;
use hybrid::OneStep;
use models::{DviModel, MechanicalModel};
use nalgebra::DMatrix;
use numerics::CENTRAL_DIFFERENCE;
use observed::ObservedSlopes;
use problem::Control;
use radau::{Adjoint, Directions, NoDerivative, Radau, Settings, Shifted, StepError, Tangents};
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;
use std::sync::Arc;
use utoipa::ToSchema;

/// Power of the relative tolerance that gives the relative change of parameters for finite differences of runs. Runs
/// are as accurate as their tolerances; a change by the square root leaves half of their digits. A larger change may
/// shift the phase of an oscillation by a whole turn, so that two differences agree without approximating a
/// derivative.
pub(super) const POWER: f64 = 0.5;
/// Largest relative change of a parameter for finite differences of runs.
pub(super) const MOST_MOVED: f64 = 1e-2;
/// Permitted distance of a derivative from a finite difference of runs, in units of the accuracy of the runs, beside
/// the difference of two finite differences.
pub(super) const SLACK: f64 = 20.0;
/// Factor of the tolerances for the runs whose finite differences are compared with derivatives, and the least relative
/// tolerance of these runs, below which rounding errors dominate.
const TIGHTER: f64 = 1e-2;
const TIGHTEST: f64 = 1e-11;
/// Permitted error of a derivative, in units of the relative tolerance times its largest value: the errors of its
/// steps add up as those of the states do.
const OWN: f64 = 100.0;
/// Largest number of output times before the end at which derivatives are compared: an error that lasts for a
/// hundredth of the run is then detected.
const MOST_COMPARED: usize = 100;
/// The size of a parameter whose value is zero, by which its change in a finite difference is scaled.
const MOVED_ALONE: f64 = 1.0;
/// The fractional part of the golden ratio, whose multiples modulo 1 are distinct and evenly distributed.
pub(super) const GOLDEN: f64 = 0.618_033_988_749_894_8;

/// The requested sensitivities: the outputs to differentiate, and the quantities with respect to which they are
/// differentiated.
#[derive(Clone, Debug)]
pub struct Sensitivities {
    /// The parameters and initial values with respect to which the outputs are differentiated.
    pub by: Vec<By>,
    /// The names of the parameters and initial values in `by`.
    pub to: Vec<String>,
    /// The outputs to differentiate: states by their indices, and definitions and integrals by their indices after
    /// all outputs of the problem.
    pub of: Vec<usize>,
    /// The names of the columns of derivatives, in which all derivatives of one output precede those of the next; empty
    /// in adjoint mode.
    pub names: Vec<String>,
    /// The quantity whose gradient is requested, in adjoint mode; it is then the only entry of `of`, with an index
    /// after all outputs of the problem.
    pub objective: Option<Arc<Objective>>,
}

/// A quantity with respect to which a run is differentiated.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum By {
    /// A parameter, given by its index.
    Parameter(usize),
    /// The initial value of a state, by the index of the state.
    Initial(usize),
}

/// Comparison of derivatives with the finite difference of two runs.
#[derive(Clone, Debug, PartialEq, Deserialize, Serialize, ToSchema)]
pub struct Checked {
    /// The state whose derivative differs most from its finite difference.
    pub of: String,
    /// The changes by which the parameters and initial values, in the order of `to`, are moved together in the one
    /// run and back in the other.
    pub direction: Vec<f64>,
    /// The derivative in that direction, at the output time at which it differs most from the finite difference.
    pub derivative: f64,
    /// Half the difference of the two runs that are moved by `direction` forwards and backwards.
    pub finite_difference: f64,
    /// The uncertainty of the finite difference: its distance from a difference with twice the change, and the errors
    /// of the runs.
    pub uncertainty: f64,
}

/// The derivatives of the time of an event with respect to parameters and initial values.
#[derive(Clone, Debug, PartialEq, Deserialize, Serialize, ToSchema)]
pub struct EventSlope {
    /// The time of the event.
    pub t: f64,
    /// The kind of the event.
    pub kind: SlopedEvent,
    /// The name of the contact.
    pub of: String,
    /// The derivatives of the time `t` of the event, by the names of the parameters and initial values.
    pub slopes: BTreeMap<String, f64>,
    /// The rate at which the function that decides the event (a gap, a force, a slip) crosses zero, in absolute
    /// value: if it is small, the event is nearly grazing, and the derivatives are large.
    pub transversality: f64,
}

/// The kind of an event whose time is differentiated.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Deserialize, Serialize, ToSchema)]
#[serde(rename_all = "snake_case")]
pub enum SlopedEvent {
    /// A contact closed with an impact.
    Impact,
    /// A contact opened that had been closed for a while.
    LiftOff,
    /// A contact ceased to slip.
    Stick,
    /// A contact began to slip.
    Slip,
    /// The limit of infinitely many impacts in a finite time.
    Accumulation,
}

/// Derivatives of the states that are propagated along a run of a differential variational inequality.
pub(super) struct Followed {
    tangents: Tangents,
    observed: Option<ObservedSlopes>,
    states: usize,
    /// The number of outputs of the problem; user's definitions and integrals follow them.
    outputs: usize,
    of: Vec<usize>,
    by: usize,
    /// The stored steps and the objective (the quantity whose gradient is requested), in adjoint mode; derivatives are
    /// then propagated in a single direction, in which all parameters and initial values move together.
    swept: Option<(Adjoint, SweptBack)>,
}

impl Followed {
    /// Prepares the propagation of derivatives of the states at the start of a run.
    pub fn new(model: &DviModel, plan: &Plan, of: &Sensitivities, tolerances: (f64, &[f64])) -> Result<Self, String> {
        let (outputs, states) = (plan.names.len(), model.structure().states);
        if let Some(objective) = &of.objective {
            let values = model.parameters.as_ref().map_or(&[][..], |parameters| parameters.values());
            let swept = SweptBack::new(plan, (of, objective), values, tolerances, 0.0);
            let adjoint = Adjoint::new(model.problem(), directions(model, &of.by)?, adjoint::MOST_STORED);
            let adjoint = adjoint.map_err(|error| error.to_string())?;
            let speeds = &swept.direction;
            let tangents = Tangents::new(model.problem(), adjoint::together(model, &of.by, speeds)?);
            let observed = ObservedSlopes::together(&objective.observables, outputs, (&of.by, speeds), plan.start);
            return Ok(Self {
                tangents: tangents.and_then(Tangents::with_terms).map_err(|error| error.to_string())?,
                observed: Some(observed),
                states,
                outputs,
                of: Vec::new(),
                by: 1,
                swept: Some((adjoint, swept)),
            });
        }
        let directions = directions(model, &of.by)?;
        let tangents = Tangents::new(model.problem(), directions).map_err(|error| error.to_string())?;
        let by = of.by.len();
        let is_observed = of.of.iter().any(|&of| of >= outputs);
        let observed = is_observed.then(|| ObservedSlopes::new(&plan.observables, outputs, &of.by, plan.start));
        Ok(Self { tangents, observed, states, outputs, of: of.of.clone(), by, swept: None })
    }

    /// Makes a step of the run, and propagates the derivatives of the states over it.
    pub fn step(&mut self, radau: &mut Radau<'_>) -> Result<Result<(), NoDerivative>, StepError> {
        if let Some((adjoint, _)) = &mut self.swept {
            adjoint.prepare(radau, &self.tangents);
        }
        let followed = self.tangents.advance(radau)?;
        Ok(followed.and_then(|()| self.observe(radau)))
    }

    /// Stores the last step of the run, in adjoint mode, and updates the derivatives of the user's integrals over it.
    fn observe(&mut self, radau: &mut Radau<'_>) -> Result<(), NoDerivative> {
        if let Some((adjoint, swept)) = &mut self.swept {
            adjoint.store(radau, &self.tangents)?;
            swept.watch(adjoint.bytes());
        }
        let Self { tangents, observed: Some(observed), states, by, .. } = self else { return Ok(()) };
        let ends = (radau.last_step().t, radau.t());
        observed.step(ends, |t| along(tangents, radau, (*states, *by), t), None);
        Ok(())
    }

    /// Returns the gradient of the objective (the quantity to differentiate) after the last step, in adjoint mode.
    pub fn gradient(&mut self, radau: &mut Radau<'_>) -> Option<Result<Gradient, String>> {
        let Self { tangents, observed: Some(observed), swept: Some((adjoint, swept)), states, .. } = self else {
            return None;
        };
        let t = radau.t();
        let along = observed.write(t, |t| along(tangents, radau, (*states, 1), t));
        let x = radau.y()[..*states].to_vec();
        Some(swept.sweep((t, &x), along[(0, 0)], |by_states, by_directions, integral| {
            let slopes = adjoint.sweep((radau, tangents), (by_states, by_directions), integral);
            Ok((slopes.map_err(|why| why.to_string())?, adjoint.work.into()))
        }))
    }

    /// Writes the columns of derivatives at a time within the last step.
    pub fn write(&mut self, radau: &mut Radau<'_>, t: f64, out: &mut [f64]) {
        let Self { tangents, observed, states, outputs, of, by, .. } = self;
        if of.is_empty() {
            return;
        }
        let observed =
            observed.as_mut().map(|observed| observed.write(t, |t| along(tangents, radau, (*states, *by), t)));
        for (out, &place) in out.chunks_exact_mut(*by).zip(&*of) {
            match (place.checked_sub(*outputs), &observed) {
                (Some(own), Some(observed)) => {
                    out.iter_mut().zip(observed.row(own).iter()).for_each(|(out, value)| *out = *value);
                }
                _ => tangents.write(radau, t, place, out),
            }
        }
    }
}

/// Returns the states and their derivatives at a time within the last step.
fn along(tangents: &Tangents, radau: &mut Radau<'_>, (states, by): (usize, usize), t: f64) -> (Vec<f64>, DMatrix<f64>) {
    let mut x = vec![0.0; radau.y().len()];
    radau.at(t, &mut x);
    x.truncate(states);
    let mut slopes = DMatrix::zeros(states, by);
    let mut row = vec![0.0; by];
    for state in 0..states {
        tangents.write(radau, t, state, &mut row);
        slopes.row_mut(state).copy_from_slice(&row);
    }
    (x, slopes)
}

/// Returns the failure of a run whose states have no derivatives from the time `time` on.
pub(super) fn failure(why: &str, time: f64, state: &[f64]) -> Failure {
    let message =
        format!("there are no derivatives from t = {time:?} on: {why}; without `sensitivities` the run itself goes on");
    Failure { code: "no_derivative".into(), message, time, state: state.to_vec() }
}

/// Returns the directions of differentiation that belong to parameters and initial values. Each direction of a
/// parameter comes with two problems, at a slightly larger and a slightly smaller value, for central differences.
pub(super) fn directions(model: &DviModel, by: &[By]) -> Result<Directions, String> {
    let shifted = by.iter().map(|by| match *by {
        By::Initial(_) => Ok(None),
        By::Parameter(parameter) => moved(model, parameter).map(Some),
    });
    let shifted = shifted.collect::<Result<_, String>>()?;
    Ok(Directions { shifted, ..unshifted(model, by)? })
}

/// Returns the directions of differentiation that belong to parameters and initial values, without problems at
/// changed parameter values.
fn unshifted(model: &DviModel, by: &[By]) -> Result<Directions, String> {
    let structure = model.structure();
    let (n, count) = (structure.states, by.len());
    let slopes = model.slopes().map_err(|error| error.to_string())?;
    let mut initial = DMatrix::zeros(n, count);
    let shifted = Vec::new();
    for (direction, by) in by.iter().enumerate() {
        if let By::Initial(state) = *by {
            initial[(state, direction)] = 1.0;
        }
    }
    let Some(mut slopes) = slopes else {
        let rows = Box::new(|_: f64, _: &[f64], out: &mut DMatrix<f64>| out.fill(0.0));
        return Ok(Directions { initial, rows, mass: Vec::new(), bounds: Vec::new(), shifted });
    };
    // The index of the direction of differentiation that belongs to a parameter; each parameter occurs at most once.
    let column = |parameter: usize| by.iter().position(|by| *by == By::Parameter(parameter));
    for (state, parameter, value) in slopes.initial() {
        // An initial value with respect to which the run is differentiated does not follow the parameters.
        if let Some(direction) = column(parameter).filter(|_| !by.contains(&By::Initial(state))) {
            initial[(state, direction)] = value;
        }
    }
    let mass = slopes.mass().filter_map(|(place, parameter, value)| Some((place, column(parameter)?, value))).collect();
    let bounds = slopes.bounds().filter_map(|(bound, parameter, value)| Some((bound, column(parameter)?, value)));
    let bounds = bounds.collect();
    let pattern = slopes.pattern().iter().enumerate();
    let places: Vec<(usize, usize, usize)> =
        pattern.filter_map(|(place, &(row, parameter))| Some((place, row, column(parameter)?))).collect();
    let mut values = vec![0.0; slopes.pattern().len()];
    let rows = Box::new(move |t: f64, y: &[f64], out: &mut DMatrix<f64>| {
        slopes.evaluate(t, y, &mut values);
        out.fill(0.0);
        places.iter().for_each(|&(place, row, direction)| out[(row, direction)] += values[place]);
    });
    Ok(Directions { initial, rows, mass, bounds, shifted })
}

/// Returns the size of a parameter with the value `value`, by which its change in a finite difference is scaled.
fn size_of(value: f64) -> f64 {
    if value == 0.0 { MOVED_ALONE } else { value.abs() }
}

/// Returns two problems for central differences, with one parameter slightly above and slightly below its value.
fn moved(model: &DviModel, parameter: usize) -> Result<Shifted, String> {
    let values = model.parameters.as_ref().map_or(&[][..], |parameters| parameters.values());
    shifted_by(model, CENTRAL_DIFFERENCE * size_of(values[parameter]), |k| if k == parameter { 1.0 } else { 0.0 })
}

/// Returns two problems for central differences, in which each parameter `k` is increased and decreased by `by *
/// speed(k)`.
fn shifted_by(model: &DviModel, by: f64, speed: impl Fn(usize) -> f64) -> Result<Shifted, String> {
    let values = model.parameters.as_ref().map_or(&[][..], |parameters| parameters.values());
    let at = |by: f64| {
        let values: Vec<f64> = values.iter().enumerate().map(|(k, value)| value + by * speed(k)).collect();
        model.with_parameters(&values).map(|model| model.problem()).map_err(|error| error.to_string())
    };
    Ok(Shifted { by, problems: [at(by)?, at(-by)?] })
}

/// Compares the derivatives of a run with finite differences of runs.
pub(super) fn check(
    model: &DviModel,
    plan: &Plan,
    settings: &Settings,
    analysis: &Analysis,
    control: &Control,
    ended: &mut Ended,
) {
    let values = model.parameters.as_ref().map_or(&[][..], |parameters| parameters.values());
    let tighter = tighter(settings);
    let run = |moved: &Moved<'_>| -> Option<Ended> {
        let bound =
            if model.parameters.is_some() { model.with_parameters(moved.parameters).ok()? } else { model.clone() };
        let initial = moved.initial(&bound.initial);
        Some(integrate_once(&bound, &Plan { initial, ..moved.plan.clone() }, &tighter, analysis, control))
    };
    compare(plan, values, (settings.rtol, &tighter), run, ended);
}

/// Compares the derivatives of a motion with located impacts with finite differences of motions.
pub(super) fn check_motion(
    model: &MechanicalModel,
    plan: &Plan,
    (contact, settings): (&ContactPlan, &Settings),
    analysis: &Analysis,
    control: &Control,
    ended: &mut Ended,
) {
    let values = model.parameters.as_ref().map_or(&[][..], |(parameters, _)| parameters.values());
    let tighter = tighter(settings);
    let contact = ContactPlan { located: Some(tighter.clone()), ..contact.clone() };
    let run = |moved: &Moved<'_>| -> Option<Ended> {
        let bound =
            if model.parameters.is_some() { model.with_parameters(moved.parameters).ok()? } else { model.clone() };
        let initial = moved.initial(&bound.initial);
        let plan = Plan { initial, ..moved.plan.clone() };
        Some(integrate_contact_once(&bound, &plan, &contact, analysis, control))
    };
    compare(plan, values, (settings.rtol, &tighter), run, ended);
}

/// Returns the settings of the runs whose finite differences are compared with derivatives. Their tolerances are
/// tighter than those of the run, so that their differences have more digits than the derivatives need.
fn tighter(settings: &Settings) -> Settings {
    let part = TIGHTER.max((TIGHTEST / settings.rtol).min(1.0));
    let atol = settings.atol.iter().map(|atol| part * atol).collect();
    Settings { rtol: part * settings.rtol, atol, ..settings.clone() }
}

/// The parameter values and initial values of one of the runs whose differences are compared with the derivatives.
struct Moved<'m> {
    parameters: &'m [f64],
    /// The states with respect to whose initial values derivatives are requested, with their initial values in this
    /// run.
    states: &'m [(usize, f64)],
    plan: &'m Plan,
}

impl Moved<'_> {
    /// Returns the initial values of this run; `follow` are the initial values that the model computes from the
    /// parameters.
    fn initial(&self, follow: &[f64]) -> Vec<f64> {
        let mut initial = follow.to_vec();
        self.states.iter().for_each(|&(state, value)| initial[state] = value);
        initial
    }
}

/// Returns distinct numbers between a half and one, with alternating signs: if several parameters and initial values
/// are moved by different fractions of their sizes, their effects cannot be mistaken for each other.
pub(super) fn generic_parts() -> impl Iterator<Item = f64> {
    (1_u32..).map(|k| {
        let part = 0.5 + 0.5 * (f64::from(k) * GOLDEN).fract();
        if k % 2 == 0 { -part } else { part }
    })
}

/// The derivatives of the outputs at one time, in which all derivatives of one output precede those of the next.
struct At {
    t: f64,
    rows: Vec<f64>,
}

/// Returns the derivatives at the end of a run, and before the end at output times that are spread over the run.
fn compared(asked: &Sensitivities, plan: &Plan, ended: &Ended) -> Vec<At> {
    let trajectory = &ended.solution.trajectory;
    let columns: Option<Vec<&[f64]>> = asked.names.iter().map(|name| trajectory.field(name)).collect();
    let mut places: Vec<usize> = (0..trajectory.t.len()).collect();
    // A recorded event has two equal output times, one before and one after its jump.
    places.dedup_by_key(|place| trajectory.t[*place].to_bits());
    places.retain(|place| trajectory.t[*place] > plan.start && trajectory.t[*place] < plan.end);
    let apart = places.len().div_ceil(MOST_COMPARED).max(1);
    let on_the_way = columns.into_iter().flat_map(|columns| {
        let at = |&place: &usize| At {
            t: trajectory.t[place],
            rows: columns.iter().filter_map(|column| column.get(place).copied()).collect(),
        };
        places.iter().skip(apart / 2).step_by(apart).map(at).collect::<Vec<At>>()
    });
    let on_the_way = on_the_way.filter(|_| asked.objective.is_none());
    on_the_way.chain([At { t: plan.end, rows: ended.derivatives.clone() }]).collect()
}

/// Whether the time `t` lies between the occurrences of one event in several runs: the numbers of events so far
/// differ, and the time since the last event is at most the spread of the last events of the runs. A difference of
/// runs is then no derivative.
fn is_between_events(events: &[Vec<f64>], t: f64) -> bool {
    let before = |events: &Vec<f64>| events.partition_point(|event| *event <= t);
    let counts: Vec<usize> = events.iter().map(before).collect();
    if counts.windows(2).all(|pair| pair[0] == pair[1]) {
        return false;
    }
    let last = |(events, count): (&Vec<f64>, &usize)| match count {
        0 => f64::NEG_INFINITY,
        count => events[count - 1],
    };
    let (first, latest) = events
        .iter()
        .zip(&counts)
        .map(last)
        .fold((f64::INFINITY, f64::NEG_INFINITY), |(first, latest), last| (first.min(last), latest.max(last)));
    t - latest <= latest - first
}

/// Returns the scale of a parameter that is zero: the change by which, according to its derivatives, some result
/// changes by its own size. Results below their tolerance, or below the largest tolerance of a state if they have
/// none, are ignored.
fn size_by_effects(
    asked: &Sensitivities,
    compared: &[At],
    values: &[Vec<f64>],
    tighter: &Settings,
    k: usize,
) -> Option<f64> {
    let most = tighter.atol.iter().copied().fold(0.0, f64::max);
    let of_result = |(number, (of, values)): (usize, (&usize, &Vec<f64>))| {
        let largest = values.iter().fold(0.0_f64, |largest, value| largest.max(value.abs()));
        let slopes = compared.iter().filter_map(|at| at.rows.get(number * asked.by.len() + k));
        let steepest = slopes.fold(0.0_f64, |steepest, slope| steepest.max(slope.abs()));
        let atol = tighter.atol.get(*of).copied().unwrap_or(most);
        (largest > atol && steepest > 0.0).then_some(largest / steepest)
    };
    let sizes = asked.of.iter().zip(values).enumerate().filter_map(of_result);
    sizes.filter(|size| *size > 0.0 && size.is_finite()).min_by(f64::total_cmp)
}

/// Compares the derivatives of a run with finite differences of runs, and records the check.
fn compare(
    plan: &Plan,
    values: &[f64],
    (rtol, tighter): (f64, &Settings),
    run: impl Fn(&Moved<'_>) -> Option<Ended>,
    ended: &mut Ended,
) {
    let Some(asked) = &plan.sensitivities else { return };
    let compared = compared(asked, plan, ended);
    let resolution = ended.resolution.take();
    let observables = asked.objective.as_ref().map_or(&plan.observables, |objective| &objective.observables);
    let checks = &mut ended.solution.diagnostics.checks;
    if ended.solution.ended_by.is_some() {
        let message =
            "`stop` ended the run, and runs with other parameters, which derivatives are compared with, end elsewhere";
        checks.caveat("derivatives_not_checked", message.to_owned());
        return;
    }
    let part = rtol.powf(POWER).min(MOST_MOVED);
    let size_of = |by: &By| match *by {
        By::Parameter(k) => values[k].abs(),
        By::Initial(state) => plan.initial[state].abs().max(ended.x[state].abs()),
    };
    // Returns the compared outputs at the times of the comparison, and the times of the events, of a run with changed
    // parameters.
    let along = |changes: &[f64]| -> Option<(Vec<Vec<f64>>, Vec<f64>)> {
        let mut parameters = values.to_vec();
        let mut states = Vec::new();
        for (by, change) in asked.by.iter().zip(changes) {
            match *by {
                By::Parameter(k) => parameters[k] += change,
                By::Initial(state) => states.push((state, plan.initial[state] + change)),
            }
        }
        let mut reference = Plan {
            times: Some(compared.iter().map(|at| at.t).collect()),
            fields: asked.of.clone(),
            observables: observables.clone(),
            sensitivities: None,
            reducers: None,
            interpolants: None,
            ..plan.clone()
        };
        reference.observables.bind(&parameters);
        let Ended { solution, .. } = run(&Moved { parameters: &parameters, states: &states, plan: &reference })?;
        let is_whole = solution.status == Status::Completed && solution.trajectory.t.len() == compared.len();
        let events = solution.trajectory.events.iter().map(|event| event.t).collect();
        is_whole.then(|| (solution.trajectory.fields.into_iter().map(|field| field.values).collect(), events))
    };
    let unmoved = along(&vec![0.0; asked.by.len()]);
    let size = |(k, by): (usize, &By)| match size_of(by) {
        size if size > 0.0 => size,
        _ => unmoved
            .as_ref()
            .and_then(|(values, _)| size_by_effects(asked, &compared, values, tighter, k))
            .map_or(1.0, |size| size.min(1.0)),
    };
    let sizes = asked.by.iter().enumerate().map(size);
    let direction: Vec<f64> = sizes.zip(generic_parts()).map(|(size, moved)| moved * part * size).collect();
    let resolution = resolution.map_or(0.0, |resolution| resolution.along(&direction));
    let times = |multiple: f64| direction.iter().map(|change| multiple * change).collect::<Vec<f64>>();
    let moved = [1.0, -1.0, 2.0, -2.0].into_iter().map_while(|multiple| along(&times(multiple)));
    let runs: Vec<_> = unmoved.into_iter().chain(moved).collect();
    let (values, events): (Vec<Vec<Vec<f64>>>, Vec<Vec<f64>>) = runs.into_iter().unzip();
    let [here, above, below, far_above, far_below] = values.as_slice() else {
        let message = "runs with other parameters, which the derivatives are compared with, did not reach the end";
        checks.caveat("derivatives_not_checked", message.to_owned());
        return;
    };
    let is_between: Vec<bool> = compared.iter().map(|at| is_between_events(&events, at.t)).collect();
    let mut worst: Option<(f64, f64, Checked)> = None;
    // For each parameter and initial value, the largest effect of its change alone on the compared outputs, in units
    // of the accuracy of the runs.
    let mut shown = vec![0.0_f64; asked.by.len()];
    for (k, &of) in asked.of.iter().enumerate() {
        let largest = here[k].iter().fold(0.0_f64, |largest, value| largest.max(value.abs()));
        let along = |row: &[f64]| row.iter().zip(&direction).map(|(slope, change)| slope * change).sum::<f64>();
        let rows = compared.iter().filter_map(|at| at.rows.chunks(asked.by.len()).nth(k));
        let steepest = rows.map(|row| along(row).abs()).fold(0.0, f64::max);
        for (i, At { t, rows }) in compared.iter().enumerate() {
            let Some(row) = rows.chunks(asked.by.len()).nth(k) else { continue };
            let [here, above, below] = [here, above, below].map(|values| values[k][i]);
            let [far_above, far_below] = [far_above, far_below].map(|values| values[k][i]);
            let derivative = along(row);
            let near = 0.5 * (above - below);
            let far = 0.25 * (far_above - far_below);
            let is_end = i + 1 == compared.len();
            if !is_end && is_between[i] {
                continue;
            }
            // At the end of the run the errors of an output are relative to its value there, before the end to its
            // largest value at all compared times.
            let size = if is_end { here.abs() } else { largest };
            let atol = tighter.atol.get(of).copied().unwrap_or(0.0);
            let known = tighter.rtol * size + atol + resolution + f64::EPSILON * largest;
            // The error of a central difference is a third of its distance from the difference with twice the
            // increment. The whole distance is taken as the uncertainty: at a jump, where there is no derivative, the
            // difference is twice that with twice the increment.
            let uncertainty = (near - far).abs() + SLACK * known + OWN * rtol * steepest;
            let distance = if is_end {
                (derivative - near).abs()
            } else {
                // At the time of a switch derivatives jump, and both one-sided limits are correct. The error of a
                // one-sided difference is of first order in the change.
                let sides = [(above - here, 0.5 * (far_above - here)), (here - below, 0.5 * (here - far_below))];
                let sides = sides.into_iter().flat_map(|(near, far)| [near, far, 2.0 * near - far]);
                let (least, most) = sides
                    .fold((f64::INFINITY, f64::NEG_INFINITY), |(least, most), side| (least.min(side), most.max(side)));
                if derivative.is_nan() { derivative } else { (least - derivative).max(derivative - most).max(0.0) }
            };
            for ((shown, slope), change) in shown.iter_mut().zip(row).zip(&direction) {
                *shown = shown.max((slope * change).abs() / (SLACK * known));
            }
            let off = if distance == 0.0 { 0.0 } else { distance / uncertainty };
            if worst.as_ref().is_none_or(|(worst, ..)| off > *worst || off.is_nan()) {
                let name = plan.names.get(of).or_else(|| observables.names.get(of - plan.names.len()));
                let of = name.cloned().unwrap_or_default();
                let direction = direction.clone();
                worst = Some((off, *t, Checked { of, direction, derivative, finite_difference: near, uncertainty }));
            }
        }
    }
    let hidden: Vec<String> =
        asked.to.iter().zip(&shown).filter(|(_, shown)| **shown < 1.0).map(|(name, _)| format!("`{name}`")).collect();
    if let Some(first) = hidden.first() {
        let others = if hidden.len() > 1 { format!(" and {} others", hidden.len() - 1) } else { String::new() };
        checks.caveat(
            "derivatives_not_checked",
            format!(
                "{first}{others}, varied by a small part of its size, moves the results by less than runs tell apart: these \
                 derivatives may lack what the run did not resolve; give larger values, or tighten `rtol` and `atol`"
            ),
        );
    }
    if let Some((off, t, checked)) = worst {
        checks.record(CheckCode::Derivatives, off, 1.0, || {
            format!(
                "the derivative of `{}` at t = {t:?} is {:e} in a direction in which the difference of two runs is {:e}, with an \
                 uncertainty of {:.0e}: the order of switches may change nearby, or a tolerance is too loose",
                checked.of, checked.derivative, checked.finite_difference, checked.uncertainty
            )
        });
        ended.solution.sensitivities = Some(checked);
    }
}
