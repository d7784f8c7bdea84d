//! The systems of the theory, each at a ladder of tolerances and steps: error against run time (work and precision; Hairer
//! and Wanner 1996, *Solving Ordinary Differential Equations II*, section IV.10), as a chapter a referee could repeat.

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

/// The tolerances of runs that choose their steps.
pub const TOLERANCES: [f64; 4] = [1e-3, 1e-5, 1e-7, 1e-9];
/// Fixed steps in the horizon. With one stage this is implicit Euler, the first-order time stepping of other programs.
pub const STEPS: [f64; 4] = [100.0, 400.0, 1600.0, 6400.0];
/// Finer fixed steps in the horizon, for methods whose answers are still wrong at all of [`STEPS`], as where a problem is
/// stiff.
pub const FINER_STEPS: [f64; 2] = [25_600.0, 102_400.0];
/// The error of the states from which an answer is wrong, whatever its tolerance or step.
pub const WRONG: f64 = 1e-2;
/// The most steps of a run.
const MOST_STEPS: u64 = 1_000_000;
/// An error that is rounding: a system whose every run is below proves nothing about methods.
const ROUNDING: f64 = 1e-11;
/// The name of first-order time stepping of equations with stages.
const IMPLICIT_EULER: &str = "1 stage at fixed steps";

/// What a report says of one system.
#[derive(Clone, Debug, Deserialize, Serialize)]
pub struct Chapter {
    /// The name of its example.
    pub name: String,
    /// The title of its example.
    pub title: String,
    /// Its equations, a line each.
    pub equations: Vec<String>,
    /// The specification as it was run, but for the method.
    pub specification: Value,
    /// The initial value of each state, by name.
    pub start: Vec<(String, f64)>,
    /// The smallest and the largest absolute tolerance of a state, as parts of the relative tolerance.
    pub atol: (f64, f64),
    /// The solution over time, in SVG.
    pub solution: String,
    /// Where the values from outside are from, where there are any.
    pub source: Option<Source>,
    /// A public thread in which another program was reported to fail on it.
    pub reported: Option<Reported>,
    /// What errors are measured against.
    pub reference: Reference,
    /// Whether the elements leave an error of which the values here are free: errors are those against the exact solution
    /// of the semidiscrete equations.
    pub semidiscrete: bool,
    /// Finer and coarser meshes, where there is one.
    pub meshes: Vec<Mesh>,
    /// The runs, a ladder for each method.
    pub ladders: Vec<Ladder>,
    /// Those of other programs.
    pub peers: Vec<Ladder>,
    /// Where and when it was measured.
    pub conditions: Conditions,
}

/// Runs that differ by their tolerance or step alone.
#[derive(Clone, Debug, Deserialize, Serialize)]
pub struct Ladder {
    /// The method; for another program with its name.
    pub method: String,
    /// From the coarsest.
    pub runs: Vec<Run>,
}

/// How a run ended.
#[derive(Clone, Copy, Debug, Deserialize, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Outcome {
    /// It reached the end.
    Completed,
    /// It was stopped when its time was over.
    Stopped,
    /// It could not go on.
    Failed,
    /// A coarser run of the ladder was stopped.
    NotTried,
}

/// One run.
#[derive(Clone, Debug, Deserialize, Serialize)]
pub struct Run {
    /// Its relative tolerance.
    pub rtol: Option<f64>,
    /// Its step.
    pub step: Option<f64>,
    /// How it ended.
    pub outcome: Outcome,
    /// Whether its answer is trusted; absent for another program, which gives no verdict.
    pub trusted: Option<bool>,
    /// Accepted steps.
    pub steps: u64,
    /// The median run time in seconds.
    pub seconds: f64,
    /// The least and the largest of the repeats.
    pub spread: (f64, f64),
    /// Its errors; absent where it did not reach the end.
    pub errors: Option<Errors>,
    /// The power of the step, or of the tolerance, by which the error at the end changed from the run before.
    pub change: Option<f64>,
    /// Why it has no answer.
    pub message: Option<String>,
}

/// Errors as parts of the largest value of each output; absent where there is nothing to compare.
#[derive(Clone, Debug, Default, Deserialize, Serialize)]
pub struct Errors {
    /// Of the states at the end; where values from outside are known, of these.
    pub end: Option<f64>,
    /// The largest of the states over time.
    pub states: Option<f64>,
    /// The largest of all other outputs over time: variables, forces, energies.
    pub variables: Option<f64>,
    /// The distance between the switch times of the run and of the reference (Hausdorff), as a part of the horizon: the
    /// largest distance of a switch of either from the nearest of the other, so that a lost switch counts, and one too
    /// many.
    pub switches: Option<f64>,
    /// Switches of the run.
    pub switches_found: Option<usize>,
}

impl Errors {
    /// The larger of the errors of states at the end and over time.
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

    fn not_tried(rung: Rung) -> Self {
        Self { outcome: Outcome::NotTried, ..Self::at(rung) }
    }

    /// The same with its times.
    fn timed(self, mut times: Vec<f64>) -> Self {
        times.sort_by(f64::total_cmp);
        let (Some(&least), Some(&most)) = (times.first(), times.last()) else { return self };
        Self { seconds: times[times.len() / 2], spread: (least, most), ..self }
    }
}

/// Runs all of one system. `None` where no ladder fits it.
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

/// The specification of a system as the report compares its runs: whatever ends a run or is asked for beside it is left out.
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

/// The same as a study with the values that are known from outside, if there are any.
fn with_exact_values(mut document: Value, known: &Known) -> Option<Value> {
    if !known.exact.is_empty() {
        let horizon = document["time"]["end"].as_f64()? - document["time"]["start"].as_f64().unwrap_or(0.0);
        document["study"] = json!({"step": [horizon], "exact": known.exact});
    }
    Some(document)
}

/// Points of a curve of the picture of a solution.
const POINTS: u32 = 401;

/// The picture of the solution as its author asks for it, without a title: that stands above.
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
    /// The runs here and those of other programs.
    pub fn all(&self) -> impl Iterator<Item = &Ladder> {
        self.ladders.iter().chain(&self.peers)
    }

    /// Whether values from outside stand behind the errors.
    pub fn outside(&self) -> bool {
        self.source.is_some()
    }

    /// Whether implicit Euler solves it to rounding at every step: a check of a method, but no proof of another.
    pub fn is_exact_for_all(&self) -> bool {
        let first = self.ladders.iter().find(|ladder| ladder.method == IMPLICIT_EULER);
        first.is_some_and(|ladder| {
            ladder.runs.iter().all(|run| {
                let errors = run.errors.as_ref();
                errors.and_then(Errors::of_states).is_some_and(|error| error < ROUNDING)
            })
        })
    }

    /// Whether the loosest tolerance solves it to rounding already, as where the solution is a polynomial of low degree
    /// between switches: the runs show that switches are located, and nothing of the order of the method.
    pub fn is_exact_between_switches(&self) -> bool {
        let first = chosen(self).and_then(|ladder| ladder.runs.first()).and_then(|run| run.errors.as_ref());
        first.and_then(Errors::of_states).is_some_and(|error| error < ROUNDING)
    }

    /// The number of trusted answers, and the number of runs of the system that reached the end.
    pub fn trusted(&self) -> (usize, usize) {
        let ended = self.ladders.iter().flat_map(|ladder| &ladder.runs).filter(|run| run.outcome == Outcome::Completed);
        ended.filter_map(|run| run.trusted).fold((0, 0), |(trusted, all), one| (trusted + usize::from(one), all + 1))
    }

    /// The number of runs without an answer, and the number of all runs that were tried.
    pub fn lost(ladders: &[Ladder]) -> (usize, usize) {
        let runs = || ladders.iter().flat_map(|ladder| &ladder.runs).filter(|run| run.outcome != Outcome::NotTried);
        (runs().filter(|run| run.outcome != Outcome::Completed).count(), runs().count())
    }

    /// Its rows as CSV, with a header.
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
                // Writing to a string does not fail.
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

    /// The parameters of the problem, as its author wrote them.
    pub fn parameters(&self) -> Option<&Map<String, Value>> {
        let problem = self.specification.get("problem")?.as_object()?.values().next()?;
        problem.get("parameters")?.as_object()
    }
}
