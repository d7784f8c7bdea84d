//! The equations for the consistent variables of a large system, with the rates `x'` kept as unknowns so that nothing
//! fills in: if `z - step` are the new variables,
//!
//! ```text
//! M x' + B step = F,    D_i step = G_i  where row i of D is not zero,    C_i x' = -(G_t)_i  where it is
//! ```

use super::super::system::System;
use factorisation::{Analysis, SparseLu, SparseMatrix};
use faer::sparse::{SymbolicSparseColMat, Triplet};
use problem::Mass;

/// Largest error with which the factors of a regular mass matrix `M` reproduce a vector of ones; beyond it, `M` counts
/// as singular.
const REGULAR: f64 = 1e-6;

pub(super) struct Sparse {
    /// Matrix of the equations for the consistent variables, stored on the pattern of the stage equations, which
    /// contains its own pattern.
    matrix: SparseMatrix,
    factors: SparseLu<f64>,
    /// Values of the factorised matrix: the factors are reused if the values have not changed.
    factored: Vec<f64>,
    right: Vec<f64>,
    is_inside: Vec<bool>,
    /// Whether each row of `D = G_z` has a nonzero entry in the pattern of derivatives.
    is_direct: Vec<bool>,
}

impl Sparse {
    /// Allocates the solver for the consistent variables of `system`; returns `None` if the mass matrix `M` is
    /// singular, or memory is insufficient.
    pub fn new(system: &System<'_>, pattern: &SymbolicSparseColMat<usize>, analysis: &Analysis) -> Option<Self> {
        let variables = system.unknowns - system.states;
        if let Mass::Constant(mass) = system.mass()
            && !is_regular(system.states, mass)
        {
            return None;
        }
        Some(Self {
            matrix: SparseMatrix::new(pattern.clone(), vec![0.0; system.layout.places]),
            factors: SparseLu::new(analysis)?,
            factored: Vec::new(),
            right: vec![0.0; system.unknowns],
            is_inside: vec![false; variables],
            is_direct: vec![false; variables],
        })
    }

    /// Computes the Newton step of the free variables, to be subtracted from them, at the point of the last
    /// evaluation of `system`; returns false if the equations are singular.
    pub fn solve(
        &mut self,
        system: &System<'_>,
        inside: &[usize],
        phi: &[f64],
        drift: &[f64],
        step: &mut [f64],
    ) -> bool {
        let n = system.states;
        self.is_inside.fill(false);
        inside.iter().for_each(|&k| self.is_inside[k] = true);
        self.is_direct.fill(false);
        system.visit_derivatives(&system.face, |i, j, _, value| {
            if i >= n && j >= n {
                self.is_direct[i - n] |= value != 0.0 && self.is_inside[j - n];
            }
        });
        let values = self.matrix.val_mut();
        values.fill(0.0);
        for &(place, value) in &system.layout.mass {
            values[place] += value;
        }
        system.visit_derivatives(&system.face, |i, j, place, value| {
            let belongs = match (i < n, j < n) {
                (true, true) => false,
                (true, false) => self.is_inside[j - n],
                (false, true) => self.is_inside[i - n] && !self.is_direct[i - n],
                (false, false) => self.is_inside[i - n] && self.is_inside[j - n],
            };
            if belongs {
                values[place] += value;
            }
        });
        self.right[..n].copy_from_slice(&phi[..n]);
        for (k, right) in self.right[n..].iter_mut().enumerate() {
            *right = match (self.is_inside[k], self.is_direct[k]) {
                (false, _) => 0.0,
                (true, true) => phi[n + k],
                (true, false) => -drift[k],
            };
        }
        for (&k, &place) in system.bounded.iter().zip(&system.layout.diagonal) {
            if !self.is_inside[k] {
                values[place] = 1.0;
            }
        }
        if self.factored != self.matrix.val() {
            self.factors.factorise_unless(&self.matrix, || system.outside.poll().is_some());
            self.factored.clear();
            self.factored.extend_from_slice(self.matrix.val());
        }
        if !self.factors.solve(&mut self.right) {
            return false;
        }
        step.iter_mut().zip(inside).for_each(|(step, &k)| *step = self.right[n + k]);
        true
    }
}

fn is_regular(n: usize, mass: &[(usize, usize, f64)]) -> bool {
    let triplets: Vec<_> = mass.iter().map(|&(i, j, value)| Triplet::new(i, j, value)).collect();
    let Ok(matrix) = SparseMatrix::try_new_from_triplets(n, n, &triplets) else { return false };
    let Some(mut factors) = Analysis::new(matrix.symbolic()).and_then(|analysis| SparseLu::new(&analysis)) else {
        return false;
    };
    let mut right = vec![0.0; n];
    mass.iter().for_each(|&(i, _, value)| right[i] += value);
    factors.factorise(&matrix) && factors.solve(&mut right) && right.iter().all(|x| (x - 1.0).abs() < REGULAR)
}
