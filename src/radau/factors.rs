//! Factors of the matrices of the transformed stage equations,
//!
//! ```text
//! (gamma/h) diag(M, 0) - Phi_y    and    ((alpha + i beta)/h) diag(M, 0) - Phi_y,
//! ```
//!
//! one real matrix if `s` is odd, and one complex matrix for each pair of eigenvalues of `A^-1` (Hairer and Wanner
//! 1996, IV.8). The rows of the rates are multiplied by the power of two next to `h`: a complex division squares its
//! divisor, and the square of `1/h` could overflow in units of time far from one.

use super::face::ActiveFace;
use super::layout::{Layout, Storage};
use super::system::System;
use super::tableau::Tableau;
use factorisation::{ComplexLu, DenseLu, Number, SparseLu, SparseMatrix};
use nalgebra::Complex;
use problem::Control;
use std::sync::Arc;

/// LU factors of the matrices of the transformed stage equations for one step size; their memory is reused for the
/// next step size.
pub struct Factors {
    layout: Arc<Layout>,
    negative_jacobian: Vec<f64>,
    /// Power of two by which each row of the matrices is multiplied.
    scale: Vec<f64>,
    real: Option<Lu<f64>>,
    complex: Vec<PairLu>,
}

impl Factors {
    /// Allocates the factors of the stage equations of `system`; the memory of factors is allocated when they are first
    /// computed.
    pub fn new(system: &System<'_>) -> Self {
        let layout = Arc::clone(&system.layout);
        Self {
            negative_jacobian: vec![0.0; layout.places],
            scale: vec![1.0; layout.unknowns],
            layout,
            real: None,
            complex: Vec::new(),
        }
    }

    /// Factorises the matrices of the transformed stage equations for step size `h` on an active face of `K`, from the
    /// current derivatives of `system`.
    pub fn compute(&mut self, system: &System<'_>, face: &ActiveFace, tableau: &Tableau, h: f64) {
        let Self { layout, negative_jacobian, scale, real, complex } = self;
        system.negative_jacobian(face, negative_jacobian);
        let unit = power_of_two(h);
        for (scale, &is_rate) in scale.iter_mut().zip(&layout.is_rate) {
            *scale = if is_rate { unit } else { 1.0 };
        }
        layout.multiply_rows(scale, negative_jacobian);
        let steps = unit / h;
        match tableau.gamma {
            None => *real = None,
            Some(gamma) => {
                let lu = real.get_or_insert_with(|| Lu::new(layout));
                lu.factorise(layout, negative_jacobian, gamma * steps, system.outside);
            }
        }
        for (k, &pair) in tableau.pairs.iter().enumerate() {
            if k == complex.len() {
                complex.push(PairLu::new(layout));
            }
            complex[k].factorise(layout, negative_jacobian, pair * steps, system.outside);
        }
    }

    /// Solves the linear system with the real matrix of the transformed stage equations, overwriting the right-hand
    /// side; returns false if the matrix is singular, or the method has none.
    pub fn solve_real(&mut self, right: &mut [f64]) -> bool {
        for (right, scale) in right.iter_mut().zip(&self.scale) {
            *right *= scale;
        }
        self.real.as_mut().is_some_and(|lu| lu.solve(right))
    }

    /// Solves the linear system with the complex matrix of pair `k` of eigenvalues, overwriting the right-hand side,
    /// real and imaginary parts apart; returns false if the matrix is singular.
    pub fn solve_pair(&mut self, k: usize, re: &mut [f64], im: &mut [f64]) -> bool {
        for ((re, im), scale) in re.iter_mut().zip(&mut *im).zip(&self.scale) {
            *re *= scale;
            *im *= scale;
        }
        self.complex[k].solve(re, im)
    }
}

/// Returns the largest power of two up to a positive number `x`; multiplication by a power of two is exact.
fn power_of_two(x: f64) -> f64 {
    f64::from_bits(x.to_bits() & f64::INFINITY.to_bits()).max(f64::MIN_POSITIVE)
}

/// LU factors of one complex matrix; those of a small dense matrix store real and imaginary parts apart.
enum PairLu {
    Small(ComplexLu),
    /// Factors of a large or sparse complex matrix, and memory for a right-hand side.
    Other(Box<Lu<Complex<f64>>>, Vec<Complex<f64>>),
}

impl PairLu {
    fn new(layout: &Layout) -> Self {
        match layout.storage {
            Storage::Dense if layout.unknowns <= ComplexLu::MOST => Self::Small(ComplexLu::new(layout.unknowns)),
            _ => Self::Other(Box::new(Lu::new(layout)), vec![Complex::new(0.0, 0.0); layout.unknowns]),
        }
    }

    /// Factorises the complex matrix `shift diag(M, 0) - Phi_y` of a pair of eigenvalues, with its rows scaled.
    fn factorise(&mut self, layout: &Layout, negative_jacobian: &[f64], shift: Complex<f64>, outside: &Control) {
        match self {
            Self::Small(factors) => {
                let (re, im) = factors.entries();
                re.copy_from_slice(negative_jacobian);
                im.fill(0.0);
                for &(place, value) in &layout.mass {
                    re[place] += shift.re * value;
                    im[place] += shift.im * value;
                }
                factors.factorise();
            }
            Self::Other(factors, _) => factors.factorise(layout, negative_jacobian, shift, outside),
        }
    }

    fn solve(&mut self, re: &mut [f64], im: &mut [f64]) -> bool {
        match self {
            Self::Small(factors) => factors.solve(re, im),
            Self::Other(factors, right) => {
                for (right, (re, im)) in right.iter_mut().zip(re.iter().zip(&*im)) {
                    *right = Complex::new(*re, *im);
                }
                let is_solved = factors.solve(right);
                for (right, (re, im)) in right.iter().zip(re.iter_mut().zip(im)) {
                    (*re, *im) = (right.re, right.im);
                }
                is_solved
            }
        }
    }
}

/// LU factors of one matrix of the transformed stage equations, dense or sparse.
#[expect(clippy::large_enum_variant, reason = "one of them lives as long as its stepper; a box would only add a hop")]
enum Lu<T: Number> {
    Dense(DenseLu<T>),
    Sparse {
        matrix: SparseMatrix<T>,
        factors: SparseLu<T>,
    },
    /// No factors of the matrix: memory for them was insufficient.
    None,
}

impl<T: Number + Send + Sync + 'static> Lu<T> {
    fn new(layout: &Layout) -> Self {
        match &layout.storage {
            Storage::Dense => Self::Dense(DenseLu::new(layout.unknowns)),
            Storage::Sparse { pattern, analysis } => match SparseLu::new(analysis) {
                Some(factors) => {
                    let zeros = vec![T::from(0.0); layout.places];
                    Self::Sparse { matrix: SparseMatrix::new(pattern.clone(), zeros), factors }
                }
                None => Self::None,
            },
        }
    }

    /// Factorises the matrix `shift diag(M, 0) - Phi_y` of the stage equations with its rows scaled.
    fn factorise(&mut self, layout: &Layout, negative_jacobian: &[f64], shift: T, outside: &Control) {
        let fill = |entries: &mut [T]| {
            for (entry, &value) in entries.iter_mut().zip(negative_jacobian) {
                *entry = T::from(value);
            }
            for &(place, value) in &layout.mass {
                entries[place] += shift * T::from(value);
            }
        };
        match self {
            Self::Dense(factors) => {
                fill(factors.entries());
                factors.factorise();
            }
            Self::Sparse { matrix, factors } => {
                fill(matrix.val_mut());
                factors.factorise_unless(matrix, || outside.poll().is_some());
            }
            Self::None => {}
        }
    }

    fn solve(&mut self, right: &mut [T]) -> bool {
        match self {
            Self::Dense(factors) => factors.solve(right),
            Self::Sparse { factors, .. } => factors.solve(right),
            Self::None => false,
        }
    }
}
