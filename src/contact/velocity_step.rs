//! One step at the level of velocities, with forces linearly implicit (Anitescu and Potra 2002, *A time-stepping method
//! for stiff multibody dynamics with contact and friction*):
//!
//! ```text
//! (M - h f_v - h^2 f_q) (v+ - v) = h (f + h f_q v) + J^T r,    q+ = q + h v+,    (r, u+) by the law of contact
//! ```
//!
//! with `M`, `J`, `f` at `(t, q, v)`. If `f` is constant this is the explicit scheme `M (v+ - v) = h f + J^T r`. Joints
//! hold at the level of velocities; the remaining violation of position constraints at the end, a joint off zero or a
//! negative gap, is projected out of `q+` in the metric of `M`, which leaves velocities, and with them kinetic energy,
//! unchanged.

mod contacted;
mod correction;
mod friction;
mod probe;

pub use contacted::Contacted;
pub use probe::{Probed, Scales};

use super::active_contacts::{ActiveContacts, rows};
use super::delassus::{Delassus, dot};
use super::law::{Law, Report, sequential};
use super::settings::{ContactError, ImpactLaw};
use friction::Motion;
use nalgebra::{DMatrix, Vector3};
use problem::{Constraints, Control, Mechanical, MechanicalStructure};
use vi::Outcome;

/// State of a mechanical system: time, coordinates and velocities.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct State {
    /// The time `t` of the state.
    pub t: f64,
    /// The generalised coordinates `q`.
    pub q: Vec<f64>,
    /// The generalised velocities `v`.
    pub v: Vec<f64>,
}

/// Which forces act in a step, and whether contacts rebound.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Forces {
    /// All forces and impulses act; contacts rebound with their restitution.
    All,
    /// Impulses alone act: an instantaneous impact of the closed contacts.
    Impact,
    /// Impulses alone act, without restitution: the limit of infinitely many impacts.
    Inelastic,
}

/// Tolerance for closed gaps at an event, where several contacts may close at once: a gap is closed below `GAP_TOL`
/// times its largest terms so far plus `OPEN` times the tolerance that it inherits from the coordinates (for bodies
/// that rest at zero, whose terms vanish). Velocities below `OPEN` times their tolerance are treated as zero.
const GAP_TOL: f64 = 1e-10;
const OPEN: f64 = 1e-3;

/// Rounding error of the value of a joint or a gap, relative to its largest terms so far.
const ROUNDING: f64 = 1e-13;

/// Cost counters of a run with contacts.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Work {
    /// Number of evaluations of the generalised forces.
    pub forces: u64,
    /// Number of evaluations of the derivatives of the generalised forces.
    pub jacobians: u64,
    /// Number of contact problems solved.
    pub solves: u64,
    /// Total number of pivots and iterations of the contact solvers.
    pub iterations: u64,
    /// Name of the solver that solved the last contact problem.
    pub solver: &'static str,
    /// The largest relative residual of the contact law in the run so far.
    pub residual: f64,
    /// The number of impacts whose whole restitution would have added energy.
    pub limited: u64,
    /// Time and contact of the first Painleve paradox: friction drove the contact into the surface that it slid on.
    pub painleve: Option<(f64, usize)>,
    /// The largest number of contacts active in one step.
    pub most_near: usize,
}

/// Integrator of single steps at the level of velocities, with its workspace.
pub struct VelocityStep<'p> {
    /// The mechanical system that is integrated.
    pub problem: &'p mut dyn Mechanical,
    pub(super) structure: MechanicalStructure,
    pub(super) constraints: Constraints,
    pub(super) delassus: Delassus,
    pub(super) mass: DMatrix<f64>,
    implicit: DMatrix<f64>,
    by_q: DMatrix<f64>,
    by_v: DMatrix<f64>,
    /// The step size for which the factors of `M - h f_v - h^2 f_q` were computed; `None` unless the matrix is
    /// constant.
    factorised: Option<f64>,
    /// The largest size of the terms of each joint and gap so far.
    pub(super) sizes: Vec<f64>,
    /// The tolerance of each joint and gap that follows from the tolerances of the coordinates.
    open: Vec<f64>,
    /// The absolute tolerances on velocities; empty if the step size is constant.
    pub(super) atol: Vec<f64>,
    law: Law,
    impact_law: ImpactLaw,
    /// Whether a step whose contacts close at different times is solved again with the sequential impact law, for
    /// comparison with a run in which the impacts are simultaneous.
    pub is_beside: bool,
    /// The largest time by which the last step applied an impact too early: a step applies impacts at its beginning,
    /// whereas they occur when the gaps close.
    pub early: f64,
    pub(super) f: Vec<f64>,
    /// The velocity change by forces in the last step, as a norm in the metric of `M`.
    pub(super) kick: f64,
    /// The change of each generalised velocity by forces in the last step.
    pub kicks: Vec<f64>,
    /// The contact whose gap was located to close; in an instantaneous impact it counts as closed whatever the
    /// rounding error of its gap.
    pub(super) closing: Option<usize>,
    /// The length of the last probe step; `None` before the first.
    pub(super) instant: Option<f64>,
    /// The impulses of the last step in the order in which the sequential impact law applied them, each with its
    /// contact.
    pub(super) strikes: Vec<(usize, Vector3<f64>)>,
    /// Impulses, velocities and energy losses of the contacts in the last step.
    pub contacted: Contacted,
    /// Cost counters of the run.
    pub work: Work,
}

impl<'p> VelocityStep<'p> {
    /// Allocates the workspace for a mechanical system; `tolerance` bounds the relative residual of the contact law.
    pub fn new(problem: &'p mut dyn Mechanical, impact_law: ImpactLaw, tolerance: f64) -> Self {
        let structure = problem.structure().clone();
        let n = structure.coordinates;
        Self {
            constraints: Constraints::new(&structure),
            delassus: Delassus::new(&structure),
            mass: DMatrix::zeros(n, n),
            implicit: DMatrix::zeros(n, n),
            by_q: DMatrix::zeros(n, n),
            by_v: DMatrix::zeros(n, n),
            factorised: None,
            sizes: vec![0.0; structure.joints + structure.contacts.len()],
            open: vec![0.0; structure.joints + structure.contacts.len()],
            atol: Vec::new(),
            law: Law::new(tolerance),
            impact_law,
            is_beside: false,
            early: 0.0,
            f: vec![0.0; n],
            kick: 0.0,
            kicks: vec![0.0; n],
            closing: None,
            instant: None,
            strikes: Vec::new(),
            contacted: Contacted::none(structure.contacts.len()),
            work: Work::default(),
            problem,
            structure,
        }
    }

    /// Advances `state` by the step size `h`.
    ///
    /// # Errors
    /// Fails if a quantity is not finite, `M` is singular, or the contact law is unsolved; `state` is then unchanged.
    pub fn advance(
        &mut self,
        state: &mut State,
        h: f64,
        forces: Forces,
        control: &Control,
    ) -> Result<(), ContactError> {
        let duration = if forces == Forces::All { h } else { 0.0 };
        self.problem.constraints(state.t + duration, &state.q, &mut self.constraints);
        // Evaluate the drift `b` of the contact velocities `u = J v + b` at the end of the step, the gaps at its
        // beginning.
        if duration > 0.0 && !self.structure.contacts.is_empty() {
            let drift = std::mem::take(&mut self.constraints.drift);
            self.constraints.drift = vec![0.0; drift.len()];
            self.problem.constraints(state.t, &state.q, &mut self.constraints);
            self.constraints.drift = drift;
        }
        self.check_constraints(state.t)?;
        self.factorise(state, duration)?;
        let mut v = state.v.clone();
        if duration > 0.0 {
            self.add_forces(state, h, &mut v)?;
        }
        let lost = ContactError::Singular { t: state.t };
        if !self.delassus.hold_joints(&self.constraints) {
            return Err(lost);
        }
        let violation: Vec<f64> = (0..self.structure.joints).map(|i| self.constraints.velocity(i, &v)).collect();
        let unheld = v.clone();
        self.delassus.obey_joints(&violation, &mut v);
        self.survey(&state.q, &v, duration);
        self.touch(state, &mut v, h, forces, control)?;
        let lost = ContactError::Singular { t: state.t };
        self.contacted.drives += self.drive_of_joints(unheld).ok_or(lost)?;
        if !v.iter().all(|v| v.is_finite()) {
            return Err(ContactError::NotFinite { what: "velocity", t: state.t });
        }
        state.t += duration;
        state.v.copy_from_slice(&v);
        state.q.iter_mut().zip(&v).for_each(|(q, v)| *q += duration * v);
        if duration > 0.0 {
            self.correct(state, control)?;
        }
        Ok(())
    }

    /// Returns, for each joint and gap, the coordinates whose coefficient has the largest absolute value of the row;
    /// returns an empty list unless all rows are affine.
    pub fn alike(&self) -> Vec<Vec<usize>> {
        if !self.structure.affine_constraints {
            return Vec::new();
        }
        let contacts = (0..self.structure.contacts.len()).map(|k| self.structure.normal(k));
        let rows = (0..self.structure.joints).chain(contacts).map(|row| self.constraints.row(row));
        let alike = rows.map(|row| {
            let largest = row.iter().fold(0.0, |most: f64, factor| most.max(factor.abs()));
            (0..row.len()).filter(|&k| row[k] != 0.0 && row[k].abs() == largest).collect()
        });
        alike.collect()
    }

    /// Returns the number of factorisations of `M - h f_v - h^2 f_q` so far.
    pub fn factorisations(&self) -> u64 {
        self.delassus.factorisations
    }

    fn check_constraints(&self, t: f64) -> Result<(), ContactError> {
        let Constraints { values, drift, transposed } = &self.constraints;
        if values.iter().chain(drift).chain(transposed.iter()).all(|x| x.is_finite()) {
            Ok(())
        } else {
            Err(ContactError::NotFinite { what: "gap, slip or joint", t })
        }
    }

    /// Records the largest size of the terms of each joint and gap so far, also of its change in a step of size `h`
    /// without contacts.
    fn survey(&mut self, q: &[f64], v: &[f64], h: f64) {
        for (row, size) in self.sizes.iter_mut().enumerate() {
            let terms = self.constraints.size(row, q) + h * self.constraints.size(row, v);
            *size = size.max(terms).max(self.constraints.values[row].abs());
        }
    }

    /// Records the largest size of the terms of joints and gaps at the coordinates `q`, and the tolerances of joints
    /// and gaps that follow from the tolerances `atol` of the coordinates.
    pub(super) fn meet(&mut self, constraints: &Constraints, q: &[f64], atol: &[f64]) {
        for (row, size) in self.sizes.iter_mut().enumerate() {
            *size = size.max(constraints.size(row, q)).max(constraints.values[row].abs());
            self.open[row] = self.open[row].max(constraints.size(row, atol));
        }
    }

    /// Returns the value below which a gap, or a joint, counts as closed at an event.
    pub(super) fn closed(&self, row: usize) -> f64 {
        GAP_TOL * self.sizes[row] + OPEN * self.open[row]
    }

    /// Returns the rounding error of the value of a joint or a gap.
    pub(super) fn rounding_of_row(&self, row: usize) -> f64 {
        ROUNDING * self.sizes[row]
    }

    /// Returns the velocity below which a row of the constraint Jacobian (a contact or joint velocity) counts as zero,
    /// from the tolerances of velocities.
    pub(super) fn open_velocity(&self, row: usize) -> f64 {
        OPEN * self.constraints.size(row, &self.atol)
    }

    /// Returns the speed below which contact `k` counts as sticking, from the tolerances of velocities.
    pub(super) fn open_slip(&self, k: usize) -> f64 {
        self.structure.tangents(k).map(|row| self.open_velocity(row)).fold(0.0, f64::max)
    }

    /// Factorises `M - h f_v - h^2 f_q`, unless the matrix is constant and already factorised.
    fn factorise(&mut self, state: &State, h: f64) -> Result<(), ContactError> {
        let constant = self.structure.constant_mass && (self.structure.constant_forces || h == 0.0);
        let key = if self.structure.constant_forces { 0.0 } else { h };
        if constant && self.factorised == Some(key) {
            return Ok(());
        }
        self.problem.mass(state.t, &state.q, &mut self.mass);
        self.implicit.copy_from(&self.mass);
        if h > 0.0 && !self.structure.constant_forces {
            self.problem.stiffness(state.t, &state.q, &state.v, &mut self.by_q, &mut self.by_v);
            self.work.jacobians += 1;
            self.implicit -= &self.by_v * h + &self.by_q * (h * h);
        }
        if !self.implicit.iter().all(|x| x.is_finite()) {
            return Err(ContactError::NotFinite { what: "mass or derivative of the forces", t: state.t });
        }
        if self.mass.clone().cholesky().is_none() {
            return Err(ContactError::MassNotPositive { t: state.t });
        }
        self.delassus.factorise(&self.implicit);
        self.factorised = constant.then_some(key);
        Ok(())
    }

    /// Adds the velocity change by forces, `v += (M - h f_v - h^2 f_q)^-1 h (f + h f_q v)`.
    fn add_forces(&mut self, state: &State, h: f64, v: &mut [f64]) -> Result<(), ContactError> {
        self.problem.forces(state.t, &state.q, &state.v, &mut self.f);
        self.work.forces += 1;
        if let Some(component) = self.f.iter().position(|f| !f.is_finite()) {
            return Err(ContactError::Force { component, t: state.t });
        }
        let mut p = self.f.clone();
        if !self.structure.constant_forces {
            for (i, p) in p.iter_mut().enumerate() {
                *p += h * (0..state.v.len()).map(|j| self.by_q[(i, j)] * state.v[j]).sum::<f64>();
            }
        }
        p.iter_mut().for_each(|p| *p *= h);
        if !self.delassus.solve(&mut p) {
            return Err(ContactError::Singular { t: state.t });
        }
        self.kick = (h * dot(&self.f, &p)).max(0.0).sqrt();
        v.iter_mut().zip(&p).for_each(|(v, p)| *v += p);
        self.kicks.copy_from_slice(&p);
        Ok(())
    }

    /// Returns the work of the drives of the joints; `v` are velocities without impulses of joints and contacts.
    fn drive_of_joints(&mut self, mut v: Vec<f64>) -> Option<f64> {
        let joints = self.structure.joints;
        if self.constraints.drift[..joints].iter().all(|b| *b == 0.0) {
            return Some(0.0);
        }
        let mut p = vec![0.0; v.len()];
        for (k, r) in self.contacted.r.iter().enumerate() {
            for (&r, row) in r.iter().zip(rows(&self.structure, k)) {
                p.iter_mut().zip(self.constraints.row(row)).for_each(|(p, j)| *p += j * r);
            }
        }
        if !self.delassus.solve(&mut p) {
            return None;
        }
        v.iter_mut().zip(&p).for_each(|(v, p)| *v += p);
        let violation: Vec<f64> = (0..joints).map(|i| self.constraints.velocity(i, &v)).collect();
        let impulses = self.delassus.joint_impulses(&violation);
        Some(-dot(&impulses, &self.constraints.drift[..joints]))
    }

    /// Applies the contact law to the velocities `v` at the end of a step without contact impulses.
    fn touch(
        &mut self,
        state: &State,
        v: &mut [f64],
        h: f64,
        forces: Forces,
        control: &Control,
    ) -> Result<(), ContactError> {
        let m = self.structure.contacts.len();
        // An impact has no duration to divide gaps by: any positive step size `h` serves, as gaps are set to zero.
        let h = if forces == Forces::All { h } else { 1.0 };
        let start = std::mem::replace(&mut self.contacted, Contacted::none(m)).r;
        self.early = 0.0;
        let free = v.to_vec();
        let mut near: Vec<usize> = Vec::new();
        let (mut impact_law, mut is_again) = (self.impact_law, false);
        loop {
            let closes = |&k: &usize| !near.contains(&k) && self.closes(k, v, h, forces);
            let joined: Vec<usize> = (0..m).filter(closes).collect();
            if joined.is_empty() && !std::mem::take(&mut is_again) {
                break;
            }
            near.extend(joined);
            near.sort_unstable();
            let lost = ContactError::Singular { t: state.t };
            let mut scene =
                ActiveContacts::new(&self.structure, &self.constraints, &mut self.delassus, &near).ok_or(lost)?;
            let mut r: Vec<Vector3<f64>> = near.iter().map(|&k| start[k]).collect();
            let mut before = scene.velocities(&self.structure, &self.constraints, &state.v);
            let mut without = scene.velocities(&self.structure, &self.constraints, &free);
            scene.set_friction(self.coefficients(state, &near, &before)?);
            let lasts = if forces == Forces::All { 1.0 } else { 0.0 };
            let gap = |&k: &usize| lasts * self.constraints.values[self.structure.joints + k];
            let gap: Vec<f64> = near.iter().map(gap).collect();
            let rebounds = forces != Forces::Inelastic;
            let elastic = if rebounds { 1.0 } else { 0.0 };
            let restitution: Vec<f64> = scene.restitution.iter().map(|e| elastic * e).collect();
            let mut struck = vec![Vector3::zeros(); near.len()];
            self.strikes.clear();
            if impact_law == ImpactLaw::Sequential && rebounds {
                let strikes = sequential(&scene.contacts(&without, &before, &gap, &restitution, h));
                strikes.iter().for_each(|&(i, strike)| struck[i] += strike);
                self.strikes.extend(strikes.into_iter().map(|(i, strike)| (near[i], strike)));
                let change: Vec<_> = (0..near.len()).map(|i| scene.delassus.row_product(i, &struck)).collect();
                for (i, change) in change.iter().enumerate() {
                    before[i] += change;
                    without[i] += change;
                }
            }
            let rounding = self.rounding_of_slips(&near, &state.v, &before, &without);
            if let Some(i) = scene.painleve(&before, &rounding) {
                self.work.painleve.get_or_insert((state.t, near[i]));
            }
            let duration = lasts * h;
            let motion = Motion {
                without: &without,
                before: &before,
                gap: &gap,
                restitution: &restitution,
                free: &free,
                h,
                duration,
            };
            let report = self.law_of_contact(state, &near, &mut scene, &motion, &mut r, control)?;
            self.work.count(&report, near.len());
            if report.outcome != Outcome::Solved {
                return Err(ContactError::Unsolved { t: state.t, contacts: near.len(), residual: report.residual });
            }
            r.iter_mut().zip(&struck).for_each(|(r, struck)| *r += struck);
            v.copy_from_slice(&free);
            scene.apply(&self.structure, &self.delassus, &r, v);
            let before = scene.velocities(&self.structure, &self.constraints, &state.v);
            let after = scene.velocities(&self.structure, &self.constraints, v);
            self.contacted = Contacted::none(m);
            self.contacted.kinetic = self.problem.energies(state.t, &state.q, &free).kinetic;
            for (i, &k) in near.iter().enumerate() {
                let change = scene.change(i, &(without[i] - before[i]), &r[i]);
                self.contacted.note(k, r[i], (before[i], after[i]), change);
                let drift = rows(&self.structure, k).map(|row| self.constraints.drift[row]);
                self.contacted.drives -= r[i].iter().zip(drift).map(|(r, b)| r * b).sum::<f64>();
            }
            let is_elastic = |(r, e): (&Vector3<f64>, &f64)| r.x == 0.0 || *e == 1.0;
            if report.restitution == 1.0 && r.iter().zip(&restitution).all(is_elastic) {
                self.contacted.beyond_restitution = self.contacted.impacts;
            }
            self.early = self.closings(&near, &r, &before).map(|(time, ..)| time.min(h)).fold(0.0, f64::max);
            let is_at_once = impact_law == ImpactLaw::Simultaneous;
            if self.is_beside && is_at_once && rebounds && self.strikes_in_turn(&near, &r, &before) {
                is_again = true;
                impact_law = ImpactLaw::Sequential;
            }
        }
        Ok(())
    }

    /// Returns, for each contact that is open at the beginning of the step and has a nonzero impulse in `r`: the time
    /// after which it closes with the velocities `before` the step, its approach speed, and the gap below which it is
    /// closed. The time is infinite if the contact does not approach: it closes only after another contact has been
    /// struck.
    fn closings(
        &self,
        near: &[usize],
        r: &[Vector3<f64>],
        before: &[Vector3<f64>],
    ) -> impl Iterator<Item = (f64, f64, f64)> {
        near.iter().zip(r).zip(before).filter(|((_, r), _)| r.x > 0.0).filter_map(|((&k, _), before)| {
            let row = self.structure.joints + k;
            let (gap, approach, closed) = (self.constraints.values[row], (-before.x).max(0.0), self.closed(row));
            (gap > closed).then(|| (gap / approach, approach, closed))
        })
    }

    /// Whether contacts close at different times within the step, so that their impacts are sequential.
    fn strikes_in_turn(&self, near: &[usize], r: &[Vector3<f64>], before: &[Vector3<f64>]) -> bool {
        let mut closings = self.closings(near, r, before);
        let Some((first, speed, _)) = closings.next() else { return false };
        closings.any(|(time, approach, closed)| {
            let apart = (time - first).abs() * approach.max(speed);
            apart > closed || apart.is_nan()
        })
    }

    /// Whether contact `k` closes with the velocities `v` at the end of the step.
    fn closes(&self, k: usize, v: &[f64], h: f64, forces: Forces) -> bool {
        let gap = self.constraints.values[self.structure.joints + k];
        match forces {
            Forces::Impact | Forces::Inelastic => {
                gap <= self.closed(self.structure.joints + k) || self.closing == Some(k)
            }
            Forces::All => gap <= 0.0 || gap + h * self.constraints.velocity(self.structure.normal(k), v) <= 0.0,
        }
    }
}

impl Work {
    fn count(&mut self, report: &Report, near: usize) {
        self.solves += report.solves;
        self.iterations += report.iterations;
        self.solver = report.solver;
        self.residual = self.residual.max(report.residual);
        self.limited += u64::from(report.restitution < 1.0);
        self.most_near = self.most_near.max(near);
    }
}
