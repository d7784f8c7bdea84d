//! Queues and traffic: reflection at zero, and an equilibrium of departure times.

use crate::systems::harness::{column, distance, last, solve};
use crate::systems::reference::example;
use serde_json::json;
use std::f64::consts::{FRAC_PI_2, FRAC_PI_4};

#[test]
fn two_queues_in_tandem_follow_the_reflection_map() {
    let solution = solve(&example("fluid_queue"));
    let error = distance(&solution, "q1", |t| (3.0 - 0.5 * t).max(0.0));
    assert!(error < 1e-9, "q1 is off by {error:e}");
    // The second queue grows at the rate 0.8 while the first is busy, and then at the rate 0.3, since arrivals pass
    // through the first queue.
    let error = distance(&solution, "q2", |t| 0.8 * t.min(6.0) + 0.3 * (t - 6.0).max(0.0));
    assert!(error < 1e-9, "q2 is off by {error:e}");
    assert!((last(&solution, "idle1") - 0.5).abs() < 1e-9);
    assert!(last(&solution, "idle2").abs() < 1e-12);
}

#[test]
fn a_free_price_that_only_bounded_variables_determine_clears_a_market() {
    // The market clears at the inflow h = 10, so that the stock q grows at the rate 6, and the price is p = 1 + q/4.
    let market = json!({"problem": {"dvi": {
        "states": {"q": {"initial": 5, "rate": "h - 4"}},
        "variables": {"h": {"inequality": "1 + q/4 - p"}, "p": {"inequality": "h - 10"}},
        "set": [{"nonnegative": ["h"]}, {"free": ["p"]}]}},
        "time": {"end": 1}});
    let solution = solve(&market);
    assert!((last(&solution, "q") - 11.0).abs() < 1e-9 && (last(&solution, "p") - 3.75).abs() < 1e-9);
    // The variables are the projection of (sin t, cos t) onto the unit simplex by a multiplier p: the first one is u
    // = (1 + sin t - cos t)/2 until pi/2, then 1.
    let simplex = json!({"problem": {"dvi": {
        "states": {"x": {"initial": 0, "rate": "u"}},
        "variables": {
            "u": {"inequality": "u - sin(t) - p"}, "w": {"inequality": "w - cos(t) - p"},
            "p": {"inequality": "u + w - 1"}
        },
        "set": [{"nonnegative": ["u", "w"]}, {"free": ["p"]}]}},
        "time": {"end": 3}, "method": {"rtol": 1e-9}});
    let solution = solve(&simplex);
    let exact = |t: f64| if t < FRAC_PI_2 { 0.5 * (t + 1.0 - t.cos() - t.sin()) } else { t - FRAC_PI_4 };
    let error = distance(&solution, "x", exact);
    assert!(error < 1e-6, "x is off by {error:e}");
    assert!((last(&solution, "x") - exact(3.0)).abs() < 1e-9);
}

#[test]
fn commuters_leave_as_vickrey_says() {
    // Reference for the equilibrium of departure times: Arnott, de Palma, Lindsey 1990, with N = 6000, s = 3000, alpha
    // = 6.4, beta = 3.9, gamma = 15.21, t* = 9.
    let (first, last_arrival, on_time) = (7.408_163_265_306_122, 9.408_163_265_306_122, 8.029_974_489_795_919);
    let (early, late) = (7680.0, 888.477_556_866_719);
    let solution = solve(&example("bottleneck"));
    let departed = |t: f64| early * (t.min(on_time) - first).max(0.0) + late * (t.min(last_arrival) - on_time).max(0.0);
    let error = distance(&solution, "departed", departed);
    assert!(error < 1e-4, "departures are off by {error:e} of 6000");
    let arrived = |t: f64| 3000.0 * (t.min(last_arrival) - first).max(0.0);
    let error = distance(&solution, "arrived", arrived);
    assert!(error < 1e-4, "arrivals are off by {error:e} of 6000");
    let error = distance(&solution, "queue", |t| departed(t) - arrived(t));
    assert!(error < 1e-4, "the queue is off by {error:e}");
    let nearest = |exact: f64| {
        solution.trajectory.events.iter().map(|event| (event.t - exact).abs()).fold(f64::INFINITY, f64::min)
    };
    for exact in [first, on_time, last_arrival] {
        assert!(nearest(exact) < 1e-8, "no switch within {:e} of {exact}", nearest(exact));
    }
}

#[test]
fn all_commuters_arrive_where_newtons_method_steps_over_the_switches() {
    let mut specification = example("bottleneck");
    for exponent in [5, 6, 7, 8, 9] {
        let rtol = 10.0_f64.powi(-exponent);
        specification["method"] = json!({"rtol": rtol, "switches": "step_over", "vi_solver": "semismooth_newton"});
        let solution = solve(&specification);
        for name in ["departed", "arrived"] {
            let error = (last(&solution, name) - 6000.0).abs();
            assert!(error < 100.0 * rtol * 6000.0, "rtol {rtol:e}: {error:e} of 6000 have not {name}");
        }
    }
}

/// Wardrop's equilibrium on twenty routes, with indexed variables: the flow on a route is `k (c - f)^(1/3)` if the
/// least cost `c` is above its free cost `f`, else zero, and all flows add up to the demand. The reference finds `c`
/// by bisection.
#[test]
fn twenty_routes_carry_what_their_least_cost_says() {
    let specification = json!({
        "problem": {"dvi": {
            "parameters": {"n": 20, "free[1..n]": "10 + i", "capacity[1..n]": "50 + 10*mod(7*i, 20)"},
            "states": {"trips": {"initial": 0, "rate": "sum(h)"}},
            "definitions": {"demand": "1000 + 500*sin(t)", "cost[1..n]": "free[i] + (h[i]/capacity[i])^3"},
            "variables": {
                "h[1..n]": {"inequality": "cost[i] - least"}, "least": {"inequality": "sum(h) - demand"}
            },
            "set": [{"nonnegative": ["h[1..n]"]}, {"free": ["least"]}]
        }},
        "time": {"end": 6}, "method": {"rtol": 1e-9}, "output": {"times": {"count": 13}}
    });
    let solution = solve(&specification);
    for (k, t) in solution.trajectory.t.iter().enumerate() {
        let flow = |least: f64, i: i32| {
            let capacity = 50.0 + 10.0 * f64::from(7 * i % 20);
            capacity * (least - 10.0 - f64::from(i)).max(0.0).cbrt()
        };
        let all = |least: f64| (1..=20).map(|i| flow(least, i)).sum::<f64>();
        let (mut below, mut above) = (0.0, 1e3);
        for _ in 0..200 {
            let middle = 0.5 * (below + above);
            if all(middle) < 1000.0 + 500.0 * t.sin() { below = middle } else { above = middle }
        }
        assert!((column(&solution, "least")[k] - below).abs() < 1e-8, "{} {below}", column(&solution, "least")[k]);
        for i in 1..=20 {
            let found = column(&solution, &format!("h[{i}]"))[k];
            // The flow on a route is the cube root of the excess of its cost over the free cost, and so is the error of
            // the flow where that excess is small.
            let bound = 120.0 * 1e-8_f64.cbrt().min(1e-8 / (below - 10.0 - f64::from(i)).max(1e-8)) + 1e-6;
            assert!((found - flow(below, i)).abs() < bound, "t = {t}, route {i}: {found} {}", flow(below, i));
        }
    }
    assert!((last(&solution, "trips") - (6000.0 + 500.0 * (1.0 - 6.0_f64.cos()))).abs() < 1e-6);
}
