//! The linearised equations of a contact mode. With the balance `M a - f - J^T lambda = 0`, the held rows `C a +
//! gamma = 0` and friction `lambda_t = -mu lambda_n d`, accelerations and multipliers change by
//!
//! ```text
//! M da - G dlambda = -(d(M a - f - J^T lambda) + sum J_t^T (dmu lambda_n d + mu lambda_n dd)),    C da = -d(u')
//! ```
//!
//! where `d` of the balance or of a held row is its derivative at fixed `a` and `lambda`, in the columns of a
//! [`Columns`].

use super::Directions;
use crate::locate::{ModeEquations, Status};
use factorisation::Pivoted;
use nalgebra::{DMatrix, DVector, Matrix2, Vector2};
use problem::{Constraints, Mechanical, MechanicalStructure, Sensitivity};

/// Layout of columns of derivatives: `q` and `v` (`2 n` columns), then the directions, then time.
#[derive(Clone, Copy, Debug)]
pub(super) struct Columns {
    pub coordinates: usize,
    pub directions: usize,
}

impl Columns {
    pub fn all(self) -> usize {
        self.time() + 1
    }

    pub fn direction(self, p: usize) -> usize {
        2 * self.coordinates + p
    }

    pub fn time(self) -> usize {
        2 * self.coordinates + self.directions
    }
}

/// A point of a motion in state space, with accelerations and multipliers of all rows of `J`; at an impact, `a` and
/// `lambda` are the changes of velocities and the impulses instead.
#[derive(Clone, Copy)]
pub(super) struct Place<'a> {
    pub t: f64,
    pub q: &'a [f64],
    pub v: &'a [f64],
    pub a: &'a [f64],
    pub lambda: &'a [f64],
}

/// The derivatives of the terms of the equations of motion at fixed accelerations and multipliers, in [`Columns`].
pub(super) struct Terms {
    /// Derivatives of the balance `M a - f - J^T lambda`, `n` rows.
    pub balance: DMatrix<f64>,
    /// Derivatives of the contact and joint accelerations `u'`, one row per row of `J`.
    pub acceleration: DMatrix<f64>,
    /// Derivatives of the contact and joint velocities `u`, one row per row of `J`.
    pub velocity: DMatrix<f64>,
    /// Derivatives of the values of joints and gaps, one per row.
    pub values: DMatrix<f64>,
}

impl Terms {
    pub fn at(
        problem: &mut dyn Mechanical,
        structure: &MechanicalStructure,
        place: Place<'_>,
        directions: &mut Directions,
    ) -> Self {
        let Place { t, q, v, a, lambda } = place;
        let (n, rows, holonomic) =
            (structure.coordinates, structure.rows(), structure.joints + structure.contacts.len());
        let columns = Columns { coordinates: n, directions: directions.count() };
        let mut by_state = Sensitivity::default();
        problem.sensitivity(t, q, v, a, lambda, &mut by_state);
        let mut by_time = vec![0.0; n + 2 * rows];
        problem.sensitivity_in_time(t, q, v, a, lambda, &mut by_time);
        let mut constraints = Constraints::new(structure);
        problem.constraints(t, q, &mut constraints);
        let mut own = DMatrix::zeros(n + 2 * rows + holonomic, columns.directions);
        directions.evaluate(t, &[q, v, a, lambda].concat(), &mut own);
        let part = |by_state: &DMatrix<f64>, first: usize, by_time: &[f64]| {
            let mut all = DMatrix::zeros(by_time.len(), columns.all());
            all.columns_mut(0, 2 * n).copy_from(by_state);
            all.columns_mut(2 * n, columns.directions).copy_from(&own.rows(first, by_time.len()));
            all.column_mut(columns.time()).copy_from_slice(by_time);
            all
        };
        let mut by_place = DMatrix::zeros(holonomic, 2 * n);
        for row in 0..holonomic {
            by_place.view_mut((row, 0), (1, n)).copy_from_slice(constraints.row(row));
        }
        Self {
            balance: part(&by_state.balance, 0, &by_time[..n]),
            acceleration: part(&by_state.acceleration, n, &by_time[n..n + rows]),
            velocity: part(&by_state.velocity, n + rows, &by_time[n + rows..]),
            values: part(&by_place, n + 2 * rows, &constraints.drift[..holonomic]),
        }
    }
}

/// The derivatives of accelerations and multipliers in a contact mode, in [`Columns`], with those of velocities and
/// gaps.
pub(super) struct Linearised {
    pub a: DMatrix<f64>,
    /// The absolute values of the terms of the derivatives of accelerations: by the forces, and by the contact and
    /// joint forces that react to them.
    pub terms: DMatrix<f64>,
    pub lambda: DMatrix<f64>,
    pub velocity: DMatrix<f64>,
    pub values: DMatrix<f64>,
    /// Whether the multipliers (contact and joint forces) of the contact mode are not unique.
    pub is_redundant: bool,
}

impl Linearised {
    /// Linearises the mode of `equations` at a state; returns `None` if the equations are singular.
    pub fn at(equations: &mut ModeEquations, t: f64, x: &[f64], directions: &mut Directions) -> Option<Self> {
        let structure = equations.shape().clone();
        let n = structure.coordinates;
        equations.evaluate_at(t, x);
        equations.solved_last()?;
        let (a, lambda) = (equations.a.clone(), equations.lambda.clone());
        let (q, v) = x.split_at(n);
        let place = Place { t, q, v, a: &a, lambda: &lambda };
        let Terms { mut balance, acceleration, velocity, values } =
            Terms::at(equations.problem(), &structure, place, directions);
        let columns = Columns { coordinates: n, directions: directions.count() };
        // The derivatives of friction at a fixed normal force: -(dmu d + mu dd) lambda_n.
        let mut friction = DMatrix::zeros(structure.rows(), columns.all());
        for (k, contact) in structure.contacts.iter().enumerate() {
            let Some((d, speed)) = equations.slip_direction(k, v) else { continue };
            let normal = lambda[structure.normal(k)];
            let turning = match (contact.slips, speed) {
                (2, speed) if speed > 0.0 => (Matrix2::identity() - d * d.transpose()) * (contact.mu * normal / speed),
                _ => Matrix2::zeros(),
            };
            for (i, row) in structure.tangents(k).enumerate() {
                for p in 0..columns.directions {
                    friction[(row, columns.direction(p))] -= directions.mu[(k, p)] * normal * d[i];
                }
                for (j, by) in structure.tangents(k).enumerate() {
                    let change = velocity.row(by) * turning[(i, j)];
                    let mut row = friction.row_mut(row);
                    row -= change;
                }
            }
        }
        balance -= &equations.constraints().transposed * &friction;
        let held = equations.rows().to_vec();
        let solved = equations.solved_last()?;
        let right = DMatrix::from_fn(held.len(), columns.all(), |i, j| -acceleration[(held[i], j)]);
        let (by_a, of_held) = solved.solve(&-balance, &right);
        let reacted = &solved.y * &of_held;
        let terms = (&by_a - &reacted).abs() + reacted.abs();
        let mut lambda = friction;
        for (i, &row) in held.iter().enumerate() {
            lambda.row_mut(row).copy_from(&of_held.row(i));
        }
        for (k, contact) in structure.contacts.iter().enumerate() {
            let Some((d, _)) = equations.slip_direction(k, v) else { continue };
            let normal = lambda.row(structure.normal(k)).into_owned();
            for (i, row) in structure.tangents(k).enumerate() {
                let mut row = lambda.row_mut(row);
                row -= &normal * (contact.mu * d[i]);
            }
        }
        let is_redundant = equations.solved_last()?.shift.is_some();
        Some(Self { a: by_a, terms, lambda, velocity, values, is_redundant })
    }
}

/// Slip directions and speeds of contacts in a plane and in space.
impl ModeEquations {
    /// Returns the direction of the slip of contact `k`, and the speed to which its turning is inversely proportional
    /// (zero in a plane, where it does not turn).
    fn slip_direction(&self, k: usize, v: &[f64]) -> Option<(Vector2<f64>, f64)> {
        let Status::Slip(of_mode) = self.mode()[k] else { return None };
        if self.shape().contacts[k].slips < 2 {
            return Some((of_mode, 0.0));
        }
        let way = self.slip(k, v) + of_mode * self.least_slip(k);
        let speed = way.norm();
        Some(if speed > 0.0 { (way / speed, speed) } else { (way, 0.0) })
    }
}

/// Solves a square system; for a singular one returns the solution of least norm, or `None` if no solution exists.
pub(super) fn solve(matrix: DMatrix<f64>, right: &DMatrix<f64>) -> Option<DMatrix<f64>> {
    /// A residual beyond this fraction of the right-hand side means that there is no solution.
    const UNSOLVED: f64 = 1e-7;
    /// Pivots below this fraction of the largest are zero.
    const SINGULAR: f64 = 1e-12;
    if matrix.nrows() == 0 {
        return Some(right.clone());
    }
    let scale = |values: DVector<f64>| values.map(|value| if value > 0.0 { value.sqrt().recip() } else { 1.0 });
    let largest = DVector::from_fn(matrix.nrows(), |i, _| matrix.row(i).amax());
    let left = DMatrix::from_diagonal(&scale(largest));
    let columns = DVector::from_fn(matrix.ncols(), |j, _| matrix.column(j).amax());
    let across = DMatrix::from_diagonal(&scale(columns));
    let scaled = &left * &matrix * &across;
    let scaled_right = &left * right;
    let pivoted = Pivoted::new(scaled.clone());
    let found = match pivoted.rank(SINGULAR) {
        full if full == scaled.nrows() => pivoted.solve(&scaled_right)?,
        rank => pivoted.pseudo_inverse(rank)? * &scaled_right,
    };
    let rest = &scaled * &found - &scaled_right;
    let is_solved = (0..right.ncols()).all(|column| {
        let size = scaled_right.column(column).amax().max(found.column(column).amax() * f64::EPSILON);
        rest.column(column).amax() <= UNSOLVED * size
    });
    let found = across * found;
    (is_solved && found.iter().all(|value| value.is_finite())).then_some(found)
}
