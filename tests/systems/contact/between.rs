//! Events of mechanical systems within long steps and after very many impacts, at the default tolerances.

use crate::systems::harness::{column, last, solve};
use dvi::solution::{EventKind, Solution};
use serde_json::{Value, json};
use std::f64::consts::{PI, SQRT_2};

/// First time in seconds at which the force `1.1 sin(3 t)` reaches the friction bound one, so that the block slips.
const BREAKS: f64 = 0.380_365_553_547_824;

fn solved(problem: &Value, end: f64, output: &Value) -> Solution {
    solve(&json!({"problem": {"mechanical": problem}, "time": {"end": end}, "output": {"times": output}}))
}

fn times(solution: &Solution, kind: EventKind) -> Vec<f64> {
    solution.trajectory.events.iter().filter(|event| event.kind == kind).map(|event| event.t).collect()
}

fn assert_times(found: &[f64], expected: impl Fn(usize) -> f64, count: usize) {
    assert_eq!(found.len(), count, "{found:?}");
    for (k, t) in found.iter().enumerate() {
        assert!((t - expected(k)).abs() < 1e-6, "number {k} at {t}, not {}", expected(k));
    }
}

#[test]
fn a_slip_that_turns_on_a_slope_passes_its_least_speed_without_a_stop() {
    // Motion of a particle with friction on a slope of the angle a, with p the angle of its velocity from the line of
    // descent: v' = g (sin a cos p - mu cos a), v p' = -g sin a sin p. The quantity v sin p / tan(p/2)^k with k =
    // mu/tan a is conserved.
    let problem = json!({"parameters": {"g": 9.81, "a": "30*pi/180"},
        "coordinates": {"x": {"initial": 0, "velocity": 1}, "y": {"initial": 0, "velocity": -1}, "z": {"initial": 0}},
        "mass": [[1, 0, 0], [0, 1, 0], [0, 0, 1]], "potential": "g*cos(a)*z - g*sin(a)*y",
        "contacts": [{"name": "slope", "gap": "z", "friction": {"coefficient": 0.4, "slip": ["x_dot", "y_dot"]}}]});
    let solution = solved(&problem, 1.5, &json!({"count": 301}));
    assert!(solution.trajectory.events.is_empty(), "{:?}", solution.trajectory.events);
    let k = 0.4 / (PI / 6.0).tan();
    let speed = |p: f64| {
        let start = 0.75 * PI;
        SQRT_2 * ((p / 2.0).tan() / (start / 2.0).tan()).powf(k) * start.sin() / p.sin()
    };
    let mut least = f64::INFINITY;
    for (x, y) in column(&solution, "x_dot").iter().zip(column(&solution, "y_dot")) {
        let exact = speed(x.atan2(*y));
        assert!((x.hypot(*y) - exact).abs() < 1e-4, "{} is not {exact}", x.hypot(*y));
        least = least.min(x.hypot(*y));
    }
    assert!((least - 0.416_905_835_233_904).abs() < 1e-4, "{least}");
}

#[test]
fn a_block_that_is_pushed_to_and_fro_slips_whenever_the_force_is_more_than_friction() {
    let problem = json!({"coordinates": {"x": {"initial": 0}, "y": {"initial": 0}}, "mass": [[1, 0], [0, 1]],
        "potential": "10*y", "forces": {"x": "1.1*sin(3*t)"},
        "contacts": [{"name": "floor", "gap": "y", "friction": {"coefficient": 0.1, "slip": ["x_dot"]}}]});
    let solution = solved(&problem, 10.0, &json!([0, 10]));
    assert_times(&times(&solution, EventKind::Slip), |k| BREAKS + k as f64 * PI / 3.0, 10);
    // After the onset of slip at t_0, the block sticks again at the root t of 1.1/3 (cos 3 t_0 - cos 3 t) = t - t_0.
    assert_times(&times(&solution, EventKind::Stick), |k| 0.812_816_062_743_253 + k as f64 * PI / 3.0, 9);
}

#[test]
fn a_ball_that_is_pulled_up_and_down_leaves_the_floor_in_each_period() {
    let problem = json!({"coordinates": {"y": {"initial": 0}}, "mass": [[1]], "potential": "9.81*y",
        "forces": {"y": "1.1*9.81*sin(3*t)"}, "contacts": [{"name": "floor", "gap": "y", "restitution": 0.5}]});
    let solution = solved(&problem, 10.0, &json!({"every": 0.05}));
    assert_times(&times(&solution, EventKind::LiftOff), |k| BREAKS + k as f64 * 2.0 * PI / 3.0, 5);
    assert!(column(&solution, "floor_gap").iter().all(|gap| *gap > -1e-7));
}

#[test]
fn a_ball_meets_an_obstacle_that_it_would_fly_past_in_a_thirtieth_of_a_second() {
    let problem = json!({"coordinates": {"x": {"initial": -3, "velocity": 3}, "y": {"initial": 1, "velocity": 4.9}},
        "mass": [[1, 0], [0, 1]], "potential": "9.81*y",
        "contacts": [{"name": "tower", "gap": "y - 2.2*exp(-(x/0.1)^2)", "restitution": 0.8}]});
    let solution = solved(&problem, 1.5, &json!([0, 1.5]));
    let impacts = times(&solution, EventKind::Impact);
    assert!((impacts[0] - 0.972_708_091_387_335).abs() < 1e-7, "{impacts:?}");
}

#[test]
fn a_ball_on_a_shaking_table_rests_between_its_flights_and_never_falls_through() {
    // The ball detaches when the table accelerates downwards with g, at 1.1 sin(w t) = 1, and its rebounds end within
    // one period.
    let problem = json!({"parameters": {"g": 9.81, "w": 30, "A": "1.1*g/w^2"},
        "coordinates": {"y": {"initial": 0, "velocity": "A*w"}}, "mass": [[1]], "potential": "g*y",
        "contacts": [{"name": "table", "gap": "y - A*sin(w*t)", "restitution": 0.2}]});
    let solution = solved(&problem, 1.0, &json!({"every": 0.001}));
    let period = 2.0 * PI / 30.0;
    assert_times(&times(&solution, EventKind::LiftOff), |k| BREAKS / 10.0 + k as f64 * period, 5);
    let impacts = times(&solution, EventKind::Impact);
    for k in 0..4 {
        let first = 0.096_074_917_164_925 + f64::from(k) * period;
        assert!(impacts.iter().any(|t| (t - first).abs() < 1e-6), "no impact at {first}: {impacts:?}");
    }
    assert!(column(&solution, "table_gap").iter().all(|gap| *gap > -1e-7));
}

#[test]
fn a_ball_stays_on_a_curved_floor_after_impacts_without_number() {
    let problem = json!({"coordinates": {"x": {"initial": 1, "velocity": 0.3}, "y": {"initial": 1.5}},
        "mass": [[1, 0], [0, 1]], "potential": "9.81*y",
        "contacts": [{"name": "floor", "gap": "y - 0.2*sin(3*x)", "restitution": 0.5}]});
    let solution = solved(&problem, 6.0, &json!({"every": 0.02}));
    assert!(column(&solution, "floor_gap").iter().all(|gap| *gap > -1e-6));
    let energies = column(&solution, "kinetic_energy").iter().zip(column(&solution, "potential_energy"));
    let energies: Vec<f64> = energies.map(|(kinetic, potential)| kinetic + potential).collect();
    assert!(energies.windows(2).all(|pair| pair[1] < pair[0] + 1e-4), "{energies:?}");
}

#[test]
fn a_heavy_ball_on_a_light_one_comes_to_rest_with_both_their_weights_on_the_floor() {
    for (mass, law) in [(100.0, "simultaneous"), (100.0, "sequential"), (0.01, "simultaneous"), (0.01, "sequential")] {
        let problem = json!({"parameters": {"m": mass}, "coordinates": {"a": {"initial": 0.5}, "b": {"initial": 1}},
            "mass": [[1, 0], [0, "m"]], "potential": "9.81*(a + m*b)",
            "contacts": [{"name": "floor", "gap": "a", "restitution": 0.5},
                         {"name": "balls", "gap": "b - a - 0.1", "restitution": 0.5}]});
        let solution = solve(&json!({"problem": {"mechanical": problem}, "time": {"end": 6},
            "method": {"impact_law": law}, "output": {"times": [0, 6]}}));
        assert!(last(&solution, "a").abs() < 1e-9 && (last(&solution, "b") - 0.1).abs() < 1e-9, "{mass} {law}");
        // Over a run between two states of rest, the impulse of the floor on the body balances that of gravity.
        let carried = last(&solution, "floor_impulse") / ((1.0 + mass) * 9.81 * 6.0);
        assert!((carried - 1.0).abs() < 1e-6, "{mass} {law}: {carried}");
    }
}

#[test]
fn what_a_floor_has_carried_is_known_though_nothing_moves_within_long_steps() {
    let problem = json!({"coordinates": {"x": {"initial": 0}, "y": {"initial": 0}}, "mass": [[1, 0], [0, 1]],
        "potential": "10*y", "forces": {"x": "0.4*sin(8*pi*t)", "y": "5*sin(3*t)"},
        "contacts": [{"name": "floor", "gap": "y", "friction": {"coefficient": 0.1, "slip": ["x_dot"]}}]});
    let solution = solved(&problem, 10.0, &json!({"every": 0.1}));
    assert!(solution.diagnostics.steps.accepted < 50, "{:?}", solution.diagnostics.steps);
    for (t, carried) in solution.trajectory.t.iter().zip(column(&solution, "floor_impulse")) {
        let exact = 10.0 * t - 5.0 / 3.0 * (1.0 - (3.0 * t).cos());
        assert!((carried - exact).abs() < 1e-6, "{carried} and not {exact} at {t}");
    }
}

#[test]
fn a_push_whose_period_divides_the_horizon_is_seen() {
    // The output times 0 and 10, and all points t = 0, 1.25, .. 10 between them, are zeros of the force, which first
    // reaches the friction bound at asin(10/11)/(8 pi).
    let problem = json!({"coordinates": {"x": {"initial": 0}, "y": {"initial": 0}}, "mass": [[1, 0], [0, 1]],
        "potential": "10*y", "forces": {"x": "1.1*sin(8*pi*t)"},
        "contacts": [{"name": "floor", "gap": "y", "friction": {"coefficient": 0.1, "slip": ["x_dot"]}}]});
    let solution = solved(&problem, 10.0, &json!([0, 10]));
    assert_times(&times(&solution, EventKind::Slip), |k| (10.0_f64 / 11.0).asin() / (8.0 * PI) + k as f64 / 8.0, 80);
}

#[test]
fn a_slip_in_space_begins_once_and_follows_the_force_that_turns() {
    // The force (3 t, 1) reaches the friction bound mu m g = 3.924. The motion that follows is compared with a
    // fifth-order Radau run of an independent program, in polar coordinates of the velocity: v' = F.e - mu m g, v
    // phi' = F.n.
    let problem = json!({"coordinates": {"x": {"initial": 0}, "y": {"initial": 0}, "z": {"initial": 0}},
        "mass": [[1, 0, 0], [0, 1, 0], [0, 0, 1]], "potential": "9.81*z", "forces": {"x": "3*t", "y": "1"},
        "contacts": [{"name": "plane", "gap": "z", "friction": {"coefficient": 0.4, "slip": ["x_dot", "y_dot"]}}]});
    let exact = [
        ("x", 0.190_017_093_328_9),
        ("y", 0.036_410_056_347_3),
        ("x_dot", 0.778_997_013_549_5),
        ("y_dot", 0.137_091_681_802_5),
    ];
    for (rtol, bound) in [(1e-6, 1e-7), (1e-10, 1e-11)] {
        let solution = solve(&json!({"problem": {"mechanical": problem}, "time": {"end": 2}, "method": {"rtol": rtol},
            "output": {"times": [0, 2]}}));
        assert_times(&times(&solution, EventKind::Slip), |_| (3.924_f64 * 3.924 - 1.0).sqrt() / 3.0, 1);
        assert_eq!(solution.trajectory.events.len(), 1, "{:?}", solution.trajectory.events);
        for (name, exact) in exact {
            assert!((last(&solution, name) - exact).abs() < bound, "{rtol} {name}: {}", last(&solution, name));
        }
    }
}

#[test]
fn a_burst_of_force_between_the_points_of_a_step_is_seen() {
    // The exact impulse of the force exp(-((t - 5)/w)^2) on the wall is w sqrt(pi), for any end time.
    for (width, end) in [(0.02, 10.0), (1e-3, 10.0), (0.02, 1000.0)] {
        let problem = json!({"coordinates": {"x": {"initial": 0}}, "mass": [[1]],
            "forces": {"x": format!("exp(-((t - 5)/{width})^2)")}, "contacts": [{"name": "wall", "gap": "x + 1"}]});
        let solution = solved(&problem, end, &json!([0, end]));
        let (found, exact) = (last(&solution, "x_dot"), width * PI.sqrt());
        assert!((found - exact).abs() < 1e-5 * exact, "{width} {end}: {found}, not {exact}");
    }
}

#[test]
fn a_pulse_of_force_lifts_a_body_at_rest_at_its_time() {
    // A force of 100 N acts for 0.02 s against a weight of 9.81 N: the impulse of the floor is that of the weight,
    // minus 2 N s.
    let problem = json!({"coordinates": {"y": {"initial": 0}}, "mass": [[1]], "potential": "9.81*y",
        "forces": {"y": "100*(heaviside(t - 37.3) - heaviside(t - 37.32))"}, "contacts": [{"name": "floor", "gap": "y"}]});
    let solution = solved(&problem, 100.0, &json!([0, 100]));
    let lifts = times(&solution, EventKind::LiftOff);
    assert!(lifts.len() == 1 && (lifts[0] - 37.3).abs() < 1e-9, "{lifts:?}");
    let carried = last(&solution, "floor_impulse");
    assert!((carried - 979.0).abs() < 1e-6, "{carried}");
}
