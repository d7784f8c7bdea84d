//! Runs a stepper from start to end: outputs, limits, events, evidence. Written once, outside the methods.

use super::{
    Contraction, Diagnostics, Evaluations, Event, EventKind, Face, Failure, Field, Outputs, Solution, Status, Steps,
    Trajectory, Tried, ViCounts, Warning, global_error,
};
use crate::analysis::{Analysis, Uniqueness, analyse_face};
use crate::problem::{Control, Dvi, Mass, Stop, Structure};
use crate::radau::{Cause, Place, Radau, Settings, StageChoice, StepError, Switch, Switches, Variables};
use crate::vi::Attempt;
use std::ops::Range;
use std::time::Instant;

/// The faces that are analysed in one run.
const MOST_FACES: usize = 16;

/// What to run and what to keep of it.
#[derive(Clone, Debug)]
pub struct Plan {
    /// The names of the states, then of the variables, then of the outputs.
    pub names: Vec<String>,
    /// What is told beside states and variables.
    pub outputs: Outputs,
    /// The initial states.
    pub initial: Vec<f64>,
    /// The time to start from.
    pub start: f64,
    /// The time to reach.
    pub end: f64,
    /// The times to report at, increasing, within `[start, end]`; none is at every step.
    pub times: Option<Vec<f64>>,
    /// The fields to keep, as indices into `names`.
    pub fields: Vec<usize>,
    /// What the theory says of the problem at the start.
    pub analysis: Analysis,
    /// The choices of the method.
    pub settings: Settings,
    /// Whether the error at the end is to be estimated.
    pub global_error: bool,
    /// The most steps.
    pub most_steps: u64,
    /// The most numbers in the trajectory.
    pub most_values: usize,
}

/// A run, and the states where it ended.
pub(super) struct Ended {
    pub solution: Solution,
    pub x: Vec<f64>,
}

/// Integrates; whatever happens, the trajectory so far is in the answer.
pub fn integrate(problem: &mut dyn Dvi, plan: &Plan, control: &Control) -> Solution {
    let share = if plan.global_error { global_error::SHARE } else { 1.0 };
    let mut ended = run_to_end(problem, plan, control, 0.0..share);
    if plan.global_error && ended.solution.status == Status::Completed {
        global_error::estimate(problem, plan, control, &mut ended);
    }
    ended.solution
}

/// One run, which is the given part of all the progress.
pub(super) fn run_to_end(problem: &mut dyn Dvi, plan: &Plan, control: &Control, part: Range<f64>) -> Ended {
    let began = Instant::now();
    let mut recorder = Recorder::new(plan);
    let mut diagnostics = describe(problem.structure(), plan);
    let mut x = plan.initial.clone();
    let (status, error) = match Radau::new(problem, plan.settings.clone(), plan.start, &plan.initial, plan.end, control)
    {
        Ok(mut radau) => {
            let ended = run(&mut radau, plan, control, part, &mut recorder, &mut diagnostics);
            x.copy_from_slice(&radau.y()[..plan.initial.len()]);
            count(&mut radau, plan, &mut diagnostics);
            ended
        }
        Err(error) => end(control, plan.start, &plan.initial, || failure(plan, &error, plan.start, &plan.initial)),
    };
    diagnostics.switches = recorder.trajectory.events.len() as u64;
    diagnostics.wall_seconds = began.elapsed().as_secs_f64();
    Ended { solution: Solution { status, error, trajectory: recorder.trajectory, diagnostics }, x }
}

fn run(
    radau: &mut Radau<'_>,
    plan: &Plan,
    control: &Control,
    part: Range<f64>,
    recorder: &mut Recorder<'_>,
    diagnostics: &mut Diagnostics,
) -> (Status, Option<Failure>) {
    recorder.start(radau);
    while !radau.is_done() {
        if let Some((code, message)) = limit(radau, plan, control, recorder) {
            let state = radau.y()[..plan.initial.len()].to_vec();
            return (Status::Stopped, Some(Failure { code, message, time: radau.t(), state }));
        }
        if let Err(error) = radau.step() {
            let state = &radau.y()[..plan.initial.len()];
            return end(control, radau.t(), state, || failure(plan, &error, radau.t(), state));
        }
        let switched = recorder.step(radau);
        judge(radau, plan, switched, diagnostics);
        let done = (radau.t() - plan.start) / (plan.end - plan.start);
        control.report(part.start + done * (part.end - part.start), radau.counts.accepted);
    }
    (Status::Completed, None)
}

/// Takes the end of a step into the evidence; after a switch, the new face as well.
fn judge(radau: &mut Radau<'_>, plan: &Plan, switched: bool, diagnostics: &mut Diagnostics) {
    let smooth = radau.kept_face() && !switched && radau.problem().structure().moving.is_empty();
    if let Some(Variables { set, bounded, z, g }) = radau.variables() {
        let certificates = diagnostics.complementarity.get_or_insert_default();
        certificates.observe(set, bounded, z, g, smooth);
        if let Some(vi) = &mut diagnostics.vi {
            vi.largest_residual = certificates.natural_map;
        }
    }
    if switched && diagnostics.faces.len() < MOST_FACES {
        let n = plan.initial.len();
        let (t, y, face) = (radau.t(), radau.y().to_vec(), radau.face().clone());
        let names = |kind: fn(Place) -> bool| -> Vec<String> {
            let places = face.places.iter().enumerate().filter(|(_, place)| kind(**place));
            places.map(|(k, _)| plan.names[n + k].clone()).collect()
        };
        let inside = names(|place| place == Place::Inside);
        let on_boundary = names(|place| matches!(place, Place::Boundary(_)));
        if diagnostics.faces.iter().all(|known| (&known.inside, &known.on_boundary) != (&inside, &on_boundary)) {
            let blocks = radau.equations_of_blocks();
            let analysis = analyse_face(radau.problem(), t, &y, &blocks, |k| face.places[k] == Place::Inside);
            diagnostics.faces.push(Face { t, inside, on_boundary, analysis });
        }
    }
}

/// A step that could not be made: because the outside gave it no time, or because it failed.
fn end(control: &Control, t: f64, state: &[f64], failure: impl FnOnce() -> Failure) -> (Status, Option<Failure>) {
    match stopped(control, t) {
        Some((code, message)) => (Status::Stopped, Some(Failure { code, message, time: t, state: state.to_vec() })),
        None => (Status::Failed, Some(failure())),
    }
}

/// What the outside asks for, if it asks to stop: a code and a message.
fn stopped(control: &Control, t: f64) -> Option<(&'static str, String)> {
    Some(match control.poll()? {
        Stop::Cancelled => ("cancelled", format!("cancelled at t = {t:?}")),
        Stop::Deadline => {
            ("wall_time", format!("the wall time allowed ended at t = {t:?}; allow more with limits.wall_seconds"))
        }
    })
}

/// The limit that the run has reached, if any: its code and message.
fn limit(radau: &Radau<'_>, plan: &Plan, control: &Control, recorder: &Recorder<'_>) -> Option<(&'static str, String)> {
    let t = radau.t();
    if let Some(stopped) = stopped(control, t) {
        return Some(stopped);
    }
    if radau.counts.accepted >= plan.most_steps {
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
            format!("the trajectory holds {most} numbers at t = {t:?}; ask for fewer times or fields"),
        ));
    }
    None
}

fn failure(plan: &Plan, error: &StepError, time: f64, state: &[f64]) -> Failure {
    let message = match *error {
        StepError::NotFinite { what, component, t } => {
            let n = plan.initial.len();
            let name = match what {
                "rate" | "derivative of the rate" => plan.names.get(component),
                "inequality" | "derivative of the inequality" => plan.names.get(n + component),
                _ => None,
            };
            match name {
                Some(name) => format!(
                    "the {what} of `{name}` is not finite at t = {t:?}: a division by zero, a function outside its \
                     domain, or a number too large"
                ),
                None => error.to_string(),
            }
        }
        StepError::EmptySet { variable, t } => format!(
            "the interval of `{}` is empty from t = {t:?} on: its lower bound passes its upper bound",
            plan.names.get(plan.initial.len() + variable).map_or("?", String::as_str)
        ),
        StepError::NoSolution { variable, t } => format!(
            "the variational inequality has no solution at t = {t:?}: the inequality of `{}` fails whatever the variables are. \
             Raising a variable should raise its inequality, at once or in time: look at its sign, and whether the start \
             satisfies it",
            plan.names.get(plan.initial.len() + variable).map_or("?", String::as_str)
        ),
        StepError::InconsistentStart { state, jump } => format!(
            "the start is inconsistent: the constraints ask for a jump of `{}` by {jump:e}",
            plan.names.get(state).map_or("?", String::as_str)
        ),
        _ => error.to_string(),
    };
    Failure { code: error.code(), message, time, state: state.to_vec() }
}

/// What is known before the run: what the theory says, what is built, what is left out and why.
pub fn describe(structure: &Structure, plan: &Plan) -> Diagnostics {
    let bounded = (0..structure.variables).any(|k| !structure.set.is_free(k)) || !structure.moving.is_empty();
    let analysis = Some(plan.analysis.clone());
    let mut diagnostics = Diagnostics { method: "radau", built: vec!["radau"], analysis, ..Diagnostics::default() };
    if !matches!(plan.analysis.uniqueness, Uniqueness::Unique | Uniqueness::NotAnalysed) {
        let message = format!("uniqueness is not guaranteed: {}", plan.analysis.because);
        diagnostics.warnings.push(Warning { code: "uniqueness_not_guaranteed", message });
    }
    if plan.analysis.index == Some(2) && !structure.constant_jacobian {
        let message = "the index at the start is 2 (CB = 0): bounds may be crossed, but where one is reached and kept the \
                       states jump; implicit Euler takes that in its stride (`\"stages\": 1` with a fixed `step`)";
        diagnostics.warnings.push(Warning { code: "index_two", message: message.to_owned() });
    }
    let mut leave = |what: &str| diagnostics.left_out.push(what.to_owned());
    if structure.variables == 0 {
        leave("variational inequality: there are no variables");
    } else if !bounded {
        leave("variational inequality: every variable is free, so G = 0");
        leave("switch detection: K is the whole space");
    }
    if structure.mass == Mass::Identity {
        leave("mass matrix: it is the identity");
    }
    if structure.constant_jacobian {
        leave("new Jacobians: the problem is linear");
    }
    if plan.settings.step.is_some() {
        leave("error estimate: the step is fixed");
    }
    if bounded {
        diagnostics.built.push("variational inequality");
        diagnostics.vi = Some(ViCounts::default());
        match plan.settings.switches {
            Switches::Locate => diagnostics.built.push("switch detection"),
            Switches::StepOver => {
                diagnostics.left_out.push("switch detection: step_over was asked for".to_owned());
            }
        }
    }
    if plan.settings.stages == StageChoice::Auto {
        diagnostics.built.push("order selection");
    }
    diagnostics
}

/// Takes over the counters of a run.
fn count(radau: &mut Radau<'_>, plan: &Plan, diagnostics: &mut Diagnostics) {
    let (counts, work) = (radau.counts, radau.work());
    diagnostics.stages = radau.stages();
    diagnostics.steps = Steps {
        accepted: counts.accepted,
        rejected: Cause::ALL.into_iter().map(|cause| counts.rejected(cause)).sum(),
        rejected_for: Cause::ALL
            .into_iter()
            .map(|cause| (cause.name(), counts.rejected(cause)))
            .filter(|(_, times)| *times > 0)
            .collect(),
    };
    diagnostics.evaluations =
        Evaluations { rates: work.rates, jacobians: work.jacobians, factorisations: work.factorisations };
    diagnostics.newton_iterations = work.newton;
    diagnostics.newton_contraction = work.contraction.summary().map(|(mean, largest)| Contraction { mean, largest });
    if let (Some(counts), Some(work)) = (&mut diagnostics.vi, radau.vi_work()) {
        (counts.solver, counts.solves, counts.pivots) = work;
        let tried = |(attempt, times): (Attempt, u64)| Tried {
            solver: attempt.solver.name(),
            outcome: attempt.outcome.name(),
            times,
        };
        counts.tried = radau.vi_failures().map(tried).collect();
    }
    if let Some(t) = radau.jumped() {
        diagnostics.warnings.push(Warning {
            code: if t == plan.start { "initial_jump" } else { "jump" },
            message: format!(
                "the state at t = {t:?} is outside what the inequalities allow; it jumped at once, by the impulse x+ = x + B p \
                 with p in K complementary to G(x+)"
            ),
        });
    }
    if radau.accumulations() > 0 {
        diagnostics.warnings.push(Warning {
            code: "switches_accumulate",
            message: format!(
                "switches followed each other ever faster ({} times); the run went on across them with the variational \
                 inequality at every stage and without locating them",
                radau.accumulations()
            ),
        });
    }
}

/// Puts the outputs asked for into columns.
struct Recorder<'a> {
    plan: &'a Plan,
    trajectory: Trajectory,
    /// The next of the times asked for.
    next: usize,
    /// Whatever can be told at one time.
    y: Vec<f64>,
    outputs: Outputs,
}

impl<'a> Recorder<'a> {
    fn new(plan: &'a Plan) -> Self {
        let capacity = plan.times.as_ref().map_or(0, Vec::len);
        let fields = plan
            .fields
            .iter()
            .map(|&index| Field { name: plan.names[index].clone(), values: Vec::with_capacity(capacity) })
            .collect();
        let trajectory = Trajectory { t: Vec::with_capacity(capacity), fields, events: Vec::new() };
        Self { plan, trajectory, next: 0, y: vec![0.0; plan.names.len()], outputs: plan.outputs.clone() }
    }

    fn values(&self) -> usize {
        self.trajectory.t.len() * (1 + self.trajectory.fields.len()) + self.trajectory.events.len()
    }

    fn start(&mut self, radau: &mut Radau<'_>) {
        radau.take_switches();
        match &self.plan.times {
            None => self.sample(radau, self.plan.start),
            Some(times) => {
                while times.get(self.next).is_some_and(|&t| t <= self.plan.start) {
                    self.sample(radau, times[self.next]);
                    self.next += 1;
                }
            }
        }
    }

    /// Takes over the outputs and the switches of the last step; whether there were any switches.
    fn step(&mut self, radau: &mut Radau<'_>) -> bool {
        let n = self.plan.initial.len();
        let events = self.trajectory.events.len();
        for Switch { t, variable, from, to } in radau.take_switches() {
            let freer = to.equations() < from.equations();
            let kind = if freer { EventKind::Activated } else { EventKind::Deactivated };
            self.trajectory.events.push(Event { t, kind, of: self.plan.names[n + variable].clone() });
        }
        let end = radau.t();
        let Some(times) = &self.plan.times else {
            self.sample(radau, end);
            return self.trajectory.events.len() > events;
        };
        while let Some(&t) = times.get(self.next)
            && t <= end
        {
            self.sample(radau, t);
            self.next += 1;
        }
        self.trajectory.events.len() > events
    }

    fn sample(&mut self, radau: &mut Radau<'_>, t: f64) {
        let unknowns = self.y.len() - self.outputs.names.len();
        radau.interpolate(t, &mut self.y[..unknowns]);
        self.outputs.append(t, &mut self.y);
        self.trajectory.t.push(t);
        for (field, &index) in self.trajectory.fields.iter_mut().zip(&self.plan.fields) {
            field.values.push(self.y[index]);
        }
    }
}
