//! Derivatives of motions with located impacts, compared with derivatives of closed forms. Closed forms are
//! differentiated by the complex step `f'(p) = Im f(p + i h)/h`, which is exact to rounding (Squire and Trapp 1998).

use crate::systems::harness::{column, last, solve};
use dvi::problem::Control;
use dvi::solution::{SlopedEvent, Solution, Status};
use dvi::specification::Specification;
use nalgebra::Complex;
use serde_json::{Value, json};

type C = Complex<f64>;

const H: f64 = 1e-40;

fn derived(problem: Value, end: f64, asked: Value) -> Solution {
    solve(&json!({"problem": {"mechanical": problem}, "time": {"end": end},
        "method": {"impacts": "locate", "rtol": 1e-10, "atol": 1e-12},
        "output": {"times": {"count": 41}}, "sensitivities": asked}))
}

/// Returns the derivatives of the closed form `f` by each of its parameters, by complex steps.
fn slopes<const N: usize>(values: [f64; N], f: impl Fn([C; N]) -> C) -> [f64; N] {
    std::array::from_fn(|k| {
        let mut moved = values.map(C::from);
        moved[k].im = H;
        f(moved).im / H
    })
}

/// Asserts that the sensitivities of the quantity `of` by the parameters `to` equal the derivatives of the closed
/// form `exact` at all output times but those of events.
#[track_caller]
fn assert_slopes<const N: usize>(
    solution: &Solution,
    of: &str,
    to: [&str; N],
    values: [f64; N],
    exact: impl Fn(f64, [C; N]) -> C,
) {
    assert!(solution.verdict.trusted, "{:?}", solution.verdict);
    for (row, &t) in solution.trajectory.t.iter().enumerate() {
        for (name, expected) in to.iter().zip(slopes(values, |p| exact(t, p))) {
            let found = column(solution, &format!("d{of}/d{name}"))[row];
            let off = (found - expected).abs() / expected.abs().max(1.0);
            assert!(off <= 1e-8, "d{of}/d{name} at {t}: {found:e} for {expected:e}");
        }
    }
}

/// Closed forms of a ball thrown up from a height: its height, its velocity and the integral of its height over time,
/// the times of its impacts, and the limit of these times.
struct Ball {
    g: C,
    e: C,
    first: C,
    speed: C,
    height: C,
    thrown: C,
}

impl Ball {
    fn new([height, thrown, g, e]: [C; 4]) -> Self {
        let speed = (thrown * thrown + g * height * 2.0).sqrt();
        Self { g, e, first: (thrown + speed) / g, speed, height, thrown }
    }

    fn limit(&self) -> C {
        self.first + self.speed * 2.0 / self.g * self.e / (C::from(1.0) - self.e)
    }

    fn impact(&self, k: usize) -> C {
        (1..k).fold(self.first, |t, i| t + self.speed * self.e.powu(i as u32) * 2.0 / self.g)
    }

    fn at(&self, t: f64) -> [C; 3] {
        let flight = |s: C, v: C, y: C| {
            [y + v * s - self.g * s * s * 0.5, v - self.g * s, y * s + v * s * s * 0.5 - self.g * s * s * s / 6.0]
        };
        if t < self.first.re {
            return flight(C::from(t), self.thrown, self.height);
        }
        let mut area = flight(self.first, self.thrown, self.height)[2];
        let (mut begin, mut speed) = (self.first, self.speed);
        // After 4000 flights the height and the duration of the ball's next flight are below rounding.
        for _ in 0..4000 {
            speed *= self.e;
            let end = begin + speed * 2.0 / self.g;
            if t < end.re {
                let [y, v, part] = flight(C::from(t) - begin, speed, C::from(0.0));
                return [y, v, area + part];
            }
            area += flight(end - begin, speed, C::from(0.0))[2];
            begin = end;
        }
        [C::from(0.0), C::from(0.0), area]
    }
}

fn ball() -> Value {
    json!({"parameters": {"h": 1, "w": 0.5, "g": 9.81, "e": 0.6, "m": 2},
        "definitions": {"energy": "m*y_dot^2/2 + m*g*y"},
        "integrals": {"area": "y", "way": "y_dot", "squares": "y_dot^2"},
        "coordinates": {"y": {"initial": "h", "velocity": "w"}}, "mass": [["m"]], "potential": "m*g*y",
        "contacts": [{"name": "floor", "gap": "y", "restitution": "e"}]})
}

#[test]
fn all_derivatives_of_the_bouncing_ball_before_at_and_after_the_accumulation() {
    let (to, values) = (["h", "w", "g", "e"], [1.0, 0.5, 9.81, 0.6]);
    let asked = json!({"to": ["h", "w", "g", "e", "m"], "of": ["y", "y_dot", "energy", "area", "way", "squares"]});
    let solution = derived(ball(), 3.0, asked);
    let limit = Ball::new(values.map(C::from)).limit().re;
    assert!((1.8..2.0).contains(&limit), "the accumulation is within the run: {limit}");
    let ball = |p: [C; 4]| Ball::new(p);
    assert_slopes(&solution, "y", to, values, |t, p| ball(p).at(t)[0]);
    assert_slopes(&solution, "y_dot", to, values, |t, p| ball(p).at(t)[1]);
    assert_slopes(&solution, "area", to, values, |t, p| ball(p).at(t)[2]);
    // The integral of the ball's velocity over time is its height minus the initial one.
    assert_slopes(&solution, "way", to, values, |t, p| ball(p).at(t)[0] - p[0]);
    // Between impacts the height y of the ball satisfies (y y')' = y'^2 - g y, and y vanishes at the impacts, where
    // y' jumps: the integral of y'^2 follows from that of y.
    assert_slopes(&solution, "squares", to, values, |t, p| {
        let [y, v, area] = ball(p).at(t);
        y * v - p[0] * p[1] + p[2] * area
    });
    assert_slopes(&solution, "energy", to, values, |t, p| {
        let [y, v, _] = ball(p).at(t);
        (v * v * 0.5 + p[2] * y) * 2.0
    });
    // The motion of a bouncing ball does not depend on its mass.
    for of in ["y", "y_dot", "area"] {
        assert!(column(&solution, &format!("d{of}/dm")).iter().all(|slope| slope.abs() < 1e-12), "{of}");
    }
    let checked = solution.sensitivities.as_ref().expect("a check");
    assert!((checked.derivative - checked.finite_difference).abs() <= checked.uncertainty, "{checked:?}");

    // Compares the derivatives of the times of all impacts, and of the accumulation point of the impacts.
    let impacts: Vec<_> = solution.event_slopes.iter().filter(|event| event.kind == SlopedEvent::Impact).collect();
    assert!(impacts.len() > 20, "{} impacts", impacts.len());
    for (k, impact) in impacts.iter().enumerate() {
        for (name, expected) in to.iter().zip(slopes(values, |p| ball(p).impact(k + 1))) {
            let found = impact.slopes[*name];
            assert!((found - expected).abs() <= 1e-8 * expected.abs(), "impact {k} by {name}: {found} for {expected}");
        }
        // The transversality of an impact is the rate at which the gap closes, which is the speed of the impact.
        let speed = (0.25 + 2.0 * 9.81_f64).sqrt() * 0.6_f64.powi(k as i32);
        assert!((impact.transversality / speed - 1.0).abs() < 1e-4);
    }
    let of_limit = solution.event_slopes.last().expect("events");
    assert_eq!((of_limit.kind, of_limit.of.as_str()), (SlopedEvent::Accumulation, "floor"));
    assert!((of_limit.t - limit).abs() < 1e-12 * limit, "{} for {limit}", of_limit.t);
    for (name, expected) in to.iter().zip(slopes(values, |p| ball(p).limit())) {
        let found = of_limit.slopes[*name];
        assert!((found - expected).abs() <= 1e-8 * expected.abs(), "the limit by {name}: {found} for {expected}");
    }
}

#[test]
fn a_ball_that_slides_while_its_impacts_accumulate() {
    // Friction acts with mu times the impulse of the floor, which is the change of the vertical velocity plus the
    // impulse of gravity. Hence x = u t - mu (y - h - w t + g t^2/2) before, at and after the limit of the impacts.
    let (to, values) = (["h", "w", "g", "e", "mu", "u"], [1.0, 0.5, 9.81, 0.6, 0.1, 6.0]);
    let mut slides = ball();
    slides["parameters"]["mu"] = json!(0.1);
    slides["parameters"]["u"] = json!(6);
    slides["coordinates"]["x"] = json!({"initial": 0, "velocity": "u"});
    slides["mass"] = json!([["m", 0], [0, "m"]]);
    slides["contacts"][0]["friction"] = json!({"coefficient": "mu", "slip": ["x_dot"]});
    for key in ["definitions", "integrals"] {
        slides.as_object_mut().unwrap().remove(key);
    }
    let solution = derived(slides, 3.0, json!({"to": to, "of": ["x", "x_dot", "y"]}));
    let motion = |t: f64, [h, w, g, e, mu, u]: [C; 6]| {
        let [y, v, _] = Ball::new([h, w, g, e]).at(t);
        let [x, x_dot] = [y - h - w * t + g * t * t * 0.5, v - w + g * t];
        [u * t - mu * x, u - mu * x_dot, y]
    };
    for (k, of) in ["x", "x_dot", "y"].into_iter().enumerate() {
        assert_slopes(&solution, of, to, values, |t, p| motion(t, p)[k]);
    }
}

#[test]
fn a_body_that_a_growing_load_lifts_off_at_a_time_without_rounding() {
    // The body detaches at t = g/k and rises by y'' = k t - g: y = k (t - g/k)^3/6. At the detachment the
    // acceleration is exactly zero, too.
    for (g, k) in [(10.0, 5.0), (9.81, 5.0), (8.0, 2.0), (1e-6, 1e-6), (3e5, 1e5)] {
        let problem = json!({"parameters": {"g": g, "k": k}, "coordinates": {"y": {"initial": 0, "velocity": 0}},
            "mass": [[1]], "forces": {"y": "k*t - g"}, "contacts": [{"name": "floor", "gap": "y"}]});
        let solution = derived(problem, g / k + 1.5, json!({"to": ["g", "k"]}));
        let flown = |t: f64| (t - g / k).max(0.0);
        assert!(solution.verdict.trusted, "{g}, {k}: {:?}", solution.verdict);
        for (row, &t) in solution.trajectory.t.iter().enumerate() {
            let flown = flown(t);
            let exact = [flown.powi(3) / 6.0 + flown.powi(2) * g / (2.0 * k), -flown.powi(2) / 2.0];
            for (name, exact) in ["dy/dk", "dy/dg"].into_iter().zip(exact) {
                let found = column(&solution, name)[row];
                assert!((found - exact).abs() <= 1e-8 * (1.0 + g / k), "{name} at {t}: {found:e} for {exact:e}");
            }
        }
    }
}

#[test]
fn a_pendulum_that_strikes_a_wall_does_not_depend_on_its_mass() {
    // A pendulum at a wall: the forces of gravity and of the rod are proportional to the mass, so that the motion does
    // not depend on it.
    let problem = json!({"parameters": {"l": 1.0086, "g": 9.81, "e": 0.43, "th": 1.086, "xw": 0.286, "m": 1.36},
        "coordinates": {"x": {"initial": "l*sin(th)"}, "y": {"initial": "-l*cos(th)"}}, "mass": [["m", 0], [0, "m"]],
        "potential": "m*g*y", "forces": {}, "joints": [{"name": "rod", "constraint": "x^2 + y^2 - l^2"}],
        "contacts": [{"name": "wall", "gap": "x + xw", "restitution": "e"}]});
    let solution = derived(problem, 1.75, json!({"to": ["m", "xw"]}));
    assert!(solution.verdict.trusted, "{:?}", solution.verdict);
    for of in ["x", "y", "x_dot", "y_dot"] {
        let by_mass = column(&solution, &format!("d{of}/dm")).iter().fold(0.0_f64, |most, slope| most.max(slope.abs()));
        assert!(by_mass < 1e-9, "d{of}/dm: {by_mass:e}");
    }
    assert!(!solution.trajectory.events.is_empty() && last(&solution, "dx/dxw").abs() > 1e-3);
}

#[test]
fn the_limit_of_a_ball_that_loses_little_at_each_impact() {
    // The run of a bouncing ball has some two hundred impacts; the flights after the last located one add up to more
    // than 1e-9 of the end time.
    let mut slow = ball();
    slow["parameters"]["e"] = json!(0.9);
    let solution = derived(slow, 12.0, json!({"to": ["e", "g"], "of": ["y"]}));
    let of_limit = solution.event_slopes.last().expect("events");
    assert_eq!(of_limit.kind, SlopedEvent::Accumulation);
    let exact = |[e, g]: [C; 2]| Ball::new([C::from(1.0), C::from(0.5), g, e]).limit();
    for (name, expected) in ["e", "g"].iter().zip(slopes([0.9, 9.81], exact)) {
        let found = of_limit.slopes[*name];
        assert!((found / expected - 1.0).abs() <= 1e-8, "the limit by {name}: {found} for {expected}");
    }
}

#[test]
fn a_ball_whose_run_does_not_begin_at_zero_has_the_same_derivatives() {
    let solution = solve(&json!({"problem": {"mechanical": ball()}, "time": {"start": 100, "end": 102.5},
        "method": {"impacts": "locate", "rtol": 1e-10, "atol": 1e-12},
        "output": {"times": {"count": 11}}, "sensitivities": {"to": ["e", "g"], "of": ["y", "area"]}}));
    for (row, &t) in solution.trajectory.t.iter().enumerate() {
        let exact = slopes([0.6, 9.81], |[e, g]| Ball::new([C::from(1.0), C::from(0.5), g, e]).at(t - 100.0)[2]);
        for (name, expected) in ["e", "g"].iter().zip(exact) {
            let found = column(&solution, &format!("darea/d{name}"))[row];
            assert!((found - expected).abs() < 1e-8, "darea/d{name} at {t}: {found} for {expected}");
        }
    }
}

/// Two balls on a line with the masses `left` and `right` and the restitution coefficient `e`, of which the left one
/// catches up with the right one.
fn two_balls(left: f64, right: f64, e: f64) -> Value {
    json!({"parameters": {"a": left, "b": right, "e": e}, "coordinates": {"x": {"initial": 0, "velocity": 2},
        "y": {"initial": 1, "velocity": -1}}, "mass": [["a", 0], [0, "b"]],
        "contacts": [{"name": "pair", "gap": "y - x - 0.13", "restitution": "e"}]})
}

#[test]
fn two_colliding_balls() {
    let to = ["x.initial", "y.initial", "x_dot.initial", "y_dot.initial", "a", "b", "e"];
    for (left, right, e) in [(1.0, 1.0, 1.0), (1.0, 1.0, 0.0), (3.0, 0.5, 0.4)] {
        let values = [0.0, 1.0, 2.0, -1.0, left, right, e];
        let solution = derived(two_balls(left, right, e), 1.0, json!({"to": to}));
        let exact = |t: f64, p: [C; 7]| -> [C; 4] {
            let [x, y, v, w, a, b, e] = p;
            let meet = (y - x - 0.13) / (v - w);
            if t < meet.re {
                return [x + v * t, y + w * t, v, w];
            }
            let impulse = a * b / (a + b) * (v - w) * (e + 1.0);
            let (v1, w1) = (v - impulse / a, w + impulse / b);
            [x + v * meet + v1 * (C::from(t) - meet), y + w * meet + w1 * (C::from(t) - meet), v1, w1]
        };
        for (k, of) in ["x", "y", "x_dot", "y_dot"].into_iter().enumerate() {
            assert_slopes(&solution, of, to, values, |t, p| exact(t, p)[k]);
        }
    }
}

#[test]
fn a_heavy_ball_and_a_light_one_that_it_pushes_go_on_with_the_velocity_of_the_heavy_one() {
    // The velocities v1', v2' after the impact of two balls have the derivatives d(v1', v2')/d(v1, v2) = (1, 0; 1, 0)
    // if the first ball is far heavier and the impact is inelastic.
    let solution = derived(two_balls(1e12, 1.0, 0.0), 1.0, json!({"to": ["x_dot.initial", "y_dot.initial"]}));
    let slope = |of: &str, by: &str| last(&solution, &format!("d{of}_dot/d{by}_dot.initial"));
    let found = [slope("x", "x"), slope("x", "y"), slope("y", "x"), slope("y", "y")];
    for (found, expected) in found.into_iter().zip([1.0, 0.0, 1.0, 0.0]) {
        assert!((found - expected).abs() < 1e-10, "{found} for {expected}");
    }
}

/// A block on a rough floor, pushed by a force `k t` that grows with time.
fn block() -> Value {
    json!({"parameters": {"m": 2, "g": 9.81, "mu": 0.3, "w": 2, "k": 2},
        "coordinates": {"x": {"initial": 0, "velocity": "w"}, "y": {"initial": 0}},
        "mass": [["m", 0], [0, "m"]], "potential": "m*g*y", "forces": {"x": "k*t"},
        "contacts": [{"name": "floor", "gap": "y", "friction": {"coefficient": "mu", "slip": ["x_dot"]}}]})
}

#[test]
fn a_block_slides_to_rest_and_is_pushed_off_again() {
    // The block slides with m x'' = k t - mu m g until it stops, rests while k t < mu m g, and then slides again with
    // m x'' = k t - mu m g.
    let to = ["m", "g", "mu", "w", "k"];
    let values = [2.0, 9.81, 0.3, 2.0, 2.0];
    let solution = derived(block(), 4.0, json!({"to": to}));
    let stop: fn([C; 5]) -> C = |[m, g, mu, w, k]| {
        // The time s of the block's stop is the smaller root of k s^2/2m - mu g s + w = 0.
        let (a, b) = (k / m * 0.5, -mu * g);
        (-b - (b * b - a * w * 4.0).sqrt()) / (a * 2.0)
    };
    let lets_go: fn([C; 5]) -> C = |[m, g, mu, _, k]| mu * m * g / k;
    let slide = |s: C, [m, g, mu, w, k]: [C; 5]| {
        [w * s - mu * g * s * s * 0.5 + k * s * s * s / (m * 6.0), w - mu * g * s + k * s * s / (m * 2.0)]
    };
    let exact = |t: f64, p: [C; 5]| -> [C; 2] {
        let (s, off) = (stop(p), lets_go(p));
        let rest = slide(s, p)[0];
        if t < s.re {
            slide(C::from(t), p)
        } else if t < off.re {
            [rest, C::from(0.0)]
        } else {
            let since = C::from(t) - off;
            let jerk = p[4] / p[0];
            [rest + jerk * since * since * since / 6.0, jerk * since * since * 0.5]
        }
    };
    let [first, second] = [stop(values.map(C::from)).re, lets_go(values.map(C::from)).re];
    assert!(first < 0.9 && (2.9..3.0).contains(&second), "{first} {second}");
    assert_slopes(&solution, "x", to, values, |t, p| exact(t, p)[0]);
    assert_slopes(&solution, "x_dot", to, values, |t, p| exact(t, p)[1]);
    assert!(column(&solution, "dy/dm").iter().all(|slope| slope.abs() < 1e-12));
    let kinds: Vec<SlopedEvent> = solution.event_slopes.iter().map(|event| event.kind).collect();
    assert_eq!(kinds, [SlopedEvent::Stick, SlopedEvent::Slip]);
    for (event, time) in solution.event_slopes.iter().zip([stop, lets_go]) {
        for (name, expected) in to.iter().zip(slopes(values, time)) {
            assert!((event.slopes[*name] - expected).abs() < 1e-8, "{:?} by {name}", event.kind);
        }
    }
}

#[test]
fn rounding_of_what_gravity_and_the_floor_add_up_to_is_not_taken_for_a_motion_off_it() {
    // The weight and the force of the floor change together; for most masses their sum is nonzero by a rounding error
    // only.
    for (m, g) in [(2.1, 9.80665), (0.7, 1.62), (3.3, 9.81)] {
        let mut problem = block();
        (problem["parameters"]["m"], problem["parameters"]["g"]) = (json!(m), json!(g));
        problem["forces"]["x"] = json!(0);
        let solution = derived(problem, 5.0, json!({"to": ["m", "g"]}));
        // The block, with the initial speed w, stops at x = w^2/2 mu g.
        assert!((last(&solution, "dx/dg") + 4.0 / (0.6 * g * g)).abs() < 1e-8);
        assert!(last(&solution, "dx/dm").abs() < 1e-8);
    }
}

#[test]
fn a_ball_that_strikes_a_rough_floor_aslant_and_slides_on_after_its_bounces() {
    // Each impact of the speed u reduces the slip by mu (1 + e) u, and after the last bounce friction reduces it at
    // the rate mu g. The slip does not reach zero within the run.
    let values = [0.2, 0.5, 9.81];
    let to = ["mu", "e", "g"];
    let problem = json!({"parameters": {"mu": 0.2, "e": 0.5, "g": 9.81},
        "coordinates": {"x": {"initial": 0, "velocity": 6}, "y": {"initial": 1}}, "mass": [[2, 0], [0, 2]],
        "potential": "2*g*y", "contacts": [{"name": "floor", "gap": "y", "restitution": "e",
            "friction": {"coefficient": "mu", "slip": ["x_dot"]}}]});
    let solution = derived(problem, 2.0, json!({"to": to}));
    let exact = |t: f64, [mu, e, g]: [C; 3]| -> [C; 2] {
        let (mut x, mut v) = (C::from(0.0), C::from(6.0));
        let mut speed = (g * 2.0).sqrt();
        let (mut begin, mut end) = (C::from(0.0), speed / g);
        for _ in 0..2000 {
            if t < end.re {
                break;
            }
            x += v * (end - begin);
            v -= mu * (e + 1.0) * speed;
            speed *= e;
            (begin, end) = (end, end + speed * 2.0 / g);
        }
        let since = C::from(t) - begin;
        if t < end.re {
            return [x + v * since, v];
        }
        [x + v * since - mu * g * since * since * 0.5, v - mu * g * since]
    };
    assert_slopes(&solution, "x_dot", to, values, |t, p| exact(t, p)[1]);
    assert_slopes(&solution, "x", to, values, |t, p| exact(t, p)[0]);
}

#[test]
fn impacts_with_stick_turn_a_ball_that_spins() {
    // A disc of radius r and moment of inertia j that sticks to the floor as it lands: its point of contact stops.
    let values = [0.5, 0.3, 1.0, 4.0];
    let problem = json!({"parameters": {"r": 0.5, "j": 0.3, "vx": 1, "sp": 4, "e": 0.5},
        "coordinates": {"phi": {"initial": 0, "velocity": "sp"}, "x": {"initial": 0, "velocity": "vx"}, "y": {"initial": 1}},
        "mass": [["j", 0, 0], [0, 1, 0], [0, 0, 1]], "potential": "9.81*y",
        "contacts": [{"name": "floor", "gap": "y - r", "restitution": "e",
            "friction": {"coefficient": 2, "slip": ["x_dot + r*phi_dot"]}}]});
    let solution = derived(problem, 0.5, json!({"to": ["r", "j", "vx", "sp"], "of": ["x_dot", "phi_dot", "x", "y"]}));
    let landing = |r: C| ((C::from(1.0) - r) * 2.0 / 9.81).sqrt();
    let exact = |t: f64, [r, j, v, s]: [C; 4]| -> [C; 4] {
        let hit = landing(r);
        let speed = hit * 9.81;
        if t < hit.re {
            return [v, s, v * t, C::from(1.0) - 9.81 * 0.5 * t * t];
        }
        // The impulse p of friction stops the slip v + r s of the disc: the velocity becomes v + p and the spin s + r
        // p/j.
        let p = -(v + r * s) / (r * r / j + 1.0);
        let since = C::from(t) - hit;
        [v + p, s + r * p / j, v * hit + (v + p) * since, r + speed * 0.5 * since - since * since * (9.81 * 0.5)]
    };
    for (k, of) in ["x_dot", "phi_dot", "x", "y"].into_iter().enumerate() {
        assert_slopes(&solution, of, ["r", "j", "vx", "sp"], values, |t, p| exact(t, p)[k]);
    }
}

#[test]
fn a_pendulum_with_a_joint_that_swings_against_a_wall() {
    // A pendulum in the coordinates of a mass point held by a rod of length l, compared with the same pendulum in its
    // angle.
    let by_joint = json!({"parameters": {"l": 1, "g": 9.81, "e": 0.7}, "coordinates": {
            "x": {"initial": "l*sin(1)"}, "y": {"initial": "-l*cos(1)"}}, "mass": [[1, 0], [0, 1]], "potential": "g*y",
        "joints": [{"name": "rod", "constraint": "x^2 + y^2 - l^2"}],
        "contacts": [{"name": "wall", "gap": "x + 0.2", "restitution": "e"}]});
    let by_angle = json!({"parameters": {"l": 1, "g": 9.81, "e": 0.7}, "coordinates": {"a": {"initial": 1}},
        "mass": [["l^2"]], "potential": "-g*l*cos(a)", "definitions": {"x": "l*sin(a)", "y": "-l*cos(a)"},
        "contacts": [{"name": "wall", "gap": "l*sin(a) + 0.2", "restitution": "e"}]});
    let to = ["l", "g", "e"];
    let [by_joint, by_angle] =
        [by_joint, by_angle].map(|problem| derived(problem, 3.0, json!({"to": to, "of": ["x", "y"]})));
    assert!(by_angle.event_slopes.len() >= 2);
    for name in to {
        for of in ["x", "y"] {
            let name = format!("d{of}/d{name}");
            let pairs = column(&by_joint, &name).iter().zip(column(&by_angle, &name));
            for (t, (joint, angle)) in by_joint.trajectory.t.iter().zip(pairs) {
                assert!((joint - angle).abs() <= 1e-6 * angle.abs().max(1.0), "{name} at {t}: {joint} for {angle}");
            }
        }
    }
}

#[test]
fn islands_that_land_at_one_time_have_their_own_derivatives() {
    let problem = json!({"parameters": {"g": 9.81, "e": 0.5}, "coordinates": {"x": {"initial": 1}, "y": {"initial": 1}},
        "mass": [[1, 0], [0, 3]], "potential": "g*x + 3*g*y",
        "contacts": [{"name": "one", "gap": "x", "restitution": "e"}, {"name": "other", "gap": "y", "restitution": 0}]});
    let solution = derived(problem, 0.8, json!({"to": ["x.initial", "y.initial", "g", "e"]}));
    let values = [1.0, 9.81, 0.5];
    let ball = |t: f64, [h, g, e]: [C; 3]| Ball::new([h, C::from(0.0), g, e]).at(t)[0];
    assert_slopes(&solution, "x", ["x.initial", "g", "e"], values, ball);
    assert_slopes(&solution, "y", ["y.initial", "g"], [1.0, 9.81], |t, [h, g]| {
        let speed = (g * h * 2.0).sqrt();
        if t < (speed / g).re { h - g * t * t * 0.5 } else { C::from(0.0) }
    });
    assert!(column(&solution, "dy/dx.initial").iter().all(|slope| *slope == 0.0));
}

#[test]
fn a_beam_that_lands_flat_on_two_feet_has_derivatives_that_keep_it_flat_and_no_others() {
    let beam = |to: Value| {
        json!({"problem": {"mechanical": {"parameters": {"h": 1, "e": 0.5, "g": 9.81},
            "coordinates": {"phi": {"initial": 0}, "y": {"initial": "h"}}, "mass": [[0.4, 0], [0, 1]], "potential": "g*y",
            "contacts": [{"name": "left", "gap": "y - sin(phi)", "restitution": "e"},
                {"name": "right", "gap": "y + sin(phi)", "restitution": "e"}]}},
            "time": {"end": 0.7}, "method": {"impacts": "locate", "rtol": 1e-10, "atol": 1e-12},
            "output": {"times": {"count": 8}}, "sensitivities": {"to": to, "of": ["y"]}})
    };
    let solution = solve(&beam(json!(["h", "e", "g"])));
    assert_slopes(&solution, "y", ["h", "e", "g"], [1.0, 0.5, 9.81], |t, [h, e, g]| {
        Ball::new([h, C::from(0.0), g, e]).at(t)[0]
    });
    let message = refusal(&beam(json!(["phi.initial"])));
    assert!(message.contains("several contacts meet at one time"), "{message}");
}

fn refusal(document: &Value) -> String {
    let specification = Specification::from_json(document.to_string().as_bytes())
        .unwrap_or_else(|errors| panic!("the specification has errors: {errors:#?}"));
    let solution = dvi::solve(&specification, &Control::new());
    assert_eq!(solution.status, Status::Failed);
    assert!(!solution.verdict.trusted);
    let failure = solution.error.expect("a failure");
    assert_eq!(failure.code, "no_derivative");
    failure.message
}

#[test]
fn what_has_no_derivative_says_so() {
    let ask = |problem: Value, end: f64, to: Value| {
        refusal(&json!({"problem": {"mechanical": problem}, "time": {"end": end}, "method": {"impacts": "locate"},
            "sensitivities": {"to": to}}))
    };
    // An oscillator that grazes a wall: it reaches the wall with zero velocity.
    let grazing = json!({"parameters": {"k": 1}, "coordinates": {"x": {"initial": 1}}, "mass": [[1]], "potential": "k*x^2/2",
        "contacts": [{"name": "wall", "gap": "x + 1", "restitution": 0.5}]});
    let message = ask(grazing, 5.0, json!(["x.initial"]));
    assert!(message.contains("grazing"), "{message}");
    // Two outer balls reach the middle one at the same time, and either impact may be the first after a perturbation.
    let three = json!({"coordinates": {"x": {"initial": -1, "velocity": 1}, "y": {"initial": 0},
            "z": {"initial": 1, "velocity": -1}}, "mass": [[1, 0, 0], [0, 1, 0], [0, 0, 1]],
        "contacts": [{"name": "left", "gap": "y - x", "restitution": 0.5}, {"name": "right", "gap": "z - y", "restitution": 0.5}]});
    let message = ask(three, 2.0, json!(["x.initial"]));
    assert!(message.contains("several contacts"), "{message}");
    // A ball at rest on the floor: a positive perturbation of its height lets it fall, a negative one violates the gap
    // constraint.
    let resting = json!({"coordinates": {"y": {"initial": 0}}, "mass": [[1]], "potential": "9.81*y",
        "contacts": [{"name": "floor", "gap": "y"}]});
    let message = ask(resting, 1.0, json!(["y.initial"]));
    assert!(message.contains("leads off it"), "{message}");
    // Sensitivities of a time-stepped problem are refused when the specification is read.
    let stepped = json!({"problem": {"mechanical": ball()}, "time": {"end": 1}, "method": {"impacts": "time_stepping", "step": 1e-3},
        "sensitivities": {"to": ["e"]}});
    let errors = Specification::from_json(stepped.to_string().as_bytes()).expect_err("errors");
    assert_eq!((errors[0].pointer.as_str(), errors[0].code), ("/sensitivities", "conflict"));
}

#[test]
fn differentiated_time_stepping_is_off_by_a_part_that_no_step_makes_smaller() {
    // The inclusion x' in 2 - Sgn(x) with x_0 = -1 (Stewart and Anitescu 2010): x rises at the rate 3 to zero and at
    // the rate 1 from there, so that dx(2)/dx_0 = 1/3. Each step of an implicit Euler scheme that does not end in
    // zero has the derivative 1.
    let solution = solve(&json!({"problem": {"dvi": {"parameters": {"a": -1},
        "states": {"x": {"initial": "a", "rate": "2 - z"}}, "variables": {"z": {"inequality": "-x"}},
        "set": [{"box": {"of": ["z"], "lower": -1, "upper": 1}}]}}, "time": {"end": 2}, "sensitivities": {"to": ["a"]}}));
    assert!((last(&solution, "dx/da") - 1.0 / 3.0).abs() < 1e-10);
    let stepped = |start: f64, steps: i32| {
        let h = 2.0 / f64::from(steps);
        (0..steps).fold(start, |x, _| if x + h > 0.0 { x + h } else { f64::min(x + 3.0 * h, 0.0) })
    };
    for steps in [101, 1001, 10_001] {
        let slope = (stepped(-1.0 + 1e-9, steps) - stepped(-1.0 - 1e-9, steps)) / 2e-9;
        assert!((slope - 1.0 / 3.0).abs() > 0.3, "with {steps} steps the slope is {slope}");
    }
    // A ball that falls on the floor: Moreau's scheme gives a velocity after the impact that depends on the initial
    // height only through the rounding of the impact time to whole steps. The exact derivative is dv/dh = (g + e g)/u
    // with the impact speed u.
    let mut thrown = ball();
    thrown["parameters"]["w"] = json!(0);
    let solution = derived(thrown, 0.6, json!({"to": ["h"], "of": ["y_dot"]}));
    let exact = 1.6 * 9.81 / (2.0 * 9.81_f64).sqrt();
    assert!((last(&solution, "dy_dot/dh") - exact).abs() < 1e-8 * exact);
    let moreau = |start: f64, steps: i32| {
        let h = 0.6 / f64::from(steps);
        let step = |(y, v): (f64, f64)| {
            let free = v - 9.81 * h;
            let v = if y <= 0.0 { free.max(-0.6 * v) } else { free };
            (y + h * v, v)
        };
        (0..steps).fold((start, 0.0), |state, _| step(state)).1
    };
    for steps in [601, 6007, 60_013] {
        let slope = (moreau(1.0 + 1e-9, steps) - moreau(1.0 - 1e-9, steps)) / 2e-9;
        assert!((slope - exact).abs() > 0.5 * exact, "with {steps} steps the slope is {slope}, exactly {exact}");
    }
}

#[test]
fn a_push_that_sets_in_has_the_derivatives_of_its_time() {
    // A block on a rough floor rests until the time t0, when a constant push sets in.
    let (to, values) = (["F", "mu", "t0"], [8.0, 0.5, 1.03]);
    let block = json!({"parameters": {"F": values[0], "mu": values[1], "t0": values[2]},
        "coordinates": {"x": {"initial": 0}, "y": {"initial": 0}}, "mass": [[1, 0], [0, 1]],
        "potential": "9.81*y", "forces": {"x": "F*heaviside(t - t0)"},
        "contacts": [{"name": "floor", "gap": "y", "friction": {"coefficient": "mu", "slip": ["x_dot"]}}]});
    let solution = derived(block, 3.0, json!({"to": to}));
    assert_slopes(&solution, "x", to, values, |t, [force, mu, t0]| {
        let since = C::from(t) - t0;
        if since.re > 0.0 { (force - mu * 9.81) * since * since * 0.5 } else { C::from(0.0) }
    });
    // A ball that rests on the floor until a constant force lifts it off at the time t0.
    let (to, values) = (["F", "t0"], [15.0, 0.97]);
    let lifted = json!({"parameters": {"F": values[0], "t0": values[1]},
        "coordinates": {"y": {"initial": 0}}, "mass": [[1]], "potential": "9.81*y", "forces": {"y": "F*heaviside(t - t0)"},
        "contacts": [{"name": "floor", "gap": "y"}]});
    let solution = derived(lifted, 2.0, json!({"to": to}));
    assert_slopes(&solution, "y", to, values, |t, [force, t0]| {
        let since = C::from(t) - t0;
        if since.re > 0.0 { (force - 9.81) * since * since * 0.5 } else { C::from(0.0) }
    });
}
