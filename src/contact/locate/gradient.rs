//! Gaps without a gradient where they close, such as powers of a distance: there is no direction to push in.

use super::{EventDriven, State};
use problem::Constraints;

/// A gap has no gradient where it closes if its gradient is this many times as large beside that place, by what the tolerances
/// leave coordinates open and by [`BEYOND`] times what the gap is off zero, to first order: below that it has at least half its
/// size, and a direction, wherever within the tolerances the gap closes. The gradient of a power `y^p` with `p >= 2`, found off
/// its zero by however much, grows by `(1 + BEYOND/p)^(p - 1) >= 2`.
const GRADIENT_GROWTH: f64 = 2.0;
const BEYOND: f64 = 2.0;

impl EventDriven<'_> {
    /// Whether the gradient of the gap of contact `k`, which closes, vanishes within the tolerances of the coordinates. These give
    /// coordinates of different units one size, and no other gap with the same zero differs, such as a function of a distance.
    pub(super) fn is_gradient_lost(&mut self, k: usize) -> bool {
        let State { t, q, .. } = &self.state;
        let row = self.structure.normal(k);
        let tolerances = self.radau.tolerances(0, q);
        let here = self.constraints.size(row, &tolerances);
        let far = 1.0 + BEYOND * self.constraints.values[self.structure.joints + k].abs() / here;
        let mut beside = Constraints::new(&self.structure);
        here == 0.0
            || [-far, far].into_iter().any(|far| {
                let gradient = self.constraints.row(row).iter().zip(&tolerances);
                let q: Vec<f64> =
                    q.iter().zip(gradient).map(|(q, (j, tolerance))| q + far * j.signum() * tolerance).collect();
                self.step.problem.constraints(*t, &q, &mut beside);
                beside.size(row, &tolerances) >= GRADIENT_GROWTH * here
            })
    }
}
