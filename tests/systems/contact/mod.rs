//! Mechanical systems with impacts and friction, compared with closed forms.

mod between;
mod energy;
mod friction;
mod impacts;
mod located;
mod rest;
mod scenes;
mod slopes;
mod units;
mod varying;

use crate::systems::harness::solve;
use dvi::solution::Solution;
use serde_json::{Value, json};

/// Solves a mechanical problem over `[0, end]` by time stepping with steps of size `h`, which may contain several
/// impacts.
pub fn stepped(problem: Value, end: f64, h: f64) -> Solution {
    solve(&json!({"problem": {"mechanical": problem}, "time": {"end": end}, "method": {"step": h}}))
}

/// Solves a mechanical problem over `[0, end]` with impacts located in time, at tight tolerances.
pub fn located(problem: Value, end: f64) -> Solution {
    solve(&json!({"problem": {"mechanical": problem}, "time": {"end": end},
                  "method": {"impacts": "locate", "rtol": 1e-10, "atol": 1e-13}}))
}

/// A mechanical problem: a ball that falls from the height one, with the given restitution coefficient.
pub fn ball(restitution: f64) -> Value {
    json!({"coordinates": {"y": {"initial": 1}}, "mass": [[1]], "potential": "9.81*y",
           "contacts": [{"name": "floor", "gap": "y", "restitution": restitution}]})
}

/// A mechanical problem: a block on a slope of the angle `theta`, with coordinates parallel and normal to the slope.
pub fn block(theta: f64, mu: f64, velocity: f64) -> Value {
    json!({"parameters": {"theta": theta, "mu": mu},
           "coordinates": {"x": {"initial": 0, "velocity": velocity}, "y": {"initial": 0}},
           "mass": [[2, 0], [0, 2]], "potential": "2*9.81*(y*cos(theta) - x*sin(theta))",
           "contacts": [{"name": "slope", "gap": "y", "friction": {"coefficient": "mu", "slip": ["x_dot"]}}]})
}
