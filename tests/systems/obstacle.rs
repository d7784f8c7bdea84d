//! Parabolic obstacle problems with moving free boundaries, compared with tables, benchmark values and closed forms.

use crate::systems::harness::{column, distance, events, last, solve};
use crate::systems::reference::example;
use dvi::problem::Control;
use dvi::solution::{Solution, Status};
use dvi::specification::{EXAMPLES, Specification};
use serde_json::{Value, json};
use std::f64::consts::{FRAC_PI_2, FRAC_PI_4};

/// Returns the value of an output field at an output time `t`.
fn at(solution: &Solution, field: &str, t: f64) -> f64 {
    let k = solution.trajectory.t.iter().position(|&told| (told - t).abs() < 1e-12);
    column(solution, field)[k.unwrap_or_else(|| panic!("no output at t = {t}"))]
}

#[test]
fn the_oxygen_front_follows_the_table() {
    // Reference for the oxygen diffusion problem: position of the front and concentration at the surface from an
    // integral equation, to seven digits (Hansen and Hougaard 1974).
    let table = [
        (0.04, 0.9991799, 0.27432417),
        (0.05, 0.9967929, 0.24768675),
        (0.06, 0.9918022, 0.22360468),
        (0.08, 0.9715500, 0.18084626),
        (0.10, 0.9350172, 0.14317670),
    ];
    let solution = solve(&example("oxygen_diffusion"));
    for (t, front, surface) in table {
        let errors = [at(&solution, "contact_from", t) - front, at(&solution, "surface", t) - surface];
        assert!(errors[0].abs() < 5e-5 && errors[1].abs() < 5e-6, "at t = {t} off by {errors:?}");
    }
    // One unit of oxygen is consumed per unit of time and length where there is oxygen: d total / dt = pressure - 1.
    let (t, total, pressure) = (&solution.trajectory.t, column(&solution, "total"), column(&solution, "pressure"));
    let integral: f64 = (1..t.len()).map(|k| (t[k] - t[k - 1]) * (0.5 * (pressure[k] + pressure[k - 1]) - 1.0)).sum();
    assert!((total[t.len() - 1] - total[0] - integral).abs() < 1e-5, "{total:?} {integral}");
}

#[test]
fn every_example_with_an_obstacle_meets_its_inequality_to_ten_digits() {
    let is_obstacle = |name: &&str| example(name)["problem"].get("obstacle").is_some();
    let names: Vec<&str> = EXAMPLES.iter().map(|example| example.name).filter(is_obstacle).collect();
    assert!(names.len() >= 3, "{names:?}");
    for name in names {
        let solution = solve(&example(name));
        let vi = solution.diagnostics.vi.as_ref().expect("an inequality");
        assert!(vi.solves > 0 && vi.largest_residual <= 1e-10, "{name}: residual {}", vi.largest_residual);
    }
}

#[test]
fn the_american_put_has_its_price_and_its_exercise_boundary() {
    // The reference value 6.0903705 of the option price is from a binomial tree with extrapolation, and from
    // collocation of the integral equation.
    let solution = solve(&example("american_put"));
    let error = last(&solution, "price") - 6.0903705;
    assert!(error.abs() < 1e-4, "off by {error:e}");
    let error = last(&solution, "contact_to").exp() - 80.875057;
    assert!(error.abs() < 1e-2, "boundary off by {error:e}");
}

#[test]
fn a_put_on_a_stock_with_dividends_has_the_price_of_spectral_collocation() {
    // Reference of the option price: Andersen, Lake and Offengenden 2016, with the interest rate r and the dividend
    // yield q both 0.05, and the volatility 0.25.
    let mut put = example("american_put");
    let problem = &mut put["problem"]["obstacle"];
    problem["parameters"]["volatility"] = json!(0.25);
    problem["advection"] = json!("a");
    let error = last(&solve(&put), "price") - 9.5694452989;
    assert!(error.abs() < 1e-4, "off by {error:e}");
}

/// The problem `0 <= u _|_ u_t - u_xx + 1 >= 0` with the solution `u = e^(t-x) - 1 - (t-x)` ahead of a front at `x =
/// t`.
fn travelling_wave(elements: u64) -> Value {
    json!({
        "problem": {"obstacle": {
            "domain": {"x": [0, 2]}, "elements": elements, "diffusion": 1, "source": -1, "obstacle": 0, "initial": 0,
            "boundary": {"x_min": {"dirichlet": "exp(t) - 1 - t"}, "x_max": {"neumann": 0}},
            "probes": {"half": [0.5]}
        }},
        "time": {"end": 1},
        "method": {"rtol": 1e-8}
    })
}

#[test]
fn a_travelling_wave_is_met_at_second_order_in_space() {
    let exact = 0.5_f64.exp() - 1.5;
    let errors = [20, 40, 80].map(|elements| {
        let solution = solve(&travelling_wave(elements));
        let front = last(&solution, "contact_from");
        assert!((front - 1.0).abs() < 4.0 / (elements * elements) as f64, "front at {front} on {elements} elements");
        last(&solution, "half") - exact
    });
    for pair in errors.windows(2) {
        let order = (pair[0] / pair[1]).log2();
        assert!(order > 1.8, "order {order} from {errors:?}");
    }
}

#[test]
fn the_stefan_problem_has_its_similarity_solution() {
    // For 0 <= u _|_ u_t - u_xx + 1 >= 0 with u(0,t) = t, the front is at 2 lambda sqrt t, where lambda e^(lambda^2)
    // erf lambda = 1/sqrt pi.
    let mut problem = travelling_wave(400);
    problem["problem"]["obstacle"]["boundary"]["x_min"]["dirichlet"] = json!("t");
    let solution = solve(&problem);
    let errors = [last(&solution, "half") - 0.3203659436888525, last(&solution, "contact_from") - 1.240125266627191];
    assert!(errors[0].abs() < 1e-5 && errors[1].abs() < 1e-4, "off by {errors:?}");
}

#[test]
fn a_string_comes_to_rest_on_a_parabola() {
    // An elastic string is straight from its ends, and touches the obstacle 1/4 - x^2 tangentially at |x| = 1 -
    // sqrt(3)/2.
    let solution = solve(&json!({
        "problem": {"obstacle": {
            "domain": {"x": [-1, 1]}, "elements": 150, "diffusion": 1, "obstacle": "1/4 - x^2", "initial": "1 - x^2",
            "boundary": {"x_min": {"dirichlet": 0}, "x_max": {"dirichlet": 0}},
            "probes": {"beside": [0.5]}
        }},
        "time": {"end": 20}
    }));
    let edge = 1.0 - 0.75_f64.sqrt();
    let errors = [
        last(&solution, "beside") - 0.5 * 2.0 * edge,
        last(&solution, "contact_to") - edge,
        last(&solution, "contact_from") + edge,
        last(&solution, "pressure") - 4.0 * edge,
    ];
    assert!(errors.iter().all(|error| error.abs() < 1e-4), "off by {errors:?}");
    let began: Vec<_> = solution.trajectory.events.iter().map(|event| (event.of.as_str(), event.t > 0.0)).collect();
    assert_eq!(began, [("contact", true)]);
}

#[test]
fn a_string_pressed_between_two_walls_leaves_them_tangentially() {
    // A string with u'' = -f between obstacles at -1 and 1: contact begins at the distance sqrt(2/f) = 1/4 from the
    // zeros of u at -1, 0 and 1.
    let solution = solve(&json!({
        "problem": {"obstacle": {
            "domain": {"x": [-1, 1]}, "elements": 202, "diffusion": 1, "source": "32*sign(x)", "initial": 0,
            "obstacle": -1, "upper_obstacle": 1,
            "boundary": {"x_min": {"dirichlet": 0}, "x_max": {"dirichlet": 0}},
            "probes": {"left": [-0.5], "between": [0.125], "right": [0.5]}
        }},
        "time": {"end": 10}
    }));
    let errors = [
        last(&solution, "left") + 1.0,
        last(&solution, "right") - 1.0,
        last(&solution, "between") - 0.75,
        last(&solution, "contact_from") + 0.75,
        last(&solution, "contact_to") - 0.75,
        last(&solution, "contact") - 1.0,
        last(&solution, "pressure"),
        last(&solution, "total"),
    ];
    assert!(errors.iter().all(|error| error.abs() < 5e-4), "off by {errors:?}");
}

#[test]
fn an_obstacle_above_mirrors_one_below() {
    let above = json!({
        "problem": {"obstacle": {
            "domain": {"x": [0, 1], "y": [0, 2]}, "elements": {"x": 12, "y": 20}, "diffusion": {"x": 1, "y": "1 + x"},
            "advection": {"x": 2, "y": "-y"}, "reaction": "t", "source": "3*x", "initial": 0,
            "upper_obstacle": "0.1 + 0.05*cos(6*t)*y", "boundary": {"x_min": {"dirichlet": "-t"}, "y_max": {"neumann": 0.2}},
            "probes": {"p": [0.7, 1.3]}
        }},
        "time": {"end": 1}
    });
    let mut below = above.clone();
    let problem = &mut below["problem"]["obstacle"];
    problem.as_object_mut().and_then(|problem| problem.remove("upper_obstacle"));
    problem["obstacle"] = json!("-0.1 - 0.05*cos(6*t)*y");
    problem["source"] = json!("-3*x");
    problem["boundary"] = json!({"x_min": {"dirichlet": "t"}, "y_max": {"neumann": -0.2}});
    let (above, below) = (solve(&above), solve(&below));
    assert!(column(&above, "contact").iter().any(|area| *area > 0.1), "nothing rests on it");
    for (field, sign) in [("p", -1.0), ("total", -1.0), ("pressure", -1.0), ("contact", 1.0)] {
        for (a, b) in column(&above, field).iter().zip(column(&below, field)) {
            assert!((a - sign * b).abs() < 1e-10, "{field}: {a} and {b}");
        }
    }
    assert!(column(&above, "pressure").iter().all(|pressure| *pressure <= 0.0), "it pulls");
}

/// A quarter of a membrane of radius 2 over a hemispherical obstacle of radius 1, computed on a square inside it.
fn hemisphere(elements: u64, mass: &str) -> Value {
    json!({
        "problem": {"obstacle": {
            "parameters": {"a": 0.6979651482233735, "k": "a^2/sqrt(1 - a^2)"},
            "domain": {"x": [0, 1.4], "y": [0, 1.4]}, "elements": elements, "diffusion": 1,
            "obstacle": "sqrt(max(1 - x^2 - y^2, 0))", "initial": 1.5, "mass": mass,
            "boundary": {"x_max": {"dirichlet": "k*ln(2/sqrt(x^2 + y^2))"}, "y_max": {"dirichlet": "k*ln(2/sqrt(x^2 + y^2))"}},
            "probes": {"one": [0.6, 0.8], "other": [1, 0]}
        }},
        "time": {"end": 8},
        "method": {"rtol": 1e-4}
    })
}

#[test]
fn a_membrane_comes_to_rest_on_a_hemisphere_at_second_order_in_space() {
    // The membrane at rest is u = sqrt(1 - r^2) up to the radius r = a of the contact, then a^2/sqrt(1 - a^2) ln(2/r),
    // with a^2 (1 - ln(a/2)) = 1.
    for mass in ["lumped", "consistent"] {
        let errors = [14, 28, 56].map(|elements| {
            let solution = solve(&hemisphere(elements, mass));
            // The area of contact between membrane and hemisphere is accurate to a third of an element along its
            // boundary.
            let (a, h) = (0.6979651482233735, 1.4 / elements as f64);
            let error = last(&solution, "contact") - FRAC_PI_4 * a * a;
            assert!(error.abs() < FRAC_PI_2 * a * h / 3.0, "{mass}: area off by {error:e} on {elements}");
            (last(&solution, "one") - 0.4715198934021101)
                .abs()
                .max((last(&solution, "other") - 0.4715198934021101).abs())
        });
        let order = (errors[0] / errors[2]).log2() / 2.0;
        assert!(order > 1.7 && errors[2] < 2e-4, "{mass}: order {order} from {errors:?}");
    }
}

#[test]
fn a_travelling_layer_stays_between_its_ends_on_a_grid_that_does_not_resolve_it() {
    // The equation u_t = u_xx/10 - 100 u_x forms a boundary layer of width 1/1000 at the right end, on elements of
    // size 1/20.
    let mut solution = solve(&json!({
        "problem": {"obstacle": {
            "domain": {"x": [0, 1]}, "elements": 20, "diffusion": 0.1, "advection": 100, "initial": 0,
            "boundary": {"x_min": {"dirichlet": 1}, "x_max": {"dirichlet": 0}},
            "probes": {"last": [0.95], "first": [0.05]}
        }},
        "time": {"end": 1}
    }));
    // The discrete steady solution of the boundary layer is exact at the nodes: (e^(1000 x) - e^1000) / (1 - e^1000).
    for probe in ["first", "last"] {
        assert!((last(&solution, probe) - 1.0).abs() < 1e-6, "{probe}: {}", last(&solution, probe));
        assert!(column(&solution, probe).iter().all(|u| (-1e-3..1.001).contains(u)), "{probe} overshoots");
    }
    let warning = solution.diagnostics.warnings.pop().expect("a warning");
    assert_eq!(warning.code, "unresolved_layers");
    assert!(solution.diagnostics.vi.is_none(), "there is no obstacle");
}

#[test]
fn a_run_that_is_cancelled_before_its_first_step_is_stopped_and_has_not_failed() {
    let specification = Specification::from_json(hemisphere(14, "lumped").to_string().as_bytes()).expect("a membrane");
    let control = Control::new();
    control.cancel();
    let solution = dvi::solve(&specification, &control);
    assert_eq!(solution.status, Status::Stopped, "{:?}", solution.error);
    assert_eq!(solution.error.map(|failure| failure.code.into_owned()).as_deref(), Some("cancelled"));
}

#[test]
fn in_three_dimensions_a_product_of_cosines_decays_as_it_should() {
    // Solution of the heat equation without flux through the sides: u = e^(-3 pi^2 t) cos(pi x) cos(pi y) cos(pi z).
    // The obstacle is never reached.
    let errors = [6, 12].map(|elements| {
        let solution = solve(&json!({
            "problem": {"obstacle": {
                "domain": {"x": [0, 1], "y": [0, 1], "z": [0, 1]}, "elements": elements, "diffusion": 1, "obstacle": -2,
                "initial": "cos(pi*x)*cos(pi*y)*cos(pi*z)", "probes": {"corner": [0, 0, 0]}
            }},
            "time": {"end": 0.05},
            "output": {"times": "steps"}
        }));
        assert!(column(&solution, "contact").iter().all(|area| *area == 0.0));
        last(&solution, "corner") - (-0.15 * std::f64::consts::PI.powi(2)).exp()
    });
    let order = (errors[0] / errors[1]).log2();
    assert!((order - 2.0).abs() < 0.2, "order {order} from {errors:?}");
}

/// The solution `u = 1/2 - t/4 + cos(pi x) exp(-pi^2 t) / 8` sinks onto the obstacle `-1/2` after the cosine has
/// decayed: contact begins at `t = 4`, independently of where the steps end.
#[test]
fn what_sinks_onto_an_obstacle_as_a_whole_is_on_its_way_until_it_is_there() {
    for (rtol, end) in [(1e-4, 5.0), (1e-6, 7.0), (1e-6, 40.0), (1e-8, 13.0)] {
        let times: Vec<f64> = (0..60).map(|k| end * f64::from(k) / 59.0).collect();
        let solution = solve(&json!({
            "problem": {"obstacle": {
                "domain": {"x": [0, 1]}, "elements": 32, "boundary": {}, "diffusion": 1,
                "initial": "0.5 + 0.125*cos(pi*x)", "source": -0.25, "obstacle": -0.5, "probes": {"middle": [0.5]},
            }},
            "time": {"end": end}, "output": {"times": times}, "method": {"rtol": rtol},
        }));
        for name in ["middle", "total"] {
            let error = distance(&solution, name, |t| (0.5 - 0.25 * t).max(-0.5));
            assert!(error < 1e-9, "{name} off by {error:e} at {rtol:e} until {end}");
        }
        let arrivals = events(&solution, "contact");
        assert!(arrivals.len() == 1 && (arrivals[0] - 4.0).abs() < 10.0 * rtol, "{arrivals:?} at {rtol:e} until {end}");
    }
}

/// The solution does not depend on the position: `u` falls by 1/2 per unit of time unless the obstacle `sin t` pushes
/// it up. Between contacts `u` is linear in time, so that its error estimate is zero.
#[test]
fn an_obstacle_that_moves_is_not_stepped_over() {
    let specification = json!({
        "problem": {"obstacle": {
            "domain": {"x": [0, 1]}, "elements": 10, "diffusion": 1, "probes": {"p": [0.3]},
            "source": -0.5, "obstacle": "sin(t)", "initial": 0.5
        }},
        "time": {"end": 14}, "output": {"times": {"count": 141}}
    });
    let solution = solve(&specification);
    let (fine, mut u, mut worst) = (10_000, 0.5_f64, 0.0_f64);
    for row in 1..141_i32 {
        for part in 1..=fine {
            let t = 0.1 * (f64::from(row - 1) + f64::from(part) / f64::from(fine));
            u = (u - 0.05 / f64::from(fine)).max(t.sin());
        }
        worst = worst.max((column(&solution, "p")[row as usize] - u).abs());
    }
    assert!(worst < 1e-3, "off by {worst:e}");
}

/// An obstacle problem on the unit interval without flux through its ends, with the members `data`, up to the time
/// `end`.
fn slab(data: &Value, end: f64, rtol: f64) -> Value {
    let mut problem =
        json!({"domain": {"x": [0, 1]}, "elements": 20, "diffusion": 1, "initial": 1, "probes": {"p": [0]}});
    let data = data.as_object().expect("data").clone();
    problem.as_object_mut().expect("a problem").extend(data);
    json!({
        "problem": {"obstacle": problem}, "time": {"end": end}, "output": {"times": {"count": 101}}, "method": {"rtol": rtol}
    })
}

/// The integral from 0 to `t` of the Gaussian `exp(-((t - 50)/width)^2)`, for times well before or after its maximum.
fn bump(t: f64, width: f64) -> f64 {
    if t > 50.0 { std::f64::consts::PI.sqrt() * width } else { 0.0 }
}

#[test]
fn a_bump_of_a_coefficient_between_the_stages_of_a_long_step_is_seen() {
    for (width, rtol) in [(1.0, 1e-5), (1.0, 1e-7), (0.1, 1e-5), (0.1, 1e-7)] {
        let solution = solve(&slab(&json!({"reaction": format!("exp(-((t-50)/{width})^2)")}), 100.0, rtol));
        let error = last(&solution, "p") - (-bump(100.0, width)).exp();
        assert!(error.abs() < 100.0 * rtol, "reaction of width {width} at {rtol:e} off by {error:e}");
        // On a grid of n elements, the solution cos(pi x) of the heat equation decays at the rate (2 n sin(pi / (2
        // n)))^2, times the diffusion coefficient.
        let data = json!({"diffusion": format!("1e-4 + exp(-((t-50)/{width})^2)"), "initial": "cos(pi*x)"});
        let solution = solve(&slab(&data, 100.0, rtol));
        let rate = (40.0 * (std::f64::consts::PI / 40.0).sin()).powi(2);
        let error = last(&solution, "p") - (-rate * (0.01 + bump(100.0, width))).exp();
        assert!(error.abs() < 100.0 * rtol, "diffusion of width {width} at {rtol:e} off by {error:e}");
    }
}

#[test]
fn a_pulse_of_the_source_between_the_stages_of_a_long_step_is_seen() {
    let data = json!({"source": "1000*exp(-((t-50)/0.001)^2)"});
    let solution = solve(&slab(&data, 100.0, 1e-7));
    let error = last(&solution, "p") - 1.0 - 1000.0 * bump(100.0, 1e-3);
    assert!(error.abs() < 1e-5, "off by {error:e}");
}

#[test]
fn a_bump_of_a_bound_between_the_stages_of_a_long_step_pushes() {
    for (key, bound, level) in
        [("obstacle", "-1 + 3*exp(-((t-50)/0.1)^2)", 2.0), ("upper_obstacle", "5 - 4.5*exp(-((t-50)/0.1)^2)", 0.5)]
    {
        let solution = solve(&slab(&json!({key: bound}), 100.0, 1e-7));
        let error = last(&solution, "p") - level;
        assert!(error.abs() < 1e-6, "{key} off by {error:e}");
    }
}

#[test]
fn jumps_of_data_end_steps() {
    // The reaction coefficient 10^4 during 10^-4 multiplies u by 1/e.
    let solution = solve(&slab(&json!({"reaction": "1e4*pulse(t, 1.2345, 1e-4)"}), 4.0, 1e-7));
    let error = distance(&solution, "p", |t| if t < 1.2345 { 1.0 } else { (-1.0_f64).exp() });
    assert!(error < 1e-5, "off by {error:e}");
    // An obstacle that appears lifts the solution below it, which stays there when the obstacle vanishes.
    let data = json!({"initial": 0, "obstacle": "if(t < 1, -1, if(t < 2, 0.5, -1))"});
    let solution = solve(&slab(&data, 4.0, 1e-7));
    let error = distance(&solution, "p", |t| if t < 1.0 { 0.0 } else { 0.5 });
    assert!(error < 1e-7, "off by {error:e}");
    let changes = events(&solution, "contact");
    assert!(changes.len() == 2 && (changes[0] - 1.0).abs() < 1e-12 && (changes[1] - 2.0).abs() < 1e-12, "{changes:?}");
}

#[test]
fn contact_begins_and_ends_when_the_load_says_so() {
    // The solution u = 1 + t^2/2 - 2 t touches the obstacle at 2 - sqrt 2, and the load t - 2 lifts it off at t = 2.
    let solution = solve(&slab(&json!({"source": "t - 2", "obstacle": 0}), 4.0, 1e-7));
    let changes = events(&solution, "contact");
    let touch = 2.0 - 2.0_f64.sqrt();
    assert!(changes.len() == 2, "{changes:?}");
    assert!((changes[0] - touch).abs() < 1e-6 && (changes[1] - 2.0).abs() < 1e-6, "{changes:?}");
    let error = distance(&solution, "p", |t| match t {
        t if t < touch => 1.0 + 0.5 * t * t - 2.0 * t,
        t if t < 2.0 => 0.0,
        t => 0.5 * (t - 2.0).powi(2),
    });
    assert!(error < 1e-6, "off by {error:e}");
}
