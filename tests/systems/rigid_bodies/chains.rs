//! Chains, closed loops and tops: joints under tension, each compared with an independent answer.

use super::weightless;
use crate::systems::harness::{column, last, solve};
use dvi::solution::{CheckCode, Solution};
use serde_json::{Value, json};

const G: f64 = 9.81;

/// A chain of links of 0.1 m and 0.1 kg along x from the origin, with a ball of the given mass fixed to the end of
/// the last link.
fn chain(links: usize, ball: f64, end: f64, step: f64) -> Value {
    let turn = std::f64::consts::FRAC_1_SQRT_2;
    let mut bodies = Vec::new();
    let mut joints = Vec::new();
    for k in 0..links {
        let (name, before) = (format!("l{k}"), k.checked_sub(1).map(|k| format!("l{k}")));
        bodies.push(json!({"name": name, "shape": {"capsule": {"radius": 0.01, "length": 0.07}}, "mass": 0.1,
            "inertia": [1e-4, 1e-4, 1e-5], "position": [0.1 * k as f64 + 0.05, 0, 0], "orientation": [turn, 0, turn, 0]}));
        let of: Vec<String> = before.into_iter().chain([name]).collect();
        joints.push(json!({"ball": {"bodies": of, "at": [0.1 * k as f64, 0, 0]}}));
    }
    if ball > 0.0 {
        let at = [0.1 * links as f64, 0.0, 0.0];
        bodies.push(json!({"name": "ball", "shape": {"sphere": {"radius": 0.03}}, "mass": ball,
            "inertia": [0.036 * ball / 100.0, 0.036 * ball / 100.0, 0.036 * ball / 100.0], "position": at}));
        joints.push(json!({"fixed": {"bodies": [format!("l{}", links - 1), "ball"]}}));
    }
    json!({
        "problem": {"rigid_bodies": {"gravity": [0, 0, -G], "bodies": bodies, "joints": joints}},
        "time": {"end": end},
        "method": {"step": step},
        "output": {"times": {"count": 101}},
    })
}

/// Returns three faults of a chain: the largest energy above the initial one and the defect of the energy balance,
/// relative to the largest kinetic energy, and the drift of joints, relative to a link.
fn faults(solution: &Solution) -> [f64; 3] {
    let (kinetic, potential) = (column(solution, "kinetic_energy"), column(solution, "potential_energy"));
    let largest = kinetic.iter().copied().fold(0.0, f64::max);
    let gain = kinetic.iter().zip(potential).map(|(t, v)| t + v - kinetic[0] - potential[0]).fold(0.0, f64::max);
    let lacking = solution.diagnostics.energy.unwrap().largest_defect;
    let drift = solution.diagnostics.checks.get(CheckCode::JointDrift).unwrap().0;
    [gain / largest, lacking / largest, drift]
}

#[test]
fn a_chain_of_light_links_with_a_heavy_end_keeps_its_energy_and_its_joints() {
    for (ball, step, end) in [(100.0, 2e-3, 5.0), (1e5, 2e-3, 1.0), (100.0, 2e-2, 1.0)] {
        let solution = solve(&chain(10, ball, end, step));
        let [gain, lacking, drift] = faults(&solution);
        assert!(gain <= 1e-9 && lacking <= 1e-2 && drift <= 1e-6, "{ball} kg, {step}: {gain:e} {lacking:e} {drift:e}");
        let others = solution.verdict.because.iter().filter(|reason| reason.code != CheckCode::LocalError);
        assert_eq!(others.count(), 0, "{:?}", solution.verdict);
    }
}

/// A heavy ball on three light links. Reference: the angles of the links from the vertical, by Lagrange's equations
/// and Radau IIA.
#[test]
fn a_ball_on_three_light_links_swings_as_in_generalised_coordinates() {
    // Derivatives of the positions of the centres by each link's angle, in multiples of the length of a link, and the
    // masses.
    let bodies = [([0.5, 0.0, 0.0], 0.1), ([1.0, 0.5, 0.0], 0.1), ([1.0, 1.0, 0.5], 0.1), ([1.0, 1.0, 1.0], 100.0)];
    let sum = |of: &dyn Fn(&[f64; 3]) -> f64| bodies.iter().map(|(at, mass)| mass * of(at)).sum::<f64>();
    let inertia = [1e-4, 1e-4, 1e-4 + 0.036];
    let mass: Vec<Vec<String>> = (0..3)
        .map(|i| {
            let entry = |j: usize| {
                let coupling = 0.01 * sum(&|at| at[i] * at[j]);
                let own = if i == j { inertia[i] } else { 0.0 };
                format!("{own} + {coupling}*cos(a{i} - a{j})")
            };
            (0..3).map(entry).collect()
        })
        .collect();
    let potential: Vec<String> = (0..3).map(|i| format!("-{}*cos(a{i})", 0.1 * G * sum(&|at| at[i]))).collect();
    let start = json!({"initial": std::f64::consts::FRAC_PI_2});
    let exact = solve(&json!({
        "problem": {"mechanical": {"coordinates": {"a0": start, "a1": start, "a2": start}, "mass": mass,
            "potential": potential.join(" ")}},
        "time": {"end": 0.5}, "method": {"rtol": 1e-13, "atol": 1e-14}, "output": {"times": {"count": 2}},
    }));
    let angles = ["a0", "a1", "a2"].map(|name| last(&exact, name));
    let (x, z) =
        (angles.iter().map(|a| 0.1 * a.sin()).sum::<f64>(), -angles.iter().map(|a| 0.1 * a.cos()).sum::<f64>());
    let error = |step: f64| {
        let solution = solve(&chain(3, 100.0, 0.5, step));
        (last(&solution, "ball.x") - x).hypot(last(&solution, "ball.z") - z)
    };
    // Under tension the light links oscillate at some 600 rad/s: long steps do not resolve their motion, but that of
    // the ball is accurate.
    let long = error(2e-3);
    assert!(long < 3e-5, "{long:e}");
    let (coarse, fine) = (error(6.25e-5), error(3.125e-5));
    assert!(fine < 1e-7 && (coarse / fine).log2() > 1.9, "{coarse:e} {fine:e}");
}

/// A free straight chain rotates for ever as one body: energy, momentum and straightness are conserved for any step
/// size.
#[test]
fn a_straight_chain_without_weight_turns_as_one_body_in_long_steps() {
    let mut specification = weightless(chain(20, 0.0, 20.0, 0.05));
    let problem = &mut specification["problem"]["rigid_bodies"];
    problem["joints"].as_array_mut().unwrap().remove(0);
    for (k, body) in problem["bodies"].as_array_mut().unwrap().iter_mut().enumerate() {
        body["velocity"] = json!([0, 0, -3.0 * (0.1 * k as f64 - 0.95)]);
        body["angular_velocity"] = json!([0, 3, 0]);
    }
    let solution = solve(&specification);
    let [gain, lacking, drift] = faults(&solution);
    assert!(gain < 1e-12 && lacking < 1e-12 && drift < 1e-12, "{gain:e} {lacking:e} {drift:e}");
    // The time-stepping scheme moves bodies along chords instead of arcs: the chain rotates by 2 atan(h w / 2) per step
    // of size h at the angular velocity w.
    let angle = 2.0 * (0.05_f64 * 3.0 / 2.0).atan() * 400.0;
    let [x, z] =
        ["x", "z"].map(|axis| last(&solution, &format!("l19.{axis}")) - last(&solution, &format!("l0.{axis}")));
    assert!((x - 1.9 * angle.cos()).abs() < 1e-9 && (z + 1.9 * angle.sin()).abs() < 1e-9, "{x} {z}");
}

/// Steady precession `W` of a top at the angle `a` from the vertical: `A W^2 cos a - C n W + m g l = 0` (Goldstein,
/// *Classical Mechanics*, 5.7).
#[test]
fn a_spinning_top_precesses_steadily_at_second_order() {
    let (l, across, along, tilt, precession) = (0.3_f64, 0.003, 0.004, 0.5_f64, 2.0);
    let spin = ((across + l * l) * precession * precession * tilt.cos() + G * l) / (along * precession);
    let axis = [tilt.sin(), 0.0, tilt.cos()];
    let about = spin - precession * tilt.cos();
    let error = |step: f64| {
        let solution = solve(&json!({
            "problem": {"rigid_bodies": {"gravity": [0, 0, -G],
                "bodies": [{"name": "top", "shape": {"sphere": {"radius": 0.05}}, "mass": 1, "inertia": [across, across, along],
                    "position": axis.map(|a| l * a), "orientation": [(0.5 * tilt).cos(), 0, (0.5 * tilt).sin(), 0],
                    "velocity": [0, precession * l * tilt.sin(), 0],
                    "angular_velocity": [about * axis[0], 0, about * axis[2] + precession]}],
                "joints": [{"ball": {"bodies": ["top"], "at": [0, 0, 0]}}]}},
            "time": {"end": 2}, "method": {"step": step}, "output": {"times": {"count": 2}},
        }));
        let angle = 2.0 * precession;
        let exact = [l * tilt.sin() * angle.cos(), l * tilt.sin() * angle.sin(), l * tilt.cos()];
        let off =
            ["top.x", "top.y", "top.z"].iter().zip(exact).map(|(name, exact)| (last(&solution, name) - exact).abs());
        off.fold(0.0, f64::max)
    };
    let (coarse, fine) = (error(1e-3), error(5e-4));
    assert!(coarse < 2e-4 && (coarse / fine).log2() > 1.9, "{coarse:e} {fine:e}");
}

/// Four bars in a square with redundant hinges. The smallest change of velocities that satisfies the joints, in the
/// norm of the mass matrix, by the pseudoinverse of `G M^-1 G^T`, leaves 0.08261986301369863 J of the 0.125 J of the
/// one bar that moves.
#[test]
fn a_redundant_loop_takes_no_more_energy_than_its_joints_must() {
    let bar = |name: &str, at: [f64; 2], size: [f64; 2], v: f64| {
        json!({"name": name, "shape": {"box": {"size": [size[0], size[1], 0.1]}}, "mass": 1, "position": [at[0], at[1], 0],
            "velocity": [v, 0, 0]})
    };
    let hinge =
        |a: &str, b: &str, x: f64, y: f64| json!({"hinge": {"bodies": [a, b], "at": [x, y, 0], "axis": [0, 0, 1]}});
    let solution = solve(&json!({
        "problem": {"rigid_bodies": {"interpenetration": "resolve",
            "bodies": [bar("south", [0.0, -0.5], [0.8, 0.1], 0.5), bar("north", [0.0, 0.5], [0.8, 0.1], 0.0),
                bar("west", [-0.5, 0.0], [0.1, 0.8], 0.0), bar("east", [0.5, 0.0], [0.1, 0.8], 0.0)],
            "joints": [hinge("south", "west", -0.5, -0.5), hinge("south", "east", 0.5, -0.5),
                hinge("north", "west", -0.5, 0.5), hinge("north", "east", 0.5, 0.5)]}},
        "time": {"end": 1}, "method": {"step": 2e-3}, "output": {"times": {"count": 101}},
    }));
    let energy = column(&solution, "kinetic_energy");
    assert!(energy.iter().all(|energy| (energy - 0.08261986301369863).abs() < 1e-12), "{energy:?}");
    assert!(faults(&solution)[2] < 1e-12);
}
