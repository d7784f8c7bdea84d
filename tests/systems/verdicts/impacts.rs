//! Verdicts on impacts, located and time-stepped: energies, gaps and accumulations.

use super::*;

/// Specification of a ball of unit mass dropped on a floor from `height`, with the run from `start` to `end`.
fn ball(height: f64, start: f64, end: f64, restitution: f64, method: Value) -> Value {
    json!({"problem": {"mechanical": {"coordinates": {"y": {"initial": height}}, "mass": [[1]], "potential": "9.81*y",
        "contacts": [{"name": "floor", "gap": "y", "restitution": restitution}]}},
        "time": {"start": start, "end": end}, "method": method, "output": {"times": [end]}})
}

/// Returns the height of a dropped ball at the time `t` between its first and second impact.
fn height_between(height: f64, restitution: f64, t: f64) -> f64 {
    let fall = (2.0 * height / 9.81_f64).sqrt();
    let passed = t - fall;
    restitution * 9.81 * fall * passed - 0.5 * 9.81 * passed * passed
}

#[test]
fn a_ball_from_any_height_rebounds_and_its_answer_is_trusted() {
    for height in [1e-3, 1.0, 3e7, 1e9, 1e12] {
        let fall = (2.0 * height / 9.81_f64).sqrt();
        let solution = solve(&ball(height, 0.0, 1.6 * fall, 0.6, json!({"atol": 1e-9 * height})));
        let exact = height_between(height, 0.6, 1.6 * fall);
        assert!((last(&solution, "y") - exact).abs() < 1e-6 * height, "{height}: {} {exact}", last(&solution, "y"));
        assert_trusted(&solution);
    }
}

#[test]
fn elastic_walls_of_any_distance_keep_the_energy() {
    for width in [1.0, 1e4, 1e7, 1e10] {
        let solution = solve(&json!({"problem": {"mechanical": {
            "coordinates": {"x": {"initial": 0.3 * width, "velocity": width}}, "mass": [[1]],
            "contacts": [{"name": "left", "gap": "x", "restitution": 1}, {"name": "right", "gap": format!("{width} - x"), "restitution": 1}]}},
            "time": {"end": 20}, "output": {"times": [20]}}));
        assert_eq!(solution.trajectory.events.len(), 20, "{width}");
        assert!((last(&solution, "x") / width - 0.3).abs() < 1e-6, "{width}: {}", last(&solution, "x"));
        assert_trusted(&solution);
    }
}

#[test]
fn elastic_blocks_count_the_same_whatever_the_horizon() {
    for (ratio, count) in [(1e2, 31), (1e4, 314)] {
        for end in [1e3, 1e8] {
            let solution = solve(&json!({"problem": {"mechanical": {
                "coordinates": {"x": {"initial": 1}, "y": {"initial": 2, "velocity": -1}}, "mass": [[1, 0], [0, ratio]],
                "contacts": [{"name": "wall", "gap": "x", "restitution": 1}, {"name": "blocks", "gap": "y-x", "restitution": 1}]}},
                "time": {"end": end}, "method": {"impacts": "locate"}, "output": {"times": {"count": 2}}}));
            assert_eq!(solution.trajectory.events.len(), count, "{ratio} {end}");
            assert_trusted(&solution);
        }
    }
}

#[test]
fn a_bouncing_ball_that_comes_to_rest_is_trusted() {
    let solution = solve(&ball(1.0, 0.0, 5.0, 0.5, json!({})));
    assert!(last(&solution, "y").abs() < 1e-9);
    assert!(excess(&solution, CheckCode::AccumulationPassed) < 1.0);
    assert_trusted(&solution);
}

#[test]
fn a_floor_that_rises_between_steps_lifts_what_rests_on_it() {
    for (width, height) in [(0.1, 0.05), (0.01, 0.001), (1e-3, 1e-5)] {
        // The rising floor throws the body up: the body detaches when the floor's deceleration exceeds gravity, and
        // must not be below the floor at its highest position.
        let gap = format!("y - {height}*exp(-((t-5)/{width})^2)");
        let spec = json!({"problem": {"mechanical": {"coordinates": {"y": {"initial": 0}}, "mass": [[1]], "potential": "9.81*y",
            "contacts": [{"name": "floor", "gap": gap}]}}, "time": {"end": 10}, "output": {"times": [4, 5, 10]}});
        let solution = solve(&spec);
        let gaps = super::super::harness::column(&solution, "floor_gap");
        assert!(gaps.iter().all(|gap| *gap > -1e-3 * height), "{width}: {gaps:?}");
        assert!(!solution.trajectory.events.is_empty(), "{width}: the body is thrown up and lands");
    }
}

#[test]
fn a_bump_that_is_narrow_beside_a_step_lifts_what_slides() {
    let solution = solve(
        &json!({"problem": {"mechanical": {"coordinates": {"x": {"initial": 0, "velocity": 1}, "y": {"initial": 0}},
        "mass": [[1, 0], [0, 1]], "potential": "9.81*y", "contacts": [{"name": "road", "gap": "y - 0.01*exp(-((x-7.3)/0.2)^2)"}]}},
        "time": {"end": 20}, "output": {"times": {"count": 201}}}),
    );
    // The frictionless bump of the floor dissipates no energy: the body continues at its initial speed.
    let highest = super::super::harness::column(&solution, "y").iter().copied().fold(0.0, f64::max);
    assert!(highest > 0.009, "it passed through the bump: {highest}");
}

#[test]
fn long_steps_are_not_trusted_and_short_ones_are() {
    let trusted = |step: f64| solve(&ball(1.0, 0.0, 0.4, 0.5, json!({"step": step}))).verdict.trusted;
    assert!(trusted(1e-5));
    let solution = solve(&ball(1.0, 0.0, 10.0, 0.5, json!({"step": 0.5})));
    assert_eq!(reasons(&solution), [CheckCode::EnergyBalance, CheckCode::LocalError]);
}

#[test]
fn bodies_at_rest_are_trusted_in_any_units_and_by_both_methods() {
    for (scale, method) in
        [(1e-9, json!({"step": 1e-2})), (1e9, json!({"step": 1e-2})), (1e9, json!({"impacts": "locate"}))]
    {
        let solution =
            solve(&json!({"problem": {"mechanical": {"coordinates": {"a": {"initial": 0}, "b": {"initial": 1}},
            "mass": [[1, 0], [0, scale]], "potential": format!("9.81*(a + {scale}*b)"),
            "contacts": [{"name": "floor", "gap": "a"}, {"name": "between", "gap": "b - a - 1"}]}},
            "time": {"end": 2}, "method": method, "output": {"times": [2]}}));
        assert_trusted(&solution);
    }
}
