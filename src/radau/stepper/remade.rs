//! The last step made again, from where it began to an earlier end: its size is the unknown of an event that is to be found to
//! the order of the method.

use super::{Freshness, Radau};
use crate::orders::Orders;
use crate::settings::{Settings, StageChoice};
use crate::stages::Newton;

impl Radau<'_> {
    /// Makes the last step again, up to the time `end` within it, with stages whose tolerances are `tighter` times those of
    /// the run; whether it could be made. If so the run has come to `end`, and what is told of the last step is told of this
    /// one; else nothing has changed.
    ///
    /// The step keeps the face that it had, and is for problems without bounded variables, whose faces do not end.
    pub fn remake(&mut self, end: f64, tighter: f64) -> bool {
        let h = end - self.last.t;
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
        // Newton's method begins at zero: from the stages of the longer step it would keep, where nothing moves at first, what
        // that one knows within its tolerance only.
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
