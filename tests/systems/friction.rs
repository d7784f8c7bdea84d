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
    // At rest, friction balances the component of the weight along the slope, below its bound.
    assert!((last(&solution, "F") - g * theta.sin()).abs() < 1e-9);
}

#[test]
fn a_block_slides_on_above_the_friction_angle() {
    let theta = 35.0_f64.to_radians();
    let mut specification = example("coulomb_slope");
    specification["problem"]["dvi"]["parameters"]["theta"] = json!(theta);
    specification["problem"]["dvi"]["states"]["v"]["initial"] = json!(0);
    let solution = solve(&specification);
    // The acceleration is g (sin 35 deg - 0.5 cos 35 deg).
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
