//! Tests that evaluation of a differential variational inequality at several points at once is bitwise equal to single
//! evaluations.

use super::{Equations, Rows};
use expression::{Graph, Scope};
use problem::{ConvexSet, Dvi, Mass, MovingBound, Side};

const STATES: usize = 9;
const VARIABLES: usize = 2;

/// Builds a problem with states `x1` to `x9` and variables `z1` and `z2`; `%` in an expression is replaced by the row
/// number.
fn problem(rate: &str, inequality: &str, bound: &str) -> Equations {
    let (mut graph, mut scope) = (Graph::new(), Scope::new());
    scope.bind("t", graph.input(0)).unwrap();
    (1..=STATES).for_each(|i| scope.bind(&format!("x{i}"), graph.input(i)).unwrap());
    (1..=VARIABLES).for_each(|i| scope.bind(&format!("z{i}"), graph.input(STATES + i)).unwrap());
    let mut parse = |text: &str, row: usize| graph.parse(&text.replace('%', &row.to_string()), &scope).unwrap();
    let rates = (1..=STATES).map(|row| parse(rate, row)).collect();
    let inequality = (1..=VARIABLES).map(|row| parse(inequality, row)).collect();
    let moving = vec![(MovingBound { variable: 1, side: Side::Upper }, parse(bound, 1))];
    let set = ConvexSet::intervals(vec![0.0; VARIABLES], vec![f64::INFINITY, 1.0]);
    let rows = Rows { mass: Mass::Identity, rates, inequality, set, moving };
    Equations::new(&mut graph, rows).expect("rows that are affine in the variables")
}

fn assert_same(problem: &mut dyn Dvi) {
    let (unknowns, rows) = (problem.structure().unknowns(), problem.structure().rows());
    for points in 1..=19 {
        let times: Vec<f64> = (0..points).map(|i| 0.3 * f64::from(i)).collect();
        let odd = |i: usize| [f64::NAN, f64::INFINITY, -0.0, 1e308][i / 17 % 4];
        let value = |i: usize| if i % 17 == 16 { odd(i) } else { (1.3 * i as f64).sin() };
        let ys: Vec<f64> = (0..times.len() * unknowns).map(value).collect();
        let mut together = vec![0.0; times.len() * rows];
        problem.evaluate_points(&times, &ys, &mut together);
        for (i, &t) in times.iter().enumerate() {
            let mut alone = vec![0.0; rows];
            problem.evaluate(t, &ys[unknowns * i..][..unknowns], &mut alone);
            for (row, (a, b)) in alone.iter().zip(&together[rows * i..]).enumerate() {
                assert!(a.to_bits() == b.to_bits() || a.is_nan() && b.is_nan(), "row {row} at {i}: {a:e}, {b:e}");
            }
        }
    }
}

#[test]
fn linear_rows_have_the_bits_of_single_evaluations() {
    let rate = "0.3*%*x1 - x2/3 + 1.7*x3 - x4 + 0.1*x5 - 7*x6 + x7*1.1 + 0.9*z1 - z2*%/7 + x9*0.01 + cos(t*%)";
    let Equations::Linear(mut linear) = problem(rate, "x% - z1/3 + sin(t)", "0.7*x3 + exp(-t)") else {
        panic!("the rows are linear");
    };
    assert_same(&mut *linear);
}

#[test]
fn rows_of_expressions_have_the_bits_of_single_evaluations() {
    let rate = "sin(%*x1)*x2 - max(x3, x4/%)^3 + z1*x5 - abs(x6)*z2 + atan2(x7, t) - sqrt(x9)";
    let Equations::Symbolic(mut symbolic) = problem(rate, "x%*x3 - z1", "x3^2 + exp(-t)") else {
        panic!("the rows are not linear");
    };
    assert_same(&mut *symbolic);
}
