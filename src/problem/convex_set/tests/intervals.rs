use crate::ConvexSet;
use proptest::prelude::*;

fn interval() -> impl Strategy<Value = (f64, f64)> {
    let end = -5.0..5.0;
    prop_oneof![
        Just((f64::NEG_INFINITY, f64::INFINITY)),
        end.clone().prop_map(|lower| (lower, f64::INFINITY)),
        end.clone().prop_map(|upper| (f64::NEG_INFINITY, upper)),
        end.clone().prop_map(|point| (point, point)),
        (end.clone(), end).prop_map(|(a, b): (f64, f64)| (a.min(b), a.max(b))),
    ]
}

fn set(lower: f64, upper: f64) -> ConvexSet {
    ConvexSet::intervals(vec![lower], vec![upper])
}

proptest! {
    #![proptest_config(ProptestConfig { failure_persistence: None, ..Default::default() })]

    #[test]
    fn the_projection_is_the_nearest_point((lower, upper) in interval(), z in -9.0..9.0, other in -9.0..9.0) {
        let k = set(lower, upper);
        let (p, y) = (k.project(0, z), k.project(0, other));
        prop_assert!(lower <= p && p <= upper);
        prop_assert_eq!(k.project(0, p), p);
        prop_assert!((p - y).abs() <= (z - other).abs());
        prop_assert!((z - p) * (y - p) <= 0.0);
    }

    #[test]
    fn the_residual_vanishes_exactly_where_no_direction_descends(
        (lower, upper) in interval(), z in -9.0..9.0, g in prop_oneof![Just(0.0), -9.0..9.0]
    ) {
        let k = set(lower, upper);
        let z = k.project(0, z);
        let descends = [-1e-3, 1e-3].iter().any(|d| g * (k.project(0, z + d) - z) < 0.0);
        prop_assert_eq!(k.natural_residual(&[z], &[g]) > 1e-12, descends);
    }
}

#[test]
fn the_residual_keeps_a_nan() {
    let k = ConvexSet::nonnegative(2);
    assert!(k.natural_residual(&[1.0, 1.0], &[f64::NAN, 0.0]).is_nan());
    assert!(k.natural_residual(&[f64::NAN, 1.0], &[0.0, 9.0]).is_nan());
}

#[test]
fn intervals_without_a_point_are_empty() {
    assert!(ConvexSet::free(3).is_nonempty() && set(1.0, 1.0).is_nonempty());
    let inf = f64::INFINITY;
    for (lower, upper) in [(1.0, 0.0), (f64::NAN, 0.0), (0.0, f64::NAN), (inf, inf), (-inf, -inf)] {
        assert!(!set(lower, upper).is_nonempty());
    }
}
