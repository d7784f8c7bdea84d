//! Coulomb's law at contacts whose normal force is not known in advance.

use super::{block, stepped};
use crate::systems::harness::{column, distance, events, last, solve};
use dvi::solution::EventKind;
use serde_json::{Value, json};

const G: f64 = 9.81;

#[test]
fn a_block_slides_to_rest_and_stays_exactly() {
    let (mu, v, h) = (0.4, 3.0, 1e-3);
    let (stop, way) = (0.764_525_993_883_792, 1.146_788_990_825_688);
    let solution = stepped(block(0.0, mu, v), 2.0, h);
    assert!((events(&solution, "slope").last().unwrap() - stop).abs() <= h);
    // The block's final position by the symplectic Euler scheme is short of the exact one by v0 h/2, with the initial
    // speed v0 and the step size h.
    assert!((last(&solution, "x") - way).abs() < 0.51 * v * h);
    assert_eq!(last(&solution, "x_dot"), 0.0);
    // Friction has dissipated all the kinetic energy of the block.
    assert!((last(&solution, "dissipated_by_friction") - 9.0).abs() < 1e-12);
}

#[test]
fn a_block_sticks_just_below_the_angle_of_friction_and_slides_just_above() {
    let mu = 0.5_f64;
    let (h, end) = (1e-2, 100.0);
    let solution = stepped(block(0.999 * mu.atan(), mu, 0.0), end, h);
    let creep = column(&solution, "x_dot").iter().fold(0.0_f64, |most, v| most.max(v.abs()));
    assert!(creep < 1e-12, "the block creeps with {creep:e}");
    let theta = 1.001 * mu.atan();
    let solution = stepped(block(theta, mu, 0.0), 1.0, h);
    let acceleration = G * (theta.sin() - mu * theta.cos());
    let error = distance(&solution, "x_dot", |t| acceleration * t);
    assert!(error < 1e-12, "the velocity is off by {error:e}");
    // Friction force, relative to the weight, of a block at rest on a slope whose angle is one degree below the angle
    // of friction.
    let theta = mu.atan() - 1.0_f64.to_radians();
    let solution = stepped(block(theta, mu, 0.0), 1.0, h);
    let force = -last(&solution, "slope_friction") / (2.0 * G);
    assert!((force - 0.431_535_575_837_347_25).abs() < 1e-12, "{force}");
}

#[test]
fn a_spring_with_friction_stops_after_eight_half_swings() {
    let solve_with = |h: f64| {
        let problem = json!({"coordinates": {"x": {"initial": 0.5}, "y": {"initial": 0}}, "mass": [[1, 0], [0, 1]],
            "potential": "9.81*y + 50*x^2",
            "contacts": [{"name": "floor", "gap": "y", "friction": {"coefficient": 0.3, "slip": ["x_dot"]}}]});
        stepped(problem, 3.0, h)
    };
    // Time stepping with implicit forces damps the oscillation of the block, so that the error is of first order in the
    // step size.
    let errors = [4e-5, 2e-5].map(|h| (last(&solve_with(h), "x") - 0.02912).abs());
    assert!(errors[1] < 1e-3 && errors[1] < 0.6 * errors[0], "{errors:?}");
    let solution = solve_with(2e-5);
    let stop = *events(&solution, "floor").last().unwrap();
    assert!((stop - 2.513_274_122_871_834_5).abs() < 0.02, "{stop}");
    assert!(last(&solution, "x").abs() < 0.02943);
    assert_eq!(last(&solution, "x_dot"), 0.0);
}

/// A block on a plane, launched at 25 degrees to a corner of the polygon that approximates the friction cone.
fn launched(cone: Value) -> Value {
    let mut friction = json!({"coefficient": 0.3, "slip": ["x_dot", "y_dot"]});
    for (key, value) in cone.as_object().unwrap() {
        friction[key] = value.clone();
    }
    json!({"parameters": {"a": "25*pi/180"},
           "coordinates": {"x": {"initial": 0, "velocity": "2*cos(a)"}, "y": {"initial": 0, "velocity": "2*sin(a)"},
                           "z": {"initial": 0}},
           "mass": [[1, 0, 0], [0, 1, 0], [0, 0, 1]], "potential": "9.81*z",
           "contacts": [{"name": "plane", "gap": "z", "friction": friction}]})
}

#[test]
fn the_exact_cone_stops_a_block_on_a_straight_line_and_four_corners_where_their_theory_says() {
    let h = 1e-3;
    let (stop, stop_of_four) = (0.679_578_661_230_037_4, 0.903_109_785_101_834_5);
    let solution = stepped(launched(json!({})), 1.5, h);
    assert!((events(&solution, "plane").last().unwrap() - stop).abs() <= h);
    let (x, y) = (last(&solution, "x"), last(&solution, "y"));
    assert!((y.atan2(x) - 25.0_f64.to_radians()).abs() < 1e-9, "the path bends");
    assert!((x.hypot(y) - stop).abs() < 1.01 * h);
    assert!(column(&solution, "z").iter().all(|z| z.abs() < 1e-12), "the block lifts off");
    let solution = stepped(launched(json!({"cone": "polyhedral", "facets": 4})), 1.5, h);
    assert!((events(&solution, "plane").last().unwrap() - stop_of_four).abs() <= h);
    assert!((last(&solution, "x") - 0.679_578_661_230_037_4).abs() < 2.0 * h, "{}", last(&solution, "x"));
    assert!((last(&solution, "y") - 0.520_587_457_097_504_5).abs() < 2.0 * h, "{}", last(&solution, "y"));
}

#[test]
fn a_block_thrown_across_a_slope_turns_without_a_stop() {
    // For a block on a slope of the angle alpha whose velocity makes the angle phi with the line of descent, the
    // speed is c tan(phi/2)^k / sin phi, with k = mu cot alpha; it is least where cos phi = k.
    let mu = 0.4;
    let k = mu * 3.0_f64.sqrt();
    let along = |phi: f64| (0.5 * phi).tan().powf(k) / phi.sin();
    let start = 0.75 * std::f64::consts::PI;
    let c = 2.0_f64.sqrt() / along(start);
    let coordinate = |velocity: f64| json!({"initial": 0, "velocity": velocity});
    for rtol in [1e-4, 1e-8] {
        let solution = solve(&json!({
            "problem": {"mechanical": {
                "coordinates": {"x": coordinate(1.0), "y": coordinate(-1.0), "z": coordinate(0.0)},
                "mass": [[1, 0, 0], [0, 1, 0], [0, 0, 1]], "parameters": {"g": 9.81, "a": "pi/6"},
                "potential": "g*cos(a)*z - g*sin(a)*y",
                "contacts": [{"name": "p", "gap": "z", "friction": {"coefficient": mu, "slip": ["x_dot", "y_dot"]}}]
            }},
            "time": {"end": 1.5}, "method": {"rtol": rtol}, "output": {"times": {"count": 1501}}}));
        let velocities = column(&solution, "x_dot").iter().zip(column(&solution, "y_dot"));
        let mut least = f64::INFINITY;
        for (x, y) in velocities {
            let speed = x.hypot(*y);
            least = least.min(speed);
            let error = speed / (c * along(x.atan2(*y))) - 1.0;
            assert!(error.abs() < 100.0 * rtol, "{rtol:e}: the speed {speed} is off by {error:e}");
        }
        let exact = c * along(k.acos());
        assert!((least / exact - 1.0).abs() < 1e-5 + 10.0 * rtol, "{rtol:e}: least speed {least} for {exact}");
    }
}

/// A disc or sphere of radius 0.1 on a slope; `k` is its moment of inertia divided by `m R^2`. Members of a JSON
/// object are sorted by name, so the order of coordinates in the mass matrix is spin, x, y.
fn round(k: f64, mu: f64, theta: f64, velocity: f64) -> Value {
    json!({"parameters": {"theta": theta, "k": k, "R": 0.1},
           "coordinates": {"x": {"initial": 0, "velocity": velocity}, "y": {"initial": "R"}, "spin": {"initial": 0}},
           "mass": [["k*R^2", 0, 0], [0, 1, 0], [0, 0, 1]], "potential": "9.81*(y*cos(theta) - x*sin(theta))",
           "contacts": [{"name": "slope", "gap": "y - R",
                         "friction": {"coefficient": mu, "slip": ["x_dot - R*spin_dot"]}}]})
}

#[test]
fn a_sphere_slides_until_it_rolls() {
    let h = 1e-4;
    let solution = stepped(round(0.4, 0.3, 0.0, 2.0), 1.0, h);
    let rolls = *events(&solution, "slope").last().unwrap();
    assert!((rolls - 0.194_165_331_780_010_7).abs() <= h, "{rolls}");
    assert!((last(&solution, "x_dot") - 1.428_571_428_571_428_6).abs() < 1e-12);
    assert!((last(&solution, "x") - 1.484_047_237_651_431_5).abs() < 2.0 * h);
    let (kept, lost) = (last(&solution, "kinetic_energy"), last(&solution, "dissipated_by_friction"));
    assert!((lost / (kept + lost) - 0.285_714_285_714_285_7).abs() < 1e-12);
}

#[test]
fn disks_and_spheres_roll_down_a_slope_where_friction_suffices() {
    let theta = 30.0_f64.to_radians();
    let acceleration = |k: f64, mu: f64| last(&stepped(round(k, mu, theta, 0.0), 1.0, 0.01), "x_dot");
    assert!((acceleration(0.5, 0.2) - 3.27).abs() < 1e-12);
    assert!((acceleration(0.4, 0.2) - 3.503_571_428_571_428_6).abs() < 1e-12);
    // The acceleration of the disc (k = 1/2) or sphere (k = 2/5) for friction coefficients just above and just below
    // the critical one, from which on it rolls without slip.
    for (k, critical, rolling) in
        [(0.5, 0.192_450_089_729_875_26, 3.27), (0.4, 0.164_957_219_768_464_5, 3.503_571_428_571_428_6)]
    {
        assert!((acceleration(k, 1.001 * critical) - rolling).abs() < 1e-12);
        assert!(acceleration(k, 0.999 * critical) - rolling > 1e-4);
    }
    let solution = stepped(round(0.5, 0.1, theta, 0.0), 1.0, 0.01);
    assert!((last(&solution, "x_dot") - 4.055_429_078_887_466).abs() < 1e-12);
    assert!((0.1 * last(&solution, "spin_dot") - 1.699_141_842_225_068_6).abs() < 1e-12);
}

#[test]
fn a_sphere_that_slides_fast_never_lifts_off() {
    let solution = stepped(round(0.4, 0.3, 0.0, 10.0), 0.5, 1e-3);
    assert!(column(&solution, "slope_gap").iter().all(|gap| gap.abs() <= 1e-10));
    assert!((last(&solution, "x_dot") - 8.5285).abs() < 1e-10);
}

/// A ladder of length 2 against a wall at the angle `degrees` to the floor, with the friction coefficients `floor`
/// and `wall`.
fn ladder(degrees: f64, floor: f64, wall: f64) -> Value {
    json!({"parameters": {"theta": degrees.to_radians()},
           "coordinates": {"x": {"initial": "cos(theta)"}, "y": {"initial": "sin(theta)"}, "a": {"initial": "theta"}},
           "mass": [["1/3", 0, 0], [0, 1, 0], [0, 0, 1]], "potential": "9.81*y",
           "contacts": [
             {"name": "floor", "gap": "y - sin(a)",
              "friction": {"coefficient": floor, "slip": ["x_dot - sin(a)*a_dot"]}},
             {"name": "wall", "gap": "x - cos(a)",
              "friction": {"coefficient": wall, "slip": ["y_dot + cos(a)*a_dot"]}}]})
}

#[test]
fn a_ladder_stands_a_hundredth_of_a_degree_above_its_limit_and_slips_below() {
    for (limit, floor, wall) in [(51.340_191_745_909_91, 0.4, 0.0), (46.397_181_027_296_38, 0.4, 0.4)] {
        let speed = |degrees: f64| {
            let solution = stepped(ladder(degrees, floor, wall), 1.0, 1e-2);
            column(&solution, "a_dot").iter().fold(0.0_f64, |most, v| most.max(v.abs()))
        };
        assert!(speed(limit + 0.01) < 1e-10, "it moves with {:e}", speed(limit + 0.01));
        assert!(speed(limit - 0.01) > 1e-5);
    }
}

/// A rod that slides on its lower end with its friction so directed that the Painleve paradox is possible (Painleve
/// 1895).
fn rod(degrees: f64, mu: f64) -> Value {
    let mut problem = ladder(degrees, mu, 0.0);
    problem["contacts"].as_array_mut().unwrap().truncate(1);
    problem["coordinates"]["x"]["velocity"] = json!(5);
    problem
}

#[test]
fn the_paradox_of_painleve_is_met_by_an_impulse_and_named() {
    let warned = |degrees: f64| {
        let problem = json!({"mechanical": rod(degrees, 1.5)});
        let solution = solve(&json!({"problem": problem, "time": {"end": 0.05}, "method": {"step": 1e-4}}));
        assert!(solution.diagnostics.vi.as_ref().unwrap().largest_residual < 1e-10);
        let energy = solution.diagnostics.energy.unwrap();
        assert!(energy.kinetic_at_end <= energy.kinetic_at_start + 9.81 * 0.05);
        solution.diagnostics.warnings.iter().any(|warning| warning.code == "painleve")
    };
    // For mu = 1.5 the Painleve paradox occurs at inclinations of one sign only.
    assert!(warned(60.0) && !warned(120.0));
    // The Painleve paradox occurs between the inclinations 50.642 and 73.048 degrees; the rod rotates little before
    // the solver first examines it.
    assert!(warned(50.7) && warned(73.0));
    assert!(!warned(45.0) && !warned(135.0));
}

#[test]
fn what_rests_has_nothing_to_tell() {
    // A bead on a rotating hoop, and a block on a belt: both stick, with relative velocities of the size of rounding
    // errors.
    let bead = json!({"parameters": {"m": 0.3, "R": 0.5, "g": 9.81, "w": 6},
        "coordinates": {"r": {"initial": "R"}, "turn": {"initial": 0.2}}, "mass": [["m", 0], [0, "m*r^2"]],
        "potential": "-m*g*r*cos(turn) - 0.5*m*w^2*r^2*sin(turn)^2",
        "contacts": [{"name": "hoop", "gap": "R - r", "friction": {"coefficient": 0.2, "slip": ["r*turn_dot"]}}]});
    let belt = json!({"coordinates": {"x": {"initial": 0, "velocity": 0.7}, "y": {"initial": 0}}, "mass": [[3, 0], [0, 3]],
        "potential": "3*9.81*y + sin(t)*x",
        "contacts": [{"name": "belt", "gap": "y", "friction": {"coefficient": 0.3, "slip": ["x_dot - 0.7"]}}]});
    for problem in [bead, belt] {
        let solution = stepped(problem, 2.0, 1e-3);
        assert!(solution.trajectory.events.is_empty(), "{:?}", solution.trajectory.events);
    }
}

#[test]
fn time_stepping_tells_each_change_of_a_contact_once() {
    // The block falls onto the floor without restitution, slides to rest from the speed 0.4 with the deceleration mu
    // g = 3, slips again when 3 t - 3 = 3, and detaches at t = 4.
    let block = json!({"coordinates": {"x": {"initial": 0, "velocity": 1}, "y": {"initial": 0.2}}, "mass": [[1, 0], [0, 1]],
        "potential": "10*y", "forces": {"x": "max(3*t - 3, 0)", "y": "10*max(t - 3, 0)"},
        "contacts": [{"name": "floor", "gap": "y", "friction": {"coefficient": 0.3, "slip": ["x_dot"]}}]});
    let solution = stepped(block, 5.0, 1e-3);
    let told: Vec<_> = solution.trajectory.events.iter().map(|event| (event.kind, event.t)).collect();
    let expected =
        [(EventKind::Impact, 0.2), (EventKind::Stick, 1.0 / 3.0), (EventKind::Slip, 2.0), (EventKind::LiftOff, 4.0)];
    assert_eq!(told.len(), expected.len(), "{told:?}");
    for ((kind, t), (right, at)) in told.iter().zip(expected) {
        assert!(*kind == right && (t - at).abs() < 5e-3, "{told:?}, not {expected:?}");
    }
}

#[test]
fn what_a_floor_and_a_wall_share_is_held_however_forces_vary() {
    // In a corner the normal and friction constraints of two contacts act on the same two coordinates: contact forces
    // are not unique, but the motion is.
    for (lift, mu) in
        [("0.6*pwm(t, 0.2, 0.6) + 0.9", 0.0), ("0.6*pwm(t, 0.2, 0.6) + 0.9", 0.2), ("6.4", 0.0), ("3*sin(7*t)", 0.3)]
    {
        for rtol in [1e-4, 1e-8, 1e-11] {
            let corner: Value = json!({"coordinates": {"x": {"initial": 0}, "y": {"initial": 0}},
                "mass": [[0.6, 0], [0, 0.6]], "potential": "5.8*y", "forces": {"x": "5", "y": lift},
                "contacts": [{"name": "floor", "gap": "y", "friction": {"coefficient": mu, "slip": ["x_dot"]}},
                    {"name": "wall", "gap": "1 - x", "friction": {"coefficient": 0.6, "slip": ["y_dot"]}}]});
            // The lift of 6.4 exceeds the weight, so that only the wall's friction can hold the body, which starts at
            // the wall.
            let mut corner = corner;
            if lift == "6.4" {
                corner["coordinates"]["x"]["initial"] = json!(1);
            }
            let solution = solve(&json!({"problem": {"mechanical": corner}, "time": {"end": 2},
                "method": {"rtol": rtol}, "output": {"times": [2]}}));
            let what = format!("{lift} {mu} {rtol}: {:?} {:?}", solution.verdict, solution.diagnostics.steps);
            assert!((last(&solution, "x") - 1.0).abs() < 1e-12 && last(&solution, "y").abs() < 1e-12, "{what}");
            assert!(solution.verdict.trusted && solution.diagnostics.steps.accepted < 400, "{what}");
        }
    }
}
