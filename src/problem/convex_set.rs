//! The convex set `K`, a product of intervals `[l_i, u_i]`; an end at infinity is absent.

/// `K = [l_1, u_1] x .. x [l_m, u_m]`, with `-inf <= l_i <= u_i <= inf`.
#[derive(Clone, Debug, PartialEq)]
pub struct ConvexSet {
    /// The lower ends, `m` of them.
    pub lower: Vec<f64>,
    /// The upper ends, `m` of them.
    pub upper: Vec<f64>,
}

impl ConvexSet {
    /// The whole space of `m` dimensions.
    pub fn free(m: usize) -> Self {
        Self { lower: vec![f64::NEG_INFINITY; m], upper: vec![f64::INFINITY; m] }
    }

    /// The nonnegative orthant of `m` dimensions.
    pub fn nonnegative(m: usize) -> Self {
        Self { lower: vec![0.0; m], upper: vec![f64::INFINITY; m] }
    }

    /// `m`, the dimension of the space that `K` lies in.
    pub fn dimension(&self) -> usize {
        self.lower.len()
    }

    /// Whether component `i` has no bound at all.
    pub fn is_free(&self, i: usize) -> bool {
        self.lower[i] == f64::NEG_INFINITY && self.upper[i] == f64::INFINITY
    }

    /// Whether there is a point in `K`; false also where an end is NaN.
    pub fn is_nonempty(&self) -> bool {
        let nonempty =
            |(&lower, &upper): (&f64, &f64)| lower <= upper && lower < f64::INFINITY && upper > -f64::INFINITY;
        self.lower.iter().zip(&self.upper).all(nonempty)
    }

    /// Component `i` of the projection of a point whose component is `z`. NaN stays NaN.
    pub fn project(&self, i: usize, z: f64) -> f64 {
        if z < self.lower[i] {
            self.lower[i]
        } else if z > self.upper[i] {
            self.upper[i]
        } else {
            z
        }
    }

    /// `max_i |z_i - P_K(z - G)_i|`, the natural-map residual: zero exactly at a solution of the variational
    /// inequality. NaN if any entry is (Facchinei and Pang 2003, section 1.5).
    pub fn natural_residual(&self, z: &[f64], g: &[f64]) -> f64 {
        let mut residual = 0.0_f64;
        for (i, (&z, &g)) in z.iter().zip(g).enumerate() {
            let r = (z - self.project(i, z - g)).abs();
            if r.is_nan() {
                return r;
            }
            residual = residual.max(r);
        }
        residual
    }
}

#[cfg(test)]
mod tests {
    use super::*;
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
        ConvexSet { lower: vec![lower], upper: vec![upper] }
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
}
