//! Plots of the error against run time on logarithmic axes: a line for each series, a mark for each run. The better a
//! method, the further its line is to the lower left.

use super::double_logarithmic::{Curve, double_logarithmic};
use crate::{Series, Status, StudyRun};

/// Errors of a run below this value are rounding errors, and are drawn at this value.
const LEAST_ERROR: f64 = 1e-17;

/// Draws the plot of a study: relative errors at the end against run times in seconds.
pub fn work_precision<'a>(
    series: impl IntoIterator<Item = &'a Series>,
    label: Option<&str>,
    reference: &str,
) -> String {
    let below = format!("relative error at the end, against {reference}");
    double_logarithmic(&curves(series), label.unwrap_or("Error against run time"), &below, "run time in s")
}

/// Converts each series of runs of a study to a curve: a mark for each run that has an error, a cross for each run that
/// did not reach the end.
pub fn curves<'a>(series: impl IntoIterator<Item = &'a Series>) -> Vec<Curve> {
    let point = |run: &StudyRun| Some((run.wall_seconds.max(1e-9), run.error_at_end?.max(LEAST_ERROR)));
    let curve = |series: &Series| Curve {
        name: series.method.clone(),
        points: series.runs.iter().filter_map(point).collect(),
        untrusted: series.runs.iter().filter(|run| run.trusted == Some(false)).filter_map(point).collect(),
        lost: series
            .runs
            .iter()
            .filter(|run| run.status != Status::Completed)
            .map(|run| run.wall_seconds.max(1e-9))
            .collect(),
        spread: Vec::new(),
    };
    series.into_iter().map(curve).collect()
}
