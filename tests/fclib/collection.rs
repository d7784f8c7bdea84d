//! Reads frictional contact problems of the FCLIB and Siconos collections from their files.

use dvi::vi::coulomb::CoulombProblem;
use serde_json::Value;
use std::path::Path;

/// Reads a file of the collection of frictional contact problems as JSON.
pub fn document(name: &str) -> Value {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join(format!("tests/reference/fclib/{name}.json"));
    let text = std::fs::read(&path).unwrap_or_else(|error| panic!("{}: {error}", path.display()));
    serde_json::from_slice(&text).unwrap_or_else(|error| panic!("{}: {error}", path.display()))
}

/// Reads the frictional contact problem in a file of the collection.
pub fn problem(name: &str) -> CoulombProblem {
    let value = document(name);
    let matrix = &value["W"];
    CoulombProblem::from_csr(
        &indices(&matrix["indptr"]),
        &indices(&matrix["indices"]),
        &numbers(&matrix["data"]),
        &numbers(&value["q"]),
        numbers(&value["mu"]),
    )
    .unwrap_or_else(|error| panic!("{name}: {error}"))
}

/// Returns all numbers of a JSON list, or of a list of lists, in order.
pub fn numbers(value: &Value) -> Vec<f64> {
    match value {
        Value::Array(list) => list.iter().flat_map(numbers).collect(),
        number => vec![number.as_f64().expect("a number")],
    }
}

fn indices(value: &Value) -> Vec<usize> {
    let list = value.as_array().expect("a list of indices");
    list.iter().map(|index| index.as_u64().and_then(|i| usize::try_from(i).ok()).expect("an index")).collect()
}
