//! One step at the level of velocities, with forces linearly implicit (Anitescu and Potra 2002, *A time-stepping method for
//! stiff multibody dynamics with contact and friction*):
//!
//! ```text
//! (M - h f_v - h^2 f_q) (v+ - v) = h (f + h f_q v) + J^T r,    q+ = q + h v+,    (r, u+) by the law of contact
//! ```
//!
//! with `M`, `J`, `f` at `(t, q, v)`. Where `f` is constant this is the explicit scheme `M (v+ - v) = h f + J^T r`. Joints
//! hold at the level of velocities; what curvature leaves of a constraint at the end, a joint off zero or a negative gap, is
//! taken out of `q+` by the shortest way in the metric of `M`, which leaves velocities, and with them kinetic energy, alone.

use super::delassus::{Delassus, dot};
use super::law::{Law, Report, sequential};
use super::near::Near;
use super::settings::{ContactError, ImpactLaw};
use crate::problem::{Constraints, Control, Mechanical, MechanicalStructure};
use crate::vi::Outcome;
use nalgebra::{DMatrix, Vector3};

/// Time, coordinates and velocities.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct State {
    /// `t`.
    pub t: f64,
    /// `q`.
    pub q: Vec<f64>,
    /// `v`.
    pub v: Vec<f64>,
}

/// What the forces of a step are.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Forces {
    /// All of them, and contacts with their restitution.
    All,
    /// All of them, and contacts without restitution: how motion goes on after an infinite number of impacts.
    Inelastic,
    /// None but impulses: an impact, at an instant. Contacts with a gap below this are closed.
    Impact(f64),
}

/// What contacts did in a step.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Contacted {
    /// Impulses, one for each contact of the system; zero where it is open.
    pub r: Vec<Vector3<f64>>,
    /// `u-` of each contact that was near.
    pub before: Vec<Vector3<f64>>,
    /// `u+`.
    pub after: Vec<Vector3<f64>>,
    /// Dissipated by friction.
    pub friction: f64,
    /// Lost in impacts.
    pub impacts: f64,
}

/// What the law makes of a contact in a step that is no part of the trajectory.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Probed {
    /// Its impulse.
    pub r: Vector3<f64>,
    /// `u` at the state probed.
    pub before: Vector3<f64>,
    /// `u` at the end of the step, without impulses.
    pub free: Vector3<f64>,
    /// `u` at its end.
    pub after: Vector3<f64>,
    /// What is rounding in slips.
    pub rounding: f64,
}

/// Counters of a run.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Work {
    /// Evaluations of the forces.
    pub forces: u64,
    /// Evaluations of their derivatives.
    pub jacobians: u64,
    /// Problems of contact solved.
    pub solves: u64,
    /// Pivots and iterations in them.
    pub iterations: u64,
    /// The solver that answered last.
    pub solver: &'static str,
    /// The largest relative residual.
    pub residual: f64,
    /// Impacts in which the whole restitution would have added energy.
    pub limited: u64,
    /// When and where friction first drove a contact into what it slid on.
    pub painleve: Option<(f64, usize)>,
    /// The largest number of contacts that were near at once.
    pub most_near: usize,
}

/// Makes steps. It owns all room that they need.
pub struct VelocityStep<'p> {
    /// The system.
    pub problem: &'p mut dyn Mechanical,
    pub(super) structure: MechanicalStructure,
    pub(super) constraints: Constraints,
    pub(super) delassus: Delassus,
    pub(super) mass: DMatrix<f64>,
    implicit: DMatrix<f64>,
    by_q: DMatrix<f64>,
    by_v: DMatrix<f64>,
    /// The step size for which a constant matrix is factorised.
    factorised: Option<f64>,
    law: Law,
    impact_law: ImpactLaw,
    pub(super) f: Vec<f64>,
    /// What contacts did in the last step.
    pub contacted: Contacted,
    /// Counters.
    pub work: Work,
}

/// Passes that take out of `q` what curvature leaves of the constraints.
const CORRECTIONS: usize = 6;

/// A slip this small beside its terms, or beside its change within a step, is none.
const ROUNDING: f64 = 1e-11;
const SMALL: f64 = 1e-6;

/// A constraint off by this, in units of the coordinates, is left.
const OFF: f64 = 1e-13;

impl<'p> VelocityStep<'p> {
    /// Room for a system.
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
            law: Law::new(tolerance),
            impact_law,
            f: vec![0.0; n],
            contacted: Contacted::none(structure.contacts.len()),
            work: Work::default(),
            problem,
            structure,
        }
    }

    /// Moves `state` over `h`.
    ///
    /// # Errors
    /// If something is not finite, `M` singular, or the law of contact unsolved; `state` is then as it was.
    pub fn advance(
        &mut self,
        state: &mut State,
        h: f64,
        forces: Forces,
        control: &Control,
    ) -> Result<(), ContactError> {
        let duration = if let Forces::Impact(_) = forces { 0.0 } else { h };
        self.problem.constraints(state.t + duration, &state.q, &mut self.constraints);
        // The bias of the end, the gaps of the beginning.
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
        self.delassus.obey_joints(&violation, &mut v);
        self.touch(state, &mut v, h, forces, control)?;
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

    /// What the law makes of contacts that are closed, without restitution, in a step so short that only directions
    /// count; the place is that where free motion leads, so that curved ways count too. `None` where friction drives a
    /// contact into what it slides on.
    ///
    /// # Errors
    /// See [`VelocityStep::advance`].
    pub fn probe(
        &mut self,
        state: &State,
        h: f64,
        contacts: &[usize],
        control: &Control,
    ) -> Result<Option<Vec<Probed>>, ContactError> {
        let lost = ContactError::Singular { t: state.t };
        self.problem.constraints(state.t, &state.q, &mut self.constraints);
        self.check_constraints(state.t)?;
        let now = self.constraints.clone();
        let q = state.q.iter().zip(&state.v).map(|(q, v)| q + h * v).collect();
        let ahead = State { t: state.t + h, q, v: state.v.clone() };
        self.problem.constraints(ahead.t, &ahead.q, &mut self.constraints);
        self.check_constraints(ahead.t)?;
        self.factorised = None;
        self.factorise(&ahead, h)?;
        let mut v = state.v.clone();
        self.add_forces(&ahead, h, &mut v)?;
        if !self.delassus.hold_joints(&self.constraints) {
            return Err(lost);
        }
        let violation: Vec<f64> = (0..self.structure.joints).map(|i| self.constraints.velocity(i, &v)).collect();
        self.delassus.obey_joints(&violation, &mut v);
        let near = Near::new(&self.structure, &self.constraints, &mut self.delassus, contacts).ok_or(lost)?;
        self.factorised = None;
        let before = near.velocities(&self.structure, &now, &state.v);
        let free = near.velocities(&self.structure, &self.constraints, &v);
        let rounding = self.rounding_of_slips(contacts, &state.v, &before, &free);
        if let Some(i) = near.painleve(&before, &rounding) {
            self.work.painleve.get_or_insert((state.t, contacts[i]));
            return Ok(None);
        }
        let none = vec![0.0; contacts.len()];
        let mut r = vec![Vector3::zeros(); contacts.len()];
        let law = near.contacts(&free, &free, &none, &none, h);
        let report = self.law.impulses(&law, &mut r, control);
        self.work.count(&report, contacts.len());
        if report.outcome != Outcome::Solved {
            return Err(ContactError::Unsolved { t: state.t, contacts: contacts.len(), residual: report.residual });
        }
        let probed = |i: usize| Probed {
            r: r[i],
            before: before[i],
            free: free[i],
            after: law.after(i, &r),
            rounding: rounding[i],
        };
        Ok(Some((0..contacts.len()).map(probed).collect()))
    }

    /// Puts `q` on the joints and gaps among these rows, and `v` on all of them, by the shortest way in the metric of `M`;
    /// rows that depend on each other share it.
    ///
    /// # Errors
    /// See [`VelocityStep::advance`].
    pub fn project(&mut self, state: &mut State, rows: &[usize]) -> Result<(), ContactError> {
        let lost = ContactError::Singular { t: state.t };
        let holonomic: Vec<usize> =
            rows.iter().copied().filter(|&row| row < self.structure.joints + self.structure.contacts.len()).collect();
        for pass in 0..CORRECTIONS {
            self.problem.constraints(state.t, &state.q, &mut self.constraints);
            self.check_constraints(state.t)?;
            self.factorised = None;
            self.factorise(state, 0.0)?;
            let off: Vec<f64> = holonomic.iter().map(|&row| self.constraints.values[row]).collect();
            if pass + 1 == CORRECTIONS || off.iter().all(|off| off.abs() <= OFF) {
                break;
            }
            if !self.delassus.remove(&self.constraints, &holonomic, &off, &mut state.q) {
                return Err(lost);
            }
        }
        let off: Vec<f64> = rows.iter().map(|&row| self.constraints.velocity(row, &state.v)).collect();
        if self.delassus.remove(&self.constraints, rows, &off, &mut state.v) { Ok(()) } else { Err(lost) }
    }

    /// Moves `q` to where no gap is negative and every joint holds, and `v` to where joints are not torn; whether that
    /// is reached.
    ///
    /// # Errors
    /// If something is not finite, or `M` singular.
    pub fn resolve(&mut self, state: &mut State, control: &Control) -> Result<bool, ContactError> {
        self.problem.constraints(state.t, &state.q, &mut self.constraints);
        self.check_constraints(state.t)?;
        self.factorise(state, 0.0)?;
        self.correct(state, control)?;
        self.problem.constraints(state.t, &state.q, &mut self.constraints);
        self.check_constraints(state.t)?;
        if !self.delassus.hold_joints(&self.constraints) {
            return Err(ContactError::Singular { t: state.t });
        }
        let (phi, gaps) = self.constraints.values.split_at(self.structure.joints);
        let violation: Vec<f64> = (0..phi.len()).map(|i| self.constraints.velocity(i, &state.v)).collect();
        let resolved = phi.iter().all(|phi| phi.abs() <= OFF) && gaps.iter().all(|gap| *gap >= -OFF);
        self.delassus.obey_joints(&violation, &mut state.v);
        Ok(resolved)
    }

    /// The size of the terms that a slip of contact `k` is the sum of, at velocities `v`; infinite without friction.
    pub(super) fn size_of_slip(&self, k: usize, v: &[f64]) -> f64 {
        let terms = |row: usize| {
            let products = self.constraints.row(row).iter().zip(v).map(|(j, v)| (j * v).abs());
            products.sum::<f64>() + self.constraints.drift[row].abs()
        };
        self.structure.tangents(k).map(terms).reduce(f64::max).unwrap_or(f64::INFINITY)
    }

    /// Slips that are none: rounding of their terms, and small beside what forces make of them within the step.
    fn rounding_of_slips(
        &self,
        contacts: &[usize],
        v: &[f64],
        before: &[Vector3<f64>],
        free: &[Vector3<f64>],
    ) -> Vec<f64> {
        let changes = before.iter().zip(free).map(|(before, free)| SMALL * (free - before).norm());
        contacts.iter().zip(changes).map(|(&k, change)| change.max(ROUNDING * self.size_of_slip(k, v))).collect()
    }

    /// Factorisations made.
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

    /// Factorises `M - h f_v - h^2 f_q`, unless it is constant and at hand.
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

    /// `v += (M - h f_v - h^2 f_q)^-1 h (f + h f_q v)`.
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
        v.iter_mut().zip(&p).for_each(|(v, p)| *v += p);
        Ok(())
    }

    /// Takes out of `q` what is left of the joints and of gaps below zero. The law of contact, with gaps in the place of
    /// velocities, keeps one gap from opening by force where another closes.
    fn correct(&mut self, state: &mut State, control: &Control) -> Result<(), ContactError> {
        let (joints, contacts) = (self.structure.joints, self.structure.contacts.len());
        if joints + contacts == 0 {
            return Ok(());
        }
        let mut low: Vec<usize> = Vec::new();
        for pass in 0..CORRECTIONS {
            self.problem.constraints(state.t, &state.q, &mut self.constraints);
            self.check_constraints(state.t)?;
            let (phi, gaps) = self.constraints.values.split_at(joints);
            low.extend((0..contacts).filter(|&k| gaps[k] < -OFF && !low.contains(&k)).collect::<Vec<_>>());
            if phi.iter().all(|phi| phi.abs() <= OFF) && low.iter().all(|&k| gaps[k] >= -OFF) {
                return Ok(());
            }
            // A place that has no way out is left after a few passes; the next step starts there.
            let lost = ContactError::Singular { t: state.t };
            if pass + 1 == CORRECTIONS || !self.delassus.hold_joints(&self.constraints) {
                return Ok(());
            }
            let before = state.q.clone();
            self.delassus.obey_joints(phi, &mut state.q);
            if low.is_empty() {
                continue;
            }
            low.sort_unstable();
            let moved: Vec<f64> = state.q.iter().zip(&before).map(|(q, before)| q - before).collect();
            let gap = |k: usize| gaps[k] + dot(self.constraints.row(joints + k), &moved);
            let gaps: Vec<_> = low.iter().map(|&k| Vector3::new(gap(k), 0.0, 0.0)).collect();
            let near = Near::new(&self.structure, &self.constraints, &mut self.delassus, &low).ok_or(lost)?;
            let mut p = vec![Vector3::zeros(); low.len()];
            let report = self.law.impulses(&near.without_friction(&gaps), &mut p, control);
            if report.outcome == Outcome::Solved {
                near.apply(&self.structure, &self.delassus, &p, &mut state.q);
            }
        }
        Ok(())
    }

    /// Lets the law of contact act on `v`.
    fn touch(
        &mut self,
        state: &State,
        v: &mut [f64],
        h: f64,
        forces: Forces,
        control: &Control,
    ) -> Result<(), ContactError> {
        let m = self.structure.contacts.len();
        // Closed contacts have no gap to be divided by a duration.
        let h = if let Forces::Impact(_) = forces { 1.0 } else { h };
        let start = std::mem::replace(&mut self.contacted, Contacted::none(m)).r;
        let free = v.to_vec();
        let mut near: Vec<usize> = Vec::new();
        loop {
            let closes = |&k: &usize| !near.contains(&k) && self.closes(k, v, h, forces);
            let joined: Vec<usize> = (0..m).filter(closes).collect();
            if joined.is_empty() {
                break;
            }
            near.extend(joined);
            near.sort_unstable();
            let lost = ContactError::Singular { t: state.t };
            let scene = Near::new(&self.structure, &self.constraints, &mut self.delassus, &near).ok_or(lost)?;
            let mut r: Vec<Vector3<f64>> = near.iter().map(|&k| start[k]).collect();
            let instant = matches!(forces, Forces::Impact(_));
            let mut before = scene.velocities(&self.structure, &self.constraints, &state.v);
            let mut without = scene.velocities(&self.structure, &self.constraints, &free);
            let gap = |&k: &usize| if instant { 0.0 } else { self.constraints.values[self.structure.joints + k] };
            let gap: Vec<f64> = near.iter().map(gap).collect();
            let elastic = if forces == Forces::Inelastic { 0.0 } else { 1.0 };
            let restitution: Vec<f64> = scene.restitution.iter().map(|e| elastic * e).collect();
            let mut struck = vec![Vector3::zeros(); near.len()];
            if self.impact_law == ImpactLaw::Sequential && forces != Forces::Inelastic {
                struck = sequential(&scene.contacts(&without, &before, &gap, &restitution, h)).0;
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
            let contacts = scene.contacts(&without, &before, &gap, &restitution, h);
            let report = self.law.impulses(&contacts, &mut r, control);
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
            for (i, &k) in near.iter().enumerate() {
                self.contacted.note(k, r[i], before[i], after[i]);
            }
        }
        Ok(())
    }

    /// Whether contact `k` matters at end velocities `v`.
    fn closes(&self, k: usize, v: &[f64], h: f64, forces: Forces) -> bool {
        let gap = self.constraints.values[self.structure.joints + k];
        match forces {
            Forces::Impact(closed) => gap <= closed,
            _ => gap <= 0.0 || gap + h * self.constraints.velocity(self.structure.normal(k), v) <= 0.0,
        }
    }
}

impl Contacted {
    /// No contact of `m` did anything.
    pub fn none(m: usize) -> Self {
        let zero = vec![Vector3::zeros(); m];
        Self { r: zero.clone(), before: zero.clone(), after: zero, friction: 0.0, impacts: 0.0 }
    }

    fn note(&mut self, k: usize, r: Vector3<f64>, before: Vector3<f64>, after: Vector3<f64>) {
        (self.r[k], self.before[k], self.after[k]) = (r, before, after);
        let mean = 0.5 * (before + after);
        self.impacts -= r.x * mean.x;
        self.friction -= r.y * mean.y + r.z * mean.z;
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
