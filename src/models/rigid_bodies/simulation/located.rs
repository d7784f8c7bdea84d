//! Steps whose impacts are located in time, of second order.
//!
//! A step is a sequence of arcs. Contacts that are closed at the beginning of an arc, and neither approach nor part, are
//! lasting: they [stay closed](self::lasting) throughout it. All other contacts are open, and the arc ends where the first of
//! them [closes](self::closing), or where the force of a lasting contact jumps: where it opens, or its slip passes through
//! zero. Where contacts close, the law of impact [acts](self::strike) at once on all contacts that are closed. Bodies without a
//! lasting contact fly,
//!
//! ```text
//! v' = v + s g/2,    q+ = q (+) s v',    v+ = v' + s g/2
//! ```
//!
//! which is exact for the centre of mass, and of second order for the rotation.
//!
//! Impacts of a contact may accumulate (Zeno). A ball that returns with velocity `e v` bounces on for the time
//! `2 e v / (1 - e) / g`. An approach `v` after which that is at most `h^2 sqrt(g/d)`, for a step `h` and a body of size `d`, is
//! ended without restitution, so that the contact lasts from there on: the bounces that are left out are over within a time of
//! order `h^2`. Bodies that meet in flight are not pressed together by their weight, and bounce whatever their approach. With
//! restitution 1 impacts do not accumulate, and only rounding is ended so. Where impacts accumulate between several bodies, their
//! number in a step is limited, and time stepping takes the rest of the step. A run that is free to choose [changes over](self::budget) to time stepping for many steps, where arcs are too many.

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

/// The number of arcs in a step, and for each moving body, beyond which time stepping takes the rest of the step: bodies that
/// meet others so often within one step are not resolved by it. The first lets a single ball bounce until it rests.
const ARCS: [usize; 2] = [64, 8];

/// Limit on the arcs of a step times the number of moving bodies: their states are kept until the next step, in some 10 MB.
const KEPT: usize = 1 << 14;

/// Velocities below this fraction of what gravity adds in the step are rounding.
const ROUNDING: f64 = 1e-9;

/// The identity of a contact.
type Key = (u32, u32, u64);

/// Part of a step between impacts.
#[derive(Clone, Debug)]
pub struct Arc {
    /// The times of its beginning and its end, from the beginning of the step on.
    pub times: [f64; 2],
    /// The moving bodies at its beginning, after the impacts there.
    starts: Vec<Motion>,
    /// The moving bodies at its end, before the impacts there.
    ends: Vec<Motion>,
    /// For each moving body, whether it has contacts; else it flies.
    held: Vec<bool>,
    /// The work of contacts from the beginning of the step to both times, by normal and tangential components.
    work: [[f64; 2]; 2],
    /// Whether all bodies move evenly, so that the arc has no error but rounding.
    pub is_exact: bool,
}

impl Arc {
    /// The moving bodies at a time within the arc, from the beginning of the step on.
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

    /// The work of contacts from the beginning of the step to a time within the arc, by normal and tangential components.
    pub fn work_at(&self, passed: f64) -> [f64; 2] {
        let [from, to] = self.times;
        let part = if to > from { ((passed - from) / (to - from)).min(1.0) } else { 1.0 };
        let [before, after] = self.work;
        [0, 1].map(|k| before[k] + part * (after[k] - before[k]))
    }
}

/// What located impacts keep from arc to arc.
#[derive(Debug, Default)]
pub(super) struct Located {
    /// The contacts that last.
    lasting: FxHashSet<Key>,
    /// The contacts of `lasting` that stick. Their velocities at the beginning of an arc are those of an extrapolated pose, and
    /// have errors of second order, which are no slip.
    sticking: FxHashSet<Key>,
    /// The contacts whose force ended with the last arc.
    leaving: FxHashSet<Key>,
    /// The pairs of bodies with a contact that opened where the last arc began, and that time.
    opened: (f64, Vec<(u32, u32)>),
    /// Whether the first step has begun.
    has_begun: bool,
    /// The time at the beginning of the step, and the length of the step.
    begin: f64,
    step: f64,
    /// The bodies with prescribed motion at the beginning of the step.
    grounds: Vec<Isometry3<f64>>,
    /// The arcs of the last step.
    arcs: Vec<Arc>,
    /// Its impacts; `None` if they are not recorded.
    impacts: Option<Vec<Impact>>,
    /// For each moving body, whether contacts acted on it in the last step.
    touched: Vec<bool>,
    /// Whether time stepping took the rest of the last step.
    is_passed: bool,
    /// The number of arcs that may be made; `None` if impacts are located at any cost.
    budget: Option<Budget>,
}

impl Located {
    /// Whether a contact lasts.
    pub fn lasts(&self, contact: &Contact) -> bool {
        self.lasting.contains(&contact.key)
    }
}

impl MoreauStepping<'_> {
    /// Lets impacts be located. The multibody system must have no joints, no forces besides gravity, and no patches.
    ///
    /// With a length of a step, time stepping takes over where impacts are so many that steps of this length are made faster by it.
    pub fn locate_impacts(&mut self, unless_many: Option<f64>) {
        let budget = unless_many.map(|step| Budget::new(step, self.moving.len()));
        self.located = Some(Box::new(Located { budget, ..Located::default() }));
    }

    /// The arcs of the last step, if impacts are located.
    pub fn arcs(&self) -> &[Arc] {
        self.located.as_ref().map_or(&[], |located| &located.arcs)
    }

    /// For each moving body, whether contacts acted on it in the last step.
    pub fn touched(&self) -> &[bool] {
        self.located.as_ref().map_or(&self.pushed, |located| &located.touched)
    }

    /// Whether impacts of the last step are located, and time stepping took its rest.
    pub fn is_passed(&self) -> bool {
        self.located.as_ref().is_some_and(|located| located.is_passed)
    }

    /// The moving bodies at the beginning of the part of the last step, of length `h` from `starts` on, that time stepping made, and
    /// the length of that part; `None` if there is none.
    pub(super) fn time_stepped<'a>(&'a self, starts: &'a [Motion], h: f64) -> Option<(&'a [Motion], f64)> {
        let Some(located) = &self.located else { return Some((starts, h)) };
        let arc = located.arcs.last().filter(|_| located.is_passed)?;
        Some((&arc.starts, arc.times[1] - arc.times[0]))
    }

    /// Makes a step of length `h` with located impacts.
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
        // What is time-stepped counts its own.
        self.report.parts += u64::from(!located.is_passed);
        Ok(())
    }

    /// Begins a step without arcs, in which nothing has touched the bodies.
    fn begin(&mut self, located: &mut Located) {
        located.arcs.clear();
        located.impacts.iter_mut().for_each(Vec::clear);
        self.pushed.fill(false);
        located.touched.clear();
        located.touched.resize(self.moving.len(), false);
        self.ground_at(located, located.begin);
    }

    /// Makes a step with located impacts to a time, with at most so many arcs; or all of it by time stepping, if the law of
    /// contact is not solved on the way.
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

    /// Makes a step with located impacts to a time, with at most so many arcs.
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

    /// Sets the bodies with prescribed motion to a time within the step.
    fn ground_at(&mut self, located: &Located, t: f64) {
        for (prescribed, from) in self.prescribed.iter_mut().zip(&located.grounds) {
            if let Some(by) = &self.scene.bodies[prescribed.body].motion {
                prescribed.at(by, &self.scene.signals, from, [located.begin, t - located.begin]);
            }
        }
    }

    /// Makes the rest of a step by time stepping.
    fn pass(&mut self, located: &mut Located, rest: f64, control: &Control) -> Result<(), StepFailure> {
        let (starts, before) = (self.moving.clone(), self.report.work);
        let times = [self.t - located.begin, located.step];
        self.advance(rest, HALVINGS, control)?;
        // Velocities of the middle of a step become those of its end.
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

    /// The approach of a contact below which its impacts accumulate within the step, or are rounding.
    fn least_approach(&self, located: &Located, contact: &Contact) -> f64 {
        let normal = contact.frame.row(0).transpose();
        let gravity = self.scene.gravity.dot(&normal).abs();
        let (fall, e) = (located.step * gravity, contact.law.restitution);
        // Bodies that both fly have the same weight per mass, which does not bring them together again.
        let flies = |body: Option<u32>| body.is_some_and(|body| !self.held[body as usize]);
        if e == 1.0 || contact.bodies.into_iter().all(flies) {
            return ROUNDING * fall;
        }
        // All bounces are over after `2 e v / ((1 - e) g)`: within a step for this approach.
        let within_step = fall * ((1.0 - e) / (2.0 * e)).min(1.0);
        // A step that has no room for all of them ends those.
        if 2 * located.arcs.len() > self.most_arcs() || fall == 0.0 {
            return within_step;
        }
        within_step * (fall / (gravity * contact.size).sqrt()).min(1.0)
    }

    /// The rounding error of the velocity of a contact.
    fn rounding(&self, located: &Located, contact: &Contact) -> f64 {
        rounding(contact, &self.moving) + ROUNDING * located.step * self.scene.gravity.norm()
    }

    /// Whether the contact points of a pair of bodies come and go as features of their surfaces pass each other.
    fn is_patch(&self, (a, b): (u32, u32)) -> bool {
        let [a, b] = [a, b].map(|body| &self.scene.bodies[body as usize].collider);
        !a.keeps_points_with(b)
    }
}
