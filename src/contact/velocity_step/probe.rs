//! A step that is no part of the trajectory: what contacts would do next.

use super::{State, VelocityStep};
use crate::active_contacts::{ActiveContacts, rows};
use crate::settings::ContactError;
use nalgebra::Vector3;
use problem::{Constraints, Control};
use vi::Outcome;

/// A velocity this small beside its terms, or beside its change within a step, is none.
const ROUNDING: f64 = 1e-11;
const SMALL: f64 = 1e-6;

/// The part of the terms of velocities by which forces change them in a probe: small enough that only directions count,
/// and far above rounding.
const CHANGE: f64 = 1e-7;

/// A probe whose change is smaller or larger than that by more than these factors is made again: rounding and directions
/// leave that much. Forces that hardly vary take one more probe, so that this many are made where none was too long.
const TOO_SHORT: f64 = 100.0;
const TOO_LONG: f64 = 1e3;
const ATTEMPTS: usize = 3;

/// Probes in all, where one is too short and one too long, as with forces that rise as a high power of time. Each that follows
/// halves the logarithm of the ratio of both: eleven tell apart lengths by a factor of two over all that doubles hold.
const MOST_ATTEMPTS: usize = ATTEMPTS + 11;

/// A probe is at least as long as this multiple of what the clock tells apart.
const TICKS: f64 = 1e4;

/// What the law makes of a contact in a step that is no part of the trajectory.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Probed {
    /// Which it is.
    pub contact: usize,
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
    /// The size of what forces and its own impulse add to `u`.
    pub change: f64,
}

/// The longest probe that was too short and the shortest that was too long.
#[derive(Default)]
struct Lengths {
    short: Option<f64>,
    long: Option<f64>,
}

impl Lengths {
    /// The length to try after `h`, by the factor that it was found to be off by; not beyond the time `left`.
    fn after(&mut self, h: f64, factor: f64, left: f64) -> f64 {
        let side = if factor < 1.0 { &mut self.long } else { &mut self.short };
        *side = Some(h);
        let next = factor * h;
        match (self.short, self.long) {
            (Some(short), Some(long)) if next <= short || long <= next => short.sqrt() * long.sqrt(),
            _ => next.min(left.max(h)),
        }
    }

    /// How many probes are made at most.
    fn attempts(&self) -> usize {
        if self.short.is_some() && self.long.is_some() { MOST_ATTEMPTS } else { ATTEMPTS }
    }
}

impl VelocityStep<'_> {
    /// What the law makes of contacts that are closed and do not part, without restitution, in a step so short that only
    /// directions count, and the length of the step; the place is that where free motion leads, so that curved ways count
    /// too. `None` where friction drives a contact into what it slides on. Velocities are known to `atol`; where nothing tells
    /// how long a step is short, it is a part of the time `left`, beyond which no probe is made longer.
    ///
    /// # Errors
    /// See [`VelocityStep::advance`].
    pub fn probe(
        &mut self,
        state: &State,
        (atol, left): (&[f64], f64),
        closed: &[usize],
        control: &Control,
    ) -> Result<Option<(f64, Vec<Probed>)>, ContactError> {
        let mut h = match self.instant {
            Some(h) => h,
            None => self.first_instant(state, atol)?.filter(|h| *h <= left).unwrap_or(CHANGE * left),
        };
        let clock = if self.structure.depends_on_time { self.problem.rounding_of_time(state.t) } else { 0.0 };
        let ticks = TICKS * clock;
        let (mut lengths, mut attempt) = (Lengths::default(), 1);
        let (now, v) = loop {
            h = h.max(ticks);
            let free = match self.free_motion(state, h) {
                // Forces need not be defined as far ahead as a longer probe goes.
                Err(_) if lengths.short.is_some() && attempt < MOST_ATTEMPTS => None,
                free => Some(free?),
            };
            let factor = free.as_ref().map_or(0.0, |free| self.pace(free, state, closed, atol));
            let fits = (factor * TOO_LONG >= 1.0 && factor <= TOO_SHORT) || (factor < 1.0 && h <= ticks);
            let next = lengths.after(h, factor, left);
            match free {
                Some(free) if fits || attempt >= lengths.attempts() || next == h => break free,
                _ => (h, attempt) = (next, attempt + 1),
            }
        };
        self.instant = Some(h);
        Ok(self.touch_free(state, h, (now, v), closed, control)?.map(|probed| (h, probed)))
    }

    /// A first guess at the length of a probe: forces change no velocity by more than it is known to.
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

    /// The factor by which a probe would have to be longer for forces to change the velocities of these contacts by the part
    /// of their terms that it should: none by much more, and that with the largest terms by more than rounding.
    fn pace(&self, (now, v): &(Constraints, Vec<f64>), state: &State, closed: &[usize], atol: &[f64]) -> f64 {
        let gained: Vec<f64> = v.iter().zip(&state.v).map(|(free, before)| free - before).collect();
        let (mut least, mut largest) = (f64::INFINITY, (0.0, 0.0));
        for &k in closed {
            for row in rows(&self.structure, k) {
                let terms = now.terms(row, &state.v);
                let due = CHANGE * terms + now.size(row, atol);
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

    /// The constraints now, and velocities after a step without contacts; constraints and factors are left at the place
    /// where that leads.
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

    /// What the law makes of contacts behind free motion.
    fn touch_free(
        &mut self,
        state: &State,
        h: f64,
        (now, v): (Constraints, Vec<f64>),
        closed: &[usize],
        control: &Control,
    ) -> Result<Option<Vec<Probed>>, ContactError> {
        let lost = ContactError::Singular { t: state.t };
        // What forces make of both sides of a contact may be the same, at rest in a stack.
        let gained: Vec<f64> = v.iter().zip(&state.v).map(|(free, before)| free - before).collect();
        let parts = |&k: &usize| {
            let row = self.structure.normal(k);
            let (before, free) = (now.velocity(row, &state.v), self.constraints.velocity(row, &v));
            let apart = now.size(row, &gained);
            let rounding = (ROUNDING * now.terms(row, &state.v)).max(self.open_velocity(row));
            before > (SMALL * (free - before).abs().max(apart)).max(rounding)
        };
        let contacts: Vec<usize> = closed.iter().copied().filter(|k| !parts(k)).collect();
        if contacts.is_empty() {
            return Ok(Some(Vec::new()));
        }
        let near =
            ActiveContacts::new(&self.structure, &self.constraints, &mut self.delassus, &contacts).ok_or(lost)?;
        self.factorised = None;
        let before = near.velocities(&self.structure, &now, &state.v);
        let free = near.velocities(&self.structure, &self.constraints, &v);
        let rounding = self.rounding_of_slips(&contacts, &state.v, &before, &free);
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
            contact: contacts[i],
            r: r[i],
            before: before[i],
            free: free[i],
            after: law.after(i, &r),
            rounding: rounding[i],
            change: near.change(i, &(free[i] - before[i]), &r[i]),
        };
        Ok(Some((0..contacts.len()).map(probed).collect()))
    }

    /// The size of the terms that a slip of contact `k` is the sum of, at velocities `v`; infinite without friction.
    pub(crate) fn size_of_slip(&self, k: usize, v: &[f64]) -> f64 {
        self.structure.tangents(k).map(|row| self.constraints.terms(row, v)).reduce(f64::max).unwrap_or(f64::INFINITY)
    }

    /// The sizes below which slips count as rest: rounding of their terms, far below what tolerances leave open, and small
    /// beside the change by forces within the step.
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
