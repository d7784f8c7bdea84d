//! The step loop: Jacobian, factors, stages, face, error, acceptance.

mod automaton;
mod estimate;
mod one_step;
mod preparation;
mod report;
mod ripple;

use automaton::Trial;
use estimate::Estimates;
pub use one_step::Saved;
pub use report::{End, LastStep, Variables};

use super::chattering::Chattering;
use super::clock::Clock;
use super::consistent_variables::ConsistentVariables;
use super::dense_output::Step;
use super::error_control::Controller;
use super::factors::Factors;
use super::newton_control::NewtonControl;
use super::orders::Orders;
use super::progress::Progress;
use super::settings::{RejectionCause, Settings, StepError};
use super::stage_vi::StageVi;
use super::stages::{Contraction, Stages, THETA};
use super::start::Jump;
use super::switches::Switching;
use super::system::System;
use super::tableau::Tableau;
use super::unseen::Unseen;
use hybrid::Breaks;
use problem::{Control, Dvi};

/// Counts of the steps of a run.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Counts {
    /// Number of accepted steps of the run.
    pub accepted: u64,
    /// Numbers of rejected steps by cause, in the order of [`RejectionCause::ALL`].
    rejected: [u64; RejectionCause::ALL.len()],
}

impl Counts {
    /// Returns the number of attempts at steps that were rejected for `cause`.
    pub fn rejected(&self, cause: RejectionCause) -> u64 {
        self.rejected[cause as usize]
    }
}

/// A run of Radau IIA on one problem.
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
    pub(super) jumps: Vec<Jump>,
    pub(super) breaks: Breaks,
    pub(super) chattering: Chattering,
    pub(super) unseen: Unseen,
    pub(super) progress: Progress,
    estimates: Estimates,
    /// Numbers of accepted and rejected steps of the run.
    pub counts: Counts,
}

/// Largest step size and largest magnitudes of the unknowns in a run so far.
#[derive(Clone)]
pub(super) struct Extent {
    /// The size of the longest step of the run so far.
    pub longest: f64,
    /// The largest magnitude of each unknown in the run so far.
    pub largest: Vec<f64>,
}

impl Extent {
    fn watch(&mut self, y: &[f64]) {
        self.largest.iter_mut().zip(y).for_each(|(largest, y)| *largest = largest.max(y.abs()));
    }
}

/// Status of the stored derivatives of the rows of the problem.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Freshness {
    /// Stale: derivatives that are not evaluated, or not worth keeping.
    Stale,
    /// Kept: derivatives from an earlier step that are still good enough.
    Kept,
    /// Fresh: derivatives evaluated in the present step.
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
            // A factorisation at the start decides whether the unbounded variables can be eliminated while the
            // bounded ones are fixed. They cannot if one of them is a multiplier of a constraint on bounded
            // variables, which occurs in no equation of its own.
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
            jumps: Vec::new(),
            breaks: Breaks::new(t),
            chattering: Chattering::default(),
            unseen: Unseen::default(),
            progress: Progress::default(),
            counts: Counts::default(),
        };
        radau.check_finite()?;
        radau.h = radau.first_step();
        radau.start(t)?;
        radau.extent.watch(&radau.y);
        Ok(radau)
    }

    pub(super) fn tableau(&self) -> &'static Tableau {
        self.orders.current().tableau
    }

    /// Appends the present step, which is accepted, to the trajectory.
    fn append(&mut self, &Trial { h, coupled, is_one_face, between, .. }: &Trial, ends_at_switch: bool) {
        let n = self.system.unknowns;
        let s = self.tableau().stages();
        let face = if coupled { &self.switching.before } else { &self.system.face };
        self.last.set(self.clock.t, h, &self.y, &self.stages.z[..s * n], face);
        self.last.is_smooth = is_one_face;
        self.last.screened = between;
        self.last.unlocated = if coupled { self.unlocated(h) } else { None };
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
        // Record magnitudes at all stages: a variable may be large between two switches at which it is zero.
        for i in 0..s {
            self.extent.watch(self.stages.stage(&self.y, i));
        }
        self.clock.advance(h);
        let clock = if ends_at_switch { 8.0 * (self.clock.t.abs() + h) / h } else { 0.0 };
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
    }

    /// Changes the number of stages from the next step on, if it may vary, by the contraction of Newton's method in
    /// the last step.
    fn change_order(&mut self, contraction: Contraction) {
        if self.orders.are_several() {
            let wish = self.controller.order_change(contraction);
            if self.orders.change(wish) {
                self.forget_order();
            }
        }
    }

    /// Discards data that are valid for the last number of stages only.
    pub(super) fn forget_order(&mut self) {
        self.factored = None;
        self.contraction = Contraction::default();
        self.controller.order_changed();
    }

    /// Reduces the size of the next attempt at a step below `h`; fails if the step size is fixed or would become too
    /// small.
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
