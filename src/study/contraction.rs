//! Nonlinear stability (B-stability; Butcher 1975; Hairer and Wanner 1996, IV.12): if the exact flow is contractive, so
//! is a step of any length. Measured on two states with cubic damping, a rotation that conserves the norm, and dry
//! friction,
//!
//! ```text
//! x' = -k x^3 + w y - r,    y' = -k y^3 - w x - s,    r in Sgn x,  s in Sgn y,
//! ```
//!
//! which is monotone, and so contractive in the Euclidean norm.

use super::linear_stability::STAGES;
use problem::Control;
use serde::{Deserialize, Serialize};
use serde_json::json;
use solution::Status;
use specification::Specification;

/// Coefficients `k` of the cubic damping and `w` of the rotation in the test problem for contraction.
const DAMPING: f64 = 2.0;
const ROTATION: f64 = 10.0;
/// Step sizes of the runs, from small to large relative to the time scales of damping and rotation.
const STEPS: [f64; 4] = [1e-3, 1e-2, 0.1, 1.0];
/// Number of steps of a run of the test problem.
const COUNT: f64 = 50.0;
/// Pairs of initial values `(x, y)`, from which two solutions are compared.
const PAIRS: [[(f64, f64); 2]; 6] = [
    [(1.0, 0.0), (0.9, 0.1)],
    [(0.7, -0.5), (-1.0, 0.5)],
    [(1.0, 1.0), (-1.0, 1.0)],
    [(0.01, 0.0), (0.0, 0.01)],
    [(-1.2, 0.3), (-0.4, 1.1)],
    [(0.3, -0.2), (0.0, 0.0)],
];

/// The behaviour of pairs of solutions for one number of stages and one step size.
#[derive(Clone, Debug, Deserialize, Serialize)]
pub struct Contraction {
    /// The number of Radau IIA stages of the method.
    pub stages: usize,
    /// The step size of the two solutions.
    pub step: f64,
    /// Largest growth of the distance between two solutions in a step, relative to their initial distance; zero for a
    /// B-stable method.
    pub growth: f64,
    /// Number of pairs of solutions with a run that did not reach its end, because Newton's method failed at a stage.
    pub failures: usize,
}

/// Measures the growth of the distance between pairs of solutions, for all numbers of stages at all step sizes.
pub fn contractions() -> Vec<Contraction> {
    let at = |stages: usize| STEPS.iter().map(move |&step| contraction(stages, step));
    STAGES.into_iter().flat_map(at).collect()
}

fn contraction(stages: usize, step: f64) -> Contraction {
    let mut found = Contraction { stages, step, growth: 0.0, failures: 0 };
    for [first, second] in PAIRS {
        match (run(stages, step, first), run(stages, step, second)) {
            (Some(first), Some(second)) => {
                let apart = |(a, b): (&(f64, f64), &(f64, f64))| (a.0 - b.0).hypot(a.1 - b.1);
                let distances: Vec<f64> = first.iter().zip(&second).map(apart).collect();
                let growth = distances.windows(2).map(|pair| (pair[1] - pair[0]) / distances[0]);
                found.growth = growth.fold(found.growth, f64::max);
            }
            _ => found.failures += 1,
        }
    }
    found
}

fn run(stages: usize, step: f64, start: (f64, f64)) -> Option<Vec<(f64, f64)>> {
    let document = json!({
        "problem": {"dvi": {"parameters": {"k": DAMPING, "w": ROTATION},
            "states": {"x": {"initial": start.0, "rate": "-k*x^3 + w*y - r"}, "y": {"initial": start.1, "rate": "-k*y^3 - w*x - s"}},
            "variables": {"r": {"inequality": "-x"}, "s": {"inequality": "-y"}},
            "set": [{"box": {"of": ["r", "s"], "lower": -1, "upper": 1}}]}},
        "time": {"end": step * COUNT},
        "method": {"step": step, "stages": stages, "switches": "step_over", "rtol": 1e-12}});
    let specification = Specification::from_json(document.to_string().as_bytes()).ok()?;
    let solution = crate::solve(&specification, &Control::new());
    let column = |name: &str| solution.trajectory.field(name);
    let points = || Some(column("x")?.iter().copied().zip(column("y")?.iter().copied()).collect());
    (solution.status == Status::Completed).then(points).flatten()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn no_step_brings_two_solutions_apart() {
        for found in contractions() {
            assert!(found.growth < 1e-12, "{found:?}");
            // Far from the solution, Newton's method may fail at a stage of a large step, and a fixed step size cannot
            // be reduced.
            assert!(found.failures == 0 || found.step == 1.0, "{found:?}");
        }
    }
}
