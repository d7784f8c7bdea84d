//! Advances a run element by element: the length of an element follows from its error and from switches in it, the
//! active set from the switches.

use super::screening::Screened;
use super::trial::{Trial, Violation};
use super::{Activity, Segments, Switch};
use crate::stepper::StepError;
use hybrid::{Automaton, Located, Proposal, Solved};

/// Relative length of a tiny element, which contributes nothing to a mean over time: the square root of the rounding
/// unit. Its share of the mean is its length, while rounding hides a change of sign along it by a fraction inversely
/// proportional to its length; a longer limit would let errors into the mean, a shorter one would take rounding for
/// switches.
pub(super) const TINY: f64 = 1.5e-8;
/// Decay factor of the usual length of elements towards shorter elements: a decimal digit in twenty-two elements.
/// With immediate decay no element of a shrinking series would be tiny relative to its predecessor; with hardly any,
/// all elements would be tiny after a stretch on which the solution hardly varies.
const FORGET: f64 = 0.9;
/// Safety factor of the length of elements, and least and largest ratio of an element to the last (Hairer, Norsett
/// and Wanner 1993, II.4): an estimate of the leading term of the error does not extend to very different lengths.
const SAFETY: f64 = 0.9;
const LEAST: f64 = 0.1;
const MOST: f64 = 2.5;
/// Growth factor of successive elements on which no active set is consistent: eight of them lead from the resolution
/// of time to `TINY`. A smaller factor would make more such elements, a larger one longer ones than necessary.
const LONGER: f64 = 8.0;
/// Largest number of successive rejections of an element: each at least halves the element, and doubles have 52
/// binary digits.
const MOST_IN_A_ROW: u32 = 52;

/// Largest number of repetitions of an element, each at most half as long, because it is not proven free of switches. A
/// judgement: with fewer, elements count as unproven that shorter ones would have proven; with more, elements that
/// cannot be proven, where a monitor touches zero, waste as many trials.
const SHORTENED: u32 = 3;

/// A change of the active set: a variable with its new activity.
type Change = (usize, Activity);

/// Data of the attempts at one element of the solution.
#[derive(Debug, Default)]
pub struct Attempts {
    /// The proposed length of the element that is attempted; and the first floating-point number after the break (kink
    /// or jump of the data) at its end, if it ends at one.
    h: f64,
    broken: Option<f64>,
    /// Whether no active set is consistent on the element, which is then accepted without checks.
    is_unclear: bool,
    /// The number of successive rejections of the element, and the number of those after which it was shortened
    /// because it was not proven free of switches.
    rejected: u32,
    shortened: u32,
    /// The number of times that the present trial element was screened for switches.
    screened: u32,
}

/// An element whose equations are solved, with the result of its screening.
pub struct Element {
    trial: Trial,
    screened: Screened,
}

impl Automaton for Segments<'_> {
    type Attempts = Attempts;
    type Step = Element;
    type Violation = Violation;
    type Event = Change;
    type Error = StepError;

    fn propose(&mut self, attempts: &mut Attempts) -> Result<Proposal, StepError> {
        if self.control.poll().is_some() {
            return Err(StepError::Interrupted { t: self.t });
        }
        attempts.screened = 0;
        let left = self.end - self.t;
        attempts.is_unclear = std::mem::take(&mut self.unclear.1);
        if attempts.is_unclear {
            return Ok(Proposal::Step(self.unclear.0.min(left)));
        }
        if self.kinks > MOST_IN_A_ROW || attempts.rejected > MOST_IN_A_ROW {
            let outcome = "the error is too large for any length of an element";
            return Err(StepError::Unsolved { t: self.t, outcome, residual: f64::NAN });
        }
        let wanted = self.h.min(self.longest());
        // Divide the remaining time of the run between its last two elements.
        let is_last = wanted >= left || left <= 2.0 * self.resolution(left);
        let h = if is_last { left } else { wanted.min(0.5 * left).max(wanted.min(left - wanted)) };
        (attempts.h, attempts.broken) = self.up_to_break(h);
        Ok(Proposal::Step(attempts.h))
    }

    fn solve(&mut self, h: f64, _: &mut Attempts) -> Result<Solved<Element>, StepError> {
        Ok(Solved::Step(Element { trial: self.trial(h)?, screened: Screened::Proven }))
    }

    /// Screens an element for switches; after too many cuts at violations the element counts as open (not proven).
    fn screen(
        &mut self,
        step: &mut Element,
        attempts: &mut Attempts,
    ) -> Result<hybrid::Screened<Violation>, StepError> {
        if attempts.is_unclear {
            return Ok(hybrid::Screened::Clear);
        }
        attempts.screened += 1;
        let trial = &step.trial;
        let is_brief = self.is_tiny(trial.h);
        step.screened = match trial.violation {
            _ if attempts.screened > MOST_IN_A_ROW => Screened::Open,
            Some(violation) => Screened::Violated(violation),
            None if is_brief || trial.error > 1.0 => Screened::Proven,
            None => self.screen_element(trial)?,
        };
        Ok(match step.screened {
            Screened::Violated(violation) => hybrid::Screened::Violated(violation),
            Screened::Proven | Screened::Unresolved | Screened::Open => hybrid::Screened::Clear,
        })
    }

    /// Shortens the element to the first switch (change of the active set) in it. Forces may have a kink at the switch,
    /// so that only the element up to the switch is accurate; it is screened again.
    fn locate(
        &mut self,
        step: Element,
        violation: Violation,
        _: &mut Attempts,
    ) -> Result<Located<Element, Change>, StepError> {
        Ok(match self.locate_switch(step.trial, violation)? {
            (Some(trial), change) => Located::Cut(Element { trial, ..step }, change),
            (None, change) => {
                self.rejected += 1;
                if let Some((variable, to)) = change {
                    self.change(variable, to)?;
                }
                Located::Rejected
            }
        })
    }

    fn is_accurate(
        &mut self,
        Element { trial, screened }: &Element,
        _: Option<&Change>,
        attempts: &mut Attempts,
    ) -> Result<bool, StepError> {
        let is_unproven = *screened == Screened::Open && attempts.shortened < SHORTENED;
        let is_rough = is_unproven || *screened == Screened::Unresolved;
        if attempts.is_unclear || self.is_tiny(attempts.h) || trial.error <= 1.0 && !is_rough {
            return Ok(true);
        }
        self.rejected += 1;
        attempts.rejected += 1;
        attempts.shortened += u32::from(*screened == Screened::Open);
        let error = trial.error.max(f64::MIN_POSITIVE);
        self.h = trial.h * (SAFETY * error.powf(-1.0 / self.order as f64)).clamp(LEAST, 0.5);
        Ok(false)
    }

    fn accept(
        &mut self,
        Element { trial, screened }: Element,
        event: Option<Change>,
        attempts: Attempts,
    ) -> Result<(), StepError> {
        if attempts.is_unclear {
            self.append(&trial, true);
            return Ok(());
        }
        let (wanted, is_tiny) = (self.h, self.is_tiny(attempts.h));
        match screened {
            Screened::Proven => self.proven += 1,
            _ => self.open += u64::from(!is_tiny),
        }
        self.append(&trial, is_tiny && trial.error > 1.0);
        if let Some((variable, to)) = event {
            self.rejected += 1;
            self.h = wanted;
            self.change(variable, to)?;
        }
        if let Some(after) = attempts.broken.filter(|_| trial.h == attempts.h) {
            self.pass_break(after);
            if event.is_none() {
                self.change_at_break(&trial)?;
            }
        }
        Ok(())
    }
}

impl Segments<'_> {
    /// Makes the next element, before the end of the run.
    ///
    /// # Errors
    /// If values are not finite, a set is empty, no solution is found, or on interruption.
    pub fn step(&mut self) -> Result<(), StepError> {
        hybrid::advance(self)
    }

    fn is_tiny(&self, h: f64) -> bool {
        h <= TINY * self.usual || h <= self.resolution(h)
    }

    /// Changes the active set at a break (kink or jump of the data) if a monitor is zero there within the tolerances:
    /// after the break the monitor (a quantity that is positive while the active set holds) may change its sign too
    /// slowly to be located.
    fn change_at_break(&mut self, trial: &Trial) -> Result<(), StepError> {
        for (variable, end) in trial.ends.iter().enumerate() {
            for to in [Activity::AtLower, Activity::Inactive, Activity::AtUpper] {
                let slack = match to {
                    Activity::Inactive => self.uncertainty(variable),
                    _ => self.allowed(variable, self.size[variable]),
                };
                if end.towards(to).abs() <= end.noise + slack {
                    return self.change(variable, to);
                }
            }
        }
        Ok(())
    }

    /// Changes the activity of a variable, at the beginning of a new segment.
    ///
    /// If a force has a kink at the switch itself, rounding may leave no valid active set for a moment. A tiny element
    /// is then accepted without checks, longer each time, with the variable at its bound.
    fn change(&mut self, variable: usize, to: Activity) -> Result<(), StepError> {
        self.is_first = true;
        self.flips += 1;
        if self.flips > 2 * self.places.len() + 2 {
            self.flips = 0;
            let length = if self.unclear.0 == 0.0 { self.resolution(0.0) } else { LONGER * self.unclear.0 };
            self.unclear = (length, true);
            if length > TINY * self.usual {
                let outcome = "no active set is consistent after a switch";
                return Err(StepError::Unsolved { t: self.t, outcome, residual: f64::NAN });
            }
            if to == Activity::Inactive {
                return Ok(());
            }
        }
        self.places[variable] = to;
        Ok(())
    }

    /// Appends an element to the solution, and sets the length of the next one.
    fn append(&mut self, trial: &Trial, is_kink: bool) {
        let (h, m) = (trial.h, self.places.len());
        let shape = &self.shapes[trial.shape];
        let n = shape.len();
        let end = if h >= self.end - self.t { self.end } else { self.t + h };
        // Changes of the active set on tiny elements, or on those without a consistent active set, come from rounding
        // next to a switch, and are not reported.
        let is_brief = is_kink || h <= TINY * self.usual;
        if !is_brief {
            let t = self.brief.take().unwrap_or(self.t);
            for (variable, (last, now)) in self.told.iter().flatten().zip(&self.places).enumerate() {
                if last != now {
                    self.switches.push(Switch { t, variable, to: *now });
                }
            }
            self.told = Some(self.places.clone());
            (self.flips, self.kinks, self.unclear) = (0, 0, (0.0, false));
        } else {
            self.kinks += 1;
            self.brief.get_or_insert(self.t);
        }
        let integrals = shape.integrals.view((0, 0), (n, n)) * h;
        for (level, integral) in self.integrals.iter_mut().enumerate() {
            let last = shape.values.row(n - 1);
            let last = last.columns(0, n);
            (0..m).for_each(|k| integral[k] = (last * trial.levels[level + 1].column(k))[(0, 0)]);
        }
        let at_start = self.integral.clone();
        for k in 0..m {
            let column = trial.levels[0].column(k);
            self.integral[k] += (0..n).map(|j| integrals[(n - 1, j)] * column[j]).sum::<f64>();
            self.size[k] = self.size[k].max(trial.size[k]);
        }
        self.past.append(self.t, end, trial.shape, trial.levels.clone(), at_start);
        self.t = end;
        self.is_first = is_kink;
        let factor = (SAFETY * trial.error.max(1e-12).powf(-1.0 / self.order as f64)).clamp(LEAST, MOST);
        if !is_brief {
            self.usual = (FORGET * self.usual).max(h);
        }
        self.h = if is_kink { LEAST * self.usual } else { h * factor };
    }
}
