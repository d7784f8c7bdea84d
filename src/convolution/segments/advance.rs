//! Advances element by element: its length follows from the error and from switches in it, the active set from the
//! switches.

use super::screening::Screened;
use super::trial::Trial;
use super::{Activity, Segments, Switch};
use crate::stepper::StepError;

/// Relative length of a tiny element, which contributes nothing to a mean over time: the square root of the rounding
/// unit. Its share of the mean is its length, while rounding hides a change of sign along it by a fraction inversely
/// proportional to its length; a longer limit would let errors into the mean, a shorter one would take rounding for
/// switches.
pub(super) const TINY: f64 = 1.5e-8;
/// Decay of the usual size towards shorter elements, a decimal digit in twenty-two elements. With immediate decay no
/// element of a shrinking series would be tiny relative to its predecessor; with hardly any, all elements would be tiny
/// after a stretch on which the solution hardly varies.
const FORGET: f64 = 0.9;
/// Safety factor of the step size, and least and largest ratio of an element to the last (Hairer, Norsett and Wanner
/// 1993, II.4): an estimate of the leading term of the error does not extend to very different lengths.
const SAFETY: f64 = 0.9;
const LEAST: f64 = 0.1;
const MOST: f64 = 2.5;
/// Growth of successive elements on which no active set holds: eight of them lead from the resolution of time to
/// `TINY`. A smaller factor would make more such elements, a larger one longer ones than necessary.
const LONGER: f64 = 8.0;
/// Largest number of successive rejections: each at least halves the element, and doubles have 52 binary digits.
const MOST_IN_A_ROW: u32 = 52;

/// Largest number of repetitions of an element, each at most half as long, because it is not proven free of switches. A
/// judgement: with fewer, elements count as unproven that shorter ones would have proven; with more, elements that
/// cannot be proven, where a monitor touches zero, waste as many trials.
const SHORTENED: u32 = 3;

/// A variable with its new activity.
type Change = Option<(usize, Activity)>;

impl Segments<'_> {
    /// Makes the next element, before the end of the run.
    ///
    /// # Errors
    /// If values are not finite, a set is empty, no solution is found, or on interruption.
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
            // The last two elements share the remaining time.
            let is_last = wanted >= left || left <= 2.0 * self.resolution(left);
            let h = if is_last { left } else { wanted.min(0.5 * left).max(wanted.min(left - wanted)) };
            let (h, broken) = self.up_to_break(h);
            let trial = self.trial(h)?;
            let is_tiny = h <= TINY * self.usual || h <= self.resolution(h);
            if self.kinks > MOST_IN_A_ROW || in_a_row > MOST_IN_A_ROW {
                let outcome = "the error is too large for any length of an element";
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

    /// Changes the active set at a break if a monitor is zero there within the tolerances: behind the break it may
    /// change its sign too slowly to be located.
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

    /// The element up to its first switch, `None` if that is at its beginning; the change of activity; and the result
    /// of screening. Forces may have a kink at the switch, so that only the element up to it is accurate.
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

    /// Accepts an element and appends it to the past.
    fn accept(&mut self, trial: &Trial, h: f64, is_kink: bool) {
        let m = self.places.len();
        let shape = &self.shapes[trial.shape];
        let n = shape.len();
        let end = if h >= self.end - self.t { self.end } else { self.t + h };
        // Changes of the active set by rounding next to a switch are not reported.
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
