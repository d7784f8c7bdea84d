//! What a stepper sees of a mechanical system in generalised coordinates `q`, with velocities `v = q'`:
//!
//! ```text
//! M(t,q) v' = f(t,q,v) + J(t,q)^T lambda,    u = J(t,q) v + b(t,q)
//! ```
//!
//! The rows of `J` are those of the joints, whose constraint `phi(t,q)` stays zero (`u = phi'`), then the normals of the
//! contacts, whose `gap(t,q)` must not be negative (`u_n = gap'`), then the directions of slip. `f` holds all forces, those
//! of the potential and of `M` itself (Coriolis, centrifugal).

use nalgebra::{DMatrix, Vector2};
use numerics::Interval;
use std::ops::Range;

/// How a contact resists slip and rebounds.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ContactData {
    /// The coefficient of friction; zero without friction.
    pub mu: f64,
    /// The coefficient of restitution, from 0 to 1.
    pub restitution: f64,
    /// The first of its directions of slip among those of all contacts.
    pub first_slip: usize,
    /// Its directions of slip: none, one or two; none without friction.
    pub slips: usize,
    /// The corners of the polygon that friction is taken from; none is the disk.
    pub facets: Option<usize>,
}

/// The shape of a mechanical system.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct MechanicalStructure {
    /// `n`, the number of coordinates.
    pub coordinates: usize,
    /// The number of joints.
    pub joints: usize,
    /// The contacts.
    pub contacts: Vec<ContactData>,
    /// Whether `M` is the same everywhere.
    pub constant_mass: bool,
    /// Whether `f` depends neither on `q` nor on `v`.
    pub constant_forces: bool,
    /// Whether forces, masses, joints, gaps or slips depend on time explicitly.
    pub depends_on_time: bool,
    /// Whether forces, masses, joints, gaps or slips are more than polynomials of low degree in `q` and `v`.
    pub has_features: bool,
    /// Whether joints and gaps are affine functions of `q` alone: on a straight way they are least at its ends.
    pub affine_constraints: bool,
}

impl MechanicalStructure {
    /// The number of directions of slip.
    pub fn slips(&self) -> usize {
        self.contacts.iter().map(|contact| contact.slips).sum()
    }

    /// The number of rows of `J`.
    pub fn rows(&self) -> usize {
        self.joints + self.contacts.len() + self.slips()
    }

    /// The row of the normal of contact `k`.
    pub fn normal(&self, k: usize) -> usize {
        self.joints + k
    }

    /// The rows of the slip directions of contact `k`.
    pub fn tangents(&self, k: usize) -> Range<usize> {
        let first = self.joints + self.contacts.len() + self.contacts[k].first_slip;
        first..first + self.contacts[k].slips
    }
}

/// Constraints at one place.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Constraints {
    /// `phi` of the joints, then the gaps.
    pub values: Vec<f64>,
    /// `b`, one a row.
    pub drift: Vec<f64>,
    /// `J^T`, a column for each row of `J`.
    pub transposed: DMatrix<f64>,
}

impl Constraints {
    /// Room for the constraints of a system.
    pub fn new(structure: &MechanicalStructure) -> Self {
        Self {
            values: vec![0.0; structure.joints + structure.contacts.len()],
            drift: vec![0.0; structure.rows()],
            transposed: DMatrix::zeros(structure.coordinates, structure.rows()),
        }
    }

    /// `u_i` at velocities `v`.
    pub fn velocity(&self, row: usize, v: &[f64]) -> f64 {
        self.drift[row] + dot(self.row(row), v)
    }

    /// The size of the terms that `u_i` is the sum of.
    pub fn terms(&self, row: usize, v: &[f64]) -> f64 {
        self.drift[row].abs() + self.size(row, v)
    }

    /// `sum_j |J_ij x_j|`: the size of the terms in which coordinates, or velocities, enter row `i`.
    pub fn size(&self, row: usize, x: &[f64]) -> f64 {
        self.row(row).iter().zip(x).map(|(j, x)| (j * x).abs()).sum()
    }

    /// `u_t` of the contact with these rows, at velocities `v`; zero in directions that it has not.
    pub fn slip(&self, tangents: Range<usize>, v: &[f64]) -> Vector2<f64> {
        let mut slip = Vector2::zeros();
        slip.iter_mut().zip(tangents).for_each(|(slip, row)| *slip = self.velocity(row, v));
        slip
    }

    /// Row `i` of `J`.
    pub fn row(&self, row: usize) -> &[f64] {
        let n = self.transposed.nrows();
        &self.transposed.as_slice()[row * n..(row + 1) * n]
    }
}

fn dot(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(a, b)| a * b).sum()
}

/// Intervals that hold what motion depends on, over a box of times, coordinates and velocities.
#[derive(Clone, Debug, Default)]
pub struct DynamicsRange {
    /// `M`, row by row.
    pub mass: Vec<Interval>,
    /// `f`.
    pub forces: Vec<Interval>,
    /// `gamma`, a number for each row of `J`.
    pub bias: Vec<Interval>,
    /// `b`, likewise.
    pub drift: Vec<Interval>,
    /// `J`, row by row.
    pub rows: Vec<Interval>,
}

impl DynamicsRange {
    /// Room for those of a system.
    pub fn new(structure: &MechanicalStructure) -> Self {
        let (n, rows) = (structure.coordinates, structure.rows());
        let room = |count: usize| vec![Interval::LINE; count];
        Self { mass: room(n * n), forces: room(n), bias: room(rows), drift: room(rows), rows: room(rows * n) }
    }

    /// Row `i` of `J`.
    pub fn row(&self, row: usize) -> &[Interval] {
        let n = self.forces.len();
        &self.rows[row * n..(row + 1) * n]
    }
}

/// Intervals that hold what [`Sensitivity`] says of accelerations and balance, row by row of `2 n`.
#[derive(Clone, Debug, Default)]
pub struct SensitivityRange {
    /// Of `M a - f - J^T lambda`, `n` rows.
    pub balance: Vec<Interval>,
    /// Of `u'`, a row for each of `J`.
    pub acceleration: Vec<Interval>,
}

/// Energies, and the powers that change them.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Energies {
    /// `v^T M v / 2`.
    pub kinetic: f64,
    /// The potential.
    pub potential: f64,
    /// `Q^T v`.
    pub power: f64,
    /// `dV/dt - dT/dt` at fixed `q` and `v`: the power of whatever changes the potential and the masses with time.
    pub drive: f64,
}

/// The sensitivity of accelerations and multipliers: derivatives by `(q, v)`, `2 n` columns.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Sensitivity {
    /// Of `M a - f - J^T lambda` at fixed `a` and `lambda`, `n` rows.
    pub balance: DMatrix<f64>,
    /// Of `u' = J a + gamma` at fixed `a`, a row for each of `J`.
    pub acceleration: DMatrix<f64>,
    /// Of `u = J v + b`.
    pub velocity: DMatrix<f64>,
}

/// A mechanical system, ready to be evaluated. What is not defined comes out as NaN or an infinity.
pub trait Mechanical: Send {
    /// Sizes and contacts.
    fn structure(&self) -> &MechanicalStructure;

    /// Writes `M`, `n x n`.
    fn mass(&mut self, t: f64, q: &[f64], mass: &mut DMatrix<f64>);

    /// Writes `f`.
    fn forces(&mut self, t: f64, q: &[f64], v: &[f64], f: &mut [f64]);

    /// Writes the derivatives of `f` by `q` and `v`.
    fn stiffness(&mut self, t: f64, q: &[f64], v: &[f64], by_q: &mut DMatrix<f64>, by_v: &mut DMatrix<f64>);

    /// Writes joints, gaps, slips and their directions.
    fn constraints(&mut self, t: f64, q: &[f64], constraints: &mut Constraints);

    /// Writes joints and gaps alone.
    fn positions(&mut self, t: f64, q: &[f64], values: &mut [f64]);

    /// Writes intervals that hold joints and gaps wherever `t` and `q` are in theirs.
    fn enclose_positions(&mut self, t: Interval, q: &[Interval], values: &mut [Interval]);

    /// Writes intervals that hold the velocities of joints and gaps wherever `t`, `q` and `v` are in theirs.
    fn enclose_velocities(&mut self, t: Interval, q: &[Interval], v: &[Interval], values: &mut [Interval]);

    /// Writes intervals that hold `f`, then `b`, then `gamma`, at one place wherever `t` is in its own.
    fn enclose_in_time(&mut self, t: Interval, q: &[f64], v: &[f64], values: &mut [Interval]);

    /// Writes intervals that hold masses, forces, bias, drift and `J` wherever `t`, `q` and `v` are in theirs.
    fn enclose_dynamics(&mut self, t: Interval, q: &[Interval], v: &[Interval], range: &mut DynamicsRange);

    /// Writes intervals that hold derivatives at accelerations `a` and multipliers `lambda` of all rows likewise.
    fn enclose_sensitivity(
        &mut self,
        t: Interval,
        x: &[Interval],
        a: &[f64],
        lambda: &[f64],
        range: &mut SensitivityRange,
    );

    /// Whether one of these may jump, by what depends on `q` and `v`, somewhere in a box.
    fn may_jump(&mut self, _t: Interval, _x: &[Interval]) -> bool {
        false
    }

    /// What changes its sign where something has a kink or a jump at a time, whatever `q` and `v` are.
    fn breaks(&mut self, _t: f64) -> &[f64] {
        &[]
    }

    /// Intervals that hold the same wherever `t` is in an interval; none where they cannot be enclosed.
    fn enclose_breaks(&mut self, _t: Interval) -> &[Interval] {
        &[]
    }

    /// Energies and power.
    fn energies(&mut self, t: f64, q: &[f64], v: &[f64]) -> Energies;

    /// Writes `gamma`, what `u'` is where `v' = 0`, a number for each row of `J`.
    fn bias(&mut self, t: f64, q: &[f64], v: &[f64], gamma: &mut [f64]);

    /// Writes derivatives at accelerations `a` and multipliers `lambda` of all rows.
    fn sensitivity(&mut self, t: f64, q: &[f64], v: &[f64], a: &[f64], lambda: &[f64], out: &mut Sensitivity);

    /// How closely its own clock tells a time.
    fn rounding_of_time(&self, t: f64) -> f64 {
        f64::EPSILON * t.abs()
    }
}
