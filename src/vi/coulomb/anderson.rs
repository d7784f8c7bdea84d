//! Anderson's acceleration (Anderson 1965; Walker and Ni 2011, *Anderson acceleration for fixed-point iterations*) of
//! the map `G` of impulses by one Gauss-Seidel sweep:
//!
//! ```text
//! f_k = G(x_k) - x_k,    gamma = argmin | f_k - F gamma |,    x_{k+1} = G(x_k) - (X + F) gamma
//! ```
//!
//! with the last changes of `x` and `f` as the columns of `X` and `F`. While the contact states do not change, `G` is
//! nearly linear and the iteration is nearly GMRES: the number of sweeps grows with the square root of the condition
//! number instead of the number itself. If `|f|` grows, the contact states have changed: the history is misleading
//! and is cleared, and the step is a plain sweep.

use nalgebra::{SMatrix, SVector, Vector3};

/// Number of changes in the history of Anderson's acceleration.
const MEMORY: usize = 3;

/// Regularisation of the Gram matrix of the recorded changes: changes that are linearly dependent on others to this
/// accuracy have no effect.
const DEPENDENT: f64 = 1e-10;

/// The history of Anderson's acceleration. Vectors are flat arrays of numbers, for fast sums and products.
#[derive(Clone, Debug, Default)]
pub(super) struct Anderson {
    /// Changes of the difference `f = G(x) - x` and of the result `G(x)` of a sweep from one iteration to the next;
    /// the oldest is overwritten first.
    changes_f: [Vec<f64>; MEMORY],
    changes_g: [Vec<f64>; MEMORY],
    /// The Gram matrix of the changes of `f = G(x) - x`.
    gram: SMatrix<f64, MEMORY, MEMORY>,
    /// The total number of changes recorded since the history was cleared.
    taken: usize,
    /// The last point `x`, the result `g` of a sweep from it, and the difference `f = g - x`.
    x: Vec<f64>,
    g: Vec<f64>,
    f: Vec<f64>,
    last_f: Vec<f64>,
    last_g: Vec<f64>,
    /// The squared norm of the difference `f = g - x` at the last point.
    size: Option<f64>,
}

impl Anderson {
    /// Clears the history, and starts from the impulses `x`.
    pub fn start(&mut self, x: &[Vector3<f64>]) {
        self.forget();
        self.size = None;
        flatten(x, &mut self.x);
    }

    fn forget(&mut self) {
        self.taken = 0;
        self.last_f.clear();
    }

    /// Replaces `r`, which is the result `G(x)` of a sweep from the last point `x`, by the next point to try.
    pub fn advance(&mut self, r: &mut [Vector3<f64>]) {
        flatten(r, &mut self.g);
        subtract(&self.g, &self.x, &mut self.f);
        let size = dot(&self.f, &self.f);
        self.x.copy_from_slice(&self.g);
        if self.size.replace(size).is_some_and(|last| size > last) {
            self.forget();
            return;
        }
        if self.last_f.len() == self.f.len() {
            self.take_changes();
        }
        for (gamma, change) in self.mixture().iter().zip(&self.changes_g[..self.taken.min(MEMORY)]) {
            self.x.iter_mut().zip(change).for_each(|(x, change)| *x -= change * gamma);
        }
        for (r, flat) in r.iter_mut().zip(self.x.chunks_exact(3)) {
            *r = Vector3::new(flat[0], flat[1], flat[2]);
        }
        std::mem::swap(&mut self.g, &mut self.last_g);
        std::mem::swap(&mut self.f, &mut self.last_f);
    }

    fn take_changes(&mut self) {
        let place = self.taken % MEMORY;
        subtract(&self.f, &self.last_f, &mut self.changes_f[place]);
        subtract(&self.g, &self.last_g, &mut self.changes_g[place]);
        self.taken += 1;
        for j in 0..self.taken.min(MEMORY) {
            let product = dot(&self.changes_f[place], &self.changes_f[j]);
            (self.gram[(place, j)], self.gram[(j, place)]) = (product, product);
        }
    }

    /// Computes the coefficients `gamma` of the recorded changes by normal equations with unit diagonal; they are
    /// zero for changes not yet recorded.
    fn mixture(&self) -> SVector<f64, MEMORY> {
        let count = self.taken.min(MEMORY);
        let is_change = |i: usize| i < count && self.gram[(i, i)] > 0.0;
        let scale: SVector<f64, MEMORY> =
            SVector::from_fn(|i, _| if is_change(i) { self.gram[(i, i)].sqrt().recip() } else { 0.0 });
        let right =
            SVector::from_fn(|i, _| if is_change(i) { scale[i] * dot(&self.changes_f[i], &self.f) } else { 0.0 });
        let scaled: SMatrix<f64, MEMORY, MEMORY> =
            SMatrix::from_fn(|i, j| match (is_change(i) && is_change(j), i == j) {
                (true, true) => 1.0 + DEPENDENT,
                (true, false) => self.gram[(i, j)] * scale[i] * scale[j],
                (false, true) => 1.0,
                (false, false) => 0.0,
            });
        let solved = scaled.cholesky().map(|factor| factor.solve(&right));
        solved.map_or_else(SVector::zeros, |gamma| gamma.component_mul(&scale))
    }
}

fn flatten(v: &[Vector3<f64>], into: &mut Vec<f64>) {
    into.resize(3 * v.len(), 0.0);
    for (flat, v) in into.chunks_exact_mut(3).zip(v) {
        flat.copy_from_slice(v.as_slice());
    }
}

fn subtract(a: &[f64], b: &[f64], into: &mut Vec<f64>) {
    into.resize(a.len(), 0.0);
    for ((difference, a), b) in into.iter_mut().zip(a).zip(b) {
        *difference = a - b;
    }
}

/// Number of independent partial sums of a scalar product, for instruction-level parallelism.
const LANES: usize = 8;

fn dot(a: &[f64], b: &[f64]) -> f64 {
    let mut sums = [0.0; LANES];
    let (a, b) = (a.chunks_exact(LANES), b.chunks_exact(LANES));
    let rest: f64 = a.remainder().iter().zip(b.remainder()).map(|(a, b)| a * b).sum();
    for (a, b) in a.zip(b) {
        for (sum, (a, b)) in sums.iter_mut().zip(a.iter().zip(b)) {
            *sum += a * b;
        }
    }
    rest + sums.iter().sum::<f64>()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_slow_linear_iteration_ends_after_as_many_steps_as_it_has_rates() {
        // The map G(x) = d x + 1, component by component, has the fixed point 1 / (1 - d); plain iteration reduces
        // the error by 1 % a step.
        let rates = [0.99, 0.9, 0.5];
        let map = |x: &Vector3<f64>| Vector3::from_fn(|i, _| rates[i] * x[i] + 1.0);
        let mut x = [Vector3::zeros()];
        let mut anderson = Anderson::default();
        anderson.start(&x);
        for _ in 0..6 {
            x = [map(&x[0])];
            anderson.advance(&mut x);
        }
        for (x, rate) in x[0].iter().zip(rates) {
            assert!((x * (1.0 - rate) - 1.0).abs() < 1e-6, "{x} at {rate}");
        }
    }

    #[test]
    fn a_point_that_is_farther_off_than_the_last_makes_the_next_step_a_plain_one() {
        let mut anderson = Anderson::default();
        let mut x = [Vector3::zeros()];
        anderson.start(&x);
        for step in [1.0, 0.5, 10.0] {
            let g = [x[0] + Vector3::repeat(step)];
            x = g;
            anderson.advance(&mut x);
            // In the second step of Anderson's acceleration, the secant through two differences extrapolates to twice
            // the distance. It is used, since the differences have become smaller.
            assert_eq!(x == g, step != 0.5);
        }
    }
}
