//! The D-gap function, a merit function for every closed convex `K`:
//!
//! ```text
//! g(z) = f_a(z) - f_b(z),    f_c(z) = max over y in K of <w, z - y> - c/2 |z - y|^2,    0 < a < b
//! ```
//!
//! The maximiser is `p_c = P_K(z - w/c)`. `g` is nonnegative, zero exactly at solutions, continuously differentiable
//! with
//!
//! ```text
//! grad g = (dw/dz)^T (p_b - p_a) - a (z - p_a) + b (z - p_b)
//! ```
//!
//! and lies between `(b - a)/2 |z - p_b|^2` and `(b - a)/2 |z - p_a|^2` (Peng 1997, *Equivalence of variational
//! inequality problems to unconstrained minimization*; Fukushima 1992 for `f_a`). Lengths are measured as
//! `|z|^2 = sum z_i^2 / s_i`, with one positive scale `s` for each block, so that the projection remains Euclidean.

use problem::{ConvexSet, Workspace};

/// The parameters `b` (`NEAR`) and `a` (`FAR`) of the D-gap function; any values with `0 < a < b` serve.
const NEAR: f64 = 2.0;
const FAR: f64 = 0.5;

/// The D-gap function, with its scales and the two projections of the last evaluation.
#[derive(Debug, Default)]
pub(super) struct Gap {
    /// The scale `s` of squared lengths, one entry for each component, equal within a block.
    pub scale: Vec<f64>,
    far: Vec<f64>,
    near: Vec<f64>,
    work: Workspace,
}

impl Gap {
    /// Evaluates the D-gap function `g` at `z` with the value `w = A z + q`.
    pub fn value(&mut self, set: &ConvexSet, z: &[f64], w: &[f64]) -> f64 {
        let Self { scale, far, near, work } = self;
        for (p, c) in [(&mut *far, FAR), (&mut *near, NEAR)] {
            p.clear();
            p.extend(z.iter().zip(w).zip(&*scale).map(|((z, w), s)| z - s * w / c));
            set.project_all(p, work);
        }
        let mut sum = 0.0;
        for i in 0..z.len() {
            let (from_far, from_near) = (z[i] - far[i], z[i] - near[i]);
            sum +=
                w[i] * (near[i] - far[i]) + 0.5 * (NEAR * from_near * from_near - FAR * from_far * from_far) / scale[i];
        }
        sum
    }

    /// Writes the gradient of the D-gap function at the last evaluation; `transposed` gives component `j` of
    /// `(dw/dz)^T v`.
    pub fn gradient(&mut self, z: &[f64], transposed: impl Fn(usize, &[f64]) -> f64, out: &mut [f64]) {
        for (i, out) in out.iter_mut().enumerate() {
            *out = (NEAR * (z[i] - self.near[i]) - FAR * (z[i] - self.far[i])) / self.scale[i];
        }
        for (near, far) in self.near.iter_mut().zip(&self.far) {
            *near -= far;
        }
        for (j, out) in out.iter_mut().enumerate() {
            *out += transposed(j, &self.near);
        }
    }
}
