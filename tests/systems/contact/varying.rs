//! Friction coefficients that vary with the position, the time, and the speed and direction of the slip, compared
//! with closed forms and an independent integration.

use super::{located, stepped};
use crate::systems::harness::{column, distance, events, last, solve};
use dvi::solution::{CheckCode, EventKind, Solution};
use serde_json::{Value, json};

const G: f64 = 9.81;

/// A mechanical problem: a unit mass on a floor, with the given friction coefficient and initial velocity.
fn on_floor(coefficient: Value, velocity: f64) -> Value {
    json!({"coordinates": {"x": {"initial": 0, "velocity": velocity}, "y": {"initial": 0}}, "mass": [[1, 0], [0, 1]],
           "potential": "9.81*y",
           "contacts": [{"name": "floor", "gap": "y", "friction": {"coefficient": coefficient, "slip": ["x_dot"]}}]})
}

fn assert_trusted(solution: &Solution) {
    assert!(solution.verdict.trusted, "{:?}", solution.verdict);
}

/// Asserts that the verdict of a time-stepped run estimates at least half of its `error` and finds no other fault;
/// returns the error.
fn assert_error_is_told(solution: &Solution, error: f64) -> f64 {
    let largest = column(solution, "x").iter().fold(0.0_f64, |most, x| most.max(x.abs()));
    let (told, _) = solution.diagnostics.checks.get(CheckCode::LocalError).expect("an estimate of the error");
    assert!(told >= 0.5 * error / largest, "{error:e} of {largest}, told {told:e}");
    let others = solution.verdict.because.iter().filter(|reason| reason.code != CheckCode::LocalError);
    assert_eq!(others.count(), 0, "{:?}", solution.verdict);
    error
}

/// With the friction coefficient `mu = mu_0 (1 + x)` the sliding block obeys `x'' = -g mu_0 (1 + x)`, an oscillation
/// about -1, until its first stop.
#[test]
fn a_floor_that_grows_rougher_stops_a_block_as_a_spring_would() {
    let (mu, v) = (0.2_f64, 3.0);
    let w = (G * mu).sqrt();
    let stop = (v / w).atan() / w;
    let exact = |t: f64| (w * t.min(stop)).cos() + v / w * (w * t.min(stop)).sin() - 1.0;
    let solution = located(on_floor(json!("0.2*(1 + x)"), v), 3.0);
    assert_trusted(&solution);
    let error = distance(&solution, "x", exact);
    assert!(error < 1e-8, "{error:e}");
    assert!((events(&solution, "floor").last().unwrap() - stop).abs() < 1e-8);
    assert!((last(&solution, "dissipated_by_friction") - 0.5 * v * v).abs() < 1e-8);
    let errors = [2e-3, 1e-3].map(|h| {
        let solution = stepped(on_floor(json!("0.2*(1 + x)"), v), 3.0, h);
        assert_error_is_told(&solution, (last(&solution, "x") - exact(3.0)).abs())
    });
    assert!(errors[1] < 0.02 && errors[1] < 0.6 * errors[0], "{errors:?}");
}

#[test]
fn a_block_slides_over_the_edge_of_a_patch() {
    // With the friction coefficient mu_1 up to x = 1 and mu_2 beyond, the speed at x = 1 is v_1 with v_1^2 = v_0^2 -
    // 2 g mu_1, and the block slides on by v_1^2/(2 g mu_2).
    let (v, first, second) = (4.0_f64, 0.1, 0.7);
    let there = (v * v - 2.0 * G * first).sqrt();
    let way = 1.0 + there * there / (2.0 * G * second);
    let time = (v - there) / (G * first) + there / (G * second);
    for coefficient in ["0.1 + 0.6*heaviside(x - 1)", "0.4 + 0.3*sign(x - 1)"] {
        let solution = located(on_floor(json!(coefficient), v), 2.0);
        assert!((last(&solution, "x") - way).abs() < 1e-7, "{} for {way}", last(&solution, "x"));
        assert!((events(&solution, "floor").last().unwrap() - time).abs() < 1e-7);
        let solution = stepped(on_floor(json!(coefficient), v), 2.0, 1e-3);
        assert!((last(&solution, "x") - way).abs() < 5e-3, "{} for {way}", last(&solution, "x"));
    }
    // A long step must not skip a patch of ice on the floor that is narrow compared with it.
    let solution = located(on_floor(json!("0.3 - 0.3*exp(-((x - 0.7)/0.001)^2)"), 3.0), 2.0);
    let ice = 0.001 * std::f64::consts::PI.sqrt();
    let way = 9.0 / (2.0 * G * 0.3) + ice;
    assert!((last(&solution, "x") - way).abs() < 1e-7, "{} for {way}", last(&solution, "x"));
}

#[test]
fn friction_that_fades_lets_a_block_go_at_its_time() {
    // On a slope of the gradient 0.3 the block begins to slide when mu = 0.5 - 0.1 t has fallen to 0.3.
    let slope = json!({"coordinates": {"x": {"initial": 0}, "y": {"initial": 0}}, "mass": [[2, 0], [0, 2]],
        "potential": "2*9.81*(y - 0.3*x)",
        "contacts": [{"name": "floor", "gap": "y", "friction": {"coefficient": "0.5 - 0.1*t", "slip": ["x_dot"]}}]});
    let exact = |t: f64| G * 0.1 * (t - 2.0_f64).max(0.0).powi(3) / 6.0;
    let solution = located(slope.clone(), 4.0);
    assert_trusted(&solution);
    assert!((events(&solution, "floor")[0] - 2.0).abs() < 1e-9, "{:?}", events(&solution, "floor"));
    assert!(distance(&solution, "x", exact) < 1e-9);
    let solution = stepped(slope, 4.0, 1e-3);
    assert!(distance(&solution, "x", exact) < 5e-3);
    // Friction vanishes for an instant, between all stage points of a step during which the block is at rest.
    let pulse = on_floor(json!("0.5 - 0.5*exp(-((t - 5)/0.01)^2)"), 0.0);
    let mut pushed = pulse;
    pushed["forces"] = json!({"x": 0.981});
    let solution = located(pushed, 10.0);
    assert!(last(&solution, "x") > 1e-5, "the block sleeps through the ice");
    assert_eq!(last(&solution, "x_dot"), 0.0);
}

/// With the Stribeck law `mu = m + d exp(-v/w)` a block of the initial speed `v_0` stops after `w/(m g) ln((m
/// exp(v_0/w) + d)/(m + d))`.
#[test]
fn stribecks_law_stops_a_block_when_its_integral_says() {
    let (m, d, w, v) = (0.2_f64, 0.15_f64, 0.1_f64, 1.0_f64);
    let stop = w / (m * G) * ((m * (v / w).exp() + d) / (m + d)).ln();
    let solution = located(on_floor(json!("0.2 + 0.15*exp(-slip_speed/0.1)"), v), 1.0);
    assert_trusted(&solution);
    assert!((events(&solution, "floor").last().unwrap() - stop).abs() < 1e-9);
    // The Stribeck law with the slip speed written as an absolute velocity, and with a slip in the opposite
    // direction.
    for (coefficient, v) in [("0.2 + 0.15*exp(-abs(x_dot)/0.1)", 1.0), ("0.2 + 0.15*exp(-slip_speed/0.1)", -1.0)] {
        let solution = located(on_floor(json!(coefficient), v), 1.0);
        assert!((events(&solution, "floor").last().unwrap() - stop).abs() < 1e-8, "{coefficient}");
    }
    let errors = [4e-4, 2e-4].map(|h| {
        let solution = stepped(on_floor(json!("0.2 + 0.15*exp(-slip_speed/0.1)"), v), 1.0, h);
        assert_trusted(&solution);
        // The distance that the block slides until its stop, by a quadrature of v^2/(g (m v + d v exp(-v/w))).
        let n = 200_000;
        let way: f64 =
            (0..n).map(|i| (i as f64 + 0.5) / n as f64 * v).map(|v| v / (G * (m + d * (-v / w).exp()))).sum::<f64>()
                * v
                / n as f64;
        (last(&solution, "x") - way).abs()
    });
    assert!(errors[1] < 1e-3 && errors[1] < 0.6 * errors[0], "{errors:?}");
}

/// Friction coefficient that weakens with the slip speed `s`: `mu(s) = 0.3/(1 + 4 s) + 0.1`.
fn weakening(s: f64) -> f64 {
    0.3 / (1.0 + 4.0 * s) + 0.1
}

/// Integrates a unit mass on a spring (`k = 10`) and a belt of speed 0.2 from rest by the classical Runge-Kutta
/// method, with the end of each phase found by bisection. Returns the times of stick-slip transitions, and the
/// position and velocity at the end.
fn on_belt(end: f64, step: f64) -> (Vec<f64>, [f64; 2]) {
    let (belt, k) = (0.2, 10.0);
    let (mut t, mut x, mut v) = (0.0_f64, 0.0_f64, 0.0_f64);
    let mut times = Vec::new();
    let mut sticks = false;
    let rate = |x: f64, v: f64| -k * x + weakening(belt - v) * G;
    let advance = |x: f64, v: f64, h: f64| {
        let (k1, l1) = (v, rate(x, v));
        let (k2, l2) = (v + 0.5 * h * l1, rate(x + 0.5 * h * k1, v + 0.5 * h * l1));
        let (k3, l3) = (v + 0.5 * h * l2, rate(x + 0.5 * h * k2, v + 0.5 * h * l2));
        let (k4, l4) = (v + h * l3, rate(x + h * k3, v + h * l3));
        (x + h / 6.0 * (k1 + 2.0 * k2 + 2.0 * k3 + k4), v + h / 6.0 * (l1 + 2.0 * l2 + 2.0 * l3 + l4))
    };
    while t < end {
        if sticks {
            let slips = t + (weakening(0.0) * G / k - x) / belt;
            let until = slips.min(end);
            (x, t, v) = (x + belt * (until - t), until, belt);
            if slips < end {
                times.push(slips);
                sticks = false;
                // At the onset of slip the slip velocity is zero; a perturbation of 1e-12 starts the motion relative
                // to the belt.
                (x, v) = advance(x, v - 1e-12, step);
                t += step;
            }
            continue;
        }
        let h = step.min(end - t);
        let (next_x, next_v) = advance(x, v, h);
        if next_v <= belt {
            (x, v, t) = (next_x, next_v, t + h);
            continue;
        }
        let (mut short, mut long) = (0.0, h);
        for _ in 0..60 {
            let middle = 0.5 * (short + long);
            if advance(x, v, middle).1 > belt { long = middle } else { short = middle }
        }
        (x, t, v, sticks) = (advance(x, v, long).0, t + long, belt, true);
        times.push(t);
    }
    (times, [x, v])
}

/// Solves a mechanical problem with located impacts, and with an absolute tolerance of velocities above the rounding
/// error of the belt's velocity.
fn on_belt_located(problem: Value, end: f64) -> Solution {
    solve(&json!({"problem": {"mechanical": problem}, "time": {"end": end},
                  "method": {"impacts": "locate", "rtol": 1e-10, "atol": 1e-12}}))
}

#[test]
fn a_block_on_a_belt_sticks_and_slips_as_an_independent_integration_has_it() {
    let end = 12.0;
    let (times, [x, v]) = on_belt(end, 1e-5);
    assert!(times.len() > 6, "{times:?}");
    let belt = |coefficient: &str| {
        json!({"parameters": {"ms": 0.3, "k": 10, "belt": 0.2},
               "coordinates": {"x": {"initial": 0}, "y": {"initial": 0}}, "mass": [[1, 0], [0, 1]],
               "potential": "9.81*y + k*x^2/2",
               "contacts": [{"name": "belt", "gap": "y",
                             "friction": {"coefficient": coefficient, "slip": ["x_dot - belt"]}}]})
    };
    let solution = on_belt_located(belt("ms/(1 + 4*slip_speed) + 0.1"), end);
    assert_trusted(&solution);
    let found = events(&solution, "belt");
    assert_eq!(found.len(), times.len(), "{found:?} for {times:?}");
    for (found, exact) in found.iter().zip(&times) {
        assert!((found - exact).abs() < 1e-6, "{found} for {exact}");
    }
    assert!((last(&solution, "x") - x).abs() < 1e-6 && (last(&solution, "x_dot") - v).abs() < 1e-6);
    let errors = [4e-4, 2e-4].map(|h| {
        let solution = stepped(belt("ms/(1 + 4*slip_speed) + 0.1"), end, h);
        assert_error_is_told(&solution, (last(&solution, "x") - x).abs())
    });
    assert!(errors[1] < 5e-3, "{errors:?}");
}

/// The friction coefficient of an impact is that of the slip speed after it: with `J = (1 + e) |v_n|` and `mu =
/// m/(1 + s)`, the slip speed becomes `s+ = s - m J/(1 + s+)`.
#[test]
fn an_impact_takes_the_friction_of_the_slip_that_it_leaves() {
    let (m, e, s, normal) = (0.4_f64, 0.5_f64, 3.0_f64, 2.0_f64);
    let given = m * (1.0 + e) * normal;
    let after = 0.5 * ((s - 1.0) + ((s - 1.0) * (s - 1.0) + 4.0 * (s - given)).sqrt());
    let ball = |velocity: f64| {
        json!({"coordinates": {"x": {"initial": 0, "velocity": velocity}, "y": {"initial": 0.2, "velocity": -2}},
               "mass": [[1, 0], [0, 1]],
               "contacts": [{"name": "floor", "gap": "y", "restitution": 0.5,
                             "friction": {"coefficient": "0.4/(1 + slip_speed)", "slip": ["x_dot"]}}]})
    };
    for velocity in [s, -s] {
        for solution in [located(ball(velocity), 0.5), stepped(ball(velocity), 0.5, 1e-2)] {
            let left = last(&solution, "x_dot");
            assert!((left - velocity.signum() * after).abs() < 1e-9, "{left} for {after}");
            assert!((last(&solution, "y_dot") - 1.0).abs() < 1e-12);
        }
    }
    // At a low tangential velocity the ball sticks to the floor in the impact.
    for solution in [located(ball(0.5), 0.5), stepped(ball(0.5), 0.5, 1e-2)] {
        assert!(last(&solution, "x_dot").abs() < 1e-12);
    }
}

/// A mechanical problem: a unit mass on a floor with elliptic friction, whose semi-axis along `y` is `ratio` times that
/// along `x`.
fn on_ellipse(velocity: [f64; 2], force: [f64; 2], ratio: f64) -> Value {
    json!({"coordinates": {"x": {"initial": 0, "velocity": velocity[0]}, "y": {"initial": 0, "velocity": velocity[1]},
                           "z": {"initial": 0}},
           "mass": [[1, 0, 0], [0, 1, 0], [0, 0, 1]], "potential": "9.81*z", "forces": {"x": force[0], "y": force[1]},
           "contacts": [{"name": "floor", "gap": "z",
                         "friction": {"coefficient": 0.3, "ratio": ratio, "slip": ["x_dot", "y_dot"]}}]})
}

/// By maximal dissipation in an ellipse with the ratio `r` of its semi-axes, `x'' / x' = r^2 y'' / y'`: the velocity
/// along `y` is proportional to a power of that along `x` with the exponent `r^2`.
#[test]
fn friction_in_an_ellipse_turns_a_slip_by_a_power_law() {
    let (ratio, u, v) = (0.5_f64, 1.5_f64, 1.0_f64);
    let solution = located(on_ellipse([u, v], [0.0, 0.0], ratio), 1.5);
    assert_trusted(&solution);
    let pairs = column(&solution, "x_dot").iter().zip(column(&solution, "y_dot"));
    let mut seen = 0;
    for (x, y) in pairs.filter(|(x, _)| **x > 0.05) {
        seen += 1;
        assert!((y / v - (x / u).powf(ratio * ratio)).abs() < 1e-7, "{x} {y}");
    }
    assert!(seen > 10);
    // Friction dissipates all the kinetic energy of the mass, and its impulses are the changes of the momenta.
    assert!((last(&solution, "dissipated_by_friction") - 0.5 * (u * u + v * v)).abs() < 1e-8);
    assert!((last(&solution, "floor_friction_1") + u).abs() < 1e-8);
    assert!((last(&solution, "floor_friction_2") + v).abs() < 1e-8);
    let stepped = stepped(on_ellipse([u, v], [0.0, 0.0], ratio), 1.5, 1e-4);
    assert!((last(&stepped, "x") - last(&solution, "x")).abs() < 1e-3);
    assert!((last(&stepped, "y") - last(&solution, "y")).abs() < 1e-3);
}

#[test]
fn a_push_is_held_within_the_ellipse_and_no_further() {
    let (mu, ratio) = (0.3, 0.5);
    for degrees in [0.0_f64, 20.0, 45.0, 70.0, 90.0] {
        let (sine, cosine) = degrees.to_radians().sin_cos();
        let most = mu * G / (cosine * cosine + sine * sine / (ratio * ratio)).sqrt();
        for (part, holds) in [(0.999, true), (1.001, false)] {
            let force = [part * most * cosine, part * most * sine];
            for solution in [
                located(on_ellipse([0.0, 0.0], force, ratio), 1.0),
                stepped(on_ellipse([0.0, 0.0], force, ratio), 1.0, 1e-2),
            ] {
                let moved = last(&solution, "x").hypot(last(&solution, "y"));
                assert_eq!(moved < 1e-9, holds, "{degrees} degrees, {part}: {moved:e}");
            }
        }
    }
}

#[test]
fn parameters_of_a_coefficient_are_bound_without_compiling_anew() {
    let document = |m: f64| {
        let mut problem = on_floor(json!("m + 0.1*exp(-slip_speed)"), 2.0);
        problem["parameters"] = json!({"m": m});
        json!({"problem": {"mechanical": problem}, "time": {"end": 1},
               "sweep": {"over": {"m": [0.2, 0.35]}, "collect": {"way": {"final": "x"}}}})
    };
    let specification =
        dvi::specification::Specification::from_json(document(0.1).to_string().as_bytes()).expect("a specification");
    let table = dvi::solve(&specification, &dvi::problem::Control::new()).table.expect("a table");
    let ways = table.column("way").expect("a column");
    for (row, m) in [0.2, 0.35].into_iter().enumerate() {
        let mut problem = on_floor(json!("m + 0.1*exp(-slip_speed)"), 2.0);
        problem["parameters"] = json!({"m": m});
        let alone = solve(&json!({"problem": {"mechanical": problem}, "time": {"end": 1}}));
        assert_eq!(ways.number(row), Some(last(&alone, "x")));
    }
}

#[test]
fn a_coefficient_that_becomes_negative_is_an_error() {
    for method in [json!({"impacts": "locate"}), json!({"step": 1e-2})] {
        let document =
            json!({"problem": {"mechanical": on_floor(json!("0.3 - x"), 5.0)}, "time": {"end": 1}, "method": method});
        let specification =
            dvi::specification::Specification::from_json(document.to_string().as_bytes()).expect("a specification");
        let solution = dvi::solve(&specification, &dvi::problem::Control::new());
        let error = solution.error.expect("an error");
        assert_eq!(error.code, "friction_negative", "{error:?}");
        assert!(error.message.contains("`floor`"), "{}", error.message);
    }
}

#[test]
fn events_of_a_belt_are_stick_and_slip_in_turn() {
    let problem = json!({"coordinates": {"x": {"initial": 0}, "y": {"initial": 0}}, "mass": [[1, 0], [0, 1]],
        "potential": "9.81*y + 5*x^2",
        "contacts": [{"name": "belt", "gap": "y",
                      "friction": {"coefficient": "0.1 + 0.3*exp(-slip_speed/0.1)", "slip": ["x_dot - 0.2"]}}]});
    let solution = on_belt_located(problem, 12.0);
    let kinds: Vec<EventKind> = solution.trajectory.events.iter().map(|event| event.kind).collect();
    assert!(kinds.len() > 5, "{kinds:?}");
    assert!(kinds.windows(2).all(|pair| pair[0] != pair[1]), "{kinds:?}");
}

fn on_a_belt(belt: &str, end: f64, count: u32) -> Value {
    json!({
        "problem": {"mechanical": {
            "coordinates": {"x": {"initial": 0}, "y": {"initial": 0}}, "mass": [[1, 0], [0, 1]], "potential": "10*y",
            "contacts": [{"name": "F", "gap": "y", "friction": {"coefficient": 0.2, "slip": [format!("x_dot - {belt}")]}}],
            "tables": {"ramp": {"x": [0, 1, 2, 9], "y": [0, 0, 4, 4], "interpolation": "linear"}}
        }},
        "time": {"end": end}, "output": {"times": {"count": count}}
    })
}

/// A belt that starts and stops instantaneously leaves a block behind, since friction is bounded: the block slips
/// until it has the velocity of the belt.
#[test]
fn a_belt_whose_speed_jumps_does_not_take_a_block_along_at_once() {
    let solution = solve(&on_a_belt("pulse(t, 1, 2)", 6.0, 61));
    let exact = |t: f64| match t {
        t if t < 1.0 => 0.0,
        t if t < 1.5 => (t - 1.0).powi(2),
        t if t < 3.0 => 0.25 + (t - 1.5),
        t => 2.0 - (3.5 - t.min(3.5)).powi(2),
    };
    let error = distance(&solution, "x", exact);
    assert!(error < 1e-9, "off by {error:e}");
    assert!(solution.verdict.trusted, "{:?}", solution.verdict);
    let kinds: Vec<(f64, EventKind)> = solution.trajectory.events.iter().map(|event| (event.t, event.kind)).collect();
    let expected = [(1.0, EventKind::Slip), (1.5, EventKind::Stick), (3.0, EventKind::Slip), (3.5, EventKind::Stick)];
    assert!(
        kinds.len() == 4 && kinds.iter().zip(expected).all(|(a, b)| a.1 == b.1 && (a.0 - b.0).abs() < 1e-9),
        "{kinds:?}"
    );
}

/// The speed of the belt has a corner at t = 1, after which the belt accelerates by 4, twice what friction can
/// transmit.
#[test]
fn a_belt_that_begins_to_run_faster_than_friction_moves_a_block_from_its_corner_on() {
    let solution = solve(&on_a_belt("ramp(t)", 6.0, 61));
    // The block, accelerated by friction, reaches the speed of the belt at t = 3.
    let exact = |t: f64| if t < 3.0 { (t - 1.0).max(0.0).powi(2) } else { 4.0 + 4.0 * (t - 3.0) };
    let error = distance(&solution, "x", exact);
    assert!(error < 1e-8, "off by {error:e}");
    assert!(solution.verdict.trusted, "{:?}", solution.verdict);
}

/// A belt that runs forwards for one second and backwards for another: the block slips all the time, and friction
/// reverses with the slip.
#[test]
fn friction_turns_where_the_belt_turns() {
    let solution = solve(&on_a_belt("if(t < 1, 3, -3)", 2.0, 21));
    let error = distance(&solution, "x", |t| if t < 1.0 { t * t } else { 1.0 + 2.0 * (t - 1.0) - (t - 1.0).powi(2) });
    assert!(error < 1e-9, "off by {error:e}");
    assert!(solution.verdict.trusted, "{:?}", solution.verdict);
}
