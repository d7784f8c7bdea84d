//! What is known of each system from outside: its equations as a paper states them, values and switch times, and how these
//! were found. Where a program found them that is not published, it is in `tests/peers/answers`.

use serde::{Deserialize, Serialize};
use serde_json::{Map, Value};
use std::collections::HashMap;

const KNOWN: &str = include_str!("known.json");

/// What is known of a system.
#[derive(Clone, Debug, Default, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Known {
    /// Its equations, a line each.
    pub equations: Vec<String>,
    /// By the name of the output: a number is the value at the end, a text an expression in `t` that holds from `from` on.
    pub exact: Map<String, Value>,
    /// The time from which expressions hold; the start where it is absent.
    pub from: Option<f64>,
    /// Another end than that of the example, where what is known is known of.
    pub end: Option<f64>,
    /// Where the values are from.
    pub source: Option<Source>,
    /// The times of switches.
    pub switches: Vec<f64>,
    /// Whether the values are those of the continuous problem in space, of which the elements leave an error.
    pub mesh: bool,
    /// A public thread in which another program was reported to fail on it.
    pub reported: Option<Reported>,
}

/// A public report of a failure elsewhere.
#[derive(Clone, Debug, Deserialize, PartialEq, Serialize)]
#[serde(deny_unknown_fields)]
pub struct Reported {
    /// What happens there, in a clause.
    pub what: String,
    /// The program, the number and the title of the thread.
    pub title: String,
    /// Its address.
    pub address: String,
}

/// The origin of values.
#[derive(Clone, Debug, Deserialize, PartialEq, Serialize)]
#[serde(deny_unknown_fields)]
pub struct Source {
    /// The method, the program or the paper.
    pub what: String,
    /// The precision of the arithmetic, and the digits that are right.
    pub digits: String,
    /// A file of the repository that makes or holds them.
    pub file: Option<String>,
}

/// What is known of a system by its name; its equations at least, of every example with a chapter.
pub fn known(name: &str) -> Known {
    all().remove(name).unwrap_or_default()
}

/// The whole table; empty if it cannot be read, which a test excludes.
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
