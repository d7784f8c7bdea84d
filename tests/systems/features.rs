//! Features of functions of the states that are narrow compared with a step: hills, strips and pulses that nothing
//! announces, each compared with a closed form.

use crate::systems::harness::{column, distance, last, solve};
use dvi::solution::Solution;
use serde_json::{Value, json};
use std::f64::consts::PI;

/// Widths of a narrow feature of a function, from one that a step may hit by chance to one that no step hits.
const WIDTHS: [f64; 3] = [1e-2, 1e-4, 1e-6];

fn assert_trusted(solution: &Solution) {
    assert!(solution.verdict.trusted, "{:?}", solution.verdict);
}

fn mechanical(system: Value, end: f64) -> Solution {
    let solution = solve(&json!({"problem": {"mechanical": system}, "time": {"end": end}}));
    assert_trusted(&solution);
    solution
}

/// Solves `x' = unit` and `y' = rate` from zero up to the time 3, and returns `y(3)`, the integral of `rate`.
fn integral(rate: &str, unit: f64) -> f64 {
    let states = json!({"x": {"initial": 0, "rate": unit.to_string()}, "y": {"initial": 0, "rate": rate}});
    let solution = solve(&json!({"problem": {"dvi": {"states": states}}, "time": {"end": 3},
        "method": {"atol": 1e-9 * unit}}));
    assert_trusted(&solution);
    last(&solution, "y")
}

#[test]
fn a_particle_is_thrown_back_by_a_hill_however_narrow_in_any_units() {
    for width in WIDTHS {
        for unit in [1e-6, 1.0, 1e6] {
            let potential = format!("{unit}^2*exp(-((x - {unit})/({width}*{unit}))^2)");
            let solution = solve(&json!({"problem": {"mechanical": {
                "coordinates": {"x": {"initial": 0, "velocity": unit}}, "mass": [[1]], "potential": potential}},
                "time": {"end": 4}, "method": {"atol": 1e-9 * unit}}));
            assert_trusted(&solution);
            // The particle returns from the hill with its initial speed, after turning on the flank, at most a few
            // widths before the top.
            assert!((last(&solution, "x_dot") / unit + 1.0).abs() < 2e-5, "{width}, {unit}");
            assert!((last(&solution, "x") / unit + 2.0).abs() < 5.0 * width + 1e-4, "{width}, {unit}");
        }
    }
}

#[test]
fn a_strip_adds_the_work_of_its_force() {
    for width in WIDTHS {
        let force = 0.5 / width;
        let system = json!({"coordinates": {"x": {"initial": 0, "velocity": 1}}, "mass": [[1]],
            "forces": {"x": format!("{force}*heaviside(x - 1)*heaviside({} - x)", 1.0 + width)}});
        let solution = mechanical(system, 4.0);
        let speed = 2.0_f64.sqrt();
        let within = 2.0 * width / (1.0 + speed);
        assert!((last(&solution, "x_dot") - speed).abs() < 1e-5, "{width}");
        let there = 1.0 + width + (3.0 - within) * speed;
        assert!((last(&solution, "x") - there).abs() < 3e-5, "{width}");
    }
}

#[test]
fn a_magnet_below_a_floor_brakes_what_slides_over_it() {
    // While the body slides past the magnet, the normal force is 1 + 0.2 exp(..)/width, and the work of friction gives
    // v^2 = 1 - 2 mu (x + 0.2 sqrt(pi)) behind the magnet.
    for width in [1e-2, 1e-3] {
        let system = json!({"coordinates": {"x": {"initial": 0, "velocity": 1}, "y": {"initial": 0}},
            "mass": [[1, 0], [0, 1]], "forces": {"y": format!("-1 - {}*exp(-((x - 1)/{width})^2)", 0.2 / width)},
            "contacts": [{"name": "floor", "gap": "y", "friction": {"coefficient": 0.05, "slip": ["x_dot"]}}]});
        let solution = mechanical(system, 3.0);
        let work = 0.05 * (last(&solution, "x") + 0.2 * PI.sqrt());
        assert!((last(&solution, "x_dot").powi(2) - (1.0 - 2.0 * work)).abs() < 1e-5, "{width}");
    }
}

#[test]
fn rates_that_peak_where_a_state_passes_are_integrated() {
    for width in WIDTHS {
        for unit in [1e-6, 1.0, 1e6] {
            let peak = format!("{unit}*exp(-((x/{unit} - 1.2345)/{width})^2)/{width}");
            assert!((integral(&peak, unit) / unit - PI.sqrt()).abs() < 1e-5, "peak {width}, {unit}");
        }
        let strip = format!("heaviside(x - 1.2345)*heaviside({} - x)/{width}", 1.2345 + width);
        assert!((integral(&strip, 1.0) - 1.0).abs() < 1e-5, "strip {width}");
        let steps = format!("(tanh((x - 1.2345)/{width}) - tanh((x - 1.2345)/{width} - 1))/{width}");
        assert!((integral(&steps, 1.0) - 2.0).abs() < 1e-5, "steps {width}");
        let moving = format!("exp(-((x + t - 2.469)/{width})^2)/{width}");
        assert!((integral(&moving, 1.0) - 0.5 * PI.sqrt()).abs() < 1e-5, "moving {width}");
    }
}

#[test]
fn a_relay_that_slides_through_a_peak_keeps_its_energy() {
    for width in [1e-4, 1e-6] {
        let push = format!("-F + 0.5*exp(-((x - 1)/{width})^2)/{width}");
        let solution = solve(&json!({"problem": {"dvi": {
            "states": {"x": {"initial": 0, "rate": "v"}, "v": {"initial": 2, "rate": push}},
            "variables": {"F": {"inequality": "-v"}}, "set": [{"box": {"of": ["F"], "lower": -0.5, "upper": 0.5}}]}},
            "time": {"end": 1.2}}));
        assert_trusted(&solution);
        let (x, v) = (last(&solution, "x"), last(&solution, "v"));
        assert!((0.5 * v * v - (2.0 - 0.5 * x + 0.5 * PI.sqrt())).abs() < 1e-5, "{width}: {v} at {x}");
    }
}

/// A state with a ripple that is small compared with it, `x' = 1e-2 sin(33 t + 1) + 5e-4 sin(190 t + 2)` from `x = 40`:
/// steps over many periods change `x` little, and their error is that of the embedded formula, not of the full order.
#[test]
fn a_ripple_that_is_small_beside_its_state_keeps_the_tolerance() {
    let wave =
        |amplitude: f64, omega: f64, phase: f64, t: f64| amplitude * (phase.cos() - (omega * t + phase).cos()) / omega;
    let exact = |t: f64| 40.0 + wave(1e-2, 33.0, 1.0, t) + wave(5e-4, 190.0, 2.0, t);
    for stages in [3, 5, 7] {
        for rtol in [1e-6, 1e-8, 1e-10, 1e-12] {
            let times: Vec<f64> = (0..200).map(|k| 4.0 * f64::from(k) / 199.0).collect();
            let solution = solve(&json!({
                "problem": {"dvi": {"states": {
                    "x": {"initial": 40, "rate": "0.01*sin(33*t + 1) + 0.0005*sin(190*t + 2)"},
                }}},
                "time": {"end": 4}, "output": {"times": times},
                "method": {"rtol": rtol, "atol": 1e-3 * rtol, "stages": stages},
            }));
            // The run takes some 200 steps, each with an error of at most about twice the tolerance.
            let error = distance(&solution, "x", exact) / (40.0 * rtol);
            assert!(error < 400.0, "{stages} stages: {error:.0} times {rtol:e}");
        }
    }
}

/// Returns the zero of a monotonic function in `(from, to)`, by bisection.
fn zero(f: impl Fn(f64) -> f64, mut from: f64, mut to: f64) -> f64 {
    for _ in 0..200 {
        let middle = 0.5 * (from + to);
        *if (f(middle) > 0.0) == (f(from) > 0.0) { &mut from } else { &mut to } = middle;
    }
    0.5 * (from + to)
}

#[test]
fn a_surface_is_left_where_the_coefficient_of_its_variable_dips() {
    // For x' = 1/2 - k(t) s with s in Sgn x, x leaves zero when k falls to 1/2, and returns to zero when the integral
    // of its rate vanishes.
    for width in [3.0, 0.3, 0.03] {
        let k = |t: f64| 1.0 - 0.9 * (-((t - 50.0) / width).powi(2)).exp();
        let leaves = 50.0 - width * (-(0.5_f64 / 0.9).ln()).sqrt();
        let area = |end: f64| {
            let count = 20_000;
            let h = (end - leaves) / f64::from(count);
            (0..count).map(|i| h * (0.5 - k(leaves + (f64::from(i) + 0.5) * h))).sum::<f64>()
        };
        let returns = zero(area, 50.0, 50.0 + 4.0 * width);
        let solution = solve(&json!({"problem": {"dvi": {
            "states": {"x": {"initial": 0.5, "rate": format!("0.5 - (1 - 0.9*exp(-((t - 50)/{width})^2))*s")}},
            "variables": {"s": {"inequality": "-x"}}, "set": [{"box": {"of": ["s"], "lower": -1, "upper": 1}}]}},
            "time": {"end": 100}, "output": {"times": {"count": 201}}, "method": {"rtol": 1e-9}}));
        assert_trusted(&solution);
        let times: Vec<f64> = solution.trajectory.events.iter().map(|event| event.t).collect();
        let told = [1.0, leaves, returns];
        let off = times.iter().zip(told).map(|(t, told)| (t - told).abs()).fold(0.0, f64::max);
        assert!(times.len() == 3 && off < 1e-6 * width, "{width}: {times:?} for {told:?}");
    }
}

#[test]
fn bounds_that_move_are_seen_in_the_rates_of_what_they_hold() {
    // First x' = a with a at its upper bound, a pulse of width 0.1; then a block that slides over a narrow rough
    // patch, whose friction does the work 2/5.
    let pulse = solve(&json!({"problem": {"dvi": {"states": {"x": {"initial": 0, "rate": "a"}},
        "variables": {"a": {"inequality": "a - 2"}},
        "set": [{"box": {"of": ["a"], "lower": 0, "upper": "exp(-((t - 50)/0.1)^2)"}}]}},
        "time": {"end": 100}, "output": {"times": [0, 100]}, "method": {"rtol": 1e-9}}));
    assert_trusted(&pulse);
    assert!((last(&pulse, "x") - 0.1 * PI.sqrt()).abs() < 1e-8, "{}", last(&pulse, "x"));
    for width in [1.0, 0.1, 0.01] {
        let friction = format!("{}*exp(-((x - 73.13)/{width})^2)", 0.4 / (width * PI.sqrt()));
        let block = solve(&json!({"problem": {"dvi": {
            "states": {"x": {"initial": 0, "rate": "v"}, "v": {"initial": 1, "rate": "-F"}},
            "variables": {"F": {"inequality": "-v"}},
            "set": [{"box": {"of": ["F"], "lower": format!("-{friction}"), "upper": friction}}]}},
            "time": {"end": 150}, "output": {"times": [0, 150]}, "method": {"rtol": 1e-8}}));
        assert_trusted(&block);
        assert!((last(&block, "v") - 0.2_f64.sqrt()).abs() < 1e-6, "{width}: {}", last(&block, "v"));
    }
}

#[test]
fn a_bounded_variable_gives_no_impulse_to_a_reference_that_jumps_for_a_moment() {
    // For x' = -s with s in Sgn(x - r), x moves towards a pulse of r, whatever its height, at the speed one for the
    // width of the pulse, and then back.
    for (width, end) in [(1e-3, 40.0), (1e-2, 400.0)] {
        let solution = solve(&json!({"problem": {"dvi": {"states": {"x": {"initial": 0, "rate": "-s"}},
            "variables": {"s": {"inequality": format!("2*pulse(t, 33.3777, {width}) - x")}},
            "set": [{"box": {"of": ["s"], "lower": -1, "upper": 1}}]}}, "time": {"end": end},
            "output": {"times": [0, 33.3777 + 0.5 * width, 33.3777 + width, 33.3777 + 1.5 * width, end]}}));
        let x = &solution.trajectory.fields[0].values;
        let off = x.iter().zip([0.0, 0.5, 1.0, 0.5, 0.0]).map(|(x, told)| (x - told * width).abs()).fold(0.0, f64::max);
        assert!(off < 1e-8, "{width}: {x:?}");
    }
}

#[test]
fn what_a_state_passes_is_seen_by_variables_that_hidden_constraints_tell() {
    // Three problems in which a state p or x grows at the rate 1 through a narrow feature: a surge of width 0.01
    // opens a diode that short-circuits i; a wall of height 1 and width 0.1 lifts x for good; a Filippov system
    // leaves y = 0 only while its lower field points down.
    let surge = solve(&json!({"problem": {"dvi": {
        "states": {"p": {"initial": 0, "rate": "1"}, "i": {"initial": 0, "rate": "-1 + 3*exp(-((p - 731.3)/0.01)^2) - i + v"}},
        "variables": {"v": {"inequality": "i"}}, "set": [{"nonnegative": ["v"]}]}},
        "time": {"end": 1000}, "output": {"times": [0, 731.31, 1000]}, "method": {"rtol": 1e-9}}));
    assert_trusted(&surge);
    // The current i obeys i' = 3 exp(-(s/w)^2) - 1 - i from the time at which the surge exceeds one; since it is at
    // most 0.0213, its decay adds only a term of the order of the width.
    let (width, leaves) = (0.01_f64, -0.01 * 3.0_f64.ln().sqrt());
    let count = 20_000;
    let h = (0.01 - leaves) / f64::from(count);
    let i = (0..count).fold(0.0, |i: f64, k| {
        let rate = |s: f64, i: f64| 3.0 * (-(s / width).powi(2)).exp() - 1.0 - i;
        let s = leaves + f64::from(k) * h;
        let middle = i + 0.5 * h * rate(s, i);
        i + h * rate(s + 0.5 * h, middle)
    });
    let found = column(&surge, "i")[1];
    assert!((found - i).abs() < 1e-8 && last(&surge, "i").abs() < 1e-12, "{found} for {i}");

    let wall = solve(&json!({"problem": {"dvi": {
        "states": {"p": {"initial": 0, "rate": "1"}, "x": {"initial": 0.5, "rate": "z"}},
        "variables": {"z": {"inequality": "x - exp(-((p - 50)/0.1)^2)"}}, "set": [{"nonnegative": ["z"]}]}},
        "time": {"end": 100}, "output": {"times": [0, 49.95, 51, 100]}, "method": {"rtol": 1e-9}}));
    assert_trusted(&wall);
    let x = column(&wall, "x");
    let told = [0.5, (-0.25_f64).exp(), 1.0, 1.0];
    assert!(x.iter().zip(told).all(|(x, told)| (x - told).abs() < 1e-9), "{x:?}");

    let slide = solve(&json!({"problem": {"filippov": {"surface": "y", "states": {
        "x": {"initial": 0, "plus": "1", "minus": "1"},
        "y": {"initial": 0.5, "plus": "-1", "minus": "1 - 2*exp(-((x - 731.3)/0.01)^2)"}}}},
        "time": {"end": 1000}, "output": {"times": [0, 731.3, 1000]}, "method": {"rtol": 1e-6}}));
    assert_trusted(&slide);
    // Reference for the slide: the integral of 1 - 2 exp(-(x/w)^2) from the point at which it vanishes to the middle of
    // the Gaussian, y = s - 2 w sqrt(pi)/2 erf(s/w), s = w sqrt(ln 2).
    let (s, erf) = (2.0_f64.ln().sqrt(), 0.760_968_108_550_488_5);
    let told = 0.01 * (s - PI.sqrt() * erf);
    let y = column(&slide, "y");
    assert!((y[1] - told).abs() < 1e-8 && y[2].abs() < 1e-12, "{y:?} for {told}");
}

#[test]
fn a_sliding_variable_has_its_value_at_outputs_whatever_its_coefficient_does() {
    // The state of y' = -1 + s (2 + (t - 50)^2) rests at zero with s = 1/(2 + (t - 50)^2).
    let solution = solve(&json!({"problem": {"dvi": {
        "states": {"y": {"initial": 0.5, "rate": "-1 + s*(2 + (t - 50)^2)"}}, "variables": {"s": {"inequality": "y"}},
        "set": [{"box": {"of": ["s"], "lower": 0, "upper": 5}}]}},
        "time": {"end": 100}, "output": {"times": {"count": 201}}, "method": {"rtol": 1e-9}}));
    assert_trusted(&solution);
    let (t, s) = (&solution.trajectory.t, column(&solution, "s"));
    let off = t.iter().zip(s).filter(|(t, _)| **t > 1.0).map(|(t, s)| (s * (2.0 + (t - 50.0).powi(2)) - 1.0).abs());
    assert!(off.fold(0.0, f64::max) < 1e-9);
}

#[test]
fn a_pulse_of_a_free_variable_is_integrated_at_every_tolerance() {
    // For y' = z with z = exp(-(t - 50)^2), the tails of the pulse matter only in sum.
    for digits in 4..=11 {
        let solution = solve(&json!({"problem": {"dvi": {"states": {"y": {"initial": 0, "rate": "z"}},
            "variables": {"z": {"inequality": "z - exp(-(t - 50)^2)"}}, "set": [{"free": ["z"]}]}},
            "time": {"end": 100}, "output": {"times": [0, 50, 53, 100]}, "method": {"rtol": 10_f64.powi(-digits)}}));
        assert_trusted(&solution);
        let off = (last(&solution, "y") - PI.sqrt()).abs();
        assert!(off < 50.0 * 10_f64.powi(-digits), "rtol 1e-{digits}: {off:e}");
    }
}

#[test]
fn a_table_of_a_state_is_integrated_across_its_knots() {
    // The monotone cubic through (-2, 0), (-1, 0), (1, 1), (2, 1) is 0, 1/2 + 3x/4 - x^3/4 and 1: its second
    // derivative jumps at -1 and 1. For x = a sin t its integral is elementary over half a period, and half the
    // period over a whole one.
    for a in [1.2_f64, 1.5, 1.7, 1.9] {
        let c = (1.0 / a).asin();
        let (of_sine, of_cube) = (1.0 - c.cos(), 2.0 / 3.0 - c.cos() + c.cos().powi(3) / 3.0);
        let half = 2.0 * (0.5 * c + 0.75 * a * of_sine - 0.25 * a.powi(3) * of_cube + 0.5 * PI - c);
        for rtol in [1e-6, 1e-9, 1e-11] {
            let solution =
                solve(&json!({"problem": {"dvi": {"states": {"x": {"initial": 0, "rate": format!("{a}*cos(t)")},
                    "y": {"initial": 0, "rate": "f(x)"}},
                "tables": {"f": {"x": [-2, -1, 1, 2], "y": [0, 0, 1, 1], "interpolation": "pchip"}}}},
                "time": {"end": 7.0 * PI}, "method": {"rtol": rtol, "atol": 1e-2 * rtol}}));
            assert_trusted(&solution);
            let off = last(&solution, "y") - 3.0 * PI - half;
            assert!(off.abs() < 1000.0 * rtol, "{a} at {rtol:e}: {off:e}");
        }
    }
}
