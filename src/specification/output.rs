//! The part of a trajectory to keep: times and fields.

use super::document::Time;
use super::error::{Errors, SpecificationError};
use super::method::out_of_range;
use super::pointer::Pointer;
use super::times::Times;
use super::wording::{abridged, listed};
use expression::nearest;
use serde::Deserialize;
use solution::Observables;
use std::collections::HashMap;
use std::ops::Range;
use utoipa::ToSchema;

/// The part of the trajectory to keep. Other times and fields are neither computed nor stored.
#[derive(Clone, Debug, Default, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct Output {
    /// The output times. Default `"steps"`.
    #[serde(default)]
    pub times: Times,
    /// The states, variables, further outputs, definitions and integrals to keep, by name. Default: all except the
    /// definitions; for problems in space, only outputs of the body or domain as a whole. `"*"` stands for the default.
    pub fields: Option<Vec<String>>,
    /// Estimate the error of the final states by a second, more accurate run, at about twice the cost.
    #[serde(default)]
    #[schema(default = false)]
    pub global_error: bool,
}

/// The name in the list of output fields that stands for the fields that are kept by default.
const ALL: &str = "*";

/// Largest number of output times of a trajectory.
pub(super) const MOST_TIMES: usize = 2_000_000;

impl Output {
    /// Returns the output times, or `None` for output at every step. Without a known horizon, only the order of the
    /// times is checked.
    pub(super) fn times(&self, time: Option<Time>, place: &Pointer<'_>, errors: &mut Errors) -> Option<Vec<f64>> {
        let place = place.key("times");
        match &self.times {
            Times::Steps => None,
            Times::Count(count) => {
                let place = place.key("count");
                if *count < 2 {
                    out_of_range(&place, *count as f64, "2 or more: the start and the end count", errors);
                } else if *count > MOST_TIMES as u64 {
                    too_many(&place, *count as f64, errors);
                } else if let Some(Time { start, end }) = time {
                    let intervals = (*count - 1) as f64;
                    return Some((0..*count).map(|k| interpolate(start, end, k as f64 / intervals)).collect());
                }
                None
            }
            Times::Every(dt) => {
                let place = place.key("every");
                if *dt <= 0.0 {
                    out_of_range(&place, *dt, "above 0", errors);
                    return None;
                }
                let Time { start, end } = time?;
                let intervals = (end - start) / dt;
                if intervals >= MOST_TIMES as f64 {
                    too_many(&place, intervals, errors);
                    return None;
                }
                // Drop a last interval between output times that is zero up to rounding.
                let whole = (intervals * (1.0 - 4.0 * f64::EPSILON)).floor() as usize;
                Some((0..=whole).map(|k| start + k as f64 * dt).chain([end]).collect())
            }
            Times::List(times) => {
                check_list(times, time, &place, errors);
                Some(times.clone())
            }
        }
    }

    /// Returns the indices of the columns of the trajectory to keep.
    pub(super) fn fields(&self, columns: &Columns<'_>, place: &Pointer<'_>, errors: &mut Errors) -> Vec<usize> {
        let Some(fields) = &self.fields else { return columns.kept() };
        let place = place.key("fields");
        let names = || columns.names();
        let positions: HashMap<&str, usize> = names().zip(0..).collect();
        // Names that occur twice among the columns of the trajectory are reported elsewhere, and each still has a
        // column.
        let mut taken = vec![false; names().count()];
        let mut kept = Vec::with_capacity(fields.len());
        for (i, field) in fields.iter().enumerate() {
            let place = place.index(i);
            if field == ALL {
                let fresh = columns.kept().into_iter().filter(|&found| !std::mem::replace(&mut taken[found], true));
                kept.extend(fresh);
                continue;
            }
            match positions.get(field.as_str()) {
                Some(&found) if taken[found] => {
                    errors.report(&place, "duplicate_name", format!("`{field}` is named already"));
                }
                Some(&found) => {
                    taken[found] = true;
                    kept.push(found);
                }
                None => errors.push_with(|| {
                    let detail =
                        format!("`{}` is not an output: neither a state, a variable nor a definition", abridged(field));
                    SpecificationError::new(place.to_string(), "unknown_name", detail)
                        .expected(listed(names()))
                        .did_you_mean(nearest(field, names()))
                }),
            }
        }
        kept
    }
}

/// The columns that a trajectory may have, from which the user selects those to keep.
pub(super) struct Columns<'a> {
    /// Names of the outputs of the problem.
    pub outputs: &'a [&'a str],
    /// Range of the outputs of the problem that are kept by default.
    pub default: Range<usize>,
    /// User-defined columns (definitions and integrals), of which integrals are kept by default.
    pub observables: &'a Observables,
    /// Names of the sensitivity columns, which are kept by default.
    pub derivatives: &'a [String],
}

impl Columns<'_> {
    fn names(&self) -> impl Iterator<Item = &str> + Clone {
        let further = self.observables.names.iter().chain(self.derivatives);
        self.outputs.iter().copied().chain(further.map(String::as_str))
    }

    /// Returns the names of the columns of the trajectory with the indices `fields`.
    pub fn named(&self, fields: &[usize]) -> Vec<String> {
        fields.iter().filter_map(|field| self.names().nth(*field)).map(str::to_owned).collect()
    }

    /// Returns the indices of the columns of the trajectory that are kept by default.
    fn kept(&self) -> Vec<usize> {
        let observables = self.outputs.len() + self.observables.names.len();
        let further = observables - self.observables.integrals..observables + self.derivatives.len();
        self.default.clone().chain(further).collect()
    }
}

fn interpolate(start: f64, end: f64, fraction: f64) -> f64 {
    if fraction == 1.0 { end } else { start + fraction * (end - start) }
}

fn too_many(place: &Pointer<'_>, times: f64, errors: &mut Errors) {
    let error = SpecificationError::new(place.to_string(), "too_many_times", format!("{times:.0} output times"));
    errors.push(error.expected(format!("at most {MOST_TIMES} output times")));
}

fn check_list(times: &[f64], time: Option<Time>, place: &Pointer<'_>, errors: &mut Errors) {
    if times.is_empty() {
        let error = SpecificationError::new(place.to_string(), "empty", "no output times");
        errors.push(error.expected("at least one time"));
    }
    if times.len() > MOST_TIMES {
        too_many(place, times.len() as f64, errors);
    }
    for (i, pair) in times.windows(2).enumerate().filter(|(_, pair)| pair[1] <= pair[0]) {
        let detail = format!("{} does not come after {}", pair[1], pair[0]);
        errors.push(
            SpecificationError::new(place.index(i + 1).to_string(), "not_increasing", detail)
                .expected("strictly increasing times"),
        );
    }
    let Some(Time { start, end }) = time else { return };
    for (i, t) in times.iter().enumerate().filter(|(_, t)| !(start..=end).contains(*t)) {
        let detail = format!("{t} is outside the time horizon");
        errors.push(
            SpecificationError::new(place.index(i).to_string(), "outside_horizon", detail)
                .expected(format!("from {start} to {end}")),
        );
    }
}
