//! Boxes that land on their edges and faces, with located impacts: the corners of a face that tilts about one of its
//! edges land at the same time despite errors of their heights, and four feet on a floor carry the same loads in
//! every run.

use super::{locate, on_the_ground};
use crate::systems::harness::{column, last, solve};
use dvi::problem::EventKind;
use dvi::solution::Solution;
use nalgebra::{Quaternion, UnitQuaternion, Vector3};
use serde_json::json;

const G: f64 = 9.81;

/// A block that rocks on its edges loses at each landing the fraction of its angular velocity that Housner (1963)
/// gives, whatever its heading.
#[test]
fn a_block_rocks_as_housner_says() {
    let (width, depth, height) = (0.1_f64, 0.17, 0.27);
    let (r, alpha) = (0.5 * width.hypot(height), (width / height).atan());
    let (tilt, yaw) = (0.5 * alpha, 0.7);
    let turn = UnitQuaternion::from_axis_angle(&Vector3::z_axis(), yaw)
        * UnitQuaternion::from_axis_angle(&Vector3::y_axis(), tilt);
    let centre = -(turn * Vector3::new(0.5 * width, 0.0, -0.5 * height));
    let q: &Quaternion<f64> = &turn;
    let block = json!({"name": "block", "shape": {"box": {"size": [width, depth, height]}}, "mass": 1,
        "position": [centre.x, centre.y, centre.z], "orientation": [q.w, q.i, q.j, q.k]});
    let inertia = 4.0 / 3.0 * r * r;
    let kept = (1.0 - 1.5 * alpha.sin().powi(2)).powi(2);
    let landing = G * r * ((alpha - tilt).cos() - alpha.cos());
    let errors = [0.02, 0.0025].map(|step| {
        let solution =
            solve(&locate(on_the_ground(std::slice::from_ref(&block), &json!({"friction": 1.0}), 0.6, step)));
        assert!(solution.verdict.trusted, "{:?}", solution.verdict);
        let landings = solution.trajectory.events.iter().filter(|event| event.kind == EventKind::Impact).count();
        assert_eq!(landings, 2, "{:?}", solution.trajectory.events);
        let of = |key: &str| last(&solution, &format!("block.{key}"));
        let spin = Vector3::new(of("wx"), of("wy"), of("wz")).norm_squared();
        let energy = 0.5 * inertia * spin + G * (of("z") - 0.5 * height);
        (energy / (landing * kept * kept) - 1.0).abs()
    });
    // With a method of first order, steps eight times as short would reduce the error of the rocking block by a factor
    // of eight only.
    assert!(errors[0] < 3e-3 && errors[1] < errors[0] / 16.0, "{errors:?}");
}

/// Whether the positions of a box in two runs differ by at most the fraction `part` of how far it moves.
fn are_within(part: f64, found: &Solution, exact: &Solution) -> bool {
    ["b.x", "b.y", "b.z"].into_iter().all(|key| {
        let [found, exact] = [found, exact].map(|solution| column(solution, key));
        let range = exact.iter().fold(0.0_f64, |most, x| most.max((x - exact[0]).abs()));
        found.iter().zip(exact).all(|(found, exact)| (found - exact).abs() <= part * range)
    })
}

/// A box that has rattled from foot to foot and slid on all four feet, compared with a run with steps fifty times as
/// short.
#[test]
fn a_box_that_rattles_to_rest_follows_one_path_at_every_step() {
    let scenes = [
        ([0.115, 0.247, 0.114], [-0.574, 0.536, 0.0], [-1.055, -6.938, -0.567], 1.0),
        ([0.2, 0.12, 0.092], [0.6, 0.3, 0.0], [2.5, -4.0, 1.5], 0.3),
        ([0.15, 0.26, 0.21], [0.8, -0.4, 0.0], [-3.1, 1.7, -5.2], 0.3),
        ([0.28, 0.1, 0.16], [-0.2, 0.9, 0.0], [5.5, 2.0, 3.0], 0.3),
    ];
    for (size, velocity, spin, friction) in scenes {
        let solve_at = |step: f64| {
            let body = json!({"name": "b", "shape": {"box": {"size": size}}, "mass": 1, "position": [0.0, 0.0, 0.4],
                "velocity": velocity, "angular_velocity": spin});
            let law = json!({"friction": friction, "restitution": 0.0});
            let mut specification = locate(on_the_ground(&[body], &law, 0.9, step));
            specification["output"] = json!({"times": {"count": 91}});
            solve(&specification)
        };
        let [coarse, fine] = [0.003, 6e-5].map(solve_at);
        assert!(are_within(5e-3, &coarse, &fine), "{size:?}");
    }
}

/// Boxes whose corners meet the floor within a very short time. If steps do not resolve the order of the impacts, two
/// runs with the same wrong order agree to a thousandth, although both are off by several hundredths.
#[test]
fn an_order_of_impacts_that_steps_do_not_resolve_is_right_or_doubted() {
    let flat = [1.0, 0.0, 0.0, 0.0];
    let turned = [0.9906349564455431, 0.02171413224381259, 0.034984724301912726, -0.13018044628343528];
    let scenes = [
        (0.01, 1.0, [0.103, 0.146, 0.286], [0.52, -0.197, 0.0], [-1.017, 2.605, -3.095], flat),
        (0.003, 0.3, [0.259, 0.189, 0.166], [0.235, 0.23, 0.0], [5.606, -5.673, -3.895], turned),
    ];
    for (step, friction, size, velocity, spin, orientation) in scenes {
        let solve_at = |step: f64| {
            let body = json!({"name": "b", "shape": {"box": {"size": size}}, "mass": 1, "position": [0.0, 0.0, 0.4],
                "orientation": orientation, "velocity": velocity, "angular_velocity": spin});
            let law = json!({"friction": friction, "restitution": 0.6});
            let mut specification = locate(on_the_ground(&[body], &law, 0.9, step));
            specification["output"] = json!({"times": {"count": 91}, "fields": ["b.x", "b.y", "b.z"]});
            solve(&specification)
        };
        let [coarse, fine] = [step, 5e-5].map(solve_at);
        assert!(are_within(1e-2, &coarse, &fine) || !coarse.verdict.trusted, "{size:?} {:?}", coarse.verdict);
    }
}

#[test]
fn a_body_that_a_floor_holds_against_forces_that_vary_is_where_it_is() {
    // A constant weight of 10 presses the sphere on the floor, more than any of the varying forces lifts it.
    for force in ["sin(6*t)", "pulse(t, 0.5, 0.1)", "4*t*(1 - t)"] {
        let solution = solve(&json!({"problem": {"rigid_bodies": {"gravity": [0, 0, -10],
                "bodies": [{"name": "floor", "shape": {"half_space": {"normal": [0, 0, 1]}}, "fixed": true},
                    {"name": "b", "shape": {"sphere": {"radius": 1}}, "mass": 1, "position": [0, 0, 1]}],
                "contacts": {"friction": 0.3}, "forces": [{"body": "b", "force": [0, 0, force]}]}},
            "time": {"end": 1}, "method": {"step": 0.001}}));
        assert!(solution.verdict.trusted, "{force} {:?}", solution.verdict);
        for (name, exact) in [("b.x", 0.0), ("b.y", 0.0), ("b.z", 1.0)] {
            assert!((last(&solution, name) - exact).abs() < 1e-12, "{force}: {name} {}", last(&solution, name));
        }
    }
}
