//! One element after the other: its length by its error and by the switches in it, and the face behind each.

use super::screening::Screened;
use super::trial::Trial;
use super::{Activity, Segments, Switch};
use crate::stepper::StepError;

/// An element that had to be this much shorter than usual adds nothing to a mean over time: the root of the rounding of doubles.
/// Its own share of the mean is as large as it is long, while rounding hides a change of sign along it by a part that goes with
/// the inverse of its length; a longer limit would let errors into the mean, a shorter one would take rounding for switches.
pub(super) const TINY: f64 = 1.5e-8;
/// How fast the usual size follows elements that are shorter: by a digit in twenty-two. If it followed at once, no element of a
/// series that shrinks would be tiny beside the one before; if it hardly did, all would be tiny after a stretch on which the
/// solution hardly varies.
const FORGET: f64 = 0.9;
/// The safety factor on the step that the error allows, and the least and the largest ratio of an element to the last (Hairer,
/// Norsett and Wanner 1993, II.4): an estimate of the leading term of the error tells no more about lengths far off.
const SAFETY: f64 = 0.9;
const LEAST: f64 = 0.1;
const MOST: f64 = 2.5;
/// By how much an element on which no face holds is longer than the one before: eight of these take it from the resolution of time
/// to `TINY`. A smaller factor would make more elements without a face, a larger one longer ones than need be.
const LONGER: f64 = 8.0;
/// Elements that may be rejected one after the other: they shrink to at most half each time, and these are the digits of doubles.
const MOST_IN_A_ROW: u32 = 52;

/// How often an element is made again, at most half as long each time, because it is not proven free of switches. A judgement: with
/// fewer, elements count as unproven that smaller ones would have proven; with more, all that cannot be proven, where a monitor
/// touches zero, take as many trials again.
const SHORTENED: u32 = 3;

/// A variable with its new place.
type Change = Option<(usize, Activity)>;

impl Segments<'_> {
    /// Makes the next element; there is one.
    ///
    /// # Errors
    /// Values that are not finite, an empty set, no solution, an interruption.
    pub fn step(&mut self) -> Result<(), StepError> {
        let (mut in_a_row, mut shortened) = (0, 0);
        loop {
            if self.control.poll().is_some() {
                return Err(StepError::Interrupted { t: self.t });
            }
            let left = self.end - self.t;
            if std::mem::take(&mut self.unclear.1) {
                let h = self.unclear.0.min(left);
                let trial = self.trial(h)?;
                self.accept(&trial, h, true);
                return Ok(());
            }
            let wanted = self.h.min(self.longest());
            // The last two elements share what is left.
            let is_last = wanted >= left || left <= 2.0 * self.resolution(left);
            let h = if is_last { left } else { wanted.min(0.5 * left).max(wanted.min(left - wanted)) };
            let (h, broken) = self.up_to_break(h);
            let trial = self.trial(h)?;
            let is_tiny = h <= TINY * self.usual || h <= self.resolution(h);
            if self.kinks > MOST_IN_A_ROW || in_a_row > MOST_IN_A_ROW {
                let outcome = "no element is short enough";
                return Err(StepError::Unsolved { t: self.t, outcome, residual: f64::NAN });
            }
            let (trial, change, screened) = self.up_to_switch(trial)?;
            if let Some(trial) = trial {
                let wanted = self.h;
                let (is_rough, is_unclear) = match screened {
                    Screened::Unresolved => (true, false),
                    Screened::Open => (shortened < SHORTENED, true),
                    Screened::Proven | Screened::Violated(_) => (false, false),
                };
                if (trial.error > 1.0 || is_rough) && !is_tiny {
                    self.rejected += 1;
                    in_a_row += 1;
                    shortened += u32::from(is_unclear);
                    let error = trial.error.max(f64::MIN_POSITIVE);
                    self.h = trial.h * (SAFETY * error.powf(-1.0 / self.order as f64)).clamp(LEAST, 0.5);
                    continue;
                }
                match screened {
                    Screened::Proven => self.proven += 1,
                    _ => self.open += u64::from(!is_tiny),
                }
                self.accept(&trial, trial.h, is_tiny && trial.error > 1.0);
                if let Some((variable, to)) = change {
                    self.rejected += 1;
                    self.h = wanted;
                    self.change(variable, to)?;
                }
                if let Some(after) = broken.filter(|_| trial.h == h) {
                    self.pass_break(after);
                    if change.is_none() {
                        self.change_at_break(&trial)?;
                    }
                }
                return Ok(());
            }
            self.rejected += 1;
            if let Some((variable, to)) = change {
                self.change(variable, to)?;
            }
        }
    }

    /// Changes the face at a break where a sign is lost there as far as tolerances tell: behind the break it may be lost too
    /// slowly to tell when.
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

    /// The element up to its first switch, none where that is at its beginning; the change there; and what screening finds
    /// of the element. Forces may have a kink at the switch, so that only the element up to it can be accurate.
    fn up_to_switch(&mut self, trial: Trial) -> Result<(Option<Trial>, Change, Screened), StepError> {
        let (mut trial, mut change) = (trial, None);
        for _ in 0..MOST_IN_A_ROW {
            let is_brief = trial.h <= TINY * self.usual || trial.h <= self.resolution(trial.h);
            let screened = match trial.violation {
                Some(violation) => Screened::Violated(violation),
                None if is_brief || trial.error > 1.0 => Screened::Proven,
                None => self.screen(&trial)?,
            };
            let Screened::Violated(violation) = screened else { return Ok((Some(trial), change, screened)) };
            match self.locate(trial, violation)? {
                (Some(shorter), found) => (trial, change) = (shorter, found),
                (None, found) => return Ok((None, found, Screened::Proven)),
            }
        }
        Ok((Some(trial), change, Screened::Open))
    }

    /// Moves a variable to another place, where a new segment begins.
    ///
    /// Where a force has a kink at the switch itself no face may hold for the time that rounding errors make: a tiny element,
    /// longer each time, is then made as it is, with the variable at its bound.
    fn change(&mut self, variable: usize, to: Activity) -> Result<(), StepError> {
        self.is_first = true;
        self.flips += 1;
        if self.flips > 2 * self.places.len() + 2 {
            self.flips = 0;
            let length = if self.unclear.0 == 0.0 { self.resolution(0.0) } else { LONGER * self.unclear.0 };
            self.unclear = (length, true);
            if length > TINY * self.usual {
                let outcome = "no face holds behind a switch";
                return Err(StepError::Unsolved { t: self.t, outcome, residual: f64::NAN });
            }
            if to == Activity::Inactive {
                return Ok(());
            }
        }
        self.places[variable] = to;
        Ok(())
    }

    /// Takes an element into the past.
    fn accept(&mut self, trial: &Trial, h: f64, is_kink: bool) {
        let m = self.places.len();
        let shape = &self.shapes[trial.shape];
        let n = shape.len();
        let end = if h >= self.end - self.t { self.end } else { self.t + h };
        // What rounding errors make of a face next to a switch is not told.
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
