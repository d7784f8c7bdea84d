//! Derivatives with respect to parameters and initial values, compared with closed forms: on smooth motion, through
//! switches with jumping rates, along sliding and sticking, and across time events that depend on a parameter.
//! Derivatives that do not exist are refused.

use crate::systems::harness::{column, last, solve};
use dvi::problem::Control;
use dvi::solution::{Solution, Status};
use dvi::specification::Specification;
use serde_json::{Value, json};

fn derived(problem: Value, end: f64, to: &[&str]) -> Solution {
    solve(&json!({"problem": problem, "time": {"end": end}, "method": {"rtol": 1e-10, "atol": 1e-12},
        "output": {"times": {"count": 9}}, "sensitivities": {"to": to}}))
}

#[track_caller]
fn assert_column(solution: &Solution, name: &str, exact: impl Fn(f64) -> f64) {
    assert!(solution.verdict.trusted, "{:?}", solution.verdict);
    for (&t, &found) in solution.trajectory.t.iter().zip(column(solution, name)) {
        let expected = exact(t);
        assert!((found - expected).abs() <= 1e-8 * expected.abs().max(1.0), "{name} at {t}: {found} for {expected}");
    }
}

#[test]
fn derivatives_of_a_linear_oscillator_are_those_of_its_solution() {
    // The solution of m x'' + k x = 0 from x = a is x = a cos wt with w^2 = k/m.
    let problem = json!({"dvi": {"parameters": {"k": 4, "m": 1, "a": 2}, "mass": [[1, 0], [0, "m"]],
        "states": {"x": {"initial": "a", "rate": "v"}, "v": {"initial": 0, "rate": "-k*x"}}}});
    let solution = derived(problem, 3.0, &["k", "m", "a", "v.initial"]);
    let w = 2.0;
    // The derivatives of the angular frequency are dw/dk = w/2k and dw/dm = -w/2m.
    let by_w = |t: f64| -2.0 * t * (w * t).sin();
    assert_column(&solution, "dx/dk", |t| by_w(t) * w / 8.0);
    assert_column(&solution, "dx/dm", |t| -by_w(t) * w / 2.0);
    assert_column(&solution, "dx/da", |t| (w * t).cos());
    assert_column(&solution, "dx/dv.initial", |t| (w * t).sin() / w);
    assert_column(&solution, "dv/da", |t| -w * (w * t).sin());
    let checked = solution.sensitivities.expect("a check");
    assert!((checked.derivative - checked.finite_difference).abs() <= checked.uncertainty);
}

#[test]
fn a_parameter_that_is_zero_is_moved_in_the_units_of_the_problem() {
    // A mass on a belt, x' = v, v' = -x - 0.8 sign(v - 0.5), with the initial velocity v0 = 0. The derivative at the
    // end, -5/22 from closed-form arcs, does not depend on the unit of length.
    let derivative = |unit: f64| {
        let problem = json!({"dvi": {"parameters": {"v0": 0}, "states": {"x": {"initial": 3.0 * unit, "rate": "v"},
                "v": {"initial": "v0", "rate": format!("-x - {:e}*F", 0.8 * unit)}},
            "variables": {"F": {"inequality": format!("{:e} - v", 0.5 * unit)}},
            "set": [{"box": {"of": ["F"], "lower": -1, "upper": 1}}]}});
        let solution = solve(&json!({"problem": problem, "time": {"end": 6}, "sensitivities": {"to": ["v0"]},
            "method": {"rtol": 1e-8, "atol": 1e-12 * unit}}));
        assert!(solution.verdict.trusted, "{unit:e}: {:?}", solution.verdict);
        last(&solution, "dx/dv0")
    };
    for unit in [1e-8, 1e-4, 1.0, 1e4] {
        let found = derivative(unit);
        assert!((found + 5.0 / 22.0).abs() < 1e-6, "{unit:e}: {found}");
    }
}

#[test]
fn where_sliding_begins_the_rate_jumps_and_the_derivatives_with_it() {
    // The state x decreases at the rate mu to zero and slides there; the state y is the integral of x, finally
    // x0^2/2mu.
    let problem = json!({"filippov": {"parameters": {"mu": 2, "x0": 3}, "surface": "x",
        "states": {"x": {"initial": "x0", "plus": "-mu", "minus": "mu"}, "y": {"initial": 0, "plus": "x", "minus": "x"}}}});
    let solution = derived(problem, 4.0, &["mu", "x0"]);
    let slides = |t: f64| t >= 1.5;
    assert_column(&solution, "dx/dmu", |t| if slides(t) { 0.0 } else { -t });
    assert_column(&solution, "dx/dx0", |t| if slides(t) { 0.0 } else { 1.0 });
    assert_column(&solution, "dy/dmu", |t| if slides(t) { -9.0 / 8.0 } else { -0.5 * t * t });
    assert_column(&solution, "dy/dx0", |t| if slides(t) { 1.5 } else { t });
}

#[test]
fn friction_that_sticks_and_lets_go_again() {
    // For v' = 4 - 3t - z with z in mu Sgn(v) and mu = 1, the block slides with v = 3t - 3t^2/2 until t = 2. It could
    // stick only while |4 - 3t| <= mu, so that it slides backwards at once with v' = 4 - 3t + mu.
    let problem = json!({"dvi": {"parameters": {"a": 4, "b": 3, "mu": 1},
        "states": {"v": {"initial": 0, "rate": "a - b*t - F"}}, "variables": {"F": {"inequality": "-v"}},
        "set": [{"box": {"of": ["F"], "lower": "-mu", "upper": "mu"}}]}});
    let solution = derived(problem, 4.0, &["a", "b", "mu"]);
    let stop = 2.0;
    // The block's first stop follows from v(stop) = 0, where v has the rate -3: d(stop) = dv/3 for a change dv of v
    // there. Then v = (a + mu)(t - stop) - b(t^2 - stop^2)/2, with the rate -1 at the stop.
    let before = |t: f64, [a, b, mu]: [f64; 3]| a * t - 0.5 * b * t * t - mu * t;
    let after = |t: f64, direction: [f64; 3]| {
        let [a, b, mu] = direction;
        let moved = before(stop, direction) / 3.0;
        (a + mu) * (t - stop) - 0.5 * b * (t * t - stop * stop) + moved
    };
    for (name, direction) in [("dv/da", [1.0, 0.0, 0.0]), ("dv/db", [0.0, 1.0, 0.0]), ("dv/dmu", [0.0, 0.0, 1.0])] {
        assert_column(&solution, name, |t| if t <= stop { before(t, direction) } else { after(t, direction) });
    }
}

#[test]
fn a_body_that_is_torn_off_and_pulled_ever_harder() {
    // For v' = a t - z with z in mu Sgn(v), the body sticks until z reaches its bound at t = mu/a, where v starts
    // smoothly.
    let problem = json!({"dvi": {"parameters": {"a": 2, "mu": 3},
        "states": {"x": {"initial": 0, "rate": "v"}, "v": {"initial": 0, "rate": "a*t - F"}},
        "variables": {"F": {"inequality": "-v"}}, "set": [{"box": {"of": ["F"], "lower": "-mu", "upper": "mu"}}]}});
    let solution = derived(problem, 4.0, &["a", "mu"]);
    // After the start at s = mu/a = 3/2, v = a (t - s)^2/2 and x = a (t - s)^3/6, with ds/dmu = 1/a and ds/da = -s/a.
    let s = 1.5;
    let since = |t: f64| f64::max(t - s, 0.0);
    assert_column(&solution, "dv/dmu", |t| -since(t));
    assert_column(&solution, "dx/dmu", |t| -0.5 * since(t).powi(2));
    assert_column(&solution, "dv/da", |t| 0.5 * since(t).powi(2) + since(t) * s);
    assert_column(&solution, "dx/da", |t| since(t).powi(3) / 6.0 + 0.5 * since(t).powi(2) * s);
}

#[test]
fn breaks_and_bounds_that_follow_a_parameter() {
    // The rate is x' = 0 before the breakpoint t = p, and x' = b after it.
    let problem = json!({"dvi": {"parameters": {"p": 1.25, "b": 3},
        "states": {"x": {"initial": 0, "rate": "b*heaviside(t - p)"}}}});
    let solution = derived(problem, 4.0, &["p", "b"]);
    assert_column(&solution, "dx/dp", |t| if t > 1.25 { -3.0 } else { 0.0 });
    assert_column(&solution, "dx/db", |t| f64::max(t - 1.25, 0.0));
    // The variable is z = min(c t, t^2) with c = 2: x = t^3/3 up to t = c, and c t^2/2 - c^3/6 from then on.
    let problem = json!({"dvi": {"parameters": {"c": 2}, "states": {"x": {"initial": 0, "rate": "z"}},
        "variables": {"z": {"inequality": "z - t^2"}}, "set": [{"box": {"of": ["z"], "upper": "c*t"}}]}});
    let solution = derived(problem, 4.0, &["c"]);
    assert_column(&solution, "dx/dc", |t| if t > 2.0 { 0.5 * t * t - 2.0 } else { 0.0 });
}

/// The times at which periodic functions jump depend on their arguments. Closed forms integrate `x' = r(t, p)` to
/// `T = 2.05` piece by piece; each case gives the rate, `p` and `dx(T)/dp`.
#[test]
fn jumps_of_periodic_functions_follow_their_arguments() {
    let end = 2.05_f64;
    let cases = [
        // The rate is a train of four complete pulses of the width p/2 each, and the beginning of a fifth.
        ("pwm(t, 0.5, p)", 0.37, 2.0),
        // The rate has steps at t = p + 1/2 and t = p + 3/2.
        ("round(t - p)", 0.3, -2.0),
        // The rate has steps at t = k/p for k = 1, .., 4.
        ("floor(p*t)", 2.0, 2.5),
        // The rate, the remainder of t divided by p, falls from p to 0 at t = p and at t = 2 p.
        ("mod(t, p)", 0.75, -(2.0 * end - 2.25) + 2.25),
        ("sawtooth(t, p)", 0.75, 3.0 - end * end / (2.0 * 0.75 * 0.75)),
        // The rate is nonzero up to p - 0.2, from p to p + 0.8, and from p + 1 on.
        ("t*if(mod(t - p, 1) < 0.8, 1, 0)", 0.3, -0.4),
    ];
    for (rate, p, exact) in cases {
        let problem = json!({"dvi": {"parameters": {"p": p}, "states": {"x": {"initial": 0, "rate": rate}}}});
        let solution = derived(problem, end, &["p"]);
        assert!(solution.verdict.trusted, "{rate}: {:?}", solution.verdict);
        let found = last(&solution, "dx/dp");
        assert!((found - exact).abs() <= 1e-8, "{rate}: {found} for {exact}");
    }
}

/// A queue that begins to grow again at a time given by its inflow alone, and a state `total` that nothing depends
/// on: `dq/dc = -(T - t)` after the time `t` of the second release, where `sin wt = c/A` a period after the first
/// one.
#[test]
fn a_state_that_nothing_depends_on_changes_no_derivative() {
    let (amplitude, w, c) = (1.06_f64, 1.48, 0.51_f64);
    let problem = json!({"dvi": {"parameters": {"c": c},
        "states": {"q": {"initial": 0, "rate": format!("{amplitude}*sin({w}*t) - c + z")},
            "total": {"initial": 0, "rate": "1e-3*q"}},
        "variables": {"z": {"inequality": "q"}}, "set": [{"nonnegative": ["z"]}]}});
    let solution = derived(problem, 6.25, &["c"]);
    assert!(solution.verdict.trusted, "{:?}", solution.verdict);
    let release = ((c / amplitude).asin() + std::f64::consts::TAU) / w;
    let found = last(&solution, "dq/dc");
    assert!((found + 6.25 - release).abs() <= 1e-8, "{found} for {}", release - 6.25);
}

/// A value that jumps with the parameter has no derivative: the velocity of a ball at the time of its impact.
#[test]
fn the_derivative_of_a_jump_is_doubted() {
    let solution = solve(&json!({"problem": {"mechanical": {"parameters": {"h": 4.905},
            "coordinates": {"y": {"initial": "h"}}, "mass": [[1]], "potential": "9.81*y",
            "contacts": [{"name": "f", "gap": "y", "restitution": 0.5}]}},
        "time": {"end": 1}, "sensitivities": {"to": ["h"], "mode": "adjoint", "objective": {"final": "y_dot"}}}));
    assert!(!solution.verdict.trusted, "{:?}", solution.gradient);
}

#[test]
fn a_rectifier_that_conducts_until_its_current_dies() {
    // A diode charges a capacitor from rest through an inductor: the current is half a period of i = sqrt(C/L) sin
    // wt, after which v = 2 remains.
    let problem = json!({"dvi": {"parameters": {"l": 1, "c": 1, "e": 1},
        "states": {"i": {"initial": 0, "rate": "(e - v + u)/l"}, "v": {"initial": 0, "rate": "i/c"}},
        "variables": {"u": {"inequality": "i"}}, "set": [{"nonnegative": ["u"]}]}});
    let solution = derived(problem, 6.0, &["l", "c", "e"]);
    assert!((last(&solution, "v") - 2.0).abs() < 1e-8);
    let t = |name: &str| last(&solution, name);
    assert!(t("dv/de").mul_add(1.0, -2.0).abs() < 1e-8 && t("dv/dl").abs() < 1e-8 && t("dv/dc").abs() < 1e-8);
    assert!(t("di/de").abs() < 1e-8 && t("di/dl").abs() < 1e-8);
}

/// All voltages and currents of a converter with ideal switches are proportional to its source voltage; the edges of
/// the switch depend on the period and the duty ratio.
#[test]
fn a_converter_whose_switch_follows_parameters() {
    let problem = json!({"circuit": {"parameters": {"period": 2e-5, "duty": 0.4, "E": 12}, "components": [
        {"voltage_source": {"name": "V1", "nodes": ["in", "0"], "volts": "E"}},
        {"switch": {"name": "S1", "nodes": ["in", "x"], "closed": "cos(2*pi*t/period) - cos(pi*duty)",
            "withstand_volts": 1000}},
        {"diode": {"name": "D1", "nodes": ["0", "x"]}},
        {"inductor": {"name": "L1", "nodes": ["x", "out"], "henries": 1e-4}},
        {"capacitor": {"name": "C1", "nodes": ["out", "0"], "farads": 1e-5}},
        {"resistor": {"name": "R1", "nodes": ["out", "0"], "ohms": 2}}]}});
    let solution = |problem: &Value, to: Value| {
        solve(&json!({"problem": problem, "time": {"end": 3e-4}, "method": {"rtol": 1e-10},
            "output": {"times": {"count": 2}}, "sensitivities": {"to": to}}))
    };
    let derived = solution(&problem, json!(["period", "duty", "E"]));
    assert!(derived.verdict.trusted, "{:?}", derived.verdict);
    for name in ["v(C1)", "i(L1)"] {
        let (value, slope) = (last(&derived, name), last(&derived, &format!("d{name}/dE")));
        assert!((12.0 * slope / value - 1.0).abs() < 1e-9, "{name}: {slope} for {value}");
        for (parameter, value, change) in [("period", 2e-5, 1e-9), ("duty", 0.4, 1e-5)] {
            let moved = |change: f64| {
                let mut moved = problem.clone();
                moved["circuit"]["parameters"][parameter] = json!(value + change);
                last(&solution(&moved, json!(["E"])), name)
            };
            let difference = (moved(change) - moved(-change)) / (2.0 * change);
            let slope = last(&derived, &format!("d{name}/d{parameter}"));
            // The error of the difference quotient with which the sensitivity is compared is mainly due to the rounding
            // of times.
            assert!((slope / difference - 1.0).abs() < 1e-4, "{name} by {parameter}: {slope} for {difference}");
        }
    }
}

fn failure(document: &Value) -> String {
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
fn where_there_is_no_derivative_the_run_says_so() {
    // Two relays reach their switching surfaces at the same time, and one drives the other.
    let relays = |b: f64| {
        json!({"problem": {"dvi": {"parameters": {"a": 1, "b": b},
            "states": {"x": {"initial": "a", "rate": "-z"}, "y": {"initial": "b", "rate": "0.5*z - w"},
                "q": {"initial": 0, "rate": "z + w"}},
            "variables": {"z": {"inequality": "-x"}, "w": {"inequality": "-y"}},
            "set": [{"box": {"of": ["z", "w"], "lower": -1, "upper": 1}}]}},
            "time": {"end": 3}, "sensitivities": {"to": ["a", "b"]}})
    };
    let message = failure(&relays(0.5));
    assert!(message.contains("several switches") && message.contains("t = 1"), "{message}");
    assert_eq!(last(&solve(&relays(0.6)), "dy/db"), 0.0);
}

#[test]
fn what_cannot_be_differentiated_is_refused_with_its_place() {
    let codes = |problem: Value, asked: Value| -> Vec<(String, String)> {
        let document = json!({"problem": problem, "time": {"end": 1}, "sensitivities": asked});
        let errors = Specification::from_json(document.to_string().as_bytes()).expect_err("errors");
        errors.iter().map(|error| (error.pointer.clone(), error.code.to_string())).collect()
    };
    let told = |pointer: &str, code: &str| vec![(pointer.to_owned(), code.to_owned())];
    let decay = |rate: &str| json!({"dvi": {"parameters": {"k": 1}, "states": {"x": {"initial": 1, "rate": rate}}}});
    assert_eq!(codes(decay("-k*x"), json!({"to": ["c"]})), told("/sensitivities/to/0", "unknown_name"));
    assert_eq!(codes(decay("-k*x"), json!({"to": ["k", "k"]})), told("/sensitivities/to/1", "duplicate_name"));
    assert_eq!(codes(decay("-k*x"), json!({"to": []})), told("/sensitivities/to", "empty"));
    assert_eq!(codes(decay("-k*x"), json!({"to": ["k"], "of": ["y"]})), told("/sensitivities/of/0", "unknown_name"));
    assert_eq!(codes(decay("-k*sign(x)"), json!({"to": ["k"]})), told("/sensitivities", "conflict"));
    let fall = json!({"mechanical": {"coordinates": {"y": {"initial": 1}}, "mass": [[1]]}});
    let mut stepped = json!({"problem": fall, "time": {"end": 1}, "sensitivities": {"to": ["y.initial"]}});
    stepped["method"] = json!({"impacts": "time_stepping", "step": 0.01});
    let errors = Specification::from_json(stepped.to_string().as_bytes()).expect_err("errors");
    assert_eq!((errors[0].pointer.as_str(), errors[0].code), ("/sensitivities", "conflict"));
}

/// Whether a field of the solution agrees with a closed form at all output times, to 1 %.
fn is_near(solution: &Solution, name: &str, exact: impl Fn(f64) -> f64) -> bool {
    let pairs = solution.trajectory.t.iter().zip(column(solution, name));
    pairs.into_iter().all(|(&t, &found)| (found - exact(t)).abs() <= 1e-2 * exact(t).abs().max(1e-2))
}

#[test]
fn steps_resolve_derivatives_where_the_states_rest() {
    // The state x' = -40 (x - 1) rests at 1, where steps of any length are exact, but perturbations decay: dx/dx0 =
    // exp(-40 t).
    for x in [1, 2] {
        let solution = solve(&json!({"problem": {"dvi": {"states": {"x": {"initial": x, "rate": "-40*(x-1)"}}}},
            "time": {"end": 0.5}, "sensitivities": {"to": ["x.initial"]}, "output": {"times": [0, 0.1, 0.25, 0.5]}}));
        let found = column(&solution, "dx/dx.initial");
        let pairs = solution.trajectory.t.iter().zip(found);
        let error = pairs.fold(0.0_f64, |most, (t, found)| most.max((found - (-40.0 * t).exp()).abs()));
        assert!(solution.verdict.trusted && error < 1e-5, "{error:e} {:?}", solution.verdict);
    }
    // A charged capacitor at rest, with the derivative by its source voltage: dv/dE = 1 - exp(-t/RC).
    let solution = solve(&json!({"problem": {"circuit": {"parameters": {"E": 10}, "components": [
            {"voltage_source": {"name": "V", "nodes": ["a", "0"], "volts": "E"}},
            {"resistor": {"name": "R", "nodes": ["a", "b"], "ohms": 1000}},
            {"capacitor": {"name": "C", "nodes": ["b", "0"], "farads": 1e-6, "volts": 10}}]}},
        "time": {"end": 0.02}, "sensitivities": {"to": ["E"]}, "output": {"times": [0, 0.001, 0.002, 0.005, 0.02]}}));
    let found = column(&solution, "dv(C)/dE");
    let pairs = solution.trajectory.t.iter().zip(found);
    let error = pairs.fold(0.0_f64, |most, (t, found)| most.max((found - 1.0 + (-1e3 * t).exp()).abs()));
    assert!(solution.verdict.trusted && error < 1e-5, "{error:e} {:?}", solution.verdict);
    // The unstable equilibrium zero of x' = x, from which perturbations grow by exp(10).
    let solution = solve(&json!({"problem": {"dvi": {"states": {"x": {"initial": 0, "rate": "x"}}}},
        "time": {"end": 10}, "sensitivities": {"to": ["x.initial"]}, "output": {"times": [0, 5, 10]}}));
    let last = column(&solution, "dx/dx.initial")[2];
    assert!((last / 10.0_f64.exp() - 1.0).abs() < 1e-4, "{last}");
}

#[test]
fn parameters_whose_jumps_coincide_are_told_apart() {
    // The rates are x' = 1 until t = a, and y' = 2 - d y until t = c: dy/dc = 2 exp(-d (t - c)) after c, and
    // dy/da = 0. At c = a the two jumps coincide, and separate under a perturbation.
    let jumps = |c: f64| {
        json!({"problem": {"dvi": {"parameters": {"a": 1, "d": 0.3, "c": c}, "states": {
                "x": {"initial": 0, "rate": "if(t<a,1,0)"}, "y": {"initial": 0, "rate": "if(t<c,2,0)-d*y"}}}},
            "time": {"end": 2}, "sensitivities": {"to": ["a", "d", "c"]}, "output": {"times": [0, 2]}})
    };
    let solution = solve(&jumps(1.2));
    let exact = |t: f64| if t < 1.2 { 0.0 } else { 2.0 * (-0.3 * (t - 1.2)).exp() };
    assert!(solution.verdict.trusted, "{:?}", solution.verdict);
    assert!(is_near(&solution, "dy/da", |_| 0.0) && is_near(&solution, "dy/dc", exact), "{:?}", solution.sensitivities);
    let message = failure(&jumps(1.0));
    assert!(message.contains("several switches coincide"), "{message}");
}
