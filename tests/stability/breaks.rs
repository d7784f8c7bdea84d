//! Forcing, bounds and obstacles that jump at given times: no step of the integrator crosses such a time, and none of
//! them is missed.

use crate::stability::harness::{Case, distance, last};
use serde_json::json;
use std::f64::consts::PI;

#[test]
fn a_stiff_relaxation_follows_every_edge_of_a_square_wave() {
    // x' = -k (x - s), where s is 1 on the even half waves of sin t and 0 on the odd ones: between edges of s, the
    // distance of x from s decays by the factor e^-k dt.
    for stiffness in [1.0, 1e3, 1e8] {
        let rate = format!("-{stiffness:e}*(x - heaviside(sin(t)))");
        let exact = |t: f64| {
            let (mut x, mut edge) = (0.0, 0.0);
            loop {
                let target = if (edge / PI).round() as i64 % 2 == 0 { 1.0 } else { 0.0 };
                let end = t.min(edge + PI);
                x = target + (x - target) * (-stiffness * (end - edge)).exp();
                if end >= t {
                    return x;
                }
                edge += PI;
            }
        };
        let solution = Case::until(60.0).state("x", 0.0, &rate).method(json!({"rtol": 1e-8})).solve();
        let error = distance(&solution, "x", exact);
        // In the transient after an edge of the forcing, the rounding error of the time of that edge affects the
        // error of x.
        let bound = 1e-6 + 2.0 * stiffness * 60.0 * f64::EPSILON;
        assert!(error < bound, "stiffness {stiffness:e}: off by {error:e}");
        assert!((last(&solution, "x") - exact(60.0)).abs() < 1e-8, "stiffness {stiffness:e}");
        assert!(solution.diagnostics.steps.accepted < 2_000, "{:?}", solution.diagnostics.steps);
    }
}

#[test]
fn kinks_of_time_do_not_lower_the_order() {
    // The integral of |cos t| after k zeros of the cosine is 2 k + (-1)^k sin t.
    let exact = |t: f64| {
        let zeros = ((t + 0.5 * PI) / PI).floor();
        2.0 * zeros + if zeros as i64 % 2 == 0 { t.sin() } else { -t.sin() }
    };
    for (steps, bound) in [(20, 3e-6), (40, 1e-7), (80, 3e-9)] {
        let case = Case::until(10.0).state("x", 0.0, "abs(cos(t))");
        let solution = case.method(json!({"stages": 3, "step": 10.0 / f64::from(steps)})).solve();
        let error = (last(&solution, "x") - exact(10.0)).abs();
        assert!(error < bound, "{steps} steps: off by {error:e}");
    }
}

#[test]
fn pulses_of_any_width_are_met_at_their_edges() {
    // Each pulse is a function of one quantity that changes its sign twice within the width w, and drives x' = -x
    // with unit area: an edge at time c adds +-exp(c - t)/w to x. Times have a relative rounding error, which is a
    // larger fraction of a smaller width.
    let centres = [2.1, 7.3];
    for width in [1e-2_f64, 1e-5, 1e-7] {
        let pulse = |c: f64| format!("heaviside({:e} - (t - {c})^2)/{width:e}", 0.25 * width * width);
        let rate = format!("-x + {} + {}", pulse(centres[0]), pulse(centres[1]));
        let exact = |t: f64| {
            let pulses = centres.iter().filter(|c| **c < t);
            pulses.map(|c| (c - t).exp() * 2.0 * (0.5 * width).sinh() / width).sum::<f64>()
        };
        let solution = Case::until(10.0).state("x", 0.0, &rate).method(json!({"rtol": 1e-8})).solve();
        assert!(solution.verdict.trusted, "width {width:e}: {:?}", solution.verdict);
        let error = (last(&solution, "x") - exact(10.0)).abs();
        let bound = 1e-8 + 8.0 * f64::EPSILON * 7.3 / width;
        assert!(error < bound, "width {width:e}: off by {error:e}");
        // The integration restarts at each edge of a pulse of the forcing, which takes some evaluations; pulses cost
        // nothing else.
        let rates = solution.diagnostics.evaluations.rates;
        assert!(rates < 250, "width {width:e}: {rates} evaluations");
    }
}

#[test]
fn periodic_edges_cost_no_more_than_the_steps_between_them() {
    // The forcing is a pulse of width w about each whole number; between pulses, interval enclosures prove that no edge
    // exists.
    let width: f64 = 0.01;
    let level = (PI * width).cos();
    let rate = format!("-x + heaviside(cos({:?}*t) - {level:?})", 2.0 * PI);
    let edge = |k: f64, t: f64| (k + 0.5 * width - t).exp() - ((k - 0.5 * width).max(0.0) - t).exp();
    let exact = (0..=10).map(|k| edge(f64::from(k), 10.5)).sum::<f64>();
    let solution = Case::until(10.5).state("x", 0.0, &rate).method(json!({"rtol": 1e-8})).solve();
    assert!(solution.verdict.trusted, "{:?}", solution.verdict);
    let error = (last(&solution, "x") - exact).abs();
    assert!(error < 1e-9, "off by {error:e}");
    let rates = solution.diagnostics.evaluations.rates;
    assert!(rates < 500, "{rates} evaluations");
}

#[test]
fn outputs_within_a_transient_behind_a_switch_are_right() {
    // A small step of the rate at t = 1/2, at a given time or because a variable reaches its bound, starts a
    // transient that is a thousand times shorter than the steps before it. After the transient, x is right for any
    // step size; outputs within the transient are right only if steps resolve it.
    let (size, stiffness) = (1e-2, 1e6);
    let linear = |t: f64| size * (1.0 - (-stiffness * t).exp()) + 1.0;
    let logistic = |t: f64| (1.0 + size) / (1.0 + size * (-stiffness * (1.0 + size) * t).exp());
    type Exact<'a> = &'a dyn Fn(f64) -> f64;
    let rates: [(&str, String, Exact<'_>); 4] = [
        ("break", format!("-{stiffness:e}*(x - 1 - {size}*heaviside(t - 0.5))"), &linear),
        ("break", format!("{stiffness:e}*x*(1 + {size}*heaviside(t - 0.5) - x)"), &logistic),
        ("switch", format!("-{stiffness:e}*(x - 1 - {size}*z)"), &linear),
        ("switch", format!("{stiffness:e}*x*(1 + {size}*z - x)"), &logistic),
    ];
    let mut times: Vec<f64> = (0..60).map(|i| 0.5 + 0.1 * f64::from(i) / stiffness).collect();
    times.push(1.0);
    for (kind, rate, exact) in &rates {
        for stages in [3, 5, 7] {
            let mut case = Case::until(1.0).state("x", 1.0, rate);
            if *kind == "switch" {
                case = case.state("y", 0.0, "1").between("z", "0.5 - y", "0", "1");
            }
            let solution = case.method(json!({"stages": stages, "rtol": 1e-6})).times(json!(times)).solve();
            assert!(solution.verdict.trusted, "{rate}: {:?}", solution.verdict);
            let error = distance(&solution, "x", |t| exact((t - 0.5).max(0.0)));
            assert!(error < 1e-5, "{rate} with {stages} stages: off by {error:e}");
        }
    }
}
