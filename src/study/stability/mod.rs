//! Stability at the limits, as a table of cases: stiff and extreme problems for all steppers, each with its expected
//! outcome. The cases are data (`cases/*.json`); a failing case is reported as such.

mod evidence;
mod expectation;

pub use evidence::Stability;
pub use expectation::{Events, Expectation, ExpectedError, ExpectedValues, Finding};

use problem::Control;
use serde::{Deserialize, Serialize};
use serde_json::{Map, Value};
use solution::{Solution, Status};
use specification::Specification;
use std::fmt::Write as _;
use std::time::Instant;

/// Parts of the table of stability cases: name, and cases as JSON.
const PARTS: [(&str, &str); 7] = [
    ("stiff", include_str!("cases/stiff.json")),
    ("scales", include_str!("cases/scales.json")),
    ("inequalities", include_str!("cases/inequalities.json")),
    ("contact", include_str!("cases/contact.json")),
    ("bodies", include_str!("cases/bodies.json")),
    ("circuits_and_memory", include_str!("cases/circuits_and_memory.json")),
    ("refusals", include_str!("cases/refusals.json")),
];

/// A stability case as written in JSON: a single case, or one for each of the values in `with`.
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Written {
    name: String,
    title: String,
    specification: Value,
    /// Values by JSON pointer of the specification that they are set at. The lists are traversed in parallel, one case
    /// per position in the lists.
    #[serde(default)]
    with: Map<String, Value>,
    expect: Vec<Expectation>,
}

/// A case of the table of stability cases.
#[derive(Clone, Debug)]
pub struct Case {
    /// Name of the part of the table that the stability case belongs to.
    pub part: &'static str,
    /// Name of the stability case, unique in the table.
    pub name: String,
    /// Description of what is extreme about the stability case.
    pub title: String,
    /// The specification of the stability case, as a user would write it.
    pub specification: Value,
    /// The expected properties of the outcome of the case.
    pub expect: Vec<Expectation>,
}

/// The outcome of a stability case.
#[derive(Clone, Debug, Deserialize, Serialize)]
pub struct Outcome {
    /// Name of the part of the table that the case belongs to.
    pub part: String,
    /// The name of the stability case.
    pub name: String,
    /// A description of what is extreme about the stability case.
    pub title: String,
    /// One finding per expectation of the stability case.
    pub findings: Vec<Finding>,
    /// Whether the answer of the case is trusted; absent if the run did not reach the end.
    #[serde(default)]
    pub trusted: Option<bool>,
    /// Run time of the case in seconds.
    pub seconds: f64,
}

impl Outcome {
    /// Whether all expectations of the stability case are met.
    pub fn passed(&self) -> bool {
        self.findings.iter().all(|finding| finding.passed)
    }
}

/// Returns the names of the parts of the table of stability cases.
pub fn parts() -> impl Iterator<Item = &'static str> {
    PARTS.iter().map(|(name, _)| *name)
}

/// Returns all stability cases, in the order of the table.
///
/// # Panics
/// If the table is invalid, which every use would reveal.
pub fn cases() -> Vec<Case> {
    let mut cases = Vec::new();
    for (part, text) in PARTS {
        let written: Vec<Written> =
            serde_json::from_str(text).unwrap_or_else(|error| panic!("the table `{part}` is wrong: {error}"));
        for case in written {
            let columns: Vec<(&String, &[Value])> = case
                .with
                .iter()
                .map(|(pointer, values)| (pointer, values.as_array().map_or(&[][..], Vec::as_slice)))
                .collect();
            let rows = columns.iter().map(|(_, values)| values.len()).max().unwrap_or(1);
            for row in 0..rows {
                let (mut specification, mut name) = (case.specification.clone(), case.name.clone());
                for (pointer, values) in &columns {
                    set(&mut specification, pointer, values[row].clone());
                    // Writing to a string cannot fail.
                    let _ = write!(name, " {}={}", pointer.rsplit('/').next().unwrap_or_default(), short(&values[row]));
                }
                let (title, expect) = (case.title.clone(), case.expect.clone());
                cases.push(Case { part, name, title, specification, expect });
            }
        }
    }
    cases
}

/// Solves a stability case, as long as `control` permits, and compares the outcome with the expectations of the case.
pub fn run(case: &Case, control: &Control) -> Outcome {
    let start = Instant::now();
    let specification = Specification::from_json(case.specification.to_string().as_bytes());
    let solution = specification.map(|specification| crate::solve(&specification, control));
    let seconds = start.elapsed().as_secs_f64();
    let mut findings: Vec<Finding> = case.expect.iter().map(|expected| expected.judge(case, &solution)).collect();
    findings.extend(solution.as_ref().ok().and_then(not_finite));
    let answer = solution.as_ref().ok().filter(|solution| solution.status == Status::Completed);
    Outcome {
        part: case.part.to_owned(),
        name: case.name.clone(),
        title: case.title.clone(),
        findings,
        trusted: answer.map(|solution| solution.verdict.trusted),
        seconds,
    }
}

/// Returns a finding against the answer of a stability case if it contains values that are not finite.
fn not_finite(solution: &Solution) -> Option<Finding> {
    let field = solution.trajectory.fields.iter().find(|field| field.values.iter().any(|value| !value.is_finite()))?;
    let found = format!("`{}` is not finite", field.name);
    Some(Finding { expected: "finite values".to_owned(), found, passed: false })
}

/// Sets the value at a JSON pointer of a document, creating missing objects.
fn set(document: &mut Value, pointer: &str, value: Value) {
    let mut place = document;
    for key in pointer.split('/').skip(1) {
        place = match key.parse::<usize>() {
            Ok(index) if place.is_array() => &mut place[index],
            _ => &mut place[key],
        };
    }
    *place = value;
}

/// Formats a value as part of the name of a stability case; an object is formatted by its members.
fn short(value: &Value) -> String {
    match value {
        Value::Object(members) => {
            let members: Vec<String> = members.iter().map(|(key, value)| format!("{key}={}", short(value))).collect();
            if members.is_empty() { "default".to_owned() } else { members.join(",") }
        }
        Value::String(text) => text.clone(),
        Value::Number(number) => number.as_f64().map_or_else(|| number.to_string(), plain),
        other => other.to_string(),
    }
}

/// Formats a number in plain or exponential notation, whichever is shorter.
fn plain(x: f64) -> String {
    let (plain, power) = (x.to_string(), format!("{x:e}"));
    if plain.len() <= power.len() + 2 { plain } else { power }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::collections::HashSet;

    #[test]
    fn rows_have_names_of_their_own_and_every_stepper_has_rows() {
        let cases = cases();
        let names: HashSet<&str> = cases.iter().map(|case| case.name.as_str()).collect();
        assert_eq!(names.len(), cases.len());
        let steppers: HashSet<String> = cases
            .iter()
            .flat_map(|case| case.specification["problem"].as_object().expect("a problem").keys().cloned())
            .collect();
        for stepper in ["dvi", "lcs", "filippov", "mechanical", "rigid_bodies", "elastic", "convolution", "circuit"] {
            assert!(steppers.contains(stepper), "no row of `{stepper}`");
        }
    }

    #[test]
    fn a_pointer_reaches_objects_lists_and_what_is_not_there_yet() {
        let mut document = serde_json::json!({"a": [{"b": 1}]});
        set(&mut document, "/a/0/b", 2.into());
        set(&mut document, "/method/step", 0.5.into());
        assert_eq!(document, serde_json::json!({"a": [{"b": 2}], "method": {"step": 0.5}}));
    }
}
