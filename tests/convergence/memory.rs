//! For the kernel `t^(a - 1)/Gamma(a)`, convolution quadrature with `s` stages has the order `min(2s - 1, s + 1 - a)`
//! where the solution is smooth. The complementary variables `u` and `w` have smooth bumps in turn, with switches
//! between the bumps.

use crate::systems::harness::{distance, solve};
use crate::systems::memory::{abel, gamma};
use serde_json::json;

/// The degree of the B-splines ("bumps") of which the exact solutions `u` and `w` consist; their knot distance is
/// `WIDTH`.
const DEGREE: i32 = 5;
const WIDTH: f64 = 0.5;

/// Returns the knots and coefficients of the truncated powers `coefficient (t - knot)_+^5` whose sum is the B-spline
/// that begins at `start`.
fn powers(start: f64) -> Vec<(f64, f64)> {
    let mut binomial = 1.0;
    let factorial: f64 = (1..=DEGREE).map(f64::from).product();
    (0..=DEGREE + 1)
        .map(|j| {
            let power = (start + WIDTH * f64::from(j), binomial / (factorial * WIDTH.powi(DEGREE)));
            binomial *= -f64::from(DEGREE + 1 - j) / f64::from(j + 1);
            power
        })
        .collect()
}

fn bump(start: f64, t: f64) -> f64 {
    powers(start).iter().map(|(knot, factor)| factor * (t - knot).max(0.0).powi(DEGREE)).sum()
}

/// Returns the largest error of the computed `u`, whose exact B-splines begin at 0.3 and 6.9; those of `w` begin at 3.6
/// and 10.2.
fn error(alpha: f64, stages: usize, step: f64) -> f64 {
    let mut q = String::from("0");
    for start in [3.6, 10.2] {
        for (knot, factor) in powers(start) {
            q += &format!(" + ({factor:e})*max(t - {knot}, 0)^{DEGREE}");
        }
    }
    for start in [0.3, 6.9] {
        for (knot, factor) in powers(start) {
            let factor = factor * gamma(f64::from(DEGREE) + 1.0) / gamma(f64::from(DEGREE) + 1.0 + alpha);
            q += &format!(" - ({factor:e})*max(t - {knot}, 0)^{}", f64::from(DEGREE) + alpha);
        }
    }
    let solution = solve(&abel(alpha, &q, 13.5, json!({"step": step, "stages": stages})));
    distance(&solution, "u", |t| bump(0.3, t) + bump(6.9, t))
}

#[test]
fn the_order_is_that_of_the_theory_over_switches() {
    for (alpha, stages) in
        [(0.25, 2), (0.5, 2), (0.75, 2), (1.0, 2), (1.5, 2), (0.25, 3), (0.5, 3), (0.75, 3), (1.0, 3), (1.5, 3)]
    {
        let theory = (2.0 * stages as f64 - 1.0).min(stages as f64 + 1.0 - alpha);
        let (coarse, fine) = (error(alpha, stages, 0.05), error(alpha, stages, 0.0125));
        let order = (coarse / fine).log2() / 2.0;
        assert!(
            order > theory - 0.3,
            "alpha = {alpha}, s = {stages}: {coarse:e} -> {fine:e}, order {order}, not {theory}"
        );
    }
}
