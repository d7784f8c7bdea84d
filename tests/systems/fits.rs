//! Fits of parameters to data: estimates and confidence intervals compared with linear least squares and, through
//! sticking and switches, with closed-form solutions; and the coverage of 95 % confidence intervals.

use crate::systems::harness::solve;
use dvi::problem::Control;
use dvi::solution::{FitAnswer, Solution, Status};
use dvi::specification::Specification;
use serde_json::{Value, json};
use std::f64::consts::TAU;

fn fitted(specification: &Value) -> (Solution, FitAnswer) {
    let mut solution = solve(specification);
    assert!(solution.verdict.trusted, "{:?}", solution.verdict);
    let fit = solution.fit.take().expect("a fit");
    (solution, fit)
}

#[track_caller]
fn assert_near(found: f64, exact: f64, tolerance: f64) {
    assert!((found - exact).abs() <= tolerance * exact.abs().max(1e-3), "{found:?} for {exact:?}");
}

fn caveats(solution: &Solution) -> Vec<&str> {
    solution.verdict.caveats.iter().map(|caveat| caveat.code.as_str()).collect()
}

/// Returns times and data of the line `x = x_0 + a t` with residuals that no straight line can fit.
fn line() -> (Vec<f64>, Vec<f64>) {
    let t: Vec<f64> = (0..8).map(|i| f64::from(i) * 0.5 + if i > 3 { 0.25 } else { 0.0 }).collect();
    let off = [0.3, -0.2, 0.1, 0.4, -0.5, 0.2, -0.1, 0.25];
    let x = t.iter().zip(off).map(|(t, off)| 1.0 + 2.0 * t + 0.1 * off).collect();
    (t, x)
}

fn problem_of_a_line() -> Value {
    json!({"dvi": {"parameters": {"a": 1}, "states": {"x": {"initial": 0, "rate": "a"}}}})
}

#[test]
fn a_straight_line_has_the_estimates_and_intervals_of_linear_regression() {
    let (t, x) = line();
    let (m, mean) = (t.len() as f64, t.iter().sum::<f64>() / t.len() as f64);
    let spread: f64 = t.iter().map(|t| (t - mean).powi(2)).sum();
    let slope = t.iter().zip(&x).map(|(t, x)| (t - mean) * x).sum::<f64>() / spread;
    let first = x.iter().sum::<f64>() / m - slope * mean;
    let squares: f64 = t.iter().zip(&x).map(|(t, x)| (x - first - slope * t).powi(2)).sum();
    // Student's t quantile at 97.5 % for 6 degrees of freedom, which scales the confidence intervals.
    let (variance, student) = (squares / (m - 2.0), 2.446_911_848_791_681);
    let (_, fit) = fitted(&json!({"problem": problem_of_a_line(), "time": {"end": 4}, "method": {"rtol": 1e-10},
        "fit": {"parameters": {"a": {}, "x.initial": {}}, "data": {"t": t, "x": x}}}));
    let [a, start] = [fit.parameters["a"], fit.parameters["x.initial"]];
    assert_near(a.estimate, slope, 1e-9);
    assert_near(start.estimate, first, 1e-9);
    let sd = [(variance / spread).sqrt(), (variance * (1.0 / m + mean * mean / spread)).sqrt()];
    for (found, sd) in [a, start].iter().zip(sd) {
        assert_near(found.sd.unwrap(), sd, 1e-7);
        assert_near(found.upper.unwrap() - found.estimate, student * sd, 1e-7);
        assert_near(found.estimate - found.lower.unwrap(), student * sd, 1e-7);
    }
    assert_eq!(fit.names, ["a", "x.initial"]);
    assert_near(fit.covariance[0][1].unwrap(), -mean * variance / spread, 1e-7);
    assert_near(fit.loss, squares, 1e-9);
    assert_near(fit.spread, variance.sqrt(), 1e-9);
    let residual = fit.residuals["x"][3].unwrap();
    assert_near(residual, line().1[3] - first - slope * line().0[3], 1e-7);
}

#[test]
fn given_standard_deviations_weigh_the_data_and_make_intervals_normal() {
    let (t, x) = line();
    let sd: Vec<f64> = (0..t.len()).map(|i| 0.02 + 0.01 * i as f64).collect();
    let mut values: Vec<Value> = x.iter().map(|x| json!(x)).collect();
    values[5] = Value::Null;
    let rows = || t.iter().zip(&x).zip(&sd).enumerate().filter(|(i, _)| *i != 5).map(|(_, row)| row);
    let sum = |f: &dyn Fn(f64, f64) -> f64| -> f64 { rows().map(|((t, x), sd)| f(*t, *x) / (sd * sd)).sum() };
    let [w, wt, wtt] = [sum(&|_, _| 1.0), sum(&|t, _| t), sum(&|t, _| t * t)];
    let [wx, wtx] = [sum(&|_, x| x), sum(&|t, x| t * x)];
    let determinant = w * wtt - wt * wt;
    let (_, fit) = fitted(&json!({"problem": problem_of_a_line(), "time": {"end": 4}, "method": {"rtol": 1e-10},
        "fit": {"parameters": {"a": {}, "x.initial": {}}, "data": {"t": t, "x": values, "sd": {"x": sd}}}}));
    let a = fit.parameters["a"];
    assert_near(a.estimate, (w * wtx - wt * wx) / determinant, 1e-9);
    assert_near(a.sd.unwrap(), (w / determinant).sqrt(), 1e-8);
    assert_near(a.upper.unwrap() - a.estimate, 1.959_963_984_540_054 * (w / determinant).sqrt(), 1e-7);
    assert_near(fit.covariance[0][1].unwrap(), -wt / determinant, 1e-8);
    assert_eq!((fit.observations, fit.residuals["x"][5]), (7, None));
}

/// Position of a mass that a belt of speed `v` carries against a spring until it slips at `x = f`; afterwards `x =
/// f + v sin(t - f/v)`, as long as the mass is slower than the belt.
fn carried(f: f64, v: f64, t: f64) -> f64 {
    let slips = f / v;
    if t <= slips { v * t } else { f + v * (t - slips).sin() }
}

fn problem_of_the_belt() -> Value {
    json!({"dvi": {"parameters": {"f": 0.8, "v_belt": 0.6},
        "states": {"x": {"initial": 0, "rate": "v"}, "v": {"initial": "v_belt", "rate": "-x - F"}},
        "variables": {"F": {"inequality": "-(v - v_belt)"}}, "set": [{"box": {"of": ["F"], "lower": "-f", "upper": "f"}}]}})
}

#[test]
fn friction_and_speed_of_a_belt_are_found_through_the_onset_of_slip() {
    let (f, v, sd) = (1.0, 0.5, 0.01);
    let t: Vec<f64> = (1..=30).map(|i| f64::from(i) * 0.25).collect();
    let x: Vec<f64> = t.iter().map(|&t| carried(f, v, t)).collect();
    let (_, fit) = fitted(&json!({"problem": problem_of_the_belt(), "time": {"end": 7.5},
        "method": {"rtol": 1e-11, "atol": 1e-13},
        "fit": {"parameters": {"f": {"lower": 0.1, "upper": 5}, "v_belt": {"lower": 0.1, "upper": 5}},
            "data": {"t": t, "x": x, "sd": sd}}}));
    assert_near(fit.parameters["f"].estimate, f, 1e-8);
    assert_near(fit.parameters["v_belt"].estimate, v, 1e-8);
    // Normal matrix of the least-squares problem, from the Jacobian of the closed-form solution.
    let slips = f / v;
    let (mut ff, mut fv, mut vv) = (0.0, 0.0, 0.0);
    for &t in &t {
        let since = t - slips;
        let (by_f, by_v) = match t <= slips {
            true => (0.0, t),
            false => (1.0 - since.cos(), since.sin() + since.cos() * f / v),
        };
        (ff, fv, vv) = (ff + by_f * by_f, fv + by_f * by_v, vv + by_v * by_v);
    }
    let determinant = ff * vv - fv * fv;
    assert_near(fit.parameters["f"].sd.unwrap(), sd * (vv / determinant).sqrt(), 1e-7);
    assert_near(fit.parameters["v_belt"].sd.unwrap(), sd * (ff / determinant).sqrt(), 1e-7);
    assert_near(fit.covariance[0][1].unwrap(), -sd * sd * fv / determinant, 1e-7);
}

#[test]
fn the_capacitor_of_a_rectifier_is_found_through_the_diodes_switch() {
    // The diode of a rectifier conducts until tan(wt) = -wRC; then the capacitor voltage v decays with the time
    // constant RC.
    let (r, c, w) = (1000.0, 1e-4, 100.0 * std::f64::consts::PI);
    let off = (std::f64::consts::PI - (w * r * c).atan()) / w;
    let at = |t: f64| 10.0 * if t <= off { (w * t).sin() } else { (w * off).sin() * (-(t - off) / (r * c)).exp() };
    let t: Vec<f64> = (1..=18).map(|i| f64::from(i) / 1000.0).collect();
    let v: Vec<f64> = t.iter().map(|&t| at(t)).collect();
    let (_, fit) = fitted(&json!({"problem": {"circuit": {"parameters": {"C": 5e-5}, "components": [
            {"voltage_source": {"name": "V", "nodes": ["in", "0"], "volts": "10*sin(100*pi*t)"}},
            {"diode": {"name": "D", "nodes": ["in", "out"]}},
            {"capacitor": {"name": "C1", "nodes": ["out", "0"], "farads": "C"}},
            {"resistor": {"name": "R1", "nodes": ["out", "0"], "ohms": r}}]}},
        "time": {"end": 0.018}, "method": {"rtol": 1e-11},
        "fit": {"parameters": {"C": {"lower": 1e-6, "upper": 1e-2}}, "data": {"t": t, "v(C1)": v, "sd": 0.1}}}));
    assert_near(fit.parameters["C"].estimate, c, 1e-8);
}

#[test]
fn what_is_measured_may_be_a_definition_of_states_and_parameters() {
    // The measured quantity is y = gain x^2 with x = exp(-a t): ln y = ln gain - 2 a t.
    let t: Vec<f64> = (0..=10).map(|i| f64::from(i) * 0.3).collect();
    let y: Vec<f64> = t.iter().map(|t| 3.0 * (-2.0 * 0.7 * t).exp()).collect();
    let (_, fit) =
        fitted(&json!({"problem": {"dvi": {"parameters": {"a": 1, "gain": 1}, "definitions": {"y": "gain*x^2"},
            "states": {"x": {"initial": 1, "rate": "-a*x"}, "w": {"initial": 0, "rate": "1"}}}},
        "time": {"end": 3}, "method": {"rtol": 1e-11, "atol": 1e-13},
        "fit": {"parameters": {"a": {}, "gain": {}}, "data": {"t": t, "y": y, "sd": 0.01, "w": t}}}));
    assert_near(fit.parameters["a"].estimate, 0.7, 1e-8);
    assert_near(fit.parameters["gain"].estimate, 3.0, 1e-8);
    // The derivatives of the measured quantity y are dy/da = -2 t y and dy/dgain = y/gain.
    let sum = |f: &dyn Fn(f64, f64) -> f64| -> f64 { t.iter().zip(&y).map(|(t, y)| f(*t, *y)).sum() };
    let [aa, ag, gg] =
        [sum(&|t, y| (2.0 * t * y).powi(2)), sum(&|t, y| -2.0 * t * y * y / 3.0), sum(&|_, y| y * y / 9.0)];
    assert_near(fit.parameters["a"].sd.unwrap(), 0.01 * (gg / (aa * gg - ag * ag)).sqrt(), 1e-6);
}

#[test]
fn two_parameters_that_enter_as_a_product_are_not_told_apart() {
    let t: Vec<f64> = (1..=10).map(|i| f64::from(i) * 0.3).collect();
    let x: Vec<f64> = t.iter().map(|t| (-0.6 * t).exp()).collect();
    let (solution, fit) = fitted(&json!({"problem": {"dvi": {"parameters": {"a": 1, "b": 1, "c": 1},
            "states": {"x": {"initial": "c", "rate": "-a*b*x"}}}}, "time": {"end": 3}, "method": {"rtol": 1e-9},
        "fit": {"parameters": {"a": {}, "b": {}, "c": {}}, "data": {"t": t, "x": x, "sd": 0.01}}}));
    let [a, b, c] = ["a", "b", "c"].map(|name| fit.parameters[name]);
    assert_near(a.estimate * b.estimate, 0.6, 1e-6);
    assert_near(c.estimate, 1.0, 1e-6);
    assert_eq!((a.sd, b.sd, fit.covariance[0][1]), (None, None, None));
    assert!(c.sd.is_some());
    let [parts] = &fit.undetermined[..] else { panic!("one combination: {:?}", fit.undetermined) };
    assert_near(parts["a"] / parts["b"], -1.0, 1e-5);
    assert_eq!(parts.len(), 2);
    assert!(caveats(&solution).contains(&"undetermined"), "{:?}", solution.verdict);
}

#[test]
fn a_parameter_that_nothing_depends_on_is_named_alone() {
    let (t, x) = line();
    let (_, fit) = fitted(&json!({"problem": {"dvi": {"parameters": {"a": 1, "b": 3}, "states": {
            "x": {"initial": 1, "rate": "a"}, "y": {"initial": 0, "rate": "b"}}}}, "time": {"end": 4},
        "fit": {"parameters": {"a": {}, "b": {}}, "data": {"t": t, "x": x}}}));
    assert_eq!(fit.undetermined.len(), 1);
    assert_eq!(fit.undetermined[0].keys().collect::<Vec<_>>(), ["b"]);
    assert!(fit.parameters["b"].sd.is_none() && fit.parameters["a"].sd.is_some());
}

#[test]
fn hubers_loss_leaves_one_value_that_is_far_off_its_bound_alone() {
    // A constant m is fitted to 9 values at 2 and one at 50, with sd 0.1: Huber's loss is least where 9 (m - 2)/0.1 =
    // 1.345.
    let t: Vec<f64> = (1..=10).map(f64::from).collect();
    let x: Vec<f64> = (1..=10).map(|i| if i == 4 { 50.0 } else { 2.0 }).collect();
    let (_, fit) =
        fitted(&json!({"problem": {"dvi": {"states": {"x": {"initial": 0, "rate": "0"}}}}, "time": {"end": 10},
        "fit": {"parameters": {"x.initial": {}}, "data": {"t": t, "x": x, "sd": 0.1}, "loss": "huber"}}));
    assert_near(fit.parameters["x.initial"].estimate - 2.0, 1.345 * 0.1 / 9.0, 1e-3);
}

#[test]
fn a_bound_that_holds_a_parameter_is_told() {
    let (t, x) = line();
    let (solution, fit) = fitted(&json!({"problem": problem_of_a_line(), "time": {"end": 4}, "method": {"rtol": 1e-9},
        "fit": {"parameters": {"a": {"upper": 1.5}, "x.initial": {}}, "data": {"t": t, "x": x, "sd": 0.05}}}));
    assert_eq!((fit.parameters["a"].estimate, fit.parameters["a"].sd), (1.5, None));
    // With the slope at its bound, the intercept is the mean of x - 1.5 t.
    let rest: f64 = t.iter().zip(&x).map(|(t, x)| x - 1.5 * t).sum::<f64>() / t.len() as f64;
    assert_near(fit.parameters["x.initial"].estimate, rest, 1e-7);
    assert_near(fit.parameters["x.initial"].sd.unwrap(), 0.05 / (t.len() as f64).sqrt(), 1e-7);
    let told = caveats(&solution);
    assert!(told.contains(&"at_bound") && told.contains(&"misfit"), "{told:?}");
}

#[test]
fn of_several_starts_the_best_minimum_is_kept_and_the_others_told() {
    // The loss as a function of the frequency of a sine has many local minima.
    let t: Vec<f64> = (0..=60).map(|i| f64::from(i) * 0.1).collect();
    let x: Vec<f64> = t.iter().map(|t| (5.0 * t).sin()).collect();
    let specification = |starts: u32| {
        json!({"problem": {"dvi": {"parameters": {"w": 1}, "states": {
            "x": {"initial": 0, "rate": "w*y"}, "y": {"initial": 1, "rate": "-w*x"}}}}, "time": {"end": 6},
        "fit": {"parameters": {"w": {"lower": 0.5, "upper": 9}}, "data": {"t": t, "x": x, "sd": 0.1}, "starts": starts}})
    };
    let (solution, alone) = fitted(&specification(1));
    assert!(alone.loss > 100.0, "from 1 the search ends in another minimum: {}", alone.loss);
    assert!(caveats(&solution).contains(&"misfit"));
    let (solution, fit) = fitted(&specification(12));
    assert_near(fit.parameters["w"].estimate, 5.0, 1e-5);
    assert_eq!(fit.starts.len(), 12);
    assert!(caveats(&solution).contains(&"several_minima"));
}

#[test]
fn a_minimum_that_is_not_the_least_is_told_by_residuals_of_one_sign() {
    // Data of x = cos 3t with errors of 1 %. From the frequency 1 the search for the least loss ends in another local
    // minimum; the standard deviation of the data is not given.
    let mut random = fastrand::Rng::with_seed(5);
    let t: Vec<f64> = (1..=120).map(|i| f64::from(i) / 10.0).collect();
    let x: Vec<f64> = t.iter().map(|t| (3.0 * t).cos() + 0.01 * normals(&mut random)[0]).collect();
    let from = |w: f64| {
        fitted(&json!({"problem": {"dvi": {"parameters": {"w": w}, "states": {
                "x": {"initial": 1, "rate": "w*v"}, "v": {"initial": 0, "rate": "-w*x"}}}},
            "time": {"end": 12}, "fit": {"parameters": {"w": {}}, "data": {"t": t, "x": x}}}))
    };
    let (solution, fit) = from(2.95);
    assert!((fit.parameters["w"].estimate - 3.0).abs() < 1e-3 && !caveats(&solution).contains(&"misfit"), "{fit:?}");
    let (solution, fit) = from(1.0);
    assert!((fit.parameters["w"].estimate - 3.0).abs() > 0.1 && caveats(&solution).contains(&"misfit"), "{fit:?}");
}

/// Returns two independent standard normal numbers (Box and Muller 1958).
fn normals(random: &mut fastrand::Rng) -> [f64; 2] {
    let (radius, angle) = ((-2.0 * (1.0 - random.f64()).ln()).sqrt(), TAU * random.f64());
    [radius * angle.cos(), radius * angle.sin()]
}

/// Returns, for each parameter, the number of confidence intervals that contain its true value, over `fits` fits to
/// the motion of a mass on a belt.
fn covered(fits: u64, sd: f64, is_told: bool) -> [u64; 2] {
    let (f, v) = (1.0, 0.5);
    let mut held = [0; 2];
    for seed in 0..fits {
        let mut random = fastrand::Rng::with_seed(1000 + seed);
        let t: Vec<f64> = (1..=20).map(|i| f64::from(i) * 0.375).collect();
        let x: Vec<f64> = t.iter().map(|&t| carried(f, v, t) + sd * normals(&mut random)[0]).collect();
        let mut data = json!({"t": t, "x": x});
        if is_told {
            data["sd"] = json!(sd);
        }
        let specification = json!({"problem": problem_of_the_belt(), "time": {"end": 7.5}, "method": {"rtol": 1e-6},
            "output": {"times": {"count": 2}}, "fit": {"parameters": {"f": {}, "v_belt": {}}, "data": data}});
        let (_, fit) = fitted(&specification);
        for (held, (name, value)) in held.iter_mut().zip([("f", f), ("v_belt", v)]) {
            let found = fit.parameters[name];
            *held += u64::from((found.lower.unwrap()..=found.upper.unwrap()).contains(&value));
        }
    }
    held
}

#[test]
fn intervals_at_95_percent_cover_about_so_often() {
    // Of 200 intervals, 190 +- 9.5 should contain the true value: the limits allow about three standard deviations of
    // the binomial count.
    for is_told in [true, false] {
        for held in covered(200, 0.02, is_told) {
            assert!((180..=200).contains(&held), "{held} of 200, sd told: {is_told}");
        }
    }
}

#[test]
fn a_fit_that_cannot_be_run_says_why() {
    let specification = json!({"problem": {"dvi": {"parameters": {"a": 1}, "states": {
            "x": {"initial": 1, "rate": "a*x^2"}}}}, "time": {"end": 4},
        "fit": {"parameters": {"a": {}}, "data": {"t": [1, 3], "x": [1, 2]}}});
    let specification = Specification::from_json(specification.to_string().as_bytes()).expect("a specification");
    let solution = dvi::solve(&specification, &Control::new());
    assert_eq!(solution.status, Status::Failed);
    let error = solution.error.unwrap();
    assert!(
        error.message.starts_with("the problem cannot be solved at the starting point of the fit"),
        "{}",
        error.message
    );
    assert!(solution.fit.is_none() && !solution.verdict.trusted);
}

#[test]
fn a_bounce_tells_gravity_and_restitution() {
    // Heights of a ball that falls from 1 and bounces, from closed forms with g = 9.81 and e = 0.7.
    let (g, e) = (9.81_f64, 0.7);
    let fall = (2.0 / g).sqrt();
    let height = |t: f64| {
        let (since, speed) = (t - fall, e * g * fall);
        if since < 0.0 { 1.0 - 0.5 * g * t * t } else { speed * since - 0.5 * g * since * since }
    };
    let t: Vec<f64> = (1..=10).map(|k| 0.1 * f64::from(k)).collect();
    let y: Vec<f64> = t.iter().map(|t| height(*t)).collect();
    let (_, fit) = fitted(&json!({"problem": {"mechanical": {"parameters": {"g": 9, "e": 0.5},
            "coordinates": {"y": {"initial": 1}}, "mass": [[1]], "potential": "g*y",
            "contacts": [{"name": "floor", "gap": "y", "restitution": "e"}]}}, "time": {"end": 1},
        "fit": {"parameters": {"g": {"lower": 1, "upper": 30}, "e": {"lower": 0, "upper": 1}},
            "data": {"t": t, "y": y, "sd": 0.01}}}));
    assert_near(fit.parameters["g"].estimate, g, 1e-7);
    assert_near(fit.parameters["e"].estimate, e, 1e-7);
    // Lower bound of the standard deviation of e, from dy/de = g T (t - T) after the bounce at the time T, for a
    // known g. It is larger if g is estimated as well.
    let known: f64 = t.iter().filter(|t| **t > fall).map(|t| (g * fall * (t - fall) / 0.01).powi(2)).sum();
    let sd = fit.parameters["e"].sd.expect("a standard deviation");
    assert!(sd > known.sqrt().recip() && sd < 3.0 * known.sqrt().recip(), "{sd} for {}", known.sqrt().recip());
}
