//! Repetition of the last step from its beginning to an earlier end: its size is the unknown in the location of an
//! event to the order of the method.

use super::{Freshness, Radau};
use crate::orders::Orders;
use crate::settings::{Settings, StageChoice};
use crate::stages::Newton;

impl Radau<'_> {
    /// Repeats the last step up to the time `end` within it, with tolerances of the stages that are `tighter` times
    /// those of the run; returns whether the stages were solved. If so, the run is at `end`, and the repeated step
    /// replaces the last one; otherwise nothing has changed.
    ///
    /// The step keeps its face: this is for problems without bounded variables, whose faces do not end.
    pub fn remake(&mut self, end: f64, tighter: f64) -> bool {
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
}
