//! Times within an arc at which the force of a lasting contact jumps: it opens, its slip passes through zero, or the curvature
//! of its surfaces jumps, as where a ball rolls over an edge. The arc is shortened until it ends there.
//!
//! Up to the transition the slip is smooth, and its zero is found by secants through points before it. A contact that opens
//! has a force until then, and none from there on: there is nothing to interpolate, and the time is bisected.

use super::super::super::contact::Contact;
use super::super::super::touches::rounding;
use super::super::MoreauStepping;
use super::{Key, Located};
use nalgebra::Vector3;

/// Velocities of lasting contacts below this fraction of what the arc, or gravity in the step, changes of them are zero; and
/// the fraction of the arc to which transitions are located. Both leave errors far below those of second order.
const ZERO: f64 = 1e-6;

/// A lasting contact at the beginning of an arc.
#[derive(Clone, Copy, Debug)]
pub(super) struct Begun {
    pub key: Key,
    pub u: Vector3<f64>,
    pub gap: f64,
    pub feature: u32,
}

/// What changes within an arc.
#[derive(Debug, Default)]
pub(super) struct Change {
    /// The contacts that opened.
    pub opened: Vec<Key>,
    /// The least slip at the end, along the slip at the beginning and relative to it: zero if it sticks, negative if the slip
    /// reversed.
    pub slip: f64,
    /// Whether a slip passed through zero.
    stops: bool,
    /// Whether a curvature jumped.
    passes: bool,
    /// Whether all slips that passed through zero are zero at the end.
    sticks: bool,
}

impl Change {
    fn is_any(&self) -> bool {
        self.stops || self.passes || !self.opened.is_empty()
    }
}

/// What to do with an arc that was tried.
#[derive(Debug)]
pub(super) enum Next {
    /// It is the arc.
    Take,
    /// Try this length.
    Try(f64),
    /// These contacts open at its beginning: try without them.
    Without(Vec<Key>),
}

/// The search for the first transition in an arc.
#[derive(Debug)]
pub(super) struct Search {
    /// The length of the whole arc.
    rest: f64,
    /// Lengths with a slip before its zero, relative to that at the beginning; the last two of them.
    slips: [(f64, f64); 2],
    /// The longest length without a transition, the shortest with one, and the contacts that open there.
    low: f64,
    high: Option<f64>,
    opened: Vec<Key>,
    /// Whether there is nothing to interpolate.
    bisects: bool,
    /// The zero of the slip by the last secant.
    predicted: Option<f64>,
}

impl Search {
    pub fn new(rest: f64) -> Self {
        let slips = [(0.0, 1.0); 2];
        Self { rest, slips, low: 0.0, high: None, opened: Vec::new(), bisects: false, predicted: None }
    }

    /// The contacts that open where the arc that is taken ends.
    pub fn leaving(&self) -> &[Key] {
        &self.opened
    }

    /// Judges an arc of length `s`, whose slip in the first stage, at the time `first`, is `slip` relative to that at the
    /// beginning.
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

    /// The next length to try, below `high`; `by` is an estimate of the zero of a slip.
    fn next(&mut self, high: f64, by: Option<f64>) -> Next {
        let within = ZERO * self.rest;
        self.predicted = None;
        if self.bisects {
            // A contact that opens at once is the common case.
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
    /// The lasting contacts at the beginning of an arc, with what detection found of them.
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

    /// What changed of the lasting contacts in an arc of the step, which is at its end.
    pub(super) fn change(&self, located: &Located, begun: &[Begun]) -> Change {
        let mut change = Change { slip: f64::INFINITY, sticks: true, ..Change::default() };
        let zero = |contact: &Contact, change: f64| self.zero(located, contact, change);
        let after = |contact: &Contact| self.velocity_of(contact);
        // Contacts move apart by errors of second order at the beginning of an arc, and by no more while they are pressed
        // together.
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

    /// The contacts that stick at the end of an arc.
    pub(super) fn sticking(&self, located: &Located) -> Vec<Key> {
        let sticks = |contact: &&Contact| {
            let u = self.velocity_of(contact);
            u.y.hypot(u.z) <= self.zero(located, contact, 0.0)
        };
        self.contacts.iter().filter(sticks).map(|contact| contact.key).collect()
    }

    /// The velocity of a contact with the current velocities of the bodies.
    pub(super) fn velocity_of(&self, contact: &Contact) -> Vector3<f64> {
        contact.velocity(|body| (self.moving[body as usize].velocity, self.moving[body as usize].omega))
    }

    /// The velocity of a lasting contact that counts as zero, where the arc changes it by `change`.
    fn zero(&self, located: &Located, contact: &Contact, change: f64) -> f64 {
        let fall = located.step * self.scene.gravity.norm();
        ZERO * (change + fall) + rounding(contact, &self.moving)
    }

    /// The least slip of the lasting contacts along their slip at the beginning of the arc, relative to it. A slip within the errors
    /// of the solution of the law is zero.
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

/// The slip of a rough contact along that of an earlier time, `start`, and relative to it; `None` if there was none.
fn slip_along(contact: &Contact, start: &Vector3<f64>, u: &Vector3<f64>) -> Option<f64> {
    let square = start.y * start.y + start.z * start.z;
    (contact.law.is_rough() && square > 0.0).then(|| (u.y * start.y + u.z * start.z) / square)
}
