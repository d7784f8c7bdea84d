//! Times within a smooth arc at which the force of a sustained contact jumps: because it opens, because its slip
//! passes through zero, or because the curvature of its surfaces jumps, as where a ball rolls over an edge. The arc
//! is shortened until it ends at the jump.
//!
//! Until the transition the slip is smooth, and its zero is found by secants through points before it. A contact that
//! opens has a force until then, and none afterwards, so that there is nothing to interpolate, and the time is
//! bisected.

use super::super::super::contact::Contact;
use super::super::super::touches::rounding;
use super::super::MoreauStepping;
use super::{Key, Located};
use nalgebra::Vector3;

/// Relative tolerance of transitions: velocities of sustained contacts below this fraction of their change in the
/// smooth arc, or of the velocity change by gravity in the step, are treated as zero, and transitions are located to
/// this fraction of the arc. The resulting errors are far below those of second order.
const ZERO: f64 = 1e-6;

/// The state of a sustained contact at the beginning of a smooth arc.
#[derive(Clone, Copy, Debug)]
pub(super) struct Begun {
    pub key: Key,
    pub u: Vector3<f64>,
    pub gap: f64,
    pub feature: u32,
}

/// The transitions (opening, end of slip, jump of curvature) of sustained contacts within a smooth arc.
#[derive(Debug, Default)]
pub(super) struct Change {
    /// The identities of the sustained contacts that opened within the smooth arc.
    pub opened: Vec<Key>,
    /// The least slip of the sustained contacts at the end of the smooth arc, along their slip at the beginning and
    /// relative to it: zero if the contact sticks, negative if the slip reversed.
    pub slip: f64,
    /// Whether the slip of a sustained contact passed through zero.
    stops: bool,
    /// Whether the curvature of the surfaces at a sustained contact jumped.
    passes: bool,
    /// Whether all contact slips that passed through zero within the smooth arc are zero at its end.
    sticks: bool,
}

impl Change {
    fn is_any(&self) -> bool {
        self.stops || self.passes || !self.opened.is_empty()
    }
}

/// The decision after a smooth arc of some length has been tried.
#[derive(Debug)]
pub(super) enum Next {
    /// Accept the smooth arc that was tried.
    Take,
    /// Reject the smooth arc that was tried, and try one of this length.
    Try(f64),
    /// Try a smooth arc without these contacts, which open at its beginning.
    Without(Vec<Key>),
}

/// The search for the first transition of sustained contacts in a smooth arc.
#[derive(Debug)]
pub(super) struct Search {
    /// The length of the longest smooth arc, to the end of the step or to the first contact that closes.
    rest: f64,
    /// The last two lengths tried of the smooth arc before the zero of the slip, each with the slip at its end relative
    /// to that at the beginning.
    slips: [(f64, f64); 2],
    /// The longest smooth arc known to have no transition, the shortest arc with one (`high`), and the contacts that
    /// open in the latter (`opened`).
    low: f64,
    high: Option<f64>,
    opened: Vec<Key>,
    /// Whether the time of the transition is located by bisection, since there is no slip to interpolate.
    bisects: bool,
    /// The length of the smooth arc at which the last secant predicts zero slip of a contact.
    predicted: Option<f64>,
}

impl Search {
    pub fn new(rest: f64) -> Self {
        let slips = [(0.0, 1.0); 2];
        Self { rest, slips, low: 0.0, high: None, opened: Vec::new(), bisects: false, predicted: None }
    }

    /// Returns the identities of the sustained contacts that open at the end of the accepted smooth arc.
    pub fn leaving(&self) -> &[Key] {
        &self.opened
    }

    /// Decides what to do after a smooth arc of length `s` with the transitions `change`; `slip` is the least slip in
    /// the first stage of the arc, at the time `first`, relative to that at the beginning.
    pub fn judge(&mut self, s: f64, change: Change, (first, slip): (f64, f64)) -> Next {
        let within = ZERO * self.rest;
        if !change.is_any() {
            self.low = s;
            if change.slip < self.slips[1].1 {
                self.slips = [self.slips[1], (s, change.slip)];
            }
            return match self.high {
                Some(high) if high - s > within => self.next(high, None),
                _ => Next::Take,
            };
        }
        let is_zero = |zero: f64| !change.passes && s <= zero + within;
        let is_located = s - self.low <= within || self.predicted.is_some_and(is_zero);
        if change.opened.is_empty() && change.sticks && is_located {
            self.opened.clear();
            return Next::Take;
        }
        self.bisects = change.passes || !change.opened.is_empty();
        (self.high, self.opened) = (Some(s), change.opened);
        if s - self.low > within {
            let has_none_yet = !self.bisects && self.slips[1].0 == 0.0;
            return match (has_none_yet, slip <= 0.0, change.slip < 0.0) {
                (true, true, _) => {
                    self.predicted = None;
                    Next::Try(first)
                }
                (true, false, _) if slip < 1.0 => self.next(s, Some(first / (1.0 - slip))),
                (true, _, true) => self.next(s, Some(s / (1.0 - change.slip))),
                _ => self.next(s, None),
            };
        }
        if self.low > 0.0 {
            return Next::Try(self.low);
        }
        if self.opened.is_empty() { Next::Take } else { Next::Without(std::mem::take(&mut self.opened)) }
    }

    /// Returns the next length of the smooth arc to try, below `high`; `by` is an estimate of the length at which a
    /// slip is zero.
    fn next(&mut self, high: f64, by: Option<f64>) -> Next {
        let within = ZERO * self.rest;
        self.predicted = None;
        if self.bisects {
            // If contacts open, try a very short arc first, since most contacts that open do so at the beginning of a
            // smooth arc.
            let at_once = self.low == 0.0 && !self.opened.is_empty();
            return Next::Try(if at_once { 0.5 * within } else { 0.5 * (self.low + high) });
        }
        let [(s0, r0), (s1, r1)] = self.slips;
        let secant = (s1 > s0 && r0 > r1).then(|| s1 + r1 * (s1 - s0) / (r0 - r1));
        match secant.or(by).filter(|zero| *zero > self.low && *zero < high) {
            Some(zero) => {
                self.predicted = Some(zero);
                Next::Try(zero)
            }
            None => Next::Try(0.5 * (self.low + high)),
        }
    }
}

impl MoreauStepping<'_> {
    /// Returns the sustained contacts at the beginning of a smooth arc, with the gaps and velocities that contact
    /// detection found.
    pub(super) fn begun(&self, located: &Located) -> Vec<Begun> {
        let lasts = |contact: &&Contact| located.lasting.contains(&contact.key);
        let begun = |contact: &Contact| {
            let mut u = contact.before;
            if located.sticking.contains(&contact.key) {
                (u.y, u.z) = (0.0, 0.0);
            }
            Begun { key: contact.key, u, gap: contact.gap, feature: contact.feature }
        };
        self.contacts.iter().filter(lasts).map(begun).collect()
    }

    /// Returns the transitions of the sustained contacts in a smooth arc; `self` contains the bodies at the end of the
    /// arc.
    pub(super) fn change(&self, located: &Located, begun: &[Begun]) -> Change {
        let mut change = Change { slip: f64::INFINITY, sticks: true, ..Change::default() };
        let zero = |contact: &Contact, change: f64| self.zero(located, contact, change);
        let after = |contact: &Contact| self.velocity_of(contact);
        // The velocity at which a sustained contact separates at the beginning of a smooth arc is an error of second
        // order, and does not grow while the contact is pressed together.
        let is_open = |contact: &Contact, start: f64| {
            let u = after(contact);
            contact.impulse.x <= 0.0 && u.x > start.max(0.0) + zero(contact, (u.x - start).abs())
        };
        for start in begun {
            let Some(contact) = self.contacts.iter().find(|contact| contact.key == start.key) else {
                let pair = (start.key.0, start.key.1);
                let of_pair = |contact: &&Contact| (contact.key.0, contact.key.1) == pair;
                if !(self.is_patch(pair)
                    && self.contacts.iter().filter(of_pair).any(|contact| !is_open(contact, start.u.x)))
                {
                    change.opened.push(start.key);
                }
                continue;
            };
            if is_open(contact, start.u.x) {
                change.opened.push(start.key);
                continue;
            }
            change.passes |= contact.feature != start.feature;
            let Some(slip) = slip_along(contact, &start.u, &after(contact)) else { continue };
            let speed = start.u.y.hypot(start.u.z);
            let zero = zero(contact, (slip - 1.0).abs() * speed);
            if speed <= zero {
                continue;
            }
            change.slip = change.slip.min(slip);
            if slip * speed <= zero {
                change.stops = true;
                let u = after(contact);
                change.sticks &= u.y.hypot(u.z) <= zero;
            }
        }
        change
    }

    /// Returns the identities of the sustained contacts that stick at the end of a smooth arc.
    pub(super) fn sticking(&self, located: &Located) -> Vec<Key> {
        let sticks = |contact: &&Contact| {
            let u = self.velocity_of(contact);
            u.y.hypot(u.z) <= self.zero(located, contact, 0.0)
        };
        self.contacts.iter().filter(sticks).map(|contact| contact.key).collect()
    }

    /// Returns the relative velocity at a contact for the current velocities of the bodies.
    pub(super) fn velocity_of(&self, contact: &Contact) -> Vector3<f64> {
        contact.velocity(|body| (self.moving[body as usize].velocity, self.moving[body as usize].omega))
    }

    /// Returns the velocity below which the relative velocity of a sustained contact is treated as zero, if the smooth
    /// arc changes it by `change`.
    fn zero(&self, located: &Located, contact: &Contact, change: f64) -> f64 {
        let fall = located.step * self.scene.gravity.norm();
        ZERO * (change + fall) + rounding(contact, &self.moving)
    }

    /// Returns the least slip of the sustained contacts along their slip at the beginning of the smooth arc, relative
    /// to the latter. A slip within the error of the solution of the contact law is returned as zero.
    pub(super) fn least_slip(&self, located: &Located, begun: &[Begun]) -> f64 {
        let slip = |start: &Begun| {
            let contact = self.contacts.iter().find(|contact| contact.key == start.key)?;
            let slip = slip_along(contact, &start.u, &self.velocity_of(contact))?;
            let speed = start.u.y.hypot(start.u.z);
            let is_zero = (slip * speed).abs() <= self.zero(located, contact, (slip - 1.0).abs() * speed);
            Some(if is_zero { 0.0 } else { slip })
        };
        begun.iter().filter_map(slip).fold(f64::INFINITY, f64::min)
    }
}

/// Returns the slip of a frictional contact along its slip velocity `start` at an earlier time, relative to `start`;
/// `None` if `start` is zero or the contact is frictionless.
fn slip_along(contact: &Contact, start: &Vector3<f64>, u: &Vector3<f64>) -> Option<f64> {
    let square = start.y * start.y + start.z * start.z;
    (contact.law.is_rough() && square > 0.0).then(|| (u.y * start.y + u.z * start.z) / square)
}
