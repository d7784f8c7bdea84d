//! Other programs on the same systems: what is asked of them, and what comes back.
//!
//! A program gets the specification, the times of comparison and the names of the outputs. It returns values at these times,
//! so that its errors are measured here, against the same reference and in the same norm as all others.

use super::{Chapter, Ladder, Outcome, REPEATS, Run, STEPS, TOLERANCES, measure};
use serde::Deserialize;
use serde_json::{Value, json};
use specification::Rung;
use std::collections::HashMap;

/// A ladder of another program.
#[derive(Debug, Deserialize)]
pub struct Answer {
    /// The program and its method.
    pub method: String,
    /// From the coarsest.
    pub runs: Vec<AnswerRun>,
}

/// A run of another program.
#[derive(Debug, Deserialize)]
pub struct AnswerRun {
    /// Its relative tolerance.
    #[serde(default)]
    pub rtol: Option<f64>,
    /// Its step.
    #[serde(default)]
    pub step: Option<f64>,
    /// Steps, where the program counts them.
    #[serde(default)]
    pub steps: u64,
    /// The run times of the repeats, in seconds.
    pub seconds: Vec<f64>,
    /// By the name of the output, the values at the times of comparison; no outputs where the run did not reach the end.
    #[serde(default)]
    pub fields: HashMap<String, Vec<Option<f64>>>,
    /// The times of switches, where the program finds any.
    #[serde(default)]
    pub switches: Option<Vec<f64>>,
    /// Why there is no answer.
    #[serde(default)]
    pub message: Option<String>,
}

/// What a program is asked.
pub fn request(chapter: &Chapter) -> Value {
    let reference = &chapter.reference;
    let steps = STEPS.map(|steps| reference.horizon / steps);
    json!({
        "system": chapter.name, "specification": chapter.specification, "times": reference.times,
        "fields": reference.names, "tolerances": TOLERANCES, "steps": steps, "repeats": REPEATS,
    })
}

impl Answer {
    /// The ladder with its errors.
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
