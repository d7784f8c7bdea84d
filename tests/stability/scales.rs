//! States from 1e-300 to 1e300, horizons from 1e-11 to 1e11: only ratios to the scale may matter.

use crate::stability::harness::{Case, distance, last};
use serde_json::json;

const SCALES: [f64; 4] = [1e-300, 1e-150, 1e150, 1e300];

/// `1e-10` of the scale, as far as a double goes.
fn method(scale: f64) -> serde_json::Value {
    json!({"rtol": 1e-8, "atol": (1e-10 * scale).max(1e-310)})
}

#[test]
fn a_linear_and_a_nonlinear_decay_are_right_at_any_scale_of_the_states() {
    for scale in SCALES {
        let linear = Case::until(3.0).state("x", scale, "-x").state("y", 0.5 * scale, "x - 2*y");
        let solution = linear.method(method(scale)).solve();
        let error = distance(&solution, "x", |t| scale * (-t).exp()) / scale;
        assert!(error < 1e-7, "{scale:e}: off by {error:e}");
        let rate = format!("-x*(1 + (x/{scale:e})^2)");
        let solution = Case::until(3.0).state("x", scale, &rate).method(method(scale)).solve();
        let error = distance(&solution, "x", |t| scale / (2.0 * (2.0 * t).exp() - 1.0).sqrt()) / scale;
        assert!(error < 1e-7, "{scale:e}: off by {error:e}");
    }
}

#[test]
fn a_relay_switches_at_any_scale_of_the_states() {
    for scale in SCALES {
        let bounds = [format!("-{scale:e}"), format!("{scale:e}")];
        let case = Case::until(5.0).state("x", 2.0 * scale, &format!("0.3*{scale:e} - s"));
        let solution = case.between("s", "-x", &bounds[0], &bounds[1]).method(method(scale)).solve();
        let error = distance(&solution, "x", |t| scale * (2.0 - 0.7 * t).max(0.0)) / scale;
        assert!(error < 1e-14, "{scale:e}: off by {error:e}");
        assert_eq!(solution.diagnostics.switches, 1);
    }
}

#[test]
fn horizons_of_1e11_and_1e_minus_11_are_alike() {
    for end in [1e11_f64, 1e-11] {
        let case = Case::until(end).state("x", 1.0, &format!("-x/{end:e}")).method(json!({"rtol": 1e-8}));
        let solution = case.solve();
        let error = (last(&solution, "x") - (-1.0_f64).exp()).abs();
        assert!(error < 1e-8, "T = {end:e}: off by {error:e}");
        let case = Case::until(end).state("x", 2.0, &format!("(0.5 - 4*s)/{end:e}"));
        let solution = case.between("s", "-x", "-1", "1").method(json!({"rtol": 1e-8})).solve();
        let error = distance(&solution, "x", |t| (2.0 - 3.5 * t / end).max(0.0));
        assert!(error < 1e-12, "T = {end:e}: off by {error:e}");
    }
}

#[test]
fn time_may_be_counted_in_any_unit() {
    // Complex pivots are squared when they are divided by: 1e-200 and 1e200 would not survive it.
    for end in [1e200_f64, 1e-200] {
        let case =
            Case::until(end).state("x", 1.0, &format!("-x/{end:e}")).state("y", 0.0, &format!("(x - 2*y)/{end:e}"));
        let solution = case.method(json!({"rtol": 1e-8})).solve();
        let error = (last(&solution, "y") - ((-1.0_f64).exp() - (-2.0_f64).exp())).abs();
        assert!(error < 1e-8, "T = {end:e}: off by {error:e}");
    }
}

#[test]
fn masses_in_the_ratio_of_1e9_stop_together() {
    let case = Case::until(2.0).state("x", 1.0, "-1 + z").state("y", 1.0, "-1e9 + w");
    let case = case.nonnegative("z", "x").nonnegative("w", "y").mass(json!([[1, 0], [0, 1e9]]));
    let solution = case.solve();
    for name in ["x", "y"] {
        let error = distance(&solution, name, |t| (1.0 - t).max(0.0));
        assert!(error < 1e-13, "`{name}` is off by {error:e}");
    }
    assert!((last(&solution, "w") / 1e9 - 1.0).abs() < 1e-12);
}

#[test]
fn a_short_run_far_from_zero_counts_its_time_exactly() {
    // Ten steps of 1e-5 at t = 1e9, where a double resolves 1.2e-7.
    let (start, end) = (1e9, 1e9 + 1e-5);
    let case = Case::until(end).from(start).state("x", 1.0, "-1e5*x").method(json!({"rtol": 1e-8}));
    let solution = case.solve();
    let error = (last(&solution, "x") - (-1e5_f64 * (end - start)).exp()).abs();
    assert!(error < 1e-8, "off by {error:e}");
    // The next double after the start is a horizon too.
    let solution = Case::until(1.0 + f64::EPSILON).from(1.0).state("x", 1.0, "-x").solve();
    assert!((last(&solution, "x") - 1.0).abs() < 1e-15);
}
