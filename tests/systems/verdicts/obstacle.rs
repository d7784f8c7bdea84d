//! Verdicts on obstacle problems with all nodes in contact while their data change.

use super::*;

#[test]
fn a_source_takes_nodes_from_one_obstacle_to_the_other_and_back() {
    for rate in [1.0, 7.0] {
        // The source of the obstacle problem is 3 rate cos(rate t), with u confined to [-1, 1] and no flux: every node
        // has the same ordinary differential equation.
        let at = |t: f64| t / rate;
        let solution = solve(&json!({"problem": {"obstacle": {"domain": {"x": [0, 1]}, "elements": 4, "diffusion": 1,
            "source": format!("3*{rate}*cos({rate}*t)"), "initial": 0, "obstacle": -1, "upper_obstacle": 1, "probes": {"a": [0.5]}}},
            "time": {"end": at(10.0)}, "output": {"times": [at(1.0), at(2.0), at(4.0), at(6.0), at(10.0)]}}));
        let exact = [1.0, 3.0 * (2.0_f64.sin() - 1.0) + 1.0, -1.0, 1.0, -1.0];
        let found = super::super::harness::column(&solution, "a");
        for (found, exact) in found.iter().zip(exact) {
            assert!((found - exact).abs() < 1e-3, "{found} {exact}");
        }
        assert_trusted(&solution);
    }
}

#[test]
fn a_pulse_of_any_width_wakes_nodes_that_rest() {
    for width in [0.5, 0.05, 0.002] {
        // From the time at which the source changes sign, u' = -1 + 20 exp(-((t - 5)/w)^2), integrated by Simpson's
        // rule.
        let source = |t: f64| -1.0 + 20.0 * (-((t - 5.0) / width).powi(2)).exp();
        let (from, to) = (5.0 - width * 20.0_f64.ln().sqrt(), 5.0 + width);
        let n = 2000;
        let h = (to - from) / n as f64;
        let exact: f64 = (0..n)
            .map(|i| from + i as f64 * h)
            .map(|t| h / 6.0 * (source(t) + 4.0 * source(t + 0.5 * h) + source(t + h)))
            .sum();
        let solution = solve(
            &json!({"problem": {"obstacle": {"domain": {"x": [0, 1]}, "elements": 20, "diffusion": 1, "obstacle": 0,
            "source": format!("-1+20*exp(-((t-5)/{width})^2)"), "initial": 0, "probes": {"a": [0.5]}}},
            "time": {"end": 10}, "output": {"times": [to]}}),
        );
        let found = last(&solution, "a");
        assert!((found - exact).abs() < 1e-3 * exact, "{width}: {found} {exact}");
        assert_trusted(&solution);
    }
}

#[test]
fn fixed_steps_over_a_pulse_are_not_trusted() {
    let spec = json!({"problem": {"obstacle": {"domain": {"x": [0, 1]}, "elements": 20, "diffusion": 1, "obstacle": 0,
        "source": "-1+20*exp(-((t-5)/0.01)^2)", "initial": 0, "probes": {"a": [0.5]}}},
        "time": {"end": 10}, "method": {"step": 0.7}, "output": {"times": [10]}});
    assert_eq!(reasons(&solve(&spec)), [CheckCode::EventsUnproven]);
}
