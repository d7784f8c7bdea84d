//! Queues and traffic: reflection at zero, and an equilibrium of departures.

use crate::systems::harness::{distance, last, solve};
use crate::systems::reference::example;
use serde_json::json;

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
