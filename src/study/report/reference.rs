//! The reference solution of an example system: values of all outputs at the comparison times, and the switching
//! times.
//!
//! Values known from outside this program (formulas or published numbers) are used wherever there are any. Elsewhere
//! the reference is a run of this program at a tolerance tighter than those that are measured; its distance from the
//! outside values at the end is part of the report. The comparison times are not multiples of any period, and each
//! lies well inside the span between two switches, so that rounding does not decide on which side of a jump it is.

use super::known::Known;
use super::{Errors, MOST_STEPS};
use crate::solve::solve_once;
use problem::Control;
use serde::{Deserialize, Serialize};
use solution::{Solution, Status};
use specification::{By, Exact, Rung, Specification, Stages};
use std::time::{Duration, Instant};

/// Number of comparison times besides the end, before those near switches are dropped: multiples of the golden
/// section of the horizon, which spread evenly and meet all phases of a periodic solution.
const TIMES: usize = 120;
const GOLDEN: f64 = 0.618_033_988_749_894_9;
/// Smallest distance of a comparison time from a switch, relative to the span between the two neighbouring switches.
const BETWEEN: f64 = 0.1;
/// Relative tolerances of the reference run, the tightest first, each with a time limit in seconds: if rounding or
/// cost keeps a run from the end, the next tolerance is tried. Methods of second order cannot use the tightest
/// tolerances.
const TOLERANCES: [(f64, u64); 3] = [(1e-13, 30), (1e-11, 60), (1e-9, 120)];
const SECOND_ORDER: [(f64, u64); 2] = [(1e-11, 120), (1e-10, 120)];
/// Reference run with fixed steps: ratio of the smallest step size that is measured to that of the reference run, and
/// time limit of the reference run in seconds.
const FINER: (f64, u64) = (16.0, 120);
/// Largest relative distance of a reference run, at the end, from values known from outside this program. A run
/// beyond it agrees in fewer than three digits: it has found another solution, and is rejected as a reference.
const REFUTED: f64 = 1e-3;
/// Names of outputs that describe the discretisation and not the solution; they are not compared.
const OF_DISCRETISATION: [&str; 3] = ["contacts", "penetration", "normal_impulse"];
/// Size of an output column, relative to the largest column, below which it counts as zero up to rounding (`ZERO`) or,
/// with fixed steps, up to the tolerance of the contact solver (`ZERO_AT_STEPS`).
const ZERO: f64 = 1e-12;
const ZERO_AT_STEPS: f64 = 1e-8;

/// Reference values that runs are compared with. They are needed while a chapter is made, and are not stored with it.
#[derive(Clone, Debug, Deserialize, Serialize)]
pub struct Reference {
    /// Times at which runs are compared with the reference; the last is the end.
    #[serde(skip)]
    pub times: Vec<f64>,
    /// Names of the outputs that are compared, states first.
    #[serde(skip)]
    pub names: Vec<String>,
    /// Number of compared outputs that are states.
    pub states: usize,
    /// Reference values of each output at the comparison times.
    #[serde(skip)]
    pub columns: Vec<Vec<f64>>,
    /// Outputs with values known from outside this program at the end: index in `names`, and value.
    #[serde(skip)]
    pub outside: Vec<(usize, f64)>,
    /// Switching times that the runs are compared with.
    pub switches: Vec<f64>,
    /// Switching times of the reference run. A switch of another run near one of them or of `switches` is not surplus:
    /// the switches that are known from outside this program need not be all.
    #[serde(skip)]
    pub located: Vec<f64>,
    /// Whether the switching times that runs are compared with are known from outside this program.
    pub switches_outside: bool,
    /// Accuracy setting of the reference run, in words; absent if no run reached the end, or if all runs contradict
    /// the values known from outside this program.
    pub run: Option<String>,
    /// Distance, at the end, of the reference run from the values known from outside this program, in the norm of the
    /// errors; if all runs are rejected as references, the smallest of their distances.
    pub agreement: Option<f64>,
    /// An estimate of the error of a reference run with fixed steps: the largest difference over time between its
    /// states and those of a run with steps twice as long. Absent for a reference run with a tolerance.
    pub coarser: Option<f64>,
    /// Length of the time horizon of the system.
    pub horizon: f64,
    /// Number of times at which runs are compared with the reference.
    pub compared: usize,
    /// Size of an output column, relative to the largest column, up to which it counts as zero.
    #[serde(skip)]
    pub zero: f64,
}

impl Reference {
    /// Computes the reference of a specification, where `finest` is the smallest step size that is measured. Returns
    /// `None` if no run reaches the end and no value is known from outside this program.
    pub fn new(specification: &Specification, known: &Known, finest: f64) -> Option<Self> {
        let time = specification.time();
        let horizon = time.end - time.start;
        let mut spread: Vec<f64> = (1..=TIMES).map(|k| time.start + horizon * (k as f64 * GOLDEN).fract()).collect();
        spread.sort_by(f64::total_cmp);
        spread.push(time.end);
        let model = specification.model();
        let zero = if model.varied().tolerance { ZERO } else { ZERO_AT_STEPS };
        let names = model.output_names();
        let outside = OutsideValues::new(specification, known);
        let mut agreement: Option<f64> = None;
        let found = runs(specification, &spread, names.len(), finest).find(|(_, solution)| {
            let Some(distance) = outside.distance(time.end, &columns_of(solution), zero) else { return true };
            let is_refuted = distance > REFUTED && !known.mesh;
            agreement = Some(if is_refuted { agreement.unwrap_or(f64::INFINITY).min(distance) } else { distance });
            !is_refuted
        });
        let events: Vec<f64> = found.iter().flat_map(|(_, solution)| switch_times(solution)).collect();
        let switches_outside = !known.switches.is_empty();
        let switches = if switches_outside { known.switches.clone() } else { events.clone() };
        let keep = kept(&spread, &switches, time.start);
        let mut columns = match &found {
            Some((_, solution)) => columns_of(solution),
            None => vec![vec![f64::NAN; spread.len()]; names.len()],
        };
        if columns.iter().any(|column| column.len() != spread.len()) {
            return None;
        }
        let run = found.map(|(words, _)| words);
        if run.is_none() && outside.is_empty() {
            return None;
        }
        if !known.mesh {
            outside.write(&spread, &mut columns);
        }
        let outside = if known.mesh { Vec::new() } else { outside.at_end(time.end).collect() };
        let is_by_step = run.is_some() && !model.varied().tolerance;
        let pick = |column: Vec<f64>| column.into_iter().zip(&keep).filter_map(|(x, keep)| keep.then_some(x)).collect();
        let times: Vec<f64> = pick(spread);
        let mut reference = Self {
            compared: times.len(),
            times,
            columns: columns.into_iter().map(pick).collect(),
            states: model.initial().len(),
            names,
            outside,
            switches,
            located: events,
            switches_outside,
            run,
            agreement,
            coarser: None,
            horizon,
            zero,
        };
        if is_by_step {
            reference.coarser = reference.error_of_coarser(specification, finest);
        }
        Some(reference)
    }

    /// Returns the largest difference over time between the states of the reference and those of a run with steps
    /// twice as long; infinity if the longer steps do not reach the end.
    fn error_of_coarser(&self, specification: &Specification, finest: f64) -> Option<f64> {
        let (finer, seconds) = FINER;
        let rung = Rung::Step(2.0 * finest / finer);
        let solution = run_to(specification, rung, &self.times, self.names.len(), seconds);
        let Some(solution) = solution else { return Some(f64::INFINITY) };
        let columns = columns_of(&solution);
        let columns: Vec<Option<&[f64]>> = columns.iter().map(|column| Some(column.as_slice())).collect();
        self.errors(&columns, None).of_states()
    }

    /// Returns the indices of the outputs that are neither states nor describe the discretisation.
    fn of_solution(&self) -> Vec<usize> {
        let told = |k: &usize| !OF_DISCRETISATION.contains(&self.names[*k].as_str());
        (self.states..self.names.len()).filter(told).collect()
    }

    /// Returns the errors of a run's values at the comparison times, in the order of the names of the outputs; `None`
    /// stands for a missing output.
    pub fn errors(&self, columns: &[Option<&[f64]>], switches: Option<&[f64]>) -> Errors {
        let distance = |k: usize, at: usize| {
            let value = columns.get(k).copied().flatten()?.get(at)?;
            let exact = self.columns[k].get(at).filter(|exact| exact.is_finite())?;
            // A value of the run that is not finite counts as an infinite error.
            Some(if value.is_finite() { relative(&self.columns, k, value - exact, self.zero) } else { f64::INFINITY })
        };
        let over_time = |fields: Vec<usize>| {
            let all = fields.into_iter().flat_map(|k| (0..self.times.len()).map(move |at| (k, at)));
            all.filter_map(|(k, at)| distance(k, at)).reduce(f64::max)
        };
        let last = self.times.len().saturating_sub(1);
        let end = match self.outside.is_empty() {
            true => (0..self.states).filter_map(|k| distance(k, last)).reduce(f64::max),
            false => self.outside.iter().filter_map(|&(k, _)| distance(k, last)).reduce(f64::max),
        };
        let nearest = |t: &f64, of: &[f64]| of.iter().map(|other| (other - t).abs()).reduce(f64::min);
        let largest = switches.and_then(|found| {
            let lost = self.switches.iter().map(|t| nearest(t, found));
            let surplus = found.iter().map(|t| {
                let near = [&self.switches, &self.located].map(|times| nearest(t, times));
                near.into_iter().flatten().reduce(f64::min)
            });
            lost.chain(surplus).map(|one| one.unwrap_or(self.horizon)).reduce(f64::max)
        });
        let finite = |error: Option<f64>| error.filter(|error| error.is_finite());
        Errors {
            end: finite(end),
            states: finite(over_time((0..self.states).collect())),
            variables: finite(over_time(self.of_solution())),
            switches: finite(largest.map(|largest| largest / self.horizon)),
            switches_found: switches.map(<[f64]>::len),
        }
    }
}

/// Returns a difference from the reference relative to the largest value of its column, or of all columns if its column
/// is zero.
fn relative(columns: &[Vec<f64>], k: usize, distance: f64, zero: f64) -> f64 {
    let size_of =
        |column: &Vec<f64>| column.iter().filter(|x| x.is_finite()).fold(0.0_f64, |size, x| size.max(x.abs()));
    let size = size_of(&columns[k]);
    let all = columns.iter().map(size_of).fold(0.0, f64::max);
    let size = if size > zero * all { size } else { all };
    distance.abs() / if size > 0.0 { size } else { 1.0 }
}

/// Returns the times of all switches of a solution in increasing order, each once.
pub fn switch_times(solution: &Solution) -> Vec<f64> {
    let mut times: Vec<f64> = solution.trajectory.events.iter().map(|event| event.t).collect();
    times.sort_by(f64::total_cmp);
    times.dedup();
    times
}

/// Returns for each time whether it is far enough from the neighbouring switches to be a comparison time; the last
/// time, the end, always is.
fn kept(times: &[f64], switches: &[f64], start: f64) -> Vec<bool> {
    let Some(&end) = times.last() else { return Vec::new() };
    let near = |t: f64| {
        let next = switches.partition_point(|switch| *switch < t);
        let before = next.checked_sub(1).map_or(start, |last| switches[last]);
        let behind = switches.get(next).copied().unwrap_or(end);
        let apart = BETWEEN * (behind - before);
        (next > 0 && t - before <= apart) || (next < switches.len() && behind - t <= apart)
    };
    times.iter().map(|&t| t == end || !near(t)).collect()
}

/// Returns the values of all outputs of a run at its output times.
fn columns_of(solution: &Solution) -> Vec<Vec<f64>> {
    solution.trajectory.fields.iter().map(|field| field.values.clone()).collect()
}

/// Solves the candidates for the reference run, the most accurate first, and returns those that reach the end, with
/// their settings in words.
fn runs(
    specification: &Specification,
    times: &[f64],
    outputs: usize,
    finest: f64,
) -> impl Iterator<Item = (String, Solution)> {
    let varied = specification.model().varied();
    let to = |(rtol, seconds): (f64, u64)| (Rung::Tolerance(rtol), format!("the tolerance {rtol:e}"), seconds);
    let rungs: Vec<(Rung, String, u64)> = match (varied.tolerance, varied.reference) {
        (true, By::Tolerance) => TOLERANCES.map(to).to_vec(),
        (true, By::Step) => SECOND_ORDER.map(to).to_vec(),
        (false, _) => {
            let step = finest / FINER.0;
            vec![(Rung::Step(step), format!("steps of {step:.3e}"), FINER.1)]
        }
    };
    rungs.into_iter().filter_map(move |(rung, words, seconds)| {
        run_to(specification, rung, times, outputs, seconds).map(|solution| (words, solution))
    })
}

/// Returns a run with all outputs at `times`, with the tolerance or step size `rung`; `None` if the run does not
/// reach the end within `seconds`.
fn run_to(specification: &Specification, rung: Rung, times: &[f64], outputs: usize, seconds: u64) -> Option<Solution> {
    let variant = specification.variant(rung, Stages::Auto, times.to_vec(), (0..outputs).collect());
    let control = Control::with_deadline(Instant::now() + Duration::from_secs(seconds));
    let solution = solve_once(&variant.within_steps(MOST_STEPS), &control);
    (solution.status == Status::Completed).then_some(solution)
}

/// Output values known from outside this program.
struct OutsideValues {
    /// For each output with known values: its index, and whether the values are known at all times and not only at
    /// the end.
    fields: Vec<(usize, bool)>,
    exact: Option<Exact>,
    from: f64,
}

impl OutsideValues {
    fn new(specification: &Specification, known: &Known) -> Self {
        let exact = specification.study().and_then(|study| study.exact.clone());
        let always = |k: &usize| {
            let name = &specification.model().output_names()[*k];
            known.exact.get(name).is_some_and(serde_json::Value::is_string)
        };
        Self {
            fields: exact.iter().flat_map(|exact| &exact.fields).map(|k| (*k, always(k))).collect(),
            exact,
            from: known.from.unwrap_or(f64::NEG_INFINITY),
        }
    }

    fn is_empty(&self) -> bool {
        self.fields.is_empty()
    }

    fn at(&self, t: f64) -> Vec<f64> {
        let mut row = vec![f64::NAN; self.fields.len()];
        if let Some(exact) = &self.exact {
            exact.values.clone().evaluate(t, &[], &mut row);
        }
        row
    }

    /// Returns the largest distance of the outputs of a run from the known values at the end; `None` if no values are
    /// known.
    fn distance(&self, end: f64, columns: &[Vec<f64>], zero: f64) -> Option<f64> {
        let last = |k: usize| columns.get(k).and_then(|column| column.last().copied()).unwrap_or(f64::NAN);
        self.at_end(end).map(|(k, exact)| relative(columns, k, last(k) - exact, zero)).reduce(f64::max)
    }

    fn at_end(&self, end: f64) -> impl Iterator<Item = (usize, f64)> {
        self.fields.iter().map(|field| field.0).zip(self.at(end))
    }

    /// Overwrites computed values of outputs by values known from outside this program, wherever there are any.
    fn write(&self, times: &[f64], columns: &mut [Vec<f64>]) {
        let last = times.len().saturating_sub(1);
        for (at, &t) in times.iter().enumerate() {
            for (&(k, always), value) in self.fields.iter().zip(self.at(t)) {
                if at == last || (always && t >= self.from) {
                    columns[k][at] = value;
                }
            }
        }
    }
}
