//! Problems with memory whose switches are known: they are located, at the order of the method, each with a mesh behind it.

use crate::systems::harness::{column, distance, events, solve};
use crate::systems::memory::{abel, gamma};
use dvi::solution::Solution;
use serde_json::{Value, json};

/// A variable between 0 and 1 under the kernel of exponent `alpha`.
fn relaxation(alpha: f64, q: &str, end: f64, method: Value, times: usize) -> Value {
    json!({
        "problem": {"convolution": {
            "variables": {"u": {"q": q}},
            "kernel": {"fractional": {"exponent": alpha}},
            "set": [{"box": {"of": ["u"], "lower": 0, "upper": 1}}]
        }},
        "time": {"end": end},
        "method": method,
        "output": {"times": {"count": times}}
    })
}

fn assert_located(solution: &Solution, at_most: u64) {
    assert!(solution.verdict.trusted, "{:?}", solution.verdict);
    assert!(solution.diagnostics.built.contains(&"located switches"), "{:?}", solution.diagnostics.left_out);
    let steps = solution.diagnostics.steps.accepted;
    assert!(steps <= at_most, "{steps} steps");
}

/// `u` in ramps from 0 to 1, a rest, ramps back to 0 and a rest, `cycles` times, and `w` in parabolas while `u` rests: `q`, the
/// switches, and the end.
fn ramps(alpha: f64, cycles: usize) -> (String, Vec<f64>, f64) {
    let factor = gamma(alpha + 2.0);
    let (mut q, mut switches, mut t) = (String::from("max(0.3 - t, 0)"), Vec::new(), 0.3);
    for i in 0..cycles {
        let i = i as f64;
        let lengths = [
            0.4 + 0.1 * (3.0 * i + 1.0).sin(),
            0.5 + 0.2 * (5.0 * i).sin(),
            0.3 + 0.1 * (2.0 * i).cos(),
            0.4 + 0.2 * (7.0 * i + 2.0).cos(),
        ];
        let mut knots = vec![t];
        lengths.iter().for_each(|length| knots.push(knots[knots.len() - 1] + length));
        for (knot, slope) in
            knots.iter().zip([1.0 / lengths[0], -1.0 / lengths[0], -1.0 / lengths[2], 1.0 / lengths[2]])
        {
            q += &format!(" - ({:e})*max(t - {knot}, 0)^{}", slope / factor, 1.0 + alpha);
        }
        for (from, to, sign) in [(knots[1], knots[2], -1.0), (knots[3], knots[4], 1.0)] {
            let length = to - from;
            q += &format!(
                " + ({sign})*({length}*(max(t - {from}, 0) + max(t - {to}, 0)) - max(t - {from}, 0)^2 + max(t - {to}, 0)^2)"
            );
        }
        switches.extend(&knots[..4]);
        t = knots[4];
    }
    (q, switches, t)
}

#[test]
fn fifty_two_known_switches_are_located() {
    for alpha in [0.3, 0.5] {
        let (q, switches, end) = ramps(alpha, 13);
        let u = |t: f64| {
            let next = switches.partition_point(|switch| *switch < t);
            let Some(last) = next.checked_sub(1) else { return 0.0 };
            let part = || (t - switches[last]) / (switches[next] - switches[last]);
            match last % 4 {
                0 => part(),
                1 => 1.0,
                2 => 1.0 - part(),
                _ => 0.0,
            }
        };
        let solution = solve(&relaxation(alpha, &q, end, json!({"rtol": 1e-8}), 1001));
        assert_located(&solution, 5_000);
        let found = events(&solution, "u");
        assert_eq!(found.len(), switches.len(), "alpha = {alpha}: {found:?}");
        let apart = found.iter().zip(&switches).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
        assert!(apart < 1e-8, "alpha = {alpha}: {apart:e}");
        let error = distance(&solution, "u", u);
        assert!(error < 1e-8, "alpha = {alpha}: {error:e}");
    }
}

#[test]
fn a_relaxation_between_bounds_switches_fifty_times() {
    // Held at zero until q = 0. The times are those of runs that share neither their mesh nor their tolerance, and the
    // first is known.
    for alpha in [0.3, 0.5, 0.8, 1.0] {
        let q = "1.2 - cos(3*t) - 1.4*sin(t)^2";
        let run =
            |rtol: f64, stages: u32| solve(&relaxation(alpha, q, 70.0, json!({"rtol": rtol, "stages": stages}), 4501));
        let (first, second) = (run(1e-7, 5), run(1e-9, 7));
        let (a, b) = (events(&first, "u"), events(&second, "u"));
        assert_located(&first, 5_000);
        assert_located(&second, 5_000);
        assert!(a.len() >= 50 && a.len() == b.len(), "alpha = {alpha}: {} and {} switches", a.len(), b.len());
        let apart = a.iter().zip(&b).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
        assert!(apart < 1e-8, "alpha = {alpha}: switches differ by {apart:e}");
        let q_at_first = 1.2 - (3.0 * a[0]).cos() - 1.4 * a[0].sin().powi(2);
        assert!(q_at_first.abs() < 1e-13, "alpha = {alpha}: q = {q_at_first:e} at the first switch");
        // The uniform grid converges to the same, slowly.
        let uniform = solve(&relaxation(alpha, q, 70.0, json!({"step": 70.0 / 65536.0}), 4501));
        let pairs = column(&first, "u").iter().zip(column(&uniform, "u"));
        let mean = pairs.map(|(a, b)| (a - b).abs()).sum::<f64>() / 4501.0;
        assert!(mean < 2e-4, "alpha = {alpha}: {mean:e} from the uniform grid");
    }
}

#[test]
fn one_switch_has_a_closed_form_behind_it() {
    // q = (1 - t)(1 + t): u solves I^a u = 2 s + s^2 with s = t - 1, and leaves zero like s^(1-a).
    for alpha in [0.2, 0.5, 0.9] {
        let exact = |t: f64| {
            let s = (t - 1.0).max(0.0);
            2.0 * s.powf(1.0 - alpha) / gamma(2.0 - alpha) + 2.0 * s.powf(2.0 - alpha) / gamma(3.0 - alpha)
        };
        for rtol in [1e-4, 1e-6, 1e-8] {
            let mut document = abel(alpha, "(1 - t)*(1 + t)", 3.0, json!({"rtol": rtol}));
            document["output"] = json!({"times": {"count": 301}});
            let solution = solve(&document);
            assert_located(&solution, 200);
            let found = distance(&solution, "u", exact);
            assert!(found < 10.0 * rtol, "alpha = {alpha}, rtol = {rtol:e}: {found:e}");
            let starts = events(&solution, "u");
            assert!(starts.len() == 1 && (starts[0] - 1.0).abs() < 1e-12, "alpha = {alpha}: {starts:?}");
        }
    }
}

#[test]
fn the_order_holds_over_switches() {
    // Errors against the steps that they cost, from a run at a tolerance far below.
    let alpha = 0.6;
    let q = "1.2 - cos(3*t) - 1.4*sin(t)^2";
    let run = |rtol: f64| solve(&relaxation(alpha, q, 20.0, json!({"rtol": rtol}), 2001));
    let reference = solve(&relaxation(alpha, q, 20.0, json!({"rtol": 1e-10, "stages": 7}), 2001));
    let error = |solution: &Solution| {
        let pairs = column(solution, "u").iter().zip(column(&reference, "u"));
        pairs.map(|(a, b)| (a - b).abs()).sum::<f64>() / 2001.0
    };
    let (coarse, fine) = (run(1e-6), run(1e-8));
    assert_located(&coarse, 5_000);
    assert_located(&fine, 5_000);
    let steps = |solution: &Solution| solution.diagnostics.steps.accepted as f64;
    let order = (error(&coarse) / error(&fine)).ln() / (steps(&fine) / steps(&coarse)).ln();
    assert!(
        order >= 3.0,
        "order {order}: {:e} in {}, {:e} in {}",
        error(&coarse),
        steps(&coarse),
        error(&fine),
        steps(&fine)
    );
    // What is told of the error is no less than it is.
    for solution in [&coarse, &fine] {
        let told = solution.diagnostics.refinement.as_ref().expect("no step is given").mean_distance[0].1;
        assert!(error(solution) <= told.max(1e-12), "{:e}, not {told:e}", error(solution));
    }
}

#[test]
fn kernels_of_time_and_of_higher_index_have_segments_too() {
    // u = 2 t^0.1 / Gamma(1.1) solves (t^0.9 / Gamma(1.9)) * u = t^2.
    let solution = solve(&json!({
        "problem": {"convolution": {
            "variables": {"u": {"q": "-t^2"}},
            "kernel": {"fractional": {"exponent": 1.9}},
            "set": [{"free": ["u"]}]
        }},
        "time": {"end": 2}, "output": {"times": {"count": 41}}
    }));
    assert_located(&solution, 500);
    let found = distance(&solution, "u", |t| 2.0 * t.powf(0.1) / gamma(1.1));
    assert!(found < 1e-6, "{found:e}");
}
