//! Events between rigid bodies, such as impacts and transitions between stick and slip, and their times.

use super::{falling_on_each_other, on_the_ground, stepped};
use crate::systems::harness::{column, solve};
use dvi::problem::EventKind;
use dvi::solution::Solution;
use serde_json::{Value, json};

const G: f64 = 9.81;

fn ball(position: [f64; 3], velocity: [f64; 3]) -> Value {
    json!({"name": "ball", "shape": {"sphere": {"radius": 0.1}}, "mass": 1, "position": position, "velocity": velocity})
}

fn told(solution: &Solution) -> Vec<(EventKind, &str, f64)> {
    solution.trajectory.events.iter().map(|event| (event.kind, event.of.as_str(), event.t)).collect()
}

/// A ball dropped from a height of 1 has impacts at `t_1 = sqrt(2/g)`, and then each `2 e^k g t_1 / g` after the
/// previous one.
#[test]
fn a_bouncing_ball_tells_every_impact_and_then_rests_in_silence() {
    let (h, e) = (1e-4, 0.8_f64);
    let solution =
        solve(&stepped(on_the_ground(&[ball([0.0, 0.0, 1.1], [0.0; 3])], &json!({"restitution": e}), 6.0, h)));
    let found = told(&solution);
    assert!(found.iter().all(|(kind, of, _)| *kind == EventKind::Impact && *of == "ground and ball"), "{found:?}");
    let first = (2.0 / G).sqrt();
    let mut t = first;
    for (k, event) in found.iter().enumerate().take(20) {
        assert!((event.2 - t).abs() <= h * (1.0 + 2.0 * k as f64), "{k}: {} {t}", event.2);
        t += 2.0 * e.powi(k as i32 + 1) * first;
    }
    assert!(found[0].2 >= first && found[0].2 < first + h);
    // All impacts of the ball are over by t_1 (1 + e) / (1 - e); impacts no faster than the velocity that gravity adds
    // in one step are not reported.
    let last = first * (1.0 + e) / (1.0 - e);
    assert!(found.len() > 25 && found.len() < 60 && found.iter().all(|event| event.2 < last + 0.01), "{}", found.len());
}

/// A ball that slides with the velocity `v` begins to roll after `2 v / (7 mu g)`.
#[test]
fn a_sliding_ball_tells_when_it_begins_to_roll_and_when_it_leaves_the_edge() {
    let table = json!({"name": "table", "shape": {"box": {"size": [4, 1, 0.2]}}, "fixed": true,
        "position": [0, 0, 1.9]});
    let mut specification =
        on_the_ground(&[table, ball([0.0, 0.0, 2.1], [2.8, 0.0, 0.0])], &json!({"friction": 0.3}), 1.7, 1e-3);
    specification["output"]["times"] = json!("steps");
    let solution = solve(&specification);
    let found = told(&solution);
    let kinds: Vec<_> = found.iter().map(|event| (event.0, event.1)).collect();
    let expected = [
        (EventKind::Stick, "table and ball"),
        (EventKind::LiftOff, "table and ball"),
        (EventKind::Impact, "ground and ball"),
    ];
    assert_eq!(kinds[..3], expected, "{found:?}");
    assert!((found[0].2 - 2.0 * 2.8 / (7.0 * 0.3 * G)).abs() < 2e-3, "{found:?}");
    // The ball rolls at 2 m/s over the edge at x = 2, too fast to rotate about it, and falls 2 m.
    let x = |t: f64| {
        let k = solution.trajectory.t.iter().position(|&at| at >= t).unwrap();
        column(&solution, "ball.x")[k]
    };
    assert!((x(found[1].2) - 2.0).abs() < 6e-3, "{}", x(found[1].2));
    assert!((found[2].2 - found[1].2 - (4.0 / G).sqrt()).abs() < 5e-3, "{found:?}");
}

#[test]
fn a_stack_at_rest_has_nothing_to_tell() {
    let cube = |k: usize| {
        json!({"name": format!("b{k}"), "shape": {"box": {"size": [1, 1, 1]}}, "mass": if k == 4 { 1e3 } else { 1.0 },
            "position": [0, 0, 0.5 + k as f64]})
    };
    let bodies: Vec<Value> = (0..5).map(cube).collect();
    let solution = solve(&on_the_ground(&bodies, &json!({"friction": 0.6, "restitution": 0.3}), 1.0, 1e-3));
    assert_eq!(told(&solution), []);
}

/// A block on a slope of 3:4 sticks for a friction coefficient `mu > 3/4`; pushed down the slope at the speed `v` it
/// stops after `v / (mu g cos - g sin)`.
#[test]
fn a_block_that_is_pushed_down_a_slope_tells_when_it_sticks() {
    let block = json!({"name": "block", "shape": {"box": {"size": [0.4, 0.4, 0.2]}}, "mass": 3,
        "position": [0.06, 0, 0.08], "orientation": [0.9486832980505138, 0, 0.31622776601683794, 0],
        "velocity": [0.8, 0, -0.6]});
    let mut specification = on_the_ground(&[block], &json!({"friction": 0.9}), 1.2, 1e-3);
    specification["problem"]["rigid_bodies"]["bodies"][0]["shape"]["half_space"]["normal"] = json!([0.6, 0, 0.8]);
    let solution = solve(&specification);
    let found = told(&solution);
    assert_eq!(found.len(), 1, "{found:?}");
    assert_eq!((found[0].0, found[0].1), (EventKind::Stick, "ground and block"));
    assert!((found[0].2 - 1.0 / (0.9 * G * 0.8 - G * 0.6)).abs() < 2e-3, "{found:?}");
}

#[test]
fn bodies_that_fall_on_each_other_tell_their_impacts_and_fall_silent() {
    let solution = solve(&falling_on_each_other());
    let found = told(&solution);
    for k in 0..4 {
        let strikes =
            |event: &&(EventKind, &str, f64)| event.0 == EventKind::Impact && event.1.contains(&format!("b{k}"));
        assert!(found.iter().filter(strikes).count() > 0, "b{k} strikes nothing: {found:?}");
    }
    assert!(found.iter().all(|event| event.2 < 4.5) && found.len() < 200, "{found:?}");
}

#[test]
fn of_more_events_than_anyone_reads_the_first_are_told_and_the_others_counted() {
    let bodies: Vec<Value> = (0..40)
        .map(|k| {
            json!({"shape": {"sphere": {"radius": 0.1}}, "mass": 1, "position": [f64::from(k), 0.0, 0.11],
                "name": format!("b{k}")})
        })
        .collect();
    let solution = solve(&on_the_ground(&bodies, &json!({"restitution": 1}), 30.0, 1e-3));
    assert_eq!(solution.trajectory.events.len(), 10_000);
    let warning = solution.diagnostics.warnings.iter().find(|warning| warning.code == "events_left_out").unwrap();
    let count: f64 = warning.message.split(' ').find_map(|word| word.parse().ok()).unwrap();
    // Each flight of a ball up to the height H lasts 2 sqrt(2 H / g).
    let expected = 40.0 * 30.0 / (2.0 * (0.02 / G).sqrt());
    assert!((count / expected - 1.0).abs() < 0.03, "{count} {expected}");
}
