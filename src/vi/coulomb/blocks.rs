//! Sparse matrices of 3 x 3 blocks, stored by block rows: the Delassus operator couples contacts that share a body.

use nalgebra::{Matrix3, Vector3};
use std::ops::Range;

/// An `n x n` matrix of 3 x 3 blocks in which every diagonal block is stored.
#[derive(Debug, Default, PartialEq)]
pub struct BlockMatrix {
    /// The offset of each block row in `columns` and `blocks`; of length `n + 1`.
    offsets: Vec<usize>,
    columns: Vec<usize>,
    blocks: Vec<Matrix3<f64>>,
    /// The index of the diagonal block of each row.
    diagonal: Vec<usize>,
}

impl BlockMatrix {
    /// Assembles blocks `(row, column, block)` in any order; blocks at the same position are added. Returns `None` if
    /// an index is `>= n`.
    pub fn from_blocks(n: usize, blocks: impl IntoIterator<Item = (usize, usize, Matrix3<f64>)>) -> Option<Self> {
        let mut entries: Vec<_> = blocks.into_iter().collect();
        if entries.iter().any(|&(i, j, _)| i >= n || j >= n) {
            return None;
        }
        entries.sort_by_key(|&(i, j, _)| (i, j));
        // Allocate once: a growing vector occupies twice its memory while it moves.
        let mut matrix = Self {
            offsets: vec![0],
            columns: Vec::with_capacity(entries.len()),
            blocks: Vec::with_capacity(entries.len()),
            diagonal: Vec::with_capacity(n),
        };
        let mut entries = entries.into_iter().peekable();
        for i in 0..n {
            let start = matrix.blocks.len();
            while let Some((_, j, block)) = entries.next_if(|entry| entry.0 == i) {
                if j >= i {
                    matrix.reach_diagonal(i);
                }
                match matrix.columns[start..].last() {
                    Some(&last) if last == j => *matrix.blocks.last_mut()? += block,
                    _ => matrix.push(j, block),
                }
            }
            matrix.reach_diagonal(i);
            matrix.offsets.push(matrix.blocks.len());
        }
        Some(matrix)
    }

    fn push(&mut self, j: usize, block: Matrix3<f64>) {
        self.columns.push(j);
        self.blocks.push(block);
    }

    /// Appends a zero diagonal block to row `i` if the row has none yet.
    fn reach_diagonal(&mut self, i: usize) {
        if self.diagonal.len() == i {
            self.diagonal.push(self.blocks.len());
            self.push(i, Matrix3::zeros());
        }
    }

    /// Returns the number of block rows of the matrix.
    pub fn len(&self) -> usize {
        self.diagonal.len()
    }

    /// Whether the matrix has no rows.
    pub fn is_empty(&self) -> bool {
        self.diagonal.is_empty()
    }

    /// Returns the number of stored 3 x 3 blocks of the matrix.
    pub(super) fn stored(&self) -> usize {
        self.blocks.len()
    }

    /// Returns the blocks `(column, block)` of row `i`, columns ascending.
    pub fn row(&self, i: usize) -> impl Iterator<Item = (usize, &Matrix3<f64>)> {
        let range = self.range(i);
        self.columns[range.clone()].iter().copied().zip(&self.blocks[range])
    }

    fn range(&self, i: usize) -> Range<usize> {
        self.offsets[i]..self.offsets[i + 1]
    }

    /// Returns the diagonal block of block row `i`.
    pub fn diagonal(&self, i: usize) -> &Matrix3<f64> {
        &self.blocks[self.diagonal[i]]
    }

    /// Returns the block of the matrix at `(i, j)`, if stored.
    pub fn block(&self, i: usize, j: usize) -> Option<&Matrix3<f64>> {
        let range = self.range(i);
        let place = self.columns[range.clone()].binary_search(&j).ok()?;
        Some(&self.blocks[range.start + place])
    }

    /// Returns block row `i` of the product of the matrix and `r`.
    #[inline]
    pub fn row_product(&self, i: usize, r: &[Vector3<f64>]) -> Vector3<f64> {
        self.row(i).fold(Vector3::zeros(), |sum, (j, block)| sum + block * r[j])
    }

    /// Copies the scaled matrix `D A D` into `target`, with the diagonal `D = diag(d_1 I, .., d_n I)`.
    pub(super) fn scale_into(&self, d: &[f64], target: &mut Self) {
        target.clone_from(self);
        for (i, &d_i) in d.iter().enumerate() {
            for place in self.range(i) {
                target.blocks[place] *= d_i * d[self.columns[place]];
            }
        }
    }

    pub(super) fn is_finite(&self) -> bool {
        self.blocks.iter().all(|block| block.iter().all(|x| x.is_finite()))
    }
}

impl Clone for BlockMatrix {
    fn clone(&self) -> Self {
        let mut copy = Self::default();
        copy.clone_from(self);
        copy
    }

    /// Copies into the memory of this matrix, without allocation if that suffices: each time step copies one matrix
    /// several times.
    fn clone_from(&mut self, source: &Self) {
        self.offsets.clone_from(&source.offsets);
        self.columns.clone_from(&source.columns);
        self.blocks.clone_from(&source.blocks);
        self.diagonal.clone_from(&source.diagonal);
    }
}
