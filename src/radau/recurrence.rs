//! Switches within noise. Where an accumulation of switches has passed, or a surface is left and met again at once, what
//! decides where a variable belongs may be smaller than what Newton's method and rounding leave of it. Switches are then
//! located that are none, and each costs a new face: a run would end in hundreds of thousands of them.
//!
//! A switch is within noise if the variable has not been clearly off its last one, or if nothing has changed behind it. After
//! [`MOST`] of those, steps go across with the variational inequality at every stage, under the same error test, until some
//! have kept their face; twice as many each time. Where that does not end them either, and at their pace the end would take
//! millions of steps, the run fails: what follows is not determined to the tolerance.

use super::face::Activity;
use super::settings::StepError;
use super::stepper::Radau;

/// Switches within noise before location is left off.
const MOST: u32 = 16;

/// Clear switches in a row after which all is forgotten.
const CLEAR: u32 = 64;

/// The multiple of its noise from which a variable is clearly off its switch: the noise bounds one step, and an error within
/// it is carried on until the next switch.
const NEAR: f64 = 10.0;

/// The most steps on one face that location is left off for.
const LONGEST: u32 = 1 << 16;

/// Switches within noise from which their pace is known, and the steps to the end, at that pace, from which a run fails.
const SAMPLE: u32 = 1 << 11;
const ENDLESS: f64 = (1_u32 << 21) as f64;

/// The recent switches.
#[derive(Debug)]
pub(super) struct Recurrence {
    /// Whether each variable has been clearly off its last switch since.
    is_clear: Vec<bool>,
    /// Clear switches in a row.
    clear: u32,
    /// Switches within noise, and the variable of the last.
    within: u32,
    variable: usize,
    /// The time and the steps made when those began.
    since: (f64, u64),
    /// The steps on one face that bring location back, next time and now, if it is left off.
    pause: u32,
    left: u32,
}

impl Recurrence {
    pub(super) fn new(variables: usize) -> Self {
        Self { is_clear: vec![true; variables], clear: 0, within: 0, variable: 0, since: (0.0, 0), pause: 1, left: 0 }
    }

    /// Whether switches are not to be located.
    pub(super) fn is_pausing(&self) -> bool {
        self.left > 0
    }

    /// Takes the switches of one instant into account; whether location is left off from here on. Those that are within noise
    /// beside one that is clear come with it: diodes without voltage or current may change their places at every switch.
    pub(super) fn switched(&mut self, variables: impl Iterator<Item = usize>) -> bool {
        let (mut last, mut is_clear) = (None, false);
        for variable in variables {
            last = Some(variable);
            is_clear |= std::mem::take(&mut self.is_clear[variable]);
        }
        let Some(variable) = last else { return false };
        if !is_clear {
            self.variable = variable;
            return self.within_noise();
        }
        self.clear += 1;
        if self.clear >= CLEAR {
            (self.clear, self.within, self.pause) = (0, 0, 1);
        }
        false
    }

    /// Takes a switch into account behind which nothing has changed, or which is within noise.
    pub(super) fn within_noise(&mut self) -> bool {
        self.clear = 0;
        self.within += 1;
        let begins = self.within.is_multiple_of(MOST) && self.left == 0;
        if self.within.is_multiple_of(MOST) {
            self.left = self.pause;
            self.pause = (2 * self.pause).min(LONGEST);
        }
        begins
    }

    /// Forgets what has led to where the states rest.
    pub(super) fn passed(&mut self) {
        (self.clear, self.within, self.pause, self.left) = (0, 0, 1, 0);
    }

    /// Takes a step that kept its face into account.
    pub(super) fn kept_face(&mut self) {
        self.left = self.left.saturating_sub(1);
    }
}

impl Radau<'_> {
    /// Finds the variables that were clearly off their last switch in the middle of the last step: it may begin and end at one.
    pub(super) fn clear_switches(&mut self) {
        if self.switching.recurrence.is_clear.iter().all(|is_clear| *is_clear) {
            return;
        }
        let Self { system, switching, control, last, orders, .. } = self;
        let (y, t) = (&mut switching.scratch, last.t + 0.5 * last.h);
        last.at(orders.last().tableau, t, y);
        if !system.evaluate(t, y) {
            return;
        }
        let is_clear = &mut switching.recurrence.is_clear;
        for (k, is_clear) in is_clear.iter_mut().enumerate().filter(|(_, is_clear)| !**is_clear) {
            let (z, g) = (y[system.states + k], system.values[system.states + k]);
            *is_clear = match last.face.places[k] {
                Activity::Inactive => {
                    let distance = (z - system.set.lower[k]).min(system.set.upper[k] - z);
                    distance > NEAR * control.noise_of_z(system, k, y)
                }
                _ => g.abs() > NEAR * control.noise_of_g(system, k, y),
            };
        }
    }

    /// Fails where switches within noise do not end.
    ///
    /// # Errors
    /// [`StepError::Unresolved`].
    pub(super) fn watch_switches(&mut self) -> Result<(), StepError> {
        let (t, accepted, remaining) = (self.clock.t, self.counts.accepted, self.clock.remaining());
        let Recurrence { within, variable, since, .. } = &mut self.switching.recurrence;
        if *within == 0 {
            *since = (t, accepted);
        }
        let left = (accepted - since.1) as f64 * remaining / (t - since.0);
        if *within < SAMPLE || left < ENDLESS {
            return Ok(());
        }
        Err(StepError::Unresolved { t, variable: *variable })
    }
}
