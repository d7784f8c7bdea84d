//! The main loop of a run: outputs, limits, events and evidence, common to all methods of integration.

use super::dense::{Dense, Sampling};
use super::impulse::Impulse;
use super::observables::{EndedBy, Observables, Observed};
use super::quadrature::NEGLIGIBLE;
use super::reducers::{Reducers, Reducing};
use super::sensitivities::{Gradient, Resolution, Sensitivities};
use super::statistics::{OverTime, Statistics};
use super::{CheckCode, Diagnostics, Event, EventKind, Failure, Field, Solution, Status, Trajectory};
use numerics::Interval;
use problem::{Control, Stop};
use std::collections::BTreeMap;
use std::sync::Arc;
use std::time::Instant;

/// The plan of a run: the initial values, the horizon, and the outputs to keep.
#[derive(Clone, Debug)]
pub struct Plan {
    /// The names of the states, then of the other outputs.
    pub names: Vec<String>,
    /// The user's definitions, integrals and monitors; their names follow `names`.
    pub observables: Observables,
    /// The initial values of the states.
    pub initial: Vec<f64>,
    /// The start time of the run.
    pub start: f64,
    /// The end time of the run.
    pub end: f64,
    /// The output times, increasing, within `[start, end]`; `None` for an output at every step.
    pub times: Option<Vec<f64>>,
    /// The requested sensitivities; their columns follow the observables.
    pub sensitivities: Option<Sensitivities>,
    /// The fields to keep in the trajectory, as indices into `names` followed by the names of observables and
    /// sensitivities.
    pub fields: Vec<usize>,
    /// Whether to estimate the global error of the states at the end.
    pub global_error: bool,
    /// Whether to compute statistics of the fields over time: means, extremes and others.
    pub statistics: bool,
    /// The numbers to collect from the run beside its trajectory.
    pub reducers: Option<Arc<Reducers>>,
    /// The permitted error of interpolants of the fields, relative to the largest value of a field; `None` if no
    /// interpolants are requested. With interpolants, no field is an integral or a derivative.
    pub interpolants: Option<f64>,
    /// Largest number of steps of the run.
    pub most_steps: u64,
    /// Largest number of values in the trajectory.
    pub most_values: usize,
    /// Largest number of bytes that the method may allocate, if it monitors them.
    pub most_memory: usize,
}

/// A method that integrates a problem step by step.
pub trait Stepper {
    /// Returns the time that the method has reached.
    fn t(&self) -> f64;

    /// Whether the method has reached the end time.
    fn is_done(&self) -> bool;

    /// Returns the number of accepted steps so far.
    fn accepted(&self) -> u64;

    /// Returns the states of the problem at the current time.
    fn states(&self) -> &[f64];

    /// Makes one accepted step.
    ///
    /// # Errors
    /// The reason why the step failed, for the user.
    fn step(&mut self) -> Result<(), Failure>;

    /// Writes all outputs, in the order of [`Plan::names`], at a time within the last step.
    fn values(&mut self, t: f64, out: &mut [f64]);

    /// Writes all outputs at an output time, and records the evidence for them.
    fn outputs(&mut self, t: f64, out: &mut [f64]) {
        self.values(t, out);
    }

    /// Writes enclosures of the outputs between two times within the last step, for those outputs whose enclosures are
    /// known. Returns false if no enclosure is known.
    fn enclose(&mut self, _from: f64, _to: f64, _out: &mut [Interval]) -> bool {
        false
    }

    /// Returns the relative tolerance, and the absolute tolerances of the states, which are the first outputs; `None`
    /// for a method without error control.
    fn tolerances(&self) -> Option<(f64, &[f64])> {
        None
    }

    /// Writes the requested sensitivities at a time within the last step.
    fn derivatives(&mut self, _t: f64, _out: &mut [f64]) {}

    /// Returns the gradient of the objective after the last step, if one is requested.
    fn gradient(&mut self) -> Option<Result<Gradient, Failure>> {
        None
    }

    /// Returns the impulses at jumps of the states at the end of the last step.
    fn impulses(&mut self) -> Vec<Impulse> {
        Vec::new()
    }

    /// Returns the name of the current mode of the system; `None` for methods that report events only.
    fn mode(&mut self) -> Option<String> {
        None
    }

    /// Moves the events of the last step, in the order of time, to `events`.
    fn take_events(&mut self, events: &mut Vec<Event>);

    /// Moves to `events` the events of the last step that were withheld because a following step may revoke them;
    /// called at the end of a run.
    fn last_events(&mut self, _events: &mut Vec<Event>) {}

    /// Adds the evidence of the last step to the diagnostics; `switched` is true if the step has events.
    fn observe(&mut self, switched: bool, diagnostics: &mut Diagnostics);

    /// Copies the counters of the method for the whole run to the diagnostics.
    fn finish(&mut self, diagnostics: &mut Diagnostics);
}

impl Plan {
    /// Returns the name of an output of the problem, or else of a definition or integral of the user.
    fn name(&self, place: usize) -> &str {
        let own = place.checked_sub(self.names.len());
        own.map_or_else(|| self.names[place].as_str(), |own| self.observables.names[own].as_str())
    }
}

/// The result of a finished run, with its final states.
pub(super) struct Ended {
    pub solution: Solution,
    pub x: Vec<f64>,
    /// The final sensitivities, in the order of [`Sensitivities::names`]; in adjoint mode the gradient.
    pub derivatives: Vec<f64>,
    /// The accuracy to which the objective of adjoint mode is known.
    pub resolution: Option<Resolution>,
    /// Statistics of the fields by name, if [`Plan::statistics`] asks for them.
    pub statistics: BTreeMap<String, OverTime>,
}

/// Starts a stepper and drives it to the end; after a failure, the answer contains the trajectory up to the failure.
pub fn run<S: Stepper>(
    plan: &Plan,
    control: &Control,
    diagnostics: Diagnostics,
    start: impl FnOnce() -> Result<S, Failure>,
) -> Solution {
    run_to_end(plan, control, diagnostics, start).solution
}

/// Starts a stepper and drives it to the end, and returns the final states as well.
pub(super) fn run_to_end<S: Stepper>(
    plan: &Plan,
    control: &Control,
    diagnostics: Diagnostics,
    start: impl FnOnce() -> Result<S, Failure>,
) -> Ended {
    let mut run = Run::new(plan, control, diagnostics);
    match start() {
        Ok(mut stepper) => {
            let mut ended = run.drive(&mut stepper);
            let gradient = run.gradient(&mut ended, &mut stepper);
            stepper.finish(&mut run.diagnostics);
            let mut ended = run.end(ended);
            if let Some(gradient) = gradient {
                gradient.put(plan, &mut ended);
            }
            ended
        }
        Err(failure) => run.end(Err(ending(control, failure))),
    }
}

/// A run in progress, driven by one stepper or by several in sequence.
pub(super) struct Run<'a> {
    plan: &'a Plan,
    control: &'a Control,
    recorder: Recorder<'a>,
    x: Vec<f64>,
    began: Instant,
    /// The evidence for the accuracy of the run so far.
    pub diagnostics: Diagnostics,
}

impl<'a> Run<'a> {
    pub fn new(plan: &'a Plan, control: &'a Control, diagnostics: Diagnostics) -> Self {
        let (recorder, x) = (Recorder::new(plan), plan.initial.clone());
        Self { plan, control, recorder, x, began: Instant::now(), diagnostics }
    }

    /// Whether an event of the user's `stop` has ended the run.
    pub fn is_ended(&self) -> bool {
        self.recorder.ended_by.is_some()
    }

    /// Drives a stepper until it is done, or an event of the user's `stop` ends the run; returns the reason if
    /// neither happens.
    pub fn drive(&mut self, stepper: &mut impl Stepper) -> Result<(), (Status, Failure)> {
        let plan = self.plan;
        self.recorder.start(stepper);
        let driven = loop {
            if let Some(failure) = self.recorder.not_finite(stepper) {
                break Err((Status::Failed, failure));
            }
            if stepper.is_done() || self.recorder.ended_by.is_some() {
                break Ok(());
            }
            if let Some((code, message)) = limit(stepper, plan, self.control, &self.recorder) {
                let state = stepper.states().to_vec();
                break Err((Status::Stopped, Failure { code: code.into(), message, time: stepper.t(), state }));
            }
            let begin = stepper.t();
            if let Err(failure) = stepper.step() {
                break Err(ending(self.control, failure));
            }
            let Recorded { events, switched } = self.recorder.step(stepper, begin, self.control);
            self.control.tell(events);
            stepper.observe(switched, &mut self.diagnostics);
            let done = (stepper.t() - plan.start) / (plan.end - plan.start);
            self.control.report(done, stepper.accepted());
        };
        self.x.copy_from_slice(stepper.states());
        self.control.tell(self.recorder.end(stepper));
        if let Some(reducing) = &mut self.recorder.reducing {
            reducing.end(stepper);
        }
        driven
    }

    /// Computes the gradient of the objective after the last step, if one is requested; if the computation fails, sets
    /// the failure as the end of the run.
    pub fn gradient(&self, ended: &mut Result<(), (Status, Failure)>, stepper: &mut impl Stepper) -> Option<Gradient> {
        if ended.is_err() {
            return None;
        }
        match stepper.gradient()? {
            Ok(gradient) => Some(gradient),
            Err(failure) => {
                *ended = Err(ending(self.control, failure));
                None
            }
        }
    }

    pub fn end(mut self, ended: Result<(), (Status, Failure)>) -> Ended {
        let (status, error) = match ended {
            Ok(()) => (Status::Completed, None),
            Err((status, failure)) => (status, Some(failure)),
        };
        let Recorder { trajectory, ended_by, observed, y, statistics, reducing, sampling, .. } = self.recorder;
        let dense: Option<Dense> = sampling.and_then(Sampling::finish);
        let of_integrals = observed.as_ref().and_then(|observed| observed.uncertainty());
        let of_means = statistics.as_ref().and_then(|statistics| statistics.uncertainty());
        let of_reductions = reducing.as_ref().and_then(|reducing| reducing.uncertainty());
        let unnamed = [of_means, of_reductions].into_iter().flatten().map(|uncertainty| ("means", uncertainty));
        for (name, uncertainty) in of_integrals.into_iter().chain(unnamed) {
            self.diagnostics.checks.record(CheckCode::LocalError, uncertainty, NEGLIGIBLE, || {
                format!(
                    "an integral over time (`{name}`) is uncertain by {uncertainty:.1e} of the integral of the absolute value: \
                     its integrand varies faster than the parts of a step that are examined; set `max_step`"
                )
            });
        }
        let field = |place: usize| self.plan.name(place);
        let of_integrals = observed.as_ref().and_then(|observed| observed.undefined());
        let of_integrals = of_integrals.or_else(|| reducing.as_ref().and_then(|reducing| reducing.undefined()));
        let undefined = |what: &str, name: &str, t: f64| {
            format!(
                "the {what} `{name}` is undefined from t = {t:?} on: states jump there by an impulse, and the integrand is not \
                 linear in it, or depends on a state that jumps beside it"
            )
        };
        if let Some((name, t)) = of_integrals {
            self.diagnostics.checks.record(CheckCode::LocalError, f64::INFINITY, NEGLIGIBLE, || {
                undefined("integral", name, t) + "; leave it out, or end before"
            });
        }
        if let Some((place, t)) = statistics.as_ref().and_then(Statistics::undefined) {
            let message = undefined("mean or root mean square of", field(place), t) + ", and `null` in the answer";
            self.diagnostics.checks.caveat("mean_undefined", message);
        }
        let of_statistics = statistics.as_ref().and_then(Statistics::open).map(|(place, by, t)| (field(place), by, t));
        let of_reductions = reducing.as_ref().and_then(|reducing| reducing.open());
        for (name, by, t) in of_statistics.into_iter().chain(of_reductions) {
            if by.is_finite() {
                let message = format!(
                    "near t = {t:?} an extreme of `{name}` may be exceeded by up to {by:.1e} of its size: nothing larger was found, \
                     and nothing excludes it; a smaller `max_step` may help"
                );
                self.diagnostics.checks.caveat("extreme_not_proven", message);
            } else {
                self.diagnostics.checks.record(CheckCode::LocalError, by, NEGLIGIBLE, || {
                    format!("`{name}` has no bound near t = {t:?}, and so no extreme: leave it out, or keep it away from there")
                });
            }
        }
        let derivatives = y[self.plan.names.len() + self.plan.observables.names.len()..].to_vec();
        let is_complete = status == Status::Completed;
        let collected = reducing.map(|reducing| reducing.finish(is_complete, &trajectory.events, &derivatives));
        if let (Some(collected), Some(of)) = (&collected, &self.plan.reducers)
            && let Some(column) = of.lost(collected, ended_by.is_some()).filter(|_| is_complete)
        {
            self.diagnostics.checks.record(CheckCode::LocalError, f64::INFINITY, NEGLIGIBLE, || {
                format!("`{column}` is not finite: its expression has a pole on the way, or a value outside its domain")
            });
        }
        let collected = collected.or_else(|| self.plan.reducers.as_ref().map(|reducers| reducers.nothing()));
        let statistics = statistics.map_or_else(BTreeMap::new, |statistics| {
            statistics.finish().into_iter().map(|(place, over)| (field(place).to_owned(), over)).collect()
        });
        let switches = trajectory.events.iter().filter(|event| event.kind != EventKind::Crossed);
        self.diagnostics.switches = switches.count() as u64;
        if let Some((label, t)) = observed.as_ref().and_then(|observed| observed.touched()) {
            let message = format!(
                "`{label}` comes to zero within what the tolerances leave uncertain, and turns back at t = {t:?}: whether it has \
                 events there is not known; tighten `rtol` and `atol`, or take a value that it crosses"
            );
            self.diagnostics.checks.caveat("touch_uncertain", message);
        }
        if let Some(open) = observed.map(|observed| observed.open()).filter(|open| *open > 0) {
            let message = format!(
                "in {open} steps a monitor of `stop` could not be enclosed, and was evaluated at some points only: two \
                 sign changes within a step would not be seen"
            );
            self.diagnostics.checks.caveat("stop_not_proven", message);
        }
        self.diagnostics.wall_seconds = self.began.elapsed().as_secs_f64();
        Ended {
            solution: Solution {
                status,
                error,
                ended_by,
                trajectory,
                diagnostics: self.diagnostics,
                collected: collected.unwrap_or_default(),
                dense,
                ..Solution::default()
            },
            x: self.x,
            derivatives,
            resolution: None,
            statistics,
        }
    }
}

/// Returns the status after a failed step of a run: stopped if `control` asks for it, otherwise failed.
pub(super) fn ending(control: &Control, failure: Failure) -> (Status, Failure) {
    match stopped(control, failure.time) {
        Some((code, message)) => (Status::Stopped, Failure { code: code.into(), message, ..failure }),
        None => (Status::Failed, failure),
    }
}

/// Returns the code and message of a request of `control` to stop the run, if there is one.
fn stopped(control: &Control, t: f64) -> Option<(&'static str, String)> {
    Some(match control.poll()? {
        Stop::Cancelled => ("cancelled", format!("cancelled at t = {t:?}")),
        Stop::Deadline => {
            ("wall_time", format!("the wall-clock limit was reached at t = {t:?}; allow more with limits.wall_seconds"))
        }
    })
}

/// Returns the code and message of the limit that the run has reached, if any.
fn limit(
    stepper: &impl Stepper,
    plan: &Plan,
    control: &Control,
    recorder: &Recorder<'_>,
) -> Option<(&'static str, String)> {
    let t = stepper.t();
    if let Some(stopped) = stopped(control, t) {
        return Some(stopped);
    }
    if stepper.accepted() >= plan.most_steps {
        let most = plan.most_steps;
        return Some((
            "steps",
            format!("{most} steps were made up to t = {t:?}; allow more with limits.steps, or loosen rtol"),
        ));
    }
    if recorder.values() > plan.most_values {
        let most = plan.most_values;
        return Some((
            "output",
            format!("the trajectory has {most} numbers at t = {t:?}; ask for fewer times or fields"),
        ));
    }
    None
}

/// Records the requested outputs of a run in columns.
struct Recorder<'a> {
    plan: &'a Plan,
    trajectory: Trajectory,
    /// The index of the next output time at which values are to be recorded.
    next: usize,
    /// The outputs of the problem, then the user's definitions and integrals, then sensitivities.
    y: Vec<f64>,
    /// The values of the user's observables; `None` before the run starts.
    observed: Option<Observed<'a>>,
    /// Statistics of the fields other than integrals and sensitivities.
    statistics: Option<Statistics>,
    reducing: Option<Reducing<'a>>,
    sampling: Option<Sampling>,
    is_started: bool,
    ended_by: Option<EndedBy>,
    /// The first user's definition or integral with a value that is not finite, and the time of that value.
    broken: Option<(usize, f64)>,
}

/// The events of one step of the run that have been recorded in the answer.
struct Recorded<'r> {
    events: &'r [Event],
    /// Whether the method itself has reported an event in the step.
    switched: bool,
}

impl<'a> Recorder<'a> {
    fn new(plan: &'a Plan) -> Self {
        let capacity = plan.times.as_ref().map_or(0, Vec::len);
        let derivatives = plan.sensitivities.iter().flat_map(|sensitivities| &sensitivities.names);
        let names: Vec<&String> = plan.names.iter().chain(&plan.observables.names).chain(derivatives).collect();
        let field = |&index: &usize| Field { name: names[index].clone(), values: Vec::with_capacity(capacity) };
        let fields = plan.fields.iter().map(field).collect();
        let trajectory = Trajectory { t: Vec::with_capacity(capacity), fields, events: Vec::new() };
        let y = vec![0.0; names.len()];
        let statistics = plan.statistics.then(|| {
            let most = plan.names.len() + plan.observables.definitions();
            let places: Vec<usize> = plan.fields.iter().copied().filter(|place| *place < most).collect();
            Statistics::new(places, plan.names.len(), &plan.observables)
        });
        Self {
            plan,
            trajectory,
            next: 0,
            y,
            observed: None,
            statistics,
            reducing: None,
            sampling: None,
            is_started: false,
            ended_by: None,
            broken: None,
        }
    }

    fn values(&self) -> usize {
        self.trajectory.t.len() * (1 + self.trajectory.fields.len()) + self.trajectory.events.len()
    }

    /// Begins recording when the first stepper starts; does nothing for later steppers of the run.
    fn start(&mut self, stepper: &mut impl Stepper) {
        if std::mem::replace(&mut self.is_started, true) {
            return;
        }
        let of = &self.plan.observables;
        if !(of.names.is_empty() && of.monitors.is_empty()) {
            self.observed = Some(Observed::new(of, self.plan.names.len(), stepper));
        }
        let plan = self.plan;
        self.reducing = plan.reducers.as_ref().map(|of| Reducing::new(of, plan.names.len(), stepper));
        if let Some(tolerance) = plan.interpolants {
            let mut row = vec![0.0; plan.fields.len()];
            self.row(stepper, plan.start, &mut row);
            self.sampling = Some(Sampling::new(plan.start, row, tolerance, plan.most_values));
        }
        match &self.plan.times {
            None => self.sample(stepper, self.plan.start),
            Some(times) => {
                while times.get(self.next).is_some_and(|&t| t <= self.plan.start) {
                    self.sample(stepper, times[self.next]);
                    self.next += 1;
                }
            }
        }
    }

    /// Records the outputs and events of the last step, which began at the time `begin`.
    fn step(&mut self, stepper: &mut impl Stepper, begin: f64, control: &Control) -> Recorded<'_> {
        let before = self.trajectory.events.len();
        let mut events = Vec::new();
        stepper.take_events(&mut events);
        let switched = !events.is_empty();
        let impulses = stepper.impulses();
        if let Some(observed) = &mut self.observed {
            observed.expect(&impulses);
            let goes_on = |count| before + count <= self.plan.most_values && control.poll().is_none();
            self.ended_by = observed.follow(stepper, begin, &mut events, goes_on);
        }
        self.trajectory.events.append(&mut events);
        let end = self.ended_by.as_ref().map_or(stepper.t(), |ended| ended.t);
        if let Some(times) = &self.plan.times {
            while let Some(&t) = times.get(self.next)
                && t <= end
            {
                self.sample(stepper, t);
                self.next += 1;
            }
        }
        // If an event ends the run, the values at the event are recorded in any case.
        let is_last = self.ended_by.is_some() && self.trajectory.t.last().is_none_or(|last| *last < end);
        if self.plan.times.is_none() || is_last {
            self.sample(stepper, end);
        }
        if let Some(observed) = &mut self.observed {
            observed.integrate(stepper, end);
        }
        if let Some(reducing) = &mut self.reducing {
            reducing.step(stepper, (begin, end), &self.trajectory.events[before..], &impulses);
        }
        if let Some(mut sampling) = self.sampling.take() {
            sampling.step(begin, end, |t, out| self.row(stepper, t, out));
            self.sampling = Some(sampling);
        }
        if let Some(statistics) = &mut self.statistics {
            statistics.step(stepper, (begin, end), &impulses);
        }
        Recorded { events: &self.trajectory.events[before..], switched }
    }

    /// Writes the fields of the trajectory at a time within the last step; no field may be an integral or a derivative.
    fn row(&mut self, stepper: &mut impl Stepper, t: f64, out: &mut [f64]) {
        let count = self.plan.names.len();
        let (outputs, own) = self.y.split_at_mut(count);
        stepper.values(t, outputs);
        if let Some(observed) = &mut self.observed {
            observed.define(t, outputs, &mut own[..self.plan.observables.definitions()]);
        }
        out.iter_mut().zip(&self.plan.fields).for_each(|(out, &place)| *out = self.y[place]);
    }

    /// Records the last events of the run, and the derivatives at its end, which need not be an output time; returns
    /// the last events.
    fn end(&mut self, stepper: &mut impl Stepper) -> &[Event] {
        let before = self.trajectory.events.len();
        stepper.last_events(&mut self.trajectory.events);
        if let Some(EndedBy { t, .. }) = &self.ended_by {
            self.trajectory.events.retain(|event| event.t <= *t);
        }
        let (t, own) = (stepper.t(), self.plan.names.len() + self.plan.observables.names.len());
        if t > self.trajectory.t.last().copied().unwrap_or(f64::NEG_INFINITY) {
            stepper.derivatives(t, &mut self.y[own..]);
        }
        self.trajectory.events.get(before..).unwrap_or_default()
    }

    fn sample(&mut self, stepper: &mut impl Stepper, t: f64) {
        let (outputs, own) = self.y.split_at_mut(self.plan.names.len());
        let (own, derivatives) = own.split_at_mut(self.plan.observables.names.len());
        stepper.derivatives(t, derivatives);
        stepper.outputs(t, outputs);
        if let Some(observed) = &mut self.observed {
            observed.write(stepper, t, outputs, own);
            let wrong = own.iter().position(|value| !value.is_finite());
            self.broken = self.broken.or(wrong.map(|place| (place, t)));
        }
        self.trajectory.t.push(t);
        for (field, &index) in self.trajectory.fields.iter_mut().zip(&self.plan.fields) {
            field.values.push(self.y[index]);
        }
    }

    /// Returns the failure if a user's definition, integral or monitor has no finite value, and removes the rows from
    /// that time on from the trajectory; otherwise `None`.
    fn not_finite(&mut self, stepper: &impl Stepper) -> Option<Failure> {
        let (name, t) = match (self.broken, self.observed.as_ref().and_then(Observed::lost)) {
            (Some((place, t)), _) => (self.plan.observables.names[place].as_str(), t),
            (None, Some(lost)) => (lost, stepper.t()),
            (None, None) => return None,
        };
        let Trajectory { t: times, fields, .. } = &mut self.trajectory;
        let rows = times.partition_point(|time| *time < t);
        times.truncate(rows);
        fields.iter_mut().for_each(|field| field.values.truncate(rows));
        let message = format!(
            "`{name}` is not finite at t = {t:?}: a division by zero, a function outside its domain, or a number too large"
        );
        let state = stepper.states().to_vec();
        Some(Failure { code: "not_finite".into(), message, time: stepper.t(), state })
    }
}
