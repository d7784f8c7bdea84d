//! Tests of tables, which are called as functions of the expression language.

use super::{Graph, Node, evaluate, space};
use crate::{Breaks, Interpolation, IntervalWorkspace, Kinks, Table, TableError, Tape};
use numerics::Interval;
use proptest::prelude::*;

const X: [f64; 5] = [0.0, 1.0, 2.5, 3.0, 5.0];
const Y: [f64; 5] = [1.0, 3.0, 2.0, 2.0, -1.0];

/// Parses `text` into a graph, with `f` as a table of the given points.
fn graph_of(text: &str, x: &[f64], y: &[f64], interpolation: Interpolation) -> (Graph, Node) {
    let (mut graph, mut scope) = space();
    scope.bind_table("f", Table::new(x, y, interpolation).unwrap()).unwrap();
    let node = graph.parse(text, &scope).unwrap();
    (graph, node)
}

fn value(text: &str, interpolation: Interpolation, t: f64) -> f64 {
    let (graph, node) = graph_of(text, &X, &Y, interpolation);
    evaluate(&graph, &[node], [t, 0.0, 0.0, 0.0])[0]
}

#[test]
fn tables_go_through_their_points_and_stay_beyond_them() {
    for interpolation in [Interpolation::Linear, Interpolation::Pchip, Interpolation::Previous] {
        for (x, y) in X.into_iter().zip(Y) {
            assert_eq!(value("f(t)", interpolation, x), y, "{interpolation:?} at {x}");
        }
        assert_eq!([-1e9, -1e-9].map(|t| value("f(t)", interpolation, t)), [1.0; 2]);
        assert_eq!([5.0 + 1e-9, 1e300].map(|t| value("f(t)", interpolation, t)), [-1.0; 2]);
        assert!(value("f(t)", interpolation, f64::NAN).is_nan());
    }
    assert_eq!([0.25, 2.0, 2.75, 4.0].map(|t| value("f(t)", Interpolation::Previous, t)), [1.0, 3.0, 2.0, 2.0]);
    assert_eq!([0.25, 2.75, 4.0].map(|t| value("f(t)", Interpolation::Linear, t)), [1.5, 2.0, 0.5]);
}

#[test]
fn cubics_are_those_of_fritsch_and_butland() {
    // Exact fractions: the values 0, 1, 5 at 0, 1, 3 have the chords 1 and 2 and the weights 5 and 4, which gives the
    // slope 9/(5/1 + 4/2) = 9/7 in the middle; parabolas give (4*1 - 2)/3 = 2/3 and (5*2 - 2*1)/3 = 8/3 at the ends.
    let (mut graph, node) = graph_of("f(x)", &[0.0, 1.0, 3.0], &[0.0, 1.0, 5.0], Interpolation::Pchip);
    let slope = graph.gradient(node).unwrap()[0].1;
    for (x, expected) in [(0.0, 2.0 / 3.0), (1.0, 9.0 / 7.0), (3.0 - 1e-13, 8.0 / 3.0)] {
        let found = evaluate(&graph, &[slope], [0.0, x, 0.0, 0.0])[0];
        assert!((found - expected).abs() < 1e-12, "{x}: {found}");
    }
    // The Hermite cubic at the midpoint is the mean of the values plus an eighth of the difference of the slopes
    // times the width.
    let found = evaluate(&graph, &[node], [0.0, 0.5, 0.0, 0.0])[0];
    assert!((found - (0.5 + (2.0 / 3.0 - 9.0 / 7.0) / 8.0)).abs() < 1e-15, "{found}");
    // The cubic does not overshoot: its slope is zero where chords change sign.
    let between = (0..=1000).map(|k| value("f(t)", Interpolation::Pchip, 5.0 * f64::from(k) / 1000.0));
    assert!(between.into_iter().all(|y| (-1.0..=3.0).contains(&y)));
}

#[test]
fn points_that_make_no_table_are_refused() {
    let error = |x: &[f64], y: &[f64]| Table::new(x, y, Interpolation::Linear).unwrap_err();
    assert_eq!(error(&[0.0, 1.0], &[1.0]), TableError::Lengths { x: 2, y: 1 });
    assert_eq!(error(&[0.0], &[1.0]), TableError::TooFew(1));
    assert_eq!(error(&[], &[]), TableError::TooFew(0));
    assert_eq!(error(&[0.0, 1.0, 1.0], &[1.0; 3]), TableError::Unsorted(2));
    assert_eq!(error(&[0.0, f64::NAN], &[1.0; 2]), TableError::NotFinite(1));
    assert_eq!(error(&[0.0, 1.0], &[f64::INFINITY; 2]), TableError::NotFinite(0));
    assert_eq!(error(&[0.0, 5e-324], &[0.0, 1.0]), TableError::NotFinite(0));
}

#[test]
fn tables_of_time_switch_at_points_where_they_change_course() {
    let breaks = |interpolation, x: &[f64], y: &[f64]| {
        let (mut graph, node) = graph_of("f(t)*x", x, y, interpolation);
        let mut breaks = Breaks::new(&mut graph, &[node]);
        let mut sign = breaks.at(-1.0)[0] >= 0.0;
        let mut found = Vec::new();
        for k in -100..=1100 {
            let t = f64::from(k) / 100.0;
            if (breaks.at(t)[0] >= 0.0) != sign {
                sign = !sign;
                found.push(t);
                let before = breaks.over(Interval::new(t - 0.009, t.next_down()))[0];
                assert_eq!((before.lo, before.hi), if sign { (-1.0, -1.0) } else { (1.0, 1.0) });
                assert!(breaks.over(Interval::new(t.next_down(), t))[0].contains(0.0));
            }
        }
        found
    };
    assert_eq!(breaks(Interpolation::Linear, &X, &Y), [0.0, 1.0, 2.5, 3.0, 5.0]);
    assert_eq!(breaks(Interpolation::Pchip, &X, &Y), [0.0, 1.0, 2.5, 3.0, 5.0]);
    // No break (kink or jump of the table) occurs at the first point (constant before it), nor at 3.0, where the value
    // does not change.
    assert_eq!(breaks(Interpolation::Previous, &X, &Y), [1.0, 2.5, 5.0]);
    assert_eq!(breaks(Interpolation::Linear, &[0.0, 1.0, 2.0, 4.0], &[1.0, 2.0, 3.0, 3.0]), [0.0, 2.0]);
}

#[test]
fn kinks_of_states_are_those_between_straight_lines() {
    let (mut graph, node) = graph_of("f(x)", &X, &Y, Interpolation::Linear);
    assert_eq!(graph.kinks(node), [("table", vec![1])]);
    let mut kinks = Kinks::new(&mut graph, &[node]);
    assert_eq!(kinks.kinks().len(), 1);
    for x in X {
        let at = |kinks: &mut Kinks, x: f64| kinks.at(0.0, &[x, 0.0, 0.0])[0];
        assert_eq!(at(&mut kinks, x), 0.0);
        assert!(at(&mut kinks, x - 0.1) * at(&mut kinks, x + 0.1) < 0.0);
        assert!((at(&mut kinks, x + 0.1).abs() - 0.1).abs() < 1e-12);
    }
    let (mut graph, node) = graph_of("f(x)", &X, &Y, Interpolation::Pchip);
    assert!(graph.kinks(node).is_empty() && Kinks::new(&mut graph, &[node]).kinks().is_empty());
    let (mut graph, node) = graph_of("f(x)", &[1.0, 2.0], &[0.0, 3.0], Interpolation::Linear);
    let mut kinks = Kinks::new(&mut graph, &[node]);
    assert_eq!([0.5, 1.25, 1.75, 2.5].map(|x| kinks.at(0.0, &[x, 0.0, 0.0])[0]), [-0.5, 0.25, 0.25, -0.5]);
}

#[test]
fn tables_are_called_with_one_argument_and_jump_with_no_state() {
    let (mut graph, mut scope) = space();
    scope.solve_for(1);
    scope.bind_table("load", Table::new(&X, &Y, Interpolation::Previous).unwrap()).unwrap();
    assert!(scope.bind("load", graph.input(3)).is_err());
    assert!(scope.bind_table("x", Table::new(&X, &Y, Interpolation::Linear).unwrap()).is_err());
    assert!(scope.bind_table("floor", Table::new(&X, &Y, Interpolation::Linear).unwrap()).is_err());
    let mut refused = |text: &str| graph.parse(text, &scope).unwrap_err();
    assert_eq!(refused("2*load").message, "expected `(` and the argument of the table `load`, found the end");
    assert_eq!(refused("load(t, 1)").message, "the table `load` takes one argument, found 2");
    assert_eq!(refused("load(x)").code, "jump_of_unknown");
    assert_eq!(refused("laod(t)").did_you_mean.as_deref(), Some("load"));
    assert!(graph.parse("load(2*t)*x", &scope).is_ok());
}

#[test]
fn copies_of_a_graph_keep_their_tables_and_numbers_fold() {
    let (graph, node) = graph_of("f(0.5) + f(t)", &X, &Y, Interpolation::Linear);
    let (below, nodes) = graph.below(&[node]);
    assert_eq!(evaluate(&below, &nodes, [1.0, 0.0, 0.0, 0.0]), [5.0]);
    assert_eq!(Tape::compile(&graph, &[node]).instructions(), 2);
    let (mut graph, node) = graph_of("f(x)*t", &X, &Y, Interpolation::Linear);
    let number = graph.substitute(node, &[(1, 2.5), (0, 3.0)]).unwrap();
    assert_eq!(graph.value(number), Some(6.0));
}

/// Generates points of a table, and the ends of an interval with points between them.
fn cases() -> impl Strategy<Value = (Vec<(f64, f64)>, [f64; 2], Vec<f64>)> {
    let points = prop::collection::vec((0.01..2.0f64, -3.0..3.0f64), 2..40);
    (points, prop::array::uniform2(-1.0..40.0f64), prop::collection::vec(0.0..=1.0f64, 20))
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 3_000, failure_persistence: None, ..ProptestConfig::default() })]

    #[test]
    fn enclosures_hold_tables_and_their_derivatives_tightly((points, ends, shares) in cases()) {
        let mut x = 0.0;
        let (x, y): (Vec<f64>, Vec<f64>) = points.into_iter().map(|(width, y)| { x += width; (x, y) }).unzip();
        let (lo, hi) = (ends[0].min(ends[1]), ends[0].max(ends[1]));
        for interpolation in [Interpolation::Linear, Interpolation::Pchip, Interpolation::Previous] {
            let (mut graph, node) = graph_of("f(x)", &x, &y, interpolation);
            let mut nodes = vec![node];
            nodes.extend(graph.gradient(node).unwrap().into_iter().map(|(_, slope)| slope));
            let tape = Tape::compile(&graph, &nodes);
            let zero = Interval::point(0.0);
            let mut ranges = vec![Interval::EMPTY; nodes.len()];
            let rest = [Interval::new(lo, hi), zero, zero];
            tape.enclose(zero, &rest, &mut IntervalWorkspace::new(&tape), &mut ranges);
            let knots = x.iter().copied().filter(|knot| (lo..=hi).contains(knot));
            let places = shares.iter().map(|share| (lo + share * (hi - lo)).clamp(lo, hi)).chain([lo, hi]).chain(knots);
            let (mut least, mut most) = (f64::INFINITY, f64::NEG_INFINITY);
            for place in places {
                let values = evaluate(&graph, &nodes, [0.0, place, 0.0, 0.0]);
                for (value, range) in values.iter().zip(&ranges) {
                    prop_assert!(range.contains(*value), "{interpolation:?} at {place}: {value} not in {range:?}");
                }
                (least, most) = (least.min(values[0]), most.max(values[0]));
            }
            // All extrema of the table are at its points or at ends of the interval; a jump occurs at the upper end at
            // the latest.
            prop_assert!(ranges[0].lo >= least - 1e-12 && ranges[0].hi <= most + 1e-12, "{interpolation:?}: {:?}", ranges[0]);
        }
    }
}
