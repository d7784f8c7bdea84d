//! The catalogue of choices: problem types, sets, methods with their verified order conditions, solvers, and the limits
//! of a solve. All entries are derived from the types that specifications are deserialised into, and from the tableaux
//! in use.

use super::lowering::MOST_UNKNOWNS;
use super::method::{ImpactLawName, Impacts, MethodName, Switches, ViSolverName};
use super::output::MOST_TIMES;
use super::plan::{MOST_STEPS, MOST_VALUES};
use super::schema::json_schema;
use radau::{Conditions, MOST_BYTES, MOST_STAGES, Tableau};
use serde::Serialize;
use serde_json::Value;
use std::sync::LazyLock;

/// Everything that a specification may choose among: problem types, sets, methods, solvers and limits.
#[derive(Debug, Serialize)]
pub struct Catalogue {
    /// The problem types, such as `dvi` and `circuit`.
    pub problems: Vec<Choice>,
    /// The types of blocks: the sets whose Cartesian product is the set `K` of the variables.
    pub sets: Vec<Choice>,
    /// The families of numerical methods.
    pub methods: Vec<Choice>,
    /// The treatments of a change of the active set: location as an event, or steps across it.
    pub switches: Vec<Choice>,
    /// The treatments of impacts of mechanical systems.
    pub impacts: Vec<Choice>,
    /// The laws for impacts at several contacts at once.
    pub impact_laws: Vec<Choice>,
    /// The solvers of the variational inequalities at the stages.
    pub vi_solvers: Vec<Choice>,
    /// The coefficients of Radau IIA, for 1 stage up to the largest number.
    pub tableaux: Vec<Coefficients>,
    /// The limits on the size of every solve.
    pub limits: Vec<Limit>,
}

/// A keyword that a specification may choose, with its meaning.
#[derive(Debug, Serialize)]
pub struct Choice {
    /// The keyword, as a specification writes it.
    pub name: String,
    /// The meaning of the keyword, in one sentence.
    pub meaning: String,
}

/// The coefficients of a Runge-Kutta method, and its verified properties.
#[derive(Debug, Serialize)]
pub struct Coefficients {
    /// Number of stages `s` of the Runge-Kutta method.
    pub stages: usize,
    /// Whether the method has an embedded error estimate, so that the step size can be adapted.
    pub adaptive: bool,
    /// The nodes `c` of the Runge-Kutta method.
    pub c: &'static [f64],
    /// The weights `b` of the Runge-Kutta method.
    pub b: &'static [f64],
    /// The Runge-Kutta matrix `A`, by rows.
    #[serde(rename = "A")]
    pub a: Vec<Vec<f64>>,
    /// The order conditions of the theory, verified with the rounded coefficients.
    pub conditions: Conditions,
}

/// A limit on the size of every solve.
#[derive(Debug, Serialize)]
pub struct Limit {
    /// The name of the limit on a solve.
    pub name: &'static str,
    /// The largest value of the quantity that the limit allows.
    pub value: u64,
    /// The quantity that the limit bounds, in one sentence.
    pub meaning: &'static str,
}

/// Returns the catalogue of all choices of a specification, which is computed on first use.
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

/// Returns the variants of an externally tagged enum, read from its definition in the JSON schema.
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
