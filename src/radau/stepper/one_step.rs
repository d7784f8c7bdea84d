//! Radau IIA as a one-step method: queries of a run between steps, the repetition of its last step, and points to
//! which the run can return.

use super::{Counts, Extent, Freshness, Radau};
use crate::chattering::Chattering;
use crate::clock::Clock;
use crate::dense_output::Step;
use crate::error_control::Controller;
use crate::face::ActiveFace;
use crate::orders::Orders;
use crate::progress::Progress;
use crate::settings::{RejectionCause, Settings, StageChoice, StepError};
use crate::stages::{Contraction, Newton};
use crate::switches::History;
use hybrid::{Breaks, OneStep};
use numerics::Interval;

/// The state of a run at a time to which it can return.
#[derive(Clone)]
pub struct Saved {
    clock: Clock,
    y: Vec<f64>,
    h: f64,
    last: Step,
    face: ActiveFace,
    rounding: Vec<f64>,
    orders: Orders,
    controller: Controller,
    extent: Extent,
    continues: bool,
    jumped: Option<f64>,
    breaks: Breaks,
    history: History,
    /// The number of recorded switches not yet taken by the caller at the saved point.
    switches: usize,
    /// The number of recorded jumps not yet taken by the caller at the saved point.
    jumps: usize,
    chattering: Chattering,
    progress: Progress,
    counts: Counts,
}

impl OneStep for Radau<'_> {
    type Error = StepError;
    type Saved = Saved;

    fn order(&self) -> usize {
        2 * self.tableau().stages() - 1
    }

    fn t(&self) -> f64 {
        self.clock.t
    }

    /// Returns the unknowns `y = (x, z)` at the time reached.
    fn y(&self) -> &[f64] {
        &self.y
    }

    fn is_done(&self) -> bool {
        self.clock.is_done()
    }

    fn next_step(&self) -> f64 {
        self.h
    }

    /// Makes one accepted step, with the transition to the next face at its end; fails if the step size falls below the
    /// limit of `t` or of the settings, with the cause.
    fn step(&mut self) -> Result<(), StepError> {
        hybrid::advance(self)
    }

    fn begin(&self) -> f64 {
        self.last.t
    }

    /// Evaluates the unknowns `y` at time `t` within the last step: the states from the collocation polynomial, with
    /// consistent variables; at the end of a step that is a switch, the variables after the switch.
    fn at(&mut self, t: f64, out: &mut [f64]) {
        self.interpolate(t, out);
    }

    fn slopes_at(&self, t: f64) -> Vec<f64> {
        self.slopes_of_polynomials(t)
    }

    fn ranges(&self, from: f64, to: f64) -> Vec<Interval> {
        self.ranges_of_polynomials(from, to)
    }

    /// Repeats the last step on its active face of `K`, up to the time `end`: this is for problems without bounded
    /// variables, whose faces do not end.
    fn cut_at(&mut self, end: f64, tighter: f64) -> bool {
        let h = self.breaks.size_up_to(self.last.t, end);
        if self.last.is_remade && h == self.last.h {
            return true;
        }
        let stages = self.orders.last().tableau.stages();
        let exact = Settings {
            stages: StageChoice::Fixed(stages),
            rtol: tighter * self.settings.rtol,
            atol: self.settings.atol.iter().map(|atol| tighter * atol).collect(),
            step: Some(h),
            ..self.settings.clone()
        };
        let orders = std::mem::replace(&mut self.orders, Orders::new(&exact));
        let settings = std::mem::replace(&mut self.settings, exact);
        let (clock, y) = (self.clock, self.y.clone());
        self.clock.set(self.last.t);
        self.y.copy_from_slice(&self.last.y);
        if !self.last.is_remade {
            self.forget_jacobian();
        }
        self.factored = None;
        // Newton's method starts from zero: started from the stages of the longer step, it would keep their values,
        // which are accurate within its tolerance only, wherever nothing moves at first.
        self.stages.z.fill(0.0);
        self.stages.w.fill(0.0);
        let is_made = self.prepare(h).is_ok() && matches!(self.newton(h), Newton::Converged { .. });
        if is_made {
            let n = self.system.unknowns;
            self.last.set(self.clock.t, h, &self.y, &self.stages.z[..stages * n], &self.system.face);
            self.last.slope.clear();
            self.last.end_slope.clear();
            self.last.is_remade = true;
            self.jacobian = Freshness::Kept;
            self.clock.set(end);
            let ends = &self.stages.z[(stages - 1) * n..stages * n];
            self.y.iter_mut().zip(ends).for_each(|(y, z)| *y += z);
        } else {
            (self.clock, self.y) = (clock, y);
            self.forget_jacobian();
        }
        (self.orders, self.settings, self.factored) = (orders, settings, None);
        is_made
    }

    fn save(&mut self) -> Saved {
        self.forget_step();
        self.mark()
    }

    fn restore(&mut self, saved: &Saved) {
        let Saved { clock, y, h, last, face, rounding, orders, controller, extent, .. } = saved.clone();
        (self.clock, self.y, self.h, self.last) = (clock, y, h, last);
        (self.system.face, self.control.rounding, self.orders) = (face, rounding, orders);
        (self.controller, self.extent) = (controller, extent);
        let Saved { continues, jumped, breaks, history, chattering, progress, counts, .. } = saved.clone();
        self.switching.switches.truncate(saved.switches);
        self.jumps.truncate(saved.jumps);
        (self.continues, self.jumped, self.breaks) = (continues, jumped, breaks);
        (self.switching.history, self.chattering, self.progress) = (history, chattering, progress);
        self.counts = counts;
        self.forget_step();
    }
}

impl Radau<'_> {
    /// Returns a copy of the present state of the run, after which the run goes on as if nothing had been saved.
    pub(crate) fn mark(&self) -> Saved {
        Saved {
            clock: self.clock,
            y: self.y.clone(),
            h: self.h,
            last: self.last.clone(),
            face: self.system.face.clone(),
            rounding: self.control.rounding.clone(),
            orders: self.orders.clone(),
            controller: self.controller,
            extent: self.extent.clone(),
            continues: self.continues,
            jumped: self.jumped,
            breaks: self.breaks.clone(),
            history: self.switching.history.clone(),
            switches: self.switching.switches.len(),
            jumps: self.jumps.len(),
            chattering: self.chattering.clone(),
            progress: self.progress.clone(),
            counts: self.counts,
        }
    }

    /// Returns the run to a point saved before the last step, to make a step of at most the size `h` in its place.
    pub(crate) fn retry_from(&mut self, mark: &Saved, h: f64) {
        self.restore(mark);
        self.h = self.h.min(h);
        self.counts.rejected[RejectionCause::Error as usize] += 1;
    }

    /// Forgets derivatives, factors and the contraction of Newton's method in earlier steps, so that the next step
    /// depends on its beginning alone.
    fn forget_step(&mut self) {
        self.jacobian = Freshness::Stale;
        self.factored = None;
        self.contraction = Contraction::default();
    }
}
