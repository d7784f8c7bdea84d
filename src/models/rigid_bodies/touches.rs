//! What happens between pairs of bodies from step to step: they strike, stick, slip and lift off.
//!
//! A heap at rest is never quite at rest: speeds below what gravity gives within a step are no impact, a small part of
//! them is no slip, and gaps that are none, or an impact that two steps share, are no lift-off. Slip begins at a greater
//! speed than it ends at, so that it does not come and go with rounding.

use super::contact::Contact;
use super::motion::Motion;
use problem::EventKind;
use rustc_hash::FxHashMap;

/// Rounding, in parts of the speeds that a difference is taken of.
const ROUNDING: f64 = 1e-9;

/// Slips that end and begin, in parts of the speed that gravity gives within a step.
const ENDS: f64 = 1e-3;
const BEGINS: f64 = 1e-2;

/// The pairs that touch.
#[derive(Debug, Default)]
pub struct Touches {
    pairs: FxHashMap<(u32, u32), Touch>,
    step: u64,
}

/// A pair that touches.
#[derive(Clone, Copy, Debug)]
struct Touch {
    slips: bool,
    /// The first and the last step at the end of which it touched.
    steps: [u64; 2],
}

/// A contact in a step.
pub struct Touched<'a> {
    /// With its impulse.
    pub contact: &'a Contact,
    /// Whether it carried one in the step before.
    pub was_struck: bool,
    /// Whether it touches at the end of the step.
    pub is_closed: bool,
}

impl Touches {
    /// Takes over the contacts of a step, those of a pair one after the other: what happened to which pair. `fall` is
    /// the speed that gravity gives within a step.
    pub fn follow<'a>(
        &mut self,
        contacts: impl Iterator<Item = Touched<'a>>,
        moving: &[Motion],
        fall: f64,
        new_events: &mut Vec<(EventKind, [usize; 2])>,
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
                new_events.push((EventKind::LiftOff, places(pair)));
            }
            stays
        });
    }

    fn take(&mut self, pair: (u32, u32), seen: &Pair, new_events: &mut Vec<(EventKind, [usize; 2])>) {
        let mut tell = |kind| new_events.push((kind, places(pair)));
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

/// What the contacts of a pair do.
#[derive(Debug, Default)]
struct Pair {
    is_closed: bool,
    is_struck: bool,
    /// Whether one came to carry an impulse at speed.
    strikes: bool,
    /// Whether one that is struck slips.
    slips: bool,
    /// Whether there is such a one, and none that slips even slowly.
    sticks: bool,
    creeps: bool,
}

impl Pair {
    fn add(&mut self, touched: &Touched<'_>, moving: &[Motion], fall: f64) {
        let Touched { contact, was_struck, is_closed } = *touched;
        self.is_closed |= is_closed;
        if contact.impulse.x <= 0.0 {
            return;
        }
        let rounding = ROUNDING * speeds(contact, moving);
        self.is_struck = true;
        self.strikes |= !was_struck && -contact.before.x > fall + rounding;
        if contact.law.friction > 0.0 {
            let after = contact.velocity(|body| (moving[body as usize].velocity, moving[body as usize].omega));
            let slip = after.y.hypot(after.z);
            self.slips |= slip > BEGINS * fall + rounding;
            self.creeps |= slip > ENDS * fall + rounding;
        }
        self.sticks = !self.creeps;
    }
}

/// The speeds of both bodies at a contact, added up.
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
