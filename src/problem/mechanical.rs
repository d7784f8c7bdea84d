//! The interface between steppers and a mechanical system in generalised coordinates `q`, with velocities `v = q'`:
//!
//! ```text
//! M(t,q) v' = f(t,q,v) + J(t,q)^T lambda,    u = J(t,q) v + b(t,q)
//! ```
//!
//! The rows of `J` are those of the joints, with constraints `phi(t,q) = 0` (`u = phi'`), then the contact normals,
//! with gaps `gap(t,q) >= 0` (`u_n = gap'`), then the slip directions. `f` contains all forces, including those of the
//! potential and of `M` (Coriolis and centrifugal forces).

use nalgebra::{DMatrix, Vector2};
use numerics::Interval;
use std::ops::Range;

/// The contact law of a contact.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ContactData {
    /// The coefficient of friction; zero without friction. Where it varies, [`Mechanical::friction`] has its value.
    pub mu: f64,
    /// Whether the coefficient varies in time, with the state or with the speed of the slip.
    pub varies: bool,
    /// The coefficient in the second slip direction divided by that in the first: friction forces form an ellipse. The
    /// second row of slips is the velocity times this ratio, in which the ellipse is a disk (Goyal, Ruina and
    /// Papadopoulos 1991, *Planar sliding with dry friction*).
    pub ratio: f64,
    /// The coefficient of restitution, from 0 to 1.
    pub restitution: f64,
    /// The index of its first slip direction among those of all contacts.
    pub first_slip: usize,
    /// The number of slip directions: zero, one or two; zero without friction.
    pub slips: usize,
    /// The number of corners of a polygonal friction set; `None` for the disk.
    pub facets: Option<usize>,
}

impl ContactData {
    /// The speed of a slip given in rows of `J`, which are scaled where friction is anisotropic.
    pub fn slip_speed(&self, slip: &Vector2<f64>) -> f64 {
        slip.x.hypot(slip.y / self.ratio)
    }

    /// The derivative of [`ContactData::slip_speed`] by the rows of the slip, or where nothing slips, that along `way`.
    pub fn slip_speed_slope(&self, slip: &Vector2<f64>, way: &Vector2<f64>) -> Vector2<f64> {
        let along = if slip.norm() > 0.0 { slip } else { way };
        let speed = self.slip_speed(along);
        if speed > 0.0 { Vector2::new(along.x, along.y / (self.ratio * self.ratio)) / speed } else { Vector2::zeros() }
    }
}

/// The structure of a mechanical system.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct MechanicalStructure {
    /// `n`, the number of coordinates.
    pub coordinates: usize,
    /// The number of joints.
    pub joints: usize,
    /// The contacts.
    pub contacts: Vec<ContactData>,
    /// Whether `M` is constant.
    pub constant_mass: bool,
    /// Whether `f` depends neither on `q` nor on `v`.
    pub constant_forces: bool,
    /// Whether forces, masses, joints, gaps or slips depend on time explicitly.
    pub depends_on_time: bool,
    /// Whether forces, masses, joints, gaps or slips are other than polynomials of low degree in `q` and `v`.
    pub has_features: bool,
    /// Whether forces are other than polynomials of low degree in `q` and `v`.
    pub has_features_of_forces: bool,
    /// Whether joints and gaps are affine functions of `q` alone: along a straight line their minimum is at an end.
    pub affine_constraints: bool,
}

impl MechanicalStructure {
    /// The number of slip directions of all contacts.
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

/// The constraints at one `(t, q)`.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Constraints {
    /// `phi` of the joints, then the gaps.
    pub values: Vec<f64>,
    /// `b`, one value per row of `J`.
    pub drift: Vec<f64>,
    /// `J^T`, a column for each row of `J`.
    pub transposed: DMatrix<f64>,
}

impl Constraints {
    /// Allocates the constraints of a system.
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

    /// The sum of the absolute values of the terms of `u_i`, as scale for rounding.
    pub fn terms(&self, row: usize, v: &[f64]) -> f64 {
        self.drift[row].abs() + self.size(row, v)
    }

    /// `sum_j |J_ij x_j|`: the scale of the terms of row `i` in coordinates or velocities.
    pub fn size(&self, row: usize, x: &[f64]) -> f64 {
        self.row(row).iter().zip(x).map(|(j, x)| (j * x).abs()).sum()
    }

    /// The slip velocity `u_t` of the contact with rows `tangents`, at velocities `v`; zero in missing directions.
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

/// Enclosures of all terms of the equations of motion over a box of times, coordinates and velocities.
#[derive(Clone, Debug, Default)]
pub struct DynamicsRange {
    /// The mass matrix `M` by rows.
    pub mass: Vec<Interval>,
    /// The forces `f`.
    pub forces: Vec<Interval>,
    /// The bias accelerations `gamma`, one per row of `J`.
    pub bias: Vec<Interval>,
    /// The drift velocities `b`, one per row of `J`.
    pub drift: Vec<Interval>,
    /// The constraint Jacobian `J` by rows.
    pub rows: Vec<Interval>,
}

impl DynamicsRange {
    /// Allocates the enclosures of a system.
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

/// Enclosures of [`Sensitivity::balance`] and [`Sensitivity::acceleration`], by rows of length `2 n`.
#[derive(Clone, Debug, Default)]
pub struct SensitivityRange {
    /// The derivatives of the balance `M a - f - J^T lambda`, `n` rows.
    pub balance: Vec<Interval>,
    /// The derivatives of the constraint accelerations `u'`, one row per row of `J`.
    pub acceleration: Vec<Interval>,
}

/// Energies, and the powers in their balance.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Energies {
    /// The kinetic energy `v^T M v / 2`.
    pub kinetic: f64,
    /// The potential energy.
    pub potential: f64,
    /// The power `Q^T v` of the applied forces.
    pub power: f64,
    /// `dV/dt - dT/dt` at fixed `q` and `v`: the power supplied by explicit time dependence of potential and masses.
    pub drive: f64,
}

/// Derivatives with respect to `(q, v)`, `2 n` columns, for the sensitivity of accelerations and multipliers.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Sensitivity {
    /// The derivatives of `M a - f - J^T lambda` at fixed `a` and `lambda`, `n` rows.
    pub balance: DMatrix<f64>,
    /// The derivatives of `u' = J a + gamma` at fixed `a`, one row per row of `J`.
    pub acceleration: DMatrix<f64>,
    /// The derivatives of `u = J v + b`, one row per row of `J`.
    pub velocity: DMatrix<f64>,
}

/// A mechanical system, ready to be evaluated. Undefined values are NaN or infinite.
pub trait Mechanical: Send {
    /// Sizes and contacts.
    fn structure(&self) -> &MechanicalStructure;

    /// Writes `M`, `n x n`.
    fn mass(&mut self, t: f64, q: &[f64], mass: &mut DMatrix<f64>);

    /// Writes `f`.
    fn forces(&mut self, t: f64, q: &[f64], v: &[f64], f: &mut [f64]);

    /// Writes the derivatives of `f` with respect to `q` and `v`.
    fn stiffness(&mut self, t: f64, q: &[f64], v: &[f64], by_q: &mut DMatrix<f64>, by_v: &mut DMatrix<f64>);

    /// Writes the values of joints and gaps, and `b` and `J^T` of all rows.
    fn constraints(&mut self, t: f64, q: &[f64], constraints: &mut Constraints);

    /// Writes the values of joints and gaps.
    fn positions(&mut self, t: f64, q: &[f64], values: &mut [f64]);

    /// Encloses the values of joints and gaps over a box of `t` and `q`.
    fn enclose_positions(&mut self, t: Interval, q: &[Interval], values: &mut [Interval]);

    /// Encloses the velocities of joints and gaps over a box of `t`, `q` and `v`.
    fn enclose_velocities(&mut self, t: Interval, q: &[Interval], v: &[Interval], values: &mut [Interval]);

    /// Encloses `f`, then `b`, then `gamma`, at fixed `q` and `v` over an interval of `t`.
    fn enclose_in_time(&mut self, t: Interval, q: &[f64], v: &[f64], values: &mut [Interval]);

    /// Encloses `f` over a box of `t`, `q` and `v`.
    fn enclose_forces(&mut self, t: Interval, q: &[Interval], v: &[Interval], f: &mut [Interval]);

    /// Encloses masses, forces, bias, drift and `J` over a box of `t`, `q` and `v`.
    fn enclose_dynamics(&mut self, t: Interval, q: &[Interval], v: &[Interval], range: &mut DynamicsRange);

    /// Encloses the derivatives of [`Sensitivity`] over a box of `t` and `x = (q, v)`, at accelerations `a` and
    /// multipliers `lambda` of all rows.
    fn enclose_sensitivity(
        &mut self,
        t: Interval,
        x: &[Interval],
        a: &[f64],
        lambda: &[f64],
        range: &mut SensitivityRange,
    );

    /// Whether a term of the equations of motion may have a jump that depends on `q` or `v` in a box of `x = (q, v)`.
    fn may_jump(&mut self, _t: Interval, _x: &[Interval]) -> bool {
        false
    }

    /// Whether a term of the equations of motion may pass a knot in a box of `x = (q, v)`, at which one of its derivatives of some
    /// order jumps.
    fn may_pass_knot(&mut self, _t: Interval, _x: &[Interval]) -> bool {
        false
    }

    /// Event functions of time, evaluated at `t`: a term of the equations of motion has a kink or a jump, independent
    /// of `q` and `v`, where one of them changes sign.
    fn breaks(&mut self, _t: f64) -> &[f64] {
        &[]
    }

    /// For each event function of [`Mechanical::breaks`] a quantity that runs evenly through its sign changes: its rates by `t` and by
    /// parameters tell how their times move.
    fn break_courses(&mut self, t: f64) -> &[f64] {
        self.breaks(t)
    }

    /// Encloses the event functions of [`Mechanical::breaks`] over an interval of `t`; empty if they cannot be
    /// enclosed.
    fn enclose_breaks(&mut self, _t: Interval) -> &[Interval] {
        &[]
    }

    /// The coefficient of friction of contact `k` at a state and a speed of its slip.
    fn friction(&mut self, k: usize, _t: f64, _q: &[f64], _v: &[f64], _slip_speed: f64) -> f64 {
        self.structure().contacts[k].mu
    }

    /// Writes the derivatives of the coefficient of friction of contact `k` by `(q, v)`, and by the speed of its slip.
    fn friction_slopes(&mut self, _k: usize, _t: f64, _q: &[f64], _v: &[f64], _slip_speed: f64, slopes: &mut [f64]) {
        slopes.fill(0.0);
    }

    /// Encloses the coefficient of friction of contact `k` over a box of `t`, `x = (q, v)` and speeds of its slip.
    fn enclose_friction(&mut self, k: usize, _t: Interval, _x: &[Interval], _slip_speed: Interval) -> Interval {
        Interval::point(self.structure().contacts[k].mu)
    }

    /// Encloses the derivatives of [`Mechanical::friction_slopes`].
    fn enclose_friction_slopes(
        &mut self,
        _k: usize,
        _t: Interval,
        _x: &[Interval],
        _slip_speed: Interval,
        slopes: &mut [Interval],
    ) {
        slopes.fill(Interval::point(0.0));
    }

    /// Energies and power.
    fn energies(&mut self, t: f64, q: &[f64], v: &[f64]) -> Energies;

    /// Writes the bias acceleration `gamma`, the value of `u'` for `v' = 0`, one per row of `J`.
    fn bias(&mut self, t: f64, q: &[f64], v: &[f64], gamma: &mut [f64]);

    /// Writes the derivatives of [`Sensitivity`] at accelerations `a` and multipliers `lambda` of all rows.
    fn sensitivity(&mut self, t: f64, q: &[f64], v: &[f64], a: &[f64], lambda: &[f64], out: &mut Sensitivity);

    /// Writes the derivatives with respect to time of the rows of [`Sensitivity`]: `n` of the balance, then one per row
    /// of `J` of the accelerations, then of the velocities.
    fn sensitivity_in_time(&mut self, t: f64, q: &[f64], v: &[f64], a: &[f64], lambda: &[f64], out: &mut [f64]);

    /// The rounding error of the time `t`.
    fn rounding_of_time(&self, t: f64) -> f64 {
        f64::EPSILON * t.abs()
    }
}
