//! The derivative of an instantaneous impact with the statuses of contacts after it held fixed. Velocities and
//! impulses solve
//!
//! ```text
//! M (v+ - v-) = J^T r,    joints: u+ = 0,    closed: u_n+ = -e u_n-,    stick: u_t+ = 0,    slip: r_t = -mu r_n u_t+/|u_t+|
//! ```
//!
//! The total derivatives of these equations, with coordinates and time that move with the event, are linear in `dv+`
//! and `dr`.

use super::linearised::{Columns, Place, Terms, solve};
use super::{Directions, NoDerivative};
use crate::locate::ROUNDING_OF_VELOCITIES;
use nalgebra::{DMatrix, Matrix2, Vector2, Vector3};
use problem::{Constraints, Mechanical, MechanicalStructure};

/// Tolerances of an impact: below `BORDER`, the slack in the friction bound (relative to the bound) and slips
/// (relative to the change of velocities) put the impact on the border between stick and slip; `OFF_TARGET` is the
/// largest relative deviation of a normal velocity from its target.
const BORDER: f64 = 1e-7;
const OFF_TARGET: f64 = 1e-6;

/// The total derivatives at an impact whose time depends on the direction, and on the coordinate: islands have their
/// own event times.
pub(super) struct Moved {
    /// Total derivatives of the coordinates, one direction per column.
    pub q: DMatrix<f64>,
    /// Total derivatives of the velocities, one direction per column.
    pub v: DMatrix<f64>,
    /// Derivatives of the event time, one row for each coordinate.
    pub times: DMatrix<f64>,
}

/// One blow of an impact: impulses that act at the same instant at one or several contacts. Sequential impacts have
/// several blows.
pub(super) struct Blow<'a> {
    /// The impulses of all contacts in the blow.
    pub r: &'a [Vector3<f64>],
    /// Whether contacts that approach rebound with their restitution.
    pub rebounds: bool,
}

/// Carries velocities `v` and their derivatives in `moved` across one blow of an impact at the time `t` and the
/// coordinates `q`.
pub(super) fn pass(
    problem: &mut dyn Mechanical,
    structure: &MechanicalStructure,
    (t, q, v): (f64, &[f64], &mut Vec<f64>),
    blow: &Blow<'_>,
    directions: &mut Directions,
    moved: &mut Moved,
) -> Result<(), NoDerivative> {
    let singular = NoDerivative::Smooth(radau::NoDerivative::Singular);
    let (n, rows, p) = (structure.coordinates, structure.rows(), directions.count());
    let columns = Columns { coordinates: n, directions: p };
    let mut mass = DMatrix::zeros(n, n);
    problem.mass(t, q, &mut mass);
    let mut constraints = Constraints::new(structure);
    problem.constraints(t, q, &mut constraints);
    let mut impulses = vec![0.0; rows];
    for (k, r) in blow.r.iter().enumerate() {
        let all = std::iter::once(structure.normal(k)).chain(structure.tangents(k));
        all.zip(r.iter()).for_each(|(row, r)| impulses[row] = *r);
    }
    let after = strike(&mass, &constraints, structure, v, &mut impulses).ok_or(singular)?;
    let change: Vec<f64> = after.iter().zip(v.iter()).map(|(after, before)| after - before).collect();

    // The derivatives of `M (v+ - v-) - J^T r` at fixed velocities and impulses are those of `with` less those of
    // `at_rest`, without impulses, since the forces contribute equally to both.
    let none = (vec![0.0; n], vec![0.0; rows]);
    let place = |v, a, lambda| Place { t, q, v, a, lambda };
    let with = Terms::at(problem, structure, place(&after, &change, &impulses), directions);
    let without = Terms::at(problem, structure, place(v, &none.0, &none.1), directions);
    let at_rest = Terms::at(problem, structure, place(&after, &none.0, &none.1), directions);
    // Forces depend on velocities, so `at_rest` has the velocities after the blow, as `with` has.
    let balance = &with.balance - &at_rest.balance;
    let total = |of: &DMatrix<f64>, row: usize, coordinate: usize| {
        let mut sum = of.view((row, 0), (1, n)) * &moved.q + of.view((row, 2 * n), (1, p));
        sum += moved.times.row(coordinate) * of[(row, columns.time())];
        sum
    };
    // A row of `J` moves with the event time of the island of its coordinates.
    let coordinate = |row: usize| {
        let gradient = constraints.row(row);
        (0..n).max_by(|&i, &j| gradient[i].abs().total_cmp(&gradient[j].abs())).unwrap_or(0)
    };

    let active: Vec<usize> = (0..blow.r.len()).filter(|&k| blow.r[k].x > 0.0).collect();
    let mut unknown: Vec<usize> = (0..structure.joints).collect();
    unknown.extend(active.iter().map(|&k| structure.normal(k)));
    unknown.extend(active.iter().flat_map(|&k| structure.tangents(k)));
    let size = n + unknown.len();
    let mut matrix = DMatrix::zeros(size, size);
    let mut right = DMatrix::zeros(size, p);
    matrix.view_mut((0, 0), (n, n)).copy_from(&mass);
    let mut carried = &mass * &moved.v;
    for i in 0..n {
        let mut row = carried.row_mut(i);
        row -= total(&balance, i, i);
    }
    right.rows_mut(0, n).copy_from(&carried);
    for (place, &row) in unknown.iter().enumerate() {
        let mut column = matrix.view_mut((0, n + place), (n, 1));
        column -= constraints.transposed.column(row);
    }
    let at = |row: usize| n + unknown.iter().position(|&other| other == row).unwrap_or(0);
    let velocity_row = |row: usize| constraints.transposed.column(row).transpose();
    let of_velocity = |row: usize| total(&with.velocity, row, coordinate(row));
    for row in 0..structure.joints {
        matrix.view_mut((at(row), 0), (1, n)).copy_from(&velocity_row(row));
        right.row_mut(at(row)).copy_from(&-of_velocity(row));
    }
    for k in 0..blow.r.len() {
        let normal = structure.normal(k);
        let (approach, leave) = (constraints.velocity(normal, v), constraints.velocity(normal, &after));
        let contact = &structure.contacts[k];
        let e = if blow.rebounds && approach < 0.0 { contact.restitution } else { 0.0 };
        let speed = approach.abs() + leave.abs();
        if blow.r[k].x <= 0.0 {
            continue;
        }
        if (leave + e * approach).abs() > OFF_TARGET * speed.max(constraints.terms(normal, v)) {
            return Err(NoDerivative::Limited);
        }
        matrix.view_mut((at(normal), 0), (1, n)).copy_from(&velocity_row(normal));
        let before = velocity_row(normal) * &moved.v + total(&without.velocity, normal, coordinate(normal));
        let of_e = directions.restitution.row(k) * if e > 0.0 || blow.rebounds { approach.min(0.0) } else { 0.0 };
        right.row_mut(at(normal)).copy_from(&(-of_velocity(normal) - before * e - of_e));
        let slips = contact.slips;
        if slips == 0 {
            continue;
        }
        let (r, bound) = (Vector2::new(blow.r[k].y, blow.r[k].z), contact.mu * blow.r[k].x);
        let u = constraints.slip(structure.tangents(k), &after);
        let changed = (u - constraints.slip(structure.tangents(k), v)).norm().max(speed);
        let rounding = structure
            .tangents(k)
            .map(|row| ROUNDING_OF_VELOCITIES * constraints.terms(row, &after))
            .fold(0.0, f64::max);
        let is_slipping = u.norm() > BORDER * changed + rounding;
        let slack = bound - r.norm();
        // The impulses of a weak blow have rounding errors that come from the rounding errors of fast slips.
        let is_inside = slack > BORDER * bound
            && slack * impulse_response(&mass, &constraints, structure.tangents(k)).ok_or(singular)? > rounding;
        if is_inside == is_slipping {
            return Err(NoDerivative::Degenerate);
        }
        if !is_slipping {
            for row in structure.tangents(k) {
                matrix.view_mut((at(row), 0), (1, n)).copy_from(&velocity_row(row));
                right.row_mut(at(row)).copy_from(&-of_velocity(row));
            }
            continue;
        }
        let d = u / u.norm();
        let turning =
            if slips == 2 { (Matrix2::identity() - d * d.transpose()) * (bound / u.norm()) } else { Matrix2::zeros() };
        for (i, row) in structure.tangents(k).enumerate() {
            matrix[(at(row), at(row))] += 1.0;
            matrix[(at(row), at(normal))] += contact.mu * d[i];
            let mut own = -directions.mu.row(k) * (blow.r[k].x * d[i]);
            for (j, by) in structure.tangents(k).enumerate() {
                let mut place = matrix.view_mut((at(row), 0), (1, n));
                place += velocity_row(by) * turning[(i, j)];
                own -= of_velocity(by) * turning[(i, j)];
            }
            right.row_mut(at(row)).copy_from(&own);
        }
    }
    let found = solve(matrix, &right).ok_or(singular)?;
    moved.v.copy_from(&found.rows(0, n));
    *v = after;
    Ok(())
}

/// Returns the largest change of velocity along one of the given rows of `J` by a unit impulse along that row.
fn impulse_response(mass: &DMatrix<f64>, constraints: &Constraints, rows: impl Iterator<Item = usize>) -> Option<f64> {
    let n = mass.nrows();
    let along = DMatrix::from_columns(&rows.map(|row| constraints.transposed.column(row)).collect::<Vec<_>>());
    let changes = solve(mass.clone(), &along)?;
    let own = along.column_iter().zip(changes.column_iter()).map(|(along, change)| along.dot(&change.rows(0, n)));
    Some(own.fold(0.0, f64::max))
}

/// Returns the velocities after the given impulses of contacts, and writes the impulses of the joints into the first
/// entries of `impulses`.
fn strike(
    mass: &DMatrix<f64>,
    constraints: &Constraints,
    structure: &MechanicalStructure,
    v: &[f64],
    impulses: &mut [f64],
) -> Option<Vec<f64>> {
    let (n, joints) = (structure.coordinates, structure.joints);
    let size = n + joints;
    let mut matrix = DMatrix::zeros(size, size);
    let mut right = DMatrix::zeros(size, 1);
    matrix.view_mut((0, 0), (n, n)).copy_from(mass);
    let before = mass * DMatrix::from_column_slice(n, 1, v);
    right.rows_mut(0, n).copy_from(&before);
    for (row, impulse) in impulses.iter().enumerate().skip(joints) {
        let mut carried = right.rows_mut(0, n);
        carried += constraints.transposed.column(row) * *impulse;
    }
    for row in 0..joints {
        let gradient = constraints.transposed.column(row);
        matrix.view_mut((n + row, 0), (1, n)).copy_from(&gradient.transpose());
        matrix.view_mut((0, n + row), (n, 1)).copy_from(&-gradient);
        right[n + row] = -constraints.drift[row];
    }
    let found = solve(matrix, &right)?;
    (0..joints).for_each(|row| impulses[row] = found[n + row]);
    Some(found.rows(0, n).iter().copied().collect())
}
