//! Functions that solve examples and read their trajectories.

use dvi::problem::Control;
use dvi::solution::{Solution, Status};
use dvi::specification::Specification;
use serde_json::Value;

/// Solves a specification, and asserts that it is valid and that the solution is completed.
pub fn solve(specification: &Value) -> Solution {
    let specification = Specification::from_json(specification.to_string().as_bytes())
        .unwrap_or_else(|errors| panic!("the specification has errors: {errors:#?}"));
    let solution = dvi::solve(&specification, &Control::new());
    assert_eq!(solution.status, Status::Completed, "{:?}", solution.error);
    solution
}

/// Returns the value of a field of the trajectory at the last output time.
pub fn last(solution: &Solution, name: &str) -> f64 {
    *column(solution, name).last().unwrap_or_else(|| panic!("`{name}` has no values"))
}

/// Returns the values of a field of the trajectory at all output times.
pub fn column<'a>(solution: &'a Solution, name: &str) -> &'a [f64] {
    solution.trajectory.field(name).unwrap_or_else(|| panic!("there is no field `{name}`"))
}

/// Returns the largest distance of a field of the trajectory from the function `exact` of time, over all output times.
pub fn distance(solution: &Solution, name: &str, exact: impl Fn(f64) -> f64) -> f64 {
    let times = solution.trajectory.t.iter();
    times.zip(column(solution, name)).map(|(&t, &value)| (value - exact(t)).abs()).fold(0.0, f64::max)
}

/// Returns the times of the events of a variable, contact or monitor.
pub fn events(solution: &Solution, of: &str) -> Vec<f64> {
    solution.trajectory.events.iter().filter(|event| event.of == of).map(|event| event.t).collect()
}
