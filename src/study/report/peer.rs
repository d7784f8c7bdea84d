//! Runs of other programs on the example systems: the request to a program, and its answer.
//!
//! A program receives the specification, the comparison times and the names of the outputs. It returns values at
//! these times, so that its errors are measured by this program, against the reference and in the norm that are used
//! for all runs.

use super::{Chapter, Ladder, Outcome, REPEATS, Run, STEPS, TOLERANCES, measure};
use serde::Deserialize;
use serde_json::{Value, json};
use specification::Rung;
use std::collections::HashMap;

/// A ladder of another program (series of runs of one method, from coarse to fine), as that program returns it.
#[derive(Debug, Deserialize)]
pub struct Answer {
    /// Name of the program and its method.
    pub method: String,
    /// Runs of the ladder, from the coarsest tolerance or step size to the finest.
    pub runs: Vec<AnswerRun>,
}

/// A run of another program.
#[derive(Debug, Deserialize)]
pub struct AnswerRun {
    /// Relative tolerance of the run; `None` for a run with fixed steps.
    #[serde(default)]
    pub rtol: Option<f64>,
    /// Fixed step size of the run; `None` for a run with adaptive steps.
    #[serde(default)]
    pub step: Option<f64>,
    /// Number of steps of the run, if the program counts its steps.
    #[serde(default)]
    pub steps: u64,
    /// The run times of the repeats of the run, in seconds.
    pub seconds: Vec<f64>,
    /// Values at the comparison times, by the name of the output; no outputs if the run did not reach the end.
    #[serde(default)]
    pub fields: HashMap<String, Vec<Option<f64>>>,
    /// Times of the switches of the run, if the program finds any.
    #[serde(default)]
    pub switches: Option<Vec<f64>>,
    /// Why the run has no answer, as a message.
    #[serde(default)]
    pub message: Option<String>,
}

/// Returns the request to solve the system of a chapter, which is sent to another program.
pub fn request(chapter: &Chapter) -> Value {
    let reference = &chapter.reference;
    let steps = STEPS.map(|steps| reference.horizon / steps);
    json!({
        "system": chapter.name, "specification": chapter.specification, "times": reference.times,
        "fields": reference.names, "tolerances": TOLERANCES, "steps": steps, "repeats": REPEATS,
    })
}

impl Answer {
    /// Returns the runs of the answer as a ladder, with their errors against the reference of the chapter.
    pub fn ladder(self, chapter: &Chapter) -> Ladder {
        let mut runs: Vec<Run> = Vec::with_capacity(self.runs.len());
        for answer in self.runs {
            let mut run = answer.run(chapter);
            run.change = runs.last().and_then(|before| measure::change(before, &run));
            runs.push(run);
        }
        Ladder { method: self.method, runs }
    }
}

impl AnswerRun {
    fn run(self, chapter: &Chapter) -> Run {
        let reference = &chapter.reference;
        let columns: HashMap<&str, Vec<f64>> = self
            .fields
            .iter()
            .filter(|(_, values)| values.len() == reference.times.len())
            .map(|(name, values)| (name.as_str(), values.iter().map(|value| value.unwrap_or(f64::NAN)).collect()))
            .collect();
        let found: Vec<Option<&[f64]>> =
            reference.names.iter().map(|name| columns.get(name.as_str()).map(Vec::as_slice)).collect();
        let errors = (!columns.is_empty()).then(|| reference.errors(&found, self.switches.as_deref()));
        let rung = match (self.rtol, self.step) {
            (Some(rtol), _) => Rung::Tolerance(rtol),
            (None, step) => Rung::Step(step.unwrap_or(f64::NAN)),
        };
        let outcome = if errors.is_some() { Outcome::Completed } else { Outcome::Failed };
        Run { outcome, steps: self.steps, errors, message: self.message, ..Run::at(rung) }.timed(self.seconds)
    }
}
