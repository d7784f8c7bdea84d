//! The step loop: Jacobian, factors, stages, face, error, acceptance.

mod attempt;
mod estimate;
mod preparation;
mod remade;
mod report;
mod ripple;

use attempt::Attempt;
use estimate::Estimates;
pub use report::{LastStep, Variables};

use super::chattering::Chattering;
use super::clock::Clock;
use super::consistent_variables::ConsistentVariables;
use super::coupled::Shortened;
use super::dense_output::Step;
use super::error_control::Controller;
use super::factors::Factors;
use super::newton_control::NewtonControl;
use super::orders::Orders;
use super::progress::{Progress, SHORT};
use super::screening::{Between, LEAST};
use super::settings::{RejectionCause, Settings, StepError};
use super::stage_vi::StageVi;
use super::stages::{Contraction, Stages, THETA};
use super::switches::Switching;
use super::system::System;
use super::tableau::Tableau;
use super::unseen::Unseen;
use hybrid::Breaks;
use problem::{Control, Dvi};

/// Counts of the steps of a run.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Counts {
    /// Accepted steps.
    pub accepted: u64,
    /// Rejected steps, in the order of [`RejectionCause::ALL`].
    rejected: [u64; RejectionCause::ALL.len()],
}

impl Counts {
    /// Steps rejected for this cause.
    pub fn rejected(&self, cause: RejectionCause) -> u64 {
        self.rejected[cause as usize]
    }
}

/// Radau IIA on one problem.
pub struct Radau<'p> {
    pub(super) system: System<'p>,
    pub(super) settings: Settings,
    pub(super) orders: Orders,
    pub(super) control: NewtonControl,
    pub(super) stages: Stages,
    pub(super) factors: Factors,
    pub(super) factored: Option<f64>,
    jacobian: Freshness,
    pub(super) stage_vi: Option<StageVi>,
    pub(super) switching: Switching,
    pub(super) consistent: Option<ConsistentVariables>,
    contraction: Contraction,
    controller: Controller,
    pub(super) clock: Clock,
    pub(super) y: Vec<f64>,
    pub(super) h: f64,
    pub(super) last: Step,
    pub(super) extent: Extent,
    pub(super) continues: bool,
    pub(super) jumped: Option<f64>,
    shortened: Shortened,
    /// Whether the present step was shortened to the part of it that screening proved.
    screened_short: bool,
    pub(super) breaks: Breaks,
    pub(super) chattering: Chattering,
    pub(super) unseen: Unseen,
    pub(super) progress: Progress,
    estimates: Estimates,
    /// Counters.
    pub counts: Counts,
}

/// Largest step size and largest magnitudes of the unknowns in a run so far.
pub(super) struct Extent {
    /// The size of the longest step.
    pub longest: f64,
    /// The largest size of each unknown.
    pub largest: Vec<f64>,
}

impl Extent {
    fn watch(&mut self, y: &[f64]) {
        self.largest.iter_mut().zip(y).for_each(|(largest, y)| *largest = largest.max(y.abs()));
    }
}

/// Status of the current derivatives.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Freshness {
    /// Not evaluated, or not worth keeping.
    Stale,
    /// From an earlier step, and still good enough.
    Kept,
    /// From the present step.
    Fresh,
}

impl<'p> Radau<'p> {
    /// Prepares a run from `(t, x)` to `end`: finds the face of `K` and the variables there. If the caller asks to stop
    /// through `outside`, long work on one step is abandoned, and the step fails.
    ///
    /// # Errors
    /// If a value is not finite at the start, the start is inconsistent, or the caller asks to stop.
    pub fn new(
        problem: &'p mut dyn Dvi,
        settings: Settings,
        t: f64,
        x: &[f64],
        end: f64,
        outside: &'p Control,
    ) -> Result<Self, StepError> {
        let mut system = System::new(problem, t, outside)?;
        let orders = Orders::new(&settings);
        let most_stages = orders.most_stages();
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
            // A factorisation at the start decides: a multiplier of bounded variables occurs in no equation of its own.
            if !is_all && system.differentiate(t, &y) && !vi.eliminates(&mut system, orders.current().tableau, end - t)
            {
                system.keep_free(t)?;
                vi = StageVi::new(&system, most_stages, settings.vi_solver)?;
            }
            stage_vi = Some(vi);
        }
        let mut radau = Self {
            stages: Stages::new(most_stages, unknowns),
            switching: Switching::new(&system, &settings)?,
            factors: Factors::new(&system),
            consistent: ConsistentVariables::new(&system),
            stage_vi,
            estimates: Estimates::new(unknowns),
            system,
            settings,
            orders,
            control,
            factored: None,
            jacobian: Freshness::Stale,
            contraction: Contraction::default(),
            controller: Controller::default(),
            clock: Clock::new(t, end),
            y,
            h: 0.0,
            last: Step::default(),
            extent: Extent { longest: 0.0, largest: vec![0.0; unknowns] },
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
        radau.extent.watch(&radau.y);
        Ok(radau)
    }

    pub(super) fn tableau(&self) -> &'static Tableau {
        self.orders.current().tableau
    }

    /// Makes one accepted step.
    ///
    /// # Errors
    /// If the step size falls below the limit of `t` or of the settings, with the cause.
    pub fn step(&mut self) -> Result<(), StepError> {
        loop {
            // Between switches that accumulate, steps are too short to gain from more stages.
            if self.switching.is_accumulating() && self.orders.take_fewest() {
                self.forget_order();
            }
            let remaining = self.clock.remaining();
            let Settings { step, min_step, max_step, .. } = self.settings;
            let mut h = step.unwrap_or(self.h.max(min_step)).min(max_step);
            if 1.000_1 * h >= remaining {
                h = remaining;
            } else if !self.clock.resolves(h) {
                return Err(StepError::StepTooSmall { t: self.clock.t, h, least: 0.0, cause: RejectionCause::Error });
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
                        // With a fixed step, derivatives at this step are the only remedy.
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
                self.shrink(reached, RejectionCause::Error, |_| 0.25 * reached)?;
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
                // If a step is nearly as large as the last, new factors do not pay off.
                if !coupled && self.contraction.theta <= THETA && (1.0..=1.2).contains(&(new / reached)) {
                    new = reached;
                }
                // A step cut at a switch or a breakpoint is no reason to reduce the size that was wished for.
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
            self.shrink(reached, RejectionCause::Error, |controller| match is_missed {
                // Cut the step where the missed variation begins.
                true if seen >= LEAST => controller.cut(seen * reached),
                true => controller.miss(s, reached, error.min(1e10), iterations, most),
                false => controller.reject(s, reached, error.min(1e10), iterations, most, first),
            })?;
        }
    }

    /// Ends a step: unless it is `shorter` than attempted, continues behind the breakpoint before which it ends.
    fn end_step(&mut self, shorter: bool) -> Result<(), StepError> {
        match self.breaks.after() {
            Some(after) if !shorter && !self.is_done() => self.pass_break(after),
            _ => Ok(()),
        }
    }

    /// Appends the present step to the trajectory.
    fn accept(&mut self, h: f64, coupled: bool, between: Option<Between>) {
        let n = self.system.unknowns;
        let s = self.tableau().stages();
        let face = if coupled { &self.switching.before } else { &self.system.face };
        self.last.set(self.clock.t, h, &self.y, &self.stages.z[..s * n], face);
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
            self.last.slope.extend(self.estimates.error[..states].iter().map(|e| gamma * e));
            if self.settings.interpolated {
                self.last.set_end_slope(self.orders.current().tableau, states);
            }
        }
        self.orders.accept();
        self.extent.longest = self.extent.longest.max(h);
        // A variable may be large between two switches at which it is zero.
        for i in 0..s {
            self.extent.watch(self.stages.stage(&self.y, i));
        }
        self.clock.advance(h);
        let clock = if self.switching.ends_at_switch() { 8.0 * (self.clock.t.abs() + h) / h } else { 0.0 };
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
        self.update_face(coupled);
        self.extent.watch(&self.y);
    }

    /// Changes the number of stages from the next step on, if it may vary, after a step with this contraction.
    fn change_order(&mut self, contraction: Contraction) {
        if self.orders.are_several() {
            let wish = self.controller.order_change(contraction);
            if self.orders.change(wish) {
                self.forget_order();
            }
        }
    }

    /// Discards data that are valid for one number of stages only.
    fn forget_order(&mut self) {
        self.factored = None;
        self.contraction = Contraction::default();
        self.controller.order_changed();
    }

    /// Reduces the next attempt below `h`; fails if the step size is fixed or would become too small.
    fn shrink(
        &mut self,
        h: f64,
        cause: RejectionCause,
        smaller: impl Fn(&mut Controller) -> f64,
    ) -> Result<(), StepError> {
        self.counts.rejected[cause as usize] += 1;
        self.progress.rejected(cause);
        if self.system.outside.poll().is_some() {
            return Err(StepError::Interrupted { t: self.clock.t });
        }
        if self.settings.step.is_some() {
            self.check_evaluation()?;
            self.check_contradiction(cause)?;
            return Err(StepError::NewtonFailed { t: self.clock.t, h });
        }
        let min_step = self.settings.min_step;
        self.h = smaller(&mut self.controller).max(if h > min_step { min_step } else { 0.0 });
        let least = min_step.max(10.0 * f64::EPSILON * self.clock.t.abs()).max(f64::MIN_POSITIVE);
        if self.h < least || !self.h.is_finite() {
            // The reason for the failure of the last, shortest attempt is more informative than the failure itself.
            self.check_evaluation()?;
            self.check_contradiction(cause)?;
            if let Some(kink) = self.collapsed_at() {
                return Err(StepError::Chattering { t: self.clock.t, kink });
            }
            let least = if self.h < min_step { min_step } else { 0.0 };
            return Err(StepError::StepTooSmall { t: self.clock.t, h: self.h, least, cause });
        }
        Ok(())
    }

    /// Fails if the inequality of one variable shows that the last variational inequality has no solution.
    pub(super) fn check_contradiction(&self, cause: RejectionCause) -> Result<(), StepError> {
        match self.stage_vi.as_ref().and_then(|vi| vi.contradiction).filter(|_| cause == RejectionCause::Unsolved) {
            Some(variable) => {
                Err(StepError::NoSolution { t: self.clock.t, variable, linear: self.system.constant_jacobian() })
            }
            None => Ok(()),
        }
    }
}
