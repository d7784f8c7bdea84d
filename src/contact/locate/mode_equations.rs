//! Smooth motion in one contact mode as an ordinary differential equation, by reduction of the index. Let `C` be the
//! held rows of the constraint Jacobian `J`, and `G` their transposes with the friction of sliding contacts added to
//! their normals (`lambda_t = -mu lambda_n d`). Then
//!
//! ```text
//! M a = f + G lambda,    C a + gamma = 0
//! ```
//!
//! determine accelerations and multipliers at each `(t, q, v)`: the constraints of index three are differentiated
//! twice, so that `lambda` has the accuracy of `q` and `v`. Drift off the constraints is projected out where a mode
//! begins.
//!
//! A slip in 3D has the direction `d` of `u_t + eps d_0`, with the direction `d_0` of the mode and the tolerance
//! `eps` of slips: a slip from rest begins in the direction of the mode, and turns at a finite rate.
//!
//! With redundant constraints, such as a body on more feet than it needs, `a` is unique but `lambda` is not. The
//! multipliers nearest to reference loads `l` are selected, in the metric of `sum (lambda_n - l_n)^2/l_n +
//! |lambda_t - l_t|^2/(mu l_n)`: if `l` are the normal forces of the contact law, all feet use the same fraction of
//! their friction bound, so that none slips before all must.

use super::enclosed_forces::Inverse;
use super::mode::{Status, held};
use crate::delassus::dot;
use crate::law::admissible;
use factorisation::Pivoted;
use nalgebra::{Cholesky, DMatrix, DVector, Dyn, Matrix2, RowDVector, Vector2, Vector3};
use numerics::Interval;
use problem::{Constraints, ConvexSet, Dvi, Mass, Mechanical, MechanicalStructure, Sensitivity, Structure};
use std::cell::OnceCell;

/// Rank tolerance of `C M^-1 G`: a pivot below this fraction of the largest indicates dependent rows.
const DEPENDENT: f64 = 1e-11;

/// Rank tolerance for held rows that were dependent at the beginning of the mode: they count as independent once a
/// pivot exceeds this fraction of the largest. Such rows are dependent on the constraint manifold only; off it,
/// singular values are of the size of the drift squared.
const RISEN: f64 = 1e-6;

/// A velocity along rows of `J` counts as constrained if forces change it by less than this fraction of their effect
/// without constraints.
const CONSTRAINED_TOL: f64 = 1e-9;

/// Smallest weight of a contact in the metric of the multipliers, as a fraction of the largest load.
const LEAST_SHARE: f64 = 1e-6;

/// The equations of motion of one contact mode.
pub struct ModeEquations {
    problem: Box<dyn Mechanical>,
    shape: MechanicalStructure,
    structure: Structure,
    features: Vec<usize>,
    mode: Vec<Status>,
    least: Vec<f64>,
    rows: Vec<usize>,
    metric: Metric,
    /// The rank of the held rows of `J` at the beginning of the mode.
    rank: Option<usize>,
    /// The factors of `M` and `C M^-1 G` at the last evaluation of the mode equations.
    last: Option<Solved>,
    constraints: Constraints,
    mass: DMatrix<f64>,
    gamma: Vec<f64>,
    f: Vec<f64>,
    sensitivity: Sensitivity,
    /// The accelerations `a` at the last evaluation of the mode equations.
    pub a: Vec<f64>,
    /// The multipliers `lambda` of every row of `J` at the last evaluation of the mode equations.
    pub lambda: Vec<f64>,
    /// The coefficient of friction of each closed contact at the last evaluation of the mode equations.
    pub mu: Vec<f64>,
}

/// A contact mode with all data that its equations need beside the state.
#[derive(Clone)]
pub(crate) struct ModeSetting {
    mode: Vec<Status>,
    least: Vec<f64>,
    rows: Vec<usize>,
    metric: Metric,
    rank: Option<usize>,
}

/// Factors of `M` and the inverse of `C M^-1 G`, with the matrices from which they were computed.
pub(crate) struct Solved {
    pub matrix: DMatrix<f64>,
    pub mass: Cholesky<f64, Dyn>,
    pub c: DMatrix<f64>,
    pub g: DMatrix<f64>,
    /// The response `M^-1 G` of accelerations to unit multipliers.
    pub y: DMatrix<f64>,
    pub inverse: DMatrix<f64>,
    /// The contribution of the reference loads to `a` and `lambda`, if multipliers are not unique.
    pub shift: Option<(DVector<f64>, DVector<f64>)>,
    /// The inverse of the whole matrix of accelerations and multipliers, computed on first use.
    pub whole_inverse: OnceCell<Inverse>,
}

impl Solved {
    /// Factorises the matrices of one state; reuses the previous factors if the matrices are unchanged.
    fn new(
        last: Option<Self>,
        matrix: &DMatrix<f64>,
        held: Held,
        metric: &Metric,
        rank: &mut Option<usize>,
    ) -> Option<Self> {
        let Held { c, g } = held;
        let mass = match last {
            Some(last) if last.matrix == *matrix && last.c == c && last.g == g => return Some(last),
            Some(last) if last.matrix == *matrix => last.mass,
            _ => matrix.clone().cholesky()?,
        };
        let y = mass.solve(&g);
        let gram = &c * &y;
        let (inverse, found) = invert(&gram, &metric.scale, *rank)?;
        rank.get_or_insert(found);
        let shift = (found < gram.nrows()).then(|| {
            let shift = &metric.load - &inverse * (gram * &metric.load);
            (&y * &shift, shift)
        });
        Some(Self { matrix: matrix.clone(), mass, c, g, y, inverse, shift, whole_inverse: OnceCell::new() })
    }

    /// Solves `M a - G lambda = p`, `C a = w` for `a` and `lambda`, for several right-hand sides `(p, w)`.
    pub fn solve(&self, p: &DMatrix<f64>, w: &DMatrix<f64>) -> (DMatrix<f64>, DMatrix<f64>) {
        let free = self.mass.solve(p);
        let lambda = &self.inverse * (w - &self.c * &free);
        (free + &self.y * &lambda, lambda)
    }
}

/// The rows `C` of `J` that the contact mode holds, and the generalised forces `G` of their multipliers.
struct Held {
    c: DMatrix<f64>,
    g: DMatrix<f64>,
}

/// The reference loads of the held rows, and the square roots of the weights of the metric in which the multipliers are
/// least.
#[derive(Clone, Default)]
struct Metric {
    load: DVector<f64>,
    scale: DVector<f64>,
}

impl ModeEquations {
    /// Builds the mode equations of a mechanical system, with all contacts open.
    pub fn new(problem: Box<dyn Mechanical>) -> Self {
        let shape = problem.structure().clone();
        let n = shape.coordinates;
        let identity = (0..n).map(|i| (i, n + i));
        let dense = (0..n).flat_map(|i| (0..2 * n).map(move |j| (n + i, j)));
        let structure = Structure {
            states: 2 * n,
            variables: 0,
            mass: Mass::Identity,
            set: ConvexSet::free(0),
            moving: Vec::new(),
            pattern: identity.chain(dense).collect(),
            constant_jacobian: false,
        };
        let features = if shape.has_features { n..2 * n } else { 0..0 };
        let mut equations = Self {
            structure,
            features: features.collect(),
            constraints: Constraints::new(&shape),
            mass: DMatrix::zeros(n, n),
            gamma: vec![0.0; shape.rows()],
            f: vec![0.0; n],
            sensitivity: Sensitivity::default(),
            a: vec![0.0; n],
            lambda: vec![0.0; shape.rows()],
            mu: vec![0.0; shape.contacts.len()],
            mode: Vec::new(),
            least: Vec::new(),
            rows: Vec::new(),
            metric: Metric::default(),
            rank: None,
            last: None,
            problem,
            shape,
        };
        let contacts = equations.shape.contacts.len();
        let none = vec![0.0; contacts];
        equations.set_mode(&vec![Status::Open; contacts], (&vec![Vector3::zeros(); contacts], &none), &none);
        equations
    }

    /// Sets the contact mode, the reference contact forces and the coefficients of friction for redundant contacts, and
    /// the slip speeds below which the mode's slip direction is used.
    pub fn set_mode(&mut self, mode: &[Status], (loads, mu): (&[Vector3<f64>], &[f64]), least: &[f64]) {
        (self.mode, self.least) = (mode.to_vec(), least.to_vec());
        self.rows = held(&self.shape, mode);
        let all = self.shape.rows();
        let (mut load, mut scale) = (vec![0.0; all], vec![1.0; all]);
        let largest = loads.iter().fold(f64::MIN_POSITIVE, |most, load| most.max(load.x));
        for (k, &mu) in mu.iter().enumerate() {
            let share = loads[k].x / largest;
            let rows = std::iter::once(self.shape.normal(k)).chain(self.shape.tangents(k));
            for ((row, part), most) in rows.zip(loads[k].iter()).zip([1.0, mu, mu]) {
                (load[row], scale[row]) = (*part, (most * share).max(LEAST_SHARE).sqrt());
            }
        }
        let rows = self.rows.len();
        self.metric.load = DVector::from_iterator(rows, self.rows.iter().map(|&row| load[row]));
        self.metric.scale = DVector::from_iterator(rows, self.rows.iter().map(|&row| scale[row]));
        (self.rank, self.last) = (None, None);
    }

    /// Sets the mode saved from other equations of the same system, with its reference loads and slip speeds.
    pub(crate) fn adopt(&mut self, ModeSetting { mode, least, rows, metric, rank }: ModeSetting) {
        (self.mode, self.least, self.rows, self.metric) = (mode, least, rows, metric);
        (self.rank, self.last) = (rank, None);
    }

    /// Returns the contact mode with its reference loads and slip speeds.
    pub(crate) fn setting(&self) -> ModeSetting {
        ModeSetting {
            mode: self.mode.clone(),
            least: self.least.clone(),
            rows: self.rows.clone(),
            metric: self.metric.clone(),
            rank: self.rank,
        }
    }

    /// Returns the structure (sizes, joints and contacts) of the mechanical system.
    pub fn shape(&self) -> &MechanicalStructure {
        &self.shape
    }

    /// Returns the status (open, frictionless, stick or slip) of each contact in the mode.
    pub fn mode(&self) -> &[Status] {
        &self.mode
    }

    /// Returns the rows of `J` (constraint Jacobian) that the mode holds.
    pub fn rows(&self) -> &[usize] {
        &self.rows
    }

    /// Returns the slip speed of contact `k` below which the direction of its slip is taken from the mode.
    pub(crate) fn least_slip(&self, k: usize) -> f64 {
        self.least[k]
    }

    /// Returns the factors of `M` and of `C M^-1 G` at the last evaluation; `None` before the first.
    pub(crate) fn solved_last(&self) -> Option<&Solved> {
        self.last.as_ref()
    }

    /// Returns the constraints (gaps, joints and their Jacobian) at the last evaluation of the mode equations.
    pub fn constraints(&self) -> &Constraints {
        &self.constraints
    }

    /// Returns the diagonal of the mass matrix `M` at the last evaluation.
    pub fn masses(&self) -> impl Iterator<Item = f64> + '_ {
        (0..self.shape.coordinates).map(|i| self.mass[(i, i)])
    }

    /// Returns the size of the friction force of contact `k` at the last evaluation.
    pub fn friction(&self, k: usize) -> f64 {
        self.shape.tangents(k).map(|row| self.lambda[row].powi(2)).sum::<f64>().sqrt()
    }

    /// Whether, at the last evaluation, the normal forces of all closed contacts are nonnegative and the friction of
    /// those that stick is below its bound by at least the fraction `part` of the bound.
    pub fn hold_below(&self, part: f64) -> bool {
        (0..self.mode.len()).filter(|&k| self.mode[k].is_closed()).all(|k| {
            let force = self.lambda[self.shape.normal(k)];
            let sticks = self.mode[k] == Status::Stick;
            force >= 0.0 && (!sticks || self.friction(k) < (1.0 - part) * self.mu[k] * force)
        })
    }

    /// Returns the velocity change along a row of `J` by an impulse along that row, without constraints, with the
    /// mass matrix of the last evaluation.
    pub fn change_of_row(&self, row: usize, impulse: f64) -> Option<f64> {
        let j = self.constraints.transposed.column(row).into_owned();
        self.last.as_ref().map(|solved| solved.mass.solve(&j).dot(&j) * impulse)
    }

    /// Returns the mechanical system whose equations these are.
    pub fn problem(&mut self) -> &mut dyn Mechanical {
        &mut *self.problem
    }

    /// Returns an unnormalised slip direction of contact `k`: in a plane the direction of the mode; in 3D the slip
    /// plus, for slips at rest, the slip tolerance times the direction of the mode.
    fn way(&self, k: usize, v: &[f64]) -> Option<Vector2<f64>> {
        let Status::Slip(direction) = self.mode[k] else { return None };
        Some(if self.shape.contacts[k].slips < 2 { direction } else { self.slip(k, v) + direction * self.least[k] })
    }

    fn direction(&self, k: usize, v: &[f64]) -> Option<Vector2<f64>> {
        let way = self.way(k, v)?;
        Some(if way.norm() > 0.0 { way.normalize() } else { way })
    }

    /// Returns the slip speed on which the friction coefficient of contact `k` depends. In a plane a slip that has
    /// reversed, past the end of its mode, counts as rest.
    fn slip_speed(&self, k: usize, v: &[f64]) -> f64 {
        let contact = &self.shape.contacts[k];
        match self.mode[k] {
            Status::Slip(direction) if contact.slips < 2 => self.slip(k, v).dot(&direction).max(0.0),
            Status::Slip(_) => contact.slip_speed(&self.slip(k, v)),
            Status::Open | Status::Frictionless | Status::Stick => 0.0,
        }
    }

    /// Evaluates the friction coefficients of closed contacts; the constraints must have been evaluated at this
    /// state. Returns `None` if a coefficient is inadmissible.
    fn evaluate_friction(&mut self, t: f64, q: &[f64], v: &[f64]) -> Option<()> {
        for k in 0..self.mode.len() {
            let contact = &self.shape.contacts[k];
            self.mu[k] = contact.mu;
            if contact.varies && self.mode[k].is_closed() {
                let speed = self.slip_speed(k, v);
                self.mu[k] = admissible(self.problem.friction(k, t, q, v, speed))?;
            }
        }
        Some(())
    }

    /// Returns the slip velocity `u_t` of contact `k`.
    pub fn slip(&self, k: usize, v: &[f64]) -> Vector2<f64> {
        self.constraints.slip(self.shape.tangents(k), v)
    }

    /// Returns the rate of the slip velocity `u_t` of the closed contact `k` at the last evaluation.
    pub fn slip_rate(&self, k: usize) -> Vector2<f64> {
        let mut rate = Vector2::zeros();
        for (rate, row) in rate.iter_mut().zip(self.shape.tangents(k)) {
            *rate = self.rate_of_row(row);
        }
        rate
    }

    /// Returns the rate of the contact velocity `u` in one row of `J` at the last evaluation.
    pub fn rate_of_row(&self, row: usize) -> f64 {
        self.gamma[row] + dot(self.constraints.row(row), &self.a)
    }

    /// Whether other constraints prevent any change of the slip of contact `k` at the last evaluation: the contact
    /// point stays at rest although its friction is at the bound.
    pub fn is_slip_held(&self, k: usize, v: &[f64]) -> bool {
        let Some(direction) = self.direction(k, v) else { return false };
        let others = self.rows.iter().any(|&row| row != self.shape.normal(k));
        others && self.is_held(self.shape.tangents(k).zip(direction.iter().copied()))
    }

    /// Whether other constraints keep the gap of the open contact `k`, which is at rest, constant at the last
    /// evaluation.
    pub fn is_gap_held(&self, k: usize) -> bool {
        !self.rows.is_empty() && self.is_held(std::iter::once((self.shape.normal(k), 1.0)))
    }

    /// Whether forces change the velocity along a combination of rows of `J`, given as pairs of row and factor, by no
    /// more than rounding.
    fn is_held(&self, rows: impl Iterator<Item = (usize, f64)>) -> bool {
        let Some(solved) = &self.last else { return false };
        let mut j = DVector::zeros(self.shape.coordinates);
        rows.for_each(|(row, factor)| j += self.constraints.transposed.column(row) * factor);
        let free = solved.mass.solve(&j);
        let held = &free - &solved.y * (&solved.inverse * (&solved.c * &free));
        j.dot(&held).abs() <= CONSTRAINED_TOL * j.dot(&free)
    }

    /// Computes accelerations `a` and multipliers `lambda` at a state; writes NaN if they do not exist.
    pub fn evaluate_at(&mut self, t: f64, x: &[f64]) {
        self.last = self.solved(t, x);
        if self.last.is_none() {
            self.a.fill(f64::NAN);
            self.lambda.fill(f64::NAN);
        }
    }

    /// Evaluates the constraints alone of the mechanical system at a state: all that monitors need in a mode that holds
    /// no row.
    pub fn evaluate_constraints(&mut self, t: f64, q: &[f64]) {
        self.problem.constraints(t, q, &mut self.constraints);
    }

    /// Evaluates the mode equations at the middle of a box of times `t` and states `x`, and returns the states at the
    /// middle.
    fn evaluate_at_middle(&mut self, t: Interval, x: &[Interval]) -> Vec<f64> {
        let middle: Vec<f64> = x.iter().map(|x| x.ball().0).collect();
        self.evaluate_at(t.ball().0, &middle);
        middle
    }

    fn solved(&mut self, t: f64, x: &[f64]) -> Option<Solved> {
        let n = self.shape.coordinates;
        let (q, v) = x.split_at(n);
        self.problem.mass(t, q, &mut self.mass);
        self.problem.forces(t, q, v, &mut self.f);
        self.problem.constraints(t, q, &mut self.constraints);
        self.problem.bias(t, q, v, &mut self.gamma);
        self.evaluate_friction(t, q, v)?;
        let transposed = &self.constraints.transposed;
        let mut g = DMatrix::zeros(n, self.rows.len());
        for (column, &row) in self.rows.iter().enumerate() {
            g.set_column(column, &transposed.column(row));
        }
        let c = g.transpose();
        for (column, &row) in self.rows.iter().enumerate() {
            let k = row.wrapping_sub(self.shape.joints);
            if k < self.mode.len()
                && let Some(direction) = self.direction(k, v)
            {
                for (tangent, d) in self.shape.tangents(k).zip(direction.iter()) {
                    let friction = transposed.column(tangent) * (self.mu[k] * d);
                    let mut column = g.column_mut(column);
                    column -= friction;
                }
            }
        }
        let solved = Solved::new(self.last.take(), &self.mass, Held { c, g }, &self.metric, &mut self.rank)?;
        let bias = DMatrix::from_fn(self.rows.len(), 1, |i, _| -self.gamma[self.rows[i]]);
        let (mut a, mut lambda) = solved.solve(&DMatrix::from_column_slice(n, 1, &self.f), &bias);
        if let Some((of_a, of_lambda)) = &solved.shift {
            a += of_a;
            lambda += of_lambda;
        }
        self.a.copy_from_slice(a.as_slice());
        self.lambda.fill(0.0);
        for (&row, lambda) in self.rows.iter().zip(lambda.iter()) {
            self.lambda[row] = *lambda;
        }
        for k in 0..self.mode.len() {
            if let Some(direction) = self.direction(k, v) {
                let size = self.mu[k] * self.lambda[self.shape.normal(k)];
                for (row, d) in self.shape.tangents(k).zip(direction.iter()) {
                    self.lambda[row] = -size * d;
                }
            }
        }
        Some(solved)
    }

    /// Adds the derivative of 3D slip directions to the derivative of `M a - f - J^T lambda`.
    fn add_turning(&self, v: &[f64], balance: &mut DMatrix<f64>) {
        for k in (0..self.mode.len()).filter(|&k| self.shape.contacts[k].slips == 2) {
            let Some(way) = self.way(k, v).filter(|way| way.norm() > 0.0) else { continue };
            let (d, speed) = (way.normalize(), way.norm());
            let size = self.mu[k] * self.lambda[self.shape.normal(k)] / speed;
            let turning = (Matrix2::identity() - d * d.transpose()) * size;
            for (i, row) in self.shape.tangents(k).enumerate() {
                for (j, by) in self.shape.tangents(k).enumerate() {
                    let push = self.constraints.transposed.column(row) * turning[(i, j)];
                    *balance += push * self.sensitivity.velocity.row(by);
                }
            }
        }
    }
}

/// Derivatives of friction by its coefficient; the equations of a mechanical system take the coefficient as fixed.
impl ModeEquations {
    /// Returns, for a sliding contact whose friction coefficient varies, the generalised force `J_t^T d lambda_n` per
    /// unit of the coefficient, opposite to friction, and the derivative of the slip speed by the rows of the slip.
    pub(super) fn varying_friction(&self, k: usize, v: &[f64]) -> Option<(DVector<f64>, Vector2<f64>)> {
        if !self.shape.contacts[k].varies {
            return None;
        }
        let direction = self.direction(k, v)?;
        let mut push = DVector::zeros(self.shape.coordinates);
        for (row, d) in self.shape.tangents(k).zip(direction.iter()) {
            push += self.constraints.transposed.column(row) * (d * self.lambda[self.shape.normal(k)]);
        }
        let slope = match self.shape.contacts[k].slips {
            // Past the end of the mode the slip speed counts as zero, so that its derivative vanishes.
            1 if self.slip(k, v).dot(&direction) < 0.0 => Vector2::zeros(),
            1 => direction,
            _ => self.shape.contacts[k].slip_speed_slope(&self.slip(k, v), &direction),
        };
        Some((push, slope))
    }

    /// Adds the derivatives of the friction coefficients to the derivative of `M a - f - J^T lambda`.
    fn add_friction_slopes(&mut self, t: f64, (q, v): (&[f64], &[f64]), balance: &mut DMatrix<f64>) {
        let n = self.shape.coordinates;
        for k in 0..self.mode.len() {
            let Some((push, of_speed)) = self.varying_friction(k, v) else { continue };
            let mut slopes = vec![0.0; 2 * n + 1];
            let speed = self.slip_speed(k, v);
            self.problem.friction_slopes(k, t, q, v, speed, &mut slopes);
            let by_speed = slopes[2 * n];
            let mut by_state = RowDVector::from_column_slice(&slopes[..2 * n]);
            for (row, slope) in self.shape.tangents(k).zip(of_speed.iter()) {
                by_state += self.sensitivity.velocity.row(row) * (by_speed * slope);
            }
            // Leave out a slope that is not finite, such as that of a root at rest: Newton iterations then only
            // converge more slowly.
            if by_state.iter().all(|slope| slope.is_finite()) {
                *balance += push * by_state;
            }
        }
    }
}

/// Returns the inverse of the matrix `C M^-1 G` of a contact mode, or for a singular one the pseudo-inverse with rows
/// and columns scaled by `scale`; and the rank. If the rank was deficient `before`, it stays so until the matrix is
/// clearly regular.
fn invert(matrix: &DMatrix<f64>, scale: &DVector<f64>, before: Option<usize>) -> Option<(DMatrix<f64>, usize)> {
    let n = matrix.nrows();
    if n == 0 {
        return Some((matrix.clone(), 0));
    }
    if !matrix.iter().all(|x| x.is_finite()) {
        return None;
    }
    let before = before.unwrap_or(n);
    let least = if before < n { RISEN } else { DEPENDENT };
    // Determine the rank without the scaling by `scale`, whose entries may differ as widely as the loads.
    let pivoted = Pivoted::new(matrix.clone());
    let rank = pivoted.rank(least);
    if rank == n {
        return pivoted.inverse().map(|inverse| (inverse, n));
    }
    let scale = DMatrix::from_diagonal(scale);
    let inverse = Pivoted::new(&scale * matrix * &scale).pseudo_inverse(rank)?;
    Some((&scale * inverse * &scale, rank))
}

impl Dvi for ModeEquations {
    fn structure(&self) -> &Structure {
        &self.structure
    }

    fn evaluate(&mut self, t: f64, y: &[f64], values: &mut [f64]) {
        let n = self.shape.coordinates;
        self.evaluate_at(t, y);
        values[..n].copy_from_slice(&y[n..]);
        values[n..].copy_from_slice(&self.a);
    }

    fn jacobian(&mut self, t: f64, y: &[f64], values: &mut [f64]) {
        let n = self.shape.coordinates;
        let (identity, rest) = values.split_at_mut(n);
        identity.fill(1.0);
        let Some(solved) = self.solved(t, y) else {
            rest.fill(f64::NAN);
            return;
        };
        let (q, v) = y.split_at(n);
        let mut sensitivity = std::mem::take(&mut self.sensitivity);
        self.problem.sensitivity(t, q, v, &self.a, &self.lambda, &mut sensitivity);
        self.sensitivity = sensitivity;
        let mut balance = self.sensitivity.balance.clone();
        self.add_turning(v, &mut balance);
        self.add_friction_slopes(t, (q, v), &mut balance);
        let acceleration = &self.sensitivity.acceleration;
        let w = DMatrix::from_fn(self.rows.len(), 2 * n, |i, j| -acceleration[(self.rows[i], j)]);
        if balance.iter().chain(&w).all(|x| *x == 0.0) {
            rest.fill(0.0);
        } else {
            let (by_state, _) = solved.solve(&-balance, &w);
            for i in 0..n {
                for j in 0..2 * n {
                    rest[i * 2 * n + j] = by_state[(i, j)];
                }
            }
        }
        self.last = Some(solved);
    }

    fn features(&self) -> &[usize] {
        &self.features
    }

    fn may_jump(&mut self, t: Interval, y: &[Interval]) -> bool {
        self.problem.may_jump(t, y)
    }

    fn may_pass_knot(&mut self, t: Interval, y: &[Interval]) -> bool {
        self.problem.may_pass_knot(t, y)
    }

    fn enclose(&mut self, t: Interval, y: &[Interval], values: &mut [Interval]) -> bool {
        let n = self.shape.coordinates;
        let middle = self.evaluate_at_middle(t, y);
        let Some(forces) = self.enclose(t, y, &middle) else { return false };
        values[..n].copy_from_slice(&y[n..]);
        values[n..].copy_from_slice(&forces.a);
        true
    }

    fn enclose_derivatives(
        &mut self,
        t: Interval,
        y: &[Interval],
        jacobian: &mut [Interval],
        _: &mut [Interval],
    ) -> bool {
        let (identity, rest) = jacobian.split_at_mut(self.shape.coordinates);
        identity.fill(Interval::point(1.0));
        self.evaluate_at_middle(t, y);
        self.enclose_slopes(t, y, rest)
    }

    fn vary_derivatives(&mut self, times: [f64; 3], y: &[f64], variations: &mut [(f64, f64)]) {
        let (identity, rest) = variations.split_at_mut(self.shape.coordinates);
        identity.fill((0.0, 0.0));
        let points = y.len() / 3;
        self.evaluate_at(times[1], &y[points..2 * points]);
        self.vary_slopes(times, y, rest);
    }

    fn time_derivative(&mut self, _: f64, _: &[f64], _: &mut [f64]) {}

    fn breaks(&mut self, t: f64) -> &[f64] {
        self.problem.breaks(t)
    }

    fn break_courses(&mut self, t: f64) -> &[f64] {
        self.problem.break_courses(t)
    }

    fn enclose_breaks(&mut self, t: Interval) -> &[Interval] {
        self.problem.enclose_breaks(t)
    }
}
