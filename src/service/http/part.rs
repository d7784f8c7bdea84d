//! Results, or an excerpt of them.

use super::jobs::unreadable;
use super::problem::{Kind, Problem};
use crate::jobs::{JobId, Results};
use serde::{Deserialize, Serialize};
use serde_json::value::RawValue;
use solution::{Diagnostics, Excerpt, Failure, NoSuchField, Solution, Status, Trajectory, Verdict};
use std::sync::Arc;

/// The whole of results, or a part.
pub struct Part {
    results: Arc<Results>,
    /// The part, if it is not the whole; its evidence is that of the whole.
    excerpt: Option<Solution>,
}

/// What the JSON of a result has for evidence.
#[derive(Deserialize)]
struct Evidence<'a> {
    #[serde(borrow)]
    diagnostics: &'a RawValue,
    #[serde(borrow)]
    study: Option<&'a RawValue>,
}

/// The JSON of a part.
#[derive(Serialize)]
struct PartJson<'a> {
    status: Status,
    verdict: &'a Verdict,
    #[serde(skip_serializing_if = "Option::is_none")]
    error: &'a Option<Failure>,
    trajectory: &'a Trajectory,
    #[serde(skip_serializing_if = "Option::is_none")]
    diagnostics: Option<&'a RawValue>,
    #[serde(skip_serializing_if = "Option::is_none")]
    study: Option<&'a RawValue>,
}

/// Names that fit into an answer.
const MOST_NAMES: usize = 30;

impl Part {
    /// The part that `excerpt` asks for.
    ///
    /// # Errors
    /// [`Kind::BadQuery`] if it names a field that is not there, [`Kind::Unreadable`] if what was stored is no solution.
    pub fn of(job: JobId, results: Arc<Results>, excerpt: Option<&Excerpt>) -> Result<Self, Box<Problem>> {
        let solution = results.solution().map_err(|error| unreadable(job, &error))?;
        let Some(excerpt) = excerpt else { return Ok(Self { results, excerpt: None }) };
        let Solution { status, verdict, error, trajectory, .. } = solution;
        let part = Solution {
            version: solution.version,
            status: *status,
            verdict: verdict.clone(),
            error: error.clone(),
            trajectory: excerpt.of(trajectory).map_err(|missing| no_such_field(&missing, trajectory))?,
            diagnostics: Diagnostics::default(),
            study: None,
        };
        Ok(Self { results, excerpt: Some(part) })
    }

    /// Its columns, which were read when it was made.
    pub fn solution(&self) -> Option<&Solution> {
        self.excerpt.as_ref().or_else(|| self.results.solution().ok())
    }

    /// Its JSON.
    pub fn json(&self) -> Vec<u8> {
        let Some(Solution { status, verdict, error, trajectory, .. }) = self.solution() else { return Vec::new() };
        let evidence = serde_json::from_slice::<Evidence<'_>>(self.results.json()).ok();
        let (diagnostics, study) = evidence.map_or((None, None), |found| (Some(found.diagnostics), found.study));
        // Every number of a solution is finite, so that it has a JSON form.
        serde_json::to_vec(&PartJson { status: *status, verdict, error, trajectory, diagnostics, study })
            .unwrap_or_default()
    }
}

fn no_such_field(NoSuchField(name): &NoSuchField, trajectory: &Trajectory) -> Box<Problem> {
    let names: Vec<&str> = trajectory.fields.iter().take(MOST_NAMES).map(|field| field.name.as_str()).collect();
    let rest = if trajectory.fields.len() > MOST_NAMES { " and more" } else { "" };
    Problem::new(Kind::BadQuery, format!("fields: there is no {name}; there are {}{rest}", names.join(", ")))
}
