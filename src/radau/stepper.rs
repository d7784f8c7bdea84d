//! One step after another: Jacobian, factors, stages, face, error, acceptance.

mod estimate;
mod preparation;
mod report;

pub use report::Variables;

use super::chattering::Chattering;
use super::consistent::Consistent;
use super::coupled::Shortened;
use super::dense_output::Step;
use super::error_control::{Controller, Rescaled};
use super::factors::Factors;
use super::newton_control::NewtonControl;
use super::progress::{Progress, SHORT};
use super::screening::{Between, LEAST};
use super::settings::{Cause, Settings, StageChoice, StepError};
use super::stage_vi::StageVi;
use super::stages::{Contraction, Newton, Stages, THETA};
use super::switches::{Located, Switching};
use super::system::System;
use super::tableau::Tableau;
use super::unseen::Unseen;
use hybrid::Breaks;
use problem::{Control, Dvi};

/// Counts of what a run did.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Counts {
    /// Accepted steps.
    pub accepted: u64,
    /// Rejected steps, by [`Cause::ALL`].
    rejected: [u64; Cause::ALL.len()],
}

impl Counts {
    /// Steps rejected for this cause.
    pub fn rejected(&self, cause: Cause) -> u64 {
        self.rejected[cause as usize]
    }
}

/// So many times a step along a curved face is halved, before its stages are solved without it.
const HALVINGS: usize = 12;
/// So many times a step is halved whose face is left at no point that can be found, before its stages are solved without it.
const SEARCHES: usize = 4;

/// A method with its tolerances.
pub(super) struct Method {
    pub(super) tableau: &'static Tableau,
    pub(super) tolerance: Rescaled,
}

/// Radau IIA on one problem.
pub struct Radau<'p> {
    pub(super) system: System<'p>,
    pub(super) settings: Settings,
    pub(super) methods: Vec<Method>,
    pub(super) current: usize,
    pub(super) control: NewtonControl,
    pub(super) stages: Stages,
    pub(super) factors: Factors,
    pub(super) factored: Option<f64>,
    jacobian: Freshness,
    pub(super) stage_vi: Option<StageVi>,
    pub(super) switching: Switching,
    pub(super) consistent: Option<Consistent>,
    contraction: Contraction,
    controller: Controller,
    pub(super) t: f64,
    /// What rounding took from `t`.
    pub(super) lag: f64,
    pub(super) y: Vec<f64>,
    end: f64,
    pub(super) h: f64,
    pub(super) last: Step,
    pub(super) last_method: usize,
    /// The size of the longest step so far.
    pub(super) longest: f64,
    /// The largest size of each unknown so far.
    pub(super) largest: Vec<f64>,
    pub(super) continues: bool,
    pub(super) jumped: Option<f64>,
    shortened: Shortened,
    /// Whether the present step was made shorter because screening proved no more of it.
    screened_short: bool,
    pub(super) breaks: Breaks,
    pub(super) chattering: Chattering,
    pub(super) unseen: Unseen,
    pub(super) progress: Progress,
    estimate: Vec<f64>,
    /// The jump of the slope of the states into the step at hand, times its size; empty where there is none to speak of.
    jump: Vec<f64>,
    embedded: Vec<f64>,
    shifted: Vec<f64>,
    /// Counters.
    pub counts: Counts,
}

/// What is known of the derivatives at hand.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Freshness {
    /// None, or none worth keeping.
    Stale,
    /// Of an earlier step, and good enough.
    Kept,
    /// Of this step.
    Fresh,
}

/// How the stages of an attempt came out.
enum Attempt {
    /// Solved, in so many Newton iterations; `coupled` over the stages, or on one face; with what screening found between
    /// them.
    Solved { h: f64, iterations: usize, coupled: bool, between: Option<Between> },
    /// To be done again with the step times this factor, and why.
    Failed(f64, Cause),
}

impl<'p> Radau<'p> {
    /// Prepares a run from `(t, x)` to `end`; finds the face of `K` and the variables there. Where `outside` asks to stop,
    /// long work on one step is given up, and the step fails.
    ///
    /// # Errors
    /// If something is not finite at the start, the start is inconsistent, or `outside` asks to stop.
    pub fn new(
        problem: &'p mut dyn Dvi,
        settings: Settings,
        t: f64,
        x: &[f64],
        end: f64,
        outside: &'p Control,
    ) -> Result<Self, StepError> {
        let mut system = System::new(problem, t, outside)?;
        let counts = match settings.stages {
            StageChoice::Fixed(s) => vec![s],
            StageChoice::Auto => vec![3, 5, 7],
        };
        let adaptive = settings.step.is_none();
        let methods: Vec<Method> = counts
            .iter()
            .map(|&s| Method { tableau: Tableau::of(s), tolerance: Rescaled::new(s, settings.rtol, adaptive) })
            .collect();
        let most_stages = counts.iter().copied().max().unwrap_or(1);
        let unknowns = system.unknowns;
        let mut y = vec![0.0; unknowns];
        y[..system.states].copy_from_slice(x);
        system.project(&mut y);
        let control = NewtonControl {
            weight: vec![0.0; unknowns],
            rounding: vec![0.0; unknowns],
            size: vec![0.0; unknowns],
            by_time: vec![0.0; unknowns - system.states],
            kappa: 0.0,
            most: 0,
            vi_tolerance: settings.vi_tolerance,
        };
        let mut stage_vi = None;
        if !system.bounded.is_empty() {
            let mut vi = StageVi::new(&system, most_stages, settings.vi_solver)?;
            let is_all = system.bounded.len() == unknowns - system.states;
            // A factorisation at the start tells: a multiplier of bounded variables is in no equation of its own.
            if !is_all && system.differentiate(t, &y) && !vi.eliminates(&mut system, methods[0].tableau, end - t) {
                system.keep_free(t)?;
                vi = StageVi::new(&system, most_stages, settings.vi_solver)?;
            }
            stage_vi = Some(vi);
        }
        let mut radau = Self {
            stages: Stages::new(most_stages, unknowns),
            switching: Switching::new(&system, &settings)?,
            factors: Factors::new(&system),
            consistent: Consistent::new(&system),
            stage_vi,
            estimate: vec![0.0; unknowns],
            jump: Vec::new(),
            embedded: vec![0.0; unknowns],
            shifted: vec![0.0; unknowns],
            system,
            settings,
            methods,
            current: 0,
            control,
            factored: None,
            jacobian: Freshness::Stale,
            contraction: Contraction::default(),
            controller: Controller::default(),
            t,
            lag: 0.0,
            y,
            end,
            h: 0.0,
            last: Step::default(),
            last_method: 0,
            longest: 0.0,
            largest: vec![0.0; unknowns],
            continues: false,
            jumped: None,
            shortened: Shortened::default(),
            screened_short: false,
            breaks: Breaks::new(t),
            chattering: Chattering::default(),
            unseen: Unseen::default(),
            progress: Progress::default(),
            counts: Counts::default(),
        };
        radau.check_finite()?;
        radau.h = radau.first_step();
        radau.start()?;
        radau.watch_sizes();
        Ok(radau)
    }

    /// The time left.
    pub(super) fn remaining(&self) -> f64 {
        (self.end - self.t) - self.lag
    }

    pub(super) fn tableau(&self) -> &'static Tableau {
        self.methods[self.current].tableau
    }

    /// Makes one accepted step.
    ///
    /// # Errors
    /// If the step size falls below what `t` or the settings allow, with the cause.
    pub fn step(&mut self) -> Result<(), StepError> {
        loop {
            if self.switching.is_accumulating() {
                // What is left between switches is too short for more stages to tell more of it.
                self.set_order(0);
            }
            let remaining = self.remaining();
            let Settings { step, min_step, max_step, .. } = self.settings;
            let mut h = step.unwrap_or(self.h.max(min_step)).min(max_step);
            if 1.000_1 * h >= remaining {
                h = remaining;
            } else if self.t + (h + self.lag) == self.t {
                return Err(StepError::StepTooSmall { t: self.t, h, least: 0.0, cause: Cause::Error });
            }
            let wished = h;
            h = self.up_to_break(h);
            if let Some(after) = self.breaks.after()
                && h <= 0.0
            {
                self.pass_break(after)?;
                continue;
            }
            let outcome = self.attempt(h)?;
            let (reached, iterations, coupled, between) = match outcome {
                Attempt::Solved { h, iterations, coupled, between } => (h, iterations, coupled, between),
                Attempt::Failed(factor, cause) => {
                    self.controller.surprise();
                    if self.jacobian == Freshness::Kept {
                        self.forget_jacobian();
                        // A fixed step has no other way out than derivatives of its own.
                        if self.settings.step.is_some() && self.jacobian == Freshness::Stale {
                            self.counts.rejected[cause as usize] += 1;
                            continue;
                        }
                    }
                    self.shrink(h, cause, |_| factor * h)?;
                    continue;
                }
            };
            if self.settings.step.is_some() {
                self.accept(reached, coupled, between);
                return self.end_step(reached < h);
            }
            let unlocated = if coupled { self.unlocated(reached) } else { None };
            if self.shortened.is_too_long(unlocated) {
                self.system.face.clone_from(&self.switching.before);
                self.shrink(reached, Cause::Error, |_| 0.25 * reached)?;
                continue;
            }
            let mut error = self.error(reached, coupled);
            if !coupled {
                error = error.max(self.constraint_error(reached));
            }
            let missed = if error < 1.0 && !coupled { self.missed(reached) } else { 0.0 };
            let is_missed = missed > 1.0;
            if is_missed {
                error = missed;
            }
            let (s, most) = (self.tableau().stages(), self.control.most);
            if error < 1.0 {
                let mut new = self.controller.accept(s, reached, error, iterations, most);
                // A step nearly as large as the last is not worth new factors.
                if !coupled && self.contraction.theta <= THETA && (1.0..=1.2).contains(&(new / reached)) {
                    new = reached;
                }
                // A step cut short by a switch or a break says nothing against the size that was wished for.
                let is_cut = self.switching.ends_at_switch() || self.breaks.after().is_some();
                self.h = if is_cut { wished } else { new };
                let is_short = !is_cut && reached < SHORT * h && !self.screened_short;
                let contraction = self.contraction;
                self.accept(reached, coupled, between);
                self.watch_progress(reached, is_short)?;
                self.watch_switches()?;
                self.watch_kinks()?;
                self.change_order(contraction);
                return self.end_step(reached < h);
            }
            self.switching.abandon();
            if coupled {
                self.system.face.clone_from(&self.switching.before);
            }
            let first = self.counts.accepted == 0;
            let seen = self.unseen.seen;
            self.shrink(reached, Cause::Error, |controller| match is_missed {
                // Up to where that begins.
                true if seen >= LEAST => controller.cut(seen * reached),
                true => controller.miss(s, reached, error.min(1e10), iterations, most),
                false => controller.reject(s, reached, error.min(1e10), iterations, most, first),
            })?;
        }
    }

    /// After a step, which may be `shorter` than was tried: goes on behind the break before which it ends.
    fn end_step(&mut self, shorter: bool) -> Result<(), StepError> {
        match self.breaks.after() {
            Some(after) if !shorter && !self.is_done() => self.pass_break(after),
            _ => Ok(()),
        }
    }

    /// Solves the stages of a step of size `h`, or of the shorter one that ends at a switch.
    fn attempt(&mut self, h: f64) -> Result<Attempt, StepError> {
        let mut size = h;
        let mut may_turn = true;
        self.screened_short = false;
        let (mut missed, mut proven) = (None, 0.0);
        let mut searches = if self.settings.step.is_some() { 0 } else { SEARCHES };
        for _ in 0..=self.system.bounded.len() + HALVINGS {
            self.prepare(size)?;
            self.predict(size);
            let (located, iterations) = match self.newton(size) {
                Newton::Converged { iterations, violated } => {
                    let violated = violated && self.is_violated_within(size, None);
                    let between = if violated || self.stage_vi.is_none() { None } else { Some(self.screen(size)) };
                    let violation = between.and_then(Between::violation).filter(|_| self.switching.locates());
                    if let Some(Between::ProvenUpTo(theta)) = between
                        && self.settings.step.is_none()
                        && self.switching.locates()
                    {
                        size *= theta;
                        self.screened_short = true;
                        continue;
                    }
                    if !violated && violation.is_none() {
                        return Ok(Attempt::Solved { h: size, iterations, coupled: false, between });
                    }
                    missed = between;
                    proven = violation.map_or(0.0, |(_, proven)| proven);
                    let mut located = self.locate(size, violation.map(|(theta, _)| theta))?;
                    // Of several switches within the step the stages need not show the first.
                    if matches!(located, Located::Nowhere)
                        && violation.is_none()
                        && self.switching.locates()
                        && let Some(first) = self.first_violation(size)?
                    {
                        proven = first.1;
                        located = self.locate(size, Some(first.0))?;
                    }
                    (located, iterations)
                }
                Newton::Slow(factor) if self.stage_vi.is_none() => return Ok(Attempt::Failed(factor, Cause::Slow)),
                Newton::Failed(cause) if self.stage_vi.is_none() => return Ok(Attempt::Failed(0.5, cause)),
                // A curved face may end where it cannot be followed any further: as far as it goes, then.
                Newton::Slow(_) | Newton::Failed(_) if self.system.is_curved() && self.switching.locates() => {
                    if std::mem::take(&mut may_turn) && self.system.turn_cones() {
                        self.factored = None;
                        continue;
                    }
                    self.predict(size);
                    match self.locate(size, None)? {
                        Located::Nowhere => {
                            size *= 0.5;
                            continue;
                        }
                        located => (located, self.control.most),
                    }
                }
                Newton::Slow(_) | Newton::Failed(_) => {
                    self.shortened.unfollowed();
                    break;
                }
            };
            match located {
                Located::At { h, between } => {
                    return Ok(Attempt::Solved { h, iterations, coupled: false, between: Some(between) });
                }
                Located::Now => {}
                Located::Behind(part) => {
                    size *= part;
                    self.screened_short = true;
                }
                // Up to shortly before it the step is proven.
                Located::Nowhere if proven >= LEAST && self.settings.step.is_none() && self.switching.locates() => {
                    size *= std::mem::take(&mut proven);
                    self.screened_short = true;
                }
                Located::Nowhere if searches > 0 && self.switching.locates() => {
                    searches -= 1;
                    size *= 0.5;
                }
                Located::Nowhere => break,
            }
        }
        self.predict(h);
        Ok(self.couple(h, missed))
    }

    /// Where screening first sees a violation in a step of size `h`, whose stages are solved again, and up to where it sees
    /// none for certain.
    fn first_violation(&mut self, h: f64) -> Result<Option<(f64, f64)>, StepError> {
        self.prepare(h)?;
        self.predict(h);
        if !matches!(self.newton(h), Newton::Converged { .. }) {
            return Ok(None);
        }
        Ok(self.screen(h).violation())
    }

    /// Newton's method on the present face.
    pub(super) fn newton(&mut self, h: f64) -> Newton {
        let tableau = self.tableau();
        let newton = self.stages.newton(
            &mut self.system,
            tableau,
            &mut self.factors,
            self.t,
            h,
            &self.y,
            &self.control,
            &mut self.contraction,
        );
        match newton {
            Newton::Converged { .. } if !self.are_stages_solved(h) => Newton::Failed(Cause::Diverged),
            newton => newton,
        }
    }

    /// Solves the stages with the VI coupled over them, from their present increments; where a violation was seen between
    /// them, it is still `missed`.
    fn couple(&mut self, h: f64, missed: Option<Between>) -> Attempt {
        let tableau = self.tableau();
        let Some(stage_vi) = &mut self.stage_vi else { return Attempt::Failed(0.5, Cause::Unsolved) };
        self.contraction = Contraction::default();
        self.switching.remember(&self.system.face);
        match stage_vi.solve(&mut self.system, tableau, &mut self.stages, self.t, h, &self.y, &self.control) {
            Ok(()) if !self.are_stages_solved(h) => {
                self.system.face.clone_from(&self.switching.before);
                Attempt::Failed(0.5, Cause::Diverged)
            }
            Ok(()) => {
                // On one face all over it is a step like any other, which may have gone over switches that no stage shows; where
                // these accumulate it is measured as a whole.
                let is_one_face = self.system.face.is_same(&self.switching.before);
                let is_alone = self.switching.locates() && self.accumulations() == 0;
                let is_screened = is_one_face && is_alone && self.settings.step.is_none();
                let between = missed.or_else(|| is_screened.then(|| self.screen(h)));
                Attempt::Solved { h, iterations: self.control.most, coupled: true, between }
            }
            Err(cause) => Attempt::Failed(0.5, cause),
        }
    }

    /// Makes the step at hand part of the trajectory.
    fn accept(&mut self, h: f64, coupled: bool, between: Option<Between>) {
        let n = self.system.unknowns;
        let s = self.tableau().stages();
        let face = if coupled { &self.switching.before } else { &self.system.face };
        self.last.set(self.t, h, &self.y, &self.stages.z[..s * n], face);
        self.last.is_smooth = !coupled;
        self.last.screened = between;
        self.last.unlocated = if coupled { self.unlocated(h) } else { None };
        self.shortened.accepted();
        self.last.slope.clear();
        self.last.end_slope.clear();
        if let Some(gamma) = self.tableau().gamma
            && self.settings.step.is_none()
            && !coupled
        {
            let states = self.system.states;
            self.last.slope.extend(self.estimate[..states].iter().map(|e| gamma * e));
            if self.settings.interpolated {
                self.last.set_end_slope(self.methods[self.current].tableau, states);
            }
        }
        self.last_method = self.current;
        self.longest = self.longest.max(h);
        if h >= self.remaining() {
            (self.t, self.lag) = (self.end, 0.0);
        } else {
            // The rounding errors of many short steps would else add up.
            let (t, step) = (self.t, h + self.lag);
            self.t = t + step;
            let taken = self.t - t;
            self.lag = (t - (self.t - taken)) + (step - taken);
        }
        let clock = if self.switching.ends_at_switch() { 8.0 * (self.t.abs() + h) / h } else { 0.0 };
        let ends = self.stages.z[(s - 1) * n..s * n].iter().zip(&mut self.control.rounding);
        for (y, (z, rounding)) in self.y.iter_mut().zip(ends) {
            *rounding = f64::EPSILON * (4.0 * y.abs().max(z.abs()) + clock * z.abs());
            *y += z;
        }
        self.counts.accepted += 1;
        self.continues = true;
        if !(self.system.constant_jacobian() || self.contraction.theta <= THETA) {
            self.jacobian = Freshness::Stale;
        } else if self.jacobian == Freshness::Fresh {
            self.jacobian = Freshness::Kept;
        }
        self.settle(coupled);
        self.watch_sizes();
    }

    /// Takes the present unknowns into their largest sizes.
    fn watch_sizes(&mut self) {
        self.largest.iter_mut().zip(&self.y).for_each(|(largest, y)| *largest = largest.max(y.abs()));
    }

    /// Takes more stages or fewer from the next step on, where the number is free, after a step with this contraction.
    fn change_order(&mut self, contraction: Contraction) {
        if self.methods.len() == 1 {
            return;
        }
        let wish = self.controller.order_change(contraction);
        self.set_order(self.current.saturating_add_signed(wish).min(self.methods.len() - 1));
    }

    fn set_order(&mut self, new: usize) {
        if new != self.current {
            self.current = new;
            self.factored = None;
            self.contraction = Contraction::default();
            self.controller.order_changed();
        }
    }

    /// Makes the next attempt smaller than `h`; fails where the step is fixed or would be too small to go on with.
    fn shrink(&mut self, h: f64, cause: Cause, smaller: impl Fn(&mut Controller) -> f64) -> Result<(), StepError> {
        self.counts.rejected[cause as usize] += 1;
        self.progress.rejected(cause);
        if self.system.outside.poll().is_some() {
            return Err(StepError::Interrupted { t: self.t });
        }
        if self.settings.step.is_some() {
            self.check_evaluation()?;
            self.check_contradiction(cause)?;
            return Err(StepError::NewtonFailed { t: self.t, h });
        }
        let min_step = self.settings.min_step;
        self.h = smaller(&mut self.controller).max(if h > min_step { min_step } else { 0.0 });
        let least = min_step.max(10.0 * f64::EPSILON * self.t.abs()).max(f64::MIN_POSITIVE);
        if self.h < least || !self.h.is_finite() {
            // What the last, shortest attempt met says more than that it failed.
            self.check_evaluation()?;
            self.check_contradiction(cause)?;
            if let Some(kink) = self.collapsed_at() {
                return Err(StepError::Chattering { t: self.t, kink });
            }
            let least = if self.h < min_step { min_step } else { 0.0 };
            return Err(StepError::StepTooSmall { t: self.t, h: self.h, least, cause });
        }
        Ok(())
    }

    /// Whether the last variational inequality has no solution for a reason that can be named.
    pub(super) fn check_contradiction(&self, cause: Cause) -> Result<(), StepError> {
        match self.stage_vi.as_ref().and_then(|vi| vi.contradiction).filter(|_| cause == Cause::Unsolved) {
            Some(variable) => {
                Err(StepError::NoSolution { t: self.t, variable, linear: self.system.constant_jacobian() })
            }
            None => Ok(()),
        }
    }
}
