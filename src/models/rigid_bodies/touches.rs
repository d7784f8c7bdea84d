//! Events between pairs of bodies in contact, detected from step to step: impact, stick, slip and lift-off.
//!
//! Bodies at rest have small residual velocities, which must not produce events. Normal velocities below the velocity
//! change by gravity within a step do not count as impacts, and tangential velocities below a small fraction of the
//! velocity change do not count as slip. Gaps within tolerance, or an impact distributed over two steps, do not count
//! as lift-off. The threshold for the onset of slip is larger than that for its end (hysteresis against rounding).

use super::contact::Contact;
use super::motion::Motion;
use problem::EventKind;
use rustc_hash::FxHashMap;

/// Rounding error of the relative velocity of two bodies, relative to the sum of their speeds.
const ROUNDING: f64 = 1e-9;

/// The slip velocity below which slip of a contact ends, relative to the velocity change by gravity within a step.
const ENDS: f64 = 1e-3;
/// The slip velocity above which slip of a contact begins, relative to the velocity change by gravity within a step.
const BEGINS: f64 = 1e-2;

/// A contact event between two bodies: its kind, the indices of the bodies, and its time; `None` is the end of the
/// step.
pub type NewEvent = (EventKind, [usize; 2], Option<f64>);

/// The pairs of bodies that are in contact, followed from step to step.
#[derive(Clone, Debug, Default)]
pub struct Touches {
    pairs: FxHashMap<(u32, u32), Touch>,
    step: u64,
}

/// The state of a pair of bodies in contact.
#[derive(Clone, Copy, Debug)]
struct Touch {
    slips: bool,
    /// The numbers of the first and the last step at whose end the pair was in contact.
    steps: [u64; 2],
}

/// A contact between two bodies in a step, with the data that determine its events (impact, stick, slip, lift-off).
pub struct Touched<'a> {
    /// The contact, with its impulse in the step.
    pub contact: &'a Contact,
    /// Whether the contact had an impulse in the previous step.
    pub was_struck: bool,
    /// Whether the contact is closed at the end of the step.
    pub is_closed: bool,
}

impl Touches {
    /// Updates the pairs in contact with the contacts of a step, grouped by pair, and appends contact events. `fall` is
    /// the velocity change by gravity within a step.
    pub fn follow<'a>(
        &mut self,
        contacts: impl Iterator<Item = Touched<'a>>,
        moving: &[Motion],
        fall: f64,
        new_events: &mut Vec<NewEvent>,
    ) {
        self.step += 1;
        let mut contacts = contacts.peekable();
        while let Some(first) = contacts.next() {
            let pair = pair(first.contact);
            let mut seen = Pair::default();
            seen.add(&first, moving, fall);
            while let Some(next) = contacts.next_if(|next| self::pair(next.contact) == pair) {
                seen.add(&next, moving, fall);
            }
            self.take(pair, &seen, new_events);
        }
        let step = self.step;
        self.pairs.retain(|&pair, touch| {
            let stays = touch.steps[1] == step;
            if !stays && touch.steps[1] > touch.steps[0] {
                new_events.push((EventKind::LiftOff, places(pair), None));
            }
            stays
        });
    }

    fn take(&mut self, pair: (u32, u32), seen: &Pair, new_events: &mut Vec<NewEvent>) {
        let mut tell = |kind| new_events.push((kind, places(pair), None));
        if seen.strikes {
            tell(EventKind::Impact);
        }
        match self.pairs.get_mut(&pair) {
            Some(touch) if seen.is_closed => {
                touch.steps[1] = self.step;
                if touch.slips && seen.sticks {
                    touch.slips = false;
                    tell(EventKind::Stick);
                } else if !touch.slips && seen.slips {
                    touch.slips = true;
                    tell(EventKind::Slip);
                }
            }
            None if seen.is_closed && seen.is_struck => {
                self.pairs.insert(pair, Touch { slips: seen.slips, steps: [self.step; 2] });
            }
            _ => {}
        }
    }
}

/// The contacts of a pair of bodies in one step, combined to one state.
#[derive(Debug, Default)]
struct Pair {
    is_closed: bool,
    is_struck: bool,
    /// Whether an impact of the pair occurred: a contact without impulse in the last step has an impulse, and its
    /// normal velocity exceeds the threshold.
    strikes: bool,
    /// Whether a contact of the pair with an impulse slips faster than the threshold for the onset of slip.
    slips: bool,
    /// Whether the pair sticks: it has a contact with an impulse, and no contact slips faster than the threshold for
    /// the end of slip.
    sticks: bool,
    /// Whether a contact of the pair with an impulse slips faster than the threshold for the end of slip.
    creeps: bool,
}

impl Pair {
    fn add(&mut self, touched: &Touched<'_>, moving: &[Motion], fall: f64) {
        let Touched { contact, was_struck, is_closed } = *touched;
        self.is_closed |= is_closed;
        if contact.impulse.x <= 0.0 {
            return;
        }
        let rounding = rounding(contact, moving);
        self.is_struck = true;
        self.strikes |= !was_struck && -contact.before.x > fall + rounding;
        if contact.law.is_rough() {
            let after = contact.velocity(|body| (moving[body as usize].velocity, moving[body as usize].omega));
            let slip = contact.slip_speed(&after);
            self.slips |= slip > BEGINS * fall + rounding;
            self.creeps |= slip > ENDS * fall + rounding;
        }
        self.sticks = !self.creeps;
    }
}

/// Returns the rounding error of the relative velocity at a contact.
pub fn rounding(contact: &Contact, moving: &[Motion]) -> f64 {
    ROUNDING * speeds(contact, moving)
}

/// Returns the sum of the speeds of both bodies at a contact.
fn speeds(contact: &Contact, moving: &[Motion]) -> f64 {
    let speed = |side: usize| {
        contact.bodies[side].map_or(0.0, |body| {
            let body = &moving[body as usize];
            body.velocity.norm() + body.omega.norm() * contact.arms[side].norm()
        })
    };
    speed(0) + speed(1)
}

fn pair(contact: &Contact) -> (u32, u32) {
    (contact.key.0, contact.key.1)
}

fn places(pair: (u32, u32)) -> [usize; 2] {
    [pair.0 as usize, pair.1 as usize]
}
