//! Work-precision report (Hairer and Wanner 1996, *Solving Ordinary Differential Equations II*, section IV.10): runs
//! each example system at a series of tolerances and step sizes, and records error against run time in one chapter
//! per system, with all settings needed to repeat the runs.

mod conditions;
mod known;
mod measure;
mod mesh;
mod peer;
mod pictures;
mod reference;

pub use conditions::Conditions;
pub use known::{Reported, Source};
pub use measure::{LONG, LONGEST, REPEATS};
pub use mesh::Mesh;
pub use peer::{Answer, request};
pub use pictures::{chapter_picture, chosen, first_order, picture};
pub use reference::Reference;

use crate::solve::solve_once;
use known::Known;
use problem::Control;
use serde::{Deserialize, Serialize};
use serde_json::{Map, Value, json};
use solution::pictures::write_svg;
use specification::{By, Example, Rung, Specification};
use std::fmt::Write as _;
use std::time::Instant;

/// Relative tolerances of the runs with adaptive steps.
pub const TOLERANCES: [f64; 4] = [1e-3, 1e-5, 1e-7, 1e-9];
/// Numbers of fixed steps in the time horizon. One-stage Radau IIA at fixed steps is implicit Euler, the first-order
/// time stepping of other programs.
pub const STEPS: [f64; 4] = [100.0, 400.0, 1600.0, 6400.0];
/// Numbers of further, smaller fixed steps in the time horizon, for methods whose answers are wrong at all of
/// [`STEPS`], for instance because the problem is stiff.
pub const FINER_STEPS: [f64; 2] = [25_600.0, 102_400.0];
/// The relative error of the states above which an answer counts as wrong, whatever its tolerance or step size.
pub const WRONG: f64 = 1e-2;
/// Largest number of steps of a run of the report.
const MOST_STEPS: u64 = 1_000_000;
/// Relative error at the level of rounding. A system that implicit Euler solves to a smaller error at every step size
/// does not distinguish methods.
const ROUNDING: f64 = 1e-11;
/// Method name of implicit Euler: one Radau IIA stage at fixed steps.
const IMPLICIT_EULER: &str = "1 stage at fixed steps";

/// Results of the report for one example system.
#[derive(Clone, Debug, Deserialize, Serialize)]
pub struct Chapter {
    /// Name of the example.
    pub name: String,
    /// Title of the example system.
    pub title: String,
    /// Equations of the example system, one line each.
    pub equations: Vec<String>,
    /// Specification of the runs of the system, except for the method.
    pub specification: Value,
    /// The initial value of each state of the system, by name.
    pub start: Vec<(String, f64)>,
    /// The smallest and the largest absolute tolerance of a state, as parts of the relative tolerance.
    pub atol: (f64, f64),
    /// Plot of the solution of the system over time, in SVG.
    pub solution: String,
    /// Source of the reference values from outside this program, if there are any.
    pub source: Option<Source>,
    /// Public thread that reports a failure of another program on the system, if there is one.
    pub reported: Option<Reported>,
    /// Reference solution that errors are measured against.
    pub reference: Reference,
    /// Whether errors are measured against the exact solution of the semidiscrete equations, so that they exclude the
    /// discretisation error in space.
    pub semidiscrete: bool,
    /// Results on finer and coarser meshes, if the system has a mesh.
    pub meshes: Vec<Mesh>,
    /// Runs of this program: for each method one ladder, a series of runs from coarse to fine.
    pub ladders: Vec<Ladder>,
    /// Runs of other programs: for each method one ladder, a series of runs from coarse to fine.
    pub peers: Vec<Ladder>,
    /// Conditions (machine, program and date) of the measurement.
    pub conditions: Conditions,
}

/// A ladder: runs of one method that differ in their tolerance or step size alone.
#[derive(Clone, Debug, Deserialize, Serialize)]
pub struct Ladder {
    /// Name of the method; for another program, with the name of the program.
    pub method: String,
    /// The runs of the method, from the coarsest tolerance or step size to the finest.
    pub runs: Vec<Run>,
}

/// How a run of the report ended.
#[derive(Clone, Copy, Debug, Deserialize, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Outcome {
    /// The run reached its end time.
    Completed,
    /// The run was stopped at its time limit.
    Stopped,
    /// The run failed before its end time.
    Failed,
    /// The run was skipped because a coarser run of the ladder was stopped.
    NotTried,
}

/// Settings and results of one run.
#[derive(Clone, Debug, Deserialize, Serialize)]
pub struct Run {
    /// Relative tolerance of the run; `None` for a run with fixed steps.
    pub rtol: Option<f64>,
    /// Fixed step size of the run; `None` for a run with adaptive steps.
    pub step: Option<f64>,
    /// How the run ended: at the end time, at its time limit, or with a failure.
    pub outcome: Outcome,
    /// Whether the verdict trusts the answer; absent for another program, which gives no verdict.
    pub trusted: Option<bool>,
    /// Number of accepted steps of the run.
    pub steps: u64,
    /// Median run time of the repeats of the run, in seconds.
    pub seconds: f64,
    /// Smallest and largest run time of the repeats of the run, in seconds.
    pub spread: (f64, f64),
    /// Errors of the run; absent if it did not reach the end time.
    pub errors: Option<Errors>,
    /// Observed order: exponent of the step size, or of the tolerance, with which the error at the end changed from
    /// the previous run.
    pub change: Option<f64>,
    /// Why the run has no answer, as a message.
    pub message: Option<String>,
}

/// Errors of a run against the reference, relative to the largest value of each output; absent where there is nothing
/// to compare.
#[derive(Clone, Debug, Default, Deserialize, Serialize)]
pub struct Errors {
    /// Largest error at the end time: of the outputs whose values at the end are known from outside this program, else
    /// of the states.
    pub end: Option<f64>,
    /// Largest error of the states over the comparison times.
    pub states: Option<f64>,
    /// Largest error over the comparison times of all other outputs: variables, forces, energies.
    pub variables: Option<f64>,
    /// Hausdorff distance between the switching times of the run and of the reference, relative to the horizon: the
    /// largest distance of a switch of either from the nearest of the other, so that a lost switch counts, and one too
    /// many.
    pub switches: Option<f64>,
    /// Number of switches (events) that the run found.
    pub switches_found: Option<usize>,
}

impl Errors {
    /// The larger of the errors of the states at the end and over time.
    pub fn of_states(&self) -> Option<f64> {
        self.end.into_iter().chain(self.states).reduce(f64::max)
    }
}

impl Run {
    fn at(rung: Rung) -> Self {
        let (rtol, step) = match rung {
            Rung::Tolerance(rtol) => (Some(rtol), None),
            Rung::Step(step) => (None, Some(step)),
        };
        Self {
            rtol,
            step,
            outcome: Outcome::Failed,
            trusted: None,
            steps: 0,
            seconds: 0.0,
            spread: (0.0, 0.0),
            errors: None,
            change: None,
            message: None,
        }
    }

    /// Whether the errors of the states are at the level of rounding, at the end and over time.
    fn is_exact(&self) -> bool {
        let both = self.errors.as_ref().and_then(|errors| Some(errors.end?.max(errors.states?)));
        both.is_some_and(|error| error < ROUNDING)
    }

    fn not_tried(rung: Rung) -> Self {
        Self { outcome: Outcome::NotTried, ..Self::at(rung) }
    }

    /// Sets the median run time of the run and the spread from the times of its repeats, in seconds.
    fn timed(self, mut times: Vec<f64>) -> Self {
        times.sort_by(f64::total_cmp);
        let (Some(&least), Some(&most)) = (times.first(), times.last()) else { return self };
        Self { seconds: times[times.len() / 2], spread: (least, most), ..self }
    }
}

/// Measures all ladders (series of runs of one method, from coarse to fine) of one system. Returns `None` if the
/// problem type of the system has no ladders, or if the system is a sweep or a search.
pub fn chapter(example: &Example, date: &str) -> Option<Chapter> {
    let known = known::known(example.name);
    let shown = shown(example, &known)?;
    let document = with_exact_values(shown.clone(), &known)?;
    let specification = Specification::from_json(document.to_string().as_bytes()).ok()?;
    let ladders = specification.model().varied().ladders;
    if ladders.is_empty() || specification.sweep().is_some() || specification.search().is_some() {
        return None;
    }
    let horizon = specification.time().end - specification.time().start;
    let steps = STEPS.map(|steps| Rung::Step(horizon / steps));
    let finer = FINER_STEPS.map(|steps| Rung::Step(horizon / steps));
    let tolerances = TOLERANCES.map(Rung::Tolerance);
    let reference = Reference::new(&specification, &known, horizon / STEPS[STEPS.len() - 1])?;
    let own = [specification.method().stages];
    let of_ladder = |ladder: &specification::Ladder| {
        let (rungs, finer): (_, &[Rung]) = if ladder.by == By::Tolerance { (tolerances, &[]) } else { (steps, &finer) };
        let stages = if ladder.stages.is_empty() { &own } else { ladder.stages };
        let name = |stages| specification.model().method_name(stages) + ladder.name;
        let run = |&stages| measure::ladder(name(stages), &specification, (&rungs, finer), stages, &reference);
        stages.iter().map(run).collect::<Vec<_>>()
    };
    let ladders = ladders.iter().flat_map(of_ladder).collect();
    let states = specification.model().output_names().into_iter();
    let start = states.zip(specification.model().initial().iter().copied()).collect();
    let rtol = specification.method().rtol;
    let parts = || specification.absolute_tolerances().iter().map(|atol| atol / rtol);
    let atol = (parts().fold(f64::INFINITY, f64::min), parts().fold(0.0, f64::max));
    Some(Chapter {
        name: example.name.to_owned(),
        title: specification.label().unwrap_or(example.name).to_owned(),
        solution: drawn(&shown),
        meshes: if known.mesh { mesh::meshes(&shown, &known) } else { Vec::new() },
        semidiscrete: known.mesh,
        specification: shown,
        start,
        atol,
        equations: known.equations,
        source: known.source,
        reported: known.reported,
        reference,
        ladders,
        peers: Vec::new(),
        conditions: Conditions::here(date.to_owned()),
    })
}

/// Returns the specification of a system as the report runs it, without sensitivities, output settings, study and
/// events that end a run.
fn shown(example: &Example, known: &Known) -> Option<Value> {
    let mut document: Value = serde_json::from_str(example.text).ok()?;
    let root = document.as_object_mut()?;
    for key in ["sensitivities", "output", "study"] {
        root.remove(key);
    }
    if let Some(Value::Array(monitors)) = root.get_mut("stop") {
        monitors.retain(|monitor| monitor["record"] == true);
    }
    if let Some(end) = known.end {
        document["time"]["end"] = end.into();
    }
    Some(document)
}

/// Adds a study with the values of outputs known from outside this program, if there are any.
fn with_exact_values(mut document: Value, known: &Known) -> Option<Value> {
    if !known.exact.is_empty() {
        let horizon = document["time"]["end"].as_f64()? - document["time"]["start"].as_f64().unwrap_or(0.0);
        document["study"] = json!({"step": [horizon], "exact": known.exact});
    }
    Some(document)
}

/// Number of points of a curve in the plot of a solution.
const POINTS: u32 = 401;

/// Solves the specification with its own method and returns a plot of the solution in SVG, without a title.
fn drawn(document: &Value) -> String {
    let mut document = document.clone();
    document["output"] = json!({"times": {"count": POINTS}});
    let Ok(specification) = Specification::from_json(document.to_string().as_bytes()) else { return String::new() };
    let solution = solve_once(&specification, &Control::with_deadline(Instant::now() + LONGEST));
    let mut picture = Vec::new();
    match write_svg(&solution, None, &mut picture) {
        Ok(()) => String::from_utf8(picture).unwrap_or_default(),
        Err(_) => String::new(),
    }
}

impl Chapter {
    /// Returns the series of runs of all methods, those of this program before those of other programs.
    pub fn all(&self) -> impl Iterator<Item = &Ladder> {
        self.ladders.iter().chain(&self.peers)
    }

    /// Whether errors of the system are measured against values from outside this program.
    pub fn outside(&self) -> bool {
        self.source.is_some()
    }

    /// Whether implicit Euler solves the system to rounding error at every step size: such a system can reveal a
    /// faulty method, but does not rank methods.
    pub fn is_exact_for_all(&self) -> bool {
        let first = self.ladders.iter().find(|ladder| ladder.method == IMPLICIT_EULER);
        first.is_some_and(|ladder| ladder.runs.iter().all(Run::is_exact))
    }

    /// Whether the loosest tolerance already solves the system to rounding error, for instance because the solution
    /// is a polynomial of low degree between switches. The runs of such a system show that switches are located, but
    /// not the order of the method.
    pub fn is_exact_between_switches(&self) -> bool {
        chosen(self).and_then(|ladder| ladder.runs.first()).is_some_and(Run::is_exact)
    }

    /// Returns the number of trusted answers, and the number of runs of this program that reached the end.
    pub fn trusted(&self) -> (usize, usize) {
        let ended = self.ladders.iter().flat_map(|ladder| &ladder.runs).filter(|run| run.outcome == Outcome::Completed);
        ended.filter_map(|run| run.trusted).fold((0, 0), |(trusted, all), one| (trusted + usize::from(one), all + 1))
    }

    /// Returns the number of runs of the ladders without an answer, and the number of all runs that were tried.
    pub fn lost(ladders: &[Ladder]) -> (usize, usize) {
        let runs = || ladders.iter().flat_map(|ladder| &ladder.runs).filter(|run| run.outcome != Outcome::NotTried);
        (runs().filter(|run| run.outcome != Outcome::Completed).count(), runs().count())
    }

    /// Returns the runs of the system as rows of CSV, with a header.
    pub fn csv(&self) -> String {
        let mut text = String::from(
            "system,method,rtol,step,outcome,trusted,steps,seconds,least_seconds,most_seconds,error_at_end,error_of_states,\
             error_of_variables,error_of_switch_times,switches,power\n",
        );
        for ladder in self.all() {
            for run in &ladder.runs {
                let cell = |value: Option<f64>| value.map_or_else(String::new, |value| value.to_string());
                let errors = run.errors.clone().unwrap_or_default();
                let outcome = json!(run.outcome);
                // Writing to a string cannot fail.
                let _ = writeln!(
                    text,
                    "{},\"{}\",{},{},{},{},{},{},{},{},{},{},{},{},{},{}",
                    self.name,
                    ladder.method.replace('"', "\"\""),
                    cell(run.rtol),
                    cell(run.step),
                    outcome.as_str().unwrap_or_default(),
                    run.trusted.map_or_else(String::new, |trusted| trusted.to_string()),
                    run.steps,
                    run.seconds,
                    run.spread.0,
                    run.spread.1,
                    cell(errors.end),
                    cell(errors.states),
                    cell(errors.variables),
                    cell(errors.switches),
                    errors.switches_found.map_or_else(String::new, |count| count.to_string()),
                    cell(run.change),
                );
            }
        }
        text
    }

    /// Returns the parameters of the problem, as the author of the specification wrote them.
    pub fn parameters(&self) -> Option<&Map<String, Value>> {
        let problem = self.specification.get("problem")?.as_object()?.values().next()?;
        problem.get("parameters")?.as_object()
    }
}
