//! The algebraic equations of a face, and the corrections that bring unknowns between the ends of a step onto them.
//!
//! Let `A` be the rows that are not rates, let `z` and the massless states `w` be free, and let the rows of `N` be a
//! basis of the left null space of `A_(z,w)`. Then
//!
//! ```text
//! N A(t, x) = 0,    dx = -D (N A_x D)^+ N A,    D = M^-1 F_(z,w)
//! ```
//!
//! are the constraints on the other states, and the correction of states that violate them: along the directions in
//! which `z` and `w` drive the states, so that invariants are preserved (Ascher and Petzold 1998, 10.2). If these
//! directions do not reach the constraints, the correction is the smallest one in the weights of the tolerances,
//! `D = W`. If `M` is singular, massless states and variables follow with `A_(z,w)^+`; if it is regular, variables
//! satisfy hidden constraints as well (see [`consistent_variables`](super::consistent_variables)).
//!
//! The ends of steps satisfy the constraints. The collocation polynomial between them does not, and no error estimate
//! detects it: a state that constraints determine has no error at the stages, whatever the step size.

use super::face::{ActiveFace, Activity};
use super::layout::Storage;
use super::newton_control::NewtonControl;
use super::system::System;
use factorisation::{Singular, equilibrated, scale_of};
use nalgebra::{DMatrix, FullPivLU};
use numerics::components;
use problem::Mass;

/// Relative rank threshold: pivots and singular values below this fraction of the largest count as zero, in matrices
/// whose rows and columns are scaled to entries of at most one.
const RANK: f64 = 1e-10;
/// Maximum number of corrections that bring one point onto the constraints; linear constraints need one.
const ITERATIONS: usize = 5;

/// The constraints on the states on one active face of `K`, with one Jacobian.
#[derive(Debug, Default)]
pub(super) struct Constraints {
    jacobians: u64,
    face: Option<ActiveFace>,
    /// Indices of the rows of the system that are equations without a time derivative.
    rows: Vec<usize>,
    /// Change of each unknown by a correction, per unit of each row of `A` (the rows that are not rates); empty if
    /// there is nothing to correct.
    correction: DMatrix<f64>,
    phi: Vec<f64>,
    changes: Vec<f64>,
    /// The unknowns before a correction onto the constraints, restored if it fails.
    before: Vec<f64>,
}

impl Constraints {
    /// Brings `y` onto the constraints of the face. Returns false, with `y` unchanged, if there is nothing to correct
    /// or if the iteration does not converge: close to a singular Jacobian, the first correction may be arbitrarily
    /// large.
    pub fn correct(&mut self, system: &mut System<'_>, control: &NewtonControl, t: f64, y: &mut [f64]) -> bool {
        self.follow(system, control, y);
        if self.correction.is_empty() {
            return false;
        }
        self.before.clear();
        self.before.extend_from_slice(y);
        let is_corrected = self.iterate(system, control, t, y);
        if !is_corrected {
            y.copy_from_slice(&self.before);
        }
        is_corrected
    }

    /// Adds corrections to `y` until they are below the tolerance of Newton's method; returns false if the corrections
    /// do not shrink.
    fn iterate(&mut self, system: &mut System<'_>, control: &NewtonControl, t: f64, y: &mut [f64]) -> bool {
        self.phi.resize(system.unknowns, 0.0);
        let mut last = f64::INFINITY;
        for _ in 0..ITERATIONS {
            if !system.phi(t, y, &mut self.phi) {
                return false;
            }
            self.changes.clear();
            self.changes.resize(system.unknowns, 0.0);
            for (column, &row) in
                self.correction.column_iter().zip(&self.rows).filter(|(_, row)| self.phi[**row] != 0.0)
            {
                for (change, entry) in self.changes.iter_mut().zip(column.as_slice()) {
                    *change += entry * self.phi[row];
                }
            }
            let mut size = 0.0_f64;
            for ((y, change), weight) in y.iter_mut().zip(&self.changes).zip(&control.weight) {
                *y += change;
                size = size.max((change * weight).abs());
            }
            if size <= control.kappa {
                return true;
            }
            if size > 0.5 * last || size.is_nan() {
                return false;
            }
            last = size;
        }
        true
    }

    /// Adds to `out` a first-order bound on the distance of each unknown from the constraints, for rows of the system
    /// on the active face of `K` (`Phi`) of magnitudes `sizes`.
    pub fn add_errors(
        &mut self,
        system: &mut System<'_>,
        control: &NewtonControl,
        y: &[f64],
        sizes: &[f64],
        out: &mut [f64],
    ) {
        self.follow(system, control, y);
        if self.correction.is_empty() {
            return;
        }
        for (column, &row) in self.correction.column_iter().zip(&self.rows).filter(|(_, row)| sizes[**row] != 0.0) {
            for (error, entry) in out.iter_mut().zip(column.as_slice()).filter(|(_, entry)| **entry != 0.0) {
                *error += entry.abs() * sizes[row];
            }
        }
    }

    /// Writes to `out` by how much a linear function of the states changes when the states are projected onto the
    /// constraints `Phi = 0` of the active face. The function is given by its gradient, and the change as a sum of
    /// multiples of components of `Phi`: pairs of a component and its factor.
    pub fn change_of(
        &mut self,
        system: &mut System<'_>,
        control: &NewtonControl,
        y: &[f64],
        gradient: impl Fn(usize) -> f64,
        out: &mut Vec<(usize, f64)>,
    ) {
        self.follow(system, control, y);
        out.clear();
        let gradient: Vec<f64> = (0..system.states).map(gradient).collect();
        out.extend(self.correction.column_iter().zip(&self.rows).map(|(column, &row)| {
            (row, column.as_slice().iter().zip(&gradient).map(|(entry, slope)| entry * slope).sum())
        }));
        out.retain(|(_, factor)| *factor != 0.0);
    }

    /// Removes from a difference of states the component that violates the constraints, a residue of rounding and of
    /// Newton's method; returns false if no constraint is known.
    pub fn project(
        &mut self,
        system: &mut System<'_>,
        control: &NewtonControl,
        y: &[f64],
        difference: &mut [f64],
    ) -> bool {
        self.follow(system, control, y);
        if self.correction.is_empty() {
            return false;
        }
        let n = system.states;
        self.changes.clear();
        self.changes.resize(system.unknowns, 0.0);
        for (column, &row) in self.correction.column_iter().zip(&self.rows) {
            let along: f64 =
                system.entries_of_row(row).filter(|(j, _)| *j < n).map(|(j, value)| value * difference[j]).sum();
            self.changes.iter_mut().zip(column.as_slice()).for_each(|(change, entry)| *change += entry * along);
        }
        difference[..n].iter_mut().zip(&self.changes).for_each(|(difference, change)| *difference += change);
        true
    }

    /// Updates the stored constraints on the states to the active face of `system` and its last Jacobian.
    fn follow(&mut self, system: &mut System<'_>, control: &NewtonControl, y: &[f64]) {
        let is_same = self.jacobians == system.work.jacobians && self.face.as_ref() == Some(&system.face);
        if is_same && !system.is_curved() {
            return;
        }
        self.jacobians = system.work.jacobians;
        self.face.get_or_insert_default().clone_from(&system.face);
        if !system.face.blocks.is_empty() {
            system.linearise_blocks(y, Some(control));
        }
        self.correction = correction(system, control, &mut self.rows).unwrap_or_default();
    }
}

/// Returns the matrix of the corrections that bring the unknowns onto the constraints, per unit of residual; `None` if
/// no constraint binds them, or the system is sparse.
fn correction(system: &System<'_>, control: &NewtonControl, rows: &mut Vec<usize>) -> Option<DMatrix<f64>> {
    let (n, unknowns, layout) = (system.states, system.unknowns, &system.layout);
    rows.clear();
    rows.extend((0..unknowns).filter(|&row| row >= n || !layout.is_rate[row]));
    if rows.is_empty() || !matches!(layout.storage, Storage::Dense) {
        return None;
    }
    let mut place = vec![usize::MAX; unknowns];
    rows.iter().enumerate().for_each(|(at, &row)| place[row] = at);
    let mut free = vec![usize::MAX; unknowns];
    let are_free = (0..unknowns).filter(|&j| j >= n || !layout.has_mass[j]);
    let columns = are_free.enumerate().map(|(column, j)| free[j] = column).count();
    let mut of_free = DMatrix::<f64>::zeros(rows.len(), columns);
    let mut of_states = DMatrix::<f64>::zeros(rows.len(), n);
    let mut rates = DMatrix::<f64>::zeros(n, columns);
    let rests = |j: usize| {
        j >= n && matches!(system.face.places[j - n], Activity::AtLower | Activity::AtUpper | Activity::Fixed)
    };
    system.visit_derivatives(&system.face, |i, j, _, value| {
        match (place[i], free[j]) {
            (usize::MAX, usize::MAX) => {}
            // A variable at rest on a bound does not drive the states: its column of derivatives of the rates is zero.
            (usize::MAX, column) => rates[(i, column)] += if rests(j) { 0.0 } else { value },
            (row, usize::MAX) => of_states[(row, j)] += value,
            (row, column) => of_free[(row, column)] += value,
        }
    });
    let (scaled, of_rows, of_columns) = equilibrated(of_free);
    let mut correction = DMatrix::<f64>::zeros(unknowns, rows.len());
    if let Some(mut null) = left_null_space(&scaled) {
        null.column_iter_mut().zip(&of_rows).for_each(|(mut column, scale)| column.scale_mut(*scale));
        let weights = DMatrix::from_fn(n, n, |i, j| if i == j { 1.0 / control.weight[i] } else { 0.0 });
        let held = &null * &of_states;
        let driven = directions(system, rates).filter(|driven| reaches(&held, driven));
        let directions = driven.unwrap_or(weights);
        let mut bound = held * &directions;
        for row in 0..bound.nrows() {
            let scale = scale_of(bound.row(row).amax());
            bound.row_mut(row).scale_mut(scale);
            null.row_mut(row).scale_mut(scale);
        }
        correction.rows_mut(0, n).copy_from(&(-directions * pseudoinverse(&bound)? * null));
    }
    if layout.has_mass.contains(&false) {
        let rest = DMatrix::identity(rows.len(), rows.len()) + of_states * correction.rows(0, n);
        let mut inverse = pseudoinverse(&scaled)?;
        inverse.column_iter_mut().zip(&of_rows).for_each(|(mut column, scale)| column.scale_mut(*scale));
        let of_free = inverse * rest;
        for (j, &column) in free.iter().enumerate().filter(|(_, column)| **column != usize::MAX) {
            correction.row_mut(j).copy_from(&(-of_free.row(column) * of_columns[column]));
        }
    }
    let is_needed = correction.amax() > 0.0;
    Some(correction).filter(|correction| is_needed && correction.iter().all(|entry| entry.is_finite()))
}

/// Returns the directions `M^-1 F_(z,w)` in which variables and massless states drive the states, with columns scaled
/// to entries of at most one; `None` if the mass matrix `M` without its massless rows is singular.
fn directions(system: &System<'_>, mut rates: DMatrix<f64>) -> Option<DMatrix<f64>> {
    if let Mass::Constant(entries) = system.mass() {
        let mut mass = DMatrix::<f64>::zeros(system.states, system.states);
        entries.iter().for_each(|&(i, j, value)| mass[(i, j)] += value);
        for i in (0..system.states).filter(|&i| !system.layout.is_rate[i] && !system.layout.has_mass[i]) {
            mass[(i, i)] = 1.0;
            rates.row_mut(i).fill(0.0);
        }
        if !mass.lu().solve_mut(&mut rates) {
            return None;
        }
    }
    for mut column in rates.column_iter_mut() {
        let scale = scale_of(column.amax());
        column.scale_mut(scale);
    }
    Some(rates).filter(|rates| rates.iter().all(|entry| entry.is_finite()))
}

/// Whether `directions` of the states reach all constraints, given the derivatives `constraints` of the constraints
/// with respect to the states.
fn reaches(constraints: &DMatrix<f64>, directions: &DMatrix<f64>) -> bool {
    // Constraints that outnumber the states, or the directions, cannot all be reached.
    if constraints.nrows() > constraints.ncols().min(directions.ncols()) {
        return false;
    }
    let bound = constraints * directions;
    let (scaled, _, _) = equilibrated(bound);
    Singular::of(&scaled).is_some_and(|singular| singular.rank(RANK) == constraints.nrows())
}

/// Returns the Moore-Penrose pseudoinverse of a matrix; zero for a zero matrix, `None` if an entry is not finite.
fn pseudoinverse(matrix: &DMatrix<f64>) -> Option<DMatrix<f64>> {
    let singular = Singular::of(matrix)?;
    let mut inverse = DMatrix::<f64>::zeros(matrix.ncols(), matrix.nrows());
    for q in 0..singular.rank(RANK) {
        inverse += singular.v_t.row(q).transpose() * singular.u.column(q).transpose() / singular.values[q];
    }
    Some(inverse)
}

/// Returns a basis of the left null space of a matrix; `None` if its rows are linearly independent. Blocks that share
/// neither rows nor columns have null spaces of their own.
fn left_null_space(matrix: &DMatrix<f64>) -> Option<DMatrix<f64>> {
    let mut basis: Vec<(Vec<usize>, DMatrix<f64>)> = Vec::new();
    for (rows, columns) in independent_blocks(matrix) {
        let block = matrix.select_rows(&rows).select_columns(&columns);
        if let Some(null) = left_null_space_of_block(block) {
            basis.push((rows, null));
        }
    }
    let count: usize = basis.iter().map(|(_, null)| null.nrows()).sum();
    if count == 0 {
        return None;
    }
    let mut all = DMatrix::<f64>::zeros(count, matrix.nrows());
    let mut next = 0;
    for (rows, null) in basis {
        for (column, &row) in rows.iter().enumerate() {
            all.view_mut((next, row), (null.nrows(), 1)).copy_from(&null.column(column));
        }
        next += null.nrows();
    }
    Some(all)
}

/// Returns the rows and the columns of each block of a matrix such that blocks share neither rows nor columns; a
/// column of zeros belongs to no block.
fn independent_blocks(matrix: &DMatrix<f64>) -> Vec<(Vec<usize>, Vec<usize>)> {
    let rows = matrix.nrows();
    let mut edges = vec![Vec::new(); rows + matrix.ncols()];
    for (j, column) in matrix.column_iter().enumerate() {
        for (i, _) in column.iter().enumerate().filter(|(_, entry)| **entry != 0.0) {
            edges[i].push(rows + j);
            edges[rows + j].push(i);
        }
    }
    let mut blocks = Vec::new();
    for mut block in components(&edges) {
        let of_columns = block.split_off(block.partition_point(|&node| node < rows));
        if !block.is_empty() {
            blocks.push((block, of_columns.into_iter().map(|node| node - rows).collect()));
        }
    }
    blocks
}

/// Returns a basis of the left null space of a matrix that is treated as one block; `None` if its rows are linearly
/// independent.
fn left_null_space_of_block(matrix: DMatrix<f64>) -> Option<DMatrix<f64>> {
    let rows = matrix.nrows();
    let lu = FullPivLU::new(matrix);
    let u = lu.u();
    let pivots: Vec<f64> = (0..u.nrows().min(u.ncols())).map(|i| u[(i, i)].abs()).collect();
    let largest = pivots.first().copied().unwrap_or(0.0);
    let rank = pivots.iter().take_while(|pivot| **pivot > RANK * largest && **pivot > 0.0).count();
    if rank == rows {
        return None;
    }
    let mut basis = DMatrix::<f64>::identity(rows, rows);
    lu.p().permute_rows(&mut basis);
    let lower = lu.l();
    for row in 0..rows {
        for above in 0..row.min(lower.ncols()).min(rank) {
            let factor = lower[(row, above)];
            if factor != 0.0 {
                let eliminated = basis.row(above) * factor;
                basis.row_mut(row).zip_apply(&eliminated, |entry, other| *entry -= other);
            }
        }
    }
    Some(basis.rows(rank, rows - rank).into_owned())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn null_vectors_are_those_of_the_combinations_that_vanish() {
        // Row three of the matrix is the sum of the first two.
        let matrix = DMatrix::from_row_slice(3, 3, &[1.0, 2.0, 0.0, 0.0, 1.0, 1.0, 1.0, 3.0, 1.0]);
        let null = left_null_space(&matrix).expect("one combination");
        assert_eq!(null.nrows(), 1);
        assert!((null * matrix).amax() < 1e-15);
        assert!(left_null_space(&DMatrix::identity(3, 3)).is_none());
    }

    #[test]
    fn blocks_that_share_neither_rows_nor_columns_have_null_spaces_of_their_own() {
        // Rows 0 and 3 of the matrix are parallel, row 1 is empty, and row 2 shares no column with another row.
        let mut matrix = DMatrix::<f64>::zeros(4, 5);
        (matrix[(0, 1)], matrix[(0, 4)], matrix[(3, 1)], matrix[(3, 4)], matrix[(2, 2)]) = (1.0, 2.0, 0.5, 1.0, 3.0);
        assert_eq!(independent_blocks(&matrix).len(), 3);
        let null = left_null_space(&matrix).expect("two combinations");
        assert_eq!(null.nrows(), 2);
        assert!((&null * matrix).amax() < 1e-15);
        assert_eq!(Singular::of(&null).expect("finite").rank(RANK), 2);
    }
}
