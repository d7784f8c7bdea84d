//! Impacts by time stepping, whose results converge with first order through any number of impacts.

use super::{ball, stepped};
use crate::systems::harness::{column, last, solve};
use crate::systems::reference::example;
use dvi::problem::Control;
use dvi::specification::Specification;
use serde_json::{Value, json};

#[test]
fn a_ball_comes_to_rest_after_infinitely_many_bounces() {
    let zeno = 1.354_570_922_957_192_7;
    let solution = stepped(ball(0.5), 2.0, 1e-3);
    let (t, y, v) = (&solution.trajectory.t, column(&solution, "y"), column(&solution, "y_dot"));
    let rested = (0..t.len()).find(|&i| y[i..].iter().chain(&v[i..]).all(|x| x.abs() < 1e-10)).expect("it rests");
    // The tolerance of the time of rest covers an error of first order in the step size, and the steps in which the
    // remaining motion halves until it is below rounding.
    assert!((t[rested] - zeno).abs() < 0.1, "{}", t[rested]);
    assert!(y.iter().all(|y| *y > -1e-12), "the floor is passed");
    let energy = solution.diagnostics.energy.unwrap();
    assert!((energy.lost_in_impacts - 9.81).abs() < 0.05);
    assert!(energy.largest_gain_in_impacts < 1e-12);
}

#[test]
fn time_stepping_is_of_first_order_through_impacts() {
    // At t = 1 the ball has bounced twice: its height is y = v2 s - g s^2/2 with s = t - t2, the time since the
    // second bounce.
    let (t2, v2, g) = (0.903_047_281_971_461_8, 1.107_361_729_517_505_1, 9.81);
    let s: f64 = 1.0 - t2;
    let exact = v2 / 1.0 * s - 0.5 * g * s * s;
    let errors: Vec<f64> = (0..8)
        .map(|i| {
            let h = 1e-3 / (1.0 + 0.37 * f64::from(i));
            (last(&stepped(ball(0.5), 1.0, h), "y") - exact).abs() / h
        })
        .collect();
    assert!(errors.iter().all(|error| *error < 20.0), "{errors:?}");
    let fine = (last(&stepped(ball(0.5), 1.0, 1e-5), "y") - exact).abs();
    assert!(fine < 20.0 * 1e-5, "{fine:e}");
}

#[test]
fn a_cradle_shares_the_blow_or_hands_it_on_as_the_law_says() {
    let row = |law: &str| {
        let mut problem = example("newton_cradle");
        let mechanical = &mut problem["problem"]["mechanical"];
        mechanical["potential"] = json!(0);
        mechanical["coordinates"]["x1"] = json!({"initial": -1e-3, "velocity": 1});
        problem["method"] = json!({"step": 1e-2, "impact_law": law});
        problem["time"] = json!({"end": 0.05});
        let solution = solve(&problem);
        (1..=5).map(|i| last(&solution, &format!("x{i}_dot"))).collect::<Vec<f64>>()
    };
    for (law, expected) in [("simultaneous", [-0.6, 0.4, 0.4, 0.4, 0.4]), ("sequential", [0.0, 0.0, 0.0, 0.0, 1.0])] {
        for (v, expected) in row(law).iter().zip(expected) {
            assert!((v - expected).abs() < 1e-12, "{law}: {:?}", row(law));
        }
    }
}

#[test]
fn an_oblique_impact_slips_or_rolls_by_coulombs_impulse() {
    let strike = |v_t: f64| -> Value {
        json!({"parameters": {"R": 0.1},
               "coordinates": {"x": {"initial": 0, "velocity": v_t}, "y": {"initial": "R", "velocity": -3},
                               "spin": {"initial": 0}},
               "mass": [["0.4*R^2", 0, 0], [0, 1, 0], [0, 0, 1]],
               "contacts": [{"name": "floor", "gap": "y - R", "restitution": 0.8,
                             "friction": {"coefficient": 0.2, "slip": ["x_dot - R*spin_dot"]}}]})
    };
    for (v_t, after, spin) in [(4.0, 2.92, 27.0), (1.0, 0.714_285_714_285_714_3, 7.142_857_142_857_143)] {
        let solution = stepped(strike(v_t), 0.01, 0.001);
        assert!((last(&solution, "x_dot") - after).abs() < 1e-12);
        assert!((last(&solution, "spin_dot") - spin).abs() < 1e-11);
        assert!((last(&solution, "y_dot") - 2.4).abs() < 1e-12);
    }
}

#[test]
fn a_gap_without_a_gradient_where_it_closes_is_refused_where_impacts_are_located() {
    let mut cubed = ball(0.5);
    cubed["contacts"][0]["gap"] = json!("y^3");
    let document = json!({"problem": {"mechanical": cubed}, "time": {"end": 2}});
    let specification = Specification::from_json(document.to_string().as_bytes()).expect("a right specification");
    let failure = dvi::solve(&specification, &Control::new()).error.expect("a failure");
    assert_eq!(failure.code, "gap_without_gradient");
    assert!(
        failure.message.contains("`floor`") && (failure.time - (2.0_f64 / 9.81).sqrt()).abs() < 1e-3,
        "{failure:?}"
    );
    // Time stepping needs only the sign of the gap function, and not its gradient, which vanishes here at contact.
    let (rested, plain) = (stepped(cubed, 2.0, 1e-3), stepped(ball(0.5), 2.0, 1e-3));
    assert!((last(&rested, "y") - last(&plain, "y")).abs() < 1e-3, "{}", last(&rested, "y"));
}
