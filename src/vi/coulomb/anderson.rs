//! Anderson's acceleration (Anderson 1965; Walker and Ni 2011, *Anderson acceleration for fixed-point iterations*) of
//! the map `G` that one Gauss-Seidel sweep makes of impulses:
//!
//! ```text
//! f_k = G(x_k) - x_k,    gamma = argmin | f_k - F gamma |,    x_{k+1} = G(x_k) - (X + F) gamma
//! ```
//!
//! with the last changes of `x` and `f` as the columns of `X` and `F`. While the contact states stay, `G` is nearly linear
//! and this is nearly GMRES: sweeps grow with the square root of the condition number, not with the number itself.

use nalgebra::{DMatrix, DVector, Vector3};

/// Changes remembered. More of them hold on to contact states that are gone.
const MEMORY: usize = 5;

/// Directions that depend on the others to this accuracy are left out.
const DEPENDENT: f64 = 1e-10;

/// The memory of an iteration.
#[derive(Clone, Debug, Default)]
pub(super) struct Anderson {
    /// Changes of `f` and of `G(x)`, oldest overwritten first.
    changes_f: Vec<Vec<Vector3<f64>>>,
    changes_g: Vec<Vec<Vector3<f64>>>,
    /// The products of the changes of `f`.
    gram: [[f64; MEMORY]; MEMORY],
    last_f: Vec<Vector3<f64>>,
    last_g: Vec<Vector3<f64>>,
    /// Changes taken in all.
    taken: usize,
}

impl Anderson {
    /// Forgets all.
    pub fn clear(&mut self) {
        self.changes_f.clear();
        self.changes_g.clear();
        self.last_f.clear();
        self.taken = 0;
    }

    /// Replaces `x`, of which `g = G(x)` was made, by the next point to try.
    pub fn advance(&mut self, x: &mut [Vector3<f64>], g: &[Vector3<f64>]) {
        let f: Vec<Vector3<f64>> = g.iter().zip(&*x).map(|(g, x)| g - x).collect();
        if self.last_f.len() == f.len() {
            let place = self.taken % MEMORY;
            if self.changes_f.len() < MEMORY {
                self.changes_f.push(Vec::new());
                self.changes_g.push(Vec::new());
            }
            change(&f, &self.last_f, &mut self.changes_f[place]);
            change(g, &self.last_g, &mut self.changes_g[place]);
            for j in 0..self.changes_f.len() {
                let product = dot(&self.changes_f[place], &self.changes_f[j]);
                (self.gram[place][j], self.gram[j][place]) = (product, product);
            }
            self.taken += 1;
        }
        x.copy_from_slice(g);
        for (gamma, change) in self.mixture(&f).iter().zip(&self.changes_g) {
            for (x, change) in x.iter_mut().zip(change) {
                *x -= change * *gamma;
            }
        }
        self.last_g.clear();
        self.last_g.extend_from_slice(g);
        self.last_f = f;
    }

    /// `gamma`, by normal equations with unit diagonal.
    fn mixture(&self, f: &[Vector3<f64>]) -> DVector<f64> {
        let m = self.changes_f.len();
        let gram = &self.gram;
        let scale = DVector::from_fn(m, |i, _| if gram[i][i] > 0.0 { gram[i][i].sqrt().recip() } else { 0.0 });
        let right = DVector::from_fn(m, |i, _| scale[i] * dot(&self.changes_f[i], f));
        let scaled =
            DMatrix::from_fn(m, m, |i, j| gram[i][j] * scale[i] * scale[j] + if i == j { DEPENDENT } else { 0.0 });
        let solved = scaled.cholesky().map(|factor| factor.solve(&right));
        solved.map_or_else(|| DVector::zeros(m), |gamma| gamma.component_mul(&scale))
    }
}

fn change(new: &[Vector3<f64>], old: &[Vector3<f64>], into: &mut Vec<Vector3<f64>>) {
    into.clear();
    into.extend(new.iter().zip(old).map(|(a, b)| a - b));
}

fn dot(a: &[Vector3<f64>], b: &[Vector3<f64>]) -> f64 {
    a.iter().zip(b).map(|(a, b)| a.dot(b)).sum()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_slow_linear_iteration_ends_after_as_many_steps_as_it_has_rates() {
        // G(x) = d x + 1, component by component: fixed point 1 / (1 - d), plain iteration gains 1 % a step.
        let rates = [0.99, 0.9, 0.5];
        let map = |x: &Vector3<f64>| Vector3::from_fn(|i, _| rates[i] * x[i] + 1.0);
        let mut x = [Vector3::zeros()];
        let mut anderson = Anderson::default();
        for _ in 0..6 {
            let g = [map(&x[0])];
            anderson.advance(&mut x, &g);
        }
        for (x, rate) in x[0].iter().zip(rates) {
            assert!((x * (1.0 - rate) - 1.0).abs() < 1e-6, "{x} at {rate}");
        }
    }
}
