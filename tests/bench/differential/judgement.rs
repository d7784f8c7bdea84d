//! Judgement of the runs of a problem. The reference is the solution by an independent method if there is one, and
//! otherwise the run with which most others agree (trusted ones only, if there are any; the tightest among equals). A
//! run is wrong if its distance from the reference exceeds a hundred tolerances, times the growth of small
//! perturbations. The error of a run with steps of a given size is also compared with the error that its verdict
//! permits, where the verdict's estimate counts as right within a factor of four.

use super::experiment::{Experiment, Run};
use super::problem::Way;
use super::solving::{Answer, Outcome};
use dvi::solution::CheckCode;

/// Permitted distance of a run from the reference in tolerances; it is multiplied by the growth `kappa` of
/// perturbations.
const TOLERANCES: f64 = 100.0;
/// Permitted distance of runs of a first-order method: the change of a field at its largest rate over this number of
/// steps, plus one step for each event. It is multiplied by the growth `kappa` of perturbations. Over an end time of
/// several periods the errors of steps accumulate.
const STEPS: f64 = 30.0;
/// Rounding error of a coordinate at rest, relative to the largest coordinate of the same unit.
const ROUNDING: f64 = 1e-9;
/// Factor by which an error estimate may differ from the true error and still count as right.
const ESTIMATE: f64 = 4.0;
/// Largest growth of small perturbations: problems with a larger one are not judged.
pub const MOST_GROWTH: f64 = 1e4;

/// Judgement of a single run of a problem.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Finding {
    /// The run is correct and trusted.
    Right,
    /// The run is correct and not trusted.
    FalseAlarm,
    /// The run is correct up to the end of the comparison and not trusted because of what follows: runs with the same
    /// method that end there are trusted.
    Behind,
    /// The run is wrong and trusted.
    Silent,
    /// The run is wrong and not trusted.
    Caught,
    Failed,
    TimedOut,
    Refused,
    Panicked,
    NotFinite,
    Skipped,
}

impl Finding {
    pub const ALL: [(Self, &'static str); 11] = [
        (Self::Right, "right"),
        (Self::FalseAlarm, "alarm"),
        (Self::Behind, "behind"),
        (Self::Silent, "SILENT"),
        (Self::Caught, "caught"),
        (Self::Failed, "failed"),
        (Self::TimedOut, "late"),
        (Self::Refused, "refused"),
        (Self::Panicked, "panic"),
        (Self::NotFinite, "not finite"),
        (Self::Skipped, "skipped"),
    ];
}

/// Reason why a problem is not judged.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Apart {
    /// The growth of small perturbations is too large, or unknown.
    Sensitive,
    /// The theory does not guarantee that the states are unique.
    NotUnique,
    /// Fewer than two runs reached the end, and there is no independent solution.
    Alone,
}

/// Judgement of all runs of a problem.
#[derive(Clone, Debug)]
pub struct Judgement {
    pub apart: Option<Apart>,
    /// For each run, its judgement, and its distance from the reference in units of the permitted distance.
    pub findings: Vec<(Finding, f64)>,
    /// Whether the reference comes from an independent method.
    pub by_reference: bool,
    /// Whether all runs agree with each other and disagree with the independent method, which is then suspect.
    pub reference_alone: bool,
    /// For each field, the reference values at the comparison times.
    pub truth: Vec<Vec<f64>>,
}

impl Judgement {
    pub fn has_wrong_runs(&self) -> bool {
        self.findings.iter().any(|(finding, _)| matches!(finding, Finding::Silent | Finding::Caught))
    }
}

/// A run with the values of its fields at the comparison times.
struct Sample<'a> {
    run: &'a Run,
    answer: &'a Answer,
    columns: Vec<Vec<f64>>,
    times: Vec<f64>,
}

/// Judges the runs of a problem.
pub fn judge(experiment: &Experiment, is_unique: bool) -> Judgement {
    let samples: Vec<Option<Sample<'_>>> =
        experiment.runs.iter().map(|run| run.answer().map(|answer| sample(experiment, run, answer))).collect();
    let complete: Vec<&Sample<'_>> = samples.iter().flatten().collect();
    let certified = complete.iter().any(|sample| sample.answer.is_certified);
    let apart = if !(is_unique || certified) {
        Some(Apart::NotUnique)
    } else if experiment.kappa > MOST_GROWTH || experiment.kappa.is_nan() {
        Some(Apart::Sensitive)
    } else if complete.is_empty() || complete.len() < 2 && experiment.reference.is_none() {
        Some(Apart::Alone)
    } else {
        None
    };
    let excess = |a: &Sample<'_>, b: &Sample<'_>| distance(experiment, a, Some(b), None);
    // Index of the run with which most other runs agree; among equals the first one, which is the tight run. A run
    // without values at some of the comparison times is no candidate, and the agreement of an untrusted run is not
    // counted if other runs are trusted.
    let is_any_trusted = complete.iter().any(|sample| sample.answer.trusted);
    let votes = |sample: &Sample<'_>| sample.answer.trusted || !is_any_trusted;
    let is_whole = |sample: &Sample<'_>| votes(sample) && !sample.columns.iter().flatten().any(|value| value.is_nan());
    let count_of =
        |sample: &Sample<'_>| complete.iter().filter(|other| votes(other) && excess(sample, other) <= 1.0).count();
    let best = complete
        .iter()
        .map(|sample| if is_whole(sample) { count_of(sample) } else { 0 })
        .enumerate()
        .rev()
        .max_by_key(|(_, count)| *count)
        .map(|(k, _)| k);
    let by_reference = experiment.reference.is_some();
    let far = |sample: &Sample<'_>| match (&experiment.reference, best) {
        (Some(values), _) => distance(experiment, sample, None, Some(values)),
        (None, Some(best)) => excess(sample, complete[best]),
        (None, None) => 0.0,
    };
    let findings: Vec<(Finding, f64)> = experiment
        .runs
        .iter()
        .zip(&samples)
        .map(|(run, sample)| match (&run.outcome, sample) {
            (Outcome::Answered(answer), Some(sample)) => {
                let mut far = far(sample);
                if let (Way::Step(_), Some(permitted)) = (experiment.way, answer.permitted) {
                    let error = match (&experiment.reference, best) {
                        (Some(values), _) => relative_error(experiment, sample, &values.columns),
                        (None, Some(best)) => error_of_first_order(experiment, sample, complete[best], &complete),
                        (None, None) => 0.0,
                    };
                    let part = error / permitted;
                    let is_told = answer.because.contains(&CheckCode::LocalError) && part > 1.0 / ESTIMATE;
                    far = far.max(part / if is_told { 1.0 / ESTIMATE } else { ESTIMATE });
                }
                let finding = match (answer.is_finite, far <= 1.0, answer.trusted) {
                    (false, _, _) => Finding::NotFinite,
                    (_, true, true) => Finding::Right,
                    (_, true, false) if is_doubted_behind(experiment, run) => Finding::Behind,
                    (_, true, false) => Finding::FalseAlarm,
                    (_, false, true) => Finding::Silent,
                    (_, false, false) => Finding::Caught,
                };
                (finding, far)
            }
            (Outcome::Refused(_), _) => (Finding::Refused, 0.0),
            (Outcome::Skipped, _) => (Finding::Skipped, 0.0),
            (Outcome::Panicked, _) => (Finding::Panicked, 0.0),
            (Outcome::Hung | Outcome::Stopped(_), _) => (Finding::TimedOut, 0.0),
            _ => (Finding::Failed, 0.0),
        })
        .collect();
    let all_agree = best.is_some_and(|best| complete.iter().all(|sample| excess(sample, complete[best]) <= 1.0));
    let reference_alone = by_reference && all_agree && complete.iter().all(|sample| far(sample) > 1.0);
    let truth = match (&experiment.reference, best) {
        (Some(values), _) => values.columns.clone(),
        (None, Some(best)) => complete[best].columns.clone(),
        (None, None) => Vec::new(),
    };
    Judgement { apart, findings, by_reference, reference_alone, truth }
}

/// Whether a run continues beyond the last comparison time, although the runs with the same method that end at that
/// time are trusted: an untrusting verdict on the longer run then concerns times that are not compared.
fn is_doubted_behind(experiment: &Experiment, run: &Run) -> bool {
    let ends_with = |other: &Run| other.specification["time"]["end"].as_f64() == Some(experiment.end);
    let same = |other: &&Run| ends_with(other) && other.specification["method"] == run.specification["method"];
    let mut same = experiment.runs.iter().filter(same).filter_map(Run::answer).peekable();
    !ends_with(run) && same.peek().is_some() && same.all(|answer| answer.trusted)
}

/// Returns the values of a run at the comparison times; NaN at times without output.
fn sample<'a>(experiment: &Experiment, run: &'a Run, answer: &'a Answer) -> Sample<'a> {
    let slack = 1e-11 * experiment.end;
    let place = |t: f64| {
        let k = answer.t.partition_point(|other| *other < t - slack);
        answer.t.get(k).filter(|other| (**other - t).abs() <= slack).map(|_| k)
    };
    let places: Vec<Option<usize>> = experiment.times.iter().map(|&t| place(t)).collect();
    let value = |column: &Vec<f64>, place: &Option<usize>| place.map_or(f64::NAN, |k| column[k]);
    let columns = answer.columns.iter().map(|column| places.iter().map(|place| value(column, place)).collect());
    Sample { run, answer, columns: columns.collect(), times: experiment.times.clone() }
}

/// Returns the largest distance of two runs, or of a run from the reference, in units of the permitted distance.
fn distance(
    experiment: &Experiment,
    sample: &Sample<'_>,
    other: Option<&Sample<'_>>,
    reference: Option<&super::reference::Values>,
) -> f64 {
    let Experiment { way, fields, sizes, rates, floors, kappa, .. } = experiment;
    // Limit the growth of perturbations: problems with a larger growth are not judged.
    let kappa = kappa.min(MOST_GROWTH);
    let accuracy = sample.run.accuracy + other.map_or(0.0, |other| other.run.accuracy);
    let events = sample.answer.events.len();
    let mut largest = 0.0_f64;
    for (k, field) in fields.iter().enumerate() {
        let truth = match (other, reference) {
            (Some(other), _) => &other.columns[k],
            (None, Some(values)) => &values.columns[k],
            (None, None) => continue,
        };
        let same = fields.iter().zip(sizes).filter(|(other, _)| (other.size, other.time) == (field.size, field.time));
        let rounding = ROUNDING * same.fold(0.0_f64, |largest, (_, size)| largest.max(*size));
        let uncertainty = reference.map_or(0.0, |values| values.accuracy[k]);
        let allowed = uncertainty
            + kappa
                * match way {
                    Way::Step(_) => accuracy * rates[k] * (STEPS + events as f64) + rounding,
                    _ => TOLERANCES * accuracy * (sizes[k] + floors[k]),
                };
        if field.jumps && matches!(way, Way::Step(_)) {
            continue;
        }
        let apart = sample.columns[k].iter().zip(truth).zip(&sample.times);
        let apart: Vec<f64> = apart
            .filter(|((a, b), _)| !a.is_nan() && !b.is_nan())
            .filter(|(_, t)| !field.jumps || !is_near_event(experiment, sample, other, **t, kappa * accuracy))
            .map(|((a, b), _)| (a - b).abs())
            .collect();
        let apart = match way {
            // The tolerance of methods for problems with memory applies to the mean error over time.
            Way::Mean => apart.iter().sum::<f64>() / apart.len().max(1) as f64,
            _ => apart.into_iter().fold(0.0, f64::max),
        };
        largest = largest.max(if allowed > 0.0 { apart / allowed } else { 0.0 });
    }
    largest
}

/// Returns the error of a run of a first-order method: its distance from the run chosen as the reference or, for that
/// run itself, an extrapolation from the distances of the others.
fn error_of_first_order(experiment: &Experiment, run: &Sample<'_>, best: &Sample<'_>, all: &[&Sample<'_>]) -> f64 {
    let of = |sample: &Sample<'_>| relative_error(experiment, sample, &best.columns);
    if !std::ptr::eq(run, best) {
        return of(run);
    }
    let step = best.run.accuracy;
    let longer = all.iter().filter(|other| other.run.accuracy > step);
    longer.map(|other| of(other) * step / (other.run.accuracy - step)).fold(0.0, f64::max)
}

/// Returns the largest relative error of the fields without jumps. As in verdicts on steps of a given size, errors
/// are relative to the largest change of a field, or to its largest value if that is smaller; the position components
/// of a body share the largest of their scales.
fn relative_error(experiment: &Experiment, sample: &Sample<'_>, truth: &[Vec<f64>]) -> f64 {
    let fields = &experiment.fields;
    let start = |k: usize| sample.answer.columns[k].first().copied().unwrap_or(0.0);
    let span = |k: usize| {
        let of = |from: f64| sample.answer.columns[k].iter().fold(0.0_f64, |span, x| span.max((x - from).abs()));
        of(0.0).min(of(start(k)))
    };
    let of_body = |k: usize| fields[k].name.split_once('.').map(|(body, _)| body);
    let together = |k: usize, other: usize| k == other || of_body(k).is_some() && of_body(k) == of_body(other);
    let errors = (0..fields.len()).filter(|&k| !fields[k].jumps).flat_map(|k| {
        let size = (0..fields.len()).filter(|&other| together(k, other)).map(span).fold(0.0, f64::max);
        let apart = sample.columns[k].iter().zip(&truth[k]).map(|(a, b)| (a - b).abs());
        apart.filter(|apart| !apart.is_nan()).map(move |apart| if size > 0.0 { apart / size } else { 0.0 })
    });
    errors.fold(0.0, f64::max)
}

/// Whether an event of one of two runs is so near to the comparison time `t` that it may lie on the other side of `t`
/// in the other run. The permitted distance is `TOLERANCES` times `part`, the accuracy of the runs times the growth
/// of perturbations, as a fraction of the end time.
fn is_near_event(experiment: &Experiment, one: &Sample<'_>, other: Option<&Sample<'_>>, t: f64, part: f64) -> bool {
    let window = (TOLERANCES * part).max(1e-9) * experiment.end;
    let events = one.answer.events.iter().chain(other.into_iter().flat_map(|other| &other.answer.events));
    events.into_iter().any(|event| (event - t).abs() <= window)
}
