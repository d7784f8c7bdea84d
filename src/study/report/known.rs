//! What is known of each example system from outside this program: equations as a paper states them, values,
//! switching times, and their sources. Unpublished programs that computed the values are in `tests/peers/answers`.

use serde::{Deserialize, Serialize};
use serde_json::{Map, Value};
use std::collections::HashMap;

const KNOWN: &str = include_str!("known.json");

/// What is known of an example system from outside this program.
#[derive(Clone, Debug, Default, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Known {
    /// Equations of the system as a paper states them, one line each.
    pub equations: Vec<String>,
    /// Known values by the name of the output: a number is the value at the end time, a text is an expression in `t`
    /// that holds from the time `from` on.
    pub exact: Map<String, Value>,
    /// The time from which the expressions in `exact` hold; absent if they hold from the start.
    pub from: Option<f64>,
    /// The end time, if it differs from that of the example because values are known at another time.
    pub end: Option<f64>,
    /// The source of the known values of the system.
    pub source: Option<Source>,
    /// The known switching times of the system.
    pub switches: Vec<f64>,
    /// Whether the known values are those of the problem continuous in space, from which a finite element solution
    /// differs by its discretisation error.
    pub mesh: bool,
    /// A public thread in which another program was reported to fail on the system.
    pub reported: Option<Reported>,
}

/// A public report of a failure of another program.
#[derive(Clone, Debug, Deserialize, PartialEq, Serialize)]
#[serde(deny_unknown_fields)]
pub struct Reported {
    /// The reported failure, in a clause.
    pub what: String,
    /// The name of the other program, and the number and the title of the thread.
    pub title: String,
    /// The web address of the thread.
    pub address: String,
}

/// The source of known values.
#[derive(Clone, Debug, Deserialize, PartialEq, Serialize)]
#[serde(deny_unknown_fields)]
pub struct Source {
    /// The method, the program or the paper that the values are from.
    pub what: String,
    /// The precision of the arithmetic that computed the values, and their number of correct digits.
    pub digits: String,
    /// A file of the repository that computes or contains the known values.
    pub file: Option<String>,
}

/// Returns what is known of a system by its name: at least the equations, for every example with a chapter.
pub fn known(name: &str) -> Known {
    all().remove(name).unwrap_or_default()
}

/// Returns what is known of all systems, by name; empty if the table cannot be parsed, which a test excludes.
pub fn all() -> HashMap<String, Known> {
    serde_json::from_str(KNOWN).unwrap_or_default()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::report;
    use specification::{EXAMPLES, Specification};
    use std::path::Path;

    #[test]
    fn what_is_known_is_known_of_examples_and_reads_as_a_study_of_them() {
        let known: HashMap<String, Known> = serde_json::from_str(KNOWN).expect("a table");
        for (name, known) in known {
            let example = EXAMPLES.iter().find(|example| example.name == name);
            let example = example.unwrap_or_else(|| panic!("`{name}` is no example"));
            assert!(!known.equations.is_empty(), "{name} has no equations");
            assert_eq!(
                known.exact.is_empty(),
                known.source.is_none(),
                "{name}: values have a source, and a source values"
            );
            if let Some(file) = known.source.as_ref().and_then(|source| source.file.as_ref()) {
                let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../..").join(file);
                assert!(path.exists(), "{name}: {file} is no file");
            }
            if known.exact.is_empty() {
                continue;
            }
            let document = report::shown(example, &known).expect("an object");
            let end = document["time"]["end"].as_f64().expect("an end");
            let start = document["time"]["start"].as_f64().unwrap_or(0.0);
            assert!(known.switches.iter().all(|t| (start..=end).contains(t)), "{name}: {:?}", known.switches);
            let document = report::with_exact_values(document, &known).expect("an end");
            let read = Specification::from_json(document.to_string().as_bytes());
            assert!(read.is_ok(), "{name}: {:#?}", read.err());
        }
    }
}
