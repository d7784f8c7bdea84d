//! Extreme step sizes of Radau IIA, with each number of stages.

use crate::stability::harness::{Case, last};
use dvi::solution::Status;
use serde_json::json;

#[test]
fn no_step_is_shorter_than_the_shortest_allowed() {
    let case = Case::until(1.0).state("x", 1.0, "-x").method(json!({"rtol": 1e-3, "min_step": 0.3}));
    let solution = case.solve();
    let steps: Vec<f64> = solution.trajectory.t.windows(2).map(|pair| pair[1] - pair[0]).collect();
    assert!(steps[..steps.len() - 1].iter().all(|&step| step >= 0.3), "{steps:?}");
    let solution = Case::until(1.0).state("x", 1.0, "-1e3*x").method(json!({"min_step": 0.3})).run();
    assert_eq!(solution.status, Status::Failed);
    let failure = solution.error.expect("a failure");
    assert_eq!(failure.code, "step_too_small");
    assert!(failure.message.contains("`min_step` = 3e-1"), "{}", failure.message);
    // If the option `min_step` is not set, the error message does not mention it: the solution 1/(1 - t) blows up at t
    // = 1.
    let failure = Case::until(2.0).state("x", 1.0, "x^2").run().error.expect("a blow-up");
    assert!(!failure.message.contains("min_step"), "{}", failure.message);
}

#[test]
fn every_number_of_stages_solves_a_nonlinear_problem_at_its_order() {
    // The exact final value of the logistic equation x' = 3 x (1 - x) with x(0) = 1/10.
    let exact = 1.0 / (1.0 + 9.0 * (-9.0_f64).exp());
    let error = |stages: usize, step: f64| {
        let case = Case::until(3.0).state("x", 0.1, "3*x*(1 - x)");
        let case = case.method(json!({"stages": stages, "step": step, "rtol": 1e-13})).times(json!([3]));
        (last(&case.solve(), "x") - exact).abs()
    };
    for stages in 1..=9 {
        let (coarse, fine) = (error(stages, 0.2), error(stages, 0.1));
        let order = (coarse / fine).log2();
        let full = 2.0 * stages as f64 - 1.0;
        assert!(order > full - 0.4 || fine < 1e-13, "{stages} stages: order {order}, errors {coarse:e}, {fine:e}");
    }
}

#[test]
fn a_pendulum_on_its_rod_takes_fixed_steps_with_any_stages() {
    // In each step of the pendulum, the Newton iteration of the stage equations must converge, also with the
    // derivatives of an earlier step, and if the first increment is due to the tension alone.
    for (stages, steps) in [(1, 100), (1, 1600), (1, 6400), (2, 1600), (3, 400), (3, 1600), (3, 6400)] {
        let mut document = crate::systems::reference::example("pendulum");
        document["method"] = json!({"stages": stages, "step": 10.0 / f64::from(steps)});
        let solution = crate::systems::harness::solve(&document);
        assert_eq!(solution.diagnostics.steps.accepted, steps as u64, "{stages} stages, {steps} steps");
    }
}
