//! Parameter sweeps: the problem is solved for many values of some of its numbers, and each member gives one row of a
//! table.

mod collect;
mod design;
mod range;
mod sobol;
mod target;

pub use collect::{AtTime, Reducer, Selector};
pub use design::{Design, DesignName};
pub use range::{Range, Rule};
pub use target::Target;

pub(super) use collect::Nameable;
pub(super) use target::{lift, set};

use super::checked::Specification;
use super::choices::choices;
use super::digest::{digest, hexadecimal};
use super::error::{Errors, SpecificationError};
use super::json::Json;
use super::lowering::Start;
use super::method::out_of_range;
use super::ordered::Ordered;
use super::pointer::Pointer;
use super::{reading, robot, vectors};
use problem::Control;
use serde::Deserialize;
use solution::Reducers;
use std::ops;
use std::sync::Arc;
use std::time::Duration;
use target::{targets, unknown};
use utoipa::ToSchema;

choices! {
    /// Data kept of each run of a sweep beside its row.
    KeepName {
        "nothing" Nothing: "The row alone: trajectories would take as much for each member as a solve does."
        "trajectories" Trajectories: "The fields of `output` at its times, each a column of lists: `trajectory.x`."
    }
}

/// Largest number of members of a sweep (combinations of values of the swept numbers).
const MOST_MEMBERS: usize = 10_000_000;
/// Largest number of trajectory values that a sweep keeps: of all members (`MOST_KEPT`) and of one
/// (`MOST_KEPT_OF_ONE`).
const MOST_KEPT: usize = 10_000_000;
const MOST_KEPT_OF_ONE: usize = 1_000_000;
/// Largest number of strata of a Latin hypercube, members times swept numbers; each stratum takes four bytes.
const MOST_SLICES: u64 = 1 << 25;
/// The largest number of numbers that a sweep may vary: each is a column of its table.
const MOST_NAMES: usize = 256;

/// The problem solved for many values of some of its numbers. The answer is `table`, with one row per member, and a
/// `summary` of its columns. A member that fails has a row as well.
///
/// Names: a parameter `m`; `x.initial`, the initial value of a state; `theta.velocity`, the initial velocity of a
/// coordinate; `R1`, the value of a component; `ball.mass`, a number of any named object.
#[derive(Clone, Debug, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct SweepRequest {
    /// The values of each swept number, by its name.
    #[schema(value_type = Option<std::collections::BTreeMap<String, Range>>)]
    pub over: Option<Ordered<Range>>,
    /// The values of the swept numbers for all members, as an alternative to `over`.
    pub table: Option<TableOfMembers>,
    /// How members are formed from the values in `over`. Default `grid`, or `table` if that is given.
    pub design: Option<DesignName>,
    /// The number of members of the designs `random`, `sobol` and `latin_hypercube`.
    #[schema(minimum = 1, maximum = 10_000_000)]
    pub count: Option<u64>,
    /// The values to collect from each run, by column name. Default: the final value of every state.
    #[schema(value_type = Option<std::collections::BTreeMap<String, Reducer>>)]
    pub collect: Option<Ordered<Reducer>>,
    /// Data kept of each run beside its row.
    #[serde(default)]
    #[schema(value_type = KeepName, default = "nothing")]
    pub keep: KeepName,
    /// Seed of the random draws, which depend on the seed and the number of the member alone. Default 0.
    #[serde(default)]
    #[schema(default = 0)]
    pub seed: u64,
}

/// The values of the swept numbers, one row per member.
#[derive(Clone, Debug, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct TableOfMembers {
    /// The names of the swept numbers.
    pub columns: Vec<String>,
    /// One row per member, with one value for each of `columns`.
    pub rows: Vec<Vec<f64>>,
}

/// A sweep that has passed every check.
#[derive(Clone, Debug)]
pub struct SweepPlan {
    /// The swept numbers, in the order of the document.
    pub targets: Vec<Target>,
    /// The values of the swept numbers for every member.
    pub design: Arc<Design>,
    /// The values to collect from the run of each member.
    pub reducers: Reducers,
    /// SHA-256 of the document of the sweep, independent of its layout.
    pub digest: Arc<str>,
    /// The document of the sweep, before vectors are expanded.
    source: Arc<Json>,
    /// Fields and times of the trajectories kept of each member; `None` to keep no trajectories.
    pub kept: Option<Arc<Kept>>,
    /// The members of the sweep to solve; `None` for all members.
    chunk: Option<SweepChunk>,
}

/// Consecutive members of a sweep, solved as one unit of work.
#[derive(Clone, Debug, PartialEq)]
pub struct SweepChunk {
    /// Indices of the members in the sweep.
    pub members: ops::Range<usize>,
    /// Code and message of the reason why the members cannot be solved, which their rows report; `None` if they can
    /// be solved.
    pub lost: Option<(String, String)>,
    /// Time limit after which no further member is started; at least one member is solved.
    pub within: Option<Duration>,
}

/// Fields and times of the trajectories kept of each member of a sweep.
#[derive(Clone, Debug, PartialEq)]
pub struct Kept {
    /// Names of the fields whose trajectories are kept.
    pub names: Vec<String>,
    /// Times at which the values of the fields are kept.
    pub times: Vec<f64>,
}

/// The inputs to the check of a sweep, prepared while the document was read.
#[derive(Clone, Debug, Default)]
pub(super) struct Prepared {
    /// The swept numbers, each with its name and the parameter that stands for it.
    pub targets: Vec<Target>,
    /// The document before its vectors are expanded; `None` for a document without a sweep.
    pub source: Option<Arc<Json>>,
}

impl SweepRequest {
    /// Checks the request for a sweep and returns its plan; errors are appended to `errors`.
    pub(super) fn check(
        &self,
        prepared: &Prepared,
        nameable: &Nameable<'_>,
        horizon: (f64, f64),
        (problem, start): (&Pointer<'_>, Start<'_>),
        errors: &mut Errors,
    ) -> Option<SweepPlan> {
        let place = Pointer::Root.key("sweep");
        let mut found = Errors::default();
        let design = self.design(&place, &mut found);
        let reducers = collect::lower(self.collect.as_ref(), nameable, horizon, (problem, start), &mut found);
        self.check_names(&reducers, &place, &mut found);
        let is_whole = found.is_empty();
        errors.append(found);
        let source = Arc::clone(prepared.source.as_ref()?);
        let (design, targets) = (design?, prepared.targets.clone());
        if !is_whole || targets.len() != design.ranges().len() {
            return None;
        }
        let digest = hexadecimal(&digest(source.to_string().as_bytes()));
        Some(SweepPlan {
            targets,
            design: Arc::new(design),
            reducers,
            digest: digest.into(),
            source,
            kept: None,
            chunk: None,
        })
    }

    /// Reports names of collected values that another column of the table of the sweep already has.
    fn check_names(&self, reducers: &Reducers, place: &Pointer<'_>, errors: &mut Errors) {
        let own =
            ["member", "status", "trusted", "error", "steps", "switches", "residual", "warnings", "period", "stable"];
        let swept: Vec<&str> = match (&self.over, &self.table) {
            (Some(over), _) => over.names().collect(),
            (None, Some(table)) => table.columns.iter().map(String::as_str).collect(),
            (None, None) => Vec::new(),
        };
        if self.collect.is_none() {
            return;
        }
        let place = place.key("collect");
        for name in &reducers.names {
            if own.contains(&name.as_str()) || swept.contains(&name.as_str()) {
                errors.report(&place.key(name), "duplicate_name", "the table already has a column with this name");
            }
        }
    }

    fn design(&self, place: &Pointer<'_>, errors: &mut Errors) -> Option<Design> {
        let ranges = match (&self.over, &self.table) {
            (Some(_), Some(_)) => {
                errors.report(&place.key("table"), "conflict", "`over` and `table` both define the members");
                return None;
            }
            (None, None) => {
                let error = SpecificationError::new(place.to_string(), "missing_key", "`over` is missing");
                errors.push(error.expected("`over`, such as `{\"m\": {\"linspace\": [0.1, 1, 10]}}`, or `table`"));
                return None;
            }
            (Some(over), None) => {
                let place = place.key("over");
                over.iter().for_each(|(name, range)| range.check(&place.key(name), errors));
                if over.is_empty() {
                    errors.report(&place, "empty", "no name is swept");
                }
                over.iter().map(|(_, range)| range.clone()).collect()
            }
            (None, Some(table)) => table.ranges(&place.key("table"), errors)?,
        };
        if ranges.len() > MOST_NAMES {
            let error =
                SpecificationError::new(place.to_string(), "too_many_unknowns", format!("{} names", ranges.len()));
            errors.push(error.expected(format!("at most {MOST_NAMES}")));
            return None;
        }
        let name = match (self.design, &self.table) {
            (None, Some(_)) => DesignName::Table,
            (None, None) => DesignName::Grid,
            (Some(DesignName::Table), None) => {
                errors.report(&place.key("design"), "conflict", "`table` is missing: the columns and rows of values");
                return None;
            }
            (Some(name), Some(_)) if name != DesignName::Table => {
                errors.report(&place.key("design"), "conflict", "`table` has the values of all members already");
                return None;
            }
            (Some(name), _) => name,
        };
        if !errors.is_empty() {
            return None;
        }
        let members = self.members(name, &ranges, place, errors)?;
        if !(1..=MOST_MEMBERS).contains(&members) {
            let error = SpecificationError::new(place.to_string(), "too_many_runs", format!("{members} members"));
            errors.push(error.expected(format!("at most {MOST_MEMBERS}")));
            return None;
        }
        Some(Design::new(name, ranges, members, self.seed))
    }

    fn members(&self, name: DesignName, ranges: &[Range], place: &Pointer<'_>, errors: &mut Errors) -> Option<usize> {
        let is_drawn = matches!(name, DesignName::Random | DesignName::Sobol | DesignName::LatinHypercube);
        let key = place.key("count");
        match self.count {
            None if is_drawn => {
                let error = SpecificationError::new(place.to_string(), "missing_key", "`count` is missing");
                errors.push(error.expected(format!("`count`, the number of members of `{}`", name.name())));
                return None;
            }
            Some(0) => {
                out_of_range(&key, 0.0, "at least 1", errors);
                return None;
            }
            Some(_) if !is_drawn => {
                let detail = format!("the number of members of a `{}` follows from `over` or `table`", name.name());
                let error = SpecificationError::new(key.to_string(), "conflict", detail);
                errors
                    .push(error.expected("no `count`, or one of the designs `random`, `sobol` and `latin_hypercube`"));
                return None;
            }
            _ => {}
        }
        if name == DesignName::Sobol && ranges.len() > design::MOST_SOBOL {
            let detail = format!("{} names in a Sobol sequence", ranges.len());
            let error = SpecificationError::new(place.key("over").to_string(), "too_many_unknowns", detail);
            errors.push(error.expected(format!("at most {}, or the design `latin_hypercube`", design::MOST_SOBOL)));
            return None;
        }
        if name == DesignName::LatinHypercube
            && self.count.is_some_and(|count| count.saturating_mul(ranges.len() as u64) > MOST_SLICES)
        {
            let detail = "this Latin hypercube has too many names times members";
            let error = SpecificationError::new(key.to_string(), "too_many_runs", detail);
            errors.push(error.expected(format!("at most {MOST_SLICES}, or the design `random` or `sobol`")));
            return None;
        }
        if is_drawn {
            return Some(self.count.and_then(|count| usize::try_from(count).ok()).unwrap_or(usize::MAX));
        }
        let names: Vec<&str> = self.over.iter().flat_map(|over| over.names()).collect();
        let mut counts = Vec::with_capacity(ranges.len());
        for (i, range) in ranges.iter().enumerate() {
            match range.points() {
                Some(points) => counts.push(points),
                None => {
                    let place = place.key("over");
                    let detail = format!("a distribution has no points for the design `{}`", name.name());
                    let error = SpecificationError::new(
                        place.key(names.get(i).copied().unwrap_or("")).to_string(),
                        "conflict",
                        detail,
                    );
                    errors.push(error.expected(
                        "a list, `linspace` or `logspace`, or `\"design\": \"random\"` (`sobol`, `latin_hypercube`) with a `count`",
                    ));
                }
            }
        }
        if counts.len() < ranges.len() {
            return None;
        }
        if name == DesignName::Grid {
            return Some(counts.iter().fold(1, |product: usize, count| product.saturating_mul(*count)));
        }
        let first = counts.first().copied().unwrap_or(0);
        if let Some(i) = counts.iter().position(|count| *count != first) {
            let place = place.key("over");
            let detail = format!("{} values, where `{1}` has {first}", counts[i], names.first().copied().unwrap_or(""));
            let error = SpecificationError::new(
                place.key(names.get(i).copied().unwrap_or("")).to_string(),
                "wrong_count",
                detail,
            );
            errors.push(error.expected("the same number of values for all names"));
            return None;
        }
        Some(first)
    }
}

impl SweepPlan {
    /// Sets the fields and times of the trajectories to keep of each member, if `request` asks to keep trajectories.
    pub(super) fn keep(
        &mut self,
        request: &SweepRequest,
        (names, times): (Vec<String>, Option<&[f64]>),
        is_search: bool,
        errors: &mut Errors,
    ) {
        if request.keep == KeepName::Nothing {
            return;
        }
        let place = Pointer::Root.key("sweep");
        let place = place.key("keep");
        if is_search {
            let detail = "an orbit or a state of rest is kept by what is collected of it";
            return errors.report(&place, "conflict", detail);
        }
        let Some(times) = times else {
            let detail = "how many steps each member takes is not known beforehand";
            let error = SpecificationError::new(place.to_string(), "missing_key", detail);
            return errors.push(error.expected("times, such as `\"output\": {\"times\": {\"count\": 101}}`"));
        };
        let of_one = times.len().saturating_mul(names.len());
        let values = of_one.saturating_mul(self.members());
        if of_one > MOST_KEPT_OF_ONE || values > MOST_KEPT {
            let detail = format!(
                "{values} numbers: {} times of {} fields of {} members",
                times.len(),
                names.len(),
                self.members()
            );
            let error = SpecificationError::new(place.to_string(), "too_many_runs", detail);
            return errors.push(error.expected(format!(
                "at most {MOST_KEPT} numbers, {MOST_KEPT_OF_ONE} of a member: fewer `output.times` or `output.fields`, or what is collected"
            )));
        }
        let is_column = |name: &str| {
            self.reducers.names.iter().any(|known| known == name)
                || self.targets.iter().any(|target| target.name == name)
        };
        if let Some(name) = names.iter().map(|name| column_of(name)).find(|name| is_column(name)) {
            let detail = format!("the table has a column `{name}` already, which the trajectory would have");
            return errors.report(&place, "duplicate_name", detail);
        }
        self.kept = Some(Arc::new(Kept { names, times: times.to_vec() }));
    }

    /// Number of values kept of the trajectory of one member of the sweep.
    pub fn numbers_kept(&self) -> usize {
        self.kept.as_ref().map_or(0, |kept| kept.names.len() * kept.times.len())
    }
}

/// Returns the name of the column of the table of a sweep that holds the trajectory of a field.
fn column_of(field: &str) -> String {
    format!("trajectory.{field}")
}

impl Kept {
    /// Returns the names of the columns of the table of a sweep that hold the kept trajectories.
    pub fn columns(&self) -> impl Iterator<Item = String> {
        self.names.iter().map(|name| column_of(name))
    }
}

impl TableOfMembers {
    fn ranges(&self, place: &Pointer<'_>, errors: &mut Errors) -> Option<Vec<Range>> {
        let rows = place.key("rows");
        if self.columns.is_empty() || self.rows.is_empty() {
            errors.report(place, "empty", "a table of members has at least one column and one row");
            return None;
        }
        if let Some(i) = (1..self.columns.len()).find(|&i| self.columns[..i].contains(&self.columns[i])) {
            errors.report(&place.key("columns").index(i), "duplicate_name", "another column has the same name");
            return None;
        }
        let count = self.columns.len();
        if let Some(i) = self.rows.iter().position(|row| row.len() != count) {
            let detail = format!("{} values for {count} columns", self.rows[i].len());
            let error = SpecificationError::new(rows.index(i).to_string(), "wrong_count", detail);
            errors.push(error.expected("one value for each column"));
            return None;
        }
        let column = |i: usize| Range::List(self.rows.iter().filter_map(|row| row.get(i).copied()).collect());
        Some((0..count).map(column).collect())
    }
}

impl SweepPlan {
    /// Number of members of the sweep, each of which is one run.
    pub fn members(&self) -> usize {
        self.design.members()
    }

    /// Returns the members of the sweep to solve: all members, or a part of them.
    pub fn chunk(&self) -> SweepChunk {
        let all = || SweepChunk { members: 0..self.members(), lost: None, within: None };
        self.chunk.clone().unwrap_or_else(all)
    }
}

impl Specification {
    /// Restricts the sweep to the members of `chunk`; indices beyond the last member are dropped.
    #[must_use]
    pub fn with_chunk(mut self, chunk: SweepChunk) -> Self {
        if let Some(plan) = self.sweep_mut() {
            let end = chunk.members.end.min(plan.members());
            let members = chunk.members.start.min(end)..end;
            plan.chunk = Some(SweepChunk { members, ..chunk });
        }
        self
    }

    /// Returns the specification of the member with the given values of the swept numbers, bound as parameters.
    ///
    /// # Errors
    /// Values that cannot be bound, for example because they change the structure of the problem.
    pub fn member(&self, values: &[f64]) -> Result<Self, Vec<SpecificationError>> {
        let Some(plan) = self.sweep() else { return Ok(self.clone()) };
        let given: Vec<(&str, f64)> =
            plan.targets.iter().map(|target| target.parameter.as_str()).zip(values.iter().copied()).collect();
        self.with_parameters(&given)
    }

    /// Returns the specification of a member, read anew from the document: for values that change the structure, and
    /// problem types that fold parameters into constants.
    ///
    /// # Errors
    /// Errors in the specification with these values.
    pub fn member_anew(&self, values: &[f64], control: &Control) -> Result<Self, Vec<SpecificationError>> {
        let Some(plan) = self.sweep() else { return Ok(self.clone()) };
        let given: Vec<(String, f64)> =
            plan.targets.iter().map(|target| target.name.clone()).zip(values.iter().copied()).collect();
        Self::from_tree((*plan.source).clone(), &given, control)
    }
}

/// Returns the text of a document with new values for some of its numbers, given by name or JSON pointer. A value is
/// JSON, or else the text of an expression.
///
/// # Errors
/// The text is not JSON, or a name is unknown.
pub fn edited(text: &[u8], settings: &[(String, String)]) -> Result<Vec<u8>, Vec<SpecificationError>> {
    let mut json = reading::tree(text)?;
    let mut errors = Errors::default();
    let mut is_written_out = false;
    for (name, value) in settings {
        let value = serde_json::from_str(value).unwrap_or_else(|_| Json::Text(value.clone()));
        if name.is_empty() || name.starts_with('/') {
            target::put_at(&mut json, name, value, &mut errors);
            continue;
        }
        let mut known = targets(&json);
        if !known.iter().any(|(known, _)| known == name) && !is_written_out {
            let mut written = json.clone();
            robot::write_out(&mut written, &mut Errors::default());
            robot::forget(&mut written);
            vectors::write_out(&mut written, &mut Errors::default());
            let others = targets(&written);
            if others.iter().any(|(known, _)| known == name) {
                (json, is_written_out) = (written, true);
            }
            known = others;
        }
        match known.iter().find(|(known, _)| known == name) {
            Some((_, path)) => target::put(&mut json, path, value),
            None => errors.push(unknown(name, String::new(), &known)),
        }
    }
    if errors.is_empty() { Ok(json.to_string().into_bytes()) } else { Err(errors.into_list()) }
}
