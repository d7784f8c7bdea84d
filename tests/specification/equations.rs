//! Equations that are built from specifications: their values and derivatives compared with those computed by hand, the
//! order of states, defaults, and warnings.

use crate::documents::{block, linear, with};
use dvi::problem::{ConvexSet, Dvi, Mass, MovingBound, Side};
use dvi::specification::Specification;
use serde_json::{Value, json};

fn read(document: &Value) -> Specification {
    read_text(&document.to_string())
}

fn read_text(text: &str) -> Specification {
    Specification::from_json(text.as_bytes()).unwrap_or_else(|errors| panic!("{errors:#?}"))
}

fn values(problem: &mut dyn Dvi, t: f64, y: &[f64]) -> Vec<f64> {
    let mut values = vec![f64::NAN; problem.structure().rows()];
    problem.evaluate(t, y, &mut values);
    values
}

fn jacobian(problem: &mut dyn Dvi, t: f64, y: &[f64]) -> Vec<f64> {
    let mut values = vec![f64::NAN; problem.structure().pattern.len()];
    problem.jacobian(t, y, &mut values);
    values
}

const GENERAL: &str = r#"{
  "problem": {"dvi": {
    "parameters": {"m": 2, "k": "3*m"},
    "states": {
      "v": {"initial": "k - 1", "rate": "(-k*x - F)/m + sin(t)"},
      "x": {"initial": 1, "rate": "v*x"}
    },
    "variables": {"N": {"inequality": "x + 4*N"}, "F": {"inequality": "-v"}},
    "set": [{"nonpositive": ["N"]}, {"box": {"of": ["F"], "lower": "-x^2", "upper": "t + 1"}}],
    "mass": [["m", 0], [0, 0]]
  }},
  "time": {"start": 0.5, "end": 1.5},
  "method": {"atol": {"x": 1e-3}, "rtol": 1e-4},
  "output": {"times": {"every": 0.3}, "fields": ["F", "v"]}
}"#;

#[test]
fn states_and_parameters_keep_the_order_of_the_document() {
    let specification = read_text(GENERAL);
    let model = specification.model().dvi().unwrap();
    assert_eq!(model.state_names, ["v", "x"]);
    assert_eq!(model.variable_names, ["N", "F"]);
    assert_eq!(model.initial, [5.0, 1.0]);
    assert_eq!(specification.output_fields(), [3, 0]);
}

#[test]
fn the_general_form_gives_values_and_exact_derivatives() {
    let specification = read_text(GENERAL);
    let mut problem = specification.model().dvi().unwrap().problem();
    let (t, y) = (0.5_f64, [5.0, 3.0, -2.0, 0.25]);
    let expected = [(-18.0 - 0.25) / 2.0 + t.sin(), 15.0, 3.0 - 8.0, -5.0, -9.0, 1.5];
    for (value, expected) in values(&mut *problem, t, &y).iter().zip(expected) {
        assert!((value - expected).abs() < 1e-14, "{value} {expected}");
    }
    let structure = problem.structure();
    assert_eq!(structure.pattern, [(0, 1), (0, 3), (1, 0), (1, 1), (2, 1), (2, 2), (3, 0), (4, 1)]);
    assert!(!structure.constant_jacobian);
    assert_eq!(structure.mass, Mass::Constant(vec![(0, 0, 2.0)]));
    assert_eq!((structure.set.lower[0], structure.set.upper[0]), (f64::NEG_INFINITY, 0.0));
    assert_eq!(
        structure.moving,
        [MovingBound { variable: 1, side: Side::Lower }, MovingBound { variable: 1, side: Side::Upper }]
    );
    assert_eq!(jacobian(&mut *problem, t, &y), [-3.0, -0.5, 3.0, 5.0, 1.0, 4.0, -1.0, -6.0]);
}

#[test]
fn a_linear_system_gives_values_and_its_matrix() {
    let specification = read(&linear());
    let mut problem = specification.model().dvi().unwrap().problem();
    let t = 0.3_f64;
    assert_eq!(values(&mut *problem, t, &[2.0, 5.0, 7.0]), [5.0, -2.0 + 7.0 + t.sin(), 5.0]);
    assert_eq!(problem.structure().pattern, [(0, 1), (1, 0), (1, 2), (2, 1)]);
    assert_eq!(jacobian(&mut *problem, t, &[2.0, 5.0, 7.0]), [1.0, -1.0, 1.0, 1.0]);
    assert!(problem.structure().constant_jacobian);
    assert_eq!(problem.structure().set, ConvexSet::nonnegative(1));
    assert_eq!(problem.structure().mass, Mass::Identity);
}

#[test]
fn a_sparse_matrix_is_the_dense_one_and_repeated_entries_add() {
    let sparse = json!({"shape": [2, 2], "entries": [[1, 0, -3], [0, 1, "2/2"], [1, 0, 2], [0, 0, 0]]});
    let sparse = read(&with(linear(), "/problem/lcs/A", sparse));
    let (mut sparse, mut dense) =
        (sparse.model().dvi().unwrap().problem(), read(&linear()).model().dvi().unwrap().problem());
    assert_eq!(sparse.structure().pattern, dense.structure().pattern);
    let y = [2.0, 5.0, 7.0];
    assert_eq!(values(&mut *sparse, 1.0, &y), values(&mut *dense, 1.0, &y));
    assert_eq!(jacobian(&mut *sparse, 1.0, &y), jacobian(&mut *dense, 1.0, &y));
}

#[test]
fn a_linear_system_may_have_bounds_that_move_with_the_state() {
    let set = json!([{"box": {"of": ["z1"], "lower": null, "upper": "x1^2 + t"}}]);
    let mut problem = read(&with(linear(), "/problem/lcs/set", set)).model().dvi().unwrap().problem();
    let y = [2.0, 5.0, 7.0];
    assert_eq!(values(&mut *problem, 0.5, &y)[3], 4.5);
    assert_eq!(problem.structure().pattern.last(), Some(&(3, 0)));
    assert_eq!(jacobian(&mut *problem, 0.5, &y).last(), Some(&4.0));
    assert!(!problem.structure().constant_jacobian);
    assert_eq!(problem.structure().set.lower, [f64::NEG_INFINITY]);
}

#[test]
fn the_number_of_variables_follows_from_any_matrix_that_tells() {
    let document = json!({
        "problem": {"lcs": {"initial": [0], "B": [[1, 2]], "set": [{"free": ["z1"]}, {"nonpositive": ["z2"]}]}},
        "time": {"end": 1}
    });
    assert_eq!(read(&document).model().dvi().unwrap().variable_names, ["z1", "z2"]);
    let document = json!({"problem": {"lcs": {"initial": [1], "A": [[-1]]}}, "time": {"end": 1}});
    assert_eq!(read(&document).model().dvi().unwrap().structure().variables, 0);
}

#[test]
fn an_identity_that_is_written_out_is_an_identity() {
    let mass = |mass| read(&with(block(), "/problem/dvi/mass", mass)).model().dvi().unwrap().structure().mass.clone();
    assert_eq!(mass(json!([[1, 0], [0, 1]])), Mass::Identity);
    // The entries of this mass matrix are parameters with the value one, which may be bound to other values: the
    // matrix must not be treated as an identity.
    assert_eq!(mass(json!([["m", 0], [0, "k"]])), Mass::Constant(vec![(0, 0, 1.0), (1, 1, 1.0)]));
}

#[test]
fn absolute_tolerances_default_to_a_thousandth_of_the_relative_one() {
    for (atol, expected) in [(1e-7, 1e-7), (1e-3, 1e-3)] {
        let specification = read_text(&GENERAL.replace("{\"x\": 1e-3}", &format!("{{\"x\": {atol}}}")));
        assert_eq!(specification.absolute_tolerances(), [1e-4 * 1e-3, expected]);
    }
    assert_eq!(read(&block()).absolute_tolerances(), [1e-6 * 1e-3; 2]);
}

#[test]
fn output_times_begin_at_the_start_and_finish_exactly_at_the_end() {
    let times = |times: Value| {
        let document = with(with(block(), "/output", json!({"times": times})), "/time/start", json!(0.5));
        read(&with(document, "/time/end", json!(1.5))).output_times().map(<[f64]>::to_vec)
    };
    assert_eq!(times(json!("steps")), None);
    assert_eq!(times(json!({"count": 2})), Some(vec![0.5, 1.5]));
    assert_eq!(times(json!({"count": 5})), Some(vec![0.5, 0.75, 1.0, 1.25, 1.5]));
    assert_eq!(times(json!({"every": 0.5})), Some(vec![0.5, 1.0, 1.5]));
    assert_eq!(times(json!({"every": 0.4})), Some(vec![0.5, 0.9, 1.3, 1.5]));
    assert_eq!(times(json!([0.5, 1.25])), Some(vec![0.5, 1.25]));
    let tenths = times(json!({"every": 0.1})).unwrap();
    assert_eq!((tenths.len(), tenths[10]), (11, 1.5));
}

#[test]
fn a_kink_of_a_state_in_a_rate_is_a_warning_with_its_remedy() {
    let rate = |text: &str| read(&with(block(), "/problem/dvi/states/v/rate", json!(text))).model().warnings().to_vec();
    let warnings = rate("-x - 0.1*abs(v) - F");
    assert_eq!(warnings.len(), 1);
    assert_eq!(warnings[0].code, "kink_in_rate");
    for part in ["the rate of `v`", "`abs` of `v`", "the box [-1, 1] and the inequality -a"] {
        assert!(warnings[0].message.contains(part), "{}", warnings[0].message);
    }
    assert_eq!(rate("-x - abs(sin(t)) - F"), []);
    assert_eq!(rate("max(x, 0) - min(x, v) - F").len(), 2);
}

/// The warning about a kink in a rate recommends a variational inequality in place of a function such as `sign` or
/// `max`. With the inequality `w`, the natural map `z - P_K(z - w)` vanishes at the value of that function.
#[test]
fn the_remedies_solve_their_variational_inequalities() {
    for a in [-2.0_f64, -0.5, 0.7, 3.0] {
        let (sign, step) = (a.signum(), f64::from(a > 0.0));
        let ramp = a.max(0.0);
        for (z, w, lower, upper) in [(sign, -a, -1.0, 1.0), (step, -a, 0.0, 1.0), (ramp, ramp - a, 0.0, f64::INFINITY)]
        {
            let set = ConvexSet::intervals(vec![lower], vec![upper]);
            assert_eq!(set.natural_residual(&[z], &[w]), 0.0);
        }
        let b = 0.2;
        assert!((a.min(b) - (a - (a - b).max(0.0))).abs() < 1e-15);
        assert!((a.max(b) - (a + (b - a).max(0.0))).abs() < 1e-15);
    }
}

#[test]
fn one_specification_serves_many_threads() {
    let specification = read(&block());
    std::thread::scope(|scope| {
        let runs: Vec<_> = (0..4)
            .map(|i| {
                let specification = &specification;
                scope.spawn(move || {
                    values(&mut *specification.model().dvi().unwrap().problem(), 0.0, &[f64::from(i), 2.0, 0.1])
                })
            })
            .collect();
        for (i, run) in (0..4).zip(runs) {
            assert_eq!(run.join().unwrap(), [-2.1, f64::from(i), -f64::from(i)]);
        }
    });
}
