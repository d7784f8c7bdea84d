//! Definitions, integrals and `stop` conditions, compared with closed forms: through switches, impacts, and events
//! that begin and end within a step.

use crate::systems::harness::{column, events, last, solve};
use dvi::solution::{EventKind, Solution};
use dvi::specification::Specification;
use serde_json::{Value, json};
use std::f64::consts::{LN_2, PI};

fn assert_trusted(solution: &Solution) {
    assert!(solution.verdict.trusted, "{:?}", solution.verdict);
}

#[track_caller]
fn assert_near(found: f64, expected: f64, tolerance: f64) {
    assert!((found - expected).abs() <= tolerance, "{found:?} instead of {expected:?}");
}

/// An oscillator `x'' = -4 x` from `x = 1`, whose solution is `x = cos 2t`, with the given `stop` conditions.
fn oscillator(stop: &Value) -> Value {
    json!({"problem": {"dvi": {
        "parameters": {"k": 4, "v_belt": 0.5},
        "definitions": {"twice": "2*energy", "energy": "kinetic + k*x^2/2", "kinetic": "v^2/2", "slip": "v - v_belt"},
        "integrals": {"path": "abs(v)", "sliding": "slip", "action": "twice"},
        "states": {"x": {"initial": 1, "rate": "v"}, "v": {"initial": 0, "rate": "-k*x"}}}},
        "time": {"end": 10}, "method": {"rtol": 1e-10, "atol": 1e-12},
        "output": {"fields": ["*", "twice", "slip"], "times": {"count": 5}}, "stop": stop})
}

#[test]
fn a_run_ends_where_a_monitor_rises_and_tells_what_else_is_watched() {
    let stop = json!([{"when": "x", "direction": "rising", "label": "through"}, {"when": "slip", "record": true}]);
    let solution = solve(&oscillator(&stop));
    assert_trusted(&solution);
    let ended = solution.ended_by.as_ref().expect("an end before the end");
    let end = 0.75 * PI;
    assert_eq!(ended.label, "through");
    assert_near(ended.t, end, 1e-9);
    // The position x passes zero at pi/4, and the velocity `-2 sin 2t` is a half at `sin 2t = -1/4`.
    assert_near(events(&solution, "slip")[0], 0.5 * (PI + 0.25_f64.asin()), 1e-9);
    assert_eq!(events(&solution, "through"), [ended.t]);
    assert!(solution.trajectory.events.iter().all(|event| event.kind == EventKind::Crossed));
    assert_eq!(solution.diagnostics.switches, 0);
    // The output times are those of the requested grid up to the end of the run, and the end itself.
    assert_eq!(solution.trajectory.t, [0.0, ended.t]);
    assert_near(last(&solution, "x"), 0.0, 1e-9);
    assert_near(last(&solution, "twice"), 4.0, 1e-8);
    assert_near(last(&solution, "slip"), 1.5, 1e-8);
    assert_near(last(&solution, "action"), 4.0 * end, 1e-8);
    assert_near(last(&solution, "sliding"), -1.0 - 0.5 * end, 1e-8);
    // The integral `path` is the length of the path of x from 1 to -1 and back to zero.
    assert_near(last(&solution, "path"), 3.0, 1e-8);
    assert!(solution.trajectory.field("energy").is_none());
}

#[test]
fn what_is_only_told_changes_nothing() {
    let plain = solve(&oscillator(&json!([])));
    let told = solve(&oscillator(&json!([{"when": "x", "record": true}])));
    assert_eq!(plain.trajectory.fields, told.trajectory.fields);
    assert_eq!(plain.diagnostics.steps.accepted, told.diagnostics.steps.accepted);
    assert!(told.ended_by.is_none());
    let expected: Vec<f64> = (0..6).map(|k| PI * (0.25 + 0.5 * f64::from(k))).collect();
    let found = events(&told, "x");
    assert_eq!(found.len(), expected.len());
    found.iter().zip(expected).for_each(|(found, expected)| assert_near(*found, expected, 1e-9));
}

/// The function of a `stop` condition changes its sign and back within one of the few long steps of the problem `x' =
/// 1`.
#[test]
fn what_changes_its_sign_and_back_within_a_step_is_seen() {
    for gap in [1e-1, 1e-3, 1e-6] {
        for (when, first) in [
            (format!("(x - 3)*(x - 3 - {gap:e})"), 3.0),
            (format!("exp(-((t - 5)/{gap:e})^2) - 0.5"), 5.0 - gap * LN_2.sqrt()),
        ] {
            let solution = solve(&json!({"problem": {"dvi": {"states": {"x": {"initial": 0, "rate": 1}}}},
                "time": {"end": 100}, "stop": [{"when": when, "record": true, "label": "w"}, {"when": "x - 50"}]}));
            assert_trusted(&solution);
            let times = events(&solution, "w");
            assert_eq!(times.len(), 2, "{when}: {times:?}");
            assert_near(times[0], first, 1e-12);
            assert_near(solution.ended_by.expect("an end").t, 50.0, 1e-12);
        }
    }
}

#[test]
fn a_ball_is_stopped_in_its_second_flight_and_after_its_third_impact() {
    let ball = |stop: Value| {
        solve(&json!({"problem": {"mechanical": {
            "parameters": {"g": 10, "e": 0.5}, "coordinates": {"y": {"initial": 5}}, "mass": [[2]], "potential": "2*g*y",
            "definitions": {"momentum": "2*y_dot", "height": "floor_gap"},
            "integrals": {"area": "height", "thrust": "momentum"},
            "contacts": [{"name": "floor", "gap": "y", "restitution": "e"}]}},
            "time": {"start": 7, "end": 27}, "method": {"rtol": 1e-10, "atol": 1e-12},
            "output": {"fields": ["*", "momentum"]}, "stop": [stop]}))
    };
    // A ball with impacts at t = 8, 9, 9.5 and the velocities 10, 5, 2.5, 1.25 before and after them.
    let solution = ball(json!({"when": "y_dot", "direction": "falling"}));
    assert_trusted(&solution);
    // The velocity of the ball jumps upwards at the impact at t = 8, and decreases to zero at t = 8.5, at a height of
    // 1.25.
    assert_near(solution.ended_by.as_ref().expect("an end").t, 8.5, 1e-9);
    assert_near(last(&solution, "y"), 1.25, 1e-9);
    assert_near(last(&solution, "area"), 5.0 - 10.0 / 6.0 + (0.625 - 0.125 * 10.0 / 6.0), 1e-8);
    assert_near(last(&solution, "thrust"), 2.0 * (1.25 - 5.0), 1e-8);
    let solution = ball(json!({"when": "floor_impulse - 50", "label": "third"}));
    assert_near(solution.ended_by.as_ref().expect("an end").t, 9.5, 1e-9);
    assert_near(last(&solution, "momentum"), 2.5, 1e-8);
    let solution = ball(json!({"when": "y_dot", "direction": "rising"}));
    assert_near(solution.ended_by.as_ref().expect("an end").t, 8.0, 1e-9);
}

#[test]
fn integrals_are_as_exact_as_states_where_variables_switch() {
    // For z = max(sin t, 0), the integrals of its square and of twice its value follow from a quadrature of the
    // smooth parts.
    let solution = solve(&json!({"problem": {"dvi": {
        "definitions": {"power": "z*z"}, "integrals": {"energy": "power", "twice": "2*z"},
        "states": {"x": {"initial": 0, "rate": "z"}}, "variables": {"z": {"inequality": "z - sin(t)"}},
        "set": [{"nonnegative": ["z"]}]}}, "time": {"end": 4.0 * PI}, "method": {"rtol": 1e-9, "atol": 1e-11},
        "output": {"times": {"count": 3}}}));
    assert_trusted(&solution);
    for (found, expected) in column(&solution, "energy").iter().zip([0.0, 0.5 * PI, PI]) {
        assert_near(*found, expected, 1e-8);
    }
    assert_near(last(&solution, "twice"), 8.0, 1e-8);
    // A state at rest, x' = 0, with an integrand that is a pulse of time alone.
    let solution = solve(&json!({"problem": {"dvi": {"integrals": {"pulse": "heaviside(t - 3)*heaviside(3.5 - t)"},
        "states": {"x": {"initial": 1, "rate": 0}}}}, "time": {"end": 10}}));
    assert_near(last(&solution, "pulse"), 0.5, 1e-8);
}

#[test]
fn outputs_are_written_as_they_are_named() {
    let solution = solve(&json!({"problem": {"circuit": {"integrals": {"heat": "(1 - v(C))^2/1000"},
        "netlist": "* a charge\nV1 in 0 1\nR in out 1k\nC out 0 1u\n"}}, "time": {"end": 1},
        "method": {"rtol": 1e-9}, "stop": [{"when": "v(C) - 1/2"}]}));
    assert_near(solution.ended_by.as_ref().expect("an end").t, 1e-3 * LN_2, 1e-11);
    assert_near(last(&solution, "heat"), 0.375e-6, 1e-13);
    let solution = solve(&json!({"problem": {"rigid_bodies": {"integrals": {"area": "ball.z"}, "gravity": [0, 0, -10],
        "bodies": [{"name": "ball", "shape": {"sphere": {"radius": 0.1}}, "mass": 1, "position": [0, 0, 20]}]}},
        "time": {"end": 3}, "method": {"step": 1e-3}, "stop": [{"when": "ball.z", "direction": "falling"}]}));
    assert_near(solution.ended_by.as_ref().expect("an end").t, 2.0, 1e-3);
    assert_near(last(&solution, "area"), 40.0 - 80.0 / 6.0, 0.05);
}

#[test]
fn definitions_stand_in_rates_forces_and_surfaces() {
    let solution = solve(&json!({"problem": {"dvi": {"definitions": {"decay": "-rate*x", "rate": "1 + t"},
        "states": {"x": {"initial": 1, "rate": "decay"}}}}, "time": {"end": 1}, "method": {"rtol": 1e-10}}));
    assert_near(last(&solution, "x"), (-1.5_f64).exp(), 1e-9);
    let solution = solve(&json!({"problem": {"mechanical": {"definitions": {"push": "3*q", "drag": "4*q_dot"},
        "coordinates": {"q": {"initial": 1, "velocity": -1}}, "mass": [[1]], "forces": {"q": "-push - drag"}}},
        "time": {"end": 2}, "method": {"rtol": 1e-10}}));
    assert_near(last(&solution, "q"), (-2.0_f64).exp(), 1e-8);
    // The solution slides along the switching surface s = 0 from t = 1 on.
    let solution = solve(&json!({"problem": {"filippov": {"definitions": {"s": "x - y", "fall": "-1"},
        "states": {"x": {"initial": 1, "plus": "fall", "minus": 1}, "y": {"initial": 0, "plus": 0, "minus": 0}},
        "surface": "s"}}, "time": {"end": 2}, "output": {"fields": ["x", "s"]}}));
    assert_near(last(&solution, "x"), 0.0, 1e-6);
    assert_near(last(&solution, "s"), 0.0, 1e-6);
}

#[test]
fn other_parameters_are_bound_in_all_that_is_observed() {
    let document = oscillator(&json!([{"when": "slip - k"}]));
    let specification = Specification::from_json(document.to_string().as_bytes()).expect("a specification");
    let bound = specification.with_parameters(&[("k", 1.0), ("v_belt", -1.5)]).expect("other values");
    let solution = dvi::solve(&bound, &dvi::problem::Control::new());
    // With x = cos t and v = -sin t, the monitored function v + 1.5 of the `stop` condition falls to 1 where sin t =
    // 1/2.
    assert_near(solution.ended_by.as_ref().expect("an end").t, PI / 6.0, 1e-8);
    assert_near(last(&solution, "twice"), 1.0, 1e-8);
}

#[test]
fn what_has_no_value_ends_the_run_and_is_left_out() {
    let document = json!({"problem": {"dvi": {"definitions": {"inverse": "1/(x - 1)"}, "integrals": {"log": "inverse"},
        "states": {"x": {"initial": 1, "rate": 1}}}}, "time": {"end": 2}, "output": {"fields": ["x", "inverse"]}});
    let specification = Specification::from_json(document.to_string().as_bytes()).expect("a specification");
    let solution = dvi::solve(&specification, &dvi::problem::Control::new());
    let failure = solution.error.as_ref().expect("a failure");
    assert_eq!(failure.code, "not_finite");
    assert!(failure.message.contains("`inverse` is not finite at t = 0"), "{}", failure.message);
    assert!(solution.trajectory.t.is_empty() && !solution.verdict.trusted);
}

#[test]
fn what_is_wrong_is_told_with_its_place() {
    let codes = |document: Value| -> Vec<(String, String)> {
        let errors = Specification::from_json(document.to_string().as_bytes()).expect_err("errors");
        errors.iter().map(|error| (error.pointer.clone(), error.code.to_string())).collect()
    };
    let with = |problem: Value, rest: Value| {
        let mut document =
            json!({"problem": {"dvi": {"states": {"x": {"initial": 1, "rate": "-x"}}}}, "time": {"end": 1}});
        let members = |value: &Value| value.as_object().expect("an object").clone();
        document["problem"]["dvi"].as_object_mut().expect("an object").extend(members(&problem));
        document.as_object_mut().expect("an object").extend(members(&rest));
        document
    };
    let assert_told = |problem: Value, rest: Value, pointer: &str, code: &str| {
        let found = codes(with(problem, rest));
        assert_eq!(found, [(pointer.to_owned(), code.to_owned())]);
    };
    let at = |rest: &str| format!("/problem/dvi/{rest}");
    assert_told(json!({"definitions": {"a": "y"}}), json!({}), &at("definitions/a"), "unknown_name");
    assert_told(json!({"definitions": {"x": "t"}}), json!({}), &at("definitions/x"), "duplicate_name");
    assert_told(json!({"integrals": {"x": "t"}}), json!({}), &at("integrals/x"), "duplicate_name");
    assert_told(json!({"parameters": {"a": "2*t"}}), json!({}), &at("parameters/a"), "unknown_name");
    assert_told(json!({}), json!({"stop": [{"when": "x -"}]}), "/stop/0/when", "syntax");
    assert_told(json!({}), json!({"stop": [{"when": 1}]}), "/stop/0/when", "constant");
    assert_told(json!({}), json!({"output": {"fields": ["y"]}}), "/output/fields/0", "unknown_name");
    let stop = json!([{"when": "x - 0.5"}]);
    assert_told(json!({}), json!({"stop": stop, "output": {"global_error": true}}), "/stop/0", "conflict");
    assert_told(json!({}), json!({"stop": stop, "study": {"rtol": [1e-3, 1e-6]}}), "/stop/0", "conflict");
    let circle = codes(with(json!({"definitions": {"a": "b", "b": "a"}}), json!({})));
    assert!(circle.iter().any(|(pointer, _)| pointer.starts_with(&at("definitions"))), "{circle:?}");
}

/// The integrands pass through 160 periods within the run, whose steps become longer as the state `x` decays.
#[test]
fn integrals_of_fast_functions_of_time_are_exact() {
    let specification = json!({
        "problem": {"dvi": {"states": {"x": {"initial": 1, "rate": "-x"}},
                            "integrals": {"power": "sin(50*t)^2", "product": "cos(100*t)*x"}}},
        "time": {"end": 10}, "output": {"times": [0, 10]}, "method": {"rtol": 1e-10}
    });
    let solution = solve(&specification);
    let power = 5.0 - 1000.0_f64.sin() / 200.0;
    let wave = |t: f64| (-t).exp() * (100.0 * (100.0 * t).sin() - (100.0 * t).cos()) / 10_001.0;
    assert!((last(&solution, "power") - power).abs() < 1e-9, "{} for {power}", last(&solution, "power"));
    let product = wave(10.0) - wave(0.0);
    assert!((last(&solution, "product") - product).abs() < 1e-8, "{} for {product}", last(&solution, "product"));
    assert!(solution.verdict.trusted, "{:?}", solution.verdict);
}

/// Integrands with features that are narrow in time or in a state, over which long steps could pass, in several units
/// of time.
#[test]
fn integrands_with_a_narrow_feature_within_a_step_are_exact() {
    let lorentz = 0.01 * (5870.0_f64.atan() + 4130.0_f64.atan());
    for scale in [1e-6, 1.0, 1e6] {
        let rate = format!("1/{scale:e}");
        let u = format!("(t/{scale:e})");
        for (integrand, exact) in [
            ("exp(-((x - 50)/0.1)^2)".to_owned(), 0.1 * PI.sqrt()),
            ("x + exp(-((x - 31.7)/0.01)^2)".to_owned(), 5000.0 + 0.01 * PI.sqrt()),
            ("1/(1 + ((x - 41.3)/0.01)^2)".to_owned(), lorentz),
            ("max(0, 1 - abs(x - 61.3)/0.01)".to_owned(), 0.01),
            (format!("exp(-(({u} - 33.3)/0.01)^2)"), 0.01 * PI.sqrt()),
            (format!("pulse({u}, 33.3777, 0.001)"), 1e-3),
            (format!("x*pulse({u}, 33.3777, 0.001)"), 1e-3 * 33.3782),
            ("narrow".to_owned(), 2e-3),
            (format!("peak({u})"), 1e-3),
            ("x^2".to_owned(), 1e6 / 3.0),
        ] {
            let solution = solve(&json!({"problem": {"dvi": {"states": {"x": {"initial": 0, "rate": rate}},
                "definitions": {"narrow": format!("pulse({u}, 77.7, 2e-3)")}, "integrals": {"q": integrand},
                "tables": {"peak": {"x": [0, 30, 30.001, 30.002], "y": [0, 0, 1, 0], "interpolation": "linear"}}}},
                "time": {"end": 100.0 * scale}, "output": {"times": [0.0, 100.0 * scale]}, "method": {"rtol": 1e-9}}));
            assert!(solution.verdict.trusted, "{integrand} at {scale:e}: {:?}", solution.verdict);
            let found = last(&solution, "q") / scale;
            assert!((found - exact).abs() <= 1e-8 * exact, "{integrand} at {scale:e}: {found} for {exact}");
        }
    }
}

/// The integral of `mod(t, p)^2`, which jumps at each multiple of `p`, between jumps and across them.
#[test]
fn integrals_of_remainders_are_exact_between_jumps_and_across_them() {
    // The integral of mod(t, p)^2 over n periods and a remainder r is n p^3/3 + r^3/3.
    for (period, end) in [(1.59, 1.0), (7.0, 5.5), (0.3, 1.0)] {
        let solution =
            solve(&json!({"problem": {"dvi": {"parameters": {"p": period}, "integrals": {"I": "mod(t, p)^2"},
            "states": {"x": {"initial": 1, "rate": "-x"}}}}, "time": {"end": end}}));
        assert_trusted(&solution);
        let whole = f64::floor(end / period);
        let exact = (whole * period.powi(3) + (end - whole * period).powi(3)) / 3.0;
        assert_near(last(&solution, "I"), exact, 1e-9);
    }
}

#[test]
fn integrals_are_unknown_to_monitors_and_integrands() {
    let problem =
        |integrals: Value| json!({"dvi": {"states": {"x": {"initial": 0, "rate": 1}}, "integrals": integrals}});
    let watched = json!({"problem": problem(json!({"q": "x"})), "time": {"end": 10}, "stop": [{"when": "x + q - 4"}]});
    let nested = json!({"problem": problem(json!({"q": "x", "r": "q"})), "time": {"end": 10}});
    for (document, place) in [(watched, "/stop/0/when"), (nested, "/problem/dvi/integrals/r")] {
        let errors = Specification::from_json(document.to_string().as_bytes()).expect_err("errors");
        assert!(errors.iter().any(|error| error.pointer == place), "{errors:?}");
    }
}

/// An integrand with thousands of edges in a step exceeds the work that a step may take, and the verdict does not
/// trust it.
#[test]
fn integrands_with_more_features_than_are_examined_are_doubted() {
    let solution = solve(&json!({"problem": {"dvi": {"states": {"x": {"initial": 0, "rate": 1}},
        "integrals": {"comb": "heaviside(sin(1e6*x) - 0.99999)"}}},
        "time": {"end": 100}, "output": {"times": [0, 100]}}));
    assert!(!solution.verdict.trusted);
}

/// Interval enclosures of expressions whose terms cancel are wide, although the integrand has no narrow feature.
#[test]
fn integrands_whose_terms_cancel_are_trusted() {
    let solution = solve(&json!({"problem": {"dvi": {
        "states": {"x": {"initial": 1, "rate": "v"}, "v": {"initial": 0, "rate": "-x"}},
        "integrals": {"norm": "sqrt(x^2 + v^2)", "quotient": "(x^2 + v^2)/(1 + x^2 + v^2)", "zero": "abs(x - x*(x^2 + v^2)/(x^2 + v^2))"}}},
        "time": {"end": 10}, "method": {"rtol": 1e-10, "atol": 1e-12}}));
    assert_trusted(&solution);
    assert_near(last(&solution, "norm"), 10.0, 1e-8);
    assert_near(last(&solution, "quotient"), 5.0, 1e-8);
    assert_near(last(&solution, "zero"), 0.0, 1e-12);
}

#[test]
fn monitors_that_rest_at_zero_have_one_event_for_reaching_it() {
    let watched = json!([
        {"when": "floor(t) - 2", "label": "floor"},
        {"when": "floor(t) - 2", "direction": "falling", "label": "floor falls"},
        {"when": "pulse(t, 2, 1)", "direction": "rising", "label": "pulse begins"},
        {"when": "pulse(t, 2, 1)", "direction": "falling", "label": "pulse ends"},
        {"when": "sin(t)^2 + cos(t)^2 - 1", "label": "rounding"}]);
    let watched = watched.as_array().expect("a list").iter().map(|watch| {
        let mut watch = watch.clone();
        watch["record"] = json!(true);
        watch
    });
    let solution = solve(&json!({"problem": {"dvi": {"states": {
            "x": {"initial": 1, "rate": "v"}, "v": {"initial": 0, "rate": "-x"}}}},
        "time": {"end": 6}, "stop": watched.collect::<Vec<Value>>()}));
    assert_trusted(&solution);
    for (label, expected) in [("floor", 2.0), ("pulse begins", 2.0), ("pulse ends", 3.0)] {
        let found = events(&solution, label);
        assert!(found.len() == 1 && (found[0] - expected).abs() < 1e-14, "{label}: {found:?}");
    }
    for label in ["floor falls", "rounding"] {
        assert_eq!(events(&solution, label), [0.0; 0], "{label}");
    }
}

#[test]
fn integrals_take_the_impulses_of_jumps() {
    // The lower bound of x rises from 0 to 1 at t = 1 and lifts x by an impulse of 1; from then on x = 1, held by z =
    // 2.
    let solved = |integrals: Value| {
        solve(&json!({"problem": {"dvi": {"integrals": integrals,
            "states": {"x": {"initial": 0, "rate": "-x + z/2"}},
            "variables": {"z": {"inequality": "x - heaviside(t - 1)"}}, "set": [{"nonnegative": ["z"]}]}},
            "time": {"end": 3}, "output": {"times": [0.5, 1.5, 3]}}))
    };
    let solution = solved(json!({"of_z": "z", "moment": "t*z + x", "x_only": "x^2"}));
    assert_trusted(&solution);
    for (name, expected) in [("of_z", [0.0, 3.0, 6.0]), ("moment", [0.0, 3.75, 12.0]), ("x_only", [0.0, 0.5, 2.0])] {
        for (found, expected) in column(&solution, name).iter().zip(expected) {
            assert_near(*found, expected, 1e-6);
        }
    }
    let jumps = solution.trajectory.events.iter().filter(|event| event.kind == EventKind::Jumped);
    assert_eq!(jumps.map(|event| (event.t, event.of.as_str())).collect::<Vec<_>>(), [(1.0, "x")]);
    // The square of an impulse, and the product of an impulse and a state that jumps with it, have no integral.
    for integrand in ["z^2", "x*z"] {
        let solution = solved(json!({"I": integrand}));
        let because = &solution.verdict.because;
        assert!(
            because.iter().any(|reason| reason.message.contains("undefined from t = 1.0")),
            "{integrand}: {because:?}"
        );
    }
}

#[test]
fn a_jump_at_the_end_is_made() {
    for end in [0.3, 0.5, 0.7, 1.0, 2.0, 3.0, 10.0] {
        for bound in [format!("heaviside(t - {end})"), format!("if(t < {end}, 0, 1)"), format!("if(t <= {end}, 0, 1)")]
        {
            let solution = solve(&json!({"problem": {"dvi": {"integrals": {"I": "z"},
                "states": {"x": {"initial": 0.2, "rate": "z"}}, "variables": {"z": {"inequality": format!("x - {bound}")}},
                "set": [{"nonnegative": ["z"]}]}}, "time": {"end": end}, "output": {"times": [0, end]}}));
            let (x, integral) = (column(&solution, "x"), column(&solution, "I"));
            assert!((x[1] - 1.0).abs() < 1e-9 && (integral[1] - 0.8).abs() < 1e-9, "{bound}: {x:?} {integral:?}");
            let jumps: Vec<f64> = solution.trajectory.events.iter().map(|event| event.t).collect();
            assert_eq!(jumps, [end], "{bound}");
        }
    }
}

#[test]
fn a_touch_within_the_tolerances_is_told() {
    let is_told = |solution: &Solution| solution.verdict.caveats.iter().any(|caveat| caveat.code == "touch_uncertain");
    // The sine touches 1, and the height of a throw has its maximum 0.6 at t = 1. With the level well above or below
    // the maximum, the number of crossings is certain.
    let sine = json!({"dvi": {"states": {"y": {"initial": 0, "rate": "cos(t)"}}}});
    let thrown = json!({"mechanical": {"coordinates": {"y": {"initial": 0.1, "velocity": 1}}, "mass": [[1]], "potential": "y",
        "contacts": [{"name": "floor", "gap": "y + 3"}]}});
    for (problem, level, crossings) in [(sine, 1.0, 6), (thrown, 0.6, 2)] {
        for (off, counts) in [(1e-10, None), (-1e-10, None), (1e-3, Some(0)), (-1e-3, Some(crossings))] {
            let solution = solve(&json!({"problem": problem, "time": {"end": 3.0 * f64::from(crossings)},
                "stop": [{"when": format!("y - {level} - ({off})"), "label": "reached", "record": true}]}));
            assert_eq!(is_told(&solution), counts.is_none(), "{level} {off}");
            if let Some(count) = counts {
                assert_eq!(events(&solution, "reached").len(), count as usize, "{level} {off}");
            }
        }
    }
}

#[test]
fn rest_at_zero_is_no_touch() {
    // Two problems with periodic events: a pulse train, and a block that sticks twice a period under a force of 1.5
    // sin t with the friction bound 1.
    let block = json!({"states": {"v": {"initial": 0, "rate": "1.5*max(0, sin(t)) - F"}}, "variables": {"F": {"inequality": "-v"}},
        "set": [{"box": {"of": ["F"], "lower": -1, "upper": 1}}]});
    let solution = solve(&json!({"problem": {"dvi": block}, "time": {"end": 20}, "stop": [
        {"when": "v", "label": "speed", "record": true}, {"when": "pwm(t, 3, 0.4)", "label": "pulse", "record": true}]}));
    let codes: Vec<&str> = solution.verdict.caveats.iter().map(|caveat| caveat.code.as_str()).collect();
    assert!(!codes.contains(&"touch_uncertain"), "{codes:?}");
    // The run covers a little more than three periods of the force, and the block slips and stops in each.
    assert!(events(&solution, "speed").len() >= 6, "{:?}", events(&solution, "speed"));
}

#[test]
fn a_state_that_comes_to_rest_at_zero_has_one_event() {
    // Two states that reach zero and stay: x = max(1 - t, 0), and a state of the rate z - 1 - t, which reaches zero
    // at sqrt(3) - 1; then a speed that friction stops at t = 1.
    let held = |rate: &str| {
        json!({"states": {"x": {"initial": 1, "rate": rate}}, "variables": {"z": {"inequality": "x"}},
            "set": [{"nonnegative": ["z"]}]})
    };
    let stopped = json!({"states": {"x": {"initial": 1, "rate": "-F"}}, "variables": {"F": {"inequality": "-x"}},
        "set": [{"box": {"of": ["F"], "lower": -1, "upper": 1}}]});
    for (problem, expected) in [(held("z-1"), 1.0), (held("z-1-t"), 3.0_f64.sqrt() - 1.0), (stopped, 1.0)] {
        let solution = solve(&json!({"problem": {"dvi": problem}, "time": {"end": 3}, "stop": [
            {"when": "x", "label": "either", "record": true},
            {"when": "x", "direction": "rising", "label": "rising", "record": true}]}));
        let (either, rising) = (events(&solution, "either"), events(&solution, "rising"));
        assert!(either.len() == 1 && (either[0] - expected).abs() < 1e-9 && rising.is_empty(), "{either:?} {rising:?}");
    }
}

#[test]
fn every_impact_of_a_ball_reaches_zero() {
    let solution = solve(&json!({"problem": {"mechanical": {"coordinates": {"y": {"initial": 1}}, "mass": [[1]],
            "potential": "9.81*y", "contacts": [{"name": "f", "gap": "y", "restitution": 0.6}]}},
        "time": {"end": 1.5}, "stop": [{"when": "y", "direction": "falling", "record": true, "label": "down"}]}));
    // The k-th flight of the ball after its first fall lasts 0.6^k times twice that fall.
    let fall = (2.0 / 9.81_f64).sqrt();
    let mut expected = vec![fall];
    while let Some(next) =
        expected.last().map(|last| last + 2.0 * fall * 0.6_f64.powi(expected.len() as i32)).filter(|t| *t < 1.5)
    {
        expected.push(next);
    }
    let found = events(&solution, "down");
    assert_eq!(found.len(), expected.len(), "{found:?}");
    assert!(found.iter().zip(&expected).all(|(found, expected)| (found - expected).abs() < 1e-9), "{found:?}");
}

#[test]
fn a_row_at_a_jump_is_behind_it_in_every_column() {
    let solution =
        solve(&json!({"problem": {"dvi": {"integrals": {"I": "z"}, "states": {"x": {"initial": 0, "rate": "z"}},
            "variables": {"z": {"inequality": "x - heaviside(t - 1)"}}, "set": [{"nonnegative": ["z"]}]}},
        "time": {"end": 2}, "output": {"times": [0, 1, 2]}}));
    assert_eq!(column(&solution, "x"), [0.0, 1.0, 1.0]);
    assert!(
        column(&solution, "I").iter().zip([0.0, 1.0, 1.0]).all(|(found, expected)| (found - expected).abs() < 1e-9)
    );
}

#[test]
fn an_impulse_whose_effect_depends_on_what_jumps_is_not_trusted() {
    // The quantity 1/y - x is constant: y = 1/4 after the jump of x by 3, which no quadrature rule with one point
    // finds.
    let solution = solve(&json!({"problem": {"dvi": {
            "states": {"x": {"initial": 0, "rate": "z"}, "y": {"initial": 1, "rate": "-z*y^2"}},
            "variables": {"z": {"inequality": "x - 3*heaviside(t - 1)"}}, "set": [{"nonnegative": ["z"]}]}}, "time": {"end": 2}}));
    let because = &solution.verdict.because;
    assert!(because.iter().any(|reason| reason.message.contains("jump at t = 1.0")), "{because:?}");
}

#[test]
fn events_of_functions_with_jumps_are_those_of_their_formulas() {
    // The period of the monitored functions, a fraction of the end time, is such that edges coincide, up to rounding,
    // with the end of the run and of its steps.
    let counted = |monitor: &str, end: f64| {
        let solution = solve(&json!({"problem": {"dvi": {"states": {"x": {"initial": 1, "rate": "-0.1*x"}}}},
            "time": {"end": end}, "stop": [{"when": monitor, "record": true}], "output": {"times": {"count": 2}}}));
        assert_trusted(&solution);
        let before = 1.0 - 1e-9;
        solution.trajectory.events.iter().map(|event| event.t).filter(|t| *t < before * end).collect::<Vec<f64>>()
    };
    for (end, n) in [(3.0, 5), (2.0, 13), (10.0, 200), (1e-6, 7), (7.0, 30)] {
        let period = end / f64::from(n);
        // A sawtooth wave as the monitored function rises through 1/2 in the middle of each period, and falls at its
        // end.
        let found = counted(&format!("sawtooth(t, {period}) - 0.5"), end);
        assert_eq!(found.len(), 2 * n as usize - 1, "{end}, {n}");
        for (k, t) in found.iter().enumerate() {
            assert_near(*t, 0.5 * period * (k + 1) as f64, 1e-9 * end);
        }
        // A triangular wave passes 1/5 twice in each period, and a pulse train passes 1/2 twice in each period.
        assert_eq!(counted(&format!("triangle(t, {period}) - 0.2"), end).len(), 2 * n as usize, "{end}, {n}");
        assert_eq!(counted(&format!("pwm(t, {period}, 0.4) - 0.5"), end).len(), 2 * n as usize - 1, "{end}, {n}");
        // A monitored function that jumps between positive values has no zero crossing, and a constant has none.
        for monitor in [
            format!("if(sawtooth(t, {period}) < 0.2, 1, 2)"),
            format!("if(mod(t, {period}) > {}, x, x + 1)", 0.3 * period),
            format!("pwm(t, {period}, 1) - 0.3"),
        ] {
            assert!(counted(&monitor, end).is_empty(), "{monitor}");
        }
    }
}
