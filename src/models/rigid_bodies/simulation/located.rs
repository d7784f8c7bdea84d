//! Steps whose impacts are located in time, of second order.
//!
//! A step is a sequence of arcs. Contacts that are closed at the beginning of an arc, and neither approach nor part,
//! [last](self::lasting) throughout it; all other contacts are open, and the arc ends where the first of them
//! [closes](self::closing). There the law of impact [acts](self::strike) at once on all contacts that are closed. Bodies
//! without a lasting contact fly,
//!
//! ```text
//! v' = v + s g/2,    q+ = q (+) s v',    v+ = v' + s g/2
//! ```
//!
//! which is exact for the centre of mass, and of second order for the rotation.
//!
//! Impacts of a contact may accumulate (Zeno). An approach slower than what gravity adds to the velocity in a step would return
//! within about a step: it is ended without restitution, so that the contact lasts. With restitution 1 impacts do not
//! accumulate, and none is ended so. The energy taken and the displacement are of second order in the step, like all other errors. Where
//! impacts accumulate between several bodies, their number in a step is limited, and time stepping takes the rest of the step.

mod closing;
mod lasting;
mod strike;

use super::super::contact::Contact;
use super::super::motion::Motion;
use super::{HALVINGS, MoreauStepping, StepFailure};
use nalgebra::Isometry3;
use problem::Control;
use rustc_hash::FxHashSet;

/// The number of arcs in a step, for each moving body, beyond which time stepping takes the rest of the step: bodies that meet
/// others so often within one step are not resolved by it.
const ARCS: usize = 8;

/// The identity of a contact.
type Key = (u32, u32, u64);

/// Part of a step between impacts.
#[derive(Clone, Debug)]
pub struct Arc {
    /// The times of its beginning and its end, from the beginning of the step on.
    pub times: [f64; 2],
    /// The moving bodies at its beginning, after the impacts there.
    pub starts: Vec<Motion>,
    /// The moving bodies at its end, before the impacts there.
    pub ends: Vec<Motion>,
}

impl Arc {
    /// The moving bodies at a time within the arc, from the beginning of the step on.
    pub fn at(&self, passed: f64) -> impl Iterator<Item = Motion> {
        let [from, to] = self.times;
        let (s, d) = (to - from, passed - from);
        self.starts.iter().zip(&self.ends).map(move |(start, end)| if d < s { start.between(end, s, d) } else { *end })
    }
}

/// What located impacts keep from arc to arc.
#[derive(Debug, Default)]
pub(super) struct Located {
    /// The contacts that last.
    lasting: FxHashSet<Key>,
    /// The time at the beginning of the step, and the length of the step.
    begin: f64,
    step: f64,
    /// The bodies with prescribed motion at the beginning of the step.
    grounds: Vec<Isometry3<f64>>,
    /// The arcs of the last step.
    pub arcs: Vec<Arc>,
    /// Whether time stepping took the rest of the last step.
    pub is_passed: bool,
}

impl MoreauStepping<'_> {
    /// Lets impacts be located. The multibody system must have no joints, and no forces that depend on the motion.
    pub fn locate_impacts(&mut self) {
        self.located = Some(Box::default());
    }

    /// The arcs of the last step, if impacts are located.
    pub fn arcs(&self) -> &[Arc] {
        self.located.as_ref().map_or(&[], |located| &located.arcs)
    }

    /// Whether impacts of the last step are located, and time stepping took its rest.
    pub fn is_passed(&self) -> bool {
        self.located.as_ref().is_some_and(|located| located.is_passed)
    }

    /// Makes a step of length `h` with located impacts.
    pub(super) fn advance_located(
        &mut self,
        located: &mut Located,
        h: f64,
        control: &Control,
    ) -> Result<(), StepFailure> {
        (located.begin, located.step, located.is_passed) = (self.t, h, false);
        located.arcs.clear();
        located.grounds.clear();
        located.grounds.extend(self.prescribed.iter().map(|prescribed| prescribed.pose));
        self.pushed.fill(false);
        self.ground_at(located, self.t);
        self.detect(h, control)?;
        self.report.penetration = self.report.penetration.max(self.depth(0.0));
        self.report.overlap = self.report.overlap.max(self.overlap());
        self.part_overlaps(h, control)?;
        let kinetic: f64 = self.moving.iter().map(Motion::kinetic_energy).sum();
        self.report.kinetic = self.report.kinetic.max(kinetic);
        let (end, most) = (self.t + h, ARCS * self.moving.len());
        while self.t < end {
            self.strike(located, control)?;
            let rest = end - self.t;
            if located.arcs.len() >= most {
                self.pass(located, rest, control)?;
                break;
            }
            self.glide(located, rest, control)?;
        }
        self.t = end;
        self.ground_at(located, end);
        self.ends.clone_from(&self.moving);
        self.report.parts += 1;
        Ok(())
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
        let starts = self.moving.clone();
        let times = [self.t - located.begin, located.step];
        self.kept.clear();
        self.advance(rest, HALVINGS, control)?;
        // Velocities of the middle of a step become those of its end.
        self.moving.clone_from(&self.ends);
        self.moving.iter_mut().for_each(|motion| motion.lag = 0.0);
        located.lasting.clear();
        let lasts = |contact: &&Contact| contact.impulse.x > 0.0 && contact.stays_closed();
        located.lasting.extend(self.contacts.iter().filter(lasts).map(|contact| contact.key));
        located.is_passed = true;
        self.kept.clear();
        located.arcs.push(Arc { times, starts, ends: self.moving.clone() });
        Ok(())
    }

    /// The velocity that gravity adds along the normal of a contact within the step.
    fn fall(&self, located: &Located, contact: &Contact) -> f64 {
        let normal = contact.frame.row(0).transpose();
        located.step * self.scene.gravity.dot(&normal).abs()
    }
}
