//! A builder for short specifications, and functions on their solutions.

use dvi::problem::Control;
use dvi::solution::{Solution, Status};
use dvi::specification::Specification;
use serde_json::{Map, Value, json};

/// A builder of a specification of the problem type `dvi`.
pub struct Case {
    specification: Value,
}

impl Case {
    /// Begins a specification without states or variables that is solved from 0 to `end`.
    pub fn until(end: f64) -> Self {
        let dvi = json!({"states": {}, "variables": {}, "set": []});
        Self { specification: json!({"problem": {"dvi": dvi}, "time": {"end": end}}) }
    }

    /// Adds to the problem a state `name` with its initial value and its rate.
    pub fn state(mut self, name: &str, initial: f64, rate: &str) -> Self {
        self.dvi("states")[name] = json!({"initial": initial, "rate": rate});
        self
    }

    /// Adds to the problem a variable with its inequality `G`, and the block of the set `K` that contains the variable.
    pub fn variable(mut self, name: &str, inequality: &str, block: Value) -> Self {
        self.dvi("variables")[name] = json!({"inequality": inequality});
        self.dvi("set").as_array_mut().expect("a list").push(block);
        self
    }

    /// Adds to the problem a nonnegative variable with its inequality.
    pub fn nonnegative(self, name: &str, inequality: &str) -> Self {
        self.variable(name, inequality, json!({"nonnegative": [name]}))
    }

    /// Adds to the problem a variable between two bounds, with its inequality.
    pub fn between(self, name: &str, inequality: &str, lower: &str, upper: &str) -> Self {
        self.variable(name, inequality, json!({"box": {"of": [name], "lower": lower, "upper": upper}}))
    }

    /// Adds to the problem a variable without bounds, with its equation.
    pub fn free(self, name: &str, equation: &str) -> Self {
        self.variable(name, equation, json!({"free": [name]}))
    }

    /// Sets the mass matrix of the problem.
    pub fn mass(mut self, matrix: Value) -> Self {
        self.specification["problem"]["dvi"]["mass"] = matrix;
        self
    }

    /// Sets the options of the numerical method.
    pub fn method(mut self, method: Value) -> Self {
        self.specification["method"] = method;
        self
    }

    /// Sets the output times of the run.
    pub fn times(mut self, times: Value) -> Self {
        self.specification["output"] = json!({"times": times});
        self
    }

    /// Sets the limits of the run, such as the number of steps.
    pub fn limits(mut self, limits: Value) -> Self {
        self.specification["limits"] = limits;
        self
    }

    /// Returns the checked specification that has been built.
    pub fn specification(&self) -> Specification {
        let mut specification = self.specification.clone();
        let dvi = specification["problem"]["dvi"].as_object_mut().expect("an object");
        if dvi["variables"].as_object().is_some_and(Map::is_empty) {
            dvi.remove("variables");
            dvi.remove("set");
        }
        Specification::from_json(specification.to_string().as_bytes())
            .unwrap_or_else(|errors| panic!("the specification has errors: {errors:#?}"))
    }

    /// Solves the specification that has been built, and returns the solution whatever its status.
    pub fn run(&self) -> Solution {
        let solution = dvi::solve(&self.specification(), &Control::new());
        assert_finite(&solution);
        solution
    }

    /// Solves the specification that has been built, and asserts that the run reaches its end.
    pub fn solve(&self) -> Solution {
        let solution = self.run();
        assert_eq!(solution.status, Status::Completed, "{:?}", solution.error);
        solution
    }

    fn dvi(&mut self, key: &str) -> &mut Value {
        &mut self.specification["problem"]["dvi"][key]
    }
}

/// The lower and upper bound of a relay's output.
pub const RELAY: [&str; 2] = ["-1", "1"];

/// Asserts that no value of the solution is NaN or infinite.
pub fn assert_finite(solution: &Solution) {
    for field in &solution.trajectory.fields {
        assert!(field.values.iter().all(|value| value.is_finite()), "`{}` is not finite", field.name);
    }
}

/// Returns the values of a field of the solution at all output times.
pub fn column<'a>(solution: &'a Solution, name: &str) -> &'a [f64] {
    solution.trajectory.field(name).unwrap_or_else(|| panic!("there is no field `{name}`"))
}

/// Returns the value of a field of the solution at the last output time.
pub fn last(solution: &Solution, name: &str) -> f64 {
    *column(solution, name).last().unwrap_or_else(|| panic!("`{name}` has no values"))
}

/// Returns the largest difference between a field of the solution and the function `exact` of time, over all output
/// times.
pub fn distance(solution: &Solution, name: &str, exact: impl Fn(f64) -> f64) -> f64 {
    let times = solution.trajectory.t.iter();
    times.zip(column(solution, name)).map(|(&t, &value)| (value - exact(t)).abs()).fold(0.0, f64::max)
}

/// Returns the times of all events of a solution, without repetitions.
pub fn instants(solution: &Solution) -> Vec<f64> {
    let mut times: Vec<f64> = solution.trajectory.events.iter().map(|event| event.t).collect();
    times.dedup();
    times
}
