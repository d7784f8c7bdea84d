//! Systems with many unknowns and sparse matrices, compared with closed forms and with the small systems that they
//! consist of.

use crate::systems::harness::{last, solve};
use dvi::problem::Control;
use dvi::solution::Status;
use dvi::specification::Specification;
use serde_json::{Value, json};
use std::f64::consts::PI;

fn sparse(rows: usize, columns: usize, entries: &[(usize, usize, f64)]) -> Value {
    json!({"shape": [rows, columns], "entries": entries})
}

/// Returns the nonzeros of the `n` by `n` matrix with the rows `c (x_{i-1} - 2 x_i + x_{i+1})`, as row, column and
/// value.
fn chain(n: usize, c: f64) -> Vec<(usize, usize, f64)> {
    let row = |i: usize| [(i, i.wrapping_sub(1), c), (i, i, -2.0 * c), (i, i + 1, c)];
    (0..n).flat_map(row).filter(|&(_, j, _)| j < n).collect()
}

#[test]
fn a_chain_too_long_for_dense_matrices_decays_as_its_slowest_wave() {
    // A dense matrix of this size would take 3.2 GB. The initial state, a sine wave, is an eigenvector of the matrix.
    let n = 20_000;
    let h = 1.0 / (n + 1) as f64;
    let wave: Vec<f64> = (1..=n).map(|i| (PI * i as f64 * h).sin()).collect();
    let rate = (2.0 / h * (0.5 * PI * h).sin()).powi(2);
    for mass in [1.0, 2.0] {
        let mut lcs = json!({"A": sparse(n, n, &chain(n, 1.0 / (h * h))), "initial": wave});
        if mass != 1.0 {
            lcs["mass"] = sparse(n, n, &(0..n).map(|i| (i, i, mass)).collect::<Vec<_>>());
        }
        let solution = solve(&json!({
            "problem": {"lcs": lcs},
            "time": {"end": 0.1},
            "method": {"rtol": 1e-8, "atol": 1e-10},
            "output": {"times": [0.1], "fields": ["x1", "x10000"]},
        }));
        for (name, i) in [("x1", 0), ("x10000", 9_999)] {
            let exact = wave[i] * (-rate * 0.1 / mass).exp();
            assert!((last(&solution, name) - exact).abs() < 1e-7, "{} instead of {exact}", last(&solution, name));
        }
        assert!(solution.diagnostics.evaluations.jacobians <= 3, "the matrix is constant");
    }
}

#[test]
fn a_full_matrix_of_middling_size_decays_along_its_eigenvectors() {
    // The matrix -I - (1/n) 1 1^T has the eigenvalue -2 along the vector of ones, and -1 on its complement.
    let n = 80;
    let full: Vec<Vec<f64>> =
        (0..n).map(|i| (0..n).map(|j| -1.0 / n as f64 - if i == j { 1.0 } else { 0.0 }).collect()).collect();
    let start: Vec<f64> = (0..n).map(|i| if i % 2 == 0 { 1.5 } else { 0.5 }).collect();
    let solution = solve(&json!({
        "problem": {"lcs": {"A": full, "initial": start}},
        "time": {"end": 1},
        "method": {"rtol": 1e-9, "atol": 1e-12},
        "output": {"times": [1]},
    }));
    let (ones, across) = ((-2.0_f64).exp(), 0.5 * (-1.0_f64).exp());
    assert!((last(&solution, "x1") - ones - across).abs() < 1e-9);
    assert!((last(&solution, "x80") - ones + across).abs() < 1e-9);
}

/// Specification of a system of `copies` independent relays with friction, `x' = 3 sin 4t - x - z`, `z in [-1, 1]`, `G
/// = -x`.
fn relays(copies: usize) -> Value {
    let diagonal = |value: f64| sparse(copies, copies, &(0..copies).map(|i| (i, i, value)).collect::<Vec<_>>());
    let names: Vec<String> = (1..=copies).map(|k| format!("z{k}")).collect();
    json!({
        "problem": {"lcs": {
            "A": diagonal(-1.0), "B": diagonal(-1.0), "C": diagonal(-1.0), "D": diagonal(0.0),
            "a": vec!["3*sin(4*t)"; copies], "initial": vec![0.5; copies],
            "set": [{"box": {"of": names, "lower": -1, "upper": 1}}],
        }},
        "time": {"end": 2},
        "method": {"rtol": 1e-9, "atol": 1e-11},
        "output": {"times": {"count": 9}},
    })
}

#[test]
fn many_copies_of_a_switching_system_run_as_the_one_does() {
    let (one, many) = (solve(&relays(1)), solve(&relays(35)));
    assert!(many.diagnostics.switches >= 35 * 2);
    assert_eq!(one.diagnostics.switches * 35, many.diagnostics.switches);
    for name in ["x", "z"] {
        let single = one.trajectory.field(&format!("{name}1")).expect("a field");
        for copy in [1, 17, 35] {
            let copied = many.trajectory.field(&format!("{name}{copy}")).expect("a field");
            let difference = single.iter().zip(copied).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
            assert!(difference < 1e-7, "{name}{copy} is off by {difference}");
        }
    }
}

#[test]
fn free_variables_of_a_large_system_follow_from_the_hidden_constraint_or_the_plain_one() {
    // The chain x_i' = z_i + (x_{i-1} - 2 x_i + x_{i+1}). Even rows of G require x_i = sin t, odd rows z_i = x_i +
    // cos t.
    let n = 120;
    let even = |i: &usize| i.is_multiple_of(2);
    let c: Vec<_> = (0..n).map(|i| (i, i, if even(&i) { 1.0 } else { -1.0 })).collect();
    let d: Vec<_> = (0..n).filter(|i| !even(i)).map(|i| (i, i, 1.0)).collect();
    let g: Vec<_> = (0..n).map(|i| if even(&i) { "-sin(t)" } else { "-cos(t)" }).collect();
    let names: Vec<String> = (1..=n).map(|k| format!("z{k}")).collect();
    let identity: Vec<_> = (0..n).map(|i| (i, i, 1.0)).collect();
    let solution = solve(&json!({
        "problem": {"lcs": {
            "A": sparse(n, n, &chain(n, 1.0)), "B": sparse(n, n, &identity), "C": sparse(n, n, &c),
            "D": sparse(n, n, &d), "g": g, "initial": vec![0.0; n], "set": [{"free": names}],
        }},
        "time": {"end": 1},
        "method": {"rtol": 1e-9, "atol": 1e-11},
        "output": {"times": [0.37, 1]},
    }));
    // An odd state between two even ones obeys x' = cos t - x + 2 sin t, x(0) = 0, so that x = (3 sin t - cos t +
    // e^-t) / 2.
    let exact = |t: f64| 0.5 * (3.0 * t.sin() - t.cos() + (-t).exp());
    for (place, &t) in solution.trajectory.t.iter().enumerate() {
        let value = |name: &str| solution.trajectory.field(name).expect("a field")[place];
        assert!((value("x61") - t.sin()).abs() < 1e-7, "{} at {t}", value("x61") - t.sin());
        assert!((value("x62") - exact(t)).abs() < 1e-7, "{} at {t}", value("x62") - exact(t));
        assert!((value("z62") - exact(t) - t.cos()).abs() < 1e-7);
        // The hidden constraint of an even row determines its variable z with the order of the states: cos t = z - 2
        // sin t + the sum of the two neighbouring states.
        let z = t.cos() + 2.0 * t.sin() - 2.0 * exact(t);
        assert!((value("z61") - z).abs() < 1e-7, "{} instead of {z} at {t}", value("z61"));
    }
}

#[test]
fn inequalities_too_many_for_memory_are_refused_with_their_number() {
    let specification = Specification::from_json(relays(5_000).to_string().as_bytes()).expect("a valid specification");
    let solution = dvi::solve(&specification, &Control::new());
    assert_eq!(solution.status, Status::Failed);
    let error = solution.error.expect("an error");
    assert_eq!(error.code, "too_large");
    assert!(error.message.contains("35000 unknowns"), "{}", error.message);
}
