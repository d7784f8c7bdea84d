//! The systems of the theory, each at a ladder of tolerances and steps: what a report is made of.

use crate::models::Model;
use crate::problem::Control;
use crate::solution::Series;
use crate::specification::{Example, Specification};
use serde::{Deserialize, Serialize};
use serde_json::{Value, json};
use std::collections::HashMap;
use std::fmt::Write as _;
use std::time::{Duration, Instant};

/// The tolerances and the numbers of stages that go with them.
const TOLERANCES: [f64; 4] = [1e-3, 1e-5, 1e-7, 1e-9];
/// Fixed steps in the horizon. With one stage this is implicit Euler, the first-order time stepping of other programs.
const STEPS: [f64; 4] = [100.0, 400.0, 1600.0, 6400.0];
/// The longest that one ladder may take.
const LONGEST: Duration = Duration::from_secs(10);

/// Times to compare at, which also tell how large each state is.
const TIMES: u32 = 33;

/// What is said of runs with a fixed step.
const FIXED: &str = " at fixed steps";

/// Answers from outside, by the name of the example.
const EXACT: &str = include_str!("exact.json");

/// What a report tells of one system.
#[derive(Clone, Debug, Deserialize, Serialize)]
pub struct Chapter {
    /// The name of its example.
    pub name: String,
    /// The title of its example.
    pub title: String,
    /// What the errors are measured against.
    pub reference: String,
    /// The runs.
    pub series: Vec<Series>,
}

#[derive(Deserialize)]
struct Known {
    exact: Value,
    source: String,
}

/// Runs all of one system. `None` where no ladder fits it.
pub fn chapter(example: &Example) -> Option<Chapter> {
    let document: Value = serde_json::from_str(example.text).ok()?;
    let known = serde_json::from_str::<HashMap<String, Known>>(EXACT).ok()?.remove(example.name);
    let specification = Specification::from_json(example.text.as_bytes()).ok()?;
    let horizon = specification.time().end - specification.time().start;
    let steps: Vec<f64> = STEPS.iter().map(|steps| horizon / steps).collect();
    let by_tolerance = json!({"rtol": TOLERANCES});
    let by_step = json!({"step": steps});
    let with = |mut ladder: Value, stages: Value| {
        ladder["stages"] = stages;
        ladder
    };
    let ladders = match specification.model() {
        Model::Dvi(_) => {
            vec![("", with(by_tolerance, json!([3, 5, "auto"]))), (FIXED, with(by_step, json!([1, 2, 3])))]
        }
        Model::Mechanical(_) => vec![(", located", by_tolerance), (FIXED, by_step)],
        Model::Convolution(_) => vec![(FIXED, with(by_step, json!([1, 2, 3])))],
        Model::RigidBodies(_) => vec![(FIXED, by_step)],
    };
    let mut chapter = Chapter {
        name: example.name.to_owned(),
        title: specification.label().unwrap_or(example.name).to_owned(),
        reference: String::new(),
        series: Vec::new(),
    };
    for (how, mut study) in ladders {
        if let Some(known) = &known {
            study["exact"] = known.exact.clone();
        }
        let mut document = document.clone();
        document["study"] = study;
        document["output"] = json!({"times": {"count": TIMES}});
        let Ok(ladder) = Specification::from_json(document.to_string().as_bytes()) else { continue };
        let control = Control::with_deadline(Instant::now() + LONGEST);
        let Some(found) = crate::solve(&ladder, &control).study else { continue };
        chapter.reference = match &known {
            Some(known) => known.source.clone(),
            None => found.reference,
        };
        chapter.series.extend(found.series.into_iter().map(|series| Series { method: series.method + how, ..series }));
    }
    (!chapter.series.is_empty()).then_some(chapter)
}

impl Chapter {
    /// Its rows as CSV, with a header.
    pub fn csv(&self) -> String {
        let mut text = String::from("system,method,rtol,step,status,steps,wall_seconds,error_at_end,order\n");
        for series in &self.series {
            for run in &series.runs {
                let cell = |value: Option<f64>| value.map_or_else(String::new, |value| value.to_string());
                let status = json!(run.status);
                // Writing to a string does not fail.
                let _ = writeln!(
                    text,
                    "{},{},{},{},{},{},{},{},{}",
                    self.name,
                    series.method,
                    cell(run.rtol),
                    cell(run.step),
                    status.as_str().unwrap_or_default(),
                    run.steps,
                    run.wall_seconds,
                    cell(run.error_at_end),
                    cell(run.order)
                );
            }
        }
        text
    }
}
