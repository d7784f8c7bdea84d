//! Verdicts on a light ball between a wall and a heavy ball that approaches it: hundreds of impacts within a step.
//! The reference computes one impact after another.

use super::solve;
use crate::systems::harness::last;
use serde_json::json;

/// Radius of both balls.
const R: f64 = 0.1;

/// Returns the time at which a gap between bodies, opening at the rate `v`, closes under the relative acceleration
/// `-g`; infinite if it does not close.
fn closes(gap: f64, v: f64, g: f64) -> f64 {
    if g == 0.0 {
        return if v < 0.0 { gap.max(0.0) / -v } else { f64::INFINITY };
    }
    (v + (v * v + 2.0 * g * gap.max(0.0)).sqrt()) / g
}

/// Returns the positions at the time `end` of two balls on a line, from the positions `x` and velocities `v`, with
/// the masses 1 and `heavy`, after elastic impacts with each other and with the wall at 0, towards which gravity
/// acts.
fn bounced(mut x: [f64; 2], mut v: [f64; 2], heavy: f64, g: f64, end: f64) -> [f64; 2] {
    let mut t = 0.0;
    loop {
        let [wall, pair] = [closes(x[0] - R, v[0], g), closes(x[1] - x[0] - 2.0 * R, v[1] - v[0], 0.0)];
        let s = wall.min(pair).min(end - t);
        for (x, v) in x.iter_mut().zip(&mut v) {
            *x += s * (*v - 0.5 * g * s);
            *v -= g * s;
        }
        t += s;
        if t >= end {
            return x;
        }
        if wall < pair {
            v[0] = -v[0];
        } else {
            let impulse = 2.0 * heavy / (1.0 + heavy) * (v[0] - v[1]);
            v = [v[0] - impulse, v[1] + impulse / heavy];
        }
    }
}

/// Returns the largest error of the balls' positions, relative to the distance that the heavy ball moves, and whether
/// the verdict trusts the result.
fn squeezed(heavy: f64, g: f64, step: f64, impacts: Option<&str>) -> (f64, bool) {
    let (x, v, end) = ([1.0, 2.0], [0.0, -1.0], 1.937);
    let ball = |name: &str, mass: f64, x: f64, v: f64| json!({"name": name, "shape": {"sphere": {"radius": R}}, "mass": mass, "position": [x, 0, 0], "velocity": [v, 0, 0]});
    let wall = json!({"name": "wall", "shape": {"half_space": {"normal": [1, 0, 0]}}, "fixed": true});
    let bodies = json!([wall, ball("light", 1.0, x[0], v[0]), ball("heavy", heavy, x[1], v[1])]);
    let mut specification = json!({"problem": {"rigid_bodies": {"gravity": [-g, 0, 0], "bodies": bodies, "contacts": {"restitution": 1}}},
        "time": {"end": end}, "method": {"step": step}, "output": {"times": {"count": 2}, "fields": ["light.x", "heavy.x"]}});
    if let Some(impacts) = impacts {
        specification["method"]["impacts"] = json!(impacts);
    }
    let solution = solve(&specification);
    let exact = bounced(x, v, heavy, g, end);
    let error = ["light.x", "heavy.x"].iter().zip(exact).map(|(name, exact)| (last(&solution, name) - exact).abs());
    (error.fold(0.0, f64::max), solution.verdict.trusted)
}

#[test]
fn impacts_in_their_hundreds_within_a_step_are_right_or_doubted() {
    for g in [0.0, 1.0] {
        for heavy in [1e2, 1e3, 1e4, 1e5, 1e6] {
            for step in [1e-2, 1e-3, 1e-4] {
                for impacts in [None, Some("time_stepping")] {
                    let (error, is_trusted) = squeezed(heavy, g, step, impacts);
                    assert!(error < 1e-2 || !is_trusted, "{g} {heavy} {step} {impacts:?}: {error}");
                }
            }
        }
    }
}

#[test]
fn impacts_that_steps_resolve_are_trusted() {
    for g in [0.0, 1.0] {
        let (error, is_trusted) = squeezed(1e3, g, 1e-3, None);
        assert!(error < 1e-8 && is_trusted, "{g}: {error} {is_trusted}");
    }
}
