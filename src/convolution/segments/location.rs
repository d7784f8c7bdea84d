//! Where a switch is: the length of the element at whose end the sign of the face is lost, as the unknown. Each guess is an
//! element of its own, so that the time has the accuracy of the method; guesses are by false position (Illinois).

use super::trial::{Trial, Violation};
use super::{Place, Segments};
use crate::stepper::StepError;

/// Guesses: every other one halves the bracket at least, and a double has 53 binary digits.
const GUESSES: usize = 120;
/// By how much the bracket shrinks as long as only its upper end is known: four binary digits a guess. A factor nearer to one takes
/// more guesses to a switch at the beginning of the element, a smaller one leaves a wider bracket to one that is not.
const SHRINK: f64 = 1.0 / 16.0;

/// A monitor is zero below this part of its noise, which allows for sixteen rounding errors of its largest term
/// ([`trial`](super::trial)): it is then at most one of them, and no other guess would tell more. With all of the noise the time
/// would be off by more than it is known to; with much less no guess would be zero, and the bracket be halved to its end.
const SURE: f64 = 1.0 / 16.0;

/// An element up to a switch, none where it is at the beginning; and the variable with its new place, none where a shorter
/// element shows no switch.
type Located = (Option<Trial>, Option<(usize, Place)>);

impl Segments<'_> {
    /// Locates the first loss of a sign in an element.
    pub(super) fn locate(&mut self, trial: Trial, violation: Violation) -> Result<Located, StepError> {
        let mut high = violation.theta * trial.h;
        let mut lost = violation;
        // What the monitor is at the upper end, as far as it counts for the next guess.
        let mut value = violation.value;
        let mut low: Option<(Trial, f64)> = None;
        let mut side = 0;
        // Whether an element that ends at the upper end has lost its sign there: one that goes further, over a kink of a force,
        // may be wrong before the kink as well.
        let mut confirmed = violation.theta == 1.0;
        for _ in 0..GUESSES {
            let resolution = self.resolution(high);
            let guess = match &low {
                _ if !confirmed && high > resolution => high,
                None if high <= resolution || high <= super::advance::TINY * self.usual.min(trial.h) => {
                    return Ok((None, Some((lost.variable, lost.to))));
                }
                None => SHRINK * high,
                Some((before, left)) => {
                    let width = high - before.h;
                    if width <= resolution {
                        break;
                    }
                    let part = if *left > 0.0 { left / (left - value) } else { 0.0 };
                    before.h + width * part.clamp(1e-3, 1.0 - 1e-3)
                }
            };
            let made = self.trial(guess)?;
            let monitor = made.ends[lost.variable];
            let at_end = monitor.towards(lost.to);
            if at_end.abs() <= SURE * monitor.noise && made.violation.is_none() && confirmed {
                return Ok((Some(made), Some((lost.variable, lost.to))));
            }
            let found = match made.violation {
                // A sign that is lost by less than the tolerance has been lost all the same.
                None if at_end < 0.0 => Violation { theta: 1.0, value: at_end, ..lost },
                // What looked like a switch was none.
                None if !confirmed && guess == high => return Ok((Some(made), None)),
                None => {
                    if side == -1 {
                        value *= 0.5;
                    }
                    side = -1;
                    low = Some((made, at_end));
                    continue;
                }
                Some(found) => found,
            };
            if found.variable != lost.variable || found.to != lost.to {
                if let Some((before, left)) = &mut low {
                    *left = before.ends[found.variable].towards(found.to);
                }
                side = 0;
            } else {
                if let Some((_, left)) = low.as_mut().filter(|_| side == 1) {
                    *left *= 0.5;
                }
                side = 1;
            }
            (high, value, lost, confirmed) = (found.theta * guess, found.value, found, found.theta == 1.0);
        }
        match low {
            Some((trial, _)) => Ok((Some(trial), Some((lost.variable, lost.to)))),
            None => Ok((None, Some((lost.variable, lost.to)))),
        }
    }
}
