//! Event-driven steps of second order, in which impacts are located in time.
//!
//! A step is a sequence of smooth arcs. Contacts that are closed at the beginning of an arc, and neither approach nor
//! separate, are sustained contacts: they [stay closed](self::lasting) throughout the arc. All other contacts are
//! open, and the arc ends when the first of them [closes](self::closing), or when the force of a sustained contact
//! jumps: because it opens, or because its slip velocity passes through zero. When contacts close, the impact law is
//! [applied](self::strike) to all closed contacts at once. Bodies without a sustained contact move freely over the
//! length `s` of the arc,
//!
//! ```text
//! v' = v + s g/2,    q+ = q (+) s v',    v+ = v' + s g/2
//! ```
//!
//! which is exact for the centre of mass, and of second order for the rotation.
//!
//! Impacts of a contact may accumulate (Zeno). A ball that rebounds with velocity `e v`, where `e` is its
//! restitution, bounces for the time `2 e v / (1 - e) / g`. If an approach velocity `v` is so small that this time is
//! at most `h^2 sqrt(g/d)`, for a step size `h` and a body of size `d`, the impact is treated without restitution, so
//! that the contact is sustained afterwards: the bounces that are left out would be over within a time of order
//! `h^2`. Bodies that collide in free motion are not pressed together by their weight, and rebound at any approach
//! velocity. With restitution 1 impacts do not accumulate, and only approach velocities within rounding are treated
//! without restitution. Where impacts accumulate between several bodies, their number in a step is limited, and time
//! stepping takes over for the rest of the step. A run that may choose its method [switches](self::budget) to time
//! stepping for many steps if there are too many arcs.

mod budget;
mod closing;
mod impact;
mod lasting;
mod strike;
mod transition;

use self::budget::Budget;
pub use self::impact::Impact;
use super::super::contact::Contact;
use super::super::motion::Motion;
use super::super::touches::rounding;
use super::{HALVINGS, MoreauStepping, StepFailure};
use nalgebra::{Isometry3, Vector3};
use problem::Control;
use rustc_hash::FxHashSet;

/// The number of smooth arcs in a step, per step and per moving body, beyond which time stepping takes over for the
/// rest of the step: a step does not resolve bodies that collide more often. The first number lets a single ball
/// bounce until it rests.
const ARCS: [usize; 2] = [64, 8];

/// Maximum product of the number of smooth arcs in a step and the number of moving bodies: the states of bodies at both
/// ends of the arcs are kept until the next step, in about 10 MB.
const KEPT: usize = 1 << 14;

/// Relative rounding error of velocities: those below this fraction of the velocity change by gravity in a step are
/// treated as zero.
const ROUNDING: f64 = 1e-9;

/// The identity of a contact: the indices of both bodies and the identity number of the contact point.
type Key = (u32, u32, u64);

/// A smooth arc: a part of a step between two impacts or transitions of contacts.
#[derive(Clone, Debug)]
pub struct Arc {
    /// The times at the beginning and the end of the smooth arc, relative to the beginning of the step.
    pub times: [f64; 2],
    /// The moving bodies at the beginning of the smooth arc, after the impacts at that time.
    starts: Vec<Motion>,
    /// The moving bodies at the end of the smooth arc, before the impacts at that time.
    ends: Vec<Motion>,
    /// For each moving body, whether it has sustained contacts in the smooth arc; otherwise it moves freely.
    held: Vec<bool>,
    /// The work of contacts from the beginning of the step to both ends of the smooth arc, by normal and tangential
    /// components.
    work: [[f64; 2]; 2],
    /// Whether all bodies move with constant accelerations, so that the smooth arc is exact up to rounding.
    pub is_exact: bool,
}

impl Arc {
    /// Returns the moving bodies at a time within the smooth arc, relative to the beginning of the step.
    pub fn at(&self, passed: f64, gravity: &Vector3<f64>) -> Vec<Motion> {
        let [from, to] = self.times;
        let (s, d) = (to - from, passed - from);
        let of = |((start, end), is_held): ((&Motion, &Motion), &bool)| match (d < s, is_held) {
            (false, _) => *end,
            (true, true) => start.between(end, s, d),
            (true, false) => start.flown(d, gravity),
        };
        self.starts.iter().zip(&self.ends).zip(&self.held).map(of).collect()
    }

    /// Returns the work of contacts from the beginning of the step to a time within the smooth arc, by normal and
    /// tangential components.
    pub fn work_at(&self, passed: f64) -> [f64; 2] {
        let [from, to] = self.times;
        let part = if to > from { ((passed - from) / (to - from)).min(1.0) } else { 1.0 };
        let [before, after] = self.work;
        [0, 1].map(|k| before[k] + part * (after[k] - before[k]))
    }
}

/// The state of the event-driven integration that is carried from one smooth arc to the next.
#[derive(Debug, Default)]
pub(super) struct Located {
    /// The identities of the sustained contacts, which stay closed in the smooth arc.
    lasting: FxHashSet<Key>,
    /// The identities of the sustained contacts that stick. Their velocities at the beginning of a smooth arc belong to
    /// an extrapolated pose, and have errors of second order, which do not count as slip.
    sticking: FxHashSet<Key>,
    /// The identities of the contacts that opened at the end of the last smooth arc.
    leaving: FxHashSet<Key>,
    /// The time at the beginning of the last smooth arc, and the pairs of bodies with a contact that opened at that
    /// time.
    opened: (f64, Vec<(u32, u32)>),
    /// Whether the first step of the simulation has begun.
    has_begun: bool,
    /// The time at the beginning of the step, and (in `step`) the length of the step.
    begin: f64,
    step: f64,
    /// The poses of the bodies with prescribed motion at the beginning of the step.
    grounds: Vec<Isometry3<f64>>,
    /// The smooth arcs of the last step.
    arcs: Vec<Arc>,
    /// The impacts of the last step; `None` if they are not recorded for comparison with another run.
    impacts: Option<Vec<Impact>>,
    /// For each moving body, whether contacts acted on it in the last step.
    touched: Vec<bool>,
    /// Whether time stepping took over from event-driven integration for the rest of the last step.
    is_passed: bool,
    /// The budget of smooth arcs that the run may still make; `None` if impacts are located at any cost.
    budget: Option<Budget>,
}

impl Located {
    /// Returns whether a contact is sustained, so that it stays closed in the smooth arc.
    pub fn lasts(&self, contact: &Contact) -> bool {
        self.lasting.contains(&contact.key)
    }
}

impl MoreauStepping<'_> {
    /// Switches to event-driven steps, which locate impacts in time. The multibody system must have no joints, no
    /// forces besides gravity, and no contact patches.
    ///
    /// If the step size of the run is given as `unless_many`, time stepping takes over where it is faster because of
    /// many impacts.
    pub fn locate_impacts(&mut self, unless_many: Option<f64>) {
        let budget = unless_many.map(|step| Budget::new(step, self.moving.len()));
        self.located = Some(Box::new(Located { budget, ..Located::default() }));
    }

    /// Returns the smooth arcs of the last step; empty for time stepping.
    pub fn arcs(&self) -> &[Arc] {
        self.located.as_ref().map_or(&[], |located| &located.arcs)
    }

    /// Returns, for each moving body, whether contacts acted on it in the last step.
    pub fn touched(&self) -> &[bool] {
        self.located.as_ref().map_or(&self.pushed, |located| &located.touched)
    }

    /// Returns whether the last step was event-driven at first, and time stepping took over for its rest.
    pub fn is_passed(&self) -> bool {
        self.located.as_ref().is_some_and(|located| located.is_passed)
    }

    /// Returns the part of the last step, of length `h` from the states `starts` on, that was made by time stepping:
    /// the moving bodies at its beginning, and its length; `None` if there is none.
    pub(super) fn time_stepped<'a>(&'a self, starts: &'a [Motion], h: f64) -> Option<(&'a [Motion], f64)> {
        let Some(located) = &self.located else { return Some((starts, h)) };
        let arc = located.arcs.last().filter(|_| located.is_passed)?;
        Some((&arc.starts, arc.times[1] - arc.times[0]))
    }

    /// Makes an event-driven step of length `h`, in which impacts are located in time.
    pub(super) fn advance_located(
        &mut self,
        located: &mut Located,
        h: f64,
        control: &Control,
    ) -> Result<(), StepFailure> {
        (located.begin, located.step, located.is_passed) = (self.t, h, false);
        located.grounds.clear();
        located.grounds.extend(self.prescribed.iter().map(|prescribed| prescribed.pose));
        self.begin(located);
        let end = self.t + h;
        let most = match &mut located.budget {
            Some(budget) => budget.most(h).min(self.most_arcs()),
            None => self.most_arcs(),
        };
        match (most, &located.budget) {
            (0, _) => self.pass(located, h, control)?,
            (_, None) => self.advance_to(located, (end, most), control)?,
            (_, Some(_)) => self.advance_or_pass(located, (end, most), control)?,
        }
        if let Some(budget) = &mut located.budget {
            budget.spend(located.arcs.len(), h, located.is_passed);
        }
        self.t = end;
        self.ground_at(located, end);
        self.ends.clone_from(&self.moving);
        // If time stepping took over for the rest of the step, it has already added its number of parts to the report.
        self.report.parts += u64::from(!located.is_passed);
        Ok(())
    }

    /// Begins an event-driven step: clears the smooth arcs and impacts of the last step, and the marks of bodies on
    /// which contacts acted.
    fn begin(&mut self, located: &mut Located) {
        located.arcs.clear();
        located.impacts.iter_mut().for_each(Vec::clear);
        self.pushed.fill(false);
        located.touched.clear();
        located.touched.resize(self.moving.len(), false);
        self.ground_at(located, located.begin);
    }

    /// Makes an event-driven step to the time `end`, with at most `most` smooth arcs; repeats the whole step by time
    /// stepping if the contact law is not solved in an arc.
    fn advance_or_pass(
        &mut self,
        located: &mut Located,
        (end, most): (f64, usize),
        control: &Control,
    ) -> Result<(), StepFailure> {
        let start = (self.moving.clone(), self.held.clone(), self.touches.clone());
        match self.advance_to(located, (end, most), control) {
            Err(StepFailure::Unsolved { .. }) => {}
            made => return made,
        }
        (self.moving, self.held, self.touches) = start;
        self.t = located.begin;
        self.forget_last_step();
        self.begin(located);
        self.pass(located, end - located.begin, control)
    }

    /// Makes an event-driven step to the time `end`; after `most` smooth arcs, time stepping takes over for the rest of
    /// the step.
    fn advance_to(
        &mut self,
        located: &mut Located,
        (end, most): (f64, usize),
        control: &Control,
    ) -> Result<(), StepFailure> {
        let h = end - self.t;
        self.detect_and_part(h, control)?;
        self.note_kinetic_energy();
        let mut is_detected = located.has_begun;
        if !located.has_begun {
            self.strike(located, control)?;
            located.has_begun = true;
        }
        while self.t < end {
            let rest = end - self.t;
            if located.arcs.len() >= most {
                self.pass(located, rest, control)?;
                break;
            }
            if !is_detected {
                self.detect(rest, control)?;
            }
            is_detected = false;
            self.glide(located, rest, control)?;
            self.strike(located, control)?;
        }
        Ok(())
    }

    fn most_arcs(&self) -> usize {
        let [of_step, of_body] = ARCS;
        let moving = self.moving.len().max(1);
        (of_step + of_body * moving).min(KEPT.div_ceil(moving))
    }

    /// Sets the bodies with prescribed motion to their state at a time within the step.
    fn ground_at(&mut self, located: &Located, t: f64) {
        for (prescribed, from) in self.prescribed.iter_mut().zip(&located.grounds) {
            if let Some(by) = &self.scene.bodies[prescribed.body].motion {
                prescribed.at(by, &self.scene.signals, from, [located.begin, t - located.begin]);
            }
        }
    }

    /// Makes the rest of an event-driven step, of length `rest`, by time stepping.
    fn pass(&mut self, located: &mut Located, rest: f64, control: &Control) -> Result<(), StepFailure> {
        let (starts, before) = (self.moving.clone(), self.report.work);
        let times = [self.t - located.begin, located.step];
        self.advance(rest, HALVINGS, control)?;
        // Replace the bodies' velocities at the middle of the time step by those at its end.
        self.moving.clone_from(&self.ends);
        self.moving.iter_mut().for_each(|motion| motion.lag = 0.0);
        located.lasting.clear();
        located.sticking.clear();
        located.leaving.clear();
        let lasts = |contact: &&Contact| contact.impulse.x > 0.0 && contact.stays_closed();
        located.lasting.extend(self.contacts.iter().filter(lasts).map(|contact| contact.key));
        located.is_passed = true;
        located.has_begun = true;
        self.kept.clear();
        let held = vec![true; starts.len()];
        let work = [before, self.report.work];
        located.touched.iter_mut().zip(&self.pushed).for_each(|(touched, pushed)| *touched |= pushed);
        located.arcs.push(Arc { times, starts, ends: self.moving.clone(), held, work, is_exact: false });
        Ok(())
    }

    /// Returns the approach velocity of a contact below which impacts are treated without restitution: because they
    /// would accumulate within the step, or because the velocity is a rounding error.
    fn least_approach(&self, located: &Located, contact: &Contact) -> f64 {
        let normal = contact.frame.row(0).transpose();
        let gravity = self.scene.gravity.dot(&normal).abs();
        let (fall, e) = (located.step * gravity, contact.law.restitution);
        // Two bodies in free motion have the same acceleration by gravity, which does not bring them together again.
        let flies = |body: Option<u32>| body.is_some_and(|body| !self.held[body as usize]);
        if e == 1.0 || contact.bodies.into_iter().all(flies) {
            return ROUNDING * fall;
        }
        // All bounces of a contact with restitution `e` are over after the time `2 e v / ((1 - e) g)`: within one step
        // for an approach velocity `v` of this size.
        let within_step = fall * ((1.0 - e) / (2.0 * e)).min(1.0);
        // Once a step has made half of its admissible smooth arcs, treat all impacts that would accumulate within the
        // step without restitution.
        if 2 * located.arcs.len() > self.most_arcs() || fall == 0.0 {
            return within_step;
        }
        within_step * (fall / (gravity * contact.size).sqrt()).min(1.0)
    }

    /// Returns the rounding error of the relative velocity at a contact.
    fn rounding(&self, located: &Located, contact: &Contact) -> f64 {
        rounding(contact, &self.moving) + ROUNDING * located.step * self.scene.gravity.norm()
    }

    /// Returns whether the contact points of a pair of bodies appear and vanish as edges and vertices of their surfaces
    /// pass each other.
    fn is_patch(&self, (a, b): (u32, u32)) -> bool {
        let [a, b] = [a, b].map(|body| &self.scene.bodies[body as usize].collider);
        !a.keeps_points_with(b)
    }
}
