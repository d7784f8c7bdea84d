//! The energy balance with moving surfaces, belts and joints, and with potentials and masses that depend on time.

use super::{located, stepped};
use crate::systems::harness::{column, last, solve};
use dvi::solution::Solution;
use serde_json::{Value, json};

/// Returns energies of a mechanical system at the end: kinetic plus potential energy, work of drives, energy dissipated
/// by friction, and energy lost in impacts.
fn balance(solution: &Solution) -> [f64; 4] {
    let energy = last(solution, "kinetic_energy") + last(solution, "potential_energy");
    let [drives, friction, impacts] =
        ["work_of_drives", "dissipated_by_friction", "lost_in_impacts"].map(|name| last(solution, name));
    let told = solution.diagnostics.energy.expect("a balance");
    assert_eq!([told.work_of_drives, told.dissipated_by_friction, told.lost_in_impacts], [drives, friction, impacts]);
    [energy, drives, friction, impacts]
}

/// Asserts the energy balance of a mechanical problem at the end: up to rounding with located impacts, and convergent
/// with time stepping.
fn assert_balance(problem: &Value, end: f64, expected: [f64; 4]) {
    let size = expected.iter().fold(1.0_f64, |most, x| most.max(x.abs()));
    let off = |solution: &Solution| {
        let found = balance(solution);
        let defect = solution.diagnostics.energy.expect("a balance").largest_defect;
        let errors = found.iter().zip(expected).map(|(found, expected)| (found - expected).abs());
        (errors.fold(defect, f64::max) / size, found)
    };
    let (exact, found) = off(&located(problem.clone(), end));
    assert!(exact < 1e-8, "{found:?}, not {expected:?}");
    for h in [1e-2, 1e-3, 1e-4] {
        let (error, found) = off(&stepped(problem.clone(), end, h));
        assert!(error < 30.0 * h, "h = {h}: {found:?}, not {expected:?}");
    }
}

#[test]
fn a_belt_gives_a_block_as_much_as_friction_takes() {
    // The friction force mu m g accelerates the block to the velocity of the belt: half of the belt's work is
    // dissipated by friction.
    let belt = json!({"coordinates": {"x": {"initial": 0}, "y": {"initial": 0}}, "mass": [[2, 0], [0, 2]],
        "potential": "2*9.81*y",
        "contacts": [{"name": "belt", "gap": "y", "friction": {"coefficient": 0.3, "slip": ["x_dot - 1"]}}]});
    assert_balance(&belt, 1.0, [1.0, 2.0, 1.0, 0.0]);
}

#[test]
fn a_block_held_on_a_belt_by_a_spring_loses_what_the_belt_does() {
    // On the belt the block approaches the equilibrium position mu m g / k of its spring only asymptotically, so that
    // it is released there, and stays.
    let held = json!({"coordinates": {"x": {"initial": "0.3*2*9.81/5"}, "y": {"initial": 0}}, "mass": [[2, 0], [0, 2]],
        "potential": "2*9.81*y + 5*x^2/2",
        "contacts": [{"name": "belt", "gap": "y", "friction": {"coefficient": 0.3, "slip": ["x_dot - 4"]}}]});
    let stretched = 0.5 * (0.3_f64 * 2.0 * 9.81).powi(2) / 5.0;
    let work = 0.3 * 2.0 * 9.81 * 4.0;
    assert_balance(&held, 1.0, [stretched, work, work, 0.0]);
}

#[test]
fn the_balance_is_told_within_steps() {
    let belt = json!({"coordinates": {"x": {"initial": 0}, "y": {"initial": 0}}, "mass": [[2, 0], [0, 2]],
        "potential": "2*9.81*y", "forces": {"x": "0.1"},
        "contacts": [{"name": "belt", "gap": "y", "friction": {"coefficient": 0.3, "slip": ["x_dot - 10"]}}]});
    let a = 0.3 * 9.81 + 0.05;
    let document = |method: Value| json!({"problem": {"mechanical": belt}, "time": {"end": 1}, "method": method, "output": {"times": {"count": 51}}});
    for (method, tolerance) in [(json!({"impacts": "locate"}), 1e-9), (json!({"step": 0.015}), 0.05)] {
        let solution = solve(&document(method));
        for (k, t) in solution.trajectory.t.iter().enumerate() {
            let (work, drives) = (0.1 * 0.5 * a * t * t, 0.3 * 2.0 * 9.81 * 10.0 * t);
            let friction = 0.3 * 2.0 * 9.81 * (10.0 * t - 0.5 * a * t * t);
            for (name, exact) in
                [("work_of_forces", work), ("work_of_drives", drives), ("dissipated_by_friction", friction)]
            {
                let found = column(&solution, name)[k];
                assert!((found - exact).abs() < tolerance, "{name} at {t}: {found}, not {exact}");
            }
        }
    }
}

#[test]
fn a_wall_that_moves_works_in_every_impact() {
    for e in [1.0, 0.8] {
        let box_that_shrinks = json!({"parameters": {"e": e}, "coordinates": {"x": {"initial": 0.5, "velocity": 3}},
            "mass": [[1]], "contacts": [{"name": "still", "gap": "x", "restitution": "e"},
                                        {"name": "moving", "gap": "1 - 0.2*t - x", "restitution": "e"}]});
        let (mut t, mut x, mut v, mut work, mut lost) = (0.0, 0.5, 3.0, 0.0, 0.0);
        let end = 1.9;
        loop {
            let (next, wall) = if v > 0.0 { ((1.0 - 0.2 * t - x) / (v + 0.2), -0.2) } else { (x / -v, 0.0) };
            if t + next > end {
                break;
            }
            (t, x) = (t + next, x + v * next);
            let after = wall - e * (v - wall);
            let loss = 0.5 * (1.0 - e * e) * (v - wall) * (v - wall);
            work += 0.5 * (after * after - v * v) + loss;
            lost += loss;
            v = after;
        }
        assert!(work > 1.0, "{work}");
        assert_balance(&box_that_shrinks, end, [0.5 * v * v, work, 0.0, lost]);
    }
}

#[test]
fn a_spring_whose_end_is_pulled_gives_what_the_hand_does() {
    // With y = x - t/10, the displacement relative to the moving end of the spring, the solution is y = -sin(2 t)/20.
    let pulled = json!({"coordinates": {"x": {"initial": 0}}, "mass": [[1]], "potential": "0.5*4*(x - 0.1*t)^2", "contacts": []});
    let (v, y) = (0.1 - 0.1 * 2.0_f64.cos(), -0.05 * 2.0_f64.sin());
    let energy = 0.5 * v * v + 2.0 * y * y;
    assert_balance(&pulled, 1.0, [energy, energy, 0.0, 0.0]);
}

#[test]
fn a_cart_on_a_given_course_drags_what_lies_on_it() {
    // The cart, of mass 1, has the acceleration a; friction accelerates its load, of mass 2, by at most mu g.
    for (a, mu) in [(2.0, 0.3), (6.0, 0.3)] {
        let cart = json!({"parameters": {"a": a, "mu": mu},
            "coordinates": {"cart": {"initial": 0}, "load": {"initial": 0}, "y": {"initial": 0}},
            "mass": [[1, 0, 0], [0, 2, 0], [0, 0, 2]], "potential": "2*9.81*y",
            "joints": [{"name": "course", "constraint": "cart - a*t^2/2"}],
            "contacts": [{"name": "bed", "gap": "y",
                          "friction": {"coefficient": "mu", "slip": ["load_dot - cart_dot"]}}]});
        let with = f64::min(a, mu * 9.81);
        let energy = 0.5 * (a * a + 2.0 * with * with);
        let work = 0.5 * a * a + 2.0 * with * 0.5 * a;
        assert_balance(&cart, 1.0, [energy, work, work - energy, 0.0]);
    }
}

#[test]
fn a_body_that_gathers_mass_at_rest_slows_down() {
    let heavier = json!({"coordinates": {"x": {"initial": 0, "velocity": 2}}, "mass": [["1 + t"]]});
    assert_balance(&heavier, 1.0, [1.0, -1.0, 0.0, 0.0]);
}

#[test]
fn a_bead_at_rest_gains_nothing_in_time_stepping() {
    let bead = json!({"parameters": {"m": 0.3, "R": 0.5, "g": 9.81, "w": 6},
        "coordinates": {"r": {"initial": "R"}, "turn": {"initial": 0.2}}, "mass": [["m", 0], [0, "m*r^2"]],
        "potential": "-m*g*r*cos(turn) - 0.5*m*w^2*r^2*sin(turn)^2",
        "contacts": [{"name": "hoop", "gap": "R - r", "friction": {"coefficient": 0.2, "slip": ["r*turn_dot"]}}]});
    let energy = stepped(bead, 1.0, 1e-3).diagnostics.energy.unwrap();
    assert!(energy.largest_gain_in_impacts < 1e-10 && energy.largest_defect < 1e-14, "{energy:?}");
}
