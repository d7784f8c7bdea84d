//! Switches that accumulate in finite time, after Stewart's spirals: `w' = M z + q`, `0 <= z`, `0 <= w`,
//! complementary, with the circulant matrix `M` of first row `(1, a, 0)` and `q = -(1, 1, 1)`. In each phase, the
//! positive component of `w` falls to zero while the next one grows; sizes and durations of successive phases have
//! the ratio `a - 1`.

use crate::stability::harness::{Case, column, instants, last};
use serde_json::{Value, json};

fn spiral(a: f64, initial: [f64; 3], end: f64, method: Value) -> Case {
    let case = Case::until(end)
        .state("w1", initial[0], &format!("z1 + {a}*z2 - 1"))
        .state("w2", initial[1], &format!("z2 + {a}*z3 - 1"))
        .state("w3", initial[2], &format!("z3 + {a}*z1 - 1"));
    case.nonnegative("z1", "w1").nonnegative("z2", "w2").nonnegative("z3", "w3").method(method)
}

#[test]
fn the_spiral_that_grows_is_not_left_for_its_centre_nor_entered_from_it() {
    // From the start w = 0 exactly, the numerical solution of the spiral stays at w = 0 with z = 1/4.
    let solution = spiral(3.0, [0.0; 3], 10.0, json!({})).times(json!({"count": 11})).solve();
    for k in 1..=3 {
        assert!(column(&solution, &format!("w{k}")).iter().all(|w| w.abs() < 1e-12));
        assert!(column(&solution, &format!("z{k}")).iter().all(|z| (z - 0.25).abs() < 1e-12));
    }
    assert_eq!(solution.diagnostics.switches, 0);
    // With the perturbed start w2 = 1e-6, the k-th phase of the spiral ends at t = 1e-6 (2^k - 1).
    for tolerance in [1e-6, 1e-10] {
        let method = json!({"rtol": tolerance, "atol": 1e-3 * tolerance});
        let solution = spiral(3.0, [0.0, 1e-6, 0.0], 1.5, method).solve();
        let times = instants(&solution);
        assert_eq!(times.len(), 20, "{times:?}");
        for (k, t) in times.iter().enumerate() {
            let exact = 1e-6 * (f64::powi(2.0, k as i32 + 1) - 1.0);
            assert!((t / exact - 1.0).abs() < 1e-7, "phase {k} ends at {t}, not {exact}");
        }
        assert!((last(&solution, "z3") - 1.0).abs() < 1e-9);
    }
}

#[test]
fn the_spiral_that_shrinks_is_passed_through_its_accumulation_point() {
    // With a = 3/2, phases of the spiral of duration 1, 1/2, 1/4, .. end at t = 2, after which w = 0 and z = 1/(1 +
    // a).
    for method in [json!({}), json!({"rtol": 1e-10}), json!({"vi_solver": "semismooth_newton"})] {
        let case = spiral(1.5, [0.0, 1.0, 0.0], 4.0, method).times(json!([0.5, 1.25, 2, 3, 4]));
        let solution = case.solve();
        let (first, second) = (column(&solution, "w1"), column(&solution, "w2"));
        assert!((second[0] - 0.5).abs() < 1e-9 && (first[1] - 0.125).abs() < 1e-9);
        for name in ["w1", "w2", "w3"] {
            assert!(column(&solution, name)[2..].iter().all(|w| w.abs() < 1e-6), "{:?}", column(&solution, name));
        }
        for name in ["z1", "z2", "z3"] {
            assert!((last(&solution, name) - 0.4).abs() < 1e-9);
        }
        let times = instants(&solution);
        for (k, t) in times.iter().take(8).enumerate() {
            let exact = 2.0 - f64::powi(0.5, k as i32);
            assert!((t - exact).abs() < 1e-9, "phase {k} ends at {t}, not {exact}");
        }
        assert!(times.len() < 100 && solution.diagnostics.steps.accepted < 300);
        assert!(solution.diagnostics.warnings.iter().any(|warning| warning.code == "switches_accumulate"));
    }
}

#[test]
fn the_twisting_controller_stops_in_finite_time() {
    // x'' = -2 sgn x - sgn x'. From the distance x, the state falls to zero within sqrt(2x), brakes for a third of
    // that time, and turns at the distance x/3 on the other side: the half turns form a geometric series that ends
    // before t = 10.
    let case = Case::until(20.0).state("x", 1.0, "v").state("v", 0.0, "-2*s - r");
    let case = case.between("s", "-x", "-1", "1").between("r", "-v", "-1", "1");
    let solution = case.times(json!([10, 20])).solve();
    for name in ["x", "v"] {
        assert!(column(&solution, name).iter().all(|value| value.abs() < 1e-6), "{:?}", column(&solution, name));
    }
    let (mut turn, mut fall) = (0.0, 2.0_f64.sqrt());
    for pair in instants(&solution).chunks_exact(2).take(4) {
        assert!((pair[0] - (turn + fall)).abs() < 1e-7, "{pair:?}: not at {}", turn + fall);
        turn += fall * 4.0 / 3.0;
        assert!((pair[1] - turn).abs() < 1e-7, "{pair:?}: not at {turn}");
        fall /= 3.0_f64.sqrt();
    }
    // At rest the forces of the two relays s and r cancel.
    assert!((2.0 * last(&solution, "s") + last(&solution, "r")).abs() < 1e-9);
    assert!(solution.diagnostics.steps.accepted < 1000);
}
