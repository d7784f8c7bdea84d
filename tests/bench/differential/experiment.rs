//! The runs of one problem: at two tolerances, with every number of stages, in other units, to a later end, with output
//! at the steps and between them, and from perturbed initial values, which measure the growth of small perturbations.

use super::problem::{Field, Problem, View, Way};
use super::random::Random;
use super::reference::Values;
use super::solving::{Answer, Outcome, solve};
use serde_json::{Map, Value, json};
use std::cell::Cell;
use std::time::Duration;

/// One run of a problem, with its label.
#[derive(Clone, Debug)]
pub struct Run {
    pub label: String,
    /// The relative tolerance of the run, or its step size.
    pub accuracy: f64,
    pub specification: Value,
    pub outcome: Outcome,
}

impl Run {
    pub fn answer(&self) -> Option<&Answer> {
        match &self.outcome {
            Outcome::Answered(answer) => Some(answer),
            _ => None,
        }
    }
}

/// The runs of a problem, with the scales by which their differences are measured.
#[derive(Clone, Debug)]
pub struct Experiment {
    pub way: Way,
    pub fields: Vec<Field>,
    pub end: f64,
    /// The times at which the runs are compared with each other.
    pub times: Vec<f64>,
    /// The largest magnitude of each field, and its largest rate of change.
    pub sizes: Vec<f64>,
    pub rates: Vec<f64>,
    /// The absolute tolerance of each field, as a multiple of the relative tolerance.
    pub floors: Vec<f64>,
    pub runs: Vec<Run>,
    /// The growth factor of a small perturbation of the initial values: at least one, infinite if it could not be
    /// measured.
    pub kappa: f64,
    pub reference: Option<Values>,
}

/// Seed and limits for the runs of one problem.
pub struct Conditions {
    pub seed: u64,
    /// The time limit of each solve.
    pub time: Duration,
    /// Whether the problem is also solved by an independent method.
    pub reference: bool,
}

/// Numbers of comparison times: ends of steps of the first run (`ON_STEPS`), and random times (`ANYWHERE`).
const ON_STEPS: usize = 10;
const ANYWHERE: usize = 14;
/// Number of random comparison times of a time-stepping method. It is larger, since the errors of such a method at
/// impacts may last for a small part of the run only.
const ANYWHERE_OF_STEPS: usize = 200;
/// Absolute tolerance of a field, relative to `rtol` and the scale of the problem.
const FLOOR: f64 = 1e-3;
/// Ratio of the tolerance of the first run to that of the tight run, whose tolerance is the smallest.
const TIGHTER: f64 = 100.0;
/// Smallest relative perturbation of the initial values: smaller ones are lost in rounding.
const LEAST_CHANGE: f64 = 1e-7;

/// Number of runs of a problem that may exceed the time limit before the remaining runs are skipped.
const MOST_LATE: u32 = 2;

/// Writes the specifications of one problem and solves them.
struct Maker<'a> {
    problem: &'a dyn Problem,
    way: Way,
    fields: Vec<Field>,
    floors: Vec<f64>,
    time: Duration,
    /// The number of runs so far that exceeded the time limit.
    late: Cell<u32>,
}

/// Settings in which the runs of one problem differ.
#[derive(Clone)]
struct Variant<'a> {
    label: &'a str,
    accuracy: f64,
    stages: Value,
    view: View,
    end: f64,
    /// The output times; if empty, the ends of steps.
    times: &'a [f64],
}

impl Maker<'_> {
    fn run(&self, variant: &Variant<'_>) -> Run {
        let skips = self.late.get() >= MOST_LATE;
        let Variant { label, accuracy, stages, view, end, times } = variant;
        let end = end / view.time;
        let mut method = Map::new();
        match self.way {
            Way::Step(_) => {
                method.insert("step".to_owned(), json!(accuracy / view.time));
                method.insert("impacts".to_owned(), json!("time_stepping"));
            }
            Way::Stages => {
                method.insert("rtol".to_owned(), json!(accuracy));
                method.insert("stages".to_owned(), stages.clone());
                let atol: Map<String, Value> = (self.fields.iter().zip(&self.floors))
                    .map(|(field, floor)| (field.name.clone(), json!(floor * accuracy / field.unit(view))))
                    .collect();
                method.insert("atol".to_owned(), atol.into());
            }
            Way::Tolerance | Way::Mean => {
                method.insert("rtol".to_owned(), json!(accuracy));
                method.insert("atol".to_owned(), json!(self.floors[0] * accuracy / self.fields[0].unit(view)));
            }
        }
        let mut output = Map::new();
        if !times.is_empty() {
            let times: Vec<f64> = times.iter().map(|t| (t / view.time).min(end)).collect();
            output.insert("times".to_owned(), json!(times));
        }
        let names: Vec<&str> = self.fields.iter().map(|field| field.name.as_str()).collect();
        output.insert("fields".to_owned(), json!(names));
        let specification = json!({
            "problem": self.problem.document(view), "time": {"end": end}, "method": method, "output": output
        });
        let outcome = if skips { Outcome::Skipped } else { solve(&specification, &self.fields, view, self.time) };
        if matches!(outcome, Outcome::Stopped(_) | Outcome::Hung) {
            self.late.set(self.late.get() + 1);
        }
        Run { label: (*label).to_owned(), accuracy: *accuracy, specification, outcome }
    }
}

/// Solves a problem with all variants of settings, and measures the growth of perturbations.
pub fn experiment(problem: &dyn Problem, conditions: &Conditions) -> Experiment {
    let mut random = Random::new(conditions.seed ^ 0x5bd1_e995);
    let (way, fields, end) = (problem.way(), problem.fields(), problem.end());
    // The absolute tolerance of a velocity is that of a length, divided by a tenth of the end time.
    let floors: Vec<f64> =
        fields.iter().map(|field| FLOOR * problem.smallest() * (0.1 * end).powi(field.time)).collect();
    let maker = Maker {
        problem,
        way,
        fields: fields.clone(),
        floors: floors.clone(),
        time: conditions.time,
        late: Cell::new(0),
    };
    let (accuracy, tight) = match way {
        Way::Step(step) => (step, step / 4.0),
        // The solver for problems with memory is of first order in the step: a tolerance tighter by two decades would
        // take a hundred times as long.
        Way::Mean => {
            let rtol = random.scale(3e-4, 1e-2);
            (rtol, rtol / 4.0)
        }
        _ => {
            let rtol = random.scale(1e-8, 1e-4);
            (rtol, rtol / TIGHTER)
        }
    };
    let stages = [json!(3), json!(5), json!(7), json!("auto")];
    let any = |random: &mut Random| random.choose(&stages).clone();
    let plain = Variant { label: "steps", accuracy, stages: any(&mut random), view: View::default(), end, times: &[] };
    let first = maker.run(&plain);
    let anywhere = if matches!(way, Way::Step(_)) { ANYWHERE_OF_STEPS } else { ANYWHERE };
    let mut times: Vec<f64> = (0..anywhere).map(|_| end * random.uniform(0.0, 1.0)).collect();
    let mut rates = vec![0.0_f64; fields.len()];
    if let Some(Answer { t, columns, .. }) = first.answer() {
        times.extend((0..ON_STEPS).map(|_| *random.choose(t)));
        for (rate, column) in rates.iter_mut().zip(columns) {
            let pairs = t.windows(2).zip(column.windows(2)).filter(|(t, _)| t[1] > t[0]);
            *rate = pairs.map(|(t, x)| (x[1] - x[0]).abs() / (t[1] - t[0])).fold(0.0, f64::max);
        }
    }
    times.push(end);
    times.retain(|t| *t > 0.0 && *t <= end);
    times.sort_by(f64::total_cmp);
    // Comparison times that are closer to each other would coincide after conversion to other units.
    times.dedup_by(|later, earlier| *later - *earlier < 1e-12 * end);
    let between = Variant { label: "tight", accuracy: tight, stages: json!("auto"), times: &times, ..plain.clone() };
    let mut runs = vec![maker.run(&between), first];
    match way {
        Way::Stages => {
            for (label, stages) in ["3 stages", "5 stages", "7 stages", "auto"].into_iter().zip(&stages) {
                runs.push(maker.run(&Variant { label, accuracy, stages: stages.clone(), ..between.clone() }));
            }
        }
        Way::Step(step) => runs.push(maker.run(&Variant { label: "half", accuracy: step / 2.0, ..between.clone() })),
        Way::Tolerance | Way::Mean => runs.push(maker.run(&Variant { label: "plain", accuracy, ..between.clone() })),
    }
    let view = View { time: random.scale(1e-4, 1e4), size: random.scale(1e-4, 1e4), change: Vec::new() };
    runs.push(maker.run(&Variant { label: "units", accuracy, stages: any(&mut random), view, ..between.clone() }));
    let later = end * random.uniform(2.0, 5.0);
    // In problems with memory the mesh depends on the end time, so that a later end changes the steps.
    runs.push(maker.run(&Variant {
        label: "later end",
        accuracy,
        stages: any(&mut random),
        end: later,
        ..between.clone()
    }));

    let mut sizes = floors.clone();
    for answer in runs.iter().take(1).chain(&runs[1..]).filter_map(Run::answer).take(2) {
        for (size, column) in sizes.iter_mut().zip(&answer.columns) {
            *size = column.iter().fold(*size, |size, x| size.max(x.abs()));
        }
    }
    let mut experiment =
        Experiment { way, fields, end, times: times.clone(), sizes, rates, floors, runs, kappa: 1.0, reference: None };
    let change = experiment.change(problem, &mut random, accuracy);
    let changed: Vec<Run> = if change.is_empty() {
        Vec::new()
    } else {
        let signs: &[f64] = if problem.starts_on_bound() { &[1.0, 0.5] } else { &[1.0, -1.0] };
        let view = |sign: f64| View { change: change.iter().map(|x| sign * x).collect(), ..View::default() };
        signs
            .iter()
            .map(|sign| maker.run(&Variant { label: "changed", view: view(*sign), ..between.clone() }))
            .collect()
    };
    experiment.measure_growth(&changed, &change);
    experiment.kappa = experiment.kappa.min(problem.most_growth(&experiment.sizes)).max(1.0);
    // An implausibly large growth of perturbations may come from a wrong run: measure it by an independent method as
    // well.
    let doubtful = experiment.kappa >= 30.0 || experiment.kappa.is_nan();
    if conditions.reference || doubtful {
        experiment.reference = problem.reference(&[], &times);
        if let (Some(values), Some(other)) = (&experiment.reference, problem.reference(&change, &times)) {
            experiment.kappa = experiment.growth(&values.columns, &other.columns, &change).max(1.0);
        }
    }
    experiment
}

impl Experiment {
    /// Returns a small perturbation of every initial value; relative to the size of its field, it is as large as the
    /// error that the tolerance permits.
    fn change(&self, problem: &dyn Problem, random: &mut Random, accuracy: f64) -> Vec<f64> {
        let relative = match self.way {
            // The relative change of a field within one step, which is the error of a first-order method.
            Way::Step(step) => {
                let parts = self.rates.iter().zip(&self.sizes).map(|(rate, size)| rate * step / size);
                parts.fold(LEAST_CHANGE, f64::max).min(1e-2)
            }
            _ => accuracy.max(LEAST_CHANGE),
        };
        let one_sided = problem.starts_on_bound();
        (0..problem.starts()).map(|i| relative * self.sizes[i] * if one_sided { 1.0 } else { random.sign() }).collect()
    }

    fn measure_growth(&mut self, changed: &[Run], change: &[f64]) {
        if change.is_empty() {
            return;
        }
        let growth = |run: &Run| {
            let (tight, other) = (self.runs[0].answer()?, run.answer()?);
            Some(self.growth(&tight.columns, &other.columns, change))
        };
        let largest = changed.iter().filter_map(growth).reduce(f64::max);
        self.kappa = largest.map_or(f64::INFINITY, |growth| growth.max(1.0));
    }

    /// Returns the largest distance of two solutions whose initial values differ by `change`, relative to that
    /// change, in the norm in which each field is divided by its size. Fields that jump are excluded.
    fn growth(&self, one: &[Vec<f64>], other: &[Vec<f64>], change: &[f64]) -> f64 {
        let start = change.iter().zip(&self.sizes).map(|(x, size)| x.abs() / size).fold(0.0, f64::max);
        let mut largest = 0.0_f64;
        for (k, field) in self.fields.iter().enumerate().filter(|(_, field)| !field.jumps) {
            debug_assert!(!field.name.is_empty());
            let apart = one[k].iter().zip(&other[k]).map(|(a, b)| (a - b).abs() / self.sizes[k]);
            largest = apart.fold(largest, f64::max);
        }
        largest / start
    }
}
