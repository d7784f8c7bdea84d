//! Studies of error versus run time (work-precision studies), on problems with known errors.

use crate::systems::harness::solve;
use dvi::problem::Control;
use dvi::solution::{Study, StudyRun};
use dvi::specification::Specification;
use serde_json::{Value, json};

fn study(problem: Value, end: f64, study: Value) -> Study {
    let document = json!({"problem": problem, "time": {"end": end}, "study": study});
    solve(&document).study.expect("a study")
}

fn oscillator() -> Value {
    json!({"dvi": {"parameters": {"w": 3}, "states": {
        "x": {"initial": 1, "rate": "v"}, "v": {"initial": 0, "rate": "-w^2*x"}}}})
}

fn orders(runs: &[StudyRun]) -> Vec<f64> {
    runs.iter().filter_map(|run| run.order).collect()
}

#[test]
fn fixed_steps_show_the_order_of_their_stages() {
    let exact = json!({"x": "cos(w*t)", "v": "-w*sin(w*t)"});
    let request = json!({"step": [0.05, 0.025], "stages": [1, 2, 3], "exact": exact, "repeats": 1});
    let found = study(oscillator(), 1.0, request);
    assert_eq!(found.reference, "the exact values");
    for (series, order) in found.series.iter().zip([1.0, 3.0, 5.0]) {
        let [observed] = orders(&series.runs)[..] else { panic!("{series:?}") };
        assert!((observed - order).abs() < 0.15, "{}: {observed} for {order}", series.method);
    }
    // In each step of size h, implicit Euler damps the oscillation by 1 / sqrt(1 + (w h)^2).
    let coarse = &found.series[0].runs[0];
    let damping = (1.0_f64 + 0.15 * 0.15).powf(-10.0);
    let angle = 20.0 * 0.15_f64.atan();
    let expected = (damping * angle.cos() - 3.0_f64.cos()).abs().max((damping * angle.sin() - 3.0_f64.sin()).abs());
    let error = coarse.error_at_end.expect("an error");
    assert!((error / expected - 1.0).abs() < 0.02, "{error} for {expected}");
    assert_eq!(coarse.steps, 20);
}

#[test]
fn located_impacts_keep_the_order_of_their_stages() {
    // A ball released at the height one on a spring of angular frequency 3 rebounds elastically from a wall: x'' = -9
    // x, x >= 0, e = 1.
    let ball = json!({"mechanical": {"coordinates": {"x": {"initial": 1}}, "mass": [[1]], "potential": "4.5*x^2",
        "contacts": [{"name": "wall", "gap": "x", "restitution": 1}]}});
    let exact = json!({"x": "abs(cos(3*t))"});
    let request = json!({"step": [0.05, 0.025], "stages": [1, 3], "exact": exact, "repeats": 1});
    let found = study(ball, 1.0, request);
    for (series, order) in found.series.iter().zip([1.0, 5.0]) {
        let [observed] = orders(&series.runs)[..] else { panic!("{series:?}") };
        assert!((observed - order).abs() < 0.3, "{}: {observed} for {order}", series.method);
    }
}

#[test]
fn a_tighter_run_measures_the_same_errors_as_the_exact_values() {
    let rtol = json!([1e-4, 1e-6, 1e-8]);
    let known = json!({"rtol": rtol, "exact": {"x": "cos(w*t)", "v": "-w*sin(w*t)"}, "repeats": 1});
    let by_exact = study(oscillator(), 2.0, known);
    let by_run = study(oscillator(), 2.0, json!({"rtol": rtol, "repeats": 1}));
    assert_eq!(by_run.reference, "a run with the relative tolerance 1e-10");
    for (a, b) in by_exact.series[0].runs.iter().zip(&by_run.series[0].runs) {
        let (a, b) = (a.error_at_end.expect("an error"), b.error_at_end.expect("an error"));
        assert!((a / b - 1.0).abs() < 0.05, "{a} against {b}");
    }
    assert!(orders(&by_exact.series[0].runs).iter().all(|order| (0.5..1.5).contains(order)), "{by_exact:?}");
}

#[test]
fn what_rounding_leaves_of_a_state_that_is_zero_is_no_error() {
    let mut problem = oscillator();
    problem["dvi"]["states"]["u"] = json!({"initial": 0, "rate": "sin(t)^2 + cos(t)^2 - 1"});
    let found = study(problem, 2.0, json!({"rtol": [1e-4, 1e-6, 1e-8], "repeats": 1}));
    let plain = study(oscillator(), 2.0, json!({"rtol": [1e-4, 1e-6, 1e-8], "repeats": 1}));
    for (a, b) in found.series[0].runs.iter().zip(&plain.series[0].runs) {
        let (a, b) = (a.error_at_end.expect("an error"), b.error_at_end.expect("an error"));
        assert!(a < 10.0 * b, "{a} against {b}");
    }
}

#[test]
fn time_stepping_through_impacts_is_of_first_order_in_a_study() {
    let ball = json!({"mechanical": {"coordinates": {"y": {"initial": 1, "velocity": 0}}, "mass": [[1]],
        "potential": "9.81*y", "contacts": [{"name": "floor", "gap": "y", "restitution": 0.5}]}});
    let request = json!({"step": [4e-3, 2e-3, 1e-3, 5e-4], "repeats": 1});
    let found = study(ball, 0.9, request);
    let errors: Vec<f64> = found.series[0].runs.iter().filter_map(|run| run.error_at_end).collect();
    let mean = (errors[0] / errors[3]).log2() / 3.0;
    assert!((0.5..1.5).contains(&mean), "{errors:?}");
}

#[test]
fn a_run_that_fails_is_a_row_without_an_error() {
    // The solution of x' = x^2 from 1 is 1/(1 - t), which blows up at t = 1.
    let problem = json!({"dvi": {"states": {"x": {"initial": 1, "rate": "x^2"}}}});
    let document = json!({"problem": problem, "time": {"end": 2}, "study": {"rtol": [1e-4, 1e-6]}});
    let specification = Specification::from_json(document.to_string().as_bytes()).expect("a right specification");
    let found = dvi::solve(&specification, &Control::new()).study.expect("a study");
    assert!(found.reference.ends_with("did not reach the end"), "{}", found.reference);
    assert!(found.series[0].runs.iter().all(|run| run.error_at_end.is_none() && run.order.is_none()));
    assert!(found.picture.starts_with("<svg"), "{}", found.picture);
}
