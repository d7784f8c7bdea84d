//! Derivatives of problems whose variables are in balls, cones, simplices and polyhedra, compared with closed forms:
//! on every face of such a set, across switches between faces, in forward and adjoint mode, and for independent
//! switches at the same time.

use crate::systems::harness::{column, last, solve};
use dvi::problem::Control;
use dvi::solution::Solution;
use dvi::specification::Specification;
use serde_json::{Value, json};

fn derived(problem: &Value, end: f64, asked: &Value) -> Solution {
    let solution = solve(&json!({"problem": {"dvi": problem}, "time": {"end": end},
        "method": {"rtol": 1e-10, "atol": 1e-12}, "output": {"times": {"count": 9}}, "sensitivities": asked}));
    assert!(solution.verdict.trusted, "{:?}", solution.verdict);
    solution
}

/// Asserts that the derivatives of the final value of the field `of` have the values `exact`, in forward and in
/// adjoint mode.
#[track_caller]
fn assert_slopes(problem: &Value, end: f64, of: &str, exact: &[(&str, f64)]) {
    let to: Vec<&str> = exact.iter().map(|(name, _)| *name).collect();
    let forward = derived(problem, end, &json!({"to": to}));
    let backward = derived(problem, end, &json!({"to": to, "mode": "adjoint", "objective": {"final": of}}));
    for (name, exact) in exact {
        let tolerance = 1e-8 * exact.abs().max(1.0);
        let found = last(&forward, &format!("d{of}/d{name}"));
        assert!((found - exact).abs() <= tolerance, "d{of}/d{name}: {found:e} for {exact:e}");
        let found = backward.gradient[*name];
        assert!((found - exact).abs() <= tolerance, "d{of}/d{name} in adjoint mode: {found:e} for {exact:e}");
    }
}

/// The differential variational inequality `x' = z`, where `z` is the projection of the constant vector `a` onto a set.
fn projection(set: &Value, count: usize, parameters: &Value) -> Value {
    let mut problem = json!({"parameters": parameters, "states": {}, "variables": {}, "set": [set]});
    for k in 1..=count {
        problem["states"][format!("x{k}")] = json!({"initial": 0, "rate": format!("z{k}")});
        problem["variables"][format!("z{k}")] = json!({"inequality": format!("z{k} - a{k}")});
    }
    problem
}

#[test]
fn points_of_balls_cones_simplices_and_polyhedra_move_with_what_they_are_nearest_to() {
    let end = 2.0;
    // The projection onto a ball is z = r a/|a|.
    let ball = json!({"ball": {"of": ["z1", "z2"], "radius": "r"}});
    let problem = projection(&ball, 2, &json!({"a1": 3, "a2": 4, "r": 2}));
    assert_slopes(
        &problem,
        end,
        "x1",
        &[("a1", end * 2.0 * 16.0 / 125.0), ("a2", -end * 2.0 * 12.0 / 125.0), ("r", end * 0.6)],
    );
    // The projection of (s, v) onto the second-order cone is z = (1 + s/|v|)/2 (|v|, v).
    let cone = json!({"second_order_cone": ["z1", "z2", "z3"]});
    let problem = projection(&cone, 3, &json!({"a1": 1, "a2": 3, "a3": 4}));
    assert_slopes(&problem, end, "x1", &[("a1", end * 0.5), ("a2", end * 0.3), ("a3", end * 0.4)]);
    assert_slopes(
        &problem,
        end,
        "x2",
        &[("a1", end * 0.3), ("a2", end * 0.5 * (1.2 - 9.0 / 125.0)), ("a3", -end * 0.5 * 12.0 / 125.0)],
    );
    // In the projection onto the simplex the third component is zero; the other two are shifted equally to the sum
    // one.
    let simplex = json!({"simplex": ["z1", "z2", "z3"]});
    let problem = projection(&simplex, 3, &json!({"a1": 0.9, "a2": 0.6, "a3": -0.5}));
    assert_slopes(&problem, end, "x1", &[("a1", end * 0.5), ("a2", -end * 0.5), ("a3", 0.0)]);
    // The projection onto the half plane lies on its boundary z1 + 2 z2 = 1.
    let half_plane = json!({"polyhedron": {"A": [[1, 2]], "b": [1], "of": ["z1", "z2"]}});
    let problem = projection(&half_plane, 2, &json!({"a1": 1, "a2": 3}));
    assert_slopes(&problem, end, "x1", &[("a1", end * 0.8), ("a2", -end * 0.4)]);
}

#[test]
fn derivatives_go_on_where_a_point_comes_to_the_boundary_and_leaves_it() {
    // The variable of a ball constraint is z = a sin t up to |z| = r at t1 = arcsin(r/a), then has |z| = r until pi -
    // t1: x = 2 a (1 - cos t1) + r (pi - 2 t1) at t = pi.
    let ball = json!({"ball": {"of": ["z1", "z2"], "radius": "r"}});
    let problem = json!({"parameters": {"a": 5, "r": 3}, "set": [ball],
        "states": {"x1": {"initial": 0, "rate": "z1"}, "x2": {"initial": 0, "rate": "z2"}},
        "variables": {"z1": {"inequality": "z1 - 0.6*a*sin(t)"}, "z2": {"inequality": "z2 - 0.8*a*sin(t)"}}});
    let first = 0.6_f64.asin();
    let pi = std::f64::consts::PI;
    assert_slopes(&problem, pi, "x1", &[("a", 0.6 * 2.0 * (1.0 - first.cos())), ("r", 0.6 * (pi - 2.0 * first))]);
}

#[test]
fn a_point_that_friction_stops_in_a_plane_has_the_derivatives_of_its_way() {
    // For a point with friction, v' = -mu v/|v| from v0, rest begins at |v0|/mu, after the distance x = v0 |v0|/(2 mu).
    let problem = json!({"parameters": {"mu": 2, "u": 3, "w": 4},
        "set": [{"ball": {"of": ["f1", "f2"], "radius": "mu"}}],
        "states": {"x1": {"initial": 0, "rate": "v1"}, "x2": {"initial": 0, "rate": "v2"},
            "v1": {"initial": "u", "rate": "-f1"}, "v2": {"initial": "w", "rate": "-f2"}},
        "variables": {"f1": {"inequality": "-v1"}, "f2": {"inequality": "-v2"}}});
    let exact = [("mu", -3.0 * 5.0 / 8.0), ("u", (5.0 + 9.0 / 5.0) / 4.0), ("w", 12.0 / 5.0 / 4.0)];
    assert_slopes(&problem, 4.0, "x1", &exact);
    let solution = derived(&problem, 4.0, &json!({"to": ["mu", "u", "w"]}));
    for name in ["dv1/du", "dv2/du", "dv1/dmu"] {
        assert!(column(&solution, name).last().is_some_and(|slope| slope.abs() < 1e-9), "{name}");
    }
    // Before friction stops the point, its velocity is v = v0 (1 - mu t/|v0|).
    assert_slopes(&problem, 1.0, "v1", &[("mu", -0.6), ("u", 1.0 - 2.0 / 5.0 + 2.0 * 9.0 / 125.0)]);
}

#[test]
fn a_point_that_friction_stops_beside_a_force_has_the_derivatives_of_its_way() {
    // The velocity of v' = F e - R v/|v|, with F < R, turns towards the direction e of the force. With the speed s
    // and the component u of v along e, (2 R s u + F (u^2 + s^2))' = -4 (R^2 - F^2) u, whose integral gives the
    // distance along e. At the stop the direction of v has an unbounded rate, a fractional power of the remaining
    // time.
    for force in [0.5_f64, 1.0, 2.5, 4.0] {
        let (r, u, w) = (5.0_f64, 4.0_f64, 3.0_f64);
        let s = u.hypot(w);
        let problem = json!({"parameters": {"F": force, "R": r, "u": u}, "set": [{"ball": {"of": ["f1", "f2"], "radius": "R"}}],
            "states": {"x": {"initial": 0, "rate": "v1"}, "y": {"initial": 0, "rate": "v2"},
                "v1": {"initial": w, "rate": "-f1"}, "v2": {"initial": "u", "rate": "F - f2"}},
            "variables": {"f1": {"inequality": "-v1"}, "f2": {"inequality": "-v2"}}});
        let (top, below) = (2.0 * r * s * u + force * (u * u + s * s), 4.0 * (r * r - force * force));
        let of_force = ((u * u + s * s) + top * 8.0 * force / below) / below;
        let of_friction = (2.0 * s * u - top * 8.0 * r / below) / below;
        let of_speed = (2.0 * r * (s + u * u / s) + 4.0 * force * u) / below;
        let solution =
            solve(&json!({"problem": {"dvi": problem}, "time": {"end": 9}, "method": {"rtol": 1e-8, "atol": 1e-10},
            "output": {"times": {"count": 9}}, "sensitivities": {"to": ["F", "R", "u"]}}));
        // If the exponent of the power of the remaining time is small, the direction of the velocity turns too fast to
        // be resolved by steps, and the verdict may doubt the solution.
        assert!(solution.verdict.trusted || force < 2.0, "{force}: {:?}", solution.verdict);
        assert!((last(&solution, "y") - top / below).abs() < 1e-8, "{force}");
        for (name, exact) in [("dy/dF", of_force), ("dy/dR", of_friction), ("dy/du", of_speed)] {
            let found = last(&solution, name);
            assert!((found - exact).abs() < 1e-6 * exact.abs(), "{force}: {name} is {found:e} for {exact:e}");
        }
    }
}

#[test]
fn switches_at_one_time_that_commute_have_their_own_derivatives() {
    // Two blocks stopped by friction rest from t = 2 on, each after the distance v^2/(2 mu), and two signs in one sum
    // change at t = 1.
    let problem = json!({"parameters": {"mu1": 1, "mu2": 2, "v1": 2, "v2": 4, "a1": -1, "a2": -2},
        "set": [{"box": {"of": ["p1", "p2", "s1", "s2"], "lower": -1, "upper": 1}}],
        "states": {"w1": {"initial": "v1", "rate": "-mu1*p1"}, "w2": {"initial": "v2", "rate": "-mu2*p2"},
            "x": {"initial": 0, "rate": "w1 + 3*w2"},
            "y1": {"initial": "a1", "rate": 1}, "y2": {"initial": "a2", "rate": 2}, "s": {"initial": 0, "rate": "s1 + s2"}},
        "variables": {"p1": {"inequality": "-w1"}, "p2": {"inequality": "-w2"},
            "s1": {"inequality": "-y1"}, "s2": {"inequality": "-y2"}}});
    assert_slopes(&problem, 3.0, "x", &[("mu1", -2.0), ("mu2", -6.0), ("v1", 2.0), ("v2", 6.0), ("a1", 0.0)]);
    assert_slopes(&problem, 3.0, "s", &[("a1", 2.0), ("a2", 1.0), ("mu1", 0.0)]);
}

#[test]
fn switches_at_one_time_that_do_not_commute_have_no_derivative() {
    // For y' = 2 + s1 and the sign s2 of y, the rate of y changes at the switch of the relay s1, which coincides with
    // that of s2: the two switches do not commute.
    let problem = json!({"dvi": {"parameters": {"a": -1, "b": -1},
        "set": [{"box": {"of": ["s1", "s2"], "lower": -1, "upper": 1}}],
        "states": {"x": {"initial": "a", "rate": 1}, "y": {"initial": "b", "rate": "2 + s1"}, "s": {"initial": 0, "rate": "s2"}},
        "variables": {"s1": {"inequality": "-x"}, "s2": {"inequality": "-y"}}}});
    let asked = json!({"problem": problem, "time": {"end": 3}, "sensitivities": {"to": ["a", "b"]}});
    let specification = Specification::from_json(asked.to_string().as_bytes()).expect("a specification");
    let solution = dvi::solve(&specification, &Control::new());
    let why = solution.error.map(|error| error.message).unwrap_or_default();
    assert!(why.contains("coincide"), "{why} {:?}", solution.verdict);
}
