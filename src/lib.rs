//! Differential variational inequalities, solved with evidence:
//!
//! ```text
//! x' = f(t,x) + B(t,x) z,    z in K,    <G(t,x,z), z~ - z> >= 0  for all z~ in K
//! ```
//!
//! A [`Specification`](specification::Specification) is read from JSON and checked as a whole; [`solve`] gives a
//! [`Solution`](solution::Solution): the trajectory in columns, and the evidence that it is right.
//!
//! ```
//! use dvi::{problem::Control, specification::Specification};
//!
//! let text = br#"{"problem": {"dvi": {"states": {"x": {"initial": 1, "rate": "-x"}}}}, "time": {"end": 1}}"#;
//! let specification = Specification::from_json(text).expect("a valid specification");
//! let solution = dvi::solve(&specification, &Control::new());
//! let x = solution.trajectory.field("x").expect("a state named x");
//! assert!((x.last().expect("a value at the end") - (-1.0_f64).exp()).abs() < 1e-6);
//! ```

pub use study::{solve, solve_on};
pub use {
    analysis, contact, convolution, explanation, expression, factorisation, hybrid, models, numerics, problem, radau,
    service, solution, specification, study, vi,
};
