//! Dry friction: Coulomb's law as maximal dissipation over `[-mu N, mu N]`.

use crate::systems::harness::{distance, events, last, solve};
use crate::systems::reference::{digits, example, switching};
use serde_json::json;

#[test]
fn a_block_on_a_slope_stops_and_stays() {
    let (g, mu, theta) = (9.81, 0.5, 20.0_f64.to_radians());
    let deceleration = g * (mu * theta.cos() - theta.sin());
    let stop = 2.0 / deceleration;
    let solution = solve(&example("coulomb_slope"));
    assert!(stop < 3.0);
    let error = distance(&solution, "v", |t| (2.0 - deceleration * t).max(0.0));
    assert!(error < 1e-9, "the velocity is off by {error:e}");
    let error = distance(&solution, "x", |t| 2.0 * t.min(stop) - 0.5 * deceleration * t.min(stop).powi(2));
    assert!(error < 1e-9, "the position is off by {error:e}");
    assert_eq!(events(&solution, "F").len(), 1);
    assert!((events(&solution, "F")[0] - stop).abs() < 1e-10);
    // For a block at rest on a slope, friction balances the component of the weight along the slope, and is less than
    // its bound.
    assert!((last(&solution, "F") - g * theta.sin()).abs() < 1e-9);
}

#[test]
fn a_block_slides_on_above_the_friction_angle() {
    let theta = 35.0_f64.to_radians();
    let mut specification = example("coulomb_slope");
    specification["problem"]["dvi"]["parameters"]["theta"] = json!(theta);
    specification["problem"]["dvi"]["states"]["v"]["initial"] = json!(0);
    let solution = solve(&specification);
    // The acceleration of the sliding block on the slope is g (sin 35 deg - 0.5 cos 35 deg).
    let acceleration = 1.608_844_063_366_257_5;
    assert!((last(&solution, "v") - 3.0 * acceleration).abs() < 1e-9, "v = {}", last(&solution, "v"));
}

#[test]
fn a_mass_on_a_belt_slips_sticks_and_slips() {
    let reference = switching("friction_oscillator_belt");
    let mut specification = example("friction_belt");
    specification["method"]["rtol"] = json!(1e-10);
    let solution = solve(&specification);
    for (state, name) in ["x", "v"].iter().enumerate() {
        let error = (last(&solution, name) - digits(&reference["x_T"][state])).abs();
        assert!(error < 1e-8, "`{name}` is off by {error:e}");
    }
    let times = events(&solution, "F");
    let modes = reference["modes"].as_array().expect("modes");
    assert_eq!(times.len(), modes.len() - 1, "{times:?}");
    for (t, mode) in times.iter().zip(&modes[1..]) {
        assert!((t - digits(&mode[0])).abs() < 1e-8, "{t} against {}", mode[0]);
    }
}

#[test]
fn a_force_a_little_above_friction_moves_a_block_however_large_its_weight_is() {
    for (weight, mu, force, end) in
        [(1e5, 1e-8, 5e-3, 100.0), (10.0, 0.3, 3.0 + 1e-6, 1e4), (1e6, 0.3, 3e5 + 0.2, 1e4), (10.0, 1e-8, 5e-7, 1e4)]
    {
        let solution = solve(&json!({"problem": {"mechanical": {
                "coordinates": {"x": {"initial": 0}, "y": {"initial": 0}}, "mass": [[1, 0], [0, 1]],
                "potential": format!("{weight:?}*y"), "forces": {"x": format!("{force:?}")},
                "contacts": [{"name": "floor", "gap": "y", "friction": {"coefficient": mu, "slip": ["x_dot"]}}]}},
            "time": {"end": end}}));
        let (found, exact) = (last(&solution, "x"), (force - mu * weight) * end * end / 2.0);
        // The excess of the applied force over the friction bound is known up to the rounding error of either.
        let known = 1e-6 + 1e-15 * force / (force - mu * weight);
        assert!((found - exact).abs() <= known * exact, "{weight}, {mu}, {force}: {found} for {exact}");
    }
    // A force on a block at the friction bound, or below it by a relative 3e-7, moves nothing.
    for force in [3.0, 3.0 - 1e-6] {
        let solution = solve(&json!({"problem": {"mechanical": {
                "coordinates": {"x": {"initial": 0}, "y": {"initial": 0}}, "mass": [[1, 0], [0, 1]],
                "potential": "10*y", "forces": {"x": force},
                "contacts": [{"name": "floor", "gap": "y", "friction": {"coefficient": 0.3, "slip": ["x_dot"]}}]}},
            "time": {"end": 1e4}}));
        assert!(last(&solution, "x").abs() < 1e-6, "{force}: {}", last(&solution, "x"));
    }
}

#[test]
fn a_force_that_turns_just_within_friction_moves_nothing_and_costs_little() {
    // A force of rotating direction on a block is at every time below the friction bound by the fraction d: the block
    // stays at rest, and the steps are long.
    for d in [1e-2, 1e-4, 1e-6] {
        let solution = solve(&json!({"problem": {"dvi": {"parameters": {"A": 1.0 - d},
            "states": {"x": {"initial": 0, "rate": "vx"}, "y": {"initial": 0, "rate": "vy"},
                "vx": {"initial": 0, "rate": "A*cos(t) - Fx"}, "vy": {"initial": 0, "rate": "A*sin(t) - Fy"}},
            "variables": {"Fx": {"inequality": "-vx"}, "Fy": {"inequality": "-vy"}},
            "set": [{"ball": {"of": ["Fx", "Fy"], "radius": 1}}]}}, "time": {"end": std::f64::consts::TAU}}));
        assert!(solution.verdict.trusted, "{d:e}: {:?}", solution.verdict);
        assert!(last(&solution, "x").abs() < 1e-9 && last(&solution, "vy").abs() < 1e-9, "{d:e}");
        assert!(solution.diagnostics.steps.accepted <= 100, "{d:e}: {} steps", solution.diagnostics.steps.accepted);
    }
}
