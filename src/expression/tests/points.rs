//! Evaluation of programs at several points at once is bitwise equal to single evaluations.

use super::enclosures::texts;
use super::{Graph, Node, Tape, parse, space};
use crate::operator::Operator;
use proptest::prelude::*;

/// Generates numbers of every kind, including signed zeros, infinities and NaN, which functions treat differently.
fn numbers() -> impl Strategy<Value = f64> {
    let odd = vec![0.0, -0.0, 1.0, -1.0, f64::NAN, f64::INFINITY, f64::NEG_INFINITY, 5e-324, -5e-324, f64::MAX, 1e-300];
    prop_oneof![4 => -4.0..4.0f64, 1 => -1e-3..1e-3f64, 2 => prop::sample::select(odd)]
}

/// Whether two numbers are bitwise equal, or both NaN; the bits of a NaN are unspecified in Rust.
fn same(a: f64, b: f64) -> bool {
    a.to_bits() == b.to_bits() || a.is_nan() && b.is_nan()
}

/// Asserts that evaluation of a program at the first `n` points at once, for every `n`, equals evaluation at each point
/// alone. Points have more inputs than the program may need.
fn assert_same(tape: &mut Tape, outputs: usize, points: &[[f64; 4]]) -> Result<(), TestCaseError> {
    let mut alone = vec![0.0; outputs * points.len()];
    for (i, point) in points.iter().enumerate() {
        tape.evaluate(point[0], &point[1..], &mut alone[outputs * i..][..outputs]);
    }
    for count in 0..=points.len() {
        let first: Vec<f64> = points[..count].iter().map(|point| point[0]).collect();
        let rest: Vec<f64> = points[..count].iter().flat_map(|point| &point[1..]).copied().collect();
        let mut together = vec![0.0; outputs * count];
        tape.evaluate_points(&first, &rest, &mut together);
        for (at, (&a, &b)) in alone.iter().zip(&together).enumerate() {
            prop_assert!(same(a, b), "{count} points, output {at}: {a:e} alone, {b:e} together");
        }
    }
    Ok(())
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 4_000, failure_persistence: None, ..ProptestConfig::default() })]

    #[test]
    fn random_expressions_and_their_derivatives_have_the_bits_of_single_evaluations(
        text in texts(), points in prop::collection::vec(prop::array::uniform4(numbers()), 19)
    ) {
        let (mut graph, root) = parse(&text).unwrap();
        let mut nodes = vec![root];
        nodes.extend(graph.gradient(root).unwrap().into_iter().map(|(_, slope)| slope));
        let nodes = graph.terms_below(&nodes);
        assert_same(&mut Tape::compile(&graph, &nodes), nodes.len(), &points)?;
    }

    #[test]
    fn every_operator_has_the_bits_of_single_operations(
        a in prop::array::uniform8(numbers()), b in prop::array::uniform8(numbers()), count in 1..=8_usize
    ) {
        use Operator::*;
        let all = [
            Negate, Expanded, Sin, Cos, Tan, Asin, Acos, Atan, Sinh, Cosh, Tanh, Exp, Ln, Log10, Sqrt, Cbrt, Abs, Sign,
            Heaviside, Floor, Round, Parity, Add, Subtract, Multiply, Divide, Power, Atan2, Min, Max, Greater, Gate,
            Choose, Modulo, Lookup, Piece,
        ];
        prop_assert_eq!(all.len(), Piece as usize + 1);
        for operator in all {
            let mut together = [0.0; 8];
            operator.apply_lanes(&a, &b, &mut together, count);
            for lane in 0..count {
                let alone = operator.apply(a[lane], b[lane]);
                prop_assert!(same(together[lane], alone), "{:?} of {:e} and {:e}", operator, a[lane], b[lane]);
            }
        }
    }
}

#[test]
fn parameters_that_are_bound_anew_are_those_of_all_points() {
    let mut graph = Graph::new();
    let (x, p) = (graph.input(1), graph.parameter(0, 2.0));
    let square = graph.multiply(p, p);
    let node: Node = graph.multiply(square, x);
    let mut tape = Tape::compile(&graph, &[node]);
    for parameter in [2.0, 3.0] {
        tape.bind(&[parameter]);
        let mut values = [0.0; 3];
        tape.evaluate_points(&[0.0; 3], &[1.0, 2.0, 4.0], &mut values);
        assert_eq!(values, [1.0, 2.0, 4.0].map(|x| parameter * parameter * x));
    }
}

#[test]
fn a_program_without_inputs_or_outputs_is_evaluated_at_any_number_of_points() {
    let mut graph = Graph::new();
    let seven = graph.constant(7.0);
    let mut values = [0.0; 5];
    Tape::compile(&graph, &[seven]).evaluate_points(&[0.0; 5], &[], &mut values);
    assert_eq!(values, [7.0; 5]);
    Tape::default().evaluate_points(&[0.0; 5], &[1.0; 10], &mut []);
}

#[test]
fn terms_side_by_side_have_the_bits_of_single_evaluations() {
    for alone in [0, 200] {
        let (mut graph, mut scope) = space();
        let mut nodes = Vec::new();
        for i in 0..40 {
            scope.bind(&format!("c{i}"), graph.constant(0.1 * f64::from(i))).unwrap();
            nodes.push(graph.parse(&format!("sin(x*c{i})*max(y, c{i}) - z/(t + c{i})"), &scope).unwrap());
        }
        // In a chain each term depends on the previous one, so that no terms can be evaluated together as lanes.
        let mut chain = nodes[0];
        for _ in 0..alone {
            let grown = graph.multiply(chain, chain);
            chain = graph.add(grown, nodes[1]);
        }
        nodes.push(chain);
        let points: Vec<[f64; 4]> = (0..9).map(|i| [0.7, 1.1, 2.3, 0.3].map(|x| x * f64::from(i))).collect();
        let mut tape = Tape::compile(&graph, &nodes);
        assert_eq!(tape.program.is_vectorised, alone == 0);
        assert_same(&mut tape, nodes.len(), &points).unwrap();
    }
}
