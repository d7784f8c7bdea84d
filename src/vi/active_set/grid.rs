//! Multilinear interpolation from every other node of a rectangular grid, the last node of each direction included, and
//! the Galerkin matrix `P^T A P` (Trottenberg, Oosterlee and Schueller 2001, section 2.3.3 and appendix A.2.3).

use crate::factorisation::SparseMatrix;
use faer::Par;
use faer::sparse::Triplet;
use faer::sparse::linalg::matmul::sparse_sparse_matmul;

/// Interpolation between two grids.
pub(super) struct Interpolation {
    /// `P^T`: a column a fine node, its rows the coarse nodes around it.
    parents: SparseMatrix,
    /// The fine node at each coarse one.
    pub nodes: Vec<usize>,
}

impl Interpolation {
    /// The interpolation to a grid of this shape, the last index fastest, and the shape of the coarse grid.
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

    /// `P^T A P`; `None` if memory does not suffice.
    pub fn galerkin(&self, matrix: &SparseMatrix) -> Option<SparseMatrix> {
        let interpolation = self.parents.transpose().to_col_major().ok()?;
        let image = sparse_sparse_matmul(matrix.as_ref(), interpolation.as_ref(), 1.0, Par::Seq).ok()?;
        sparse_sparse_matmul(self.parents.as_ref(), image.as_ref(), 1.0, Par::Seq).ok()
    }

    /// `coarse = P^T fine`
    pub fn restrict(&self, fine: &[f64], coarse: &mut [f64]) {
        coarse.fill(0.0);
        for (node, &value) in fine.iter().enumerate() {
            let parents = self.parents.symbolic().row_idx_of_col_raw(node);
            for (&parent, &weight) in parents.iter().zip(self.parents.val_of_col(node)) {
                coarse[parent] += weight * value;
            }
        }
    }

    /// `fine = P coarse`
    pub fn interpolate(&self, coarse: &[f64], fine: &mut [f64]) {
        for (node, value) in fine.iter_mut().enumerate() {
            let parents = self.parents.symbolic().row_idx_of_col_raw(node);
            let weights = self.parents.val_of_col(node);
            *value = parents.iter().zip(weights).map(|(&parent, weight)| weight * coarse[parent]).sum();
        }
    }
}
