//! Douglas-Rachford splitting of `0 in S (A z + q) + N_K(z)`,
//!
//! ```text
//! x = (I + S A)^-1 (y - S q),    z = P_K(2 x - y),    y <- y + z - x
//! ```
//!
//! which converges for every monotone `A` if a solution exists, at a linear rate that may be slow (Lions and Mercier
//! 1979, *Splitting algorithms for the sum of two nonlinear operators*). `S` is one positive scale for each block.

use super::AffineVi;
use nalgebra::DMatrix;
use problem::Workspace;

/// The Douglas-Rachford iteration on one affine variational inequality.
#[derive(Debug)]
pub(super) struct Splitting {
    inverse: DMatrix<f64>,
    y: Vec<f64>,
    x: Vec<f64>,
    work: Workspace,
}

impl Splitting {
    /// Starts the Douglas-Rachford iteration at `z`, with the value `w = A z + q`. Returns `None` if `I + S A` is
    /// singular.
    pub fn new(vi: &AffineVi<'_>, scale: &[f64], z: &[f64], w: &[f64]) -> Option<Self> {
        let m = z.len();
        let resolvent = DMatrix::from_fn(m, m, |i, j| f64::from(i == j) + scale[i] * vi.matrix[(i, j)]);
        let inverse = resolvent.try_inverse()?;
        let y = z.iter().zip(w).zip(scale).map(|((z, w), s)| z + s * w).collect();
        Some(Self { inverse, y, x: vec![0.0; m], work: Workspace::default() })
    }

    /// Makes `times` Douglas-Rachford iterations, and writes the projected point `P_K(2 x - y)` of the last one to `z`.
    pub fn iterate(&mut self, vi: &AffineVi<'_>, scale: &[f64], times: usize, z: &mut [f64]) {
        for _ in 0..times {
            self.x.fill(0.0);
            for (j, column) in self.inverse.column_iter().enumerate() {
                let factor = self.y[j] - scale[j] * vi.q[j];
                for (x, a) in self.x.iter_mut().zip(column.iter()) {
                    *x += factor * a;
                }
            }
            for ((z, x), y) in z.iter_mut().zip(&self.x).zip(&self.y) {
                *z = 2.0 * x - y;
            }
            vi.set.project_all(z, &mut self.work);
            for ((y, z), x) in self.y.iter_mut().zip(&*z).zip(&self.x) {
                *y += z - x;
            }
        }
    }
}
