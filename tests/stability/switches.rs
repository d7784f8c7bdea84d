//! Switches of the active set: many, simultaneous, grazing, and stepped over.

use crate::stability::harness::{Case, RELAY, column, distance, instants, last};
use serde_json::{Value, json};
use std::f64::consts::PI;

#[test]
fn a_bound_that_is_touched_is_no_switch_and_one_passed_within_a_step_is_two() {
    // While z = 0, x = (t - 1)^2 + depth. If depth < 0, x rests at zero from t = 1 - sqrt(-depth) to t = 1.
    for depth in [0.0, 1e-14, 1e-8, 1e-6] {
        let case = Case::until(3.0).state("x", 1.0 + depth, "2*(t - 1) + z").nonnegative("z", "x");
        let solution = case.method(json!({"rtol": 1e-8})).solve();
        let error = distance(&solution, "x", |t| (t - 1.0).powi(2) + depth);
        assert!(error < 1e-13, "{depth:e}: off by {error:e}");
    }
    for depth in [-1e-8, -1e-6, -1e-4, -1e-2, -0.3] {
        let contact = 1.0 - f64::sqrt(-depth);
        let case = Case::until(3.0).state("x", 1.0 + depth, "2*(t - 1) + z").nonnegative("z", "x");
        let solution = case.method(json!({"rtol": 1e-8})).solve();
        let exact = |t: f64| if t < contact { (t - 1.0).powi(2) + depth } else { (t - 1.0).max(0.0).powi(2) };
        let error = distance(&solution, "x", exact);
        assert!(error < 1e-11, "{depth:e}: off by {error:e}");
        let times = instants(&solution);
        assert_eq!(times.len(), 2, "{depth:e}: {times:?}");
        assert!((times[0] - contact).abs() < 1e-8 && (times[1] - 1.0).abs() < 1e-8, "{depth:e}: {times:?}");
    }
}

#[test]
fn variables_that_switch_at_once_switch_at_one_time() {
    for count in [2, 3] {
        let mut case = Case::until(3.0);
        for k in 0..count {
            let speed = f64::from(k + 1);
            let next = (k + 1) % count;
            case = case.state(&format!("x{k}"), speed, &format!("-{speed} + z{k} + 0.25*z{next}"));
            case = case.nonnegative(&format!("z{k}"), &format!("x{k}"));
        }
        let solution = case.method(json!({"rtol": 1e-8})).solve();
        for k in 0..count {
            let speed = f64::from(k + 1);
            let error = distance(&solution, &format!("x{k}"), |t| (speed * (1.0 - t)).max(0.0));
            assert!(error < 1e-13, "x{k} is off by {error:e}");
            let next = (k + 1) % count;
            let push = last(&solution, &format!("z{k}")) + 0.25 * last(&solution, &format!("z{next}"));
            assert!((push - speed).abs() < 1e-12);
        }
        let times = instants(&solution);
        assert!(times.len() == 1 && (times[0] - 1.0).abs() < 1e-12, "{times:?}");
        assert_eq!(solution.diagnostics.switches, count as u64);
    }
}

#[test]
fn a_spring_with_dry_friction_stops_after_eight_half_turns() {
    // A mass on a spring with dry friction, x'' + 100 x in -0.3 g Sgn x', x(0) = 1/2: each half period takes pi/10 and
    // reduces the amplitude by 2 mu g/k = 0.05886, until the spring force is below the friction limit.
    let case = Case::until(4.0).state("x", 0.5, "v").state("v", 0.0, "-100*x - F");
    let turns: Vec<f64> = (0..=8).map(|k| 0.1 * PI * f64::from(k)).collect();
    let case = case.between("F", "-v", "-2.943", "2.943").method(json!({"rtol": 1e-10}));
    let solution = case.times(json!([&turns[..], &[3.0, 4.0]].concat())).solve();
    let exact = |k: i32| f64::powi(-1.0, k) * (0.5 - 0.05886 * f64::from(k));
    for (k, &x) in (0..).zip(column(&solution, "x")) {
        let error = (x - exact(k.min(8))).abs();
        assert!(error < 1e-8, "half turn {k}: {x} is off by {error:e}");
    }
    assert!(last(&solution, "v").abs() < 1e-12);
    let times = instants(&solution);
    assert!((times[times.len() - 1] - turns[8]).abs() < 1e-8, "{times:?}");
}

#[test]
fn a_hundred_thousand_switches_keep_their_phase() {
    // The solution of x' = 3 cos t - sgn x tends to one with x(t + pi) = -x(t), positive from t_0 on with 6 sin t_0 =
    // -pi.
    let half_periods = 100_000;
    let end = PI * f64::from(half_periods);
    let case = Case::until(end).state("x", 0.0, "3*cos(t) - s").between("s", "-x", RELAY[0], RELAY[1]);
    let solution = case.method(json!({"rtol": 1e-6})).times(json!([end])).solve();
    let switches = instants(&solution);
    assert_eq!(switches.len(), half_periods as usize);
    let first = PI - (PI / 6.0).asin();
    let phase = switches[switches.len() - 1] % PI;
    assert!((phase - first).abs() < 1e-5, "the last switch is at {phase}, not {first}, of its half period");
    let error = (last(&solution, "x") - std::f64::consts::FRAC_PI_2 + (PI / 6.0).asin()).abs();
    assert!(error < 1e-4, "x is off by {error:e}");
    // The trajectory contains only the single requested output time, whatever the number of steps.
    assert_eq!(solution.trajectory.t.len(), 1);
}

/// Specification of a state `x = 2 - 0.7 t + 0.1 sin t` that stays at zero once it has reached zero; the state `y` is
/// its integral.
fn slide() -> Case {
    let case = Case::until(5.0).state("x", 2.0, "0.3 - s + 0.1*cos(t)").state("y", 0.0, "x");
    case.between("s", "-x", RELAY[0], RELAY[1])
}

/// Returns the exact final `y` of the problem of `slide`: the integral of `x` up to its zero, which Newton's method
/// finds.
fn integral() -> f64 {
    let mut rest = 2.8_f64;
    for _ in 0..20 {
        rest -= (2.0 - 0.7 * rest + 0.1 * rest.sin()) / (0.1 * rest.cos() - 0.7);
    }
    2.0 * rest - 0.35 * rest * rest + 0.1 * (1.0 - rest.cos())
}

#[test]
fn stepping_over_switches_solves_every_step_and_converges() {
    let integral = integral();
    for vi_solver in ["lemke", "semismooth_newton"] {
        for stages in 1..=7 {
            for steps in [100, 333, 1000, 5000] {
                let step = 5.0 / f64::from(steps);
                let solution = slide()
                    .method(json!({
                        "stages": stages, "step": step, "switches": "step_over", "vi_solver": vi_solver, "rtol": 1e-10
                    }))
                    .solve();
                assert!(column(&solution, "x").iter().all(|&x| x > -1e-12));
                // If steps pass over switches, the step that contains the switch is of low order, whatever the order
                // of the method.
                let bound = if stages == 1 { 2.0 * step } else { step * step };
                let error = (last(&solution, "y") - integral).abs();
                assert!(error < bound, "{stages} stages, {steps} steps: off by {error:e}");
                assert!((last(&solution, "s") - 0.3 - 0.1 * 5.0_f64.cos()).abs() < 1e-6);
            }
        }
    }
}

#[test]
fn stepping_over_switches_with_error_control_keeps_the_tolerance() {
    let integral = integral();
    for tolerance in [1e-4, 1e-6, 1e-8] {
        let solution = slide().method(json!({"rtol": tolerance, "switches": "step_over"})).solve();
        let error = (last(&solution, "y") - integral).abs();
        assert!(error < 10.0 * tolerance, "rtol {tolerance:e}: off by {error:e}");
        // A rejected step leaves no switch in the diagnostics: there is one switch, and no warning of accumulating
        // switches.
        assert_eq!(solution.diagnostics.switches, 1);
        assert!(solution.diagnostics.warnings.is_empty(), "{:?}", solution.diagnostics.warnings);
    }
}

#[test]
fn pulses_between_which_no_state_moves_are_all_found() {
    // x' = max(0, sin t - c): while sin t is below c, no state changes, and only information on the sign of G limits
    // the step size.
    for level in [0.0, 0.9, 0.99, 0.999] {
        let start = f64::asin(level);
        let pulse = 2.0 * start.cos() - level * (PI - 2.0 * start);
        for method in [json!({"rtol": 1e-6}), json!({"rtol": 1e-3}), json!({"rtol": 1e-6, "stages": 3})] {
            let case = Case::until(200.0 * PI).state("x", 0.0, "z").nonnegative("z", &format!("z - sin(t) + {level}"));
            let tolerance = method["rtol"].as_f64().expect("a number");
            let solution = case.method(method.clone()).times(json!([200.0 * PI])).solve();
            let times = instants(&solution);
            assert!(times.len() >= 199, "{level}, {method}: {} switches", times.len());
            let error = (last(&solution, "x") / (100.0 * pulse) - 1.0).abs();
            assert!(error < 30.0 * tolerance, "{level}, {method}: off by {error:e}");
        }
    }
}

/// Solves `x' = max(0, g)` in three formulations: with one variable, with an additional free variable, and with two
/// variables that occur in each other's inequalities. Compares the number of switches with the zeros of `g`, and the
/// final state with the integral of `max(0, g)`, both computed from two million samples.
fn assert_all_pulses_are_found(g: impl Fn(f64) -> f64, text: &str, method: Value) {
    let (end, samples) = (200.0 * PI, 2_000_000);
    let values: Vec<f64> = (0..samples).map(|i| g((f64::from(i) + 0.5) * end / f64::from(samples))).collect();
    let zeros = values.windows(2).filter(|pair| (pair[0] < 0.0) != (pair[1] < 0.0)).count();
    let integral = values.iter().map(|value| value.max(0.0)).sum::<f64>() * end / f64::from(samples);
    let case = || Case::until(end).state("x", 0.0, "z").times(json!([end])).method(method.clone());
    let alone = case().nonnegative("z", &format!("z - ({text})"));
    let beside = case().nonnegative("z", &format!("z + w - 2*({text})")).free("w", "w - z");
    let pair = |one: &str, other: &str| format!("2*{one} + {other} - 3*({text})");
    let coupled = case().nonnegative("z", &pair("z", "w")).nonnegative("w", &pair("w", "z"));
    for (form, case) in [("alone", alone), ("beside a free one", beside), ("coupled", coupled)] {
        let solution = case.solve();
        assert_eq!(instants(&solution).len(), zeros, "{form}, {method}");
        let error = (last(&solution, "x") / integral - 1.0).abs();
        assert!(error < 1e-4, "{form}, {method}: off by {error:e}");
    }
}

#[test]
fn a_pulse_in_the_step_before_a_located_switch_is_found() {
    let g = |t: f64| (5.0 * t).cos() + (0.3 * t).cos() - 1.6;
    for rtol in [1e-3, 1e-6, 1e-9] {
        assert_all_pulses_are_found(g, "cos(5*t) + cos(0.3*t) - 1.6", json!({"rtol": rtol}));
    }
}

#[test]
fn a_block_that_a_force_moves_now_and_then_is_not_left_stuck() {
    // v' = a sin 3t - F, |F| <= 1: the block slips in alternating directions, each time from when the force exceeds 1
    // until v is zero.
    let a = 1.1_f64;
    let start = (1.0 / a).asin();
    let slip = |phase: f64| (a * (start.cos() - phase.cos()) - (phase - start)) / 3.0;
    let (mut low, mut high) = (start + 0.1, PI);
    for _ in 0..60 {
        let middle = 0.5 * (low + high);
        if slip(middle) > 0.0 { low = middle } else { high = middle }
    }
    for rtol in [1e-3, 1e-6, 1e-9] {
        let case =
            Case::until(10.0).state("x", 0.0, "v").state("v", 0.0, "1.1*sin(3*t) - F").between("F", "-v", "-1", "1");
        let solution = case.method(json!({"rtol": rtol})).times(json!([10])).solve();
        let times = instants(&solution);
        // The events of the block: nine half periods with two switches each, and the beginning of the tenth slip.
        assert_eq!(times.len(), 19, "{rtol:e}: {times:?}");
        for (k, pair) in times.chunks_exact(2).enumerate() {
            let begins = |phase: f64| (phase + PI * k as f64) / 3.0;
            let error = (pair[0] - begins(start)).abs().max((pair[1] - begins(low)).abs());
            assert!(error < 30.0 * rtol, "{rtol:e}: slip {k} at {pair:?}, off by {error:e}");
        }
    }
}

#[test]
fn a_rest_between_the_stages_of_a_long_step_is_found() {
    // The polynomial through the five stage values of the variable z is positive although z is zero for a fifth of the
    // step.
    let g = |t: f64| t.sin() - 0.5 + 0.6 * (3.3 * t).sin();
    assert_all_pulses_are_found(g, "sin(t) - 0.5 + 0.6*sin(3.3*t)", json!({"rtol": 1e-4, "stages": 5}));
}
