//! Sets that couple several variables: balls, cones, simplices and polyhedra.

use crate::systems::harness::{column, distance, events, last, solve};
use crate::systems::reference::example;
use dvi::analysis::Uniqueness;
use serde_json::{Value, json};

#[test]
fn a_block_in_the_plane_slides_straight_and_stops() {
    let (mu, g) = (0.4, 9.81);
    let stop = 5.0 / (mu * g);
    let specification = example("friction_disk");
    let solution = solve(&specification);
    let speed = |t: f64| (5.0 - mu * g * t).max(0.0);
    for (name, part) in [("vx", 0.6), ("vy", 0.8)] {
        let error = distance(&solution, name, |t| part * speed(t));
        assert!(error < 1e-6, "{name} is off by {error:e}");
    }
    let way = 0.5 * stop * 5.0;
    assert!((last(&solution, "x") - 0.6 * way).abs() < 1e-6 && (last(&solution, "y") - 0.8 * way).abs() < 1e-6);
    let times = events(&solution, "Fx");
    assert!(times.len() == 1 && (times[0] - stop).abs() < 1e-6, "{times:?}");
    // While the body slides, the friction force is at its bound and opposes the motion; at rest it is zero.
    for (&t, (&fx, &fy)) in
        solution.trajectory.t.iter().zip(column(&solution, "Fx").iter().zip(column(&solution, "Fy")))
    {
        let force = if t < stop - 0.02 { 2.0 * mu * g } else { 0.0 };
        if (t - stop).abs() > 0.02 {
            assert!((fx - 0.6 * force).abs() < 1e-6 && (fy - 0.8 * force).abs() < 1e-6, "F = ({fx}, {fy}) at {t}");
        }
    }
}

#[test]
fn a_radius_that_varies_with_time_and_state_is_followed() {
    // The normal force on the body grows with time, so that the speed decreases with |v|' = -mu g (1 + t).
    let mut specification = example("friction_disk");
    specification["problem"]["dvi"]["set"][0]["ball"]["radius"] = json!("mu*m*g*(1 + t)");
    let solution = solve(&specification);
    let speed = |t: f64| (5.0 - 0.4 * 9.81 * (t + 0.5 * t * t)).max(0.0);
    let error = distance(&solution, "vy", |t| 0.8 * speed(t));
    assert!(error < 1e-6, "off by {error:e}");
    // The friction bound grows with the distance s: r = m (1 + x/0.6), hence s'' = -(1 + s) and s = 5 sin t - 1 + cos
    // t.
    specification["problem"]["dvi"]["set"][0]["ball"]["radius"] = json!("m*(1 + x/0.6)");
    specification["time"]["end"] = json!(1);
    let solution = solve(&specification);
    let error = distance(&solution, "x", |t| 0.6 * (5.0 * t.sin() - 1.0 + t.cos()));
    assert!(error < 1e-6, "off by {error:e}");
}

#[test]
fn a_trajectory_passes_from_a_region_to_a_sliding_mode_to_the_common_point() {
    let solution = solve(&example("three_regions"));
    // The solution of the Filippov system moves in its first region to the line between the first two regions, then
    // slides along that line at half speed to the origin.
    let (line, origin) = (2.0 - 1.0 / 3.0_f64.sqrt(), 2.0 + 3.0_f64.sqrt());
    let x = |t: f64| if t < line { 2.0 - t } else { (origin - t).max(0.0) / 4.0 };
    let y = |t: f64| if t < line { 1.0 } else { (origin - t).max(0.0) * 3.0_f64.sqrt() / 4.0 };
    let (in_x, in_y) = (distance(&solution, "x", x), distance(&solution, "y", y));
    assert!(in_x < 1e-6 && in_y < 1e-6, "off by {in_x:e}, {in_y:e}");
    let mixture = |t: f64| match t {
        t if t < line => [1.0, 0.0, 0.0],
        t if t < origin => [0.5, 0.5, 0.0],
        _ => [1.0 / 3.0; 3],
    };
    for (k, name) in ["z1", "z2", "z3"].iter().enumerate() {
        for (&t, &z) in solution.trajectory.t.iter().zip(column(&solution, name)) {
            if (t - line).abs() > 0.02 && (t - origin).abs() > 0.02 {
                assert!((z - mixture(t)[k]).abs() < 1e-6, "{name} = {z} at {t}");
            }
        }
    }
    assert!((events(&solution, "z2")[0] - line).abs() < 1e-5);
    assert!((events(&solution, "z3")[0] - origin).abs() < 1e-5);
}

/// A differential variational inequality whose set is a square, written as a box and as a polyhedron.
#[test]
fn a_square_is_the_same_as_a_box_and_as_a_polyhedron() {
    let system = |block: Value| {
        json!({"problem": {"dvi": {
            "states": {"x": {"initial": 1, "rate": "y - u"}, "y": {"initial": 0, "rate": "-x - w"}},
            "variables": {"u": {"inequality": "-x"}, "w": {"inequality": "w - y/2"}},
            "set": [block]}},
            "time": {"end": 3}, "method": {"rtol": 1e-9}, "output": {"times": {"count": 31}}})
    };
    let by_box = solve(&system(json!({"box": {"of": ["u", "w"], "lower": -0.1, "upper": 0.1}})));
    let a = json!([[1, 0], [-1, 0], [0, 1], [0, -1]]);
    let by_rows = solve(&system(json!({"polyhedron": {"of": ["u", "w"], "A": a, "b": [0.1, 0.1, 0.1, 0.1]}})));
    for name in ["x", "y"] {
        for (a, b) in column(&by_box, name).iter().zip(column(&by_rows, name)) {
            assert!((a - b).abs() < 1e-7, "{name}: {a} {b}");
        }
    }
}

#[test]
fn forces_from_a_polyhedron_are_those_of_a_vertex_however_short_the_steps_are() {
    // The variables (u, w) are the vertex of the triangle at which (1, 1/2) . (u, w) is largest, as long as the
    // states hardly change from (1, 1/2).
    for step in [1e-2, 1e-5, 1e-8, 1e-11, 1e-14] {
        for solver in ["auto", "semismooth_newton"] {
            let solution = solve(&json!({"problem": {"dvi": {
                "states": {"v": {"initial": 1, "rate": "-u"}, "q": {"initial": 0.5, "rate": "-w"}},
                "variables": {"u": {"inequality": "-v"}, "w": {"inequality": "-q"}},
                "set": [{"polyhedron": {"of": ["u", "w"], "A": [[1, 2], [-3, 1], [1, -3]], "b": [2, 0.3, 0.4]}}]}},
                "time": {"end": 10.0 * step}, "method": {"step": step, "vi_solver": solver}}));
            for (name, value) in [("u", 1.36), ("w", 0.32)] {
                assert!((last(&solution, name) - value).abs() < 1e-12, "{solver}, step {step:e}: {name}");
            }
        }
    }
}

#[test]
fn a_point_held_in_a_cone_slides_down_its_side() {
    // Gravity acts along -s, with the cone s >= |v| as a unilateral constraint: in its interior the point falls
    // freely, and on its boundary the multiplier balances half of gravity.
    let specification = json!({"problem": {"dvi": {
        "states": {"s": {"initial": 2, "rate": "-1 + p"}, "v": {"initial": 1, "rate": "q"}},
        "variables": {"p": {"inequality": "s"}, "q": {"inequality": "v"}},
        "set": [{"second_order_cone": ["p", "q"]}]}},
        "time": {"end": 2.5}, "method": {"rtol": 1e-9}, "output": {"times": {"count": 26}}});
    let solution = solve(&specification);
    // The point (s, v) stays in the dual cone; at t = 1 it reaches s = v, and then moves along s = v with (s, v)' =
    // (-1, 0) + l (1, -1).
    let s = |t: f64| if t < 1.0 { 2.0 - t } else { (1.0 - 0.5 * (t - 1.0)).max(0.0) };
    let error = distance(&solution, "s", s);
    assert!(error < 1e-6, "off by {error:e}");
    assert!((last(&solution, "v") - 0.25).abs() < 1e-6);
}

#[test]
fn every_solver_that_can_gives_the_same_motion() {
    for (solver, stages, tolerance) in [
        ("auto", 3, 1e-6_f64),
        ("semismooth_newton", 5, 1e-6),
        ("conic", 3, 1e-6),
        // With several stages the matrix of the stage inequality is far from symmetric, for which block Gauss-Seidel
        // does not converge.
        ("block_gauss_seidel", 1, 1e-2),
    ] {
        let mut specification = example("friction_disk");
        specification["method"] = json!({"vi_solver": solver, "stages": stages, "rtol": 1e-3 * tolerance.max(1e-5)});
        let solution = solve(&specification);
        assert!((last(&solution, "x") - 0.6 * 12.5 / (0.4 * 9.81)).abs() < tolerance, "{solver}");
        let name = solution.diagnostics.vi.as_ref().expect("a variational inequality").solver;
        assert_eq!(name, if solver == "auto" { "semismooth_newton" } else { solver });
    }
}

#[test]
fn a_block_and_an_interval_that_switch_at_once_are_both_located() {
    // Two bodies with the speed 2 and the friction bound 1, one on a line and one in the plane: both stop at t = 2.
    let specification = json!({"problem": {"dvi": {
        "states": {
            "u": {"initial": 2, "rate": "-F"},
            "v": {"initial": 1.2, "rate": "-P"}, "w": {"initial": 1.6, "rate": "-Q"}
        },
        "variables": {"F": {"inequality": "-u"}, "P": {"inequality": "-v"}, "Q": {"inequality": "-w"}},
        "set": [{"box": {"of": ["F"], "lower": -1, "upper": 1}}, {"ball": {"of": ["P", "Q"], "radius": 1}}]}},
        "time": {"end": 3}});
    let solution = solve(&specification);
    for name in ["F", "P", "Q"] {
        let times = events(&solution, name);
        assert!(times.len() == 1 && (times[0] - 2.0).abs() < 1e-10, "{name}: {times:?}");
    }
    assert!(solution.diagnostics.steps.accepted < 100, "{:?}", solution.diagnostics.steps);
}

#[test]
fn a_force_that_only_just_reaches_the_friction_moves_nothing() {
    let specification = json!({"problem": {"dvi": {
        "states": {
            "v": {"initial": 0, "rate": "0.6*(1 - (t - 1)^2) - F"},
            "w": {"initial": 0, "rate": "0.8*(1 - (t - 1)^2) - H"}
        },
        "variables": {"F": {"inequality": "-v"}, "H": {"inequality": "-w"}},
        "set": [{"ball": {"of": ["F", "H"], "radius": 1}}]}},
        "time": {"end": 2}});
    let solution = solve(&specification);
    assert!(last(&solution, "v").abs() < 1e-9 && last(&solution, "w").abs() < 1e-9);
    assert!(solution.diagnostics.steps.accepted < 200, "{:?}", solution.diagnostics.steps);
}

#[test]
fn a_point_that_leaves_the_apex_of_a_cone_is_its_projection_there() {
    // The variables (s, v, w) are the projection of (sin t, cos t, 1/2) onto the cone: it leaves the apex where sin
    // t > -|(cos t, 1/2)|.
    let specification = json!({"problem": {"dvi": {
        "states": {"q": {"initial": 0, "rate": "s + v + w"}},
        "variables": {
            "s": {"inequality": "s - sin(t)"}, "v": {"inequality": "v - cos(t)"}, "w": {"inequality": "w - 0.5"}
        },
        "set": [{"second_order_cone": ["s", "v", "w"]}]}},
        "time": {"end": 6.3}, "method": {"rtol": 1e-12}, "output": {"times": "steps"}});
    let solution = solve(&specification);
    let s = column(&solution, "s").iter().zip(&solution.trajectory.t);
    let error = s.fold(0.0_f64, |error, (s, t)| {
        let (axis, side) = (t.sin(), t.cos().hypot(0.5));
        let exact = if side <= axis { axis } else { (0.5 * (axis + side)).max(0.0) };
        error.max((s - exact).abs())
    });
    assert!(error < 1e-9, "s is off by {error:e}");
}

#[test]
fn the_face_of_a_block_is_analysed_on_its_tangent_space() {
    // A point on the boundary of the cone can move along its ray and around the cone: of the three variables one is
    // determined by |(q, r)| = p, one by G through the curvature, and one by the derivative of G.
    let specification = json!({"problem": {"dvi": {
        "states": {
            "s": {"initial": 1.5, "rate": "-1 + p"},
            "x": {"initial": 1, "rate": "-y + q"}, "y": {"initial": 0, "rate": "x + r"}
        },
        "variables": {"p": {"inequality": "s"}, "q": {"inequality": "x"}, "r": {"inequality": "y"}},
        "set": [{"second_order_cone": ["p", "q", "r"]}]}},
        "time": {"end": 1}});
    let solution = solve(&specification);
    let faces = &solution.diagnostics.faces;
    assert_eq!(faces.len(), 1, "{faces:?}");
    assert!((faces[0].t - 0.5).abs() < 1e-6 && faces[0].on_boundary == ["p", "q", "r"], "{faces:?}");
    assert_eq!((faces[0].analysis.index, faces[0].analysis.levels.as_slice()), (Some(1.0), [1, 1].as_slice()));
    assert_eq!(faces[0].analysis.uniqueness, Uniqueness::Unique, "{}", faces[0].analysis.because);
}

/// For `x' = a(t) e + z` with `G = x` and `a = 1.001 sin(40 t)` along a direction `e`, `z` balances the drive until
/// `a` exceeds the range of the set, and again once the excess has been returned. While it balances, the states are
/// constant, so that steps may be arbitrarily long.
#[test]
fn what_a_set_holds_it_lets_go_whenever_the_drive_is_beyond_it() {
    let (omega, periods) = (40.0, 12);
    // Phases within half a period: the start p of a motion, and its end q, where 1.001 (cos p - cos q) = q - p.
    let leaves = (1.0 / 1.001_f64).asin();
    let (mut low, mut high) = (std::f64::consts::PI - leaves, std::f64::consts::PI);
    for _ in 0..60 {
        let middle = 0.5 * (low + high);
        let is_back = 1.001 * (leaves.cos() - middle.cos()) < middle - leaves;
        *(if is_back { &mut high } else { &mut low }) = middle;
    }
    let phases = (0..2 * periods).flat_map(|k| [leaves, low].map(|phase| phase + std::f64::consts::PI * f64::from(k)));
    let expected: Vec<f64> = phases.map(|phase| phase / omega).collect();
    let square = json!({"A": [[1, 0], [-1, 0], [0, 1], [0, -1]], "b": [1, 1, 1, 1], "of": ["z1", "z2"]});
    let ball = json!({"ball": {"of": ["z1", "z2"], "radius": 1}});
    // If the multiplier z is on an edge of the square, its component z2 stays constant, and x2 moves.
    for (name, set, drives) in [
        ("ball", ball, ["0.6006*sin(40*t)", "0.8008*sin(40*t)"]),
        ("square", json!({"polyhedron": square}), ["1.001*sin(40*t)", "0.3*sin(40*t)"]),
        ("edge", json!({"polyhedron": square}), ["1.001*sin(40*t)", "1.5"]),
    ] {
        for stages in [3, 5, 7] {
            let solution = solve(&json!({
                "problem": {"lcs": {
                    "A": [[0, 0], [0, 0]], "B": [[1, 0], [0, 1]], "C": [[1, 0], [0, 1]], "D": [[0, 0], [0, 0]],
                    "a": drives, "g": [0, 0], "initial": [0, 0], "set": [set],
                }},
                "time": {"end": 2.0 * std::f64::consts::PI * f64::from(periods) / omega},
                "method": {"rtol": 1e-8, "atol": 1e-10, "stages": stages},
            }));
            let times = events(&solution, "z1");
            assert_eq!(times.len(), expected.len(), "{name}, {stages} stages: {times:?}");
            for (time, expected) in times.iter().zip(&expected) {
                assert!((time - expected).abs() < 1e-7, "{name}, {stages} stages: {time} instead of {expected}");
            }
        }
    }
}

/// The equations `R i + v = x`, `-i + v/R = y/R` of two free variables have the solution `R i = (x - y)/2`, `v = (x +
/// y)/2` whatever `R` is, while their coefficients differ by up to `1e18`.
#[test]
fn free_variables_are_determined_whatever_their_units() {
    for r in [1e-9, 1e-6, 1e-3, 1.0, 1e3, 1e6, 1e8, 1e9] {
        for times in [json!("steps"), json!({"count": 9})] {
            let solution = solve(&json!({"problem": {"dvi": {"parameters": {"R": r},
                "states": {"x": {"initial": 1, "rate": "y - 0.1*v - 0.1*R*i"}, "y": {"initial": 0.5, "rate": "-4*x"}},
                "variables": {"i": {"inequality": "R*i + v - x"}, "v": {"inequality": "-i + v/R - y/R"}},
                "set": [{"free": ["i", "v"]}]}}, "time": {"end": 2}, "output": {"times": times}}));
            assert!(solution.verdict.trusted && solution.verdict.caveats.is_empty(), "{r:e}: {:?}", solution.verdict);
            let [x, y, i, v] = ["x", "y", "i", "v"].map(|name| column(&solution, name));
            for k in 0..x.len() {
                let off = [r * i[k] - 0.5 * (x[k] - y[k]), v[k] - 0.5 * (x[k] + y[k])];
                assert!(off.iter().all(|off| off.abs() < 1e-9), "{off:?} for {r:e}");
            }
        }
    }
}
