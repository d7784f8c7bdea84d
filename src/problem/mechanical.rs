//! The interface between steppers and a mechanical system in generalised coordinates `q`, with velocities `v = q'`:
//!
//! ```text
//! M(t,q) v' = f(t,q,v) + J(t,q)^T lambda,    u = J(t,q) v + b(t,q)
//! ```
//!
//! The rows of `J` are those of the joints, with constraints `phi(t,q) = 0` (`u = phi'`), then the contact normals,
//! with gaps `gap(t,q) >= 0` (`u_n = gap'`), then the slip directions of the contacts. `f` contains all forces,
//! including those of the potential and of `M` (Coriolis and centrifugal forces).

use nalgebra::{DMatrix, Vector2};
use numerics::Interval;
use std::ops::Range;

/// The contact law of a contact of a mechanical system: friction and restitution.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ContactData {
    /// The coefficient of friction of the contact; zero without friction. [`Mechanical::friction`] returns its value if
    /// the coefficient varies.
    pub mu: f64,
    /// Whether the contact's coefficient of friction varies in time, with the state or with the slip speed.
    pub varies: bool,
    /// The coefficient of friction in the second slip direction divided by that in the first: the friction forces are
    /// in an ellipse. The second slip row of `J` is the slip velocity times this ratio, which maps the ellipse to a
    /// disk (Goyal, Ruina and Papadopoulos 1991, *Planar sliding with dry friction*).
    pub ratio: f64,
    /// The coefficient of restitution of the contact in Newton's impact law, from 0 to 1.
    pub restitution: f64,
    /// The index of the contact's first slip direction among the slip directions of all contacts.
    pub first_slip: usize,
    /// The number of the contact's slip directions: one or two with friction, zero without.
    pub slips: usize,
    /// The number of corners of the contact's friction set if it is a polygon; `None` for the friction disk.
    pub facets: Option<usize>,
}

impl ContactData {
    /// Returns the slip speed `|u_t|` of the contact for the slip velocity that the slip rows of `J` give, in which the
    /// second component is multiplied by `ratio`.
    pub fn slip_speed(&self, slip: &Vector2<f64>) -> f64 {
        slip.x.hypot(slip.y / self.ratio)
    }

    /// Returns the gradient of [`ContactData::slip_speed`] with respect to the slip velocity; at zero slip, the limit
    /// of the gradient along the direction `way`.
    pub fn slip_speed_slope(&self, slip: &Vector2<f64>, way: &Vector2<f64>) -> Vector2<f64> {
        let along = if slip.norm() > 0.0 { slip } else { way };
        let speed = self.slip_speed(along);
        if speed > 0.0 { Vector2::new(along.x, along.y / (self.ratio * self.ratio)) / speed } else { Vector2::zeros() }
    }
}

/// The structure of a mechanical system: its sizes, contact laws and the kind of its dependence on time and state.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct MechanicalStructure {
    /// The number `n` of generalised coordinates `q`.
    pub coordinates: usize,
    /// The number of scalar joint constraints of the system.
    pub joints: usize,
    /// The contact laws (friction and restitution), one per contact.
    pub contacts: Vec<ContactData>,
    /// Whether the mass matrix `M` is constant.
    pub constant_mass: bool,
    /// Whether the forces `f` of the equations of motion depend neither on `q` nor on `v`.
    pub constant_forces: bool,
    /// Whether forces, masses, joint constraints, gaps or slip velocities depend on time explicitly.
    pub depends_on_time: bool,
    /// Whether forces, masses, joint constraints, gaps or slip velocities are not polynomials of low degree in `q` and
    /// `v`, so that a step may not resolve them.
    pub has_features: bool,
    /// Whether the forces are not polynomials of low degree in `q` and `v`, so that a step may not resolve them.
    pub has_features_of_forces: bool,
    /// Whether joint constraints and gaps are affine functions of `q` alone, so that along a straight line their
    /// minimum is at an end.
    pub affine_constraints: bool,
}

impl MechanicalStructure {
    /// Returns the number of slip directions of all contacts together.
    pub fn slips(&self) -> usize {
        self.contacts.iter().map(|contact| contact.slips).sum()
    }

    /// Returns the number of rows of the constraint Jacobian `J`: joints, contact normals and slip directions.
    pub fn rows(&self) -> usize {
        self.joints + self.contacts.len() + self.slips()
    }

    /// Returns the index of the row of the constraint Jacobian `J` for the normal direction of contact `k`.
    pub fn normal(&self, k: usize) -> usize {
        self.joints + k
    }

    /// Returns the indices of the rows of the constraint Jacobian `J` for the slip directions of contact `k`.
    pub fn tangents(&self, k: usize) -> Range<usize> {
        let first = self.joints + self.contacts.len() + self.contacts[k].first_slip;
        first..first + self.contacts[k].slips
    }
}

/// The constraints of a mechanical system (joints, gaps, slip directions) at one time `t` and given coordinates `q`.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Constraints {
    /// The values of the joint constraints `phi`, then the gaps of the contacts.
    pub values: Vec<f64>,
    /// The drift velocities `b` in the constraint velocities `u = J v + b`, one per row of `J`.
    pub drift: Vec<f64>,
    /// The transposed constraint Jacobian `J^T` of joints, contact normals and slip directions, a column for each row
    /// of `J`.
    pub transposed: DMatrix<f64>,
}

impl Constraints {
    /// Allocates the constraints of a mechanical system with the given structure.
    pub fn new(structure: &MechanicalStructure) -> Self {
        Self {
            values: vec![0.0; structure.joints + structure.contacts.len()],
            drift: vec![0.0; structure.rows()],
            transposed: DMatrix::zeros(structure.coordinates, structure.rows()),
        }
    }

    /// Returns the constraint velocity `u_i = J_i v + b_i` of row `i` of the constraint Jacobian at velocities `v`.
    pub fn velocity(&self, row: usize, v: &[f64]) -> f64 {
        self.drift[row] + dot(self.row(row), v)
    }

    /// Returns `|b_i| + sum_j |J_ij v_j|`, the scale of rounding errors of the constraint velocity `u_i` of row `i` of
    /// `J`.
    pub fn terms(&self, row: usize, v: &[f64]) -> f64 {
        self.drift[row].abs() + self.size(row, v)
    }

    /// Returns `sum_j |J_ij x_j|`, the scale of rounding errors of row `i` of the constraint Jacobian `J` times the
    /// coordinates or velocities `x`.
    pub fn size(&self, row: usize, x: &[f64]) -> f64 {
        self.row(row).iter().zip(x).map(|(j, x)| (j * x).abs()).sum()
    }

    /// Returns the slip velocity `u_t`, at velocities `v`, of the contact whose slip rows of `J` are `tangents`; its
    /// components are zero in directions that the contact does not have.
    pub fn slip(&self, tangents: Range<usize>, v: &[f64]) -> Vector2<f64> {
        let mut slip = Vector2::zeros();
        slip.iter_mut().zip(tangents).for_each(|(slip, row)| *slip = self.velocity(row, v));
        slip
    }

    /// Returns a row of the constraint Jacobian `J`.
    pub fn row(&self, row: usize) -> &[f64] {
        let n = self.transposed.nrows();
        &self.transposed.as_slice()[row * n..(row + 1) * n]
    }
}

fn dot(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(a, b)| a * b).sum()
}

/// Interval enclosures of all terms of the equations of motion over a box of times, coordinates and velocities.
#[derive(Clone, Debug, Default)]
pub struct DynamicsRange {
    /// The enclosure of the mass matrix `M`, by rows.
    pub mass: Vec<Interval>,
    /// The enclosures of the forces `f`, one per coordinate.
    pub forces: Vec<Interval>,
    /// The enclosures of the bias accelerations `gamma` in `u' = J v' + gamma`, one per row of `J`.
    pub bias: Vec<Interval>,
    /// The enclosures of the drift velocities `b` in `u = J v + b`, one per row of `J`.
    pub drift: Vec<Interval>,
    /// The enclosure of the constraint Jacobian `J`, by rows.
    pub rows: Vec<Interval>,
}

impl DynamicsRange {
    /// Allocates the enclosures of the equations of motion of a mechanical system.
    pub fn new(structure: &MechanicalStructure) -> Self {
        let (n, rows) = (structure.coordinates, structure.rows());
        let room = |count: usize| vec![Interval::LINE; count];
        Self { mass: room(n * n), forces: room(n), bias: room(rows), drift: room(rows), rows: room(rows * n) }
    }

    /// Returns the enclosure of a row of the constraint Jacobian `J`.
    pub fn row(&self, row: usize) -> &[Interval] {
        let n = self.forces.len();
        &self.rows[row * n..(row + 1) * n]
    }
}

/// Interval enclosures of [`Sensitivity::balance`] and [`Sensitivity::acceleration`], by rows of length `2 n`, where
/// `n` is the number of coordinates.
#[derive(Clone, Debug, Default)]
pub struct SensitivityRange {
    /// The enclosed derivatives of the force balance `M a - f - J^T lambda` with respect to `(q, v)`, `n` rows.
    pub balance: Vec<Interval>,
    /// The enclosed derivatives of the constraint accelerations `u'` with respect to `(q, v)`, one row for each row of
    /// `J`.
    pub acceleration: Vec<Interval>,
}

/// The energies of a mechanical system, and the powers in its energy balance.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Energies {
    /// The kinetic energy `T = v^T M v / 2` of the system.
    pub kinetic: f64,
    /// The potential energy `V` of the mechanical system.
    pub potential: f64,
    /// The power `Q^T v` of the applied forces `Q` in the energy balance.
    pub power: f64,
    /// The power supplied by the explicit time dependence of potential and masses: `dV/dt - dT/dt` at fixed `q` and
    /// `v`, with potential energy `V` and kinetic energy `T`.
    pub drive: f64,
}

/// Derivatives of the equations of motion with respect to `(q, v)`, `2 n` columns, for the sensitivity of
/// accelerations and multipliers.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Sensitivity {
    /// The derivatives with respect to `(q, v)` of the force balance `M a - f - J^T lambda` at fixed accelerations `a`
    /// and multipliers `lambda`, `n` rows.
    pub balance: DMatrix<f64>,
    /// The derivatives with respect to `(q, v)` of the constraint accelerations `u' = J a + gamma` at fixed
    /// accelerations `a`, one row for each row of `J`.
    pub acceleration: DMatrix<f64>,
    /// The derivatives with respect to `(q, v)` of the constraint velocities `u = J v + b`, one row for each row of
    /// `J`.
    pub velocity: DMatrix<f64>,
}

/// The equations of a mechanical system, for evaluation at given time and state. Undefined values are NaN or infinite.
pub trait Mechanical: Send {
    /// Returns the sizes of the mechanical system and its contact laws.
    fn structure(&self) -> &MechanicalStructure;

    /// Writes the mass matrix `M` of the equations of motion, `n x n`.
    fn mass(&mut self, t: f64, q: &[f64], mass: &mut DMatrix<f64>);

    /// Writes the forces `f` of the equations of motion, one per coordinate.
    fn forces(&mut self, t: f64, q: &[f64], v: &[f64], f: &mut [f64]);

    /// Writes the derivatives of the forces `f` with respect to `q` and `v`.
    fn stiffness(&mut self, t: f64, q: &[f64], v: &[f64], by_q: &mut DMatrix<f64>, by_v: &mut DMatrix<f64>);

    /// Writes the values of joint constraints and gaps, and the drift velocities `b` and columns of `J^T` of all rows
    /// of `J`.
    fn constraints(&mut self, t: f64, q: &[f64], constraints: &mut Constraints);

    /// Writes the values of the joint constraints and the gaps of the contacts.
    fn positions(&mut self, t: f64, q: &[f64], values: &mut [f64]);

    /// Encloses the values of joint constraints and of contact gaps over a box of `t` and `q`.
    fn enclose_positions(&mut self, t: Interval, q: &[Interval], values: &mut [Interval]);

    /// Encloses the time derivatives of joint constraints and of contact gaps over a box of `t`, `q` and `v`.
    fn enclose_velocities(&mut self, t: Interval, q: &[Interval], v: &[Interval], values: &mut [Interval]);

    /// Encloses the forces `f`, then the drift velocities `b`, then the bias accelerations `gamma`, at fixed `q` and
    /// `v` over an interval of `t`.
    fn enclose_in_time(&mut self, t: Interval, q: &[f64], v: &[f64], values: &mut [Interval]);

    /// Encloses the forces `f` over a box of `t`, `q` and `v`.
    fn enclose_forces(&mut self, t: Interval, q: &[Interval], v: &[Interval], f: &mut [Interval]);

    /// Encloses the mass matrix, forces, bias accelerations, drift velocities and the constraint Jacobian `J` over a
    /// box of `t`, `q` and `v`.
    fn enclose_dynamics(&mut self, t: Interval, q: &[Interval], v: &[Interval], range: &mut DynamicsRange);

    /// Encloses the derivatives of [`Sensitivity`] over a box of `t` and `x = (q, v)`, at accelerations `a` and
    /// multipliers `lambda` of all rows of `J`.
    fn enclose_sensitivity(
        &mut self,
        t: Interval,
        x: &[Interval],
        a: &[f64],
        lambda: &[f64],
        range: &mut SensitivityRange,
    );

    /// Returns whether a term of the equations of motion may have a jump that depends on `q` or `v` in a box of `t`
    /// and `x = (q, v)`.
    fn may_jump(&mut self, _t: Interval, _x: &[Interval]) -> bool {
        false
    }

    /// Returns whether a term of the equations of motion may pass a knot in a box of `t` and `x = (q, v)`: a point at
    /// which a derivative of the term, of some order, jumps.
    fn may_pass_knot(&mut self, _t: Interval, _x: &[Interval]) -> bool {
        false
    }

    /// Returns the event functions of time, evaluated at `t`: where one of them changes sign, a term of the equations
    /// of motion has a kink or a jump that does not depend on `q` and `v`.
    fn breaks(&mut self, _t: f64) -> &[f64] {
        &[]
    }

    /// Returns, for each event function of [`Mechanical::breaks`], a quantity that is smooth where the event function
    /// changes sign, such as the argument of a `floor`: its derivatives with respect to `t` and to parameters
    /// determine how the times of the sign changes move with the parameters.
    fn break_courses(&mut self, t: f64) -> &[f64] {
        self.breaks(t)
    }

    /// Encloses the event functions of [`Mechanical::breaks`] over an interval of `t`; empty if they cannot be
    /// enclosed.
    fn enclose_breaks(&mut self, _t: Interval) -> &[Interval] {
        &[]
    }

    /// Returns the coefficient of friction of contact `k` at a time, a state and a slip speed.
    fn friction(&mut self, k: usize, _t: f64, _q: &[f64], _v: &[f64], _slip_speed: f64) -> f64 {
        self.structure().contacts[k].mu
    }

    /// Writes the derivatives of the coefficient of friction of contact `k` with respect to `(q, v)`, then to the
    /// slip speed.
    fn friction_slopes(&mut self, _k: usize, _t: f64, _q: &[f64], _v: &[f64], _slip_speed: f64, slopes: &mut [f64]) {
        slopes.fill(0.0);
    }

    /// Encloses the coefficient of friction of contact `k` over a box of `t`, `x = (q, v)` and slip speeds.
    fn enclose_friction(&mut self, k: usize, _t: Interval, _x: &[Interval], _slip_speed: Interval) -> Interval {
        Interval::point(self.structure().contacts[k].mu)
    }

    /// Encloses the derivatives of the coefficient of friction that [`Mechanical::friction_slopes`] writes, over a
    /// box of `t`, `x = (q, v)` and slip speeds.
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

    /// Returns the energies of the mechanical system and the powers in its energy balance.
    fn energies(&mut self, t: f64, q: &[f64], v: &[f64]) -> Energies;

    /// Writes the bias accelerations `gamma`, one per row of `J`: the constraint accelerations `u'` for `v' = 0`.
    fn bias(&mut self, t: f64, q: &[f64], v: &[f64], gamma: &mut [f64]);

    /// Writes the derivatives of [`Sensitivity`] at accelerations `a` and multipliers `lambda` of all rows of `J`.
    fn sensitivity(&mut self, t: f64, q: &[f64], v: &[f64], a: &[f64], lambda: &[f64], out: &mut Sensitivity);

    /// Writes the time derivatives of the equations whose derivatives [`Sensitivity`] contains: `n` of the force
    /// balance, then one per row of `J` of the constraint accelerations, then one per row of `J` of the constraint
    /// velocities.
    fn sensitivity_in_time(&mut self, t: f64, q: &[f64], v: &[f64], a: &[f64], lambda: &[f64], out: &mut [f64]);

    /// Returns the rounding error of the time `t`, on which the equations of motion depend.
    fn rounding_of_time(&self, t: f64) -> f64 {
        f64::EPSILON * t.abs()
    }
}
