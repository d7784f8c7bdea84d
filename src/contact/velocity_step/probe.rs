//! The probe: a trial step outside the trajectory that determines the next contact mode.

use super::{State, VelocityStep};
use crate::active_contacts::{ActiveContacts, rows};
use crate::delassus::dot;
use crate::settings::ContactError;
use hybrid::Breaks;
use nalgebra::{Vector2, Vector3};
use problem::{Constraints, Control};
use vi::Outcome;

/// Relative zero tolerances for velocities: for rounding, relative to their terms (`ROUNDING`); and relative to their
/// change within a step (`SMALL`).
const ROUNDING: f64 = 1e-11;
const SMALL: f64 = 1e-6;

/// The change of velocities by forces in a probe, relative to the terms of velocities: small enough that only
/// directions count, and far above rounding.
const CHANGE: f64 = 1e-7;

/// A probe is repeated if its change of velocities is smaller or larger than `CHANGE` by more than the factors
/// `TOO_SHORT` and `TOO_LONG`, which rounding and directions tolerate. Forces that hardly vary need one more probe,
/// so that `ATTEMPTS` suffice if none was too long.
const TOO_SHORT: f64 = 100.0;
const TOO_LONG: f64 = 1e3;
const ATTEMPTS: usize = 3;

/// Largest number of probes if one was too short and one too long, as with forces that rise as a high power of time.
/// Each further probe halves the logarithm of the ratio of the two lengths: eleven probes separate them to a factor
/// of two over the whole range of doubles.
const MOST_ATTEMPTS: usize = ATTEMPTS + 11;

/// The shortest probe (trial step), as a multiple of the resolution of the clock.
const TICKS: f64 = 1e4;

/// The result of the contact law at one contact in a probe.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Probed {
    /// The index of the contact that was probed.
    pub contact: usize,
    /// The impulse of the contact in the probe step.
    pub r: Vector3<f64>,
    /// The contact velocity `u` at the state probed.
    pub before: Vector3<f64>,
    /// The contact velocity `u` that the probe ends with if no impulse acts.
    pub free: Vector3<f64>,
    /// The contact velocity `u` at the end of the probe.
    pub after: Vector3<f64>,
    /// The speed below which the slip of the contact counts as rest.
    pub rounding: f64,
    /// The velocity scale of the contact: the size of the changes of `u` by forces and by the contact's own impulse.
    pub change: f64,
    /// The coefficient of friction of the contact in the probe step.
    pub mu: f64,
    /// The residual of the contact law over all contacts of the probe, relative to their velocities.
    pub residual: f64,
}

/// Scales from which the length of a probe is chosen.
#[derive(Clone, Copy)]
pub struct Scales<'a> {
    /// The absolute tolerances of velocities.
    pub atol: &'a [f64],
    /// The sizes of velocities, also before an impact at the time of the probe: velocities after an impact carry the
    /// rounding errors of those before it.
    pub reached: &'a [f64],
    /// The remaining time of the run.
    pub left: f64,
}

/// The length of the longest probe so far that was too short, and that of the shortest that was too long.
#[derive(Default)]
struct Lengths {
    short: Option<f64>,
    long: Option<f64>,
}

impl Lengths {
    /// Returns the probe length to try after the length `h`, which should be longer by `factor`; at most the remaining
    /// time `left`.
    fn after(&mut self, h: f64, factor: f64, left: f64) -> f64 {
        let side = if factor < 1.0 { &mut self.long } else { &mut self.short };
        *side = Some(h);
        let next = factor * h;
        match (self.short, self.long) {
            (Some(short), Some(long)) if next <= short || long <= next => short.sqrt() * long.sqrt(),
            _ => next.min(left.max(h)),
        }
    }

    /// Returns the largest number of probes (trial steps) with which to search for a suitable length.
    fn attempts(&self) -> usize {
        if self.short.is_some() && self.long.is_some() { MOST_ATTEMPTS } else { ATTEMPTS }
    }
}

impl VelocityStep<'_> {
    /// Applies the contact law without restitution to closed contacts that do not separate, in a step so short that
    /// only directions count. Returns the length of the step and the result at each of these contacts. Constraints
    /// are evaluated at the end of the free motion, so that curved paths count too, and forces before the next
    /// breakpoint in time. Returns `None` in Painleve's paradox, where friction drives a contact into the surface it
    /// slides on. If no time scale is known, the length is a fraction of the remaining time, which no probe exceeds.
    ///
    /// # Errors
    /// See [`VelocityStep::advance`].
    pub fn probe(
        &mut self,
        state: &State,
        scales: Scales<'_>,
        closed: &[usize],
        control: &Control,
    ) -> Result<Option<(f64, Vec<Probed>)>, ContactError> {
        let Scales { atol, left, .. } = scales;
        let mut h = match self.instant {
            Some(h) => h,
            None => self.first_instant(state, atol)?.filter(|h| *h <= left).unwrap_or(CHANGE * left),
        };
        let clock = if self.structure.depends_on_time { self.problem.rounding_of_time(state.t) } else { 0.0 };
        let ticks = TICKS * clock;
        let (mut lengths, mut attempt) = (Lengths::default(), 1);
        let (now, v) = loop {
            h = Breaks::new(state.t).part_before(self.problem, state.t, h.max(ticks));
            let free = match self.free_motion(state, h) {
                // A shorter probe was too short, but forces may be undefined at the end of a longer one: bisect the
                // length.
                Err(_) if lengths.short.is_some() && attempt < MOST_ATTEMPTS => None,
                free => Some(free?),
            };
            let factor = free.as_ref().map_or(0.0, |free| self.pace(free, state, closed, scales));
            let fits = (factor * TOO_LONG >= 1.0 && factor <= TOO_SHORT) || (factor < 1.0 && h <= ticks);
            let next = lengths.after(h, factor, left);
            match free {
                Some(free) if fits || attempt >= lengths.attempts() || next == h => break free,
                _ => (h, attempt) = (next, attempt + 1),
            }
        };
        self.instant = Some(h);
        Ok(self.touch_free(state, h, (now, v), (closed, scales.reached), control)?.map(|probed| (h, probed)))
    }

    /// Returns an initial length of the probe, for which forces change no velocity by more than its absolute tolerance.
    fn first_instant(&mut self, state: &State, atol: &[f64]) -> Result<Option<f64>, ContactError> {
        self.factorised = None;
        self.factorise(state, 0.0)?;
        let mut rates = vec![0.0; state.v.len()];
        self.problem.forces(state.t, &state.q, &state.v, &mut rates);
        if !self.delassus.solve(&mut rates) {
            return Err(ContactError::Singular { t: state.t });
        }
        let known = state.v.iter().zip(atol).map(|(v, atol)| CHANGE * v.abs() + atol);
        let times = known.zip(&rates).map(|(known, rate)| known / rate.abs());
        Ok(times.filter(|time| *time > 0.0 && time.is_finite()).reduce(f64::min))
    }

    /// Returns the factor by which the probe should be longer for forces to change the velocities of the closed
    /// contacts by the intended fraction of their terms: no velocity by much more, and the one with the largest terms
    /// by more than rounding.
    fn pace(
        &self,
        (now, v): &(Constraints, Vec<f64>),
        state: &State,
        closed: &[usize],
        Scales { atol, reached, .. }: Scales<'_>,
    ) -> f64 {
        let gained: Vec<f64> = v.iter().zip(&state.v).map(|(free, before)| free - before).collect();
        let (mut least, mut largest) = (f64::INFINITY, (0.0, 0.0));
        for &k in closed {
            for row in rows(&self.structure, k) {
                let terms = now.terms(row, &state.v);
                let due = (CHANGE * terms).max(ROUNDING * now.size(row, reached)) + now.size(row, atol);
                let change = (self.constraints.velocity(row, v) - now.velocity(row, &state.v)).abs();
                let change = change.max(now.size(row, &gained));
                if due > 0.0 && change > 0.0 {
                    least = least.min(due / change);
                    if terms > largest.0 {
                        largest = (terms, due / change);
                    }
                }
            }
        }
        if least.is_finite() { least.max((largest.1 / TOO_SHORT).min(1.0)) } else { 1.0 }
    }

    /// Returns the current constraints, and the velocities after a step without contacts. Leaves constraints and
    /// factors evaluated at the end of that step.
    fn free_motion(&mut self, state: &State, h: f64) -> Result<(Constraints, Vec<f64>), ContactError> {
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
        Ok((now, v))
    }

    /// Applies the contact law to the end velocities of the free motion of a probe step.
    fn touch_free(
        &mut self,
        state: &State,
        h: f64,
        (now, v): (Constraints, Vec<f64>),
        (closed, reached): (&[usize], &[f64]),
        control: &Control,
    ) -> Result<Option<Vec<Probed>>, ContactError> {
        let lost = ContactError::Singular { t: state.t };
        // The normal velocity of a contact at rest may be unchanged although forces change the velocities of both its
        // bodies, as in a stack: compare with the changes of the velocities of both.
        let gained: Vec<f64> = v.iter().zip(&state.v).map(|(free, before)| free - before).collect();
        let rounding_of_row = |row: usize| ROUNDING * now.terms(row, reached);
        let parts = |&k: &usize| {
            let row = self.structure.normal(k);
            let (before, free) = (now.velocity(row, &state.v), self.constraints.velocity(row, &v));
            let apart = now.size(row, &gained);
            let rounding = rounding_of_row(row).max(self.open_velocity(row));
            before > (SMALL * (free - before).abs().max(apart)).max(rounding)
        };
        let contacts: Vec<usize> = closed.iter().copied().filter(|k| !parts(k)).collect();
        if contacts.is_empty() {
            return Ok(Some(Vec::new()));
        }
        let mut near =
            ActiveContacts::new(&self.structure, &self.constraints, &mut self.delassus, &contacts).ok_or(lost)?;
        self.factorised = None;
        let before = near.velocities(&self.structure, &now, &state.v);
        let mut free = near.velocities(&self.structure, &self.constraints, &v);
        // The normal velocity of a contact at rest is rounding: keep only its change by forces.
        for ((free, before), &k) in free.iter_mut().zip(&before).zip(&contacts) {
            if before.x.abs() <= rounding_of_row(self.structure.normal(k)) {
                free.x -= before.x;
            }
        }
        let rounding = self.rounding_of_slips(&contacts, reached, &before, &free);
        // Before the contact law, the slip of a sticking contact is rounding: set it to zero.
        let at_rest = |(u, least): (&Vector3<f64>, &f64)| {
            if u.y.hypot(u.z) > *least { *u } else { Vector3::new(u.x, 0.0, 0.0) }
        };
        let slips: Vec<Vector3<f64>> = before.iter().zip(&rounding).map(at_rest).collect();
        near.set_friction(self.coefficients(state, &contacts, &slips)?);
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
        let after = law.after(&r);
        let probed = |i: usize| Probed {
            contact: contacts[i],
            r: r[i],
            before: before[i],
            free: free[i],
            after: after[i],
            rounding: rounding[i],
            change: near.change(i, &(free[i] - before[i]), &r[i]),
            mu: near.friction()[i],
            residual: report.residual,
        };
        Ok(Some((0..contacts.len()).map(probed).collect()))
    }

    /// Returns the share of a slip of contact `k` in `direction`, squared and in the metric of `M`, that remains
    /// after projection onto the `held` rows of `J`: 1 if the rows do not affect the slip, 0 if they determine it.
    pub(crate) fn freedom(&mut self, k: usize, direction: &Vector2<f64>, held: &[usize]) -> f64 {
        let mut row = vec![0.0; self.structure.coordinates];
        for (tangent, share) in self.structure.tangents(k).zip(direction.iter()) {
            row.iter_mut().zip(self.constraints.row(tangent)).for_each(|(row, j)| *row += share * j);
        }
        let mut response = row.clone();
        if !self.delassus.solve(&mut response) {
            return 0.0;
        }
        let whole = dot(&row, &response);
        let off: Vec<f64> = held.iter().map(|&held| dot(self.constraints.row(held), &response)).collect();
        let is_left = self.delassus.remove(&self.constraints, held, &off, &mut response);
        if is_left && whole > 0.0 { dot(&row, &response) / whole } else { 0.0 }
    }

    /// Returns the size of the terms of the slip of contact `k` at velocities `v`; infinite for a contact without
    /// friction.
    pub(crate) fn size_of_slip(&self, k: usize, v: &[f64]) -> f64 {
        self.structure.tangents(k).map(|row| self.constraints.terms(row, v)).reduce(f64::max).unwrap_or(f64::INFINITY)
    }

    /// Returns the speeds below which slips count as rest: rounding of their terms, a small fraction of their
    /// tolerance, or a small fraction of their change by forces within the step.
    pub(super) fn rounding_of_slips(
        &self,
        contacts: &[usize],
        v: &[f64],
        before: &[Vector3<f64>],
        free: &[Vector3<f64>],
    ) -> Vec<f64> {
        let changes = before.iter().zip(free).map(|(before, free)| SMALL * (free - before).norm());
        let rounding = |k: usize| (ROUNDING * self.size_of_slip(k, v)).max(self.open_slip(k));
        contacts.iter().zip(changes).map(|(&k, change)| change.max(rounding(k))).collect()
    }
}
