//! Stacks of boxes at rest under their weight.

use super::on_the_ground;
use crate::systems::harness::{column, solve};
use serde_json::{Value, json};

#[test]
fn a_stack_of_ten_boxes_carries_a_top_a_million_times_as_heavy() {
    for load in [1.0, 1e3, 1e6] {
        let cube = |k: usize| {
            json!({"name": format!("b{k}"), "shape": {"box": {"size": [1, 1, 1]}},
                "mass": if k == 9 { load } else { 1.0 }, "position": [0, 0, 0.5 + k as f64]})
        };
        let bodies: Vec<Value> = (0..10).map(cube).collect();
        let solution = solve(&on_the_ground(&bodies, &json!({"friction": 0.6}), 2.0, 1e-3));
        for k in 0..10 {
            let worst = |axis: &str, from: f64| {
                let values = column(&solution, &format!("b{k}.{axis}"));
                values.iter().map(|value| (value - from).abs()).fold(0.0, f64::max)
            };
            assert!(worst("z", 0.5 + k as f64) < 1e-6, "load {load}, box {k}: {:e}", worst("z", 0.5 + k as f64));
            assert!(worst("x", 0.0).max(worst("y", 0.0)) < 1e-8, "load {load}, box {k}: {:e}", worst("x", 0.0));
        }
        assert!(column(&solution, "penetration").iter().all(|depth| *depth < 1e-6));
    }
}

#[test]
fn a_box_that_lands_askew_on_another_comes_to_lie_flat() {
    let lower = json!({"name": "lower", "shape": {"box": {"size": [2, 2, 1]}}, "mass": 4, "position": [0, 0, 0.5]});
    let upper = json!({"name": "upper", "shape": {"box": {"size": [1, 1, 1]}}, "mass": 1, "position": [0.1, 0.05, 1.8],
        "orientation": [1, 0.05, 0.08, 0.3]});
    let solution = solve(&on_the_ground(&[lower, upper], &json!({"friction": 0.5}), 3.0, 1e-3));
    let at_end = |name: &str| column(&solution, name)[100];
    assert!((at_end("upper.z") - 1.5).abs() < 1e-6, "{}", at_end("upper.z"));
    assert!(at_end("kinetic_energy") < 1e-12);
    // The upper box lies flat: the quaternion of its orientation is a rotation about z.
    assert!(at_end("upper.qx").hypot(at_end("upper.qy")) < 1e-6);
}

/// Fifty boxes with two hundred contacts. The contact forces carry each box in every step, at a bounded cost; block
/// Gauss-Seidel sweeps from box to box would need orders of magnitude more work.
#[test]
fn a_stack_of_fifty_boxes_carries_its_weight_in_every_step() {
    let cube = |k: usize| {
        json!({"name": format!("b{k}"), "shape": {"box": {"size": [0.1, 0.1, 0.1]}}, "mass": 1.0,
            "position": [0, 0, 0.05 + 0.1 * k as f64], "contact_forces": true})
    };
    let bodies: Vec<Value> = (0..50).map(cube).collect();
    let mut specification = on_the_ground(&bodies, &json!({"friction": 0.5}), 0.1, 2e-3);
    specification["output"] = json!({"times": {"count": 51}});
    let solution = solve(&specification);
    for k in [0, 25, 49] {
        let height = column(&solution, &format!("b{k}.z"));
        let from = 0.05 + 0.1 * k as f64;
        assert!(height.iter().all(|z| (z - from).abs() < 1e-8), "box {k}: {:e}", height[50] - from);
        let held = column(&solution, &format!("b{k}.contact_fz"));
        assert!(held[1..].iter().all(|force| (force - 9.81).abs() < 1e-4), "box {k}: {held:?}");
    }
    let vi = solution.diagnostics.vi.as_ref().expect("contacts");
    assert!(vi.largest_residual <= 1e-8, "{vi:?}");
    assert!(vi.pivots <= 3_000 * vi.solves, "{vi:?}");
}
