//! Elastic bodies in contact with obstacles: waves compared with d'Alembert's solutions, and bodies in two and three
//! dimensions compared with uniform stress, Coulomb's law and finer grids.

use crate::systems::harness::{column, distance, events, last, solve};
use crate::systems::reference::example;
use dvi::solution::Solution;
use serde_json::{Value, json};
use std::f64::consts::PI;

/// Solves an elastic problem up to the time `end`, with the given tolerance and number of output times.
fn run(elastic: &Value, end: f64, tolerance: f64, times: usize) -> Solution {
    solve(&json!({
        "problem": {"elastic": elastic},
        "time": {"end": end},
        "method": {"rtol": tolerance, "atol": tolerance},
        "output": {"times": {"count": times}}
    }))
}

/// An elastic bar of length 10 and wave speed 30 that moves with velocity -10 towards a wall at a distance of 5.
fn thrown_bar(elements: usize) -> Value {
    json!({
        "body": {"bar": {"x": [0, 10]}}, "elements": elements, "density": 1, "young": 900,
        "contact": {"x_min": {"gap": 5}}, "initial": {"velocity": ["-10"]},
        "probes": {"near": [0], "far": [10]}
    })
}

#[test]
fn a_bar_touches_the_wall_for_the_time_of_a_wave_and_leaves_with_its_speed() {
    let (mut late, mut behind) = (Vec::new(), Vec::new());
    for elements in [100, 400] {
        let solution = run(&thrown_bar(elements), 2.0, 1e-6, 401);
        let [contact, release] = events(&solution, "u(0)")[..] else { panic!("{:?}", solution.trajectory.events) };
        assert!((contact - 0.5).abs() < 1e-8, "{contact}");
        late.push((release - 7.0 / 6.0).abs());
        for (t, force) in solution.trajectory.t.iter().zip(column(&solution, "force_x_min")) {
            if (0.6..1.1).contains(t) {
                assert!((force - 300.0).abs() < 0.5, "{elements}: {force} at {t}");
            }
            assert!(
                (contact..release).contains(t) || force.abs() < 1e-9 || (t - contact).abs() < 0.01,
                "{force} at {t}"
            );
        }
        let errors = ["near", "far"].map(|end| (last(&solution, end) - (10.0 * (2.0 - 7.0 / 6.0) - 5.0)).abs());
        behind.push(errors[0].max(errors[1]));
        let energy = solution.diagnostics.energy.expect("a balance");
        assert!(energy.largest_defect < 1e-3 * 500.0 && energy.kinetic_at_start == 500.0, "{energy:?}");
    }
    // Time stepping spreads a wave front over a width proportional to `h^(2/3)`, where `h` is the size of an element.
    assert!(late[1] < 0.5 * late[0] && late[1] < 2e-3, "{late:?}");
    assert!(behind[1] < 0.5 * behind[0] && behind[1] < 0.05, "{behind:?}");
}

#[test]
fn what_energy_is_lost_is_lost_by_the_steps_alone() {
    let defects = [1e-4, 1e-6, 1e-8].map(|tolerance| {
        let solution = run(&thrown_bar(100), 2.0, tolerance, 2);
        solution.diagnostics.energy.expect("a balance").largest_defect / 500.0
    });
    assert!(defects[0] < 1e-3 && defects[1] < 0.1 * defects[0] && defects[2] < 0.1 * defects[1], "{defects:?}");
}

#[test]
fn a_wall_that_moves_into_a_bar_does_the_work_that_the_bar_takes_up() {
    let bar = json!({
        "body": {"bar": {"x": [0, 10]}}, "elements": 100, "density": 1, "young": 900,
        "contact": {"x_min": {"gap": "-10*t"}}
    });
    // Until the reflected wave returns to the wall, the contact force is the impedance times the velocity, `rho c v`.
    let solution = run(&bar, 0.5, 1e-6, 101);
    for (t, force) in solution.trajectory.t.iter().zip(column(&solution, "force_x_min")) {
        assert!(*t < 0.1 || (force - 300.0).abs() < 1.0, "{force} at {t}");
    }
    let energy = solution.diagnostics.energy.expect("a balance");
    assert!((energy.work_of_forces - 1500.0).abs() < 0.01 * 1500.0, "{energy:?}");
    let gained = energy.kinetic_at_end + energy.potential_at_end;
    assert!((gained - energy.work_of_forces).abs() < 1e-3 * gained, "{energy:?}");
}

/// A string of length 1 with wave speed 1, fixed at both ends, above an obstacle on the interval `between`.
fn string(elements: usize, between: [f64; 2], initial: &Value) -> Value {
    json!({
        "body": {"string": {"x": [0, 1]}}, "elements": elements, "density": 1, "tension": 1,
        "clamped": ["x_min", "x_max"], "contact": {"below": {"gap": 0, "between": between}},
        "initial": initial, "probes": {"middle": [0.5], "quarter": [0.25]}
    })
}

#[test]
fn a_string_is_thrown_back_by_a_flat_obstacle_as_a_whole() {
    let errors = [40, 80].map(|elements| {
        let initial = json!({"displacement": ["sin(pi*x)"]});
        let solution = run(&string(elements, [0.0, 1.0], &initial), 2.0, 1e-6, 201);
        let energy = solution.diagnostics.energy.expect("a balance");
        assert!(energy.largest_defect < 1e-4 * PI * PI / 4.0, "{energy:?}");
        let middle = distance(&solution, "middle", |t| (PI * t).cos().abs());
        let quarter = distance(&solution, "quarter", |t| (PI * t).cos().abs() * (PI / 4.0).sin());
        middle.max(quarter)
    });
    // A node of the string between two fixed ones turns back after `pi h`, twice: the error is of first order in the
    // element size `h`.
    assert!(errors[1] < 0.3 && (1.8..2.2).contains(&(errors[0] / errors[1])), "{errors:?}");
}

#[test]
fn a_string_that_falls_on_a_point_is_held_by_it_until_its_halves_turn_back() {
    let solution = run(&string(160, [0.5, 0.5], &json!({"velocity": ["-1"]})), 3.0, 1e-6, 601);
    let found = events(&solution, "u(80)");
    assert!(found.len() == 3, "{found:?}");
    for (found, exact) in found.iter().zip([0.5, 1.5, 2.0]) {
        assert!((found - exact).abs() < 0.015, "{found} {exact}");
    }
    let forces = || solution.trajectory.t.iter().copied().zip(column(&solution, "force_below").iter().copied());
    for (t, force) in forces() {
        assert!(!(0.1..0.4).contains(&t) || (force - 2.0).abs() < 0.01, "{force} at {t}");
        assert!(!(0.55..1.45).contains(&t) && t < 2.05 || force.abs() < 1e-9, "{force} at {t}");
    }
    // By t = 1.6 the jumps of the velocity have become wave trains, as on any grid, so that only the mean force is
    // comparable.
    let second: Vec<f64> = forces().filter(|(t, _)| (1.6..1.9).contains(t)).map(|(_, force)| force).collect();
    let mean = second.iter().sum::<f64>() / second.len() as f64;
    assert!((mean - 2.0).abs() < 0.04, "{mean}");
    // Closed form at t = 1: the string, thrown upwards, is a trapezoid whose height at the middle is 1/2.
    let at = |t: f64| solution.trajectory.t.iter().position(|&found| (found - t).abs() < 1e-9).expect("a time");
    assert!((column(&solution, "middle")[at(1.0)] - 0.5).abs() < 0.02);
    assert!((column(&solution, "quarter")[at(1.0)] - 0.25).abs() < 0.02);
    assert!((column(&solution, "quarter")[at(0.25)] + 0.25).abs() < 0.02);
}

/// Returns the final state of rest of a unit square or cube with Young's modulus 1000 and Poisson's ratio 0.3 on a
/// floor, under the pressure 10 on its top.
fn pressed(body: &Value, elements: &[usize], floor: &str, top: &str) -> Value {
    let counts: serde_json::Map<String, Value> =
        ["x", "y", "z"].iter().zip(elements).map(|(key, &n)| ((*key).to_owned(), n.into())).collect();
    let mut down = vec![0.0; elements.len()];
    *down.last_mut().expect("a direction") = -10.0;
    json!({
        "body": body, "elements": counts, "density": 1e-3, "young": 1000, "poisson": 0.3, "viscosity": 100,
        "traction": {top: down}, "contact": {floor: {"gap": 0}},
        "probes": {"left": vec![0; elements.len()], "right": vec![1; elements.len()]}
    })
}

#[test]
fn uniform_stress_passes_through_a_contact_exactly() {
    let square = json!({"rectangle": {"x": [0, 1], "y": [0, 1], "plane": "strain"}});
    let solution = run(&pressed(&square, &[3, 4], "y_min", "y_max"), 4.0, 1e-6, 2);
    let close = |value: f64, exact: f64| assert!((value - exact).abs() < 1e-11, "{value} {exact}");
    close(last(&solution, "force_y_min"), 10.0);
    close(last(&solution, "right_y"), -0.0091);
    close(last(&solution, "right_x") - last(&solution, "left_x"), 0.0039);

    let plate = json!({"rectangle": {"x": [0, 1], "y": [0, 1], "plane": "stress"}});
    let solution = run(&pressed(&plate, &[3, 4], "y_min", "y_max"), 4.0, 1e-6, 2);
    close(last(&solution, "right_y"), -0.01);

    let cube = json!({"box": {"x": [0, 1], "y": [0, 1], "z": [0, 1]}});
    let solution = run(&pressed(&cube, &[1, 2, 2], "z_min", "z_max"), 4.0, 1e-6, 2);
    close(last(&solution, "force_z_min"), 10.0);
    close(last(&solution, "right_z"), -0.01);
    close(last(&solution, "right_y") - last(&solution, "left_y"), 0.003);
}

/// An elastic block that falls onto a cylindrical floor of radius 1, deformed enough to touch it away from the middle.
fn dropped_block(columns: usize, viscosity: f64) -> Value {
    json!({
        "body": {"rectangle": {"x": [-1, 1], "y": [0, 1], "plane": "strain"}}, "elements": {"x": columns, "y": columns / 2},
        "density": 1, "young": 100, "poisson": 0.3, "viscosity": viscosity,
        "contact": {"y_min": {"gap": "0.02 + x^2/2"}}, "initial": {"velocity": [0, "-1"]},
        "probes": {"top": [0, 1]}
    })
}

#[test]
fn a_viscoelastic_block_on_a_curved_floor_tends_to_one_motion_as_its_elements_shrink() {
    let solutions = [4, 8, 16].map(|columns| run(&dropped_block(columns, 2.0), 0.6, 1e-5, 61));
    let top = |k: usize| column(&solutions[k], "top_y");
    let apart = |a: usize, b: usize| top(a).iter().zip(top(b)).fold(0.0_f64, |most, (a, b)| most.max((a - b).abs()));
    assert!(apart(1, 2) < 0.6 * apart(0, 1) && apart(1, 2) < 0.02, "{} {}", apart(0, 1), apart(1, 2));
    for solution in &solutions {
        assert!(column(solution, "force_y_min").iter().all(|force| *force >= -1e-9));
        let energy = solution.diagnostics.energy.expect("a balance");
        assert!(energy.dissipated_by_viscosity > 0.1 * energy.kinetic_at_start, "{energy:?}");
        assert!(energy.largest_defect < 0.01 * energy.kinetic_at_start, "{energy:?}");
    }
}

#[test]
fn without_viscosity_the_block_keeps_its_energy_and_its_uniqueness_is_said_to_be_open() {
    let solution = run(&dropped_block(6, 0.0), 0.4, 1e-6, 2);
    let energy = solution.diagnostics.energy.expect("a balance");
    assert!(energy.largest_defect < 1e-4 * energy.kinetic_at_start, "{energy:?}");
    assert!(solution.diagnostics.warnings.iter().any(|warning| warning.code == "uniqueness_open"));
    let viscous = run(&dropped_block(6, 2.0), 0.01, 1e-4, 2);
    assert!(viscous.diagnostics.warnings.iter().all(|warning| warning.code != "uniqueness_open"));
}

/// An elastic block of mass 2 on a rough floor, with a load of 20 on its top and a horizontal force that rises to
/// `push` on its left side.
fn pushed_block(viscosity: f64, push: f64) -> Value {
    json!({
        "body": {"rectangle": {"x": [0, 2], "y": [0, 1], "plane": "strain"}}, "elements": {"x": 4, "y": 2},
        "density": 1, "young": 1000, "poisson": 0.3, "viscosity": viscosity,
        "traction": {"y_max": [0, "-10*min(t/0.2, 1)"], "x_min": [format!("{push}*min(t/2, 1)"), 0]},
        "contact": {"y_min": {"gap": 0, "friction": 0.3}}, "probes": {"corner": [2, 1]}
    })
}

#[test]
fn a_block_on_a_rough_floor_sticks_below_the_limit_of_coulomb_and_slides_above_it() {
    let stuck = run(&pushed_block(50.0, 4.0), 4.0, 1e-6, 41);
    assert!((last(&stuck, "force_y_min") - 20.0).abs() < 0.02, "{}", last(&stuck, "force_y_min"));
    assert!((last(&stuck, "friction_y_min_x") + 4.0).abs() < 0.02, "{}", last(&stuck, "friction_y_min_x"));
    assert!(last(&stuck, "corner_x") < 0.02);

    let sliding = run(&pushed_block(50.0, 10.0), 4.0, 1e-6, 41);
    assert!((last(&sliding, "friction_y_min_x") + 0.3 * last(&sliding, "force_y_min")).abs() < 1e-6);
    // By the momentum balance of the whole body, its acceleration from t = 3 to t = 4 is (10 - 0.3 20)/2.
    let x = column(&sliding, "corner_x");
    let acceleration = (x[40] - 2.0 * x[35] + x[30]) / 0.25;
    assert!((acceleration - 2.0).abs() < 0.05, "{acceleration}");
    let energy = sliding.diagnostics.energy.expect("a balance");
    assert!(energy.dissipated_by_friction > 1.0 && energy.largest_defect < 0.01 * energy.work_of_forces, "{energy:?}");
}

#[test]
fn a_pressed_and_pushed_block_ends_where_another_program_has_it_at_every_tolerance() {
    // Reference for the block from tests/peers/answers/viscoelastic_block.py: the same finite elements with implicit
    // Euler, extrapolated to seven digits.
    let answers = [("pushed_corner_x", 0.0194062942), ("pushed_corner_y", -0.0044296766), ("foot_x", 0.0121661748)];
    for rtol in [1e-3, 1e-4, 1e-5] {
        let mut block = example("viscoelastic_block");
        block["method"] = json!({"rtol": rtol});
        let solution = solve(&block);
        for (name, answer) in answers {
            let error = (last(&solution, name) / answer - 1.0).abs();
            assert!(error < 10.0 * rtol, "{name} at {rtol:e}: off by {error:e}");
        }
        // Before the load arrives, contact forces and gaps are rounding noise, which must not shorten the steps.
        assert!(solution.diagnostics.steps.accepted < 1000, "{:?}", solution.diagnostics.steps);
    }
}
