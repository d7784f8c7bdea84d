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
