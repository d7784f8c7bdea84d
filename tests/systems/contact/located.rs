//! Event-driven integration of mechanical systems with located impacts: as accurate as for smooth motion.

use super::{ball, block, located};
use crate::systems::harness::{column, events, last, solve};
use crate::systems::reference::example;
use dvi::solution::{EventKind, Solution};
use serde_json::{Value, json};

const G: f64 = 9.81;

fn times(solution: &Solution, kind: EventKind) -> Vec<f64> {
    solution.trajectory.events.iter().filter(|event| event.kind == kind).map(|event| event.t).collect()
}

#[test]
fn every_bounce_before_the_zeno_point_is_found_and_the_ball_rests_after_it() {
    let e = 0.9_f64;
    let solution = located(ball(e), 10.0);
    let impacts = times(&solution, EventKind::Impact);
    let fall = (2.0 / G).sqrt();
    // Times of the impacts of a bouncing ball: t_k = t_1 + 2 t_1 (e + .. + e^k).
    let exact = |k: usize| fall * (1.0 + 2.0 * (1..=k).map(|i| e.powi(i as i32)).sum::<f64>());
    assert!(impacts.len() > 150, "{} impacts", impacts.len());
    for (k, t) in impacts.iter().enumerate() {
        assert!((t - exact(k)).abs() < 1e-9, "impact {k} at {t}, not {}", exact(k));
    }
    let zeno = fall * (1.0 + e) / (1.0 - e);
    assert!((impacts.last().unwrap() - zeno).abs() < 1e-8);
    assert!(last(&solution, "y").abs() < 1e-12 && last(&solution, "y_dot").abs() < 1e-12);
    let energy = solution.diagnostics.energy.unwrap();
    assert!((energy.lost_in_impacts - G).abs() < 1e-9 && energy.largest_defect < 1e-9, "{energy:?}");
    // The ball begins and ends at rest, so that the impulse of the floor over the run equals that of the weight.
    let carried = last(&solution, "floor_impulse");
    assert!((carried - 10.0 * G).abs() < 1e-7, "{carried}");
}

#[test]
fn a_gap_may_be_any_function_of_the_distance_with_a_gradient_where_it_closes() {
    let fall = (2.0 / G).sqrt();
    for gap in ["y", "exp(20*y) - 1", "exp(y/1e-2) - 1", "y + 1e6*y^3", "1e-9*y", "ln(1 + 20*y)", "sinh(30*y)"] {
        let mut falling = ball(0.5);
        falling["contacts"][0]["gap"] = json!(gap);
        let solution = located(falling, 1.0);
        let impacts = times(&solution, EventKind::Impact);
        assert!(impacts.len() == 2, "{gap}: {impacts:?}");
        for (t, exact) in impacts.iter().zip([fall, 2.0 * fall]) {
            assert!((t - exact).abs() < 1e-9, "{gap}: {t}, not {exact}");
        }
        assert!(solution.verdict.trusted, "{gap}: {:?}", solution.verdict);
    }
}

#[test]
fn a_ball_without_restitution_stays_where_it_falls() {
    let solution = located(ball(0.0), 2.0);
    let impacts = times(&solution, EventKind::Impact);
    assert!(impacts.len() == 1 && (impacts[0] - 0.451_523_640_985_730_9).abs() < 1e-13);
    assert!(last(&solution, "y").abs() < 1e-14 && last(&solution, "y_dot") == 0.0);
}

#[test]
fn an_elastic_ball_keeps_its_energy_over_a_thousand_bounces() {
    let period = 2.0 * (2.0 / G).sqrt();
    let solution = located(ball(1.0), 1000.0 * period);
    let impacts = times(&solution, EventKind::Impact);
    assert!(impacts.len() >= 999, "{} impacts", impacts.len());
    let energy = last(&solution, "kinetic_energy") + last(&solution, "potential_energy");
    assert!((energy - G).abs() < 1e-10 * G, "{energy}");
    assert!((impacts[998] - 998.5 * period).abs() < 1e-9);
}

#[test]
fn a_ball_on_a_shaking_table_locks_its_phase() {
    // Orbit of a ball with one impact per period of the oscillating table, for Gamma = A w^2/g = 1.2 and e = 1/2: cos(w
    // t) = pi (1 - e)/((1 + e) Gamma) at each impact.
    let (omega, gamma, e) = (50.0, 1.2, 0.5);
    let amplitude = gamma * G / (omega * omega);
    let phase = (std::f64::consts::PI * (1.0 - e) / ((1.0 + e) * gamma)).acos();
    let speed = std::f64::consts::PI * G / omega;
    let problem = json!({"parameters": {"A": amplitude, "w": omega, "f": phase},
        "coordinates": {"y": {"initial": "A*sin(f)", "velocity": speed}}, "mass": [[1]], "potential": "9.81*y",
        "contacts": [{"name": "table", "gap": "y - A*sin(w*t + f)", "restitution": e}]});
    // The ball starts with its velocity after an impact, after which its flight lasts one period of the table.
    let table = amplitude * omega * phase.cos();
    let mut problem = problem;
    problem["coordinates"]["y"]["velocity"] = json!(speed);
    assert!((table - speed * (1.0 - e) / (1.0 + e)).abs() < 1e-12);
    let solution = located(problem, 10.0);
    let impacts = times(&solution, EventKind::Impact);
    let period = 2.0 * std::f64::consts::PI / omega;
    assert!(impacts.len() >= 78, "{} impacts", impacts.len());
    for pair in impacts.windows(2) {
        assert!((pair[1] - pair[0] - period).abs() < 1e-9, "{} after {}", pair[1] - pair[0], pair[0]);
    }
}

#[test]
fn blocks_and_a_wall_count_the_digits_of_pi() {
    for (mass, collisions) in [(3, 5), (16, 12), (100, 31), (10_000, 314)] {
        let problem = json!({"coordinates": {"x": {"initial": 1}, "y": {"initial": 2, "velocity": -1}},
            "mass": [[1, 0], [0, mass]],
            "contacts": [{"name": "wall", "gap": "x", "restitution": 1}, {"name": "blocks", "gap": "y - x", "restitution": 1}]});
        let solution = located(problem, 100.0);
        assert_eq!(times(&solution, EventKind::Impact).len(), collisions, "N = {mass}");
        let energy = last(&solution, "kinetic_energy");
        assert!((energy - 0.5 * f64::from(mass)).abs() < 1e-11 * f64::from(mass));
    }
}

#[test]
fn a_particle_leaves_a_sphere_at_the_time_of_the_theory() {
    let problem = json!({"coordinates": {"x": {"initial": 0, "velocity": 0.5}, "y": {"initial": 1}}, "mass": [[1, 0], [0, 1]],
        "potential": "9.81*y", "contacts": [{"name": "sphere", "gap": "sqrt(x^2 + y^2) - 1"}]});
    let solution = located(problem, 1.0);
    let leaves = times(&solution, EventKind::LiftOff);
    // Within the tolerance, the particle may touch the sphere once more after its detachment.
    assert!(!leaves.is_empty() && leaves.iter().all(|t| (t - 0.754_238_838_002_552).abs() < 1e-9), "{leaves:?}");
    assert!(solution.diagnostics.energy.unwrap().largest_defect < 1e-8);
}

#[test]
fn a_sliding_block_stops_at_the_time_of_the_theory_and_stays() {
    let solution = located(block(0.0, 0.4, 3.0), 2.0);
    let stops = times(&solution, EventKind::Stick);
    assert!(stops.len() == 1 && (stops[0] - 0.764_525_993_883_792).abs() < 1e-11, "{stops:?}");
    assert!((last(&solution, "x") - 1.146_788_990_825_688).abs() < 1e-10);
    assert!((last(&solution, "dissipated_by_friction") - 9.0).abs() < 1e-9);
    let mu = 0.5_f64;
    let solution = located(block(0.999 * mu.atan(), mu, 0.0), 100.0);
    assert!(column(&solution, "x_dot").iter().all(|v| v.abs() < 1e-12), "the block creeps");
    let theta = 1.001 * mu.atan();
    let solution = located(block(theta, mu, 0.0), 1.0);
    assert!((last(&solution, "x_dot") - G * (theta.sin() - mu * theta.cos())).abs() < 1e-10);
}

#[test]
fn a_spinning_disk_is_stopped_by_the_friction_of_its_whole_face() {
    // The friction torque on a spinning disc of uniform pressure follows from the mean of |r x w| over its face, 2/3
    // R |w|.
    let problem = json!({"parameters": {"R": 0.1, "m": 1.5},
        "coordinates": {"angle": {"initial": 0, "velocity": 20}, "z": {"initial": 0}},
        "mass": [["m*R^2/2", 0], [0, "m"]], "potential": "9.81*m*z",
        "contacts": [{"name": "face", "gap": "z",
                      "friction": {"coefficient": 0.3, "slip": ["2/3*R*angle_dot"]}}]});
    let solution = located(problem, 1.0);
    let stop = *events(&solution, "face").last().unwrap();
    assert!((stop - 0.509_683_995_922_528).abs() < 1e-12, "{stop}");
    assert!((last(&solution, "angle") - 5.096_839_959_225_281).abs() < 1e-12, "{}", last(&solution, "angle"));
    assert!(last(&solution, "angle_dot").abs() < 1e-15, "{}", last(&solution, "angle_dot"));
}

#[test]
fn a_spring_with_friction_turns_at_the_points_of_the_theory() {
    let problem = json!({"coordinates": {"x": {"initial": 0.5}, "y": {"initial": 0}}, "mass": [[1, 0], [0, 1]],
        "potential": "9.81*y + 50*x^2",
        "contacts": [{"name": "floor", "gap": "y", "friction": {"coefficient": 0.3, "slip": ["x_dot"]}}]});
    let solution = located(problem, 3.0);
    let stop = *events(&solution, "floor").last().unwrap();
    assert!((stop - 2.513_274_122_871_834_5).abs() < 1e-8, "{stop}");
    assert!((last(&solution, "x") - 0.02912).abs() < 1e-9, "{}", last(&solution, "x"));
}

#[test]
fn a_rocking_block_loses_what_housner_says() {
    // A block of half width 0.1 and half height 0.4 stands on a corner, on a rough floor without restitution.
    let problem = json!({"parameters": {"b": 0.1, "h": 0.4, "m": 1, "tilt": "0.5*atan(b/h)"},
        "coordinates": {
            "angle": {"initial": "tilt"},
            "x": {"initial": "b*cos(tilt) - h*sin(tilt)"},
            "y": {"initial": "b*sin(tilt) + h*cos(tilt)"}},
        "mass": [["m*(b^2 + h^2)/3", 0, 0], [0, "m", 0], [0, 0, "m"]], "potential": "9.81*m*y",
        "contacts": [
            {"name": "left", "gap": "y - b*sin(angle) - h*cos(angle)",
             "friction": {"coefficient": 2, "slip": ["x_dot + (b*sin(angle) + h*cos(angle))*angle_dot"]}},
            {"name": "right", "gap": "y + b*sin(angle) - h*cos(angle)",
             "friction": {"coefficient": 2, "slip": ["x_dot + (-b*sin(angle) + h*cos(angle))*angle_dot"]}}]});
    let solution = located(problem, 1.0);
    let impacts = times(&solution, EventKind::Impact);
    assert!(impacts.len() >= 2, "{impacts:?}");
    assert!((impacts[0] - 0.312_308_575_112_622_3).abs() < 1e-9, "{impacts:?}");
    assert!((impacts[1] - 0.820_592_229_082_600_9).abs() < 1e-8, "{impacts:?}");
    let lowest = solution.trajectory.t.iter().zip(column(&solution, "angle")).filter(|(t, _)| **t < impacts[1]);
    let least = lowest.map(|(_, angle)| *angle).fold(0.0, f64::min);
    // The output times need not include the time at which the angle of the block is extreme.
    assert!(least > -0.094_736_793_120_816_74 - 1e-9 && least < -0.08, "{least}");
    let spins: Vec<f64> = column(&solution, "kinetic_energy").to_vec();
    let at = solution.trajectory.t.iter().position(|t| *t == impacts[0]).unwrap();
    let before = 9.81 * (0.4123105625617661 * (0.5 * 0.25_f64.atan()).cos() - 0.4);
    assert!((spins[at] / before - 0.831_314_878_892_733_6).abs() < 1e-8, "{}", spins[at] / before);
}

#[test]
fn a_block_that_slides_in_a_plane_stops_on_a_straight_line() {
    let problem = json!({"parameters": {"a": "25*pi/180"},
        "coordinates": {"x": {"initial": 0, "velocity": "2*cos(a)"}, "y": {"initial": 0, "velocity": "2*sin(a)"},
                        "z": {"initial": 0}},
        "mass": [[1, 0, 0], [0, 1, 0], [0, 0, 1]], "potential": "9.81*z",
        "contacts": [{"name": "plane", "gap": "z", "friction": {"coefficient": 0.3, "slip": ["x_dot", "y_dot"]}}]});
    let solution = located(problem, 1.5);
    let (x, y) = (last(&solution, "x"), last(&solution, "y"));
    assert!((y.atan2(x) - 25.0_f64.to_radians()).abs() < 1e-9, "the path bends");
    assert!((x.hypot(y) - 0.679_578_661_230_037_4).abs() < 1e-7, "{}", x.hypot(y));
    assert!(column(&solution, "z").iter().all(|z| z.abs() < 1e-10));
}

#[test]
fn the_woodpecker_keeps_its_published_period() {
    let mut problem = example("woodpecker");
    problem["time"]["end"] = json!(3);
    problem["method"] = json!({"impacts": "locate", "rtol": 1e-8});
    problem["output"] = json!({"times": {"count": 30_001}, "fields": ["height", "woodpecker"]});
    let solution = solve(&problem);
    let (t, bird, y) = (&solution.trajectory.t, column(&solution, "woodpecker"), column(&solution, "height"));
    let swings: Vec<usize> = (1..t.len() - 1)
        .filter(|&i| t[i] > 1.5 && bird[i] > 0.1 && bird[i] >= bird[i - 1] && bird[i] > bird[i + 1])
        .collect();
    assert!(swings.len() >= 8, "{} swings", swings.len());
    let (first, end) = (swings[0], swings[swings.len() - 1]);
    let cycles = (swings.len() - 1) as f64;
    let (period, fall) = ((t[end] - t[first]) / cycles, (y[first] - y[end]) / cycles);
    assert!((period - 0.146).abs() < 3e-4, "period {period}");
    assert!((fall - 0.01945).abs() < 1e-4, "fall {fall}");
    let most = bird.iter().copied().fold(0.0, f64::max);
    assert!((most - 0.12).abs() < 2.4e-4, "largest angle {most}");
}

#[test]
fn a_pendulum_on_a_rod_is_the_pendulum_in_its_angle() {
    let rod = json!({"coordinates": {"x": {"initial": 1}, "y": {"initial": 0}}, "mass": [[1, 0], [0, 1]], "potential": "9.81*y",
        "joints": [{"name": "rod", "constraint": "x^2 + y^2 - 1"}]});
    let angle = json!({"coordinates": {"a": {"initial": "pi/2"}}, "mass": [[1]], "potential": "-9.81*cos(a)"});
    let (rod, angle): (Solution, Solution) = (located(rod, 5.0), located(angle, 5.0));
    let a = last(&angle, "a");
    assert!((last(&rod, "x") - a.sin()).abs() < 1e-7 && (last(&rod, "y") + a.cos()).abs() < 1e-7);
}

/// Impacts, curvature and friction together: a ball in a rough bowl comes to rest at its lowest point, and the energy
/// balance closes.
#[test]
fn the_energy_of_a_ball_in_a_bowl_goes_where_the_books_say() {
    let bowl: Value = json!({"coordinates": {"x": {"initial": -0.5}, "y": {"initial": 0.5}}, "mass": [[1, 0], [0, 1]],
        "potential": "9.81*y",
        "contacts": [{"name": "bowl", "gap": "1 - sqrt(x^2 + (y - 1)^2)", "restitution": 0.5,
                      "friction": {"coefficient": 0.2, "slip": ["(x_dot*(1 - y) + x*y_dot)/sqrt(x^2 + (y - 1)^2)"]}}]});
    let solution = located(bowl, 10.0);
    let energy = solution.diagnostics.energy.unwrap();
    assert!(energy.largest_defect < 1e-7, "{energy:?}");
    assert!(energy.largest_gain_in_impacts < 1e-12 && energy.dissipated_by_friction > 0.5, "{energy:?}");
    assert!(last(&solution, "x_dot").abs() < 1e-10 && last(&solution, "y_dot").abs() < 1e-10);
}

#[test]
fn stages_beside_a_step_are_those_of_radau() {
    let problem = json!({"coordinates": {"x": {"initial": 1}}, "mass": [[1]], "potential": "x^2/2"});
    let error = |stages: u64, step: f64| {
        let solution = solve(&json!({"problem": {"mechanical": problem}, "time": {"end": 10},
            "method": {"step": step, "stages": stages, "vi_tolerance": 1e-14}}));
        assert_eq!(solution.diagnostics.steps.accepted, (10.0 / step).round() as u64);
        (last(&solution, "x") - 10.0_f64.cos()).abs()
    };
    for (stages, step, least) in [(1, 0.01, 1.9), (2, 0.1, 7.5), (3, 0.2, 30.0), (5, 1.0, 400.0)] {
        let (coarse, fine) = (error(stages, step), error(stages, step / 2.0));
        // With one, two, three and five stages, Radau IIA converges with the orders one, three, five and nine.
        assert!(coarse > least * fine && coarse < 0.3, "{stages}: {coarse} {fine}");
    }
}

#[test]
fn a_body_whose_impact_leaves_no_force_lets_go_at_every_tolerance() {
    // The sleeve of the woodpecker toy strikes at t = 0.0779 and detaches at once. The reference was found from matrix
    // exponentials in thirty digits, with all contact modes tried at each event (tests/peers/answers/woodpecker.py).
    let exact = [("height", -0.007380055945847309), ("sleeve", 0.1015509159402271), ("woodpecker", 0.1156130217801562)];
    for rtol in [1e-6_f64, 1e-8, 1e-9, 1e-10, 1e-11, 1e-12, 1e-13] {
        let mut toy = example("woodpecker");
        toy["time"] = json!({"end": 0.0815});
        toy["output"] = json!({});
        toy["method"] = json!({"rtol": rtol, "atol": rtol});
        let solution = solve(&toy);
        for (name, exact) in exact {
            let found = last(&solution, name);
            assert!((found - exact).abs() <= 1e2 * rtol.max(1e-12), "{name} at rtol {rtol}: {found} for {exact}");
        }
        toy["time"] = json!({"end": 1});
        let found = last(&solve(&toy), "height");
        assert!((found + 0.12816782368).abs() <= 1e3 * rtol.max(1e-12), "rtol {rtol}: {found}");
    }
}

#[test]
fn a_force_that_jumps_lets_go_with_the_velocities_of_its_time() {
    // A force accelerates both bodies by 1/2 up to the time `jump`; then the first body is pulled back with the force
    // 3, and the second flies on.
    for jump in [0.3, 0.5, 0.6, 0.7, 0.847, 0.9, 1.1, 1.3] {
        for (force, rtol) in [(1.0, 1e-3), (1.0, 1e-6), (1e-6, 1e-3), (1e-7, 1e-6), (1e5, 1e-9)] {
            let solution = solve(&json!({"problem": {"mechanical": {
                    "coordinates": {"a": {"initial": 0}, "b": {"initial": 0}}, "mass": [[1, 0], [0, 1]],
                    "forces": {"a": format!("{force:?}*(1 - 4*heaviside(t - {jump}))")}, "contacts": [{"name": "c", "gap": "b - a"}]}},
                "time": {"end": jump + 1.0}, "method": {"rtol": rtol}, "output": {"times": [jump + 1.0]}}));
            let (a, b) = (last(&solution, "a") / force, last(&solution, "b") / force);
            let (place, speed) = (0.25 * jump * jump, 0.5 * jump);
            assert!(
                (b - place - speed).abs() < 1e-9 && (a - place - speed + 1.5).abs() < 1e-9,
                "{jump} {force}: {a} {b}"
            );
            assert!(solution.verdict.trusted, "{jump} {force} {rtol}: {:?}", solution.verdict);
        }
    }
}

#[test]
fn short_flights_are_located_beside_long_steps() {
    // Flights of a ball under y'' = -10 - 10 y that start with the speed v last 2/w atan(v w/10), w = sqrt 10, and each
    // impact halves the speed.
    let w = 10.0_f64.sqrt();
    let speed = |n: i32| 30.0_f64.sqrt() * 0.5_f64.powi(n);
    let limit = std::f64::consts::FRAC_PI_3 / w + (1..60).map(|n| 2.0 / w * (speed(n) * w / 10.0).atan()).sum::<f64>();
    for rtol in [1e-3, 1e-4, 1e-5, 1e-6, 1e-8, 1e-10] {
        let solution = solve(&json!({"problem": {"mechanical": {"coordinates": {"y": {"initial": 1}}, "mass": [[2]],
                "potential": "20*y", "forces": {"y": "-20*y"}, "contacts": [{"name": "floor", "gap": "y", "restitution": 0.5}]}},
            "time": {"end": 3}, "method": {"rtol": rtol}, "output": {"times": [3]}}));
        let impacts = times(&solution, EventKind::Impact);
        let found = impacts.last().copied().unwrap_or_default();
        assert!((found - limit).abs() <= 10.0 * f64::max(rtol, 1e-9), "rtol {rtol}: {found} for {limit}");
        assert!(last(&solution, "y").abs() < 1e-15 && solution.verdict.trusted, "rtol {rtol}: {:?}", solution.verdict);
        assert!(solution.diagnostics.steps.accepted < 250, "{:?}", solution.diagnostics.steps);
    }
}
