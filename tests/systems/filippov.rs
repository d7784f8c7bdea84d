//! Filippov systems: crossing of a switching surface, sliding along one, a repulsive surface, and three regions that
//! meet.

use crate::systems::harness::{column, distance, events, last, solve};
use crate::systems::reference::{digits, example, switching};
use dvi::specification::Specification;
use serde_json::{Value, json};

fn filippov(problem: Value, end: f64) -> Value {
    json!({"problem": {"filippov": problem}, "time": {"end": end}, "method": {"rtol": 1e-10}, "output": {"times": {"count": 201}}})
}

#[test]
fn the_switching_circle_is_crossed_at_one() {
    let end = switching("switching_circle")["T"].as_f64().expect("a time");
    let solution = solve(&example("switching_circle"));
    let turn = std::f64::consts::TAU * (end - 1.0);
    let exact = [(end - 1.0).exp() * turn.cos(), -(end - 1.0).exp() * turn.sin()];
    for (state, exact) in ["x", "y"].iter().zip(exact) {
        let error = (last(&solution, state) - exact).abs();
        assert!(error < 1e-9, "`{state}` is off by {error:e}");
    }
    assert!((events(&solution, "z")[0] - 1.0).abs() < 1e-10);
    // The weight of the convex combination of the two vector fields is 0 before the crossing of the surface and 1 after
    // it, with no value in between.
    for (&t, &z) in solution.trajectory.t.iter().zip(column(&solution, "z")) {
        assert_eq!(z, if t < 1.0 { 0.0 } else { 1.0 }, "at {t}");
    }
}

#[test]
fn the_sliding_mode_is_that_of_its_two_regions() {
    let reference = switching("sliding_mode");
    let solution = solve(&filippov(
        json!({
            "states": {
                "x1": {"initial": 1, "plus": "x2", "minus": "x2"},
                "x2": {"initial": 0, "plus": "x1/2 - 2", "minus": "x1/2 + 2"}
            },
            "surface": "x1 + x2"
        }),
        5.0,
    ));
    for (k, state) in ["x1", "x2"].iter().enumerate() {
        let error = (last(&solution, state) - digits(&reference["x_T"][k])).abs();
        assert!(error < 1e-9, "`{state}` is off by {error:e}");
    }
    assert!((events(&solution, "z")[0] - digits(&reference["t_hit"])).abs() < 1e-9);
}

#[test]
fn the_relay_slides_with_the_share_that_holds_it() {
    let solution = solve(&filippov(
        json!({"states": {"x": {"initial": 2, "plus": "0.3 - 1", "minus": "0.3 + 1"}}, "surface": "x"}),
        5.0,
    ));
    let reach = 2.857_142_857_142_857;
    let error = distance(&solution, "x", |t| (2.0 - 0.7 * t).max(0.0));
    assert!(error < 1e-10, "off by {error:e}");
    assert!((events(&solution, "z")[0] - reach).abs() < 1e-10);
    // In the sliding mode, 0.3 = s = (1 - z) - z determines the weight z of one of the two vector fields.
    assert!((last(&solution, "z") - 0.35).abs() < 1e-12);
}

#[test]
fn three_regions_by_name_are_the_three_regions_in_full() {
    let (full, c, s) = (solve(&example("three_regions")), "1/2", "sqrt(3)/2");
    let solution = solve(&filippov(
        json!({
            "parameters": {"c": c, "s": s},
            "states": {"x": {"initial": 2}, "y": {"initial": 1}},
            "regions": [
                {"indicator": "-x", "rates": {"x": -1, "y": 0}},
                {"indicator": "c*x - s*y", "rates": {"y": "-s", "x": "c"}},
                {"indicator": "c*x + s*y", "rates": {"x": "c", "y": "s"}}
            ]
        }),
        5.0,
    ));
    let line = 2.0 - 1.0 / 3.0_f64.sqrt();
    assert!((events(&solution, "z2")[0] - line).abs() < 1e-8);
    assert!((events(&full, "z2")[0] - line).abs() < 1e-5);
    // The solution slides along the line between the first two regions at half speed, to the point where all three
    // meet.
    let origin = 2.0 + 3.0_f64.sqrt();
    let error = distance(&solution, "x", |t| if t < line { 2.0 - t } else { (origin - t).max(0.0) / 4.0 });
    assert!(error < 1e-7, "off by {error:e}");
    for name in ["z1", "z2", "z3"] {
        assert!((last(&solution, name) - 1.0 / 3.0).abs() < 1e-7, "`{name}` ends at {}", last(&solution, name));
    }
}

#[test]
fn a_surface_that_repels_is_warned_of_only_where_the_start_is_on_it() {
    let codes = |initial: f64, plus: f64, minus: f64| -> Vec<&str> {
        let states = json!({"x": {"initial": initial, "plus": plus, "minus": minus}});
        let text = filippov(json!({"states": states, "surface": "x"}), 1.0).to_string();
        let specification = Specification::from_json(text.as_bytes()).expect("a right specification");
        specification.model().warnings().iter().map(|warning| warning.code).collect()
    };
    assert_eq!(codes(0.0, 1.0, -1.0), ["repulsive_sliding"]);
    assert_eq!(codes(0.1, 1.0, -1.0), [""; 0]);
    assert_eq!(codes(0.0, -1.0, 1.0), [""; 0]);
    assert_eq!(codes(0.0, 1.0, 2.0), [""; 0]);
}
