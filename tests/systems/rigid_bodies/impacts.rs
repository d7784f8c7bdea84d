//! Impacts of spheres and of other rigid bodies.

use super::{falling_on_each_other, on_the_ground, weightless};
use crate::systems::harness::{column, last, solve};
use serde_json::{Value, json};

#[test]
fn an_oblique_impact_slips_or_rolls_as_newton_and_coulomb_say() {
    for (v, expected, omega) in [(4.0, 2.92, 27.0), (1.0, 0.7142857142857143, 7.142857142857143)] {
        let ball = json!({"name": "ball", "shape": {"sphere": {"radius": 0.1}}, "mass": 3, "position": [0, 0, 0.1],
            "velocity": [v, 0, -3]});
        let contacts = json!({"friction": 0.2, "restitution": 0.8});
        let solution = solve(&weightless(on_the_ground(&[ball], &contacts, 0.01, 1e-3)));
        assert!((last(&solution, "ball.vx") - expected).abs() < 1e-12);
        assert!((last(&solution, "ball.wy") - omega).abs() < 1e-11);
        assert!((last(&solution, "ball.vz") - 2.4).abs() < 1e-12);
        let lost = last(&solution, "lost_in_impacts") + last(&solution, "dissipated_by_friction");
        let kinetic = column(&solution, "kinetic_energy");
        assert!((kinetic[0] - last(&solution, "kinetic_energy") - lost).abs() < 1e-12);
    }
}

fn cradle(n: usize) -> Value {
    let ball = |k: usize| {
        json!({"name": format!("b{k}"), "shape": {"sphere": {"radius": 0.5}}, "mass": 1, "position": [k, 0, 5],
            "velocity": [if k == 0 { 1 } else { 0 }, 0, 0]})
    };
    let bodies: Vec<Value> = (0..n).map(ball).collect();
    weightless(on_the_ground(&bodies, &json!({"restitution": 1}), 0.01, 1e-3))
}

#[test]
fn spheres_in_a_row_part_as_the_simultaneous_law_says_and_keep_energy_and_momentum() {
    for n in [3, 5] {
        let solution = solve(&cradle(n));
        let speeds: Vec<f64> = (0..n).map(|k| last(&solution, &format!("b{k}.vx"))).collect();
        for (k, speed) in speeds.iter().enumerate() {
            let expected = if k == 0 { -(n as f64 - 2.0) / n as f64 } else { 2.0 / n as f64 };
            assert!((speed - expected).abs() < 1e-10, "{speeds:?}");
        }
        assert!((last(&solution, "kinetic_energy") - 0.5).abs() < 1e-10);
    }
}

#[test]
fn bodies_that_fall_on_each_other_end_at_rest_with_no_overlap_and_all_energy_accounted_for() {
    let solution = solve(&falling_on_each_other());
    // The deepest penetration is that of a corner rotated below the ground within a step: its lever arm times h^2
    // w^2 / 2.
    let deepest = column(&solution, "penetration").iter().copied().fold(0.0, f64::max);
    assert!(deepest < 1e-3, "{deepest:e}");
    let sum = |k: usize| {
        let of = |name: &str| column(&solution, name)[k];
        of("kinetic_energy") + of("potential_energy") + of("dissipated_by_friction") + of("lost_in_impacts")
    };
    let (start, end) = (sum(0), sum(100));
    assert!((end / start - 1.0).abs() < 5e-3, "{start} {end}");
    assert!(column(&solution, "kinetic_energy")[100] < 1e-2 * start);
}
