//! Factors of the matrices of the transformed stage equations,
//!
//! ```text
//! (gamma/h) diag(M, 0) - Phi_y    and    ((alpha + i beta)/h) diag(M, 0) - Phi_y,
//! ```
//!
//! one real where `s` is odd and one complex for each pair of eigenvalues of `A^-1` (Hairer and Wanner 1996, IV.8).

use super::tableau::Tableau;
use nalgebra::{Complex, DMatrix, DVectorViewMut, Dyn, LU};

/// LU factors for one step size.
#[derive(Debug, Default)]
pub struct Factors {
    real: Option<LU<f64, Dyn, Dyn>>,
    complex: Vec<LU<Complex<f64>, Dyn, Dyn>>,
}

impl Factors {
    /// Factorises for step size `h`, given `diag(M, 0)` and `-Phi_y`.
    pub fn compute(tableau: &Tableau, h: f64, mass: &DMatrix<f64>, negative_jacobian: &DMatrix<f64>) -> Self {
        let real = tableau.gamma.map(|gamma| (negative_jacobian + mass * (gamma / h)).lu());
        let complex = tableau
            .pairs
            .iter()
            .map(|&pair| negative_jacobian.zip_map(mass, |j, m| Complex::new(j, 0.0) + pair / h * m).lu())
            .collect();
        Self { real, complex }
    }

    /// Solves with the real matrix in place; false if it is singular or there is none.
    pub fn solve_real(&self, right: &mut [f64]) -> bool {
        let n = right.len();
        self.real.as_ref().is_some_and(|lu| lu.solve_mut(&mut DVectorViewMut::from_slice(right, n)))
    }

    /// Solves with the complex matrix of pair `k` in place; false if it is singular.
    pub fn solve_pair(&self, k: usize, right: &mut [Complex<f64>]) -> bool {
        let n = right.len();
        self.complex[k].solve_mut(&mut DVectorViewMut::from_slice(right, n))
    }
}
