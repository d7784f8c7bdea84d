//! The systems of the theory, each at a ladder of tolerances and steps: what a report is made of.

use problem::Control;
use serde::{Deserialize, Serialize};
use serde_json::{Map, Value, json};
use solution::pictures::{Curve, curves, overview};
use solution::{Series, Status};
use specification::{By, Example, Specification};
use std::collections::HashMap;
use std::fmt::Write as _;
use std::time::{Duration, Instant};

/// The tolerances of runs that choose their steps.
pub const TOLERANCES: [f64; 4] = [1e-3, 1e-5, 1e-7, 1e-9];
/// Fixed steps in the horizon. With one stage this is implicit Euler, the first-order time stepping of other programs.
const STEPS: [f64; 4] = [100.0, 400.0, 1600.0, 6400.0];
/// The longest that one ladder may take.
const LONGEST: Duration = Duration::from_secs(10);

/// Times to compare at, which also tell how large each state is.
const TIMES: u32 = 33;

/// The methods that show in the picture of all systems: of each the first that it has been run by.
const CHOSEN: [&str; 5] = ["stages chosen", "contact, located", "tr_bdf2", "3 stages", "3 stages at fixed steps"];
const FIRST_ORDER: [&str; 2] = ["1 stage at fixed steps", "contact at fixed steps"];

/// Answers from outside, by the name of the example. Where another program gives them and is not published, it is in
/// `tests/peers/answers`.
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
    /// Whether that comes from outside: a closed form, or another program.
    pub outside: bool,
    /// The runs.
    pub series: Vec<Series>,
    /// Those of other programs.
    pub peers: Vec<Series>,
}

/// What is known of a system.
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Known {
    /// Expressions in `t`, by the name of the output.
    exact: Value,
    /// Where they are from.
    source: String,
    /// Another end than that of the example, where what is known is known of.
    end: Option<f64>,
}

/// Runs all of one system. `None` where no ladder fits it.
pub fn chapter(example: &Example) -> Option<Chapter> {
    let mut document: Value = serde_json::from_str(example.text).ok()?;
    let known = serde_json::from_str::<HashMap<String, Known>>(EXACT).ok()?.remove(example.name);
    if let Some(end) = known.as_ref().and_then(|known| known.end) {
        document["time"]["end"] = end.into();
    }
    let specification = Specification::from_json(document.to_string().as_bytes()).ok()?;
    let horizon = specification.time().end - specification.time().start;
    let steps: Vec<f64> = STEPS.iter().map(|steps| horizon / steps).collect();
    let ladders = specification.model().varied().ladders.iter().map(|ladder| {
        let mut study = match ladder.by {
            By::Tolerance => json!({"rtol": TOLERANCES}),
            By::Step => json!({"step": steps}),
        };
        if !ladder.stages.is_empty() {
            study["stages"] = json!(ladder.stages);
        }
        (ladder.name, study)
    });
    let mut chapter = Chapter {
        name: example.name.to_owned(),
        title: specification.label().unwrap_or(example.name).to_owned(),
        reference: String::new(),
        outside: known.is_some(),
        series: Vec::new(),
        peers: Vec::new(),
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
    /// The runs here and those of other programs.
    pub fn all(&self) -> impl Iterator<Item = &Series> {
        self.series.iter().chain(&self.peers)
    }

    /// How many of the answers of its runs are trusted, and of how many that reached the end.
    pub fn trusted(&self) -> (usize, usize) {
        let ended = self.series.iter().flat_map(|series| &series.runs).filter(|run| run.status == Status::Completed);
        ended.filter_map(|run| run.trusted).fold((0, 0), |(trusted, all), one| (trusted + usize::from(one), all + 1))
    }

    /// Its rows as CSV, with a header.
    pub fn csv(&self) -> String {
        let mut text = String::from("system,method,rtol,step,status,trusted,steps,wall_seconds,error_at_end,order\n");
        for series in self.all() {
            for run in &series.runs {
                let cell = |value: Option<f64>| value.map_or_else(String::new, |value| value.to_string());
                let status = json!(run.status);
                // Writing to a string does not fail.
                let _ = writeln!(
                    text,
                    "{},{},{},{},{},{},{},{},{},{}",
                    self.name,
                    series.method,
                    cell(run.rtol),
                    cell(run.step),
                    status.as_str().unwrap_or_default(),
                    run.trusted.map_or_else(String::new, |trusted| trusted.to_string()),
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

/// All systems with an answer from outside in one picture: the first-order time stepping of other programs beside what is
/// chosen here without being told.
pub fn picture(chapters: &[Chapter]) -> String {
    let pick = |chapter: &Chapter, methods: &[&str], name: &str| {
        let found = curves(&chapter.series);
        let by = |method: &&str| found.iter().find(|curve| curve.name == **method && !curve.points.is_empty());
        let run = methods.iter().find_map(by);
        Curve {
            name: name.to_owned(),
            points: run.map_or_else(Vec::new, |curve| curve.points.clone()),
            untrusted: run.map_or_else(Vec::new, |curve| curve.untrusted.clone()),
        }
    };
    let panels: Vec<(&str, Vec<Curve>)> = chapters
        .iter()
        .filter(|chapter| chapter.outside)
        .map(|chapter| {
            let chosen = pick(chapter, &CHOSEN, "tolerances from 1e-3 to 1e-9");
            (chapter.name.as_str(), vec![chosen, pick(chapter, &FIRST_ORDER, "time stepping of first order")])
        })
        .collect();
    overview(&panels, "Error against run time", "relative error at the end", "run time in s")
}

/// What is known of the end of a system by name, where that is a number: for programs that solve it too.
pub fn exact_end(name: &str) -> Option<Map<String, Value>> {
    let known = serde_json::from_str::<HashMap<String, Known>>(EXACT).ok()?.remove(name)?;
    let Value::Object(exact) = known.exact else { return None };
    exact.values().all(Value::is_number).then_some(exact)
}

#[cfg(test)]
mod tests {
    use super::*;
    use specification::EXAMPLES;

    #[test]
    fn what_is_known_is_known_of_examples_and_reads_as_a_study_of_them() {
        let known: HashMap<String, Known> = serde_json::from_str(EXACT).expect("a table");
        for (name, known) in known {
            let example = EXAMPLES.iter().find(|example| example.name == name);
            let text = example.unwrap_or_else(|| panic!("`{name}` is no example")).text;
            let mut document: Value = serde_json::from_str(text).expect("JSON");
            let end = known.end.unwrap_or_else(|| document["time"]["end"].as_f64().expect("an end"));
            document["time"]["end"] = end.into();
            let start = document["time"]["start"].as_f64().unwrap_or(0.0);
            document["study"] = json!({"step": [end - start], "exact": known.exact});
            let read = Specification::from_json(document.to_string().as_bytes());
            assert!(read.is_ok(), "{name}: {:#?}", read.err());
        }
    }
}
