//! Location of switches: the unknown is the length of the element at whose end a monitor is zero. Each guess is an
//! element of its own, so that the time has the accuracy of the method; guesses are by false position (Illinois).

use super::trial::{Trial, Violation};
use super::{Activity, Segments};
use crate::stepper::StepError;
use numerics::Bracket;

/// Largest number of guesses of the time of a switch: every other one at least halves the bracket, and a double has
/// 53 binary digits.
const GUESSES: usize = 120;
/// Shrinkage of the bracket of a switch at each guess as long as only its upper end is known: four binary digits a
/// guess. A factor nearer to one takes more guesses to a switch at the beginning of the element, a smaller one leaves a
/// wider bracket otherwise.
const SHRINK: f64 = 1.0 / 16.0;

/// Fraction of the bracket of a switch, at either of its ends, in which no guess is made: a wrong value moves a guess
/// at most three decimal digits towards one end. A larger fraction costs guesses where the secant is accurate, a
/// smaller one where it is not.
const MARGIN: f64 = 1e-3;

/// Fraction of its noise below which a monitor counts as zero. The noise allows for sixteen rounding errors of its
/// largest term ([`trial`](super::trial)), so the monitor is then within one of them, and further guesses would gain
/// nothing. With all of the noise the time would be less accurate than possible; with much less no guess would be zero,
/// and the bracket be halved to its end.
const SURE: f64 = 1.0 / 16.0;

/// The element up to a switch, `None` if the switch is at the beginning of the element; and the variable with its new
/// activity, `None` if a shorter element shows no switch.
type LocatedSwitch = (Option<Trial>, Option<(usize, Activity)>);

impl Segments<'_> {
    /// Locates the first change of sign of a monitor in an element.
    pub(super) fn locate_switch(&mut self, trial: Trial, violation: Violation) -> Result<LocatedSwitch, StepError> {
        let mut lost = violation;
        // The length of the shortest element found so far whose monitor is negative at its end, and the value of the
        // monitor.
        let mut behind = (violation.theta * trial.h, violation.value);
        // The longest element found so far whose monitor is positive at its end, and the bracket of the switch: from
        // the end of this element to that of the shortest element with a negative monitor.
        let mut before: Option<(Trial, Bracket)> = None;
        // Whether an element that ends at the upper end of the bracket, and not beyond it, has a negative monitor
        // there: an element across a kink of a force may be wrong before the kink as well.
        let mut confirmed = violation.theta == 1.0;
        for _ in 0..GUESSES {
            let high = behind.0;
            let resolution = self.resolution(high);
            let guess = match &before {
                _ if !confirmed && high > resolution => high,
                None if high <= resolution || high <= super::advance::TINY * self.usual.min(trial.h) => {
                    return Ok((None, Some((lost.variable, lost.to))));
                }
                None => SHRINK * high,
                Some((_, bracket)) if bracket.width() <= resolution => break,
                Some((_, bracket)) => {
                    let (low, margin) = (bracket.before.0, MARGIN * bracket.width());
                    let guess = Some(bracket.guess()).filter(|guess| guess.is_finite());
                    guess.unwrap_or(low).clamp(low + margin, high - margin)
                }
            };
            let made = self.trial(guess)?;
            let monitor = made.ends[lost.variable];
            let at_end = monitor.towards(lost.to);
            if at_end.abs() <= SURE * monitor.noise && made.violation.is_none() && confirmed {
                return Ok((Some(made), Some((lost.variable, lost.to))));
            }
            let found = match made.violation {
                // A monitor that is negative at the end of the element by less than the tolerance has changed its sign
                // nevertheless.
                None if at_end < 0.0 => Violation { theta: 1.0, value: at_end, ..lost },
                // The element that ends where the longer one was negative shows no switch: accept it.
                None if !confirmed && guess == high => return Ok((Some(made), None)),
                None => {
                    let mut bracket =
                        before.map_or_else(|| Bracket::new((0.0, at_end), behind), |(_, bracket)| bracket);
                    bracket.narrow(guess, at_end);
                    before = Some((made, bracket));
                    continue;
                }
                Some(found) => found,
            };
            behind = (found.theta * guess, found.value);
            if let Some((trial, bracket)) = &mut before {
                if (found.variable, found.to) == (lost.variable, lost.to) {
                    bracket.narrow(behind.0, behind.1);
                } else {
                    let value = trial.ends[found.variable].towards(found.to);
                    *bracket = Bracket::new((trial.h, value), behind);
                }
            }
            (lost, confirmed) = (found, found.theta == 1.0);
        }
        Ok((before.map(|(trial, _)| trial), Some((lost.variable, lost.to))))
    }
}
