//! A solution without its columns, as JSON: everything in an answer other than the numbers of its trajectory and
//! table.

use crate::{
    Branch, Checked, EndedBy, Event, EventSlope, Failure, FitAnswer, Orbit, Provenance, Solution, StaticSolution,
    Status, SteadyState, Summary, Table, Trajectory, Verdict, Version,
};
use serde::{Deserialize, Serialize};
use serde_json::value::RawValue;
use std::borrow::Cow;
use std::collections::BTreeMap;
use std::io;
use std::ops::RangeInclusive;

/// The JSON text of a trajectory with empty times and fields, which marks the positions of the columns.
const EMPTY: &str = "\"trajectory\":{\"t\":[],\"fields\":{},";

/// The JSON text at the beginning of a table of a sweep whose columns are stored separately.
const EMPTY_TABLE: &str = "\"table\":{\"columns\":{}";

/// The JSON of a solution in which the columns of the trajectory, and those of the table of a sweep, are empty.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Skeleton(String);

/// The members of a solution, of which diagnostics, table and study are kept as JSON text and not parsed.
#[derive(Serialize, Deserialize)]
struct Parts<'a> {
    #[serde(default)]
    version: Version,
    status: Status,
    #[serde(default)]
    verdict: Verdict,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    provenance: Option<Provenance>,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    error: Option<Failure>,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    ended_by: Option<EndedBy>,
    trajectory: Trajectory,
    #[serde(borrow, default, skip_serializing_if = "Option::is_none")]
    diagnostics: Option<Cow<'a, RawValue>>,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    sensitivities: Option<Checked>,
    #[serde(default, skip_serializing_if = "BTreeMap::is_empty")]
    gradient: BTreeMap<String, f64>,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    objective: Option<f64>,
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    event_slopes: Vec<EventSlope>,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    orbit: Option<Orbit>,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    steady_state: Option<SteadyState>,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    branch: Option<Branch>,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    fit: Option<FitAnswer>,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    solution: Option<StaticSolution>,
    #[serde(borrow, default, skip_serializing_if = "Option::is_none")]
    table: Option<Cow<'a, RawValue>>,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    summary: Option<Summary>,
    #[serde(borrow, default, skip_serializing_if = "Option::is_none")]
    study: Option<Cow<'a, RawValue>>,
}

/// Returns the JSON of the table of a sweep without its columns.
fn head_of(table: &Table) -> serde_json::Result<Box<RawValue>> {
    serde_json::value::to_raw_value(&Table { columns: Vec::new(), ..table.head() })
}

impl Skeleton {
    /// Returns the skeleton of a solution: its JSON with empty columns.
    ///
    /// # Errors
    /// Failure of serialisation, which does not occur for a valid solution.
    pub fn of(solution: &Solution) -> io::Result<Self> {
        let Solution {
            version,
            status,
            verdict,
            provenance,
            error,
            ended_by,
            trajectory,
            diagnostics,
            sensitivities,
            gradient,
            objective,
            event_slopes,
            orbit,
            steady_state,
            branch,
            table,
            summary,
            fit,
            solution: of_static,
            study,
            collected: _,
            dense: _,
        } = solution;
        let evidence = |text: serde_json::Result<Box<RawValue>>| text.map(Cow::Owned);
        let parts = Parts {
            version: *version,
            status: *status,
            verdict: verdict.clone(),
            provenance: provenance.clone(),
            error: error.clone(),
            ended_by: ended_by.clone(),
            trajectory: Trajectory { events: trajectory.events.clone(), ..Trajectory::default() },
            diagnostics: Some(evidence(serde_json::value::to_raw_value(diagnostics))?),
            sensitivities: sensitivities.clone(),
            gradient: gradient.clone(),
            objective: *objective,
            event_slopes: event_slopes.clone(),
            orbit: orbit.clone(),
            steady_state: steady_state.clone(),
            branch: branch.clone(),
            table: table.as_ref().map(|table| evidence(head_of(table))).transpose()?,
            summary: summary.clone(),
            fit: fit.clone(),
            solution: of_static.clone(),
            study: study.as_ref().map(|study| evidence(serde_json::value::to_raw_value(study))).transpose()?,
        };
        Ok(Self(serde_json::to_string(&parts)?))
    }

    /// Splits the JSON of a solution into its skeleton and its trajectory.
    ///
    /// # Errors
    /// The text is not the JSON of a solution.
    pub fn read(json: &[u8]) -> io::Result<(Self, Trajectory)> {
        let mut parts: Parts<'_> = serde_json::from_slice(json)?;
        let events = parts.trajectory.events.clone();
        let trajectory = std::mem::replace(&mut parts.trajectory, Trajectory { events, ..Trajectory::default() });
        Ok((Self(serde_json::to_string(&parts)?), trajectory))
    }

    /// Creates a skeleton from stored text.
    ///
    /// # Errors
    /// The text has no positions for columns.
    pub fn of_text(text: String) -> io::Result<Self> {
        let found = text.contains(EMPTY).then_some(Self(text));
        found.ok_or_else(|| io::Error::new(io::ErrorKind::InvalidData, "a solution has a trajectory"))
    }

    /// Returns the JSON text of the solution without its columns.
    pub fn text(&self) -> &str {
        &self.0
    }

    /// Returns the JSON text before the times, between times and fields, and after the fields. Quotes within JSON
    /// strings are escaped, so that no string can contain the text that marks these positions.
    pub fn around_columns(&self) -> [&str; 3] {
        let start = self.0.find(EMPTY).unwrap_or_default();
        let (times, fields) = ("\"trajectory\":{\"t\":".len(), EMPTY.len() - "{},".len());
        let between = start + times + "[]".len()..start + fields;
        [&self.0[..start + times], &self.0[between], &self.0[start + EMPTY.len() - ",".len()..]]
    }

    /// Returns the skeleton with only those events whose times are within `times`.
    ///
    /// # Errors
    /// The text is not that of a solution.
    pub fn within(&self, times: &RangeInclusive<f64>) -> io::Result<Self> {
        let mut parts: Parts<'_> = serde_json::from_str(&self.0)?;
        parts.trajectory.events.retain(|event: &Event| times.contains(&event.t));
        Ok(Self(serde_json::to_string(&parts)?))
    }

    /// Splits the JSON text at the position of the columns of the table of a sweep; returns `None` if the text has no
    /// table whose columns are stored separately.
    pub fn around_table(text: &str) -> Option<(&str, &str)> {
        let start = text.find(EMPTY_TABLE)? + EMPTY_TABLE.len() - "}".len();
        Some(text.split_at(start))
    }

    /// Returns the solution with the columns `trajectory`, and with `table` if the table of a sweep is stored
    /// separately.
    ///
    /// # Errors
    /// The text is not that of a solution.
    pub fn with(&self, trajectory: Trajectory, table: Option<Table>) -> io::Result<Solution> {
        let solution: Solution = serde_json::from_str(&self.0)?;
        let events = solution.trajectory.events;
        let table = table.or(solution.table);
        Ok(Solution { trajectory: Trajectory { events, ..trajectory }, table, ..solution })
    }

    /// Whether the solution has the table of a sweep. Quotes within JSON strings are escaped, so that no string can
    /// contain the text that is searched for.
    pub fn has_table(&self) -> bool {
        self.0.contains("\"table\":{\"columns\":")
    }

    /// Returns the provenance of the solution.
    ///
    /// # Errors
    /// The text is not that of a solution.
    pub fn provenance(&self) -> io::Result<Option<Provenance>> {
        Ok(serde_json::from_str::<Parts<'_>>(&self.0)?.provenance)
    }

    /// Returns the verdict on the solution.
    ///
    /// # Errors
    /// The text is not that of a solution.
    pub fn verdict(&self) -> io::Result<Verdict> {
        Ok(serde_json::from_str::<Parts<'_>>(&self.0)?.verdict)
    }
}
