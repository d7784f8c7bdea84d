//! Linear systems with the block pattern of the Delassus operator: dense if small or if elimination fills the
//! pattern, otherwise sparse with the analysis of the pattern reused between factorisations.

use super::BlockMatrix;
use factorisation::{Analysis, DenseLu, SparseLu, SparseMatrix};
use faer::sparse::SymbolicSparseColMat;
use nalgebra::Matrix3;

/// Largest number of contacts for which a dense factorisation is faster whatever the pattern.
const DENSE_AT_MOST: usize = 30;

/// The cost of an operation on one 3 x 3 block in a sparse factorisation, relative to its cost in a dense
/// factorisation. Measured on heaps of spheres with 70 to 160 contacts.
const SLOWER: usize = 64;

/// Counts the block operations of an elimination by minimum degree, on the graph of contacts that share a body. Stops
/// counting once the number exceeds `enough`.
fn work_of_elimination(pattern: &BlockMatrix, enough: usize) -> usize {
    let n = pattern.len();
    // The neighbours of each contact that is not yet eliminated, and the contact itself, as bits.
    let mut rows = vec![vec![0_u64; n.div_ceil(64)]; n];
    for i in 0..n {
        for (j, _) in pattern.row(i) {
            rows[i][j / 64] |= 1 << (j % 64);
            rows[j][i / 64] |= 1 << (i % 64);
        }
    }
    let degree = |row: &[u64]| row.iter().map(|word| word.count_ones() as usize).sum::<usize>();
    let mut degrees: Vec<usize> = rows.iter().map(|row| degree(row)).collect();
    let mut work = 0;
    for _ in 0..n {
        let least = degrees.iter().enumerate().min_by_key(|(_, degree)| **degree);
        let Some((pivot, &least)) = least else { break };
        work += least * least;
        if work > enough {
            break;
        }
        degrees[pivot] = usize::MAX;
        let eliminated = std::mem::take(&mut rows[pivot]);
        let is_neighbour = |i: &usize| *i != pivot && eliminated[i / 64] >> (i % 64) & 1 == 1;
        for i in (0..n).filter(is_neighbour) {
            rows[i].iter_mut().zip(&eliminated).for_each(|(row, of)| *row |= of);
            rows[i][pivot / 64] &= !(1 << (pivot % 64));
            degrees[i] = degree(&rows[i]);
        }
    }
    work
}

/// A square matrix with the pattern of a [`BlockMatrix`], and its factors.
pub(super) struct BlockSystem {
    /// For each stored block, the position of its first entry among the values of the sparse matrix.
    places: Vec<usize>,
    /// For each block column, the distance between its successive columns among the values of the sparse matrix.
    strides: Vec<usize>,
    factors: Factors,
}

enum Factors {
    Dense { columns: Vec<f64>, lu: DenseLu<f64> },
    Sparse { matrix: SparseMatrix, lu: Box<SparseLu<f64>> },
}

impl BlockSystem {
    /// Analyses a block pattern; returns `None` if memory does not suffice.
    pub fn new(pattern: &BlockMatrix) -> Option<Self> {
        let n = pattern.len();
        let in_dense = n.saturating_pow(3) / 3;
        let is_dense =
            n <= DENSE_AT_MOST || in_dense <= SLOWER.saturating_mul(work_of_elimination(pattern, in_dense / SLOWER));
        if is_dense { Some(Self::dense(pattern)) } else { Self::sparse(pattern) }
    }

    fn dense(pattern: &BlockMatrix) -> Self {
        let n = pattern.len();
        let places = (0..n).flat_map(|i| pattern.row(i).map(move |(j, _)| 9 * n * j + 3 * i)).collect();
        let factors = Factors::Dense { columns: vec![0.0; 9 * n * n], lu: DenseLu::new(3 * n) };
        Self { places, strides: vec![3 * n; n], factors }
    }

    fn sparse(pattern: &BlockMatrix) -> Option<Self> {
        let n = pattern.len();
        let mut columns = vec![Vec::new(); n];
        for i in 0..n {
            for (j, _) in pattern.row(i) {
                columns[j].push(i);
            }
        }
        let strides: Vec<usize> = columns.iter().map(|rows| 3 * rows.len()).collect();
        let mut column_offsets = vec![0];
        let mut row_indices = Vec::with_capacity(9 * pattern.stored());
        let mut next: Vec<usize> = Vec::with_capacity(n);
        for rows in &columns {
            next.push(row_indices.len());
            for _ in 0..3 {
                row_indices.extend(rows.iter().flat_map(|i| 3 * i..3 * i + 3));
                column_offsets.push(row_indices.len());
            }
        }
        // Visit rows in ascending order, as they are stored in each column.
        let mut places = Vec::with_capacity(pattern.stored());
        for i in 0..n {
            for (j, _) in pattern.row(i) {
                places.push(next[j]);
                next[j] += 3;
            }
        }
        let values = vec![0.0; row_indices.len()];
        let symbolic = SymbolicSparseColMat::new_checked(3 * n, 3 * n, column_offsets, None, row_indices);
        let lu = Box::new(SparseLu::new(&Analysis::new(symbolic.as_ref())?)?);
        Some(Self { places, strides, factors: Factors::Sparse { matrix: SparseMatrix::new(symbolic, values), lu } })
    }

    /// Factorises the matrix whose block `(i, j)` is `block(i, j, b)`, where `b` is the stored block of the pattern;
    /// returns false if the factorisation fails.
    pub fn factorise(
        &mut self,
        pattern: &BlockMatrix,
        block: impl Fn(usize, usize, &Matrix3<f64>) -> Matrix3<f64>,
    ) -> bool {
        let values = match &mut self.factors {
            Factors::Dense { columns, .. } => columns.as_mut_slice(),
            Factors::Sparse { matrix, .. } => matrix.val_mut(),
        };
        let mut places = self.places.iter();
        for i in 0..pattern.len() {
            for ((j, entry), &place) in pattern.row(i).zip(&mut places) {
                let block = block(i, j, entry);
                for (c, column) in block.column_iter().enumerate() {
                    let start = place + c * self.strides[j];
                    values[start..start + 3].copy_from_slice(&[column[0], column[1], column[2]]);
                }
            }
        }
        match &mut self.factors {
            Factors::Dense { columns, lu } => {
                lu.entries().copy_from_slice(columns);
                lu.factorise();
                true
            }
            Factors::Sparse { matrix, lu } => lu.factorise(matrix),
        }
    }

    /// Solves the factorised linear system in place of its right-hand side `right`; returns false if the matrix is
    /// singular.
    pub fn solve(&mut self, right: &mut [f64]) -> bool {
        match &mut self.factors {
            Factors::Dense { lu, .. } => lu.solve(right),
            Factors::Sparse { lu, .. } => lu.solve(right),
        }
    }
}
