//! Reduction of equivalent formulations of a differential variational inequality to one form, for the analysis of
//! uniqueness: free variables are eliminated, and states are restricted to the subspace in which two solutions can
//! differ.
//!
//! - Of the equations `0 = C_F x + D_FF z_F + D_FB z_B` of the free variables `z_F` (with the bounded variables
//!   `z_B`), those in the range of `D_FF` determine a part of `z_F`. The other equations, if they constrain states
//!   only (`0 = C_2 x`), determine the rest of `z_F` after one differentiation, and the difference of two solutions
//!   is in the kernel of `C_2`.
//! - If `q^T A = 0` and `q^T B = 0`, `q^T x` is an invariant: the difference of two solutions is orthogonal to `q`.

use super::linearisation::{Linearisation, RANK};
use factorisation::{Singular, equilibrated};
use nalgebra::DMatrix;

impl Linearisation {
    /// Returns the linearised problem after elimination of its free variables; `None` if there are no free variables,
    /// if all are free, or if their elimination takes more than one differentiation of `G`.
    pub(super) fn without_free(&self) -> Option<Self> {
        let (free, bounded): (Vec<usize>, Vec<usize>) = (0..self.variables()).partition(|&k| self.free[k]);
        if free.is_empty() || bounded.is_empty() {
            return None;
        }
        let (n, m) = (self.states(), bounded.len());
        // Stack the derivatives. Rows: rates, then `G` of the bounded variables. Columns: states, then bounded
        // variables.
        let rows = stack(&self.a, &self.c.select_rows(&bounded));
        let by_bounded = stack(&self.b.select_columns(&bounded), &self.block(&bounded, &bounded));
        let mut known = join(&rows, &by_bounded);
        let mut by_free = stack(&self.b.select_columns(&free), &self.block(&bounded, &free));
        let mut equations = join(&self.c.select_rows(&free), &self.block(&free, &bounded));
        let (scaled, of_rows, of_columns) = equilibrated(self.block(&free, &free));
        equations.row_iter_mut().zip(of_rows).for_each(|(mut row, scale)| row.scale_mut(scale));
        by_free.column_iter_mut().zip(of_columns).for_each(|(mut column, scale)| column.scale_mut(scale));

        let own = Singular::of(&scaled)?;
        let rank = own.rank(RANK);
        let (equations, by_free) = (own.u.transpose() * equations, by_free * own.v_t.transpose());
        for i in 0..rank {
            known -= by_free.column(i) * equations.row(i) / own.values[i];
        }
        let rest = free.len() - rank;
        let equations = equations.rows(rank, rest).into_owned();
        let by_free = by_free.columns(rank, rest).into_owned();
        let (constraint, of_bounded) = (equations.columns(0, n).into_owned(), equations.columns(n, m));
        if of_bounded.amax() > RANK * equations.amax() {
            return None;
        }
        let mut differences = DMatrix::identity(n, n);
        if rest > 0 {
            let products = &constraint * by_free.rows(0, n);
            if Singular::of(&products)?.rank(RANK) < rest {
                return None;
            }
            let answer = products.lu().solve(&(&constraint * known.rows(0, n)))?;
            known -= by_free * answer;
            differences = kernel(&constraint)?;
        }
        let of = |top, left, rows, columns| known.view((top, left), (rows, columns)).into_owned();
        let reduced = Self {
            a: of(0, 0, n, n),
            b: of(0, n, n, m),
            c: of(n, 0, m, n),
            d: of(n, n, m, m),
            free: vec![false; m],
            ..self.clone()
        };
        Some(reduced.on(&differences))
    }

    /// Returns the linearised problem restricted to the subspace of states in which two solutions can differ,
    /// orthogonal to its linear invariants; `None` if there are no invariants.
    pub(super) fn without_invariants(&self) -> Option<Self> {
        if !self.is_constant || self.states() == 0 {
            return None;
        }
        let n = self.states();
        let mut rows = join(&self.a, &self.b);
        let sizes: Vec<f64> =
            rows.row_iter().map(|row| row.amax()).map(|size| if size > 0.0 { size } else { 1.0 }).collect();
        for (mut row, size) in rows.row_iter_mut().zip(&sizes) {
            row.unscale_mut(*size);
        }
        let singular = Singular::of(&rows)?;
        let rank = singular.rank(RANK);
        if rank == n {
            return None;
        }
        let invariants = DMatrix::from_fn(n - rank, n, |i, j| singular.u[(j, rank + i)] / sizes[j]);
        Some(self.on(&kernel(&invariants)?))
    }

    /// Restricts the linearised problem to states in the span of `basis`, whose columns are orthonormal; the span must
    /// contain the rates of these states.
    fn on(&self, basis: &DMatrix<f64>) -> Self {
        Self { a: basis.tr_mul(&self.a) * basis, b: basis.tr_mul(&self.b), c: &self.c * basis, ..self.clone() }
    }

    /// Returns the submatrix of `D = dG/dz` in the given rows and columns.
    fn block(&self, rows: &[usize], columns: &[usize]) -> DMatrix<f64> {
        DMatrix::from_fn(rows.len(), columns.len(), |i, j| self.d[(rows[i], columns[j])])
    }
}

/// Computes an orthonormal basis of the kernel of a matrix of full row rank, whose rows are first scaled to equal size.
fn kernel(matrix: &DMatrix<f64>) -> Option<DMatrix<f64>> {
    let (rows, n) = matrix.shape();
    let mut square = DMatrix::zeros(n.max(rows), n);
    for (i, row) in matrix.row_iter().enumerate() {
        let size = row.amax();
        square.row_mut(i).copy_from(&(row / if size > 0.0 { size } else { 1.0 }));
    }
    let singular = Singular::of(&square)?;
    let rank = singular.rank(RANK);
    Some(singular.v_t.rows(rank, n - rank).transpose())
}

/// Returns the matrix in which the matrix `above` is stacked on the matrix `below`.
fn stack(above: &DMatrix<f64>, below: &DMatrix<f64>) -> DMatrix<f64> {
    let n = above.nrows();
    DMatrix::from_fn(n + below.nrows(), above.ncols(), |i, j| if i < n { above[(i, j)] } else { below[(i - n, j)] })
}

/// Returns the matrix in which the matrix `left` stands beside the matrix `right`.
fn join(left: &DMatrix<f64>, right: &DMatrix<f64>) -> DMatrix<f64> {
    let n = left.ncols();
    DMatrix::from_fn(left.nrows(), n + right.ncols(), |i, j| if j < n { left[(i, j)] } else { right[(i, j - n)] })
}
