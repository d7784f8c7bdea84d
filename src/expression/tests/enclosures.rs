//! Enclosures contain the results of evaluation, at every point of the box and for every intermediate term.

use super::{evaluate, parse};
use crate::{Graph, IntervalWorkspace, Node, Tape};
use numerics::Interval;
use proptest::prelude::*;
use std::f64::consts::{FRAC_PI_2, PI};

/// Encloses the values of terms over a box of inputs `(t, x, y, z)`.
fn enclose(graph: &Graph, nodes: &[Node], inputs: [Interval; 4]) -> Vec<Interval> {
    let tape = Tape::compile(graph, nodes);
    let mut outputs = vec![Interval::EMPTY; nodes.len()];
    tape.enclose(inputs[0], &inputs[1..], &mut IntervalWorkspace::new(&tape), &mut outputs);
    outputs
}

/// Encloses the expression `text` for `x` in an interval, `y` on the whole line, and the other inputs zero.
fn over(text: &str, lo: f64, hi: f64) -> Interval {
    let (graph, node) = parse(text).unwrap();
    let zero = Interval::point(0.0);
    enclose(&graph, &[node], [zero, Interval::new(lo, hi), Interval::LINE, zero])[0]
}

#[track_caller]
fn assert_range(text: &str, domain: (f64, f64), lo: f64, hi: f64, defined: bool) {
    let found = over(text, domain.0, domain.1);
    let close = |a: f64, b: f64| a == b || (a - b).abs() <= 1e-13 * b.abs().max(1e-13);
    assert!(close(found.lo, lo) && close(found.hi, hi) && found.defined == defined, "{text}: {found:?}");
}

#[test]
fn functions_have_their_ranges() {
    let infinity = f64::INFINITY;
    let line = (-infinity, infinity);
    for (text, domain, lo, hi, defined) in [
        ("sin(x)", (0.1, 3.0), 0.1_f64.sin(), 1.0, true),
        ("sin(x)", (2.0, 7.0), -1.0, 2.0_f64.sin(), true),
        ("sin(x)", line, -1.0, 1.0, true),
        ("cos(x)", (-0.5, 0.25), 0.5_f64.cos(), 1.0, true),
        ("cos(x)", (3.0, 3.5), -1.0, 3.5_f64.cos(), true),
        ("cos(x)", (1e17, 1e17), -1.0, 1.0, true),
        ("tan(x)", (-1.0, 1.0), -(1.0_f64.tan()), 1.0_f64.tan(), true),
        ("tan(x)", (1.0, 2.0), -infinity, infinity, false),
        ("asin(x)", (-2.0, 0.5), -FRAC_PI_2, 0.5_f64.asin(), false),
        ("acos(x)", (-1.0, 1.0), 0.0, PI, true),
        ("atan(x)", line, -FRAC_PI_2, FRAC_PI_2, true),
        ("atan2(x, -1)", (-1.0, 1.0), -PI, PI, true),
        ("atan2(x, -1)", (1.0, 2.0), 2.0_f64.atan2(-1.0), 1.0_f64.atan2(-1.0), true),
        ("cosh(x)", (-1.0, 2.0), 1.0, 2.0_f64.cosh(), true),
        ("tanh(x)", line, -1.0, 1.0, true),
        ("exp(-x)", (0.0, infinity), 0.0, 1.0, true),
        ("ln(x)", (-1.0, 1.0), -infinity, 0.0, false),
        ("sqrt(1 + x^2)", line, 1.0, infinity, true),
        ("sqrt(1 - cos(x))", line, 0.0, 2.0_f64.sqrt(), true),
        ("sqrt(x)", (-1.0, 4.0), 0.0, 2.0, false),
        ("cbrt(x)", (-8.0, 27.0), -2.0, 3.0, true),
        ("abs(x)", (-2.0, 1.0), 0.0, 2.0, true),
        ("sign(x)", (0.0, 1.0), 0.0, 1.0, true),
        ("heaviside(x)", (-1.0, 0.0), 0.0, 1.0, true),
        ("min(x, 2)", (1.0, 3.0), 1.0, 2.0, true),
        ("max(x, 2, x - 1)", (1.0, 3.0), 2.0, 3.0, true),
        ("x^3", (-2.0, 1.0), -8.0, 4.0, true),
        ("x^18", (-2.0, 1.0), 0.0, 262_144.0, true),
        ("x^19", (-2.0, 1.0), -524_288.0, 1.0, true),
        ("x^1.5", (-1.0, 4.0), 0.0, 8.0, false),
        ("x^-1.5", (0.0, 4.0), 0.125, infinity, false),
        ("2^x", (-1.0, 3.0), 0.5, 8.0, true),
        ("x^x", (0.5, 2.0), 0.25, 4.0, true),
        ("x - x", line, 0.0, 0.0, true),
        ("x/(1 + y^2)", (-1.0, 2.0), -1.0, 2.0, true),
        ("1/x", (-1.0, 2.0), -infinity, infinity, false),
        ("x/x", (1.0, 2.0), 1.0, 1.0, true),
        ("floor(x)", (0.5, 2.5), 0.0, 2.0, true),
        ("ceil(x)", (0.5, 2.5), 1.0, 3.0, true),
        ("round(x)", (-0.5, 2.4), -1.0, 2.0, true),
        ("mod(x, 3)", (7.0, 8.0), 1.0, 2.0, true),
        ("pwm(x, 2, 0.25)", (2.01, 2.24), 1.0, 1.0, true),
        ("pwm(x, 2, 0.25)", (2.75, 3.75), 0.0, 0.0, true),
        ("triangle(x, 2)", (0.25, 0.75), 0.25, 0.75, true),
        ("if(x > 1, x, -5)", (2.0, 3.0), 2.0, 3.0, true),
        ("if(x > 1, sqrt(x), 5)", (-2.0, 0.0), 5.0, 5.0, true),
        ("pulse(x, 1, 2)", (1.0, 2.5), 1.0, 1.0, true),
    ] {
        assert_range(text, domain, lo, hi, defined);
    }
    // Ranges of the remainder are exact up to rounding only.
    for (text, ends, hull) in [("mod(x, 3)", (7.0, 10.0), (0.0, 3.0)), ("mod(x, -3)", (-5.0, 9.0), (-3.0, 0.0))] {
        let found = over(text, ends.0, ends.1);
        assert!((found.lo - hull.0).abs().max((found.hi - hull.1).abs()) < 1e-14 && found.defined, "{text}: {found:?}");
    }
    assert!(over("sqrt(x)", -2.0, -1.0).is_empty() && over("asin(x)", 2.0, 3.0).is_empty());
}

#[test]
fn a_branch_that_is_not_taken_need_not_be_defined() {
    let (mut graph, node) = parse("sqrt(max(x, 0))").unwrap();
    let slope = graph.gradient(node).unwrap()[0].1;
    let zero = Interval::point(0.0);
    let at = |lo, hi| enclose(&graph, &[slope], [zero, Interval::new(lo, hi), zero, zero])[0];
    assert_eq!(at(-2.0, -1.0), zero);
    assert!(at(1.0, 4.0).contains(0.25) && at(1.0, 4.0).contains(0.5) && at(1.0, 4.0).defined);
}

#[test]
fn lanes_are_enclosed_as_they_are_evaluated() {
    let rows: Vec<String> = (1..=60).map(|k| format!("sin({k}*x)*y + x/({k} + y^2) - {k}*x*y")).collect();
    let (mut graph, scope) = super::space();
    let nodes: Vec<Node> = rows.iter().map(|row| graph.parse(row, &scope).unwrap()).collect();
    let point = [0.0, 0.3, -0.7, 0.0];
    let enclosures = enclose(&graph, &nodes, point.map(Interval::point));
    for (value, enclosure) in evaluate(&graph, &nodes, point).into_iter().zip(enclosures) {
        assert!(enclosure.contains(value) && enclosure.hi - enclosure.lo < 1e-13, "{enclosure:?}, {value}");
    }
}

/// Generates random expressions with all functions of the language.
pub(super) fn texts() -> impl Strategy<Value = String> {
    let constants = prop_oneof![(-3.0..3.0f64), prop::sample::select(vec![-2.0, -1.0, 0.0, 0.5, 1.0, 3.0])];
    let leaf = prop_oneof![
        prop::sample::select(vec!["t", "x", "y", "z"]).prop_map(str::to_owned),
        constants.prop_map(|value| format!("({value})")),
    ];
    let unary = vec![
        "-",
        "sin",
        "cos",
        "tan",
        "asin",
        "acos",
        "atan",
        "sinh",
        "cosh",
        "tanh",
        "exp",
        "ln",
        "log10",
        "sqrt",
        "cbrt",
        "abs",
        "sign",
        "heaviside",
        "floor",
        "ceil",
        "round",
    ];
    let binary = vec!["+", "-", "*", "/", "^", "atan2", "min", "max", "mod"];
    leaf.prop_recursive(5, 30, 2, move |inner| {
        prop_oneof![
            (prop::sample::select(unary.clone()), inner.clone()).prop_map(|(name, a)| format!("({name}({a}))")),
            (prop::sample::select(binary.clone()), inner.clone(), inner.clone()).prop_map(|(name, a, b)| {
                match name {
                    // Let the divisor depend on z, because constant zero divisors are rejected.
                    "mod" => format!("mod({a}, {b} + z/3)"),
                    _ if name.len() == 1 => format!("({a} {name} {b})"),
                    _ => format!("{name}({a}, {b})"),
                }
            }),
            (prop::sample::select(vec!["<", "<=", "==", "!="]), inner.clone(), inner.clone())
                .prop_map(|(comparison, a, b)| format!("if({a} {comparison} {b} or not {b} > 1, {b}, 2*{a})")),
            (inner, prop::sample::select(vec!["-3", "-1", "2", "3", "4", "17", "18", "0.5", "1.5", "-0.3"]))
                .prop_map(|(a, exponent)| format!("({a})^{exponent}")),
        ]
    })
}

/// Generates ends of intervals, often of equal sign and often zero, and points in the intervals, often the ends.
fn edges() -> impl Strategy<Value = ([f64; 2], Vec<f64>)> {
    let end = prop_oneof![-4.0..4.0f64, prop::sample::select(vec![-1.0, 0.0, 1.0]), -1e-3..1e-3f64];
    let shares = prop::collection::vec(prop_oneof![0.0..=1.0f64, prop::sample::select(vec![0.0, 1.0])], 6);
    (end.clone(), end, shares).prop_map(|(a, b, shares)| ([a.min(b), a.max(b)], shares))
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 10_000, failure_persistence: None, ..ProptestConfig::default() })]

    #[test]
    fn random_points_evaluate_inside_the_enclosures_of_all_terms(
        text in texts(), edges in prop::array::uniform4(edges())
    ) {
        let (mut graph, root) = parse(&text).unwrap();
        let mut nodes = vec![root];
        nodes.extend(graph.gradient(root).unwrap().into_iter().map(|(_, slope)| slope));
        let nodes = graph.terms_below(&nodes);
        let enclosures = enclose(&graph, &nodes, [0, 1, 2, 3].map(|i| Interval::new(edges[i].0[0], edges[i].0[1])));
        for k in 0..6 {
            let point = [0, 1, 2, 3].map(|i| {
                let ([lo, hi], shares) = &edges[i];
                (lo + shares[k] * (hi - lo)).clamp(*lo, *hi)
            });
            let values = evaluate(&graph, &nodes, point);
            // Skip results that overflow or lie at a pole, which enclosures need not contain.
            if values.iter().any(|value| value.is_infinite()) {
                continue;
            }
            for ((value, enclosure), node) in values.iter().zip(&enclosures).zip(&nodes) {
                let held = if value.is_nan() { !enclosure.defined } else { enclosure.contains(*value) };
                prop_assert!(held, "{text} at {point:?}: {value} is not in {enclosure:?} of {:?}", graph.terms[node.place()]);
            }
        }
    }
}
