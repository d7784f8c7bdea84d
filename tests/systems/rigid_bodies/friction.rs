//! Sliding, rolling and sticking of rigid bodies.

use super::on_the_ground;
use crate::systems::harness::{column, distance, last, solve};
use serde_json::{Value, json};

fn ball(velocity: [f64; 3]) -> Value {
    json!({"name": "ball", "shape": {"sphere": {"radius": 0.1}}, "mass": 1, "position": [0, 0, 0.1], "velocity": velocity})
}

/// Rotates gravity as on a slope of the given angle in degrees, for bodies on the ground.
fn tilted(mut specification: Value, degrees: f64) -> Value {
    let (sine, cosine) = degrees.to_radians().sin_cos();
    specification["problem"]["rigid_bodies"]["gravity"] = json!([9.81 * sine, 0, -9.81 * cosine]);
    specification
}

#[test]
fn a_sliding_ball_rolls_from_the_time_and_with_the_speed_that_momentum_tells() {
    for step in [1e-2, 1e-3] {
        let solution = solve(&on_the_ground(&[ball([2.0, 0.0, 0.0])], &json!({"friction": 0.3}), 1.0, step));
        assert!((last(&solution, "ball.vx") - 10.0 / 7.0).abs() < 1e-10);
        assert!((last(&solution, "ball.wy") - 100.0 / 7.0).abs() < 1e-9);
        // The position x of the ball is of first order: its error is at most v_0 h / 2 with the step size h.
        assert!((last(&solution, "ball.x") - 1.4840472376514315).abs() < step);
        let speed = |t: f64| (2.0 - 0.3 * 9.81 * t).max(10.0 / 7.0);
        assert!(distance(&solution, "ball.vx", speed) < 3.0 * step);
        let lost = last(&solution, "dissipated_by_friction");
        assert!((lost - 2.0 * 0.2857142857142857).abs() < 1e-9, "{lost}");
    }
}

#[test]
fn a_ball_that_slides_at_ten_metres_a_second_never_lifts_off() {
    let solution = solve(&on_the_ground(&[ball([10.0, 0.0, 0.0])], &json!({"friction": 0.3}), 0.5, 1e-3));
    assert!(distance(&solution, "ball.z", |_| 0.1) < 1e-10);
    assert!((last(&solution, "ball.vx") - 8.5285).abs() < 1e-9);
}

#[test]
fn balls_and_disks_roll_down_a_slope_where_friction_allows_and_slide_where_not() {
    let disk = json!({"name": "ball", "shape": {"cylinder": {"radius": 0.1, "length": 0.1}}, "mass": 1,
        "position": [0, 0, 0.1], "orientation": [0.5_f64.sqrt(), 0.5_f64.sqrt(), 0, 0]});
    let cases = [
        (ball([0.0; 3]), 0.17, 3.5035714285714286, 35.035714285714286),
        (ball([0.0; 3]), 0.1, 4.055429078887466, 25.0 * 0.1 * 9.81 * 0.75_f64.sqrt()),
        (disk.clone(), 0.2, 3.27, 32.7),
        (disk, 0.1, 4.055429078887466, 16.991418422250686),
    ];
    for (body, friction, acceleration, angular) in cases {
        let specification = tilted(on_the_ground(&[body], &json!({"friction": friction}), 1.0, 1e-3), 30.0);
        let solution = solve(&specification);
        assert!((last(&solution, "ball.vx") / acceleration - 1.0).abs() < 1e-9, "{friction}");
        assert!(
            (last(&solution, "ball.wy") / angular - 1.0).abs() < 1e-9,
            "{friction}: {}",
            last(&solution, "ball.wy")
        );
        assert!(distance(&solution, "ball.z", |_| 0.1) < 1e-10);
    }
}

#[test]
fn a_block_stops_where_the_circle_of_friction_says() {
    let (sine, cosine) = 25_f64.to_radians().sin_cos();
    let block = json!({"name": "block", "shape": {"box": {"size": [1, 1, 0.1]}}, "mass": 2, "position": [0, 0, 0.05],
        "velocity": [2.0 * cosine, 2.0 * sine, 0]});
    let solution = solve(&on_the_ground(&[block], &json!({"friction": 0.3}), 1.0, 1e-3));
    let (x, y) = (last(&solution, "block.x"), last(&solution, "block.y"));
    assert!((y.atan2(x).to_degrees() - 25.0).abs() < 1e-6);
    assert!((x.hypot(y) - 0.6795786612300374).abs() < 1e-3 && last(&solution, "block.vx").abs() < 1e-12);
}

/// With friction forces from the square with corners `+-mu r_n e_i`, `|v_x| + |v_y|` decreases at the rate `mu g`, at
/// first along one axis.
#[test]
fn a_block_stops_where_a_cone_of_four_edges_says() {
    let (sine, cosine) = 25_f64.to_radians().sin_cos();
    let block = json!({"name": "block", "shape": {"box": {"size": [1, 1, 0.1]}}, "mass": 2, "position": [0, 0, 0.05],
        "velocity": [2.0 * cosine, 2.0 * sine, 0]});
    let contacts = json!({"friction": 0.3, "cone": "polyhedral", "facets": 4});
    let solution = solve(&on_the_ground(&[block], &contacts, 1.0, 1e-3));
    assert!((last(&solution, "block.x") - 0.6795786612300374).abs() < 2e-3, "{}", last(&solution, "block.x"));
    assert!((last(&solution, "block.y") - 0.5205874570975045).abs() < 2e-3, "{}", last(&solution, "block.y"));
    let speed = |t: f64| (2.0 * (sine + cosine) - 0.3 * 9.81 * t).max(0.0);
    let (x, y) = (column(&solution, "block.vx"), column(&solution, "block.vy"));
    for (k, t) in solution.trajectory.t.iter().enumerate() {
        assert!((x[k].abs() + y[k].abs() - speed(*t)).abs() < 4e-3, "{t}");
    }
}

#[test]
fn a_block_on_a_slope_sticks_just_below_the_angle_of_friction_and_slides_just_above() {
    let block = json!({"name": "block", "shape": {"box": {"size": [1, 1, 0.5]}}, "mass": 2, "position": [0, 0, 0.25]});
    let critical = 0.5_f64.atan();
    for factor in [0.999, 1.001] {
        let degrees = (critical * factor).to_degrees();
        let specification = on_the_ground(std::slice::from_ref(&block), &json!({"friction": 0.5}), 2.0, 1e-2);
        let solution = solve(&tilted(specification, degrees));
        let (sine, cosine) = degrees.to_radians().sin_cos();
        let expected = 2.0 * 9.81 * (sine - 0.5 * cosine).max(0.0);
        let creep = column(&solution, "block.vx").iter().map(|v| v.abs()).fold(0.0, f64::max);
        assert!((last(&solution, "block.vx") - expected).abs() < 1e-10, "{factor}: {creep:e} for {expected}");
        assert!(factor > 1.0 || creep < 1e-10, "{creep:e}");
    }
}
