//! The projection `p` of a point `x` onto a polyhedron by the dual active-set method of Goldfarb and Idnani (1983, *A
//! numerically stable dual method for solving strictly convex quadratic programs*), with the identity as Hessian:
//!
//! ```text
//! min 1/2 |p - x|^2,  A p <= b:    p = x - N^T l,    N p = b_N,    l >= 0
//! ```
//!
//! Starting at `p = x`, the most violated row of `A p <= b` enters the active set, and rows whose multiplier `l`
//! falls to zero leave it, until no row is violated. The active rows `N` are factorised as `N^T = Q R` by
//! Gram-Schmidt with reorthogonalisation, so that `Q` stays orthonormal.

use super::ball::norm;
use super::polyhedron::{Polyhedron, dot};

/// The active rows of a polyhedron at the end of a projection, with the workspace of the dual active-set method.
#[derive(Clone, Debug, Default)]
pub struct ActiveRows {
    /// The indices of the active rows of the polyhedron, in the order in which they became active.
    rows: Vec<usize>,
    /// The multipliers of the active rows of the polyhedron, in the order of `rows`.
    multipliers: Vec<f64>,
    /// The orthonormal factor `Q` of the active rows `N` of the polyhedron (`N^T = Q R`), by columns.
    q: Vec<f64>,
    /// The triangular factor `R` of the active rows `N` of the polyhedron (`N^T = Q R`), by columns, each padded to the
    /// dimension of the space.
    r: Vec<f64>,
    /// The coefficients of the row of the polyhedron that enters the active set, as a linear combination of the active
    /// rows.
    coefficients: Vec<f64>,
    /// The component, orthogonal to the active rows, of the row of the polyhedron that enters the active set.
    rest: Vec<f64>,
}

/// Relative rounding error of a row `a^T p - b` of the polyhedron at a point `p`: violations below this fraction of
/// `|x| + |b|` are treated as zero, where `x` is the projected point.
const NOISE: f64 = 1e-14;

/// A row of the polyhedron, of unit length, is treated as linearly dependent on the active rows if its component
/// orthogonal to them is shorter than this threshold.
const DEPENDENT: f64 = 1e-10;

impl ActiveRows {
    /// Returns the indices of the rows of the polyhedron that were active at the end of the last projection.
    pub fn rows(&self) -> &[usize] {
        &self.rows
    }

    /// Writes the projection of `x` onto the polyhedron `{z : A z <= scale b}` to `p`; for `scale = 0` the set is the
    /// recession cone. Returns false if the set is empty. `p` is NaN if `x` is not finite.
    pub(super) fn project(&mut self, set: &Polyhedron, scale: f64, x: &[f64], p: &mut [f64]) -> bool {
        let n = set.dimension();
        self.reset(n);
        p.copy_from_slice(x);
        if !x.iter().all(|x| x.is_finite()) {
            p.fill(f64::NAN);
            return true;
        }
        let size = norm(x);
        for _ in 0..20 * (set.rows() + n) + 20 {
            let Some((row, mut violation)) = self.most_violated(set, scale, p, size) else { return true };
            let mut multiplier = 0.0;
            loop {
                let left = self.resolve(set.normal(row), self.rows.len());
                let full = if left > DEPENDENT { violation / (left * left) } else { f64::INFINITY };
                let (blocking, short) = self.first_to_leave();
                let step = full.min(short);
                if step == f64::INFINITY {
                    return false;
                }
                if left > DEPENDENT {
                    for (p, rest) in p.iter_mut().zip(&self.rest) {
                        *p -= step * rest;
                    }
                    violation -= step * left * left;
                }
                multiplier += step;
                for (l, c) in self.multipliers.iter_mut().zip(&self.coefficients) {
                    *l = (*l - step * c).max(0.0);
                }
                if full <= short {
                    self.enter(row, multiplier, left);
                    break;
                }
                self.leave(set, blocking);
            }
        }
        true
    }

    /// Projects `x` in place onto the null space of the polyhedron's active rows: `x - Q Q^T x` with their orthonormal
    /// basis `Q`.
    pub(super) fn restrict(&self, x: &mut [f64]) {
        let n = x.len();
        for q in self.q.chunks_exact(n.max(1)).take(self.rows.len()) {
            let along = dot(q, x);
            for (x, q) in x.iter_mut().zip(q) {
                *x -= along * q;
            }
        }
    }

    /// Returns whether the vector `d` is a nonnegative combination of the polyhedron's active rows, up to rounding.
    pub(super) fn generate(&mut self, d: &[f64]) -> bool {
        let noise = 1e-9 * norm(d);
        self.resolve(d, self.rows.len()) <= noise && self.coefficients.iter().all(|c| *c >= -noise)
    }

    fn reset(&mut self, n: usize) {
        self.rows.clear();
        self.multipliers.clear();
        self.q.resize(n * n, 0.0);
        self.r.resize(n * n, 0.0);
        self.rest.resize(n, 0.0);
        self.rows.reserve(n);
        self.multipliers.reserve(n);
        self.coefficients.reserve(n);
    }

    fn most_violated(&self, set: &Polyhedron, scale: f64, p: &[f64], size: f64) -> Option<(usize, f64)> {
        let mut worst = None;
        for i in (0..set.rows()).filter(|i| !self.rows.contains(i)) {
            let offset = scale * set.offset(i);
            let violation = dot(set.normal(i), p) - offset;
            let noise = NOISE * (size + offset.abs());
            if violation > noise && worst.is_none_or(|(_, largest)| violation > largest) {
                worst = Some((i, violation));
            }
        }
        worst
    }

    /// Decomposes a row of the polyhedron as `N^T c + rest`, with `N` the first `k` active rows and `rest` orthogonal
    /// to them; stores `c` and `rest`, and returns the length of `rest`.
    fn resolve(&mut self, row: &[f64], k: usize) -> f64 {
        let n = row.len();
        self.rest.copy_from_slice(row);
        self.coefficients.clear();
        self.coefficients.resize(k, 0.0);
        for _ in 0..2 {
            for (q, c) in self.q.chunks_exact(n.max(1)).zip(&mut self.coefficients) {
                let along = dot(q, &self.rest);
                *c += along;
                for (rest, q) in self.rest.iter_mut().zip(q) {
                    *rest -= along * q;
                }
            }
        }
        // Store the new column of the triangular factor `R` of the active rows, in case the row enters the active set.
        if k < n {
            self.r[k * n..k * n + k].copy_from_slice(&self.coefficients);
        }
        for i in (0..k).rev() {
            let (head, tail) = self.coefficients.split_at_mut(i + 1);
            let sum: f64 = tail.iter().enumerate().map(|(j, c)| self.r[(i + 1 + j) * n + i] * c).sum();
            head[i] = (head[i] - sum) / self.r[i * n + i];
        }
        norm(&self.rest)
    }

    /// Ratio test of the dual active-set method: returns the active row whose multiplier is the first to fall to zero
    /// as the multiplier of the entering row grows, and the growth at which it does.
    fn first_to_leave(&self) -> (usize, f64) {
        let mut first = (0, f64::INFINITY);
        for (i, (l, c)) in self.multipliers.iter().zip(&self.coefficients).enumerate() {
            if *c > 0.0 && l / c < first.1 {
                first = (i, l / c);
            }
        }
        first
    }

    fn enter(&mut self, row: usize, multiplier: f64, left: f64) {
        self.write_column(self.rows.len(), left);
        self.rows.push(row);
        self.multipliers.push(multiplier);
    }

    /// Writes column `k` of the factor `Q` of the active rows, and its diagonal entry of `R`, from the result of the
    /// last call of `resolve`; `left` is the length of the orthogonal component.
    fn write_column(&mut self, k: usize, left: f64) {
        let n = self.rest.len();
        for (q, rest) in self.q[k * n..][..n].iter_mut().zip(&self.rest) {
            *q = rest / left;
        }
        self.r[k * n + k] = left;
    }

    /// Removes a row from the active set, given by its position in the set, and orthogonalises the rows that entered
    /// after it anew.
    fn leave(&mut self, set: &Polyhedron, place: usize) {
        self.multipliers.remove(place);
        self.rows.remove(place);
        for k in place..self.rows.len() {
            let left = self.resolve(set.normal(self.rows[k]), k);
            self.write_column(k, left);
        }
    }
}
