//! Expressions with parameters, compared with the expressions in which numbers replace the parameters.

use crate::{Assumption, Assumptions, Graph, IntervalWorkspace, Irregularities, Kinks, Node, Scope, Tape};
use num_dual::{Dual64, DualNum};
use numerics::Interval;
use proptest::prelude::*;

/// Expressions that use every rewriting rule, in parameters `p`, `q`, `r` and inputs `t`, `x`, `y`, `z`.
const TEXTS: [&str; 14] = [
    "-p*x + q*sin(r*t)",
    "p*(x - y)/q - (r - p)*z",
    "x/p + p/x - y*(-q)",
    "q*abs(x - p) + max(p, y)*r - min(y, q, z)",
    "exp(-p*t)*x^3 - (p^2 + q^2)*y^2",
    "sqrt(p*p + x^2)/(q + r)",
    "-(p - q)*(x - r)*(-y)",
    "p - x - (q - y) + (-p)",
    "atan2(p*x, q)*heaviside(y - r) + sign(p*x - q)",
    "abs(x)^r + (1 + x^2)^(p/q)",
    "p*q*r*x + p*q*y + 2*p*3*z",
    "ln(p + exp(q*x)) - tanh(x/r)*cbrt(y*p)",
    "p*x*y + q*y*z + r*z*x - p*q*x*y*z",
    "-x*p - y/(-q) - (-z)/r",
];

/// Parses an expression with parameters, or with their values as numbers, and builds its derivatives with respect to
/// the inputs.
fn parsed(text: &str, parameters: [f64; 3], are_numbers: bool) -> (Graph, Vec<Node>, Vec<usize>) {
    let (mut graph, mut scope) = super::space();
    for (index, name) in ["p", "q", "r"].into_iter().enumerate() {
        let value = parameters[index];
        let node = if are_numbers { graph.constant(value) } else { graph.parameter(index, value) };
        scope.bind(name, node).unwrap();
    }
    let mut nodes = vec![graph.parse(text, &scope).unwrap()];
    let gradient = graph.gradient(nodes[0]).unwrap();
    nodes.extend(gradient.iter().map(|&(_, node)| node));
    (graph, nodes, gradient.into_iter().map(|(input, _)| input).collect())
}

fn values(tape: &mut Tape, inputs: [f64; 4], count: usize) -> Vec<f64> {
    let mut values = vec![0.0; count];
    tape.evaluate(inputs[0], &inputs[1..], &mut values);
    values
}

/// Whether two numbers are equal up to the sign of zeros; NaN equals NaN.
fn same(a: f64, b: f64) -> bool {
    a == b || a.to_bits() == b.to_bits() || a.is_nan() && b.is_nan()
}

#[test]
fn an_evaluation_takes_no_more_operations_than_with_numbers() {
    let count = |text: &str, parameters: [f64; 3], are_numbers: bool| {
        let (graph, nodes, _) = parsed(text, parameters, are_numbers);
        Tape::compile(&graph, &nodes).instructions()
    };
    let counts = |parameters: [f64; 3]| -> Vec<(usize, usize)> {
        TEXTS.iter().map(|text| (count(text, parameters, false), count(text, parameters, true))).collect()
    };
    for parameters in [[0.7, 1.3, 2.9], [-0.7, 1.3, 0.37], [0.7, -1.3, -2.9], [-3.1, -0.2, -5.3]] {
        for (text, (symbolic, folded)) in TEXTS.iter().zip(counts(parameters)) {
            assert_eq!(symbolic, folded, "{text} at {parameters:?}");
        }
    }
    // Factors 1 are dropped for numbers, but not for parameters, whose value may change.
    let counts = counts([1.0, 1.0, 1.0]);
    let symbolic: usize = counts.iter().map(|(symbolic, _)| symbolic).sum();
    let folded: usize = counts.iter().map(|(_, folded)| folded).sum();
    assert_eq!((symbolic, folded), AT_ONE);
}

/// The number of operations in the programs of all test expressions and their derivatives: with parameters that have
/// the value 1, and with the number 1 in place of each parameter.
const AT_ONE: (usize, usize) = (162, 128);

/// Returns the results of a program at a point, and their enclosures over a box around it.
fn told(tape: &mut Tape, workspace: &mut IntervalWorkspace, count: usize) -> Vec<(f64, Interval)> {
    let inputs = [0.3, 1.7, -0.6, 2.1];
    let ranges = inputs.map(|input| Interval::new(input, input + 0.25));
    let mut enclosures = vec![Interval::EMPTY; count];
    tape.enclose(ranges[0], &ranges[1..], workspace, &mut enclosures);
    values(tape, inputs, count).into_iter().zip(enclosures).collect()
}

#[test]
fn a_bound_program_has_the_bits_of_one_compiled_anew() {
    // The last three sets of parameter values contain ones, powers of two, equal values, or products of equal value.
    let others = [[1.1, 0.4, 2.7], [-2.3, 4.1, 1.9], [3.5, 1.0, 0.25], [2.25, 2.25, 0.75], [1.0, 4.0, 7.0]];
    for text in TEXTS {
        let (graph, nodes, by) = parsed(text, [0.7, 1.3, 2.9], false);
        let mut bound = Tape::compile(&graph, &nodes);
        let mut workspace = IntervalWorkspace::new(&bound);
        for (k, parameters) in others.into_iter().enumerate() {
            if text.contains('^') && k >= 2 {
                // Expanded powers are not bitwise equal to general powers.
                continue;
            }
            bound.bind(&parameters);
            workspace.bind(&bound);
            let (graph, anew, by_anew) = parsed(text, parameters, true);
            assert_eq!(by, by_anew, "{text} at {parameters:?}");
            let mut folded = Tape::compile(&graph, &anew);
            let mut of_folded = IntervalWorkspace::new(&folded);
            let found = told(&mut bound, &mut workspace, nodes.len());
            let expected = told(&mut folded, &mut of_folded, anew.len());
            for (place, ((found, range), (expected, anew))) in found.into_iter().zip(expected).enumerate() {
                if k < 2 || place == 0 {
                    assert!(same(found, expected), "{text} at {parameters:?}: {found} instead of {expected}");
                    assert_eq!(range, anew, "{text} at {parameters:?}");
                } else {
                    // Without parameters, terms with equal numbers share their derivatives, whose sums then have a
                    // different order.
                    let off = (found - expected).abs();
                    assert!(off <= 1e-14 * expected.abs().max(1.0), "{text} at {parameters:?}: off by {off}");
                }
            }
        }
    }
}

proptest! {
    #[test]
    fn derivatives_by_parameters_are_those_of_dual_numbers(p in 0.1..3.0, q in 0.1..3.0, x in 0.2..2.0, y in -2.0..2.0) {
        let text = "p*sin(q*x) + q^2*x^p - y/(p + q) + exp(-p*y)*sqrt(q) + abs(p - 5)*x";
        let (mut graph, nodes, _) = parsed(text, [p, q, 0.0], false);
        let gradient = graph.gradient_by_parameters(nodes[0]).unwrap();
        let by: Vec<usize> = gradient.iter().map(|&(parameter, _)| parameter).collect();
        prop_assert_eq!(&by, &[0, 1]);
        let nodes: Vec<Node> = gradient.into_iter().map(|(_, node)| node).collect();
        let found = values(&mut Tape::compile(&graph, &nodes), [0.0, x, y, 0.0], 2);
        let value = |p: Dual64, q: Dual64| {
            (q * x).sin() * p + q * q * (p * x.ln()).exp() - (p + q).recip() * y
                + (p * -y).exp() * q.sqrt() + (-p + 5.0) * x
        };
        let (p, q) = (Dual64::from_re(p), Dual64::from_re(q));
        for (found, expected) in found.into_iter().zip([value(p.derivative(), q).eps, value(p, q.derivative()).eps]) {
            prop_assert!((found - expected).abs() <= 1e-12 * (1.0 + expected.abs()), "{found} instead of {expected}");
        }
    }
}

#[test]
fn what_vanishes_at_the_values_given_has_slopes_all_the_same() {
    // d/dp (x p q) = x q, although p is zero, so that the derivative with respect to x vanishes and is dropped; d/dr
    // y^r = y^r ln y at r = 2.
    let (mut graph, nodes, by) = parsed("p*q*x + y^r", [0.0, 3.0, 2.0], false);
    assert_eq!(by, [2]);
    let gradient = graph.gradient_by_parameters(nodes[0]).unwrap();
    let slopes: Vec<Node> = gradient.iter().map(|&(_, node)| node).collect();
    assert_eq!(gradient.iter().map(|&(parameter, _)| parameter).collect::<Vec<_>>(), [0, 1, 2]);
    let mut tape = Tape::compile(&graph, &slopes);
    let found = values(&mut tape, [0.0, 5.0, 3.0, 0.0], 3);
    let expected = [15.0, 0.0, 9.0 * 3f64.ln()];
    assert!(found.iter().zip(expected).all(|(a, b)| (a - b).abs() < 1e-14), "{found:?} instead of {expected:?}");
}

#[test]
fn a_value_that_decided_is_asked_about() {
    let check = |text: &str, given: [f64; 3], bound: [f64; 3]| {
        let (graph, _, _) = parsed(text, given, false);
        Assumptions::new(&graph).check(&bound).err()
    };
    let text = "p*x + q*y + z^r";
    assert_eq!(check(text, [1.0, 0.0, 2.0], [3.0, 0.0, 2.0]), None);
    let broken = check(text, [1.0, 0.0, 2.0], [1.0, 4.0, 2.0]).expect("`y` has a derivative now");
    assert_eq!((broken.assumption, broken.found, broken.parameters), (Assumption::Vanishing, 4.0, vec![1]));
    let broken = check(text, [1.0, 0.0, 2.0], [1.0, 0.0, 3.0]).expect("a square is no cube");
    assert_eq!((broken.assumption, broken.given, broken.parameters), (Assumption::Value, 2.0, vec![2]));
    assert_eq!(check("x^r", [0.0, 0.0, 2.1], [0.0, 0.0, 2.3]), None);
    let broken = check(text, [1.0, 0.0, 2.0], [0.0, 0.0, 2.0]).expect("`x` has no derivative any more");
    assert_eq!((broken.assumption, broken.parameters), (Assumption::Vanishing, vec![0]));
}

#[test]
fn what_is_irregular_and_what_has_a_kink_follows_the_parameters() {
    let (mut graph, mut scope): (Graph, Scope) = super::space();
    let p = graph.parameter(0, 1.0);
    scope.bind("p", p).unwrap();
    let node = graph.parse("sqrt(x^2 + p) + max(y, p*x)", &scope).unwrap();
    let mut irregularities = Irregularities::new(&graph, &[node]);
    assert!(irregularities.is_empty());
    irregularities.bind(&[-1.0]);
    assert!(irregularities.over(Interval::LINE, &[Interval::LINE; 3]).is_some_and(|found| found.function == "sqrt"));
    irregularities.bind(&[2.0]);
    assert!(irregularities.is_empty());

    let mut kinks = Kinks::new(&mut graph, &[node]);
    kinks.bind(&[2.0]);
    assert_eq!(kinks.at(0.0, &[3.0, 1.0]), [-5.0]);
    assert_eq!(kinks.gradient(0, 0.0, &[3.0, 1.0]).collect::<Vec<_>>(), [(0, -2.0), (1, 1.0)]);
}
