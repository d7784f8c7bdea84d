//! The reference of a system: values of all outputs at the times of comparison, and the times of switches.
//!
//! Values from outside are used wherever there are any. Between them, a run of this program to a tolerance beyond those that
//! are measured is the reference; its distance from the outside values at the end is part of the report. The times of
//! comparison are no multiples of any period, and each lies well within its span between two switches, so that rounding does not
//! decide on which side of a jump it is.

use super::known::Known;
use super::{Errors, MOST_STEPS};
use crate::solve::solve_once;
use problem::Control;
use serde::{Deserialize, Serialize};
use solution::{Solution, Status};
use specification::{By, Exact, Rung, Specification, Stages};
use std::time::{Duration, Instant};

/// Times of comparison beside the end, before those near switches are left out: multiples of the golden section of the horizon,
/// which are spread evenly and meet all phases of what is periodic.
const TIMES: usize = 120;
const GOLDEN: f64 = 0.618_033_988_749_894_9;
/// The distance of times of comparison from switches, as a part of the span between two of them.
const BETWEEN: f64 = 0.1;
/// The tolerances of the run of reference, the tightest first, with the seconds that it may take: where rounding or cost keep it
/// from the end, the next one is tried. Methods of second order have none of the tighter ones.
const TOLERANCES: [(f64, u64); 3] = [(1e-13, 30), (1e-11, 60), (1e-9, 120)];
const SECOND_ORDER: [(f64, u64); 2] = [(1e-11, 120), (1e-10, 120)];
/// Where steps have one size: the step as a part of the finest that is measured, and the seconds.
const FINER: (f64, u64) = (16.0, 120);
/// A run that is further than this from the values from outside at the end, relative to their sizes, has no three digits of
/// them: it is another solution, and no reference between them.
const REFUTED: f64 = 1e-3;
/// Outputs that describe the discretisation and not the solution.
const OF_DISCRETISATION: [&str; 3] = ["contacts", "penetration", "normal_impulse"];
/// A column this much smaller than the largest is what rounding leaves of zero; where steps have one size, what the tolerance of
/// the contact problems leaves of it.
const ZERO: f64 = 1e-12;
const ZERO_AT_STEPS: f64 = 1e-8;

/// Values to compare with. The values themselves are needed while a chapter is made, and are not kept with it.
#[derive(Clone, Debug, Deserialize, Serialize)]
pub struct Reference {
    /// The times of comparison; the last is the end.
    #[serde(skip)]
    pub times: Vec<f64>,
    /// The names of the outputs, those of the states first.
    #[serde(skip)]
    pub names: Vec<String>,
    /// How many of them are states.
    pub states: usize,
    /// The values of each output at the times.
    #[serde(skip)]
    pub columns: Vec<Vec<f64>>,
    /// The outputs with values from outside at the end, as places in `names`, with these values.
    #[serde(skip)]
    pub outside: Vec<(usize, f64)>,
    /// The times of switches.
    pub switches: Vec<f64>,
    /// Whether these are from outside.
    pub switches_outside: bool,
    /// How the run of reference was asked for, in words; absent where none reached the end, or the outside refutes all.
    pub run: Option<String>,
    /// The distance of the run of reference from the outside values at the end, in the norm of the errors; without such a run
    /// that of the best run.
    pub agreement: Option<f64>,
    /// The largest error over time of the states of a run with steps twice as long, where the run of reference has steps
    /// of one size: what the reference may be off by.
    pub coarser: Option<f64>,
    /// The span of time from start to end.
    pub horizon: f64,
    /// The number of times of comparison.
    pub compared: usize,
    /// The part of the largest column up to which a column is zero.
    #[serde(skip)]
    pub zero: f64,
}

impl Reference {
    /// The reference of a specification, with steps of the size `finest` as the smallest that are measured. `None` where
    /// no run reaches the end and nothing is known from outside.
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
        let switches = if switches_outside { known.switches.clone() } else { events };
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

    /// The largest error over time of the states of a run with steps twice those of the reference; infinite if it does not
    /// reach the end.
    fn error_of_coarser(&self, specification: &Specification, finest: f64) -> Option<f64> {
        let (finer, seconds) = FINER;
        let rung = Rung::Step(2.0 * finest / finer);
        let solution = run_to(specification, rung, &self.times, self.names.len(), seconds);
        let Some(solution) = solution else { return Some(f64::INFINITY) };
        let columns = columns_of(&solution);
        let columns: Vec<Option<&[f64]>> = columns.iter().map(|column| Some(column.as_slice())).collect();
        self.errors(&columns, None).of_states()
    }

    /// The outputs that are no states.
    fn of_solution(&self) -> Vec<usize> {
        let told = |k: &usize| !OF_DISCRETISATION.contains(&self.names[*k].as_str());
        (self.states..self.names.len()).filter(told).collect()
    }

    /// The errors of values at the times of comparison, in the order of the names; `None` for an output that is not there.
    pub fn errors(&self, columns: &[Option<&[f64]>], switches: Option<&[f64]>) -> Errors {
        let distance = |k: usize, at: usize| {
            let value = columns.get(k).copied().flatten()?.get(at)?;
            let exact = self.columns[k].get(at).filter(|exact| exact.is_finite())?;
            // What is no number is no small error.
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
            let surplus = found.iter().map(|t| nearest(t, &self.switches));
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

/// A distance as a part of the largest value of its column, or of the largest of all where the column is zero.
fn relative(columns: &[Vec<f64>], k: usize, distance: f64, zero: f64) -> f64 {
    let size_of =
        |column: &Vec<f64>| column.iter().filter(|x| x.is_finite()).fold(0.0_f64, |size, x| size.max(x.abs()));
    let size = size_of(&columns[k]);
    let all = columns.iter().map(size_of).fold(0.0, f64::max);
    let size = if size > zero * all { size } else { all };
    distance.abs() / if size > 0.0 { size } else { 1.0 }
}

/// The times of all switches of an answer, from the start on, each once.
pub fn switch_times(solution: &Solution) -> Vec<f64> {
    let mut times: Vec<f64> = solution.trajectory.events.iter().map(|event| event.t).collect();
    times.sort_by(f64::total_cmp);
    times.dedup();
    times
}

/// Which times are far enough from the switches around them; the last, the end, is kept.
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

/// The values of all outputs of a run.
fn columns_of(solution: &Solution) -> Vec<Vec<f64>> {
    solution.trajectory.fields.iter().map(|field| field.values.clone()).collect()
}

/// The runs that may be the reference and reach the end, the most accurate first, and what they are.
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

/// A run with all outputs at these times, if it reaches the end within so many seconds.
fn run_to(specification: &Specification, rung: Rung, times: &[f64], outputs: usize, seconds: u64) -> Option<Solution> {
    let variant = specification.variant(rung, Stages::Auto, times.to_vec(), (0..outputs).collect());
    let control = Control::with_deadline(Instant::now() + Duration::from_secs(seconds));
    let solution = solve_once(&variant.within_steps(MOST_STEPS), &control);
    (solution.status == Status::Completed).then_some(solution)
}

/// Values from outside.
struct OutsideValues {
    /// For each output that has any: its place, and its value at a time where it is known there.
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

    /// The distance of the columns of a run from them at the end; `None` if there are none.
    fn distance(&self, end: f64, columns: &[Vec<f64>], zero: f64) -> Option<f64> {
        let last = |k: usize| columns.get(k).and_then(|column| column.last().copied()).unwrap_or(f64::NAN);
        self.at_end(end).map(|(k, exact)| relative(columns, k, last(k) - exact, zero)).reduce(f64::max)
    }

    fn at_end(&self, end: f64) -> impl Iterator<Item = (usize, f64)> {
        self.fields.iter().map(|field| field.0).zip(self.at(end))
    }

    /// Replaces computed values wherever outside ones hold.
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
