//! Adjoint gradients, compared with closed forms and with forward sensitivities: on smooth motion, through switches
//! with jumping rates, along sliding modes, at breakpoints that depend on a parameter, and through impacts and their
//! accumulation. The cost of a gradient does not depend on the number of parameters, and gradients that do not exist
//! are refused.

use crate::systems::harness::{last, solve};
use dvi::problem::Control;
use dvi::radau::{Adjoint, AdjointWork, Directions, Radau, Tangents};
use dvi::solution::{Solution, Status};
use dvi::specification::Specification;
use hybrid::OneStep;
use nalgebra::DMatrix;
use serde_json::{Value, json};

/// Returns a specification that solves `problem` up to the time `end` with the given `sensitivities`.
fn document(problem: &Value, end: f64, sensitivities: &Value) -> Value {
    let mut method = json!({"rtol": 1e-11, "atol": 1e-13});
    if problem.get("mechanical").is_some() {
        method["impacts"] = json!("locate");
        // The gap of a contact that is closed at the start is known only up to its tolerance, so the absolute
        // tolerance is larger for mechanical problems.
        method["atol"] = json!(1e-11);
    }
    json!({"problem": problem, "time": {"end": end}, "method": method, "output": {"times": [end]},
        "sensitivities": sensitivities})
}

/// Solves `problem` up to the time `end` with the adjoint gradient of `objective` by the parameters `to`, and asserts
/// that the solution is trusted.
#[track_caller]
fn gradient(problem: &Value, end: f64, to: &[&str], objective: &Value) -> Solution {
    let asked = json!({"to": to, "mode": "adjoint", "objective": objective});
    let solution = solve(&document(problem, end, &asked));
    assert!(solution.verdict.trusted, "{:?}", solution.verdict);
    assert_eq!(solution.gradient.len(), to.len());
    assert!(solution.trajectory.fields.iter().all(|field| !field.name.contains('/')), "adjoint mode has no columns");
    solution
}

#[track_caller]
fn assert_near(found: f64, expected: f64, part: f64, name: &str) {
    assert!((found - expected).abs() <= part * expected.abs().max(1.0), "{name}: {found:e} for {expected:e}");
}

/// Asserts that the gradients of final states `of` and of integrals of `integrands` in adjoint mode agree with the
/// derivatives in forward mode.
#[track_caller]
fn assert_forward(problem: &Value, end: f64, to: &[&str], (of, integrands): (&[&str], &[&str])) {
    let mut with_integrals = problem.clone();
    let names: Vec<String> = (0..integrands.len()).map(|k| format!("I{k}")).collect();
    for members in with_integrals.as_object_mut().expect("an object").values_mut() {
        for (name, integrand) in names.iter().zip(integrands) {
            members["integrals"][name] = json!(integrand);
        }
    }
    let all: Vec<&str> = of.iter().copied().chain(names.iter().map(String::as_str)).collect();
    let forward = solve(&document(&with_integrals, end, &json!({"to": to, "of": all})));
    let objectives =
        of.iter().map(|of| json!({"final": of})).chain(integrands.iter().map(|of| json!({"integral": of})));
    for (of, objective) in all.iter().zip(objectives) {
        let adjoint = gradient(problem, end, to, &objective);
        assert_near(adjoint.objective.expect("an objective"), last(&forward, of), 1e-9, of);
        for to in to {
            let name = format!("d{of}/d{to}");
            assert_near(adjoint.gradient[*to], last(&forward, &name), 1e-9, &name);
        }
    }
}

#[test]
fn the_gradient_of_a_linear_oscillator_is_that_of_its_solution() {
    let problem = json!({"dvi": {"parameters": {"k": 4, "m": 1, "a": 2}, "mass": [[1, 0], [0, "m"]],
        "states": {"x": {"initial": "a", "rate": "v"}, "v": {"initial": 0, "rate": "-k*x"}}}});
    let to = ["k", "m", "a", "v.initial"];
    let solution = gradient(&problem, 3.0, &to, &json!({"final": "k*x^2"}));
    // For the oscillator x = a cos wt with w^2 = k/m, the derivatives of the frequency are dw/dk = w/2k and dw/dm =
    // -w/2m.
    let (w, t) = (2.0_f64, 3.0);
    let (x, by_w) = (2.0 * (w * t).cos(), -2.0 * t * (w * t).sin());
    let slopes = [by_w * w / 8.0, -by_w * w / 2.0, (w * t).cos(), (w * t).sin() / w];
    for (k, (name, slope)) in to.iter().zip(slopes).enumerate() {
        let own = if k == 0 { x * x } else { 0.0 };
        assert_near(solution.gradient[*name], 8.0 * x * slope + own, 1e-9, name);
    }
    assert_near(solution.objective.expect("an objective"), 4.0 * x * x, 1e-9, "the objective");
    let checked = solution.sensitivities.expect("a check");
    assert_eq!(checked.of, "objective");
    assert!((checked.derivative - checked.finite_difference).abs() <= checked.uncertainty);
    assert_forward(&problem, 3.0, &to, (&["x", "v"], &["k*x^2 + v", "t*x"]));
}

#[test]
fn a_relay_that_slides_has_the_gradient_of_its_closed_form() {
    // The state x decreases at the rate mu to zero and slides there; the state y is the integral of x, finally
    // x0^2/2mu.
    let problem = json!({"filippov": {"parameters": {"mu": 2, "x0": 3}, "surface": "x",
        "states": {"x": {"initial": "x0", "plus": "-mu", "minus": "mu"}, "y": {"initial": 0, "plus": "x", "minus": "x"}}}});
    let to = ["mu", "x0"];
    let solution = gradient(&problem, 4.0, &to, &json!({"final": "mu*y"}));
    assert_near(solution.gradient["mu"], 0.0, 1e-9, "mu");
    assert_near(solution.gradient["x0"], 3.0, 1e-9, "x0");
    // The integral of x^2 over the run, with the initial value x0 of x and its rate -mu, is x0^3/3mu.
    let solution = gradient(&problem, 4.0, &to, &json!({"integral": "x^2"}));
    assert_near(solution.gradient["mu"], -27.0 / 12.0, 1e-9, "mu");
    assert_near(solution.gradient["x0"], 4.5, 1e-9, "x0");
    assert_forward(&problem, 4.0, &to, (&["x", "y"], &["x*y"]));
}

#[test]
fn gradients_through_switches_are_those_of_forward_mode() {
    // A block with Coulomb friction slides to rest and is later pushed off again.
    let friction = json!({"dvi": {"parameters": {"a": 4, "b": 3, "mu": 1},
        "states": {"v": {"initial": 0, "rate": "a - b*t - F"}}, "variables": {"F": {"inequality": "-v"}},
        "set": [{"box": {"of": ["F"], "lower": "-mu", "upper": "mu"}}]}});
    assert_forward(&friction, 4.0, &["a", "b", "mu"], (&["v"], &["v^2"]));
    // The static friction of a block at rest reaches its bound, and the block begins to slip.
    let torn = json!({"dvi": {"parameters": {"a": 2, "mu": 3},
        "states": {"x": {"initial": 0, "rate": "v"}, "v": {"initial": 0, "rate": "a*t - F"}},
        "variables": {"F": {"inequality": "-v"}}, "set": [{"box": {"of": ["F"], "lower": "-mu", "upper": "mu"}}]}});
    assert_forward(&torn, 4.0, &["a", "mu"], (&["x", "v"], &["x*v"]));
    // Two problems, one with a breakpoint in time and one with a moving bound, each of which depends on a parameter.
    let breaks = json!({"dvi": {"parameters": {"p": 1.25, "b": 3},
        "states": {"x": {"initial": 0, "rate": "b*heaviside(t - p)"}}}});
    assert_forward(&breaks, 4.0, &["p", "b"], (&["x"], &["x^2"]));
    let bound = json!({"dvi": {"parameters": {"c": 2}, "states": {"x": {"initial": 0, "rate": "z"}},
        "variables": {"z": {"inequality": "z - t^2"}}, "set": [{"box": {"of": ["z"], "upper": "c*t"}}]}});
    assert_forward(&bound, 4.0, &["c"], (&["x"], &["x"]));
    // A hidden constraint of index 2: the current of a diode in series with an inductance.
    let rectifier = json!({"dvi": {"parameters": {"l": 1, "c": 1, "e": 1},
        "states": {"i": {"initial": 0, "rate": "(e - v + u)/l"}, "v": {"initial": 0, "rate": "i/c"}},
        "variables": {"u": {"inequality": "i"}}, "set": [{"nonnegative": ["u"]}]}});
    assert_forward(&rectifier, 6.0, &["l", "c", "e"], (&["i", "v"], &["i*e"]));
}

#[test]
fn a_diode_that_charges_a_capacitor_has_the_gradient_of_its_closed_form() {
    // Closed form of the voltage of a capacitor that is charged through a resistor and an ideal diode which conducts
    // all the time: v = E (1 - exp(-t/RC)).
    let problem = json!({"circuit": {"parameters": {"E": 10, "R": 1000, "C": 1e-6}, "components": [
        {"voltage_source": {"name": "V", "nodes": ["a", "0"], "volts": "E"}},
        {"diode": {"name": "D", "nodes": ["a", "b"]}},
        {"resistor": {"name": "R1", "nodes": ["b", "c"], "ohms": "R"}},
        {"capacitor": {"name": "C1", "nodes": ["c", "0"], "farads": "C"}}]}});
    let t = 1.5e-3;
    let solution = gradient(&problem, t, &["E", "R", "C"], &json!({"final": "v(C1)"}));
    let (tau, left) = (1e-3, (-1.5_f64).exp());
    let by_tau = -10.0 * left * t / (tau * tau);
    for (name, expected) in [("E", 1.0 - left), ("R", by_tau * 1e-6), ("C", by_tau * 1000.0)] {
        let found = solution.gradient[name];
        assert!((found / expected - 1.0).abs() < 1e-8, "{name}: {found:e} for {expected:e}");
    }
}

#[test]
fn a_variable_that_rests_at_its_bound_does_not_hide_the_switch_of_another() {
    // The state x = 1 - a t decreases to zero while y rests at zero all along: the integral of x is 1/(2 a).
    let problem = json!({"dvi": {"parameters": {"a": 1},
        "states": {"x": {"initial": 1, "rate": "z - a"}, "y": {"initial": 0, "rate": "u - a"}},
        "variables": {"z": {"inequality": "x"}, "u": {"inequality": "y"}}, "set": [{"nonnegative": ["z", "u"]}]}});
    let solution = gradient(&problem, 2.0, &["a", "x.initial"], &json!({"integral": "x"}));
    assert_near(solution.gradient["a"], -0.5, 1e-9, "a");
    assert_near(solution.gradient["x.initial"], 1.0, 1e-9, "x.initial");
    // Dry friction holds one block at rest and stops the other, whose velocity is v = v0 - mu t until the time v0/mu.
    let problem = json!({"dvi": {"parameters": {"mu": 1, "v0": 1.5},
        "states": {"v": {"initial": "v0", "rate": "-mu*p"}, "w": {"initial": 0, "rate": "0.5*mu - mu*r"}},
        "variables": {"p": {"inequality": "-v"}, "r": {"inequality": "-w"}},
        "set": [{"box": {"of": ["p", "r"], "lower": -1, "upper": 1}}]}});
    let solution = gradient(&problem, 3.0, &["mu", "v0"], &json!({"integral": "v"}));
    assert_near(solution.gradient["mu"], -0.5 * 1.5 * 1.5, 1e-9, "mu");
    assert_near(solution.gradient["v0"], 1.5, 1e-9, "v0");
}

/// A mechanical problem: a ball that falls from the height `h` and bounces with the restitution coefficient `e`.
fn ball() -> Value {
    json!({"mechanical": {"parameters": {"h": 1, "g": 9.81, "e": 0.6},
        "coordinates": {"y": {"initial": "h"}}, "mass": [[1]], "potential": "g*y",
        "contacts": [{"name": "floor", "gap": "y", "restitution": "e"}]}})
}

/// The height of the ball after two bounces, `y = e^2 u s - g s^2/2` with the speed `u` of the first impact and the
/// time `s` since the second.
fn height([h, g, e]: [f64; 3], t: f64) -> f64 {
    let u = (2.0 * g * h).sqrt();
    let s = t - u / g * (1.0 + 2.0 * e);
    e * e * u * s - 0.5 * g * s * s
}

#[test]
fn the_height_of_a_ball_after_two_bounces_has_the_gradient_of_its_closed_form() {
    let (values, t) = ([1.0, 9.81, 0.6], 1.2);
    let solution = gradient(&ball(), t, &["h", "g", "e"], &json!({"final": "y"}));
    assert_near(solution.objective.expect("an objective"), height(values, t), 1e-9, "y");
    let [h, g, e] = values;
    let u = (2.0 * g * h).sqrt();
    let s = t - u / g * (1.0 + 2.0 * e);
    // The derivatives of the height of the ball follow from those of the impact speed u and of the time s since the
    // second bounce: du = u (dh/2h + dg/2g) and ds = -d(u/g (1 + 2e)).
    let slope = |[dh, dg, de]: [f64; 3]| {
        let du = u * (dh / (2.0 * h) + dg / (2.0 * g));
        let ds = -(du / g - u * dg / (g * g)) * (1.0 + 2.0 * e) - 2.0 * u / g * de;
        2.0 * e * de * u * s + e * e * (du * s + u * ds) - 0.5 * dg * s * s - g * s * ds
    };
    for (k, name) in ["h", "g", "e"].into_iter().enumerate() {
        let direction: [f64; 3] = std::array::from_fn(|i| if i == k { 1.0 } else { 0.0 });
        assert_near(solution.gradient[name], slope(direction), 1e-9, name);
    }
}

#[test]
fn gradients_through_impacts_are_those_of_forward_mode() {
    // Two end times lie before the accumulation point of the ball's impacts, and one behind it; the integrand y_dot^2
    // jumps at each impact.
    let to = ["h", "g", "e", "y_dot.initial"];
    for end in [1.2, 1.7, 2.5] {
        assert_forward(&ball(), end, &to, (&["y", "y_dot"], &["y", "y_dot^2"]));
    }
    // A block on a rough floor slides to rest and is pushed off again by a growing force.
    let block = json!({"mechanical": {"parameters": {"m": 2, "g": 9.81, "mu": 0.3, "w": 2, "k": 2},
        "coordinates": {"x": {"initial": 0, "velocity": "w"}, "y": {"initial": 0}},
        "mass": [["m", 0], [0, "m"]], "potential": "m*g*y", "forces": {"x": "k*t"},
        "contacts": [{"name": "floor", "gap": "y", "friction": {"coefficient": "mu", "slip": ["x_dot"]}}]}});
    assert_forward(&block, 4.0, &["m", "g", "mu", "w", "k"], (&["x", "x_dot"], &["x*x_dot"]));
    // A pendulum, held by a joint of constant length, swings against a wall.
    let pendulum = json!({"mechanical": {"parameters": {"l": 1, "g": 9.81, "e": 0.7}, "coordinates": {
            "x": {"initial": "l*sin(1)"}, "y": {"initial": "-l*cos(1)"}}, "mass": [[1, 0], [0, 1]], "potential": "g*y",
        "joints": [{"name": "rod", "constraint": "x^2 + y^2 - l^2"}],
        "contacts": [{"name": "wall", "gap": "x + 0.2", "restitution": "e"}]}});
    assert_forward(&pendulum, 3.0, &["l", "g", "e"], (&["x", "y"], &["x*y"]));
    // A run of the bouncing ball that starts at t = 100 has the same gradient as its equivalent that starts at t = 0.
    let mut later = document(&ball(), 101.2, &json!({"to": to, "mode": "adjoint", "objective": {"integral": "t*y"}}));
    later["time"]["start"] = json!(100);
    let later = solve(&later).gradient;
    let now = gradient(&ball(), 1.2, &to, &json!({"integral": "(100 + t)*y"})).gradient;
    to.iter().for_each(|name| assert_near(later[*name], now[*name], 1e-8, name));
}

/// Solves a chain of 50 masses at rest between springs, with the gradient by the first `differentiated` of its spring
/// constants and applied forces.
fn chain(differentiated: usize) -> Solution {
    let (mut parameters, mut states, mut to) = (json!({}), json!({}), Vec::new());
    for i in 0..50 {
        let (left, here, right) = (
            if i == 0 { "0".into() } else { format!("x{}", i - 1) },
            format!("x{i}"),
            if i == 49 { "0".into() } else { format!("x{}", i + 1) },
        );
        parameters[format!("k{i}")] = json!(1.0 + 0.01 * f64::from(i));
        parameters[format!("f{i}")] = json!(0.1);
        let next = if i == 49 { "1".to_owned() } else { format!("k{}", i + 1) };
        let rate = format!("k{i}*({left} - {here}) + {next}*({right} - {here}) + f{i}");
        states[here] = json!({"initial": 0, "rate": rate});
        to.extend([format!("k{i}"), format!("f{i}")]);
    }
    to.truncate(differentiated);
    let problem = json!({"dvi": {"parameters": parameters, "states": states}});
    let to: Vec<&str> = to.iter().map(String::as_str).collect();
    gradient(&problem, 2.0, &to, &json!({"final": "x0^2 + x25"}))
}

#[test]
fn a_hundred_parameters_cost_as_much_as_one() {
    let [one, all] = [1, 100].map(chain);
    let work = |solution: &Solution| solution.diagnostics.adjoint.expect("a sweep back");
    let (of_one, of_all) = (work(&one), work(&all));
    // The backward sweep of the adjoint mode factorises the matrix of each step once. The run for one parameter and
    // the run for all of them have different steps, because each also integrates the derivatives along one direction
    // in the space of its parameters, and these limit the step size.
    assert_eq!(of_all.factorisations, of_all.steps);
    assert_eq!(of_all.steps, all.diagnostics.steps.accepted);
    assert!(of_all.jacobians <= 7 * of_all.steps && of_all.repeated == 0, "{of_all:?}");
    // The adjoint needs finite differences only at breakpoints and for hidden constraints, and the chain has neither.
    assert_eq!(of_all.differences, 0);
    let ratio = |a: u64, b: u64| a as f64 / b as f64;
    assert!(ratio(of_all.factorisations, of_one.factorisations) < 1.5, "{of_all:?} {of_one:?}");
    assert!(ratio(of_all.jacobians, of_one.jacobians) < 1.5, "{of_all:?} {of_one:?}");
    let (evaluations, of_one) = (all.diagnostics.evaluations, one.diagnostics.evaluations);
    assert!(ratio(evaluations.rates, of_one.rates) < 1.5, "{evaluations:?} {of_one:?}");
    // The derivative by the first spring constant is the same whether the gradient by one parameter or by all is
    // requested.
    assert_near(all.gradient["k0"], one.gradient["k0"], 1e-9, "k0");
    // For x' = A x + f the derivative by f is the integral of exp(A t) applied to the gradient at the end, evaluated
    // by a Taylor series; A is symmetric.
    let k = |i: usize| if i < 50 { 1.0 + 0.01 * i as f64 } else { 1.0 };
    let apply = |y: &[f64]| -> Vec<f64> {
        let at = |i: Option<usize>| i.and_then(|i| y.get(i)).copied().unwrap_or(0.0);
        (0..50).map(|i| k(i) * (at(i.checked_sub(1)) - y[i]) + k(i + 1) * (at(Some(i + 1)) - y[i])).collect()
    };
    let series = |start: &[f64]| -> Vec<f64> {
        // Applies the sum of t^(j+1)/(j+1)! A^j, the integral of exp(A t), over subintervals short enough for the
        // series to converge without cancellation.
        let (parts, t) = (20, 0.1);
        let (mut state, mut sum) = (start.to_vec(), vec![0.0; 50]);
        for _ in 0..parts {
            let (mut term, mut next) = (state.clone(), vec![0.0; 50]);
            let mut factor = 1.0;
            for j in 0..30 {
                next.iter_mut().zip(&term).for_each(|(next, term)| *next += factor * term);
                factor *= t / f64::from(j + 1);
                sum.iter_mut().zip(&term).for_each(|(sum, term)| *sum += factor * term);
                term = apply(&term);
            }
            state = next;
        }
        sum
    };
    // The matrix A is symmetric, so it is its own transpose. The final state is series(f), and the objective has the
    // derivative 2 x0 by the position of the first mass and 1 by that of mass 25.
    let x = series(&[0.1; 50]);
    let mut costate = vec![0.0; 50];
    (costate[0], costate[25]) = (2.0 * x[0], 1.0);
    let by_forces = series(&costate);
    for (i, expected) in by_forces.iter().enumerate() {
        assert_near(all.gradient[&format!("f{i}")], *expected, 1e-9, &format!("f{i}"));
    }
}

#[test]
fn steps_resolve_gradients_where_the_states_rest() {
    // The state x' = -40 (x - 1) rests at 1, where steps of any length are exact, but perturbations decay: dx/dx0 =
    // exp(-40 t).
    let solution = solve(&json!({"problem": {"dvi": {"states": {"x": {"initial": 1, "rate": "-40*(x-1)"}}}},
        "time": {"end": 0.1},
        "sensitivities": {"to": ["x.initial"], "mode": "adjoint", "objective": {"final": "x"}}}));
    assert!(solution.verdict.trusted, "{:?}", solution.verdict);
    let found = solution.gradient["x.initial"];
    assert!((found - (-4.0_f64).exp()).abs() < 1e-5, "{found:e}");
}

fn failure(document: &Value) -> String {
    let specification = Specification::from_json(document.to_string().as_bytes())
        .unwrap_or_else(|errors| panic!("the specification has errors: {errors:#?}"));
    let solution = dvi::solve(&specification, &Control::new());
    assert_eq!(solution.status, Status::Failed);
    assert!(solution.gradient.is_empty() && !solution.verdict.trusted);
    let failure = solution.error.expect("a failure");
    assert_eq!(failure.code, "no_derivative");
    failure.message
}

#[test]
fn where_there_is_no_gradient_the_run_says_so() {
    // Two relays reach their switching surfaces at the same time, and one drives the other, so that the order of the
    // switches matters.
    let relays = json!({"dvi": {"parameters": {"a": 1, "b": 0.5},
        "states": {"x": {"initial": "a", "rate": "-z"}, "y": {"initial": "b", "rate": "0.5*z - w"}, "q": {"initial": 0, "rate": "z + w"}},
        "variables": {"z": {"inequality": "-x"}, "w": {"inequality": "-y"}},
        "set": [{"box": {"of": ["z", "w"], "lower": -1, "upper": 1}}]}});
    let asked = json!({"to": ["a", "b"], "mode": "adjoint", "objective": {"final": "q"}});
    let mut two = document(&relays, 3.0, &asked);
    two["method"] = json!({});
    let message = failure(&two);
    assert!(message.contains("several switches") && message.contains("t = 1"), "{message}");
    // The two feet of a beam land at the same time, in an order that a perturbation of its angle decides.
    let beam = json!({"mechanical": {"coordinates": {"phi": {"initial": 0}, "y": {"initial": 1}},
        "mass": [[0.4, 0], [0, 1]], "potential": "9.81*y",
        "contacts": [{"name": "left", "gap": "y - sin(phi)", "restitution": 0.5},
            {"name": "right", "gap": "y + sin(phi)", "restitution": 0.5}]}});
    let asked = json!({"to": ["phi.initial"], "mode": "adjoint", "objective": {"final": "y"}});
    let message = failure(&document(&beam, 0.7, &asked));
    assert!(message.contains("several contacts meet at one time"), "{message}");
    // The derivative of the objective sqrt(x) is infinite at the final x = 0.
    let decay = json!({"dvi": {"parameters": {"k": 0}, "states": {"x": {"initial": 0, "rate": "k"}}}});
    let asked = json!({"to": ["k"], "mode": "adjoint", "objective": {"final": "sqrt(x)"}});
    let message = failure(&document(&decay, 1.0, &asked));
    assert!(message.contains("not finite"), "{message}");
}

#[test]
fn what_adjoint_mode_cannot_do_is_refused_with_its_place() {
    let refused = |asked: Value, more: Value| -> (String, String, String) {
        let mut document = json!({"problem": {"dvi": {"parameters": {"k": 1},
            "states": {"x": {"initial": 1, "rate": "-k*x + z"}}, "variables": {"z": {"inequality": "z - x"}},
            "set": [{"nonnegative": ["z"]}]}}, "time": {"end": 1}, "sensitivities": asked});
        for (key, value) in more.as_object().expect("an object") {
            document[key] = value.clone();
        }
        let errors = Specification::from_json(document.to_string().as_bytes()).expect_err("errors");
        let first = errors.first().expect("an error");
        assert_eq!(errors.len(), 1, "{errors:#?}");
        (first.pointer.clone(), first.code.to_string(), format!("{first:?}"))
    };
    let adjoint = |objective: Value| json!({"to": ["k"], "mode": "adjoint", "objective": objective});
    let cases = [
        (json!({"to": ["k"], "mode": "reverse"}), json!({}), "/sensitivities/mode", "forward"),
        (json!({"to": ["k"], "mode": "adjoint"}), json!({}), "/sensitivities/objective", "final"),
        (json!({"to": ["k"], "objective": {"final": "x"}}), json!({}), "/sensitivities/objective", "adjoint"),
        (
            json!({"to": ["k"], "of": ["x"], "mode": "adjoint", "objective": {"final": "x"}}),
            json!({}),
            "/sensitivities/of",
            "objective",
        ),
        (adjoint(json!({"final": "y"})), json!({}), "/sensitivities/objective/final", "y"),
        (adjoint(json!({"final": "z"})), json!({}), "/sensitivities/objective/final", "states"),
        (adjoint(json!({"integral": "floor(3*t)*x"})), json!({}), "/sensitivities/objective/integral", "jumps"),
        (adjoint(json!({"final": "x"})), json!({"stop": [{"when": "x - 0.5"}]}), "/stop/0", "record"),
        (adjoint(json!({"final": "x"})), json!({"sweep": {"over": {"k": [1, 2]}}}), "/sensitivities/mode", "forward"),
    ];
    for (asked, more, pointer, told) in cases {
        let (found, code, text) = refused(asked.clone(), more);
        assert_eq!(found, pointer, "{asked} {code} {text}");
        assert!(text.contains(told), "{asked}: {text}");
    }
    // Rigid bodies, here a sphere, are time-stepped, and adjoint mode needs Radau IIA steps.
    let spheres = json!({"problem": {"rigid_bodies": {"gravity": [0, 0, -9.81], "bodies": [
        {"name": "ball", "shape": {"sphere": {"radius": 0.1}}, "mass": 1, "position": [0, 0, 1]}]}}, "time": {"end": 1},
        "sensitivities": adjoint(json!({"final": "ball.z"}))});
    let errors = Specification::from_json(spheres.to_string().as_bytes()).expect_err("errors");
    assert!(errors.iter().any(|error| error.pointer.starts_with("/sensitivities")), "{errors:#?}");
}

#[test]
fn a_gradient_that_cancels_is_not_doubted() {
    // Two uncoupled bodies fall on the floor and lie there: their heights are zero, whatever the weight that the
    // floor bears.
    let falls = |name: &str| json!({"name": name, "gap": name, "restitution": 0.3});
    let rest = json!({"mechanical": {"parameters": {"m": 2.1, "n": 0.7, "g": 9.80665, "h": 0.4},
        "coordinates": {"x": {"initial": "h"}, "y": {"initial": 0}}, "mass": [["m", 0], [0, "n"]],
        "potential": "(m*x + n*y)*g", "contacts": [falls("x"), falls("y")]}});
    for (of, to) in
        [("y", &["n", "g"][..]), ("y", &["m", "n", "g", "h"]), ("x", &["m", "n", "g", "h"]), ("y_dot", &["g"])]
    {
        let solution = gradient(&rest, 3.0, to, &json!({"final": of}));
        for (name, slope) in &solution.gradient {
            assert!(slope.abs() < 1e-9, "d{of}/d{name} = {slope:e}");
        }
    }
    // The state x slides at zero whatever its drive a b, and the rate of the state y is x: the final x has the
    // derivative zero.
    let slides = json!({"dvi": {"parameters": {"a": 0.3, "b": 0.7},
        "states": {"x": {"initial": 0.4, "rate": "a*b - z"}, "y": {"initial": 1, "rate": "x"}},
        "variables": {"z": {"inequality": "-x"}}, "set": [{"box": {"of": ["z"], "lower": -1, "upper": 1}}]}});
    let solution = gradient(&slides, 5.0, &["a", "b", "x.initial"], &json!({"final": "x"}));
    assert!(solution.gradient.values().all(|slope| slope.abs() < 1e-9), "{:?}", solution.gradient);
    // The integral of a wave over whole periods, and then differences of two equal states: each has the derivative
    // zero.
    let wave = json!({"dvi": {"parameters": {"p": 1.3}, "states": {"x": {"initial": "p", "rate": "-p*x"},
        "y": {"initial": "p", "rate": "-x*p"}}}});
    for objective in [json!({"integral": "p*cos(2*pi*t)"}), json!({"final": "x - y"}), json!({"integral": "y - x"})] {
        let solution = gradient(&wave, 3.0, &["p"], &objective);
        assert!(solution.gradient["p"].abs() < 1e-9, "{objective} {:?}", solution.gradient);
    }
}

#[test]
fn differences_along_each_parameter_are_counted() {
    // A step of the forcing whose time is the sum of many parameters: the adjoint needs one finite difference for each
    // of them.
    let breaks = |count: usize| {
        let names: Vec<String> = (0..count).map(|k| format!("p{k}")).collect();
        let mut parameters = json!({});
        names.iter().for_each(|name| parameters[name] = json!(0.25));
        let problem = json!({"dvi": {"parameters": parameters,
            "states": {"x": {"initial": 0, "rate": format!("heaviside(t - {})", names.join(" - "))}}}});
        let to: Vec<&str> = names.iter().map(String::as_str).collect();
        let solution = gradient(&problem, 4.0, &to, &json!({"final": "x"}));
        names.iter().for_each(|name| assert_near(solution.gradient[name], -1.0, 1e-8, name));
        solution.diagnostics.adjoint.expect("a sweep back").differences
    };
    assert_eq!(breaks(2), 2);
    assert_eq!(breaks(8), 8);
}

/// Returns the gradient of the final `x` by all initial values, with at most `most` bytes for stored steps; then the
/// bytes used and the work of the backward pass.
fn with_memory(specification: &Specification, most: usize) -> (Vec<f64>, usize, AdjointWork) {
    let (model, time, control) =
        (specification.model().dvi().expect("a problem"), specification.time(), Control::new());
    let mut problem = model.problem();
    let (n, settings) = (model.initial.len(), specification.settings());
    let mut radau =
        Radau::new(&mut *problem, settings, time.start, &model.initial, time.end, &control).expect("a start");
    let directions = |initial: DMatrix<f64>| Directions {
        shifted: (0..initial.ncols()).map(|_| None).collect(),
        initial,
        rows: Box::new(|_: f64, _: &[f64], out: &mut DMatrix<f64>| out.fill(0.0)),
        mass: Vec::new(),
        bounds: Vec::new(),
    };
    let mut tangents = Tangents::new(model.problem(), directions(DMatrix::from_element(n, 1, 1.0))).expect("tangents");
    let mut adjoint = Adjoint::new(model.problem(), directions(DMatrix::identity(n, n)), most).expect("an adjoint");
    let mut largest = 0;
    while !radau.is_done() {
        adjoint.prepare(&mut radau, &tangents);
        tangents.advance(&mut radau).expect("a step").expect("derivatives");
        adjoint.store(&mut radau, &tangents).expect("derivatives");
        largest = largest.max(adjoint.bytes());
    }
    let mut by_states = vec![0.0; n];
    by_states[0] = 1.0;
    let end = (radau.t(), radau.y().to_vec());
    let swept = adjoint.sweep((&mut radau, &mut tangents), (&by_states, &vec![0.0; n]), |_| None).expect("a sweep");
    assert_eq!((radau.t(), radau.y().to_vec()), end, "the run ends where it was");
    (swept.gradient, largest, adjoint.work)
}

#[test]
fn steps_that_are_not_kept_are_made_again_and_give_the_same_gradient() {
    // Specification of a block on a moving belt, which sticks and slips.
    let specification = json!({"problem": {"dvi": {"parameters": {"mu": 0.6},
        "states": {"x": {"initial": 0.2, "rate": "v"}, "v": {"initial": 0.1, "rate": "-x - F"}},
        "variables": {"F": {"inequality": "0.5 - v"}}, "set": [{"box": {"of": ["F"], "lower": "-mu", "upper": "mu"}}]}},
        "time": {"end": 40}, "method": {"rtol": 1e-9, "atol": 1e-11}});
    let specification = Specification::from_json(specification.to_string().as_bytes()).expect("a specification");
    let (all, bytes, work) = with_memory(&specification, usize::MAX);
    assert_eq!(work.repeated, 0);
    let most = bytes / 5;
    let (parts, largest, again) = with_memory(&specification, most);
    assert!(largest <= most + most / 4, "{largest} bytes, {most} allowed");
    assert!(again.repeated > again.steps / 2 && again.repeated <= again.steps, "{again:?}");
    for (all, parts) in all.iter().zip(&parts) {
        assert!((all - parts).abs() <= 1e-7 * all.abs().max(1.0), "{all:e} {parts:e}");
    }
}
