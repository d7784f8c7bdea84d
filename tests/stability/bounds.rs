//! Bounds of variables that move with time or with the states, meet, cross, or coincide from the beginning.

use crate::stability::harness::{Case, column, distance, instants, last};
use dvi::solution::Status;
use serde_json::json;

#[test]
fn a_variable_follows_bounds_that_move() {
    // The solution z = max(cos t, sin t) is the median of (cos t, sin t, 2).
    let case = Case::until(6.0).state("x", 0.0, "-x + z").between("z", "z - sin(t)", "cos(t)", "2");
    let solution = case.method(json!({"rtol": 1e-8})).solve();
    let error = distance(&solution, "z", |t| t.cos().max(t.sin()));
    assert!(error < 1e-12, "z is off by {error:e}");
    let times = instants(&solution);
    assert_eq!(times.len(), 2, "{times:?}");
    for (t, quarter) in times.iter().zip([0.25, 1.25]) {
        assert!((t - quarter * std::f64::consts::PI).abs() < 1e-9, "{t}");
    }
    let evidence = solution.diagnostics.complementarity.expect("evidence");
    assert!(evidence.smallest_g > -1e-9 && evidence.largest_product < 1e-9, "{evidence:?}");
}

#[test]
fn bounds_that_cross_end_the_run_where_they_do() {
    // The lower bound sin t exceeds the upper bound 1/2 from t = pi/6; before, z = max(sin t, 0.2).
    let case = Case::until(6.0).state("x", 0.0, "z").between("z", "z - 0.2", "sin(t)", "0.5");
    let solution = case.method(json!({"rtol": 1e-8})).run();
    assert_eq!(solution.status, Status::Failed);
    let failure = solution.error.as_ref().expect("a failure");
    assert_eq!(failure.code, "empty_set");
    assert!(failure.message.contains("`z`"), "{}", failure.message);
    assert!((failure.time - std::f64::consts::FRAC_PI_6).abs() < 1e-8, "{}", failure.time);
    assert!(column(&solution, "z").iter().all(|&z| (0.2 - 1e-9..0.5 + 1e-9).contains(&z)));
    // The state x = 2 e^-t - 1, which gives both bounds -x and x, changes its sign at t = ln 2: the set becomes
    // empty.
    let case = Case::until(3.0).state("x", 1.0, "-1 - x").state("v", 1.0, "-F").between("F", "-v", "-x", "x");
    let failure = case.run().error.expect("a failure");
    assert_eq!(failure.code, "empty_set");
    assert!((failure.time - 2.0_f64.ln()).abs() < 1e-6, "{}", failure.time);
}

#[test]
fn a_ball_whose_radius_turns_negative_ends_the_run_where_it_does() {
    let ball = json!({"ball": {"of": ["z"], "radius": "1 - t"}});
    let failure =
        Case::until(3.2).state("x", 0.0, "z").variable("z", "z - sin(t)", ball).run().error.expect("a failure");
    assert_eq!(failure.code, "empty_set");
    assert!(failure.message.contains("the ball of `z`") && failure.message.contains("t = "), "{}", failure.message);
    assert!((failure.time - 1.0).abs() < 1e-8, "{}", failure.time);
}

#[test]
fn both_ends_of_an_interval_are_reached_within_one_step() {
    // The variable z = clip(gain sin t) moves from one bound to the other within the time 2/gain.
    for gain in [1e3, 1e9] {
        let case = Case::until(10.0).state("x", 0.0, "-x + z");
        let case = case.between("z", &format!("z - {gain:e}*sin(t)"), "-1", "1").method(json!({"rtol": 1e-8}));
        let solution = case.solve();
        // The exact solution satisfies x' = -x + sgn(sin t), where z = sgn(sin t) except for a time of 2/gain at each
        // switch.
        let mut exact = 0.0;
        for k in 0..4 {
            let (from, to) = (f64::from(k) * std::f64::consts::PI, (f64::from(k + 1) * std::f64::consts::PI).min(10.0));
            let level = if k % 2 == 0 { 1.0 } else { -1.0 };
            exact = level + (exact - level) * (from - to).exp();
        }
        let error = (last(&solution, "x") - exact).abs();
        assert!(error < 2.0 / gain + 1e-8, "gain {gain:e}: off by {error:e}");
    }
}
