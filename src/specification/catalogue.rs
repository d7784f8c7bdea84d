//! What there is to choose from: problems, sets, methods with their checked conditions, solvers, and the limits of a
//! solve. All of it is read off the types that a specification is read into, and off the tableaux in use.

use super::lowering::MOST_UNKNOWNS;
use super::method::{ImpactLawName, Impacts, MethodName, Switches, ViSolverName};
use super::output::MOST_TIMES;
use super::plan::{MOST_STEPS, MOST_VALUES};
use super::schema::json_schema;
use radau::{Conditions, MOST_BYTES, MOST_STAGES, Tableau};
use serde::Serialize;
use serde_json::Value;
use std::sync::LazyLock;

/// All that a specification may ask for.
#[derive(Debug, Serialize)]
pub struct Catalogue {
    /// The types of problem.
    pub problems: Vec<Choice>,
    /// The factors of `K`.
    pub sets: Vec<Choice>,
    /// The families of methods.
    pub methods: Vec<Choice>,
    /// What may be done where the active set changes.
    pub switches: Vec<Choice>,
    /// How impacts are met.
    pub impacts: Vec<Choice>,
    /// How impacts at several contacts at once come about.
    pub impact_laws: Vec<Choice>,
    /// The solvers of the variational inequalities at the stages.
    pub vi_solvers: Vec<Choice>,
    /// The coefficients of Radau IIA, one to the most stages.
    pub tableaux: Vec<Coefficients>,
    /// What bounds a solve, wherever it runs.
    pub limits: Vec<Limit>,
}

/// A word in a specification.
#[derive(Debug, Serialize)]
pub struct Choice {
    /// The word.
    pub name: String,
    /// What it stands for, in a sentence.
    pub meaning: String,
}

/// A Runge-Kutta method, and what is found of it.
#[derive(Debug, Serialize)]
pub struct Coefficients {
    /// `s`
    pub stages: usize,
    /// Whether it has an embedded error estimate, so that the step can follow the error.
    pub adaptive: bool,
    /// The nodes.
    pub c: &'static [f64],
    /// The weights.
    pub b: &'static [f64],
    /// The matrix, by rows.
    #[serde(rename = "A")]
    pub a: Vec<Vec<f64>>,
    /// The conditions of the theory, as they are found to hold for these doubles.
    pub conditions: Conditions,
}

/// A bound, and what it bounds.
#[derive(Debug, Serialize)]
pub struct Limit {
    /// Its name.
    pub name: &'static str,
    /// The largest value allowed.
    pub value: u64,
    /// What it bounds, in a sentence.
    pub meaning: &'static str,
}

/// The catalogue; computed when it is first asked for.
pub fn catalogue() -> &'static Catalogue {
    static CATALOGUE: LazyLock<Catalogue> = LazyLock::new(|| {
        let schema = json_schema();
        Catalogue {
            problems: tagged(&schema, "Problem"),
            sets: tagged(&schema, "Block"),
            methods: choices(MethodName::ALL, |choice| (choice.name(), choice.meaning())),
            switches: choices(Switches::ALL, |choice| (choice.name(), choice.meaning())),
            impacts: choices(Impacts::ALL, |choice| (choice.name(), choice.meaning())),
            impact_laws: choices(ImpactLawName::ALL, |choice| (choice.name(), choice.meaning())),
            vi_solvers: choices(ViSolverName::ALL, |choice| (choice.name(), choice.meaning())),
            tableaux: (1..=MOST_STAGES).map(coefficients).collect(),
            limits: limits(),
        }
    });
    &CATALOGUE
}

fn choices<T: Copy>(all: &[T], told: impl Fn(T) -> (&'static str, &'static str)) -> Vec<Choice> {
    let told = all.iter().map(|&choice| told(choice));
    told.map(|(name, meaning)| Choice { name: name.to_owned(), meaning: meaning.to_owned() }).collect()
}

/// The variants of a choice that is tagged from outside, from its definition in the schema.
fn tagged(schema: &Value, definition: &str) -> Vec<Choice> {
    let variants = schema["$defs"][definition]["oneOf"].as_array();
    let choice = |variant: &Value| {
        let name = variant["required"][0].as_str()?.to_owned();
        Some(Choice { name, meaning: variant["description"].as_str()?.replace('\n', " ") })
    };
    variants.into_iter().flatten().filter_map(choice).collect()
}

fn coefficients(s: usize) -> Coefficients {
    let tableau = Tableau::of(s);
    Coefficients {
        stages: s,
        adaptive: tableau.gamma.is_some(),
        c: &tableau.c,
        b: &tableau.b,
        a: tableau.a.row_iter().map(|row| row.iter().copied().collect()).collect(),
        conditions: Conditions::of(tableau),
    }
}

fn limits() -> Vec<Limit> {
    let limit = |name, value, meaning| Limit { name, value, meaning };
    vec![
        limit("unknowns", MOST_UNKNOWNS as u64, "States and variables of a problem."),
        limit("steps", MOST_STEPS, "Accepted steps of a solve; `limits.steps` asks for fewer."),
        limit("times", MOST_TIMES as u64, "Output times."),
        limit("values", MOST_VALUES as u64, "Numbers in a trajectory."),
        limit("matrix_bytes", MOST_BYTES as u64, "Memory for one dense part of a solve, in bytes."),
    ]
}

#[cfg(test)]
mod tests {
    use super::*;
    use vi::SolverKind;

    #[test]
    fn nothing_that_can_be_written_is_left_out() {
        let catalogue = catalogue();
        let names = |choices: &[Choice]| choices.iter().map(|choice| choice.name.clone()).collect::<Vec<_>>();
        for (list, definition) in [(&catalogue.problems, "Problem"), (&catalogue.sets, "Block")] {
            let variants = json_schema()["$defs"][definition]["oneOf"].as_array().unwrap().len();
            assert!(list.len() == variants && variants >= 2, "{:?}", names(list));
        }
        assert_eq!(names(&catalogue.vi_solvers), SolverKind::ALL.map(|kind| kind.name().to_owned()));
        let all =
            [&catalogue.problems, &catalogue.sets, &catalogue.methods, &catalogue.switches, &catalogue.vi_solvers];
        for choice in all.into_iter().flatten() {
            assert!(choice.meaning.ends_with('.') && !choice.meaning.contains('\n'), "{choice:?}");
        }
    }
}
