//! Switches within noise. After an accumulation of switches, or where a surface is left and met again at once, the
//! quantity that decides the activity of a variable may be smaller than its errors from Newton's method and rounding.
//! Spurious switches are then located, each at the cost of a new face: a run would end in hundreds of thousands of
//! them.
//!
//! A switch is within noise if the variable has not been clearly off its last switch, or if nothing has changed behind
//! it. After [`MOST`] of these, steps go across switches with the variational inequality at every stage, under the same
//! error test, until a number of steps have kept their face; the number doubles each time. If the switches go on
//! nevertheless, and at their pace the run would take millions of steps, the run fails: the tolerances do not determine
//! the solution.

use super::face::Activity;
use super::settings::StepError;
use super::stepper::Radau;

/// Number of switches within noise (changes of the active face of `K` whose monitors stay within their noise levels)
/// before the location of switches is suspended.
const MOST: u32 = 16;

/// Number of successive clear switches (changes of the active face of `K` not within noise) after which the record of
/// switches is reset.
const CLEAR: u32 = 64;

/// Multiple of its noise level from which a variable is clearly off its switch (the zero of its monitor): the noise
/// level bounds the error of one step, and an error below it is carried on until the next switch.
const NEAR: f64 = 10.0;

/// Maximum number of steps on one face for which the location of switches is suspended.
const LONGEST: u32 = 1 << 16;

/// A run fails after `SAMPLE` switches within noise, from which their frequency is known, if it would take more than
/// `ENDLESS` further steps to its end at that frequency.
const SAMPLE: u32 = 1 << 11;
const ENDLESS: f64 = (1_u32 << 21) as f64;

/// Record of the recent switches (changes of the active face of `K`) of a run, clear ones and those within noise.
#[derive(Clone, Debug)]
pub(super) struct Recurrence {
    /// For each variable, whether it has been clearly (by more than noise) off the zero of its monitor since its last
    /// switch.
    is_clear: Vec<bool>,
    /// Number of successive clear switches (those not within noise).
    clear: u32,
    /// Number of switches within noise, and the variable of the last one.
    within: u32,
    variable: usize,
    /// Time, and number of accepted steps, at the beginning of this record of switches.
    since: (f64, u64),
    /// Number of steps, each on one face, after which the location of switches resumes: for the next suspension, and
    /// the number left in the present one (zero if the location is not suspended).
    pause: u32,
    left: u32,
}

impl Recurrence {
    pub(super) fn new(variables: usize) -> Self {
        Self { is_clear: vec![true; variables], clear: 0, within: 0, variable: 0, since: (0.0, 0), pause: 1, left: 0 }
    }

    /// Whether the location of switches (changes of the active face of `K`) is suspended.
    pub(super) fn is_pausing(&self) -> bool {
        self.left > 0
    }

    /// Records the switches at one time; returns whether the location of switches is suspended from that time on.
    /// Switches within noise that coincide with a clear one belong to it: diodes without voltage or current may
    /// change their activity at every switch.
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

    /// Records a switch within noise, or a switch behind which no variable has changed; returns whether the location
    /// of switches is suspended from this switch on.
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

    /// Resets the record of switches when the states have come to rest.
    pub(super) fn passed(&mut self) {
        (self.clear, self.within, self.pause, self.left) = (0, 0, 1, 0);
    }

    /// Records a step that kept its active face of `K`, which counts towards the end of a suspension of the location of
    /// switches.
    pub(super) fn kept_face(&mut self) {
        self.left = self.left.saturating_sub(1);
    }
}

impl Radau<'_> {
    /// Marks the variables that were clearly off their last switch in the middle of the last step: the ends of the
    /// step may themselves be switches.
    pub(super) fn clear_switches(&mut self) {
        if self.switching.history.recurrence.is_clear.iter().all(|is_clear| *is_clear) {
            return;
        }
        let Self { system, switching, control, last, orders, .. } = self;
        let (y, t) = (&mut switching.scratch, last.t + 0.5 * last.h);
        last.at(orders.last().tableau, t, y);
        if !system.evaluate(t, y) {
            return;
        }
        let is_clear = &mut switching.history.recurrence.is_clear;
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

    /// Fails if switches within noise go on at a frequency at which the run would not end.
    ///
    /// # Errors
    /// [`StepError::Unresolved`].
    pub(super) fn watch_switches(&mut self) -> Result<(), StepError> {
        let (t, accepted, remaining) = (self.clock.t, self.counts.accepted, self.clock.remaining());
        let Recurrence { within, variable, since, .. } = &mut self.switching.history.recurrence;
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
