//! The solver as a Rust library: the examples of `api/rust` compared with known values, equations given as functions
//! compared with equations given as text, and errors of invalid problems.

#[path = "../../api/rust/friction_belt.rs"]
#[allow(dead_code, reason = "an example has a main function")]
mod friction_belt;
#[path = "../../api/rust/order.rs"]
#[allow(dead_code, reason = "an example has a main function")]
mod order;
#[path = "../../api/rust/peak_detector.rs"]
#[allow(dead_code, reason = "an example has a main function")]
mod peak_detector;

use dvi::{AbsoluteTolerance, Problem, Refused, Set, Settings};

#[test]
fn the_examples_give_what_is_known() {
    let radius = friction_belt::radius_of_cycle(4.0, 1.0, 0.5).unwrap();
    assert!((radius - 0.25).abs() < 1e-7, "{radius}");
    let held = peak_detector::held_voltage(3.0).unwrap();
    assert!((held - 3.0).abs() < 1e-7, "{held}");
    for (stages, step, least) in order::LADDERS {
        let order = (order::error(stages, step).unwrap() / order::error(stages, step / 2.0).unwrap()).log2();
        assert!(order > least - 0.2, "{stages} stages: {order}");
    }
}

/// A pendulum on a rod in Cartesian coordinates, of index 2: the multiplier enters the rates, and the inequality is
/// the constraint on velocities.
fn pendulum() -> Problem {
    Problem::new()
        .state("x", 1.0)
        .state("y", 0.0)
        .state("u", 0.0)
        .state("w", 0.0)
        .variables(&["l"], Set::Free)
        .equations(|_t, s, z, rates, inequality| {
            rates.copy_from_slice(&[s[2], s[3], -s[0] * z[0], -s[1] * z[0] - 1.0]);
            inequality[0] = s[0] * s[2] + s[1] * s[3];
        })
}

const PENDULUM: &str = r#"{"dvi": {
    "states": {"x": {"initial": 1, "rate": "u"}, "y": {"initial": 0, "rate": "w"},
               "u": {"initial": 0, "rate": "-x*l"}, "w": {"initial": 0, "rate": "-y*l - 1"}},
    "variables": {"l": {"inequality": "x*u + y*w"}}, "set": [{"free": ["l"]}]}}"#;

#[test]
fn functions_and_text_agree() {
    let settings = Settings { rtol: 1e-9, times: Some(vec![0.5, 2.0, 5.0]), ..Settings::default() };
    let [functions, text] =
        [pendulum(), Problem::text(PENDULUM)].map(|problem| problem.solve(5.0, &settings).unwrap().trajectory);
    for name in ["x", "y", "u", "w", "l"] {
        let pairs = functions.field(name).unwrap().iter().zip(text.field(name).unwrap());
        pairs.for_each(|(a, b)| assert!((a - b).abs() < 1e-6, "{name}: {a} beside {b}"));
    }
    // For the pendulum, conservation of energy, which is independent of the solver, gives speed^2 = -2 y.
    let at = |name: &str| functions.field(name).unwrap()[2];
    let energy = 0.5 * (at("u").powi(2) + at("w").powi(2)) + at("y");
    assert!(energy.abs() < 1e-7, "{energy}");
}

/// Finite-difference Jacobians are accurate enough for Newton's method, so that equations given as functions need no
/// more steps than equations given as text.
#[test]
fn differences_cost_no_steps() {
    let settings = Settings { rtol: 1e-8, ..Settings::default() };
    let [functions, text] = [pendulum(), Problem::text(PENDULUM)]
        .map(|problem| problem.solve(5.0, &settings).unwrap().diagnostics.steps.accepted as f64);
    assert!((functions / text - 1.0).abs() < 0.05, "{functions} steps beside {text}");
}

/// A problem with lengths of the order of 1e-9 and times of the order of 1e-6 is solved to the same number of digits.
#[test]
fn functions_hold_in_other_units() {
    let (length, time) = (1e-9, 1e-6);
    let speed = length / time;
    let problem = Problem::new()
        .state("x", 3.5 * length)
        .state("v", 0.0)
        .variables(&["F"], Set::Box { lower: -1.0, upper: 1.0 })
        .equations(move |_t, x, z, rates, inequality| {
            rates[0] = x[1];
            rates[1] = -x[0] / (time * time) - z[0] * length / (time * time);
            inequality[0] = -x[1];
        });
    let atol = vec![("x".to_owned(), 1e-12 * length), ("v".to_owned(), 1e-12 * speed)];
    let settings = Settings { rtol: 1e-9, atol: AbsoluteTolerance::PerState(atol), ..Settings::default() };
    let solution = problem.solve(1.5 * std::f64::consts::PI * time, &settings).unwrap();
    let end = |name: &str| *solution.trajectory.field(name).unwrap().last().unwrap();
    assert!((end("x") / length + 1.0).abs() < 1e-7, "{}", end("x") / length);
    assert!((end("v") / speed - 0.5).abs() < 1e-7, "{}", end("v") / speed);
    let codes: Vec<&str> = solution.verdict.caveats.iter().map(|caveat| caveat.code.as_str()).collect();
    assert!(codes.contains(&"rates_not_proven") && codes.contains(&"uniqueness_not_guaranteed"), "{codes:?}");
}

#[track_caller]
fn assert_refused(problem: &Problem, settings: &Settings, end: f64, code: &str, pointer: &str) {
    let Refused(errors) = problem.solve(end, settings).unwrap_err();
    assert_eq!((errors[0].code, errors[0].pointer.as_str()), (code, pointer), "{errors:?}");
    assert!(Refused(errors).to_string().contains(code));
}

#[test]
fn what_is_wrong_is_refused() {
    let plain = Settings::default();
    let decay = || Problem::new().state("x", 1.0);
    let works = || decay().equations(|_t, x, _z, rates, _g| rates[0] = -x[0]);
    assert!(works().solve(1.0, &plain).is_ok());
    assert_refused(&decay(), &plain, 1.0, "missing_key", "/problem");
    assert_refused(&Problem::new().equations(|_, _, _, _, _| {}), &plain, 1.0, "empty_states", "/problem/dvi/states");
    let nowhere = decay().equations(|_t, x, _z, rates, _g| rates[0] = (x[0] - 2.0).sqrt());
    assert_refused(&nowhere, &plain, 1.0, "outside_domain", "/problem/dvi/states/x/rate");
    assert_refused(&works(), &plain, f64::NAN, "wrong_type", "/time/end");
    assert_refused(&works(), &plain, -1.0, "end_before_start", "/time/end");
    assert_refused(&works(), &Settings { rtol: 0.5, ..plain.clone() }, 1.0, "out_of_range", "/method/rtol");
    assert_refused(
        &Problem::new().state("x", f64::INFINITY).equations(|_, _, _, _, _| {}),
        &plain,
        1.0,
        "wrong_type",
        "/problem/dvi/states/x/initial",
    );
    let square = decay().variables(&["z"], Set::Nonnegative).equations(|_t, x, z, rates, g| {
        rates[0] = z[0] * z[0];
        g[0] = z[0] + x[0];
    });
    assert_refused(&square, &plain, 1.0, "rate_not_affine", "/problem/dvi/states/x/rate");
    // A bound of a variable that is NaN or otherwise invalid must not be treated as an infinite one.
    for (lower, upper) in [(f64::NAN, 1.0), (-1.0, f64::NAN), (f64::INFINITY, f64::INFINITY)] {
        let boxed = decay().variables(&["z"], Set::Box { lower, upper }).equations(|_t, _x, z, rates, g| {
            rates[0] = z[0];
            g[0] = z[0];
        });
        assert!(boxed.solve(1.0, &plain).is_err(), "{lower} to {upper}");
    }
    let text = Problem::text(r#"{"dvi": {"states": {"x": {"initial": 1, "rate": "-y"}}}}"#);
    assert_refused(&text, &plain, 1.0, "unknown_name", "/problem/dvi/states/x/rate");
    assert_refused(&Problem::text("{}, {"), &plain, 1.0, "syntax", "/problem");
    assert_refused(&Problem::text("{}").state("x", 1.0), &plain, 1.0, "conflict", "/problem");
}

/// A solution that blows up is returned up to its last step with an error; a panic of a user's function propagates to
/// its caller.
#[test]
fn what_fails_on_its_way_keeps_what_there_is() {
    let problem = Problem::new().state("x", 1.0).equations(|_t, x, _z, rates, _g| rates[0] = x[0] * x[0]);
    let solution = problem.solve(2.0, &Settings::default()).unwrap();
    assert!(!solution.verdict.trusted && solution.error.is_some());
    let last = *solution.trajectory.t.last().unwrap();
    assert!((last - 1.0).abs() < 1e-3, "{last}");
}
