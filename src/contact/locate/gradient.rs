//! Gaps whose gradient vanishes where they close, such as powers of a distance: the impulse has no direction.

use super::{EventDriven, State};
use problem::Constraints;

/// Growth of the gradient of a gap that identifies a vanishing gradient where the gap closes. The gradient is
/// compared with the gradient at a small distance: within the tolerances of the coordinates, extended by [`BEYOND`]
/// times the first-order distance of the gap from its zero. With less growth the gradient keeps at least half its
/// size, and a direction, wherever within the tolerances the gap closes. The gradient of a power `y^p` with `p >= 2`
/// grows by `(1 + BEYOND/p)^(p - 1) >= 2` whatever its distance from the zero.
const GRADIENT_GROWTH: f64 = 2.0;
const BEYOND: f64 = 2.0;

impl EventDriven<'_> {
    /// Whether the gradient of the closing gap of contact `k` vanishes within the tolerances of the coordinates. The
    /// tolerances scale coordinates of different units, so that gaps with equal zeros, such as functions of a
    /// distance, compare alike.
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
