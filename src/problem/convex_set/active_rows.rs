//! The projection onto a polyhedron by the dual active-set method of Goldfarb and Idnani (1983, *A numerically stable
//! dual method for solving strictly convex quadratic programs*), whose Hessian is the identity here:
//!
//! ```text
//! min 1/2 |p - x|^2,  A p <= b:    p = x - N^T l,    N p = b_N,    l >= 0
//! ```
//!
//! From `p = x` the most violated row enters, rows whose multiplier falls to zero make way, until none is violated. `N`
//! is kept as `N^T = Q R` by Gram-Schmidt, twice over, so that `Q` stays orthonormal.

use super::ball::norm;
use super::polyhedron::{Polyhedron, dot};

/// The rows that a projection ended on, with its workspace.
#[derive(Clone, Debug, Default)]
pub struct ActiveRows {
    /// The rows, in the order in which they entered.
    rows: Vec<usize>,
    /// Their multipliers.
    multipliers: Vec<f64>,
    /// `Q`, column by column, and `R`, each column padded to the dimension.
    q: Vec<f64>,
    r: Vec<f64>,
    /// The coefficients of the entering row in the active ones, and what is left of it.
    coefficients: Vec<f64>,
    rest: Vec<f64>,
}

/// A violation below this fraction of its terms is rounding.
const NOISE: f64 = 1e-14;

/// A row is dependent on the active ones if less than this is left of its unit length.
const DEPENDENT: f64 = 1e-10;

impl ActiveRows {
    /// The rows of the last projection.
    pub fn rows(&self) -> &[usize] {
        &self.rows
    }

    /// Projects `x` onto `{z : A z <= scale b}` into `p`; the recession cone is that of scale zero. False if the set
    /// is empty; NaN where `x` has one.
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

    /// `x - Q Q^T x` in place: onto the directions in which the active rows leave free.
    pub(super) fn restrict(&self, x: &mut [f64]) {
        let n = x.len();
        for q in self.q.chunks_exact(n.max(1)).take(self.rows.len()) {
            let along = dot(q, x);
            for (x, q) in x.iter_mut().zip(q) {
                *x -= along * q;
            }
        }
    }

    /// Whether `d` is a nonnegative combination of the active rows, to rounding.
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

    /// Writes a row as `N^T c + rest` with `rest` orthogonal to the first `k` active rows, and returns its length.
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
        // The new column of R, kept for when the row enters.
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

    /// The active row whose multiplier falls to zero first as that of the entering row grows, and by how much it may.
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

    /// Column `k` of `Q`, and the diagonal of `R` there, from the row resolved last.
    fn write_column(&mut self, k: usize, left: f64) {
        let n = self.rest.len();
        for (q, rest) in self.q[k * n..][..n].iter_mut().zip(&self.rest) {
            *q = rest / left;
        }
        self.r[k * n + k] = left;
    }

    /// Takes a row out; those that entered after it are orthogonalised anew.
    fn leave(&mut self, set: &Polyhedron, place: usize) {
        self.multipliers.remove(place);
        self.rows.remove(place);
        for k in place..self.rows.len() {
            let left = self.resolve(set.normal(self.rows[k]), k);
            self.write_column(k, left);
        }
    }
}
