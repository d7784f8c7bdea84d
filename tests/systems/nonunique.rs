//! A problem with several solutions: `w' = M z - (1,1,1)`, `0 <= z perp w >= 0`, with the P-matrix `M =
//! [[1,3,0],[0,1,3],[3,0,1]]` (Stewart). From `w = 0` one solution stays at rest; others spiral outwards, with each
//! phase twice as long as the previous one.

use crate::systems::harness::{column, solve};
use crate::systems::reference::example;
use dvi::analysis::Uniqueness;
use serde_json::json;

#[test]
fn from_rest_the_solution_stays() {
    let mut specification = example("reverse_zeno");
    specification["problem"]["lcs"]["initial"] = json!([0, 0, 0]);
    let solution = solve(&specification);
    for (w, z) in [("w1", "z1"), ("w2", "z2"), ("w3", "z3")] {
        // Rounding errors of z enter w quadratically; a solution that left the unstable equilibrium w = 0 would grow to
        // ten.
        assert!(column(&solution, w).iter().all(|w| w.abs() < 1e-25));
        assert!(column(&solution, z).iter().all(|z| (z - 0.25).abs() < 1e-15));
    }
    assert!(solution.trajectory.events.is_empty());
}

#[test]
fn from_nearby_it_follows_the_spiral() {
    let start = 1e-6;
    let solution = solve(&example("reverse_zeno"));
    // The phases of the spiral end at 1e-6 (2^k - 1): the first lasts 1e-6, and each is twice as long as the previous
    // one.
    let mut ends: Vec<f64> = solution.trajectory.events.iter().map(|event| event.t).collect();
    ends.dedup();
    assert_eq!(ends.len(), 23);
    for (k, end) in ends.iter().enumerate() {
        let exact = start * (2.0_f64.powi(k as i32 + 1) - 1.0);
        assert!((end / exact - 1.0).abs() < 1e-12, "phase {k} ends at {end} instead of {exact}");
    }
    // In the phase of the spiral with z = e3, from T to 2T in the shifted time s = t + 1e-6, w1 = 2T - s, w2 = 2(s - T)
    // and w3 = 0.
    let (s, phase) = (10.0 + start, start * 2.0_f64.powi(23));
    assert!((column(&solution, "w1").last().expect("values") - (2.0 * phase - s)).abs() < 1e-9);
    assert!((column(&solution, "w2").last().expect("values") - 2.0 * (s - phase)).abs() < 1e-9);
    let caveats = &solution.verdict.caveats;
    assert!(caveats.iter().any(|caveat| caveat.code == "uniqueness_not_guaranteed"), "{caveats:?}");
}

/// For `y' = -u` above the surface `y = 0`, `y' = u` below it, and `u' = -1`, the surface attracts until `u = 0` and
/// repels afterwards, when the solution may leave it at any time and to either side.
#[test]
fn a_surface_that_begins_to_repel_takes_the_certificate_back() {
    for (scale, end, attracts) in [(1.0, 0.9, true), (1.0, 1.5, false), (1e-6, 1.5e-6, false), (1e6, 0.9e6, true)] {
        let solution = solve(&json!({
            "problem": {"filippov": {
                "states": {
                    "y": {"initial": 0.1 * scale, "plus": "-u", "minus": "u"},
                    "u": {"initial": 1, "plus": format!("-1/{scale:e}"), "minus": format!("-1/{scale:e}")},
                },
                "surface": "y",
            }},
            "time": {"end": end},
        }));
        let caveat = solution.verdict.caveats.iter().find(|caveat| caveat.code == "uniqueness_not_guaranteed");
        assert_eq!(caveat.is_none(), attracts, "{caveat:?}");
        assert_eq!(solution.verdict.trusted, attracts, "{:?}", solution.verdict);
        let analysis = solution.diagnostics.analysis.expect("an analysis");
        assert_eq!(analysis.uniqueness == Uniqueness::Unique, attracts, "{}", analysis.because);
    }
}

/// For `y' = x - 1.3` above the surface `y = 0` and `1.3 + d - x` below it, with `x' = 1`, the solution slides until `x =
/// 1.3`, leaves upwards and ends at `y = (2.3 - 1.3)^2/2`. The surface begins to repel at `x = 1.3 + d/2`: a step that
/// passes both points may end on the other side.
#[test]
fn an_exit_close_to_where_a_surface_repels_is_right_or_doubted() {
    let mut trusted = Vec::new();
    for (d, rtol) in [(1e-3, 1e-3), (1e-4, 1e-4), (1e-6, 1e-10), (1e-2, 1e-6), (0.1, 1e-6), (0.5, 1e-9)] {
        let solution = solve(&json!({
            "problem": {"filippov": {
                "states": {
                    "x": {"initial": 0, "plus": "1", "minus": "1"},
                    "y": {"initial": 0, "plus": "x - 1.3", "minus": format!("1.3 + {d:e} - x")},
                },
                "surface": "y",
            }},
            "time": {"end": 2.3}, "method": {"rtol": rtol, "atol": rtol},
        }));
        let off = (column(&solution, "y").last().expect("values") - 0.5).abs();
        assert!(off < 1e-2 || !solution.verdict.trusted, "{d:e}, {rtol:e}: off by {off:e}");
        if solution.verdict.trusted {
            trusted.push(d);
        }
    }
    assert!(trusted.contains(&0.1) && trusted.contains(&0.5), "{trusted:?}");
}
