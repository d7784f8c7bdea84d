//! Branches of periodic orbits and of equilibria over a parameter, with folds, flips, tori, Hopf points and border
//! collisions at parameter values that are known in closed form.

use crate::systems::harness::solve;
use dvi::problem::Control;
use dvi::solution::{Branch, BranchEventKind, Status};
use dvi::specification::Specification;
use serde_json::{Value, json};
use std::f64::consts::{PI, TAU};

fn branch_of(specification: Value) -> Branch {
    let solution = solve(&specification);
    let is_trusted = solution.verdict.trusted;
    let branch = solution.branch.expect("a branch");
    // A branch that ends because its orbit grazes a wall may be untrusted: its last orbit touches the wall within the
    // tolerance.
    assert!(is_trusted || branch.ended.is_some(), "{:?}", solution.verdict);
    let points = branch.parameter.len();
    assert!(branch.points.len() == points && branch.stable.len() == points && branch.spectrum.len() == points);
    branch
}

fn kinds(branch: &Branch) -> Vec<BranchEventKind> {
    branch.events.iter().map(|event| event.kind).collect()
}

#[track_caller]
fn assert_at(branch: &Branch, kind: BranchEventKind, exact: f64, tolerance: f64) {
    let event = branch.events.iter().find(|event| event.kind == kind);
    let event = event.unwrap_or_else(|| panic!("no {kind:?} among {:?}, ended {:?}", branch.events, branch.ended));
    assert!((event.at - exact).abs() <= tolerance, "{kind:?} at {} for {exact}", event.at);
}

const G: f64 = 9.81;

/// Returns the amplitude of a table that oscillates once per unit of time with the peak `acceleration`, in units of
/// gravity.
fn amplitude(acceleration: f64) -> f64 {
    acceleration * G / (TAU * TAU)
}

/// A ball that strikes a shaken table once in each of its periods. It strikes at the phase whose cosine is `pi (1 -
/// e)/(1 + e)` of gravity over the acceleration: there the table's velocity makes up for the loss in the impact. The
/// table's phase is shifted by the fraction `moved` of its period.
fn ball_on_a_table(e: f64, acceleration: f64, to: f64, moved: f64) -> Value {
    let phase = (PI * (1.0 - e) / (1.0 + e) / acceleration).acos();
    let (a, speed, flown) = (amplitude(acceleration), 0.5 * G, 1.0 - phase / TAU - moved);
    let height = a * phase.sin() + speed * flown - 0.5 * G * flown * flown;
    json!({"problem": {"mechanical": {"parameters": {"a": a, "e": e},
            "coordinates": {"y": {"initial": height + 1e-3, "velocity": speed - G * flown - 1e-3}}, "mass": [[1]],
            "potential": "9.81*y",
            "contacts": [{"name": "table", "gap": format!("y - a*sin(2*pi*(t - {moved}))"), "restitution": "e"}]}},
        "method": {"impacts": "locate", "rtol": 1e-10, "atol": 1e-12},
        "periodic": {"period": 1, "continue": {"parameter": "a", "to": to}}})
}

#[test]
fn a_ball_on_a_shaken_table_doubles_its_period_where_its_map_says() {
    // For a ball that bounces on the oscillating table, the map from impact to impact has the determinant e^2 and the
    // trace 1 + e^2 - (1 + e)^2 a w^2 sin(phase)/g (Holmes 1982): a flip where the trace is -(1 + e^2), and a fold
    // where the phase is zero.
    let e = 0.8;
    let at_rest = PI * (1.0 - e) / (1.0 + e);
    let flip = at_rest.hypot(2.0 * (1.0 + e * e) / ((1.0 + e) * (1.0 + e)));
    let branch = branch_of(ball_on_a_table(e, 0.6, amplitude(1.3), 0.3));
    assert_eq!(kinds(&branch), [BranchEventKind::Flip], "{:?}", branch.ended);
    assert_at(&branch, BranchEventKind::Flip, amplitude(flip), 1e-8);
    assert_eq!((branch.stable[0], *branch.stable.last().expect("points")), (Some(true), Some(false)));
    assert_eq!(branch.ended, None);
    for (a, multipliers) in branch.parameter.iter().zip(&branch.spectrum) {
        let [[re_1, im_1], [re_2, im_2]] = multipliers[..] else { panic!("two multipliers") };
        let determinant = re_1 * re_2 - im_1 * im_2;
        assert!((determinant - e * e).abs() < 1e-7, "{determinant}");
        let acceleration = a * TAU * TAU / G;
        let sine = (1.0 - (at_rest / acceleration).powi(2)).sqrt();
        let trace = 1.0 + e * e - (1.0 + e).powi(2) * acceleration * sine;
        assert!((re_1 + re_2 - trace).abs() < 1e-6, "{} for {trace} at {a}", re_1 + re_2);
    }
}

#[test]
fn below_a_least_amplitude_the_ball_does_not_follow_and_the_branch_folds() {
    let e = 0.8;
    let branch = branch_of(ball_on_a_table(e, 0.6, amplitude(0.2), 0.3));
    assert_at(&branch, BranchEventKind::Fold, amplitude(PI * (1.0 - e) / (1.0 + e)), 1e-8);
    // The branch of periodic orbits turns at the fold and comes back to its first parameter value on its unstable half.
    let (first, last) = (branch.parameter[0], *branch.parameter.last().expect("points"));
    assert!((first - last).abs() < 1e-12, "{first} {last}");
    assert_eq!(*branch.stable.last().expect("points"), Some(false));
    assert!(branch.stable.contains(&Some(true)));
}

#[test]
fn an_impact_that_passes_the_beginning_of_the_period_is_no_event() {
    // The ball strikes at the phases +-acos(0.349/A) of the table. Along the branch around the fold the time of
    // impact passes the beginning of the period, at the fold itself if the table's phase is not shifted. The speed
    // before the impact is the same on both sides of the fold.
    let (e, acceleration) = (0.8, 0.6_f64);
    let at_rest = PI * (1.0 - e) / (1.0 + e);
    for moved in [0.1, 0.0, -0.1] {
        let branch = branch_of(ball_on_a_table(e, acceleration, amplitude(0.2), moved));
        assert_eq!(kinds(&branch), [BranchEventKind::Fold], "{moved}: {:?}", branch.ended);
        assert_at(&branch, BranchEventKind::Fold, amplitude(at_rest), 1e-8);
        let phase = -(at_rest / acceleration).acos();
        let struck = (phase / TAU + moved).rem_euclid(1.0);
        let (speed, flown) = (0.5 * G, 1.0 - struck);
        let height = amplitude(acceleration) * phase.sin() + speed * flown - 0.5 * G * flown * flown;
        let last = branch.points.last().expect("points");
        assert!((last["y"] - height).abs() < 1e-8, "{moved}: {} for {height}", last["y"]);
        assert!((last["y_dot"] - (speed - G * flown)).abs() < 1e-7, "{moved}: {}", last["y_dot"]);
        assert_eq!(*branch.stable.last().expect("points"), Some(false));
    }
}

#[test]
fn orbits_that_lie_side_by_side_have_no_folds() {
    // A block with dry friction, driven by less than the friction bound, sticks: it can rest anywhere in |x| <= 1 -
    // f.
    let solution = solve(&json!({"problem": {"dvi": {"parameters": {"f": 0.5},
            "states": {"x": {"initial": 0.2, "rate": "v"}, "v": {"initial": 0, "rate": "-x - 0.1*v - s + f*cos(1.3*t)"}},
            "variables": {"s": {"inequality": "-v"}}, "set": [{"box": {"of": ["s"], "lower": -1, "upper": 1}}]}},
        "method": {"rtol": 1e-8, "atol": 1e-10},
        "periodic": {"period": "2*pi/1.3", "continue": {"parameter": "f", "to": 1.5, "points": 40}}}));
    let branch = solution.branch.expect("a branch");
    assert!(branch.events.is_empty(), "{:?}", branch.events);
    assert!(solution.verdict.caveats.iter().any(|caveat| caveat.code == "orbit_uncertain"), "{:?}", solution.verdict);
}

#[test]
fn an_oscillator_that_is_driven_harder_grazes_its_wall_at_a_known_drive() {
    // The orbit of the oscillator x'' + 2 d x' + x = f cos(w t) has the amplitude f/|1 - w^2 + 2 d w i|, and grazes
    // the wall where that is one (Shaw and Holmes 1983).
    let (d, w) = (0.1_f64, 2.0_f64);
    let branch = branch_of(json!({"problem": {"mechanical": {"parameters": {"f": 1, "d": d, "w": w},
            "coordinates": {"x": {"initial": 0}}, "mass": [[1]], "potential": "x^2/2",
            "forces": {"x": "f*cos(w*t) - 2*d*x_dot"},
            "contacts": [{"name": "wall", "gap": "1 - x", "restitution": 0.8}]}},
        "method": {"impacts": "locate", "rtol": 1e-10, "atol": 1e-12},
        "periodic": {"period": "2*pi/w", "continue": {"parameter": "f", "to": 5}}}));
    assert_at(&branch, BranchEventKind::Grazing, (1.0 - w * w).hypot(2.0 * d * w), 1e-6);
    let event = branch.events.iter().find(|event| event.kind == BranchEventKind::Grazing).expect("an event");
    assert!(event.of.is_none() || event.of.as_deref() == Some("wall"), "{event:?}");
    // Below the amplitude of the drive at which it grazes the wall, the periodic orbit is that of the linear
    // oscillator.
    for (f, point) in branch.parameter.iter().zip(&branch.points).filter(|(f, _)| **f < 3.0) {
        let exact = f * (1.0 - w * w) / ((1.0 - w * w).powi(2) + (2.0 * d * w).powi(2));
        assert!((point["x"] - exact).abs() < 1e-8, "{} for {exact}", point["x"]);
    }
}

#[test]
fn a_relay_that_a_drive_begins_to_switch_is_touched_at_a_known_drive() {
    // A bound z >= 0 of a variable takes the part of a wall: z pushes back from x = 1 on. The orbit of x' = f cos t -
    // x - z has the amplitude f/sqrt 2 while z = 0.
    let branch = branch_of(json!({"problem": {"dvi": {"parameters": {"f": 1},
            "states": {"x": {"initial": 0, "rate": "f*cos(t) - x - z"}},
            "variables": {"z": {"inequality": "0.5*z - x + 1"}}, "set": [{"nonnegative": ["z"]}]}},
        "method": {"rtol": 1e-10, "atol": 1e-12},
        "periodic": {"period": "2*pi", "continue": {"parameter": "f", "to": 2}}}));
    assert_at(&branch, BranchEventKind::Grazing, 2.0_f64.sqrt(), 1e-6);
    let event = branch.events.iter().find(|event| event.kind == BranchEventKind::Grazing).expect("an event");
    assert_eq!(event.of.as_deref(), Some("z"));
    // Beyond the border collision the branch of periodic orbits goes on to the end of the parameter's interval.
    assert_eq!(branch.ended, None);
    assert!((branch.parameter.last().expect("points") - 2.0).abs() < 1e-12);
}

#[test]
fn a_switch_that_passes_the_beginning_of_the_period_is_no_border() {
    // For x' = A cos t - x - f, where f pushes from x = 1 on, the orbit touches x = 1 at A = sqrt 2; at A = 2.002 the
    // beginning of the period lies at x = 1.
    let branch = branch_of(json!({"problem": {"dvi": {"parameters": {"A": 1},
            "states": {"x": {"initial": 0.5, "rate": "A*cos(t) - x - f"}},
            "variables": {"f": {"inequality": "f - x + 1"}}, "set": [{"nonnegative": ["f"]}]}},
        "method": {"rtol": 1e-10, "atol": 1e-12},
        "periodic": {"period": "2*pi", "continue": {"parameter": "A", "to": 4}}}));
    assert_eq!(kinds(&branch), [BranchEventKind::Grazing]);
    assert_at(&branch, BranchEventKind::Grazing, 2.0_f64.sqrt(), 1e-6);
    let starts = branch.points.iter().map(|point| point["x"]);
    assert!(branch.ended.is_none() && starts.fold(0.0, f64::max) > 1.2, "{branch:?}");
}

#[test]
fn a_torus_begins_where_two_multipliers_cross_the_unit_circle() {
    // The states x and y rotate at 0.3 rad/s and grow at the rate m, and a driven state z makes the system periodic:
    // multipliers exp(2 pi (m +- 0.3 i)).
    let branch = branch_of(json!({"problem": {"dvi": {"parameters": {"m": -0.4}, "states": {
            "x": {"initial": 0, "rate": "m*x - 0.3*y - x*(x^2 + y^2)"}, "y": {"initial": 0, "rate": "0.3*x + m*y - y*(x^2 + y^2)"},
            "z": {"initial": 0.5, "rate": "cos(t) - z"}}}},
        "method": {"rtol": 1e-10, "atol": 1e-12},
        "periodic": {"period": "2*pi", "continue": {"parameter": "m", "to": 0.4}}}));
    assert_eq!(kinds(&branch), [BranchEventKind::NeimarkSacker]);
    assert_at(&branch, BranchEventKind::NeimarkSacker, 0.0, 1e-8);
    assert_eq!((branch.stable[0], *branch.stable.last().expect("points")), (Some(true), Some(false)));
}

#[test]
fn the_period_follows_the_parameter_that_drives_it() {
    // The orbit of x' = -x + cos(w t) has x = 1/(1 + w^2) at the start of each period.
    let branch = branch_of(json!({"problem": {"dvi": {"parameters": {"w": 1}, "states": {
            "x": {"initial": 0.5, "rate": "-x + cos(w*t)"}}}}, "method": {"rtol": 1e-10, "atol": 1e-12},
        "periodic": {"period": "2*pi/w", "continue": {"parameter": "w", "from": 2, "to": 6}}}));
    assert_eq!((branch.parameter[0], *branch.parameter.last().expect("points")), (2.0, 6.0));
    for ((w, point), period) in branch.parameter.iter().zip(&branch.points).zip(&branch.period) {
        assert!((point["x"] - 1.0 / (1.0 + w * w)).abs() < 1e-9 && (period - TAU / w).abs() < 1e-12);
    }
    assert!(branch.events.is_empty() && branch.stable.iter().all(|stable| *stable == Some(true)));
}

#[test]
fn free_periods_are_followed_with_their_orbits() {
    // The states x and y rotate at the angular velocity w = 1 + b r^2 on the circle r^2 = a.
    let branch = branch_of(json!({"problem": {"dvi": {"parameters": {"a": 1, "b": 0.5}, "states": {
            "x": {"initial": 1, "rate": "x*(a - x^2 - y^2) - y*(1 + b*(x^2 + y^2))"},
            "y": {"initial": 0, "rate": "y*(a - x^2 - y^2) + x*(1 + b*(x^2 + y^2))"}}}},
        "method": {"rtol": 1e-10, "atol": 1e-12},
        "periodic": {"period": {"free": 4.2, "phase": "y"}, "continue": {"parameter": "a", "to": 3}}}));
    for ((a, point), period) in branch.parameter.iter().zip(&branch.points).zip(&branch.period) {
        assert!((point["x"] - a.sqrt()).abs() < 1e-8, "{point:?} at {a}");
        assert!((period - TAU / (1.0 + 0.5 * a)).abs() < 1e-8, "{period} at {a}");
    }
    assert!(branch.events.is_empty(), "{:?}", branch.events);
}

fn rests(problem: Value, parameter: &str, to: f64) -> Branch {
    branch_of(json!({"problem": {"dvi": problem}, "method": {"rtol": 1e-10, "atol": 1e-12},
        "steady_state": {"continue": {"parameter": parameter, "to": to}}}))
}

#[test]
fn states_of_rest_fold_and_branch_and_begin_to_oscillate() {
    let branch = rests(json!({"parameters": {"p": 1}, "states": {"x": {"initial": 1, "rate": "p - x^2"}}}), "p", -1.0);
    assert_eq!(kinds(&branch), [BranchEventKind::Fold]);
    assert_at(&branch, BranchEventKind::Fold, 0.0, 1e-9);
    assert!((branch.points.last().expect("points")["x"] + 1.0).abs() < 1e-8, "it comes back on its other half");

    let pitchfork = json!({"parameters": {"p": -1}, "states": {"x": {"initial": 0.1, "rate": "p*x - x^3"}}});
    let branch = rests(pitchfork, "p", 1.0);
    assert_eq!(kinds(&branch), [BranchEventKind::Branching]);
    assert_at(&branch, BranchEventKind::Branching, 0.0, 1e-9);

    let oscillates = json!({"parameters": {"m": -0.5}, "states": {"x": {"initial": 0.1, "rate": "m*x - 2*y"},
        "y": {"initial": 0, "rate": "2*x + m*y - y^3"}}});
    let branch = rests(oscillates, "m", 0.5);
    assert_eq!(kinds(&branch), [BranchEventKind::Hopf]);
    assert_at(&branch, BranchEventKind::Hopf, 0.0, 1e-9);
}

#[test]
fn states_of_rest_cross_borders_and_turn_at_them() {
    // With z = max(x, 0), the equation x' = p - x - z has the equilibrium p for p < 0 and p/2 for p > 0.
    let bent = |rate: &str, p: f64, x: f64| {
        json!({"parameters": {"p": p}, "states": {"x": {"initial": x, "rate": rate}},
            "variables": {"z": {"inequality": "z - x"}}, "set": [{"nonnegative": ["z"]}]})
    };
    let branch = rests(bent("p - x - z", -1.0, -1.0), "p", 1.0);
    assert_eq!(kinds(&branch), [BranchEventKind::Border]);
    assert_at(&branch, BranchEventKind::Border, 0.0, 1e-7);
    assert_eq!(branch.events[0].of.as_deref(), Some("z"));
    for (p, point) in branch.parameter.iter().zip(&branch.points) {
        assert!((point["x"] - if *p < 0.0 { *p } else { 0.5 * p }).abs() < 1e-7, "{point:?} at {p}");
    }
    // The equation x' = p - |x| has the equilibrium p and, unstable, the equilibrium -p: they meet in a corner at p =
    // 0.
    let branch = rests(bent("p + x - 2*z", 1.0, -1.0), "p", -1.0);
    assert_eq!(kinds(&branch), [BranchEventKind::Border]);
    assert_at(&branch, BranchEventKind::Border, 0.0, 1e-7);
    assert!((branch.points.last().expect("points")["x"] - 1.0).abs() < 1e-7);
    assert_eq!((branch.stable[0], *branch.stable.last().expect("points")), (Some(false), Some(true)));
}

#[test]
fn what_cannot_be_followed_is_refused_with_its_place() {
    let codes = |document: Value| -> Vec<(String, String)> {
        let errors = Specification::from_json(document.to_string().as_bytes()).expect_err("errors");
        errors.iter().map(|error| (error.pointer.clone(), error.code.to_string())).collect()
    };
    let told = |pointer: &str, code: &str| vec![(pointer.to_owned(), code.to_owned())];
    let asked = |of: Value| {
        json!({"problem": {"dvi": {"parameters": {"p": 1}, "states": {"x": {"initial": 1, "rate": "p - x"}}}},
            "steady_state": {"continue": of}})
    };
    let place = "/steady_state/continue";
    assert_eq!(codes(asked(json!({"parameter": "q", "to": 2}))), told(&format!("{place}/parameter"), "unknown_name"));
    assert_eq!(codes(asked(json!({"parameter": "p", "to": 1}))), told(&format!("{place}/to"), "out_of_range"));
    let few = asked(json!({"parameter": "p", "to": 2, "points": 1}));
    assert_eq!(codes(few), told(&format!("{place}/points"), "out_of_range"));
    assert_eq!(codes(asked(json!({"parameter": "p"}))), told(place, "missing_key"));
    let mut swept = asked(json!({"parameter": "p", "to": 2}));
    swept["sweep"] = json!({"over": {"p": [1, 2]}});
    assert_eq!(codes(swept), told("/steady_state", "conflict"));

    // A problem without an equilibrium gives no point at which the branch can start.
    let specification = asked(json!({"parameter": "p", "to": 2})).to_string().replace("p - x", "p");
    let specification = Specification::from_json(specification.as_bytes()).expect("a specification");
    let solution = dvi::solve(&specification, &Control::new());
    assert!(solution.status == Status::Failed && solution.branch.is_none());
    assert_eq!(solution.error.expect("a failure").code, "no_steady_state");
}

#[test]
fn a_branch_that_has_all_its_points_before_its_end_says_so() {
    let follow = |points: u64| {
        solve(&json!({"problem": {"dvi": {"parameters": {"p": 1}, "states": {"x": {"initial": 1, "rate": "p - x"}}}},
            "steady_state": {"continue": {"parameter": "p", "to": 2, "points": points}}}))
    };
    let short = follow(5);
    let branch = short.branch.as_ref().expect("a branch");
    assert!(branch.points.len() == 5 && branch.parameter.iter().all(|p| *p < 2.0), "{branch:?}");
    assert!(branch.ended.as_ref().is_some_and(|why| why.contains("`points`")), "{:?}", branch.ended);
    assert!(short.verdict.caveats.iter().any(|caveat| caveat.code == "branch_ended"), "{:?}", short.verdict);
    let whole = follow(200);
    let branch = whole.branch.as_ref().expect("a branch");
    assert!(branch.ended.is_none() && branch.parameter.last() == Some(&2.0), "{:?}", branch.ended);
    // A limit of as many points as the whole branch has does not cut the branch short.
    let same = follow(branch.points.len() as u64);
    assert!(same.branch.expect("a branch").ended.is_none());
}

#[test]
fn two_eigenvalues_that_pass_together_are_told() {
    for rates in [["p*x", "p*y"], ["p*x - x^3", "p*y - 2*y^3"]] {
        let solution = solve(&json!({"problem": {"dvi": {"parameters": {"p": -1}, "states": {
                "x": {"initial": 0, "rate": rates[0]}, "y": {"initial": 0, "rate": rates[1]}}}},
            "steady_state": {"continue": {"parameter": "p", "to": 1.1}}}));
        let codes: Vec<&str> = solution.verdict.caveats.iter().map(|caveat| caveat.code.as_str()).collect();
        assert!(codes.contains(&"branch_event_missed"), "{rates:?}: {codes:?}");
    }
}

#[test]
fn a_branch_follows_its_bends_however_long_the_interval_is() {
    // The branch p = x + 0.05 sin 40 x has folds where 1 + 2 cos 40 x = 0.
    for to in [0.2, 0.5, 2.0] {
        let branch = branch_of(json!({"problem": {"dvi": {"parameters": {"p": 0}, "states": {
                "x": {"initial": 0, "rate": "p - x - 0.05*sin(40*x)"}}}},
            "method": {"rtol": 1e-9, "atol": 1e-11}, "steady_state": {"continue": {"parameter": "p", "to": to, "points": 2000}}}));
        let folds: Vec<f64> =
            branch.events.iter().filter(|event| event.kind == BranchEventKind::Fold).map(|event| event.at).collect();
        let angles = (0..40).flat_map(|k| [TAU / 3.0, 2.0 * TAU / 3.0].map(|angle| angle + TAU * f64::from(k)));
        let turns: Vec<f64> = angles.map(|angle| angle / 40.0 + 0.05 * angle.sin()).collect();
        // The branch ends where it first reaches the end of the parameter's interval; folds beyond that point are not
        // found.
        let crossed = turns.iter().position(|p| *p > to).unwrap_or(turns.len());
        assert_eq!(folds.len(), crossed, "to {to}: {folds:?}");
        assert!(folds.iter().zip(&turns).all(|(found, exact)| (found - exact).abs() < 1e-8), "to {to}: {folds:?}");
    }
}
