//! Multilinear interpolation from every other node of a rectangular grid, the last node of each direction included, and
//! the Galerkin matrix `P^T A P` (Trottenberg, Oosterlee and Schueller 2001, section 2.3.3 and appendix A.2.3).

use super::Unsuitable;
use factorisation::SparseMatrix;
use faer::Par;
use faer::sparse::Triplet;
use faer::sparse::linalg::matmul::sparse_sparse_matmul;
use problem::Control;
use std::sync::Arc;

/// Grids with at most this number of nodes are not coarsened further.
const SMALL: usize = 32;

/// Multilinear interpolation `P` from a coarse grid to a fine grid.
pub(super) struct Interpolation {
    /// The transpose `P^T`: a column for each fine node, with the coarse nodes around it as rows.
    parents: SparseMatrix,
    /// For each coarse node, the index of the fine node at the same position.
    pub nodes: Vec<usize>,
}

/// A grid of every other node of the next finer one, with its Galerkin matrix.
pub(super) struct Coarser {
    /// The interpolation to the next finer grid, shared by the solvers on both grids.
    pub transfer: Arc<Interpolation>,
    pub matrix: SparseMatrix,
    /// The number of nodes in each direction of the coarser grid.
    pub shape: Vec<usize>,
}

/// Builds the successively coarser grids below a grid of the given shape.
pub(super) fn hierarchy(matrix: &SparseMatrix, shape: &[usize], control: &Control) -> Result<Vec<Coarser>, Unsuitable> {
    let mut coarser: Vec<Coarser> = Vec::new();
    loop {
        let (fine, shape) = coarser.last().map_or((matrix, shape), |coarser| (&coarser.matrix, &coarser.shape));
        if fine.nrows() <= SMALL || shape.iter().all(|&nodes| nodes <= 3) {
            return Ok(coarser);
        }
        let (transfer, shape) = Interpolation::new(shape);
        let matrix = transfer.galerkin(fine, control)?;
        coarser.push(Coarser { transfer: Arc::new(transfer), matrix, shape });
    }
}

impl Interpolation {
    /// Builds the interpolation to a grid of the given shape, the last index fastest; also returns the shape of the
    /// coarse grid.
    pub fn new(shape: &[usize]) -> (Self, Vec<usize>) {
        let coarse_shape: Vec<usize> = shape.iter().map(|&nodes| nodes / 2 + 1).collect();
        let (fine, coarse) = (shape.iter().product(), coarse_shape.iter().product());
        let mut nodes = vec![0; coarse];
        let mut triplets = Vec::with_capacity(4 * fine);
        let mut around: Vec<(usize, f64)> = Vec::new();
        for node in 0..fine {
            around.clear();
            around.push((0, 1.0));
            let mut stride = fine;
            for (&length, &coarse_length) in shape.iter().zip(&coarse_shape) {
                stride /= length;
                let at = node / stride % length;
                let known = around.len();
                let is_coarse = at % 2 == 0 || at + 1 == length;
                for parent in 0..known {
                    let (index, weight) = around[parent];
                    let first = index * coarse_length + at.div_ceil(2).min(coarse_length - 1);
                    if is_coarse {
                        around[parent] = (first, weight);
                    } else {
                        around[parent] = (first, 0.5 * weight);
                        around.push((first - 1, 0.5 * weight));
                    }
                }
            }
            if let [(only, _)] = around[..] {
                nodes[only] = node;
            }
            triplets.extend(around.iter().map(|&(parent, weight)| Triplet::new(parent, node, weight)));
        }
        let parents = SparseMatrix::try_new_from_triplets(coarse, fine, &triplets);
        let parents = parents.expect("every parent is a node of the coarse grid");
        (Self { parents, nodes }, coarse_shape)
    }

    /// Computes the Galerkin matrix `P^T A P`; returns an error if memory does not suffice.
    fn galerkin(&self, matrix: &SparseMatrix, control: &Control) -> Result<SparseMatrix, Unsuitable> {
        control.go_on()?;
        let interpolation = self.parents.transpose().to_col_major().map_err(|_| Unsuitable::Memory)?;
        let image = sparse_sparse_matmul(matrix.as_ref(), interpolation.as_ref(), 1.0, Par::Seq);
        let image = image.map_err(|_| Unsuitable::Memory)?;
        control.go_on()?;
        sparse_sparse_matmul(self.parents.as_ref(), image.as_ref(), 1.0, Par::Seq).map_err(|_| Unsuitable::Memory)
    }

    /// Restricts a vector to the coarse grid, `coarse = P^T fine`.
    pub fn restrict(&self, fine: &[f64], coarse: &mut [f64]) {
        coarse.fill(0.0);
        for (node, &value) in fine.iter().enumerate() {
            let parents = self.parents.symbolic().row_idx_of_col_raw(node);
            for (&parent, &weight) in parents.iter().zip(self.parents.val_of_col(node)) {
                coarse[parent] += weight * value;
            }
        }
    }

    /// Interpolates a vector to the fine grid, `fine = P coarse`.
    pub fn interpolate(&self, coarse: &[f64], fine: &mut [f64]) {
        for (node, value) in fine.iter_mut().enumerate() {
            let parents = self.parents.symbolic().row_idx_of_col_raw(node);
            let weights = self.parents.val_of_col(node);
            *value = parents.iter().zip(weights).map(|(&parent, weight)| weight * coarse[parent]).sum();
        }
    }
}
