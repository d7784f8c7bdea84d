//! Conjugate gradients on the rows of inactive variables, preconditioned by a multigrid cycle, for a symmetric matrix
//! on a grid whose factors would not be sparse: their size grows as `n log n` in two dimensions, as `n^(4/3)` in
//! three.
//!
//! The coarse matrices are those of the whole grid; on each, nodes whose fine node is active are left out (the
//! truncated basis of Kornhuber 1994, by nodes). One forward Gauss-Seidel sweep on the way down and one backward
//! sweep on the way up give a symmetric cycle (Trottenberg, Oosterlee and Schueller 2001, section 7.8).

use super::Unsuitable;
use super::grid::{Coarser, Interpolation};
use super::sparse::restrict;
use factorisation::{Cholesky, SparseMatrix};
use problem::Control;
use std::sync::Arc;

/// Grids with at most this number of nodes are solved by factorisation.
const SMALL: usize = 500;

/// Tolerance on the residual, relative to the right-hand side of inactive rows (active rows have another size): as
/// accurate as a factorisation.
const REACHED: f64 = 1e-14;

/// Largest number of conjugate gradient iterations, after which the current iterate is accepted; each iteration gains
/// about one decimal digit.
const MOST: usize = 60;

/// The grids with their matrices, from fine to coarse, and the workspace of the conjugate gradients.
pub(super) struct Multigrid {
    /// The grids, the finest first.
    levels: Vec<Grid>,
    coarsest: Cholesky,
    /// The last solution, from which the next solve of the conjugate gradients starts.
    last: Vec<f64>,
    residual: Vec<f64>,
    direction: Vec<f64>,
    image: Vec<f64>,
}

struct Grid {
    /// The matrix of the whole grid; `None` on the finest grid, whose matrix is owned by the caller.
    matrix: Option<SparseMatrix>,
    restricted: SparseMatrix,
    inside: Vec<bool>,
    /// The transfer to the next coarser grid; `None` on the coarsest grid.
    transfer: Option<Arc<Interpolation>>,
    right: Vec<f64>,
    z: Vec<f64>,
    defect: Vec<f64>,
}

impl Grid {
    fn new(matrix: &SparseMatrix, is_finest: bool) -> Self {
        let n = matrix.nrows();
        Self {
            matrix: (!is_finest).then(|| matrix.clone()),
            restricted: matrix.clone(),
            inside: vec![true; n],
            transfer: None,
            right: vec![0.0; n],
            z: vec![0.0; n],
            defect: vec![0.0; n],
        }
    }

    fn column(&self, j: usize) -> impl Iterator<Item = (usize, f64)> {
        let rows = self.restricted.symbolic().row_idx_of_col_raw(j);
        rows.iter().copied().zip(self.restricted.val_of_col(j).iter().copied())
    }

    /// Makes one Gauss-Seidel sweep over the nodes of the grid; the columns of the symmetric matrix serve as its rows.
    fn smooth(&mut self, forwards: bool) {
        let n = self.z.len();
        for k in 0..n {
            let i = if forwards { k } else { n - 1 - k };
            let (mut sum, mut diagonal) = (self.right[i], 1.0);
            for (j, value) in self.column(i) {
                if j == i {
                    diagonal = value;
                } else {
                    sum -= value * self.z[j];
                }
            }
            self.z[i] = sum / diagonal;
        }
    }
}

/// Computes `image = R z` with the matrix `R` restricted to inactive variables, which is symmetric.
fn apply(grid: &Grid, z: &[f64], image: &mut [f64]) {
    for (i, image) in image.iter_mut().enumerate() {
        *image = grid.column(i).map(|(j, value)| value * z[j]).sum();
    }
}

impl Multigrid {
    /// Prepares a symmetric matrix whose rows are the nodes of a grid; `below` are the coarser grids.
    pub fn new(matrix: &SparseMatrix, below: &[Coarser], control: &Control) -> Result<Self, Unsuitable> {
        let n = matrix.nrows();
        let mut levels = vec![Grid::new(matrix, true)];
        let mut fine = matrix;
        for Coarser { transfer, matrix, .. } in below {
            if fine.nrows() <= SMALL {
                break;
            }
            control.go_on()?;
            if let Some(grid) = levels.last_mut() {
                grid.transfer = Some(Arc::clone(transfer));
            }
            levels.push(Grid::new(matrix, false));
            fine = matrix;
        }
        let coarsest = Cholesky::new(fine).ok_or(Unsuitable::Memory)?;
        let zeros = || vec![0.0; n];
        Ok(Self { levels, coarsest, last: zeros(), residual: zeros(), direction: zeros(), image: zeros() })
    }

    /// Sets the matrix of the finest grid to `restricted`, in which the rows of active variables are those of the
    /// identity, and restricts the coarser matrices accordingly; `inside` marks the inactive variables. Returns
    /// false if the system is singular.
    pub fn restrict(&mut self, restricted: &SparseMatrix, inside: impl Iterator<Item = bool>) -> bool {
        let [finest, ..] = &mut self.levels[..] else { return false };
        let (_, values) = finest.restricted.parts_mut();
        values.copy_from_slice(restricted.val());
        finest.inside.clear();
        finest.inside.extend(inside);
        for k in 1..self.levels.len() {
            let (finer, coarser) = self.levels.split_at_mut(k);
            let (fine, coarse) = (&finer[k - 1], &mut coarser[0]);
            let (Some(transfer), Some(matrix)) = (&fine.transfer, &coarse.matrix) else { return false };
            for (inside, &node) in coarse.inside.iter_mut().zip(&transfer.nodes) {
                *inside = fine.inside[node];
            }
            restrict(matrix, |node| coarse.inside[node], |_| 0.0, &mut coarse.restricted);
        }
        self.levels.last().is_some_and(|coarsest| self.coarsest.factorise(&coarsest.restricted))
    }

    /// Solves the restricted system in place of `z`, where the rows of active variables are those of the identity.
    /// Returns false if the iteration breaks down, or if `control` asks to stop.
    pub fn solve(&mut self, z: &mut [f64], control: &Control) -> bool {
        let mut answer = std::mem::take(&mut self.last);
        for ((answer, &inside), &right) in answer.iter_mut().zip(&self.levels[0].inside).zip(z.iter()) {
            *answer = if inside { *answer } else { right };
        }
        let (mut residual, mut direction) = (std::mem::take(&mut self.residual), std::mem::take(&mut self.direction));
        let mut image = std::mem::take(&mut self.image);
        apply(&self.levels[0], &answer, &mut image);
        for ((residual, image), &right) in residual.iter_mut().zip(&image).zip(z.iter()) {
            *residual = right - image;
        }
        let rows = z.iter().zip(&self.levels[0].inside).filter(|(_, inside)| **inside);
        let enough = REACHED * rows.map(|(right, _)| right * right).sum::<f64>().sqrt();
        let mut before = f64::INFINITY;
        for k in 0..MOST {
            if dot(&residual, &residual).sqrt() <= enough || control.poll().is_some() {
                break;
            }
            self.cycle(&residual);
            let correction = &self.levels[0].z;
            let product = dot(&residual, correction);
            let factor = if k == 0 { 0.0 } else { product / before };
            for (direction, correction) in direction.iter_mut().zip(correction) {
                *direction = correction + factor * *direction;
            }
            before = product;
            apply(&self.levels[0], &direction, &mut image);
            let length = product / dot(&direction, &image);
            if !length.is_finite() {
                break;
            }
            for (answer, direction) in answer.iter_mut().zip(&direction) {
                *answer += length * direction;
            }
            for (residual, image) in residual.iter_mut().zip(&image) {
                *residual -= length * image;
            }
        }
        z.copy_from_slice(&answer);
        (self.last, self.residual, self.direction, self.image) = (answer, residual, direction, image);
        control.poll().is_none() && z.iter().all(|z| z.is_finite())
    }

    /// Computes the multigrid correction of a residual into `z` of the finest grid.
    fn cycle(&mut self, residual: &[f64]) {
        let coarsest = self.levels.len() - 1;
        self.levels[0].right.copy_from_slice(residual);
        for k in 0..coarsest {
            let (finer, coarser) = self.levels.split_at_mut(k + 1);
            let (fine, coarse) = (&mut finer[k], &mut coarser[0]);
            fine.z.fill(0.0);
            fine.smooth(true);
            let mut defect = std::mem::take(&mut fine.defect);
            apply(fine, &fine.z, &mut defect);
            for ((defect, right), &inside) in defect.iter_mut().zip(&fine.right).zip(&fine.inside) {
                *defect = if inside { right - *defect } else { 0.0 };
            }
            if let Some(transfer) = &fine.transfer {
                transfer.restrict(&defect, &mut coarse.right);
            }
            fine.defect = defect;
            mask(&coarse.inside, &mut coarse.right);
        }
        let Grid { right, z, .. } = &mut self.levels[coarsest];
        z.copy_from_slice(right);
        self.coarsest.solve(z);
        for k in (0..coarsest).rev() {
            let (finer, coarser) = self.levels.split_at_mut(k + 1);
            let (fine, coarse) = (&mut finer[k], &coarser[0]);
            if let Some(transfer) = &fine.transfer {
                transfer.interpolate(&coarse.z, &mut fine.defect);
            }
            mask(&fine.inside, &mut fine.defect);
            for (z, correction) in fine.z.iter_mut().zip(&fine.defect) {
                *z += correction;
            }
            fine.smooth(false);
        }
    }
}

fn mask(inside: &[bool], values: &mut [f64]) {
    for (value, &inside) in values.iter_mut().zip(inside) {
        *value = if inside { *value } else { 0.0 };
    }
}

fn dot(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(a, b)| a * b).sum()
}
