//! Queues and traffic: reflection at zero, and an equilibrium of departures.

use crate::systems::harness::{distance, last, solve};
use crate::systems::reference::example;
use serde_json::json;
use std::f64::consts::{FRAC_PI_2, FRAC_PI_4};

#[test]
fn two_queues_in_tandem_follow_the_reflection_map() {
    let solution = solve(&example("fluid_queue"));
    let error = distance(&solution, "q1", |t| (3.0 - 0.5 * t).max(0.0));
    assert!(error < 1e-9, "q1 is off by {error:e}");
    // 0.8 t while the first is busy, then arrivals pass through it.
    let error = distance(&solution, "q2", |t| 0.8 * t.min(6.0) + 0.3 * (t - 6.0).max(0.0));
    assert!(error < 1e-9, "q2 is off by {error:e}");
    assert!((last(&solution, "idle1") - 0.5).abs() < 1e-9);
    assert!(last(&solution, "idle2").abs() < 1e-12);
}

#[test]
fn a_free_price_that_only_bounded_variables_determine_clears_a_market() {
    // h = 10 clears it, so that q' = 6 and p = 1 + q/4.
    let market = json!({"problem": {"dvi": {
        "states": {"q": {"initial": 5, "rate": "h - 4"}},
        "variables": {"h": {"inequality": "1 + q/4 - p"}, "p": {"inequality": "h - 10"}},
        "set": [{"nonnegative": ["h"]}, {"free": ["p"]}]}},
        "time": {"end": 1}});
    let solution = solve(&market);
    assert!((last(&solution, "q") - 11.0).abs() < 1e-9 && (last(&solution, "p") - 3.75).abs() < 1e-9);
    // Nearest to (sin t, cos t) in the unit simplex, by its multiplier: u = (1 + sin t - cos t)/2 until pi/2, then 1.
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
    // Arnott, de Palma, Lindsey 1990, with N = 6000, s = 3000, alpha = 6.4, beta = 3.9, gamma = 15.21, t* = 9.
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
