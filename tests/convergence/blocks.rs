//! The order `2s - 1` of Radau IIA methods with `s` stages over whole trajectories whose switches change the active
//! face of a set of several variables: from the interior of a ball, a cone or a polyhedron to its boundary and back,
//! along the boundary of a ball or a cone while the direction turns, between the faces of a simplex, and between the
//! sides of a polygon.

use super::switches::{System, assert_order};
use serde_json::json;

/// A body of unit mass on a slope, pushed across it, with a friction coefficient of twice the gradient: if `w` is the
/// tangent of half the angle between the velocity and the downward direction, the speed is `C w (1 + w^2)/2`. The
/// body turns down the slope and stops in finite time (d ln speed / d angle = (2 - cos)/sin).
#[test]
fn a_body_pushed_across_a_slope_turns_down_and_stops() {
    let specification = json!({"problem": {"dvi": {
        "states": {
            "x": {"initial": 0, "rate": "vx"}, "y": {"initial": 0, "rate": "vy"},
            "vx": {"initial": 0, "rate": "1 - F"}, "vy": {"initial": 1.5, "rate": "-H"}
        },
        "variables": {"F": {"inequality": "-vx"}, "H": {"inequality": "-vy"}},
        "set": [{"ball": {"of": ["F", "H"], "radius": 2}}]}},
        "time": {"end": 1.25}});
    // With the constant C = 3/2 and the tangent w = 1 of half the angle of the velocity at the start, the sliding body
    // stops at the time C (w + w^3/3)/2 = 1, at the point (C^2 (w^2/2 - w^6/6)/4, C^2 (w^3/3 + w^5/5)/2).
    assert_order(&System {
        specification,
        end: vec![("x", 0.1875), ("y", 0.6)],
        switches: vec![1.0],
        coarsest: [80, 20, 10],
    });
}

/// A block on a plane is pushed by the force `f = (1 + s) u + s^2/2 u'` with `u = (cos s, sin s)`, `s = t - 1`, which
/// is below the friction limit up to `t = 1`; then the block moves with the velocity `s^2/2 u`.
#[test]
fn a_body_at_rest_starts_to_slide_along_a_curve() {
    let specification = json!({"problem": {"dvi": {
        "states": {
            "vx": {"initial": 0, "rate": "t*cos(t - 1) - (t - 1)^2/2*sin(t - 1) - F"},
            "vy": {"initial": 0, "rate": "t*sin(t - 1) + (t - 1)^2/2*cos(t - 1) - H"}
        },
        "variables": {"F": {"inequality": "-vx"}, "H": {"inequality": "-vy"}},
        "set": [{"ball": {"of": ["F", "H"], "radius": 1}}]}},
        "time": {"end": 3}});
    let end = 2.0_f64;
    assert_order(&System {
        specification,
        end: vec![("vx", 2.0 * end.cos()), ("vy", 2.0 * end.sin())],
        switches: vec![1.0],
        coarsest: [80, 20, 10],
    });
}

/// An oscillator in the plane that moves along a line: dry friction of size `r` reduces the amplitude by `2 r` in
/// every half period.
#[test]
fn an_oscillator_with_dry_friction_turns_back_in_the_plane() {
    let specification = json!({"problem": {"dvi": {
        "states": {
            "x": {"initial": 2.4, "rate": "v"}, "v": {"initial": 0, "rate": "-x - F"},
            "y": {"initial": 3.2, "rate": "w"}, "w": {"initial": 0, "rate": "-y - H"}
        },
        "variables": {"F": {"inequality": "-v"}, "H": {"inequality": "-w"}},
        "set": [{"ball": {"of": ["F", "H"], "radius": 0.75}}]}},
        "time": {"end": 10}});
    let pi = std::f64::consts::PI;
    assert_order(&System {
        specification,
        end: vec![("x", 0.3), ("y", 0.4)],
        switches: vec![pi, 2.0 * pi, 3.0 * pi],
        coarsest: [500, 40, 20],
    });
}

/// A point `(s, x, y)` above a cone circles and is pressed towards the cone: above the cone `s' = -cos t`, on the
/// cone half of that, and it lifts off when the pressure ends.
#[test]
fn a_point_circles_down_a_cone_and_lifts_off() {
    let specification = json!({"problem": {"dvi": {
        "states": {
            "s": {"initial": 1.5, "rate": "-cos(t) + p"},
            "x": {"initial": 1, "rate": "-3*y + q"}, "y": {"initial": 0, "rate": "3*x + r"}
        },
        "variables": {"p": {"inequality": "s"}, "q": {"inequality": "x"}, "r": {"inequality": "y"}},
        "set": [{"second_order_cone": ["p", "q", "r"]}]}},
        "time": {"end": 2.5}});
    let pi = std::f64::consts::PI;
    assert_order(&System {
        specification,
        end: vec![("s", 1.75 - 2.5_f64.sin()), ("x", 0.75 * 7.5_f64.cos()), ("y", 0.75 * 7.5_f64.sin())],
        switches: vec![pi / 6.0, pi / 2.0],
        coarsest: [200, 40, 20],
    });
}

/// A Filippov system of three regions with a constant direction of motion in each, and the speed `5 e^-t` in all of
/// them: as functions of the travelled length `5 (1 - e^-t)`, the coordinates are piecewise linear.
#[test]
fn a_sliding_mode_between_three_regions() {
    let specification = json!({"problem": {"dvi": {
        "states": {
            "x": {"initial": 2, "rate": "-a*(z1 - (z2 + z3)/2)"},
            "y": {"initial": 1, "rate": "-a*sqrt(3)/2*(z2 - z3)"},
            "a": {"initial": 5, "rate": "-a"},
            "way": {"initial": 0, "rate": "x"}
        },
        "variables": {
            "z1": {"inequality": "-x"},
            "z2": {"inequality": "x/2 - sqrt(3)/2*y"},
            "z3": {"inequality": "x/2 + sqrt(3)/2*y"}
        },
        "set": [{"simplex": ["z1", "z2", "z3"]}]}},
        "time": {"end": 2}});
    let (line, origin) = (2.0 - 1.0 / 3.0_f64.sqrt(), 2.0 + 3.0_f64.sqrt());
    let time = |length: f64| -(1.0 - length / 5.0).ln();
    let (first, second) = (time(line), time(origin));
    // The antiderivative by time of a coordinate c - 5 (1 - e^-t) of the solution, where c is its value at the start.
    let integral = |c: f64, t: f64| (c - 5.0) * t - 5.0 * (-t).exp();
    let way = integral(2.0, first) - integral(2.0, 0.0) + 0.25 * (integral(origin, second) - integral(origin, first));
    assert_order(&System {
        specification,
        end: vec![("way", way)],
        switches: vec![first, second],
        coarsest: [40, 10, 5],
    });
}

/// Sliding friction whose set of forces is a square that stands on a corner: the friction force is first at a corner,
/// then on a side, and then the body rests.
#[test]
fn friction_with_a_polygon_of_directions() {
    let specification = json!({"problem": {"dvi": {
        "states": {
            "x": {"initial": 0, "rate": "v"}, "y": {"initial": 0, "rate": "w"},
            "v": {"initial": 3, "rate": "-v - F"}, "w": {"initial": 1, "rate": "-w - H"}
        },
        "variables": {"F": {"inequality": "-v"}, "H": {"inequality": "-w"}},
        "set": [{"polyhedron": {"of": ["F", "H"], "A": [[1, 1], [1, -1], [-1, 1], [-1, -1]], "b": [1, 1, 1, 1]}}]}},
        "time": {"end": 2}});
    let (three, ratio) = (3.0_f64.ln(), (5.0 / 3.0_f64).ln());
    assert_order(&System {
        specification,
        end: vec![("x", 3.0 - three - 0.5 * ratio), ("y", 1.0 - 0.5 * ratio)],
        switches: vec![three, 5.0_f64.ln()],
        coarsest: [20, 10, 5],
    });
}
