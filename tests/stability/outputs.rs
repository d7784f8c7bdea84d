//! Output times and limits of a run: outputs at the ends and at switches, a million outputs, and runs that are stopped
//! early.

use crate::stability::harness::{Case, RELAY, column, distance, last};
use dvi::problem::Control;
use dvi::solution::Status;
use serde_json::json;
use std::time::{Duration, Instant};

/// Specification of a relay whose state `x` reaches zero at `t = 2/0.7` and stays there.
fn relay(end: f64) -> Case {
    Case::until(end).state("x", 2.0, "0.3 - s").between("s", "-x", RELAY[0], RELAY[1])
}

/// Specification of the relay `x' = 3 cos t - sgn x`, with two switches in every period for ever.
fn forced(end: f64) -> Case {
    Case::until(end).state("x", 0.0, "3*cos(t) - s").between("s", "-x", RELAY[0], RELAY[1])
}

#[test]
fn outputs_at_the_start_at_a_switch_and_at_the_end_are_there() {
    let reach = 2.0_f64 / 0.7;
    let times = [0.0, 1.0, reach.next_down(), reach, reach.next_up(), 4.0, 5.0];
    let solution = relay(5.0).times(json!(times)).solve();
    assert_eq!(solution.trajectory.t, times);
    assert!(distance(&solution, "x", |t| (2.0 - 0.7 * t).max(0.0)) < 1e-12);
    for (&t, &s) in solution.trajectory.t.iter().zip(column(&solution, "s")) {
        assert!((t - reach).abs() < 1e-9 || (s - if t < reach { 1.0 } else { 0.3 }).abs() < 1e-9, "s = {s} at {t}");
    }
    assert_eq!(relay(5.0).times(json!([0])).solve().trajectory.t, [0.0]);
}

#[test]
fn between_the_steps_states_keep_to_what_constrains_them() {
    use std::f64::consts::PI;
    for rtol in [1e-4, 1e-6, 1e-9] {
        let method = json!({"rtol": rtol});
        // Sliding on a moving surface: the constraint holds at the ends of steps, so that an error shows only between
        // them.
        let slides = Case::until(5.0).state("x", 1.0, "-2*s").between("s", "-(x - sin(t))", "-1", "1");
        let solution = slides.method(method.clone()).times(json!({"count": 201})).solve();
        let x = column(&solution, "x").iter().zip(&solution.trajectory.t).filter(|(_, t)| **t > 1.0);
        let error = x.fold(0.0_f64, |error, (x, t)| error.max((x - t.sin()).abs()));
        // The error estimate of the embedded formula is compared with a rescaled tolerance, `0.1 rtol^(2/3)`.
        let tolerance = 0.1 * f64::powf(rtol, 2.0 / 3.0);
        assert!(error < 5.0 * tolerance, "{rtol:e}: off the surface by {error:e}");
        // The multiplier i keeps the state v on the given path 10 sin t.
        let path = Case::until(2.0 * PI).state("v", 0.0, "i - v").free("i", "v - 10*sin(t)");
        let solution = path.method(method).times(json!({"count": 101})).solve();
        let error = distance(&solution, "v", |t| 10.0 * t.sin());
        assert!(error < 50.0 * tolerance, "{rtol:e}: off the path by {error:e}");
    }
}

#[test]
fn a_state_below_its_tolerance_is_told() {
    let case = || Case::until(20.0).state("x", 1e-12, "v").state("v", 0.0, "-x").times(json!([20]));
    let is_told = |case: Case| {
        let solution = case.solve();
        (solution.diagnostics.warnings.iter().any(|warning| warning.code == "below_tolerance"), last(&solution, "x"))
    };
    assert!(is_told(case()).0);
    let (told, x) = is_told(case().method(json!({"atol": 1e-20})));
    assert!(!told && (x / 1e-12 - 20.0_f64.cos()).abs() < 1e-4, "{told}, {x:e}");
    // A state that is zero up to rounding causes no warning about its absolute tolerance.
    assert!(!is_told(Case::until(1.0).state("x", 1.0, "-x").state("w", 1e-17, "0").times(json!([1]))).0);
}

#[test]
fn a_million_outputs_cost_no_steps() {
    let few = relay(5.0).solve().diagnostics.steps.accepted;
    let solution = relay(5.0).times(json!({"count": 1_000_000})).solve();
    assert_eq!(solution.trajectory.t.len(), 1_000_000);
    assert_eq!(solution.diagnostics.steps.accepted, few);
    assert!(distance(&solution, "x", |t| (2.0 - 0.7 * t).max(0.0)) < 1e-12);
}

#[test]
fn a_deadline_and_a_cancel_keep_the_trajectory_so_far() {
    let specification = forced(1e9).specification();
    let control = Control::with_deadline(Instant::now() + Duration::from_millis(200));
    let solution = dvi::solve(&specification, &control);
    assert_eq!(solution.status, Status::Stopped);
    assert_eq!(solution.error.as_ref().expect("a reason").code, "wall_time");
    assert!(solution.trajectory.t.len() > 100 && solution.diagnostics.switches > 10);

    let control = Control::new();
    let solution = std::thread::scope(|scope| {
        let run = scope.spawn(|| dvi::solve(&specification, &control));
        while control.steps() < 1000 {
            std::thread::yield_now();
        }
        control.cancel();
        run.join().expect("no panic")
    });
    assert_eq!(solution.error.as_ref().expect("a reason").code, "cancelled");
    assert!(solution.trajectory.t.len() >= 1000);
}

#[test]
fn a_limit_of_steps_is_kept_and_named() {
    let solution = forced(1e9).limits(json!({"steps": 100})).run();
    assert_eq!(solution.status, Status::Stopped);
    assert_eq!(solution.error.expect("a reason").code, "steps");
    assert_eq!(solution.diagnostics.steps.accepted, 100);
}
