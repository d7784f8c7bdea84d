//! An arch of stones, supported by weight and friction alone.

use super::on_the_ground;
use crate::systems::harness::{column, solve};
use serde_json::{Value, json};
use std::f64::consts::PI;

const STONES: usize = 11;

/// The `k`-th stone of a semicircular arch of mean radius 1, thickness `t` and depth 0.5, as a convex hull.
fn stone(k: usize, t: f64) -> Value {
    let mut points = Vec::new();
    for side in [k, k + 1] {
        let angle = PI * side as f64 / STONES as f64;
        for radius in [1.0 - 0.5 * t, 1.0 + 0.5 * t] {
            for y in [-0.25, 0.25] {
                points.push(json!([radius * angle.cos(), y, radius * angle.sin()]));
            }
        }
    }
    json!({"name": format!("s{k}"), "shape": {"convex_hull": {"points": points}}, "density": 2000})
}

fn arch(t: f64) -> Value {
    let stones: Vec<Value> = (0..STONES).map(|k| stone(k, t)).collect();
    on_the_ground(&stones, &json!({"friction": 0.7}), 2.0, 2e-3)
}

#[test]
fn a_thick_arch_of_eleven_stones_stands() {
    let solution = solve(&arch(0.25));
    for k in 0..STONES {
        for axis in ["x", "y", "z"] {
            let values = column(&solution, &format!("s{k}.{axis}"));
            let moved = values.iter().map(|value| value.abs()).fold(0.0, f64::max);
            assert!(moved < 1e-6, "stone {k} moves by {moved:e} along {axis}");
        }
    }
}

/// A semicircular arch stands if its thickness is at least 0.1075 of its radius (Milankovitch 1907; Heyman 1969).
#[test]
fn an_arch_thinner_than_any_line_of_thrust_falls() {
    let solution = solve(&arch(0.06));
    let key = column(&solution, &format!("s{}.z", STONES / 2));
    assert!(key[100] < -0.1, "the key stone has come down by {}", -key[100]);
}
