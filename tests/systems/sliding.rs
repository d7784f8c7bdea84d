//! Switching by the sign of a function: a relay, a sliding mode.

use crate::systems::harness::{column, distance, events, last, solve};
use crate::systems::reference::{digits, example, switching};
use serde_json::json;

#[test]
fn the_relay_reaches_zero_and_stays_without_chatter() {
    let reach = 2.0 / 0.7;
    let solution = solve(&example("relay"));
    let error = distance(&solution, "x", |t| (2.0 - 0.7 * t).max(0.0));
    assert!(error < 1e-10, "off by {error:e}");
    assert_eq!(events(&solution, "s").len(), 1);
    assert!((events(&solution, "s")[0] - reach).abs() < 1e-10);
    // The selection that holds x at zero.
    for (&t, &s) in solution.trajectory.t.iter().zip(column(&solution, "s")) {
        let exact = if t < reach { 1.0 } else { 0.3 };
        assert!((s - exact).abs() < 1e-9, "s = {s} at t = {t}");
    }
    assert!(last(&solution, "x").abs() < 1e-14);
}

#[test]
fn the_sliding_mode_is_reached_and_kept() {
    let reference = switching("sliding_mode");
    let mut specification = example("sliding_mode");
    specification["method"]["rtol"] = json!(1e-10);
    let solution = solve(&specification);
    for (state, field) in solution.trajectory.fields.iter().take(2).enumerate() {
        let error = (field.values.last().expect("values") - digits(&reference["x_T"][state])).abs();
        assert!(error < 1e-9, "`{}` is off by {error:e}", field.name);
    }
    let hit = solution.trajectory.events[0].t;
    assert!((hit - digits(&reference["t_hit"])).abs() < 1e-9, "hit at {hit}");
}
