//! Output times and limits: at the ends, at switches, a million of them, and runs stopped half-way.

use crate::stability::harness::{Case, RELAY, column, distance};
use dvi::problem::Control;
use dvi::solution::Status;
use serde_json::json;
use std::time::{Duration, Instant};

/// Reaches zero at `2/0.7` and rests there.
fn relay(end: f64) -> Case {
    Case::until(end).state("x", 2.0, "0.3 - s").between("s", "-x", RELAY[0], RELAY[1])
}

/// `x' = 3 cos t - sgn x`: two switches in every period, for ever.
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
