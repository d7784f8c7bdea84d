//! Solving examples and reading their trajectories.

use dvi::problem::Control;
use dvi::solution::{Solution, Status};
use dvi::specification::Specification;
use serde_json::Value;
use std::path::Path;

/// The text of an example, as JSON to be changed before it is solved.
pub fn example(name: &str) -> Value {
    read(&format!("api/examples/{name}.json"))
}

/// A JSON file of the repository.
pub fn read(path: &str) -> Value {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join(path);
    let text = std::fs::read(&path).unwrap_or_else(|error| panic!("{}: {error}", path.display()));
    serde_json::from_slice(&text).unwrap_or_else(|error| panic!("{}: {error}", path.display()))
}

/// Solves a specification that must be right, to its end.
pub fn solve(specification: &Value) -> Solution {
    let specification = Specification::from_json(specification.to_string().as_bytes())
        .unwrap_or_else(|errors| panic!("the specification has errors: {errors:#?}"));
    let solution = dvi::solve(&specification, &Control::new());
    assert_eq!(solution.status, Status::Completed, "{:?}", solution.error);
    solution
}

/// The last value of a field.
pub fn last(solution: &Solution, name: &str) -> f64 {
    *column(solution, name).last().unwrap_or_else(|| panic!("`{name}` has no values"))
}

/// A field over time.
pub fn column<'a>(solution: &'a Solution, name: &str) -> &'a [f64] {
    solution.trajectory.field(name).unwrap_or_else(|| panic!("there is no field `{name}`"))
}

/// The largest distance of a field from a function of time.
pub fn distance(solution: &Solution, name: &str, exact: impl Fn(f64) -> f64) -> f64 {
    let times = solution.trajectory.t.iter();
    times.zip(column(solution, name)).map(|(&t, &value)| (value - exact(t)).abs()).fold(0.0, f64::max)
}

/// The times of the events of a variable.
pub fn events(solution: &Solution, of: &str) -> Vec<f64> {
    solution.trajectory.events.iter().filter(|event| event.of == of).map(|event| event.t).collect()
}

/// A number that a reference file holds as a string of more digits than a double has.
pub fn digits(value: &Value) -> f64 {
    value.as_str().and_then(|text| text.parse().ok()).unwrap_or_else(|| panic!("{value} is not a string of digits"))
}

/// The system of that name in `tests/reference/switching.json`.
pub fn switching(name: &str) -> Value {
    let systems = read("tests/reference/switching.json")["systems"].take();
    let found = systems.as_array().and_then(|systems| systems.iter().find(|system| system["name"] == name));
    found.unwrap_or_else(|| panic!("no switching system `{name}`")).clone()
}
