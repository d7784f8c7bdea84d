//! Discontinuous rates that depend on the sign of a function: a relay, sliding modes and sliding-mode controllers.

use crate::systems::harness::{column, distance, events, last, solve};
use crate::systems::reference::{digits, example, switching};
use serde_json::json;

#[test]
fn the_relay_reaches_zero_and_stays_without_chatter() {
    let reach = 2.0 / 0.7;
    let solution = solve(&example("relay"));
    let error = distance(&solution, "x", |t| (2.0 - 0.7 * t).max(0.0));
    assert!(error < 1e-10, "off by {error:e}");
    assert_eq!(events(&solution, "s").len(), 1);
    assert!((events(&solution, "s")[0] - reach).abs() < 1e-10);
    // The multiplier s is 1 until x reaches zero; from then on it is the selection of the sign function that keeps x
    // at zero.
    for (&t, &s) in solution.trajectory.t.iter().zip(column(&solution, "s")) {
        let exact = if t < reach { 1.0 } else { 0.3 };
        assert!((s - exact).abs() < 1e-9, "s = {s} at t = {t}");
    }
    assert!(last(&solution, "x").abs() < 1e-14);
}

#[test]
fn the_sliding_mode_is_reached_and_kept() {
    let reference = switching("sliding_mode");
    let mut specification = example("sliding_mode");
    specification["method"]["rtol"] = json!(1e-10);
    let solution = solve(&specification);
    for (state, field) in solution.trajectory.fields.iter().take(2).enumerate() {
        let error = (field.values.last().expect("values") - digits(&reference["x_T"][state])).abs();
        assert!(error < 1e-9, "`{}` is off by {error:e}", field.name);
    }
    let hit = solution.trajectory.events[0].t;
    assert!((hit - digits(&reference["t_hit"])).abs() < 1e-9, "hit at {hit}");
}

/// The twisting algorithm for a double integrator, `x'' = -a sgn x - b sgn x'` with `a > b`, from `x = 0` and `x' = v`
/// at `t = 0`.
struct Twisting {
    a: f64,
    b: f64,
    v: f64,
}

impl Twisting {
    /// Returns the ratio of `|x'|` at consecutive zeros of `x` in the twisting algorithm.
    fn ratio(&self) -> f64 {
        ((self.a - self.b) / (self.a + self.b)).sqrt()
    }

    /// Returns the time from one zero of `x`, passed with the speed `v`, to the next zero.
    fn swing(&self, v: f64) -> f64 {
        v / (self.a + self.b) + self.ratio() * v / (self.a - self.b)
    }

    /// Returns the time at which the twisting algorithm comes to rest, after infinitely many switches.
    fn rest(&self) -> f64 {
        self.swing(self.v) / (1.0 - self.ratio())
    }

    /// Returns `x'` of the twisting algorithm at the time `t`, computed from one zero of `x` to the next.
    fn velocity(&self, t: f64) -> f64 {
        let (mut begin, mut v, mut sign) = (0.0, self.v, 1.0);
        while begin + self.swing(v) <= t && v > 1e-300 {
            (begin, v, sign) = (begin + self.swing(v), v * self.ratio(), -sign);
        }
        let s = t - begin;
        let turns = v / (self.a + self.b);
        sign * if s < turns { v - (self.a + self.b) * s } else { -(self.a - self.b) * (s - turns) }
    }

    fn specification(&self, end: f64, times: &[f64], rtol: f64) -> serde_json::Value {
        let atol = 1e-3 * rtol * self.v;
        json!({
            "problem": {"dvi": {
                "states": {
                    "x": {"initial": 0, "rate": "v"},
                    "v": {"initial": self.v, "rate": format!("-{:?}*p - {:?}*q", self.a, self.b)}
                },
                "variables": {"p": {"inequality": "-x"}, "q": {"inequality": "-v"}},
                "set": [{"box": {"of": ["p", "q"], "lower": -1, "upper": 1}}]
            }},
            "time": {"end": end},
            "method": {"rtol": rtol, "atol": atol},
            "output": {"times": times}
        })
    }
}

#[test]
fn twisting_comes_to_rest_where_its_switches_accumulate() {
    for (a, b, v) in [(2.3, 0.9, 0.7), (5e6, 4e6, 2e6), (1e-6, 1e-7, 1e-6)] {
        let twisting = Twisting { a, b, v };
        let (rest, rtol) = (twisting.rest(), 1e-9);
        for end in [1.5, 40.0] {
            let times = [0.5, 0.97, 0.999, 1.0, 1.2].map(|part| part * rest);
            let solution = solve(&twisting.specification(end * rest, &times, rtol));
            for (&t, &found) in solution.trajectory.t.iter().zip(column(&solution, "v")) {
                let exact = if t < rest { twisting.velocity(t) } else { 0.0 };
                assert!((found - exact).abs() < 1e-7 * v, "a = {a}: x' = {found:e} at {t}, not {exact:e}");
            }
            let last = solution.trajectory.events.last().expect("switches").t;
            assert!((last - rest).abs() < 1e-6 * rest, "a = {a}: at rest from {last}, not {rest}");
            let (p, q) = (column(&solution, "p"), column(&solution, "q"));
            let force = a * p[p.len() - 1] + b * q[q.len() - 1];
            assert!(force.abs() < 1e-9 * a, "a = {a}: a force {force:e} at rest");
            assert!(solution.verdict.trusted, "a = {a}: {:?}", solution.verdict);
        }
    }
}

#[test]
fn super_twisting_comes_to_rest_at_a_root() {
    // At rest the gain B(x) = -k sqrt|x| of the controller vanishes, so that the multiplier has no effect on x: x = 0,
    // w = 0 and u = 0 have codimension three.
    for (k, l, start) in [(2.1, 1.7, 0.4), (1.5, 1.1, 1.0), (3.0, 4.0, 2.0)] {
        let solution = solve(&json!({
            "problem": {"dvi": {
                "states": {
                    "x": {"initial": start, "rate": format!("-{k}*sqrt(abs(x))*u + w")},
                    "w": {"initial": 0, "rate": format!("-{l}*u")}
                },
                "variables": {"u": {"inequality": "-x"}},
                "set": [{"box": {"of": ["u"], "lower": -1, "upper": 1}}]
            }},
            "time": {"end": 20},
            "method": {"rtol": 1e-6},
            "output": {"times": [12, 20]}
        }));
        for field in ["x", "w"] {
            let worst = column(&solution, field).iter().fold(0.0_f64, |worst, value| worst.max(value.abs()));
            assert!(worst < 1e-8, "k = {k}: `{field}` is {worst:e} at rest");
        }
    }
}

#[test]
fn terminal_sliding_ends_at_the_root() {
    let (k, start) = (3.0, 2.0_f64);
    for end in [2.0, 200.0] {
        let solution = solve(&json!({
            "problem": {"dvi": {
                "states": {"x": {"initial": start, "rate": format!("-{k}*sqrt(abs(x))*u")}},
                "variables": {"u": {"inequality": "-x"}},
                "set": [{"box": {"of": ["u"], "lower": -1, "upper": 1}}]
            }},
            "time": {"end": end},
            "method": {"rtol": 1e-8}
        }));
        let error = distance(&solution, "x", |t| (start.sqrt() - 0.5 * k * t).max(0.0).powi(2));
        assert!(error < 1e-6, "to {end}: off by {error:e}");
    }
}

#[test]
fn a_source_that_exceeds_a_store_for_an_instant_switches_once_on_and_once_off() {
    // For a diode that charges a capacitor, v' = max(a sin t - v, 0) from v = 1, the current begins at arcsin(1/a); the
    // small excess is a parabola about its maximum, during which v follows the linear equation.
    for excess in [1e-4, 3e-5_f64] {
        let solution = solve(&json!({"problem": {"dvi": {"states": {"v": {"initial": 1, "rate": "i"}},
                "variables": {"i": {"inequality": format!("i - ({}*sin(t) - v)", 1.0 + excess)}},
                "set": [{"nonnegative": ["i"]}]}}, "time": {"end": 3}}));
        let found = events(&solution, "i");
        assert_eq!(found.len(), 2, "{excess:e}: {found:?}");
        assert!((found[0] - (1.0 / (1.0 + excess)).asin()).abs() < 1e-6, "{excess:e}: {found:?}");
        // To leading order the current of the diode ends as long after the maximum as it began before it.
        let width = 2.0 * (2.0 * excess).sqrt();
        assert!(((found[1] - found[0]) / width - 1.0).abs() < 0.02, "{excess:e}: {found:?}");
        assert!(solution.verdict.trusted, "{excess:e}: {:?}", solution.verdict);
    }
}

#[test]
fn what_follows_switches_that_are_too_close_is_not_stepped_over() {
    // The capacitor voltage v is charged by the second peak, of 1.10001, and only by 1e-5 by the first.
    let solution = solve(&json!({"problem": {"dvi": {"states": {"v": {"initial": 1, "rate": "i"}},
            "variables": {"i": {"inequality": "i - ((1.00001 + 0.1*heaviside(t - 4))*sin(t) - v)"}},
            "set": [{"nonnegative": ["i"]}]}}, "time": {"end": 10}, "method": {"rtol": 1e-8}}));
    // During the second peak v' = b sin t - v from v_0 = 1 at t_0, where b sin t_0 = v_0; the current ends where v =
    // b sin t.
    let (b, t0) = (1.10001_f64, std::f64::consts::TAU + (1.0_f64 / 1.10001).asin());
    let v = |t: f64| {
        let forced = |t: f64| 0.5 * b * (t.sin() - t.cos());
        forced(t) + (1.0 - forced(t0)) * (t0 - t).exp()
    };
    let (mut a, mut c) = (t0 + 0.1, t0 + 1.5);
    while c - a > 1e-13 {
        let middle = 0.5 * (a + c);
        if b * middle.sin() > v(middle) { a = middle } else { c = middle }
    }
    let end = last(&solution, "v");
    assert!((end - v(a)).abs() < 1e-6, "{end} for {}", v(a));
    assert_eq!(events(&solution, "i").len(), 4, "{:?}", solution.trajectory.events);
}
