//! Selection of a face whose equations determine the variables, among the faces that belong to one solution of an
//! affine VI.
//!
//! If several inequalities are degenerate (a variable on its bound with `G = 0`), or variables are not unique, the
//! values of a solution do not determine its face: diodes that block together share a voltage in any proportion. Let
//! `u` and `v` be the left and the right null vector of `S_II`, where `I` are the free variables. Then `z_I + tau v`
//! solves the same VI until a variable reaches its bound or another `G` becomes zero. There a variable leaves `I` or
//! enters it, and the matrix becomes regular if neither `u` nor `v` vanishes on the change: the step from a solution to
//! a basic one, like that from an interior point of a linear program to a vertex (Megiddo 1991).

use factorisation::{Singular, equilibrated};
use nalgebra::DMatrix;

/// Relative rank threshold: singular values below this fraction of the largest count as zero, in a matrix with rows and
/// columns scaled to one.
const RANK: f64 = 1e-10;

/// A variable of an affine VI over an interval.
#[derive(Clone, Copy, Debug)]
pub(super) struct Member {
    /// Index of the row and column of the variable in the matrix of the affine VI.
    pub at: usize,
    pub z: f64,
    pub g: f64,
    pub lower: f64,
    pub upper: f64,
    pub rests: Rests,
}

/// Position of a variable of the affine VI in its interval: free, or on a bound.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Rests {
    Inactive,
    Lower,
    Upper,
}

/// End of the path along a null vector of the matrix of the free variables, where one variable changes its position in
/// its interval.
struct End {
    /// Distance from the solution to the end of the path, in units of the null vector.
    tau: f64,
    member: usize,
    rests: Rests,
    /// Pivot of the matrix of the free variables behind the end of the path: the larger, the more regular is that
    /// matrix.
    pivot: f64,
}

/// Moves the variables of a solution of an affine VI along null vectors until the matrix of the free variables is
/// regular; returns whether anything changed.
pub(super) fn regularise(matrix: &DMatrix<f64>, members: &mut [Member]) -> bool {
    let mut changed = false;
    for _ in 0..members.len() {
        let inside: Vec<usize> = (0..members.len()).filter(|&i| members[i].rests == Rests::Inactive).collect();
        let Some((u, v)) = null_vectors(matrix, members, &inside) else { return changed };
        let slope = |row: usize| -> f64 { inside.iter().zip(&v).map(|(&j, v)| matrix[(row, members[j].at)] * v).sum() };
        let mut ends: Vec<End> = Vec::new();
        for ((&i, v), u) in inside.iter().zip(&v).zip(&u) {
            let Member { z, lower, upper, .. } = members[i];
            let pivot = (u * v).abs();
            ends.push(End { tau: (lower - z) / v, member: i, rests: Rests::Lower, pivot });
            ends.push(End { tau: (upper - z) / v, member: i, rests: Rests::Upper, pivot });
        }
        for (i, member) in members.iter().enumerate().filter(|(_, member)| member.rests != Rests::Inactive) {
            let slope = slope(member.at);
            let column: f64 = inside.iter().zip(&u).map(|(&j, u)| u * matrix[(members[j].at, member.at)]).sum();
            ends.push(End { tau: -member.g / slope, member: i, rests: Rests::Inactive, pivot: (slope * column).abs() });
        }
        let most = ends.iter().map(|end| end.pivot).fold(0.0, f64::max);
        let usable = ends.into_iter().filter(|end| end.tau.is_finite() && end.pivot > RANK * most);
        let Some(End { tau, member, rests, .. }) =
            usable.min_by(|a, b| a.tau.abs().total_cmp(&b.tau.abs()).then(b.pivot.total_cmp(&a.pivot)))
        else {
            return changed;
        };
        let slopes: Vec<f64> = members.iter().map(|member| slope(member.at)).collect();
        for (member, slope) in members.iter_mut().zip(slopes).filter(|(member, _)| member.rests != Rests::Inactive) {
            member.g += tau * slope;
        }
        inside.iter().zip(&v).for_each(|(&i, v)| members[i].z += tau * v);
        let moved = &mut members[member];
        moved.rests = rests;
        match rests {
            Rests::Lower => moved.z = moved.lower,
            Rests::Upper => moved.z = moved.upper,
            Rests::Inactive => moved.g = 0.0,
        }
        changed = true;
    }
    changed
}

/// Returns the left and the right null vector of the matrix of the free variables; `None` if the matrix is regular.
fn null_vectors(matrix: &DMatrix<f64>, members: &[Member], inside: &[usize]) -> Option<(Vec<f64>, Vec<f64>)> {
    let count = inside.len();
    let own = DMatrix::from_fn(count, count, |i, j| matrix[(members[inside[i]].at, members[inside[j]].at)]);
    let (scaled, of_rows, of_columns) = equilibrated(own);
    let singular = Singular::of(&scaled)?;
    if count == 0 || singular.rank(RANK) == count {
        return None;
    }
    let u = singular.u.column(count - 1).iter().zip(&of_rows).map(|(u, scale)| u * scale).collect();
    let v = singular.v_t.row(count - 1).iter().zip(&of_columns).map(|(v, scale)| v * scale).collect();
    Some((u, v))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn member(at: usize, z: f64, g: f64, rests: Rests) -> Member {
        Member { at, z, g, lower: 0.0, upper: f64::INFINITY, rests }
    }

    /// Two diodes in series block 3 V together: the voltage between them is undetermined.
    #[test]
    fn a_shared_voltage_ends_where_one_diode_has_none() {
        // z = (the current of the first diode, the voltage of the second), G = (3 - z_2 - .., z_1).
        let matrix = DMatrix::from_row_slice(2, 2, &[0.0, -1.0, 1.0, 0.0]);
        let mut members = [member(0, 0.0, 2.0, Rests::Lower), member(1, 1.0, 0.0, Rests::Inactive)];
        assert!(regularise(&matrix, &mut members));
        // The second diode has no voltage left: its variable rests on its bound, and none is free.
        assert_eq!((members[1].rests, members[1].z, members[0].g), (Rests::Lower, 0.0, 3.0));
        let mut members = [member(0, 0.0, 0.5, Rests::Lower), member(1, 2.5, 0.0, Rests::Inactive)];
        assert!(regularise(&matrix, &mut members));
        // The first diode has no voltage left: its current may flow, and the two equations together are regular.
        assert_eq!((members[0].rests, members[1].rests, members[1].z), (Rests::Inactive, Rests::Inactive, 3.0));
    }
}
