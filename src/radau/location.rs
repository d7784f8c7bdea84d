//! Location of the point within a step at which a monitor of the face becomes negative.
//!
//! The zero of the monitor on the collocation polynomial is a first guess. The step is then solved again with its size
//! as the unknown, so that the end of the step, which has the full order, is the switch. (Interpolation alone would
//! give order `s + 1`.)

use super::crossings::Crossing;
use super::face::{Monitor, monitors};
use super::screening::Between;
use super::settings::StepError;
use super::stages::Newton;
use super::stepper::Radau;
use super::switches::{Switching, turned};

/// Position of the sign change of a violated monitor (event function) in a step.
pub(super) enum EventTime {
    /// The sign change is at the end of a step of size `h`, whose stages are solved; `between` is the result of its
    /// screening.
    At { h: f64, between: Between },
    /// The sign change is at the beginning of the step: the face has been changed there, and the step should be
    /// attempted again.
    Now,
    /// No monitor changes sign up to this fraction of the step, as screening of the step proves; a switch before the
    /// located one may follow.
    Behind(f64),
    /// The sign change of the monitor was not found, or not searched for.
    Nowhere,
}

/// Distance from its bracket on the collocation polynomial at which a switch may lie once the stages are solved
/// again, relative to the length of the bracket.
const SLACK: f64 = 0.25;
/// Maximum number of switches (changes of the active face of `K`) located within one step, each of them earlier than
/// the one located before.
const ROUNDS: usize = 8;
/// Maximum number of solves of the stages to locate one switch.
const SOLVES: usize = 12;
/// Two values of a monitor determine its slope, to within a quarter, if they differ by `TOLD` times its noise, or if
/// their step sizes differ by the fraction `APART`, over which noise hardly affects the slope. Other pairs may not even
/// determine its sign. A monitor within `TOLD` times its noise that approaches zero no further counts as zero.
const TOLD: f64 = 8.0;
const APART: f64 = 1e-7;

impl Radau<'_> {
    /// Locates the first sign change of a violated monitor (event function) of the present step, of size `h`. At
    /// `hidden_crossing`, a fraction of the step, a monitor is violated that need not be violated at any stage.
    pub(super) fn locate_switch(&mut self, h: f64, mut hidden_crossing: Option<f64>) -> Result<EventTime, StepError> {
        if !self.switching.locates() {
            return Ok(EventTime::Nowhere);
        }
        let mut size = h;
        let (mut solves, mut rounds) = (0, 0);
        // Each round takes the earliest sign change on the current polynomial; another round is needed if the step
        // that ends at this sign change shows an earlier one of another variable.
        while let Some(crossing) = self.earliest(size, hidden_crossing.map(|theta| theta * h / size)) {
            let least = 1e3 * f64::EPSILON * self.clock.t.abs().max(size);
            // A monitor that crosses zero at the located end of the step, to within the rounding of time, crosses
            // together with the monitor for which that end was located.
            let is_end = solves > 0 && (1.0 - crossing.theta) * size <= self.clock.rounding(size);
            let end = if is_end {
                size
            } else if crossing.theta * size <= least {
                0.0
            } else {
                let Some(end) = self.solve_for_end(&crossing, size, &mut solves)? else {
                    return Ok(EventTime::Nowhere);
                };
                end
            };
            if end <= least {
                self.switching.remember(&self.system.face);
                let changed = self.choose_face(size) && !self.switching.before.is_same(&self.system.face)
                    || self.choose_face_beyond_noise(size);
                self.switching.record(self.clock.t, &self.system.set, &self.system.face, &[]);
                self.restart();
                return Ok(if changed { EventTime::Now } else { EventTime::Nowhere });
            }
            size = end;
            rounds += 1;
            if rounds == ROUNDS {
                return Ok(EventTime::Nowhere);
            }
            if hidden_crossing.is_some() {
                solves = solves.min(1);
            }
            if !is_end && self.is_violated_within(size, Some(&crossing)) {
                continue;
            }
            let between = self.screen_step(size);
            // In its first step on a new face, a run may have to bring the states onto the equations of that face; a
            // violation of a monitor in between is no reason to leave the face at once.
            match between {
                Between::Violated { theta, .. } if self.continues || self.rises_before(theta, size) => {
                    hidden_crossing = Some(theta * size / h);
                }
                Between::ProvenUpTo(theta) if self.settings.step.is_none() => {
                    return Ok(EventTime::Behind(theta * size / h));
                }
                between => {
                    self.switching.remember(&self.system.face);
                    return Ok(EventTime::At { h: size, between });
                }
            }
        }
        Ok(EventTime::Nowhere)
    }

    /// Solves the step again with its size as the unknown, so that one monitor (event function) is zero at its end.
    /// Returns the size, or `None` if the stages cannot be solved or the iteration on the size fails.
    fn solve_for_end(
        &mut self,
        crossing: &Crossing,
        mut size: f64,
        solves: &mut usize,
    ) -> Result<Option<f64>, StepError> {
        let longest = 1.5 * size;
        // If a monitor has several zeros over the step, only the zero in the bracket of its sign change is sought.
        let slack = |(begin, end): (f64, f64)| SLACK * (end - begin);
        let mut bracket = crossing.bracket.map(|part| ((part.0 - slack(part)) * size, (part.1 + slack(part)) * size));
        let mut trial = crossing.theta * size;
        let mut slope = crossing.slope;
        let mut last: Option<(f64, f64)> = None;
        while *solves < SOLVES && trial > 0.0 && trial < longest {
            *solves += 1;
            self.prepare(trial)?;
            self.stages.resample(self.tableau(), trial / size);
            let before = std::mem::replace(&mut size, trial);
            match self.stages_on_face(size) {
                Some(true) => {}
                Some(false) => {
                    // The trial step passes the end of the active face: reduce it towards the last step size for which
                    // all stages were on the face.
                    let reached = last.map_or(0.0, |(h, _)| h);
                    trial = reached + 0.5 * (size - reached);
                    continue;
                }
                // Behind the end of the active face its equations need not have a solution: reduce the step in the
                // same way.
                None => {
                    let reached = last.map_or(0.0, |(h, _)| h);
                    trial = reached + 0.5 * (size - reached);
                    self.predict(size);
                    continue;
                }
            }
            let Some(Monitor { value, noise }) = self.monitor_at(crossing, size) else { return Ok(None) };
            if let Some((h, old)) = last
                && ((size - h).abs() > APART * size || (value - old).abs() > TOLD * noise)
            {
                slope = (value - old) / (size - h);
            }
            last = Some((size, value));
            let correction = value / slope;
            let rounding = self.clock.rounding(size);
            let stalled = (size - before).abs() <= correction.abs() && value.abs() <= TOLD * noise;
            if correction.abs() <= rounding || stalled {
                return Ok(Some(size));
            }
            if value.abs() <= 0.1 * noise {
                return Ok(Some(self.extend(crossing, size, value, correction)));
            }
            trial = size - correction;
            if let Some((shortest, longest)) = &mut bracket {
                let end = if value > 0.0 { shortest } else { longest };
                *end = size;
            }
            if let Some((shortest, longest)) = bracket.filter(|part| !(trial > part.0 && trial < part.1)) {
                trial = 0.5 * (shortest + longest);
            }
        }
        Ok(None)
    }

    /// Extends or shortens the present step, of size `h`, along its collocation polynomial to the zero of the monitor
    /// of `crossing`, whose `value` is within noise, so that the zero is at a distance of about `correction`; returns
    /// the new size. Other variables that switch at the same time then err by rounding only, and not by the tolerance
    /// of the search.
    fn extend(&mut self, crossing: &Crossing, h: f64, value: f64, correction: f64) -> f64 {
        let theta = 1.0 - correction / h;
        // Far outside its step the collocation polynomial is meaningless.
        if !(0.5..=1.5).contains(&theta) {
            return h;
        }
        let mut monitors = std::mem::take(&mut self.switching.monitors);
        self.monitors_at(theta, h, &mut monitors);
        let left = monitors.get(crossing.index).map_or(value, |monitor| monitor.value);
        self.switching.monitors = monitors;
        // Take the secant through both values of the monitor: in this way the error of the polynomial behind its last
        // stage has an effect of second order only.
        let end = h - correction * value / (value - left);
        // A secant through values of the monitor that differ by noise only may lead to any time.
        if left.is_nan() || left.abs() > 0.5 * value.abs() || !end.is_finite() {
            return h;
        }
        self.stages.resample(self.tableau(), end / h);
        end
    }

    /// Solves the stages of a step of size `h` on the present face by Newton's method or, if that fails on a curved
    /// face, with the variational inequality at every stage, which requires only that the step does not pass the end
    /// of the face. Returns whether the step stays on the face, or `None` if neither method solves the stages.
    fn stages_on_face(&mut self, h: f64) -> Option<bool> {
        if matches!(self.newton(h), Newton::Converged { .. }) {
            return Some(true);
        }
        if !self.system.is_curved() {
            return None;
        }
        self.predict(h);
        let face = self.system.face.clone();
        let tableau = self.tableau();
        let vi = self.stage_vi.as_mut()?;
        let solved = vi.solve(&mut self.system, tableau, &mut self.stages, self.clock.t, h, &self.y, &self.control);
        let is_same = self.system.face.is_same(&face);
        self.system.face = face;
        if solved.is_err() {
            return None;
        }
        let states = self.system.states;
        let end = self.stages.stage(&self.y, tableau.stages() - 1);
        Some(is_same && turned(&self.system, &self.system.face, &self.y[states..], &end[states..]).is_empty())
    }

    /// Whether a monitor, other than the one that ends the step, is violated at a stage of the present step, of size
    /// `h`. Variables that hidden constraints determine are replaced by consistent ones: their stage values are
    /// accurate only to order `s`, the number of stages, and may leave their bounds while the consistent values do
    /// not.
    pub(super) fn is_violated_within(&mut self, h: f64, end: Option<&Crossing>) -> bool {
        let tableau = self.tableau();
        (0..tableau.stages()).any(|i| {
            let t = self.clock.t + tableau.c[i] * h;
            self.switching.scratch.copy_from_slice(self.stages.stage(&self.y, i));
            let Switching { inside, scratch, monitors: values, .. } = &mut self.switching;
            if let Some(consistent) = &mut self.consistent
                && consistent.is_cheap()
                && !inside.tells_all(&self.system)
            {
                consistent.solve(&mut self.system, &self.control, t, scratch);
            }
            if !self.system.evaluate(t, scratch) {
                return true;
            }
            monitors(&mut self.system, &self.control, scratch, values);
            let mut others = values.iter().enumerate().filter(|(index, _)| end.is_none_or(|end| *index != end.index));
            others.any(|(_, monitor)| monitor.is_violated())
        })
    }

    /// Returns the monitor of `crossing` at the end of the present step, with consistent variables: the stage values
    /// of variables would give the time of the switch only to order `s`, the number of stages.
    fn monitor_at(&mut self, crossing: &Crossing, h: f64) -> Option<Monitor> {
        let y = self.stages.stage(&self.y, self.tableau().stages() - 1);
        self.switching.scratch.copy_from_slice(y);
        if let Some(consistent) = &mut self.consistent {
            consistent.solve(&mut self.system, &self.control, self.clock.t + h, &mut self.switching.scratch);
        }
        self.system.evaluate(self.clock.t + h, &self.switching.scratch);
        let Switching { scratch, monitors: values, .. } = &mut self.switching;
        monitors(&mut self.system, &self.control, scratch, values);
        values.get(crossing.index).copied()
    }
}
