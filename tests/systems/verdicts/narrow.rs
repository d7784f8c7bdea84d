//! Verdicts of time stepping with data that are narrower than a step, in time or in space: friction coefficients,
//! forces, and gaps. References are closed forms, or integrations with far shorter steps.

use super::solve;
use crate::systems::harness::{distance, last};
use serde_json::{Value, json};

const G: f64 = 9.81;

/// Permitted relative errors of trusted answers: two digits for rigid bodies, three for generalised coordinates.
const PERMITTED: [f64; 2] = [1e-2, 1e-3];

/// Returns the distance that a point slides up to the time `end`, from the velocity `v`, with the friction
/// coefficient `mu(t, x)`.
fn slid(mu: &dyn Fn(f64, f64) -> f64, v: f64, end: f64) -> f64 {
    let (count, mut x, mut v) = (400_000, 0.0, v);
    let h = end / f64::from(count);
    for k in 0..count {
        // Integrates the motion of the sliding point by the midpoint rule.
        let t = (f64::from(k) + 0.5) * h;
        let middle = v - 0.5 * h * G * mu(t - 0.5 * h, x);
        let next = v - h * G * mu(t, x + 0.5 * h * v);
        if next <= 0.0 {
            break;
        }
        x += h * middle;
        v = next;
    }
    x
}

/// Specification of a sliding point in generalised coordinates, with the given friction coefficient.
fn point(friction: &str, v: f64, [end, count]: [f64; 2]) -> Value {
    json!({"problem": {"mechanical": {"coordinates": {"x": {"initial": 0, "velocity": v}, "y": {"initial": 0}}, "mass": [[1, 0], [0, 1]],
        "forces": {"y": -G}, "contacts": [{"name": "c", "gap": "y", "friction": {"coefficient": friction, "slip": ["x_dot"]}}]}},
        "time": {"end": end}, "method": {"step": end / count, "impacts": "time_stepping"}, "output": {"times": [end], "fields": ["x"]}})
}

/// Specification of a flat box that slides, as a rigid body, with the given friction coefficient.
fn slider(friction: &str, v: f64, [end, count]: [f64; 2], impacts: &str) -> Value {
    let bodies = json!([{"name": "ground", "shape": {"half_space": {"normal": [0, 0, 1]}}, "fixed": true},
        {"name": "b", "shape": {"box": {"size": [0.4, 0.4, 0.002]}}, "mass": 2, "position": [0, 0, 0.001], "velocity": [v, 0, 0]}]);
    json!({"problem": {"rigid_bodies": {"gravity": [0, 0, -G], "bodies": bodies, "contacts": {"friction": friction}}},
        "time": {"end": end}, "method": {"step": end / count, "impacts": impacts}, "output": {"times": [end], "fields": ["b.x"]}})
}

/// Solves a specification, asserts that a trusted result is right, and returns whether it is trusted.
fn judged(system: &Value, field: &str, exact: f64, permitted: f64) -> bool {
    let solution = solve(system);
    let error = (last(&solution, field) - exact).abs() / exact.abs();
    assert!(!solution.verdict.trusted || error < permitted, "{field} is off by {error:e}: {system}");
    solution.verdict.trusted
}

#[test]
fn friction_that_is_narrower_than_a_step_is_seen() {
    let (v, end) = (3.0, 0.9);
    // Three friction coefficients: a pulse in time, a wave whose period is that of the steps, and a rough strip of the
    // floor.
    type Coefficient = (&'static str, fn(f64, f64) -> f64);
    let pulse: Coefficient =
        ("0.1 + 3*exp(-((t - 0.3333)/0.005)^2)", |t, _| 0.1 + 3.0 * (-((t - 0.3333) / 0.005_f64).powi(2)).exp());
    let period: Coefficient =
        ("0.2 + 0.15*cos(2*pi*t/0.015)", |t, _| 0.2 + 0.15 * (std::f64::consts::TAU * t / 0.015).cos());
    let strip: Coefficient =
        ("0.1 + 4*exp(-((X - 0.7137)/0.005)^2)", |_, x| 0.1 + 4.0 * (-((x - 0.7137) / 0.005_f64).powi(2)).exp());
    let mut trusted = 0;
    for (k, (text, mu)) in [pulse, period, strip].into_iter().enumerate() {
        let exact = slid(&mu, v, end);
        // The front and the rear corners of the box each carry half of its weight.
        let of_box = slid(&|t, x| 0.5 * (mu(t, x - 0.2) + mu(t, x + 0.2)), v, end);
        for count in [9.0, 15.0, 30.0, 60.0, 9000.0] {
            let of_point = judged(&point(&text.replace('X', "x"), v, [end, count]), "x", exact, 1.2 * PERMITTED[1]);
            let text = text.replace('X', "contact_x");
            let stepped = judged(&slider(&text, v, [end, count], "time_stepping"), "b.x", of_box, 1.2 * PERMITTED[0]);
            trusted += usize::from(of_point && stepped);
            assert!(count > 100.0 || !of_point, "{k} in {count} steps");
        }
        for count in [9.0, 15.0, 30.0] {
            let text = text.replace('X', "contact_x");
            judged(&slider(&text, v, [end, count], "locate"), "b.x", of_box, 1.2 * PERMITTED[0]);
        }
    }
    assert_eq!(trusted, 3);
    // The run of a point under slowly varying friction is trusted.
    let slow = |t: f64, _: f64| 0.2 + 0.1 * t;
    let exact = slid(&slow, v, end);
    assert!(judged(&point("0.2 + 0.1*t", v, [end, 900.0]), "x", exact, 1e-3));
    assert!(judged(&slider("0.2 + 0.1*t", v, [end, 90.0], "time_stepping"), "b.x", exact, 1e-2));
}

/// Friction does not matter for the verdict on a body at rest, nor on one that has come to rest.
#[test]
fn friction_that_varies_where_nothing_slides_is_trusted() {
    let pulses = "0.3 + 0.2*cos(2*pi*t/0.015)";
    let solution = solve(&slider(pulses, 0.0, [10.0, 500.0], "time_stepping"));
    assert!(solution.verdict.trusted && last(&solution, "b.x").abs() < 1e-9, "{:?}", solution.verdict);
    // On a slope of the gradient 0.2, a friction coefficient that is always larger holds the body; one that is at
    // times smaller lets it slide down step by step.
    let slope = |friction: &str| {
        let mut system = slider(friction, 0.0, [1.0, 50.0], "time_stepping");
        system["problem"]["rigid_bodies"]["gravity"] = json!([G * 0.2, 0, -G]);
        system
    };
    assert!(solve(&slope("0.3 + 0.05*cos(2*pi*t/0.02)")).verdict.trusted);
    assert!(!solve(&slope("0.3 + 0.29*cos(2*pi*t/0.02)")).verdict.trusted);
}

#[test]
fn forces_on_coordinates_that_are_narrow_in_space_are_seen() {
    let (force, width, place) = (2000.0, 0.0005, 0.5037);
    let impulse = force * width * std::f64::consts::PI.sqrt();
    let bump = format!("{force}*exp(-((x - {place})/{width})^2)");
    let system = |count: f64, force: Value, field: &str| {
        json!({"problem": {"mechanical": {"coordinates": {"x": {"initial": 0, "velocity": 1}, "y": {"initial": 0}}, "mass": [[1, 0], [0, 1]],
            "forces": force}}, "time": {"end": 1.2}, "method": {"step": 1.2 / count, "impacts": "time_stepping"},
            "output": {"times": [1.2], "fields": [field]}})
    };
    // Reference solutions: for a force along the path from the energy, and for a force across it from its impulse.
    let along = place + (1.0 + 2.0 * impulse).sqrt() * (1.2 - place);
    let across = impulse * (1.2 - place);
    for (direction, exact) in [("x", along), ("y", across)] {
        for count in [24.0, 60.0, 120.0, 240.0, 1200.0] {
            judged(&system(count, json!({direction: bump}), direction), direction, exact, 1.2 * PERMITTED[1]);
        }
        // A run of 60 steps, each far longer than the width of the bump, is not trusted.
        assert!(!judged(&system(60.0, json!({direction: bump}), direction), direction, exact, PERMITTED[1]));
    }
    // A run with a smooth nonlinear spring force is trusted.
    let exact = 0.5 * 2.4_f64.sin();
    assert!(judged(&system(12_000.0, json!({"x": "-4*x + 1e-9*sin(x)"}), "x"), "x", exact, PERMITTED[1]));
}

#[test]
fn gaps_that_close_and_open_within_a_step_are_seen() {
    let system = |x: [f64; 2], gap: &str, count: f64| {
        json!({"problem": {"mechanical": {"coordinates": {"x": {"initial": x[0], "velocity": x[1]}, "y": {"initial": 0}}, "mass": [[1, 0], [0, 1]],
            "contacts": [{"name": "wall", "gap": gap, "restitution": 1}]}}, "time": {"end": 1.2},
            "method": {"step": 1.2 / count, "impacts": "time_stepping"}, "output": {"times": [1.2], "fields": ["x"]}})
    };
    for count in [7.0, 12.0, 24.0, 60.0, 120.0, 600.0] {
        // A spike of the floor in the path of the body, and one that is too low to touch it.
        let spike = |height: f64| format!("y + 0.5 - {height}*exp(-((x - 0.5037)/0.001)^2)");
        assert!(!solve(&system([0.0, 1.0], &spike(1.0), count)).verdict.trusted, "{count} steps");
        let free = solve(&system([0.0, 1.0], &spike(0.49), count));
        assert!(free.verdict.trusted && distance(&free, "x", |t| t) < 1e-12, "{count} steps: {:?}", free.verdict);
        // An obstacle that moves up for an instant and strikes the body, and one that does not reach it.
        let bat = |height: f64| format!("x - {height}*exp(-((t - 0.5037)/0.001)^2)");
        assert!(!solve(&system([1.0, 0.0], &bat(2.0), count)).verdict.trusted, "{count} steps");
        let still = solve(&system([1.0, 0.0], &bat(0.99), count));
        assert!(still.verdict.trusted && distance(&still, "x", |_| 1.0) < 1e-12, "{count} steps: {:?}", still.verdict);
    }
    // A point that passes a round pillar at a tenth of the pillar's radius, and a point that passes a gate.
    for (start, gap) in [(-2.0, "sqrt(x^2 + (y - 1.1)^2) - 1"), (-1.0, "0.1 + x^2 - y")] {
        for count in [60.0, 600.0] {
            let past = solve(&system([start, 3.0], gap, count));
            assert!(past.verdict.trusted && distance(&past, "x", |t| start + 3.0 * t) < 1e-12, "{gap}, {count} steps");
        }
    }
}

/// If a body is at rest at the output times, the verdict disregards errors of its earlier motion.
#[test]
fn values_at_rest_are_trusted_and_those_on_the_way_are_not() {
    let ball = |count: f64, times: [f64; 2]| {
        let bodies = json!([{"name": "ground", "shape": {"half_space": {"normal": [0, 0, 1]}}, "fixed": true},
            {"name": "b", "shape": {"sphere": {"radius": 0.1}}, "mass": 1, "position": [0, 0, 0.5]}]);
        json!({"problem": {"rigid_bodies": {"gravity": [0, 0, -G], "bodies": bodies, "contacts": {"restitution": 0.5}}},
            "time": {"end": 8}, "method": {"step": 8.0 / count, "impacts": "time_stepping"},
            "output": {"times": times, "fields": ["b.z"]}})
    };
    let point = |count: f64, times: [f64; 2]| {
        json!({"problem": {"mechanical": {"coordinates": {"y": {"initial": 0.4}}, "mass": [[1]], "forces": {"y": -G},
            "contacts": [{"name": "c", "gap": "y", "restitution": 0.5}]}},
            "time": {"end": 8}, "method": {"step": 8.0 / count, "impacts": "time_stepping"}, "output": {"times": times, "fields": ["y"]}})
    };
    for count in [400.0, 800.0, 1600.0] {
        for (rests, moves, field, height) in [
            (ball(count, [7.0, 8.0]), ball(count, [0.6, 8.0]), "b.z", 0.1),
            (point(count, [7.0, 8.0]), point(count, [0.6, 8.0]), "y", 0.0),
        ] {
            let at_rest = solve(&rests);
            assert!(at_rest.verdict.trusted, "{field}, {count} steps: {:?}", at_rest.verdict);
            assert!((last(&at_rest, field) - height).abs() < 1e-6);
            assert!(!solve(&moves).verdict.trusted, "{field}, {count} steps");
        }
    }
    // A stack that settles by a tenth of a millimetre in its first steps presses on the ground with its weight.
    let boxes = (0..3).map(|k| {
        json!({"name": format!("b{k}"), "shape": {"box": {"size": [0.4, 0.4, 0.2]}}, "mass": 1,
            "position": [0, 0, 0.1 + 0.2001 * f64::from(k) + 1e-4]})
    });
    let ground = json!({"name": "ground", "shape": {"half_space": {"normal": [0, 0, 1]}}, "fixed": true, "contact_forces": true});
    let bodies: Vec<Value> = std::iter::once(ground).chain(boxes).collect();
    let stack = json!({"problem": {"rigid_bodies": {"gravity": [0, 0, -G], "bodies": bodies, "contacts": {"friction": 0.5}}},
        "time": {"end": 1}, "method": {"step": 0.02}, "output": {"times": [0.5, 1], "fields": ["ground.contact_fz"]}});
    assert!(judged(&stack, "ground.contact_fz", -3.0 * G, 1e-6));
}

/// A motor of constant speed moves a slide to and fro, and recovers the work that it has done.
#[test]
fn a_motor_that_holds_a_speed_is_trusted() {
    let speed = 3.0_f64;
    for count in [200.0, 2000.0] {
        let crank = json!({"problem": {"mechanical": {"coordinates": {"a": {"initial": 0, "velocity": speed}, "x": {"initial": 1}},
            "mass": [[1, 0], [0, 1]],
            "joints": [{"name": "motor", "constraint": format!("a - {speed}*t")}, {"name": "slide", "constraint": "x - cos(a)"}]}},
            "time": {"end": 2}, "method": {"step": 2.0 / count, "impacts": "time_stepping"}, "output": {"times": [1, 2], "fields": ["x"]}});
        assert!(judged(&crank, "x", (2.0 * speed).cos(), 1e-9), "{count} steps");
    }
}
