//! Periodic orbits and steady states, compared with closed forms, and errors of problems that have none.

use crate::systems::harness::solve;
use dvi::problem::Control;
use dvi::solution::{Orbit, Solution, Status};
use dvi::specification::Specification;
use serde_json::{Value, json};
use std::f64::consts::{PI, TAU};

fn orbit_of(specification: Value) -> Orbit {
    let solution = solve(&specification);
    assert!(
        solution.status == Status::Completed && solution.verdict.trusted,
        "{:?} {:?}",
        solution.error,
        solution.verdict
    );
    solution.orbit.expect("an orbit")
}

fn failed(specification: Value) -> Solution {
    let specification = Specification::from_json(specification.to_string().as_bytes()).expect("a specification");
    let solution = dvi::solve(&specification, &Control::new());
    assert!(solution.status == Status::Failed && !solution.verdict.trusted && solution.orbit.is_none());
    solution
}

#[track_caller]
fn assert_near(found: f64, exact: f64, tolerance: f64) {
    assert!((found - exact).abs() <= tolerance * exact.abs().max(1e-3), "{found:?} for {exact:?}");
}

#[test]
fn a_driven_oscillator_has_its_amplitude_and_its_multipliers() {
    // The orbit of x'' + 2 d x' + x = cos 2t has the amplitude 1/|1 - 4 + 4 d i| and the multipliers exp(lambda pi)
    // with lambda = -d +- i sqrt(1 - d^2).
    let d = 0.1_f64;
    let orbit = orbit_of(json!({"problem": {"dvi": {"parameters": {"w": 2, "d": d}, "states": {
            "x": {"initial": 0, "rate": "v"}, "v": {"initial": 0, "rate": "cos(w*t) - 2*d*v - x"}}}},
        "periodic": {"period": "2*pi/w"}, "method": {"rtol": 1e-11, "atol": 1e-13}}));
    assert!(orbit.shots <= 3, "a linear map takes one step of Newton's method: {}", orbit.shots);
    let amplitude = 1.0 / 3.0_f64.hypot(4.0 * d);
    let x = orbit.over_period["x"];
    assert_near(x.max, amplitude, 1e-9);
    assert_near(x.ripple, 2.0 * amplitude, 1e-9);
    assert_near(x.rms.unwrap(), amplitude / 2.0_f64.sqrt(), 1e-9);
    assert!(x.mean.unwrap().abs() < 1e-10);
    let [[re, im], _] = orbit.multipliers[..] else { panic!("two multipliers") };
    let turned = PI * (1.0 - d * d).sqrt();
    assert_near(re, (-d * PI).exp() * turned.cos(), 1e-9);
    assert_near(im, (-d * PI).exp() * turned.sin().abs(), 1e-8);
    assert_eq!(orbit.stable, Some(true));
}

#[test]
fn a_free_period_is_found_with_the_orbit() {
    // Reference for the periodic orbit of van der Pol's equation at mu = 1: series in forty digits (Amore and others
    // 2018).
    let orbit = orbit_of(json!({"problem": {"dvi": {"states": {
            "x": {"initial": 2, "rate": "v"}, "v": {"initial": 0, "rate": "(1 - x^2)*v - x"}}}},
        "periodic": {"period": {"free": 6.3, "phase": "v"}}, "method": {"rtol": 1e-11, "atol": 1e-13}}));
    assert_near(orbit.period, 6.663_286_859_323_13, 1e-10);
    assert_near(orbit.over_period["x"].max, 2.008_619_860_874_843, 1e-10);
    assert_near(orbit.multipliers[0][0], 1.0, 1e-8);
    assert_eq!(orbit.stable, Some(true));
}

#[test]
fn a_rectifier_with_a_capacitor_ripples_as_its_equation_says() {
    // The diode of the rectifier blocks from tan(wt) = -wRC on, and conducts again when 10 sin(wt) meets the decaying
    // exponential.
    let (r, c, w) = (1000.0, 1e-4, 100.0 * PI);
    let orbit = orbit_of(json!({"problem": {"circuit": {"components": [
            {"voltage_source": {"name": "V", "nodes": ["in", "0"], "volts": "10*sin(100*pi*t)"}},
            {"diode": {"name": "D", "nodes": ["in", "out"]}},
            {"capacitor": {"name": "C", "nodes": ["out", "0"], "farads": c}},
            {"resistor": {"name": "R", "nodes": ["out", "0"], "ohms": r}}]}},
        "periodic": {"period": 0.02}, "method": {"rtol": 1e-11}}));
    let off = PI - (w * r * c).atan();
    let held = |angle: f64| 10.0 * off.sin() * (-(angle - off) / (w * r * c)).exp();
    let (mut before, mut after) = (TAU, TAU + 0.5 * PI);
    for _ in 0..100 {
        let middle = 0.5 * (before + after);
        *if held(middle) > 10.0 * middle.sin() { &mut before } else { &mut after } = middle;
    }
    let out = orbit.over_period["v(out)"];
    assert_near(out.min, held(before), 1e-9);
    assert_near(out.max, 10.0, 1e-12);
    assert!(
        orbit.shots <= 5 && orbit.multipliers[0][0].abs() < 1e-9,
        "what a diode overwrites is forgotten: {orbit:?}"
    );
}

/// A circuit: a buck converter with ideal switches and the load resistance `ohms`.
fn buck(ohms: f64) -> Value {
    json!({"problem": {"circuit": {"parameters": {"period": 2e-5, "duty": 0.4}, "components": [
            {"voltage_source": {"name": "V1", "nodes": ["in", "0"], "volts": 12}},
            {"switch": {"name": "S1", "nodes": ["in", "x"], "closed": "cos(2*pi*t/period) - cos(pi*duty)",
                "withstand_volts": 1000}},
            {"diode": {"name": "D1", "nodes": ["0", "x"]}},
            {"inductor": {"name": "L1", "nodes": ["x", "out"], "henries": 1e-4}},
            {"capacitor": {"name": "C1", "nodes": ["out", "0"], "farads": 1e-5}},
            {"resistor": {"name": "R1", "nodes": ["out", "0"], "ohms": ohms}}]}},
        "periodic": {"period": "period"}, "method": {"rtol": 1e-10}})
}

#[test]
fn a_converter_balances_over_its_period_and_decays_as_its_load_makes_it() {
    let orbit = orbit_of(buck(2.0));
    assert!(orbit.shots <= 5, "{}", orbit.shots);
    // In continuous conduction of the converter the duty ratio gives the mean output voltage, and the multipliers are
    // exp(lambda T), of modulus exp(-T/(2RC)).
    assert_near(orbit.over_period["v(out)"].mean.unwrap(), 0.4 * 12.0, 1e-11);
    let [re, im] = orbit.multipliers[0];
    assert_near(re.hypot(im), (-0.5_f64).exp(), 1e-9);
    let phase = 2e-5 * (1.0 / (1e-4 * 1e-5) - 1.0 / (2.0_f64 * 2.0 * 1e-5).powi(2)).sqrt();
    assert_near(im, (-0.5_f64).exp() * phase.sin(), 1e-8);

    // In discontinuous conduction the coil and the capacitor of the converter store no net energy over a period, the
    // coil current is zero for part of it, and all steps are proven to contain no undetected event.
    let orbit = orbit_of(buck(200.0));
    assert!(orbit.shots <= 7, "from rest, by way of a state in continuous conduction: {}", orbit.shots);
    let of = |name: &str| orbit.over_period[name];
    let mean = |name: &str| of(name).mean.unwrap();
    assert_near(mean("v(x)"), mean("v(out)"), 1e-9);
    assert_near(mean("i(L1)"), mean("v(out)") / 200.0, 1e-8);
    assert!(of("i(L1)").min.abs() < 1e-12 && mean("v(out)") > 0.5 * 12.0);
    assert!(orbit.multipliers[1][0].abs() < 1e-9, "the current is forgotten: {:?}", orbit.multipliers);
}

#[test]
fn what_has_no_orbit_says_why() {
    let of = |rate: &str, period: Value| {
        failed(
            json!({"problem": {"dvi": {"states": {"x": {"initial": 1, "rate": rate}}}}, "periodic": {"period": period}}),
        )
    };
    for (rate, period, code) in [
        ("1", json!(2), "no_orbit"),
        ("-x", json!({"free": 2, "phase": "x"}), "no_orbit"),
        ("sin(t) - x", json!(2), "not_periodic"),
        ("sin(t) - x", json!({"free": 6, "phase": "x"}), "not_periodic"),
        ("cos(3*t) + pulse(t, 50, 1) - x", json!("2*pi/3"), "not_periodic"),
    ] {
        let error = of(rate, period).error.expect("a failure");
        assert_eq!(error.code, code, "{}", error.message);
    }
}

#[test]
fn a_state_of_rest_has_its_eigenvalues() {
    // The variable z with z >= 0 and z + y - 1 >= 0 is 1 - y where y < 1, so that y' = -3y + 1 has the steady state
    // 1/3; x' = x - x^3 has the steady state 1.
    let rest = |specification: Value| {
        let solution = solve(&specification);
        assert!(solution.verdict.trusted, "{:?} {:?}", solution.error, solution.verdict);
        solution.steady_state.expect("a state of rest")
    };
    let found = rest(json!({"problem": {"dvi": {
        "states": {"x": {"initial": 0.5, "rate": "x - x^3"}, "y": {"initial": 3, "rate": "-2*y + z"}},
        "variables": {"z": {"inequality": "z + y - 1"}}, "set": [{"nonnegative": ["z"]}]}}, "steady_state": {}}));
    assert_near(found.states["x"], 1.0, 1e-12);
    assert_near(found.states["y"], 1.0 / 3.0, 1e-12);
    assert_near(found.variables["z"], 2.0 / 3.0, 1e-12);
    assert_near(found.eigenvalues[0][0], -2.0, 1e-9);
    assert_near(found.eigenvalues[1][0], -3.0, 1e-9);
    assert_eq!(found.stable, Some(true));

    // The steady state of an oscillator whose equilibrium is unstable and whose time scale is 1e6.
    let found = rest(json!({"problem": {"dvi": {"states": {
        "x": {"initial": 3, "rate": "1e-6*v"}, "v": {"initial": 1, "rate": "1e-6*(0.2*v - x + 2)"}}}}, "steady_state": {}}));
    assert_near(found.states["x"], 2.0, 1e-12);
    assert_near(found.eigenvalues[0][0], 0.1e-6, 1e-9);
    assert_near(found.eigenvalues[0][1].abs(), 1e-6 * 0.99_f64.sqrt(), 1e-9);
    assert_eq!(found.stable, Some(false));
}

#[test]
fn the_state_of_rest_is_that_which_a_run_comes_to() {
    let rest = |problem: Value| {
        let solution = solve(&json!({"problem": {"dvi": problem}, "steady_state": {}}));
        assert!(solution.verdict.trusted, "{:?} {:?}", solution.error, solution.verdict);
        solution.steady_state.expect("a state of rest")
    };
    // For x' = 1 + x - 2 max(x, 0), runs from above the unstable equilibrium at -1 tend to 1.
    for (from, to) in [(1.0, 1.0), (0.1, 1.0), (-0.5, 1.0), (1e3, 1.0), (-1.0, -1.0)] {
        let found = rest(json!({"states": {"x": {"initial": from, "rate": "1 + x - 2*z"}},
            "variables": {"z": {"inequality": "z - x"}}, "set": [{"nonnegative": ["z"]}]}));
        assert_near(found.states["x"], to, 1e-12);
        assert_eq!(found.stable, Some(to > 0.0));
    }
    // The equation x' = -x + 2 sign(x) has the stable equilibria -2 and 2.
    for from in [-3.0, -0.1, 0.1, 2.0, 1e4] {
        let found = rest(json!({"states": {"x": {"initial": from, "rate": "-x + 2*z"}},
            "variables": {"z": {"inequality": "-x"}}, "set": [{"box": {"of": ["z"], "lower": -1, "upper": 1}}]}));
        assert_near(found.states["x"], 2.0 * f64::signum(from), 1e-12);
    }
    // The fast state x first brings the solution near a saddle point, which the state y then leaves.
    for from in [1e-3, -1e-3] {
        let found = rest(json!({"states": {"x": {"initial": 1, "rate": "-10*x"},
            "y": {"initial": from, "rate": "y*(1 - y^2)"}}}));
        assert_near(found.states["y"], f64::signum(from), 1e-12);
    }
}

#[test]
fn a_search_that_begins_far_from_the_orbit_keeps_the_value_of_its_phase() {
    // Roessler's equations at c = 2.5, whose orbit passes y = -2.8 twice. Reference of the period: Taylor series of
    // order 30.
    for rtol in [1e-5, 1e-7, 1e-9] {
        let solution = solve(&json!({"problem": {"dvi": {"parameters": {"c": 2.5}, "states": {
                "x": {"initial": 2, "rate": "-y - z"}, "y": {"initial": -2.8, "rate": "x + 0.2*y"},
                "z": {"initial": 0.1, "rate": "0.2 + z*(x - c)"}}}},
            "periodic": {"period": {"free": 5.75, "phase": "y"}}, "method": {"rtol": rtol, "atol": 1e-3 * rtol}}));
        assert!(solution.verdict.trusted, "{rtol:e}: {:?} {:?}", solution.error, solution.verdict);
        let orbit = solution.orbit.as_ref().expect("an orbit");
        assert_near(orbit.period, 5.748_991_183_278_001, 10.0 * rtol);
        assert!(orbit.shots <= 30, "{} shots", orbit.shots);
        let y = solution.trajectory.field("y").expect("a field");
        assert_near(y[0], -2.8, 1e-12);
    }
}

#[test]
fn what_never_rests_says_why() {
    for (rate, code) in [("1 + x^2", "no_steady_state"), ("sin(t) - x", "not_autonomous")] {
        let solution =
            failed(json!({"problem": {"dvi": {"states": {"x": {"initial": 1, "rate": rate}}}}, "steady_state": {}}));
        let error = solution.error.expect("a failure");
        assert_eq!(error.code, code, "{}", error.message);
    }
}

/// Asserts that the Floquet multipliers of a periodic orbit are right or that the solution is not trusted; with
/// `is_trusted`, that they are right and trusted.
#[track_caller]
fn assert_multipliers(specification: &Value, exact: &[[f64; 2]], is_trusted: bool) {
    let solution = solve(specification);
    let found = solution.orbit.as_ref().map(|orbit| orbit.multipliers.clone()).unwrap_or_default();
    let is_right = found.len() == exact.len()
        && found
            .iter()
            .zip(exact)
            .all(|(a, b)| (a[0] - b[0]).hypot(a[1].abs() - b[1].abs()) <= 1e-3 * b[0].hypot(b[1]));
    let is_sure = solution.verdict.trusted;
    assert!(is_right || !is_sure, "{found:?} for {exact:?}");
    assert!(!is_trusted || is_right && is_sure, "{found:?} for {exact:?}: {:?}", solution.verdict);
}

#[test]
fn an_orbit_that_begins_on_a_switching_surface_has_the_multipliers_of_an_orbit() {
    // The solution of x' = cos(t + ph) + k x - F sign x passes zero twice a period, at cos = c and at cos = -c, with
    // rates c - F and c + F before and after: the multiplier is exp(2 pi k) ((c - F)/(c + F))^2.
    let dry = |growth: f64, phase: f64, x: f64| {
        let rate = |sign: &str| format!("cos(t+ph)+({growth})*x{sign}0.3");
        json!({"problem": {"filippov": {"parameters": {"ph": phase}, "surface": "x",
                "states": {"x": {"initial": x, "plus": rate("-"), "minus": rate("+")}}}},
            "periodic": {"period": "2*pi"}, "method": {"rtol": 1e-10}, "output": {"times": {"count": 3}}})
    };
    // The periodic orbit is odd: half a period later it is its negative. This symmetry gives the phase ph of the drive
    // at which the orbit is zero at t = 0.
    let phase_at_zero = |k: f64| {
        // Between its zeros the orbit is x = A cos(t + ph) + B sin(t + ph) + F/k + C exp(k t), with x(0) = x(pi) = 0.
        let (a, b) = (-k / (1.0 + k * k), 1.0 / (1.0 + k * k));
        let steady = 0.3 / k;
        // The condition for the phase ph of the drive is a cos ph + b sin ph = f with f = -(F/k) (e^(k pi) - 1)/(e^(k
        // pi) + 1).
        let f = -steady * (0.5 * k * PI).tanh();
        (b.atan2(a), (f / a.hypot(b)).acos())
    };
    for k in [0.15, -0.5] {
        let (middle, off) = phase_at_zero(k);
        for phase in [middle - off, middle + off] {
            let c = phase.cos();
            if c <= 0.3 {
                continue;
            }
            let exact = (TAU * k).exp() * ((c - 0.3) / (c + 0.3)).powi(2);
            assert_multipliers(&dry(k, phase, 0.0), &[[exact, 0.0]], true);
            // The periodic orbit for a drive whose phase is a quarter of a period later.
            let x = solve(&dry(k, phase, 0.0)).trajectory.field("x").expect("x")[1];
            assert!(x.abs() < 1e-6, "half of a period later it is zero as well: {x}");
            let above = 0.5;
            if k < 0.0 {
                assert_multipliers(&dry(k, phase + 0.5 * PI, above), &[[exact, 0.0]], true);
            }
        }
    }
}

#[test]
fn steps_resolve_what_is_near_an_orbit_at_rest() {
    // Hill's equation about its equilibrium zero: by Liouville's theorem the product of the multipliers, a complex
    // pair, is exp(-d pi).
    let hill = json!({"problem": {"dvi": {"states": {"x": {"initial": 0, "rate": "v"},
            "v": {"initial": 0, "rate": "-0.2*v-25*(1+0.3*cos(2*t))*x"}}}},
        "periodic": {"period": "pi"}, "output": {"times": {"count": 3}}});
    let solution = solve(&hill);
    let multipliers = &solution.orbit.as_ref().expect("an orbit").multipliers;
    let product: f64 = multipliers.iter().map(|value| value[0].hypot(value[1])).product();
    assert!((product - (-0.2 * PI).exp()).abs() <= 1e-3 && solution.verdict.trusted, "{multipliers:?}");
    // The equilibrium zero of x' = x (2 + cos t) - x^3 has the multiplier exp(4 pi). Beside a second state that
    // moves, x' = 12 x cos(t)^2 has the multiplier exp(12 pi).
    let grows = json!({"problem": {"dvi": {"states": {"x": {"initial": 0, "rate": "x*(2+cos(t))-x^3"}}}},
        "periodic": {"period": "2*pi"}, "output": {"times": {"count": 3}}});
    assert_multipliers(&grows, &[[(4.0 * PI).exp(), 0.0]], true);
    let beside = json!({"problem": {"dvi": {"states": {"x": {"initial": 0, "rate": "12*x*cos(t)^2"},
            "y": {"initial": 0.5, "rate": "-y+cos(t)"}}}},
        "periodic": {"period": "2*pi"}, "output": {"times": {"count": 3}}});
    let orbit = solve(&beside).orbit.expect("an orbit");
    let (found, exact) = (orbit.multipliers[0], (12.0 * PI).exp());
    assert!((found[0] / exact - 1.0).abs() < 1e-3 && found[1] == 0.0, "{found:?} for {exact:e}");
}

#[test]
fn a_derivative_behind_a_jump_in_time_is_resolved_where_the_states_rest() {
    // During half of a period y follows the logistic map, and during the other half x relaxes to y by exp(-40): the
    // multipliers are 2 - r and nearly 0, and the fixed point 1 - 1/r has a flip at r = 3.
    let map = json!({"problem": {"dvi": {"parameters": {"r": 2.6}, "states": {
            "x": {"initial": 0.6, "rate": "(1-if(mod(t,1)<0.5,1,0))*80*(y-x)"},
            "y": {"initial": 0.6, "rate": "if(mod(t,1)<0.5,1,0)*2*(r*x*(1-x)-x)"}}}},
        "periodic": {"period": 1, "continue": {"parameter": "r", "to": 3.3, "points": 100}},
        "method": {"rtol": 1e-9}, "output": {"times": {"count": 3}}});
    let solution = solve(&map);
    let events = &solution.branch.as_ref().expect("a branch").events;
    assert!(events.iter().any(|event| (event.at - 3.0).abs() < 1e-4), "{events:?}");
    assert!(solution.verdict.trusted, "{:?}", solution.verdict);
}

#[test]
fn a_torus_begins_where_oscillations_that_no_state_makes_grow() {
    // An equilibrium of x and y beside a driven state, for which steps would be too long to resolve oscillations with
    // the frequency w: a torus begins at m = 0.
    for w in [2.0_f64.sqrt(), 9.3] {
        let solution = solve(&json!({"problem": {"dvi": {"parameters": {"m": -0.1, "w": w}, "states": {
                "x": {"initial": 0, "rate": "m*x-w*y-x*(x^2+y^2)"}, "y": {"initial": 0, "rate": "w*x+m*y-y*(x^2+y^2)"},
                "z": {"initial": 0.5, "rate": "-z+cos(t)"}}}},
            "periodic": {"period": "2*pi", "continue": {"parameter": "m", "to": 0.2}},
            "output": {"times": {"count": 3}}}));
        let events = &solution.branch.as_ref().expect("a branch").events;
        let is_right = events.iter().any(|event| event.at.abs() < 1e-3);
        assert!(is_right && solution.verdict.trusted, "{w}: {events:?} {:?}", solution.verdict);
    }
}

#[test]
fn a_drift_below_the_tolerance_is_no_orbit() {
    let one = |x: f64, rate: &str| json!({"problem": {"dvi": {"states": {"x": {"initial": x, "rate": rate}}}}, "periodic": {"period": 1}});
    // A drive in resonance adds pi to the amplitude in each period, and dry friction reduces it by at most 4 F.
    let resonance = |rtol: f64| {
        json!({"problem": {"dvi": {"states": {"x": {"initial": 1, "rate": "y"}, "y": {"initial": 0, "rate": "-x+cos(t)"}}}},
            "periodic": {"period": "2*pi"}, "method": {"rtol": rtol}})
    };
    let with_friction = json!({"problem": {"dvi": {
            "states": {"x": {"initial": 1, "rate": "v"}, "v": {"initial": 0, "rate": "-x-F+cos(t)"}},
            "variables": {"F": {"inequality": "-v"}}, "set": [{"box": {"of": ["F"], "lower": -0.5, "upper": 0.5}}]}},
        "periodic": {"period": "2*pi"}});
    let drifting = [
        resonance(1e-6),
        resonance(1e-9),
        with_friction,
        // Periodic problems whose rates have one sign have no orbit.
        one(1.0, "exp(-x)"),
        one(1.5, "1/x+0*t"),
        one(1.5, "ln(2+x^2)/(1+x^2)*(1.5+sin(2*pi*t))"),
        one(2.0, "-(x-1)^2-1e-8"),
    ];
    for specification in drifting {
        let error = failed(specification).error.expect("a failure");
        assert_eq!(error.code, "no_orbit", "{}", error.message);
    }

    // A rate that is positive only within 1e-2 of x = 1 has two periodic orbits with constant x, the roots of (x -
    // 1)^2 = 1e-4: the search finds the larger one, with the multiplier exp(-2e-2).
    let orbit = orbit_of(one(2.0, "1e-4-(x-1)^2"));
    assert_near(orbit.start["x"], 1.01, 1e-5);
    assert_near(orbit.multipliers[0][0], (-2e-2_f64).exp(), 1e-4);
    assert_eq!(orbit.stable, Some(true));
    // Every starting point of an undamped oscillator lies on a periodic orbit.
    let orbit = orbit_of(json!({"problem": {"dvi": {"states": {
            "x": {"initial": 1, "rate": "y"}, "y": {"initial": 0, "rate": "-x"}}}}, "periodic": {"period": "2*pi"}}));
    assert_near(orbit.start["x"], 1.0, 1e-12);
    assert_eq!(orbit.stable, None);
}

#[test]
fn a_steady_state_that_its_equations_do_not_determine_is_told() {
    let solved = |states: Value| solve(&json!({"problem": {"dvi": {"states": states}}, "steady_state": {}}));
    let is_told =
        |solution: &Solution| solution.verdict.caveats.iter().any(|caveat| caveat.code == "steady_state_uncertain");
    // Steady-state problems: a system without equilibrium, one with a continuum of equilibria, and one with a triple
    // root, which the tolerances determine only to 1e-4.
    for (from, rate) in [(800.0, "exp(-x)"), (25.0, "1 - tanh(x)"), (3.0, "0*x"), (1.0, "-x^3")] {
        let solution = solved(json!({"x": {"initial": from, "rate": rate}}));
        assert!(is_told(&solution), "{rate}: {:?}", solution.verdict);
    }
    let conserved = solved(json!({"a": {"initial": 1, "rate": "b - 2*a"}, "b": {"initial": 0, "rate": "2*a - b"}}));
    assert!(is_told(&conserved));
    let found = conserved.steady_state.expect("a steady state");
    assert_near(found.states["a"], 1.0 / 3.0, 1e-6);
    for rate in ["1e-9*(1 - x)", "exp(-x) - 1e-12", "1e6 - 1e12*x"] {
        let solution = solved(json!({"x": {"initial": 5, "rate": rate}}));
        assert!(solution.verdict.trusted && !is_told(&solution), "{rate}: {:?}", solution.verdict);
    }
}

#[test]
fn what_is_stable_on_one_side_only_is_not_said_to_be_stable() {
    let one = |x: f64, rate: &str| json!({"dvi": {"states": {"x": {"initial": x, "rate": rate}}}});
    let with_z = |rate: &str, inequality: &str, x: f64| {
        json!({"dvi": {"states": {"x": {"initial": x, "rate": rate}}, "variables": {"z": {"inequality": inequality}},
            "set": [{"nonnegative": ["z"]}]}})
    };
    // Steady states at double and fourfold roots, and those of x' = -|x| and x' = -x + 3 max(0, x) at their kinks: all
    // are stable on one side only.
    for problem in
        [one(2.0, "-(x-1)^2"), one(3.0, "-(x-2)^4"), with_z("-x-2*z", "z+x", 1.0), with_z("-x+3*z", "z-x", -1.0)]
    {
        let solution = solve(&json!({"problem": problem, "steady_state": {}}));
        let found = solution.steady_state.as_ref().expect("a state of rest");
        let is_told = solution.verdict.caveats.iter().any(|caveat| caveat.code == "stability_undecided");
        assert!(found.stable.is_none() && is_told, "{problem}: {found:?} {:?}", solution.verdict);
    }
    // As a periodic problem, the equation x' = -(x - 1)^2 has its double root as an orbit of any period.
    let solution = solve(&json!({"problem": one(2.0, "-(x-1)^2"), "periodic": {"period": 1}}));
    let orbit = solution.orbit.expect("an orbit");
    assert!((orbit.start["x"] - 1.0).abs() < 1e-4 && orbit.stable.is_none(), "{orbit:?}");
    // Away from a kink the eigenvalue decides on stability: x' = -x + 3 max(0, x) - 2 has the equilibrium -2 with the
    // eigenvalue -1, and x' = x - 1 has the unstable equilibrium 1.
    for (problem, stable) in [(with_z("-x+3*z-2", "z-x", -3.0), true), (one(1.0, "x-1"), false)] {
        let solution = solve(&json!({"problem": problem, "steady_state": {}}));
        assert_eq!(solution.steady_state.expect("a state of rest").stable, Some(stable));
    }
}

#[test]
fn orbits_that_runs_return_to_from_far_around_are_said_to_be_uncertain() {
    // Weak damping contracts x to the periodic orbit 5 + sin t by a relative 1e-9 per unit of time; without damping
    // every starting point lies on an orbit.
    for (rate, is_uncertain) in [("cos(t) - 1e-9*(x - 5)", true), ("cos(t)", true), ("cos(t) - (x - 5)", false)] {
        let solution = solve(&json!({"problem": {"dvi": {"states": {"x": {"initial": 1, "rate": rate}}}},
            "periodic": {"period": "2*pi"}}));
        let is_told = solution.verdict.caveats.iter().any(|caveat| caveat.code == "orbit_uncertain");
        assert_eq!(is_told, is_uncertain, "{rate}: {:?}", solution.verdict);
    }
}

#[test]
fn means_over_a_period_take_impulses_and_see_pulses() {
    // The state of x' = z - x is lifted to 1 at the start of each period, held there, and decays during the second
    // half. Since z = x' + x, the mean of z is that of x.
    let lifted = solve(&json!({"problem": {"dvi": {"states": {"x": {"initial": 1, "rate": "z - x"}},
            "variables": {"z": {"inequality": "x - pwm(t, 1, 0.5)"}}, "set": [{"nonnegative": ["z"]}]}},
        "periodic": {"period": 1}}));
    let orbit = lifted.orbit.expect("an orbit");
    let exact = 0.5 + 1.0 - (-0.5_f64).exp();
    for name in ["x", "z"] {
        let mean = orbit.over_period[name].mean.unwrap();
        assert!((mean - exact).abs() < 1e-8, "{name}: {mean} for {exact}");
    }
    // The root mean square of z over a period is undefined since z contains an impulse; all other means exist.
    assert!(lifted.verdict.trusted, "{:?}", lifted.verdict);
    assert!(
        lifted.verdict.caveats.iter().any(|caveat| caveat.code == "mean_undefined" && caveat.message.contains("`z`"))
    );
    assert!(orbit.over_period["z"].rms.is_none() && orbit.over_period["x"].rms.is_some());

    let pulsed = |d: &str| {
        let solution = solve(&json!({"problem": {"dvi": {"states": {"x": {"initial": 0, "rate": "sin(t) - x"}},
            "definitions": {"d": d}}}, "periodic": {"period": "2*pi"}, "output": {"fields": ["d"]}}));
        assert!(solution.verdict.trusted, "{:?}", solution.verdict);
        solution.orbit.expect("an orbit").over_period["d"]
    };
    let period = std::f64::consts::TAU;
    for (d, area, square) in [
        ("pulse(t, 2, 0.01)", 0.01, 0.01),
        ("exp(-((t - 2)/0.001)^2)", 0.001 * std::f64::consts::PI.sqrt(), 0.001 * std::f64::consts::FRAC_PI_2.sqrt()),
    ] {
        let over = pulsed(d);
        assert!((over.mean.unwrap() / (area / period) - 1.0).abs() < 1e-7, "{d}: {over:?}");
        assert!((over.rms.unwrap() / (square / period).sqrt() - 1.0).abs() < 1e-7, "{d}: {over:?}");
        assert!((over.max - 1.0).abs() < 1e-8 && over.min.abs() < 1e-12, "{d}: {over:?}");
    }
}

#[test]
fn a_period_may_begin_at_an_edge_of_its_drive() {
    // The orbit of x' = u - x, where u is 1 over the first 40 % of each period, consists of exponentials.
    for period in [0.1_f64, 1e-6, 0.3, 7.0] {
        let (on, off) = (0.4 * period, 0.6 * period);
        let exact = (-off).exp() * (-on).exp_m1() / (-period).exp_m1();
        for (drive, start) in [
            (format!("pwm(t, {period}, 0.4)"), 0.0),
            (format!("pulse(mod(t, {period}), 0, {on})"), period),
            (format!("if(mod(t, {period}) < {on}, 1, 0)"), 0.0),
            (format!("if(sawtooth(t, {period}) < 0.4, 1, 0)"), 3.0 * period),
        ] {
            let orbit =
                orbit_of(json!({"problem": {"dvi": {"states": {"x": {"initial": 0, "rate": format!("{drive} - x")}}}},
                "time": {"start": start, "end": start + period}, "periodic": {"period": period},
                "method": {"rtol": 1e-10, "atol": 1e-12}}));
            assert_near(orbit.start["x"], exact, 1e-8);
        }
    }
}
