//! How far a point is from a solution, component by component: over an interval
//!
//! ```text
//! r_i = |median(z_i - l_i, G_i, z_i - u_i)| = |z_i - P(z_i - G_i)|
//! ```
//!
//! which loses no digit where `z_i` is large, beside the terms of what it is: of `G_i`, or of `z_i`. A point that runs away to
//! infinity, beside which every residual would be small, is none near a solution so.

use problem::{ConvexSet, Workspace};

/// The component that is farthest from solved.
#[derive(Clone, Copy, Debug)]
pub struct Worst {
    /// Which it is.
    pub component: usize,
    /// Its `r_i`.
    pub residual: f64,
    /// The size of its terms: at least one, or that of the largest of the problem where all are smaller.
    pub terms: f64,
    /// The largest `r_i` of all.
    pub largest: f64,
}

impl Worst {
    /// Of a point `z` with `g = G(z)`, whose terms add up to these sizes.
    pub fn of(set: &ConvexSet, (z, g): (&[f64], &[f64]), terms: &[f64]) -> Self {
        let size = |values: &[f64]| values.iter().fold(f64::MIN_POSITIVE, |most, value| most.max(value.abs()));
        let (least_term, least_z) = (size(terms).min(1.0), size(z).min(1.0));
        let mut worst = Self { component: 0, residual: 0.0, terms: 1.0, largest: 0.0 };
        let mut offer = |component: usize, residual: f64, terms: f64| {
            if worst.residual.is_nan() {
                return;
            }
            if residual.is_nan() || residual * worst.terms > worst.residual * terms {
                worst = Self { component, residual, terms, ..worst };
            }
            worst.largest = if residual.is_nan() { residual } else { worst.largest.max(residual) };
        };
        for i in (0..z.len()).filter(|&i| set.block_of(i).is_none()) {
            let (below, above) = (z[i] - set.lower[i], z[i] - set.upper[i]);
            if !(g[i].is_finite() && z[i].is_finite()) {
                offer(i, f64::NAN, 1.0);
            } else if g[i] > below {
                offer(i, below.abs(), z[i].abs().max(least_z));
            } else if g[i] < above {
                offer(i, above.abs(), z[i].abs().max(least_z));
            } else {
                offer(i, g[i].abs(), terms[i].max(least_term));
            }
        }
        let mut work = Workspace::default();
        for (number, block) in set.blocks().iter().enumerate() {
            let over = |values: &[f64]| block.members.iter().fold(0.0_f64, |most, &i| most.max(values[i].abs()));
            let residual = set.defect(number, z, g, 1.0, &mut work);
            let residual = if block.members.iter().all(|&i| g[i].is_finite()) { residual } else { f64::NAN };
            offer(block.members[0], residual, over(terms).max(least_term).max(over(z)));
        }
        worst
    }

    /// The residual beside its terms.
    pub fn relative(&self) -> f64 {
        if self.residual == 0.0 { 0.0 } else { self.residual / self.terms }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_point_far_away_is_not_near_a_solution() {
        // w2 = -1 whatever z2 is, and z2 has no upper end: beside z2 = 5e16 one is nothing.
        let set = ConvexSet::nonnegative(2);
        let worst = Worst::of(&set, (&[0.0, 5e16], &[5e16, -1.0]), &[5e16, 1.0]);
        assert_eq!((worst.component, worst.residual, worst.relative()), (1, 1.0, 1.0));
        assert_eq!(Worst::of(&set, (&[0.0, 3.0], &[2.0, 0.0]), &[2.0, 6.0]).relative(), 0.0);
        assert!(Worst::of(&set, (&[0.0, 3.0], &[f64::NAN, 0.0]), &[2.0, 6.0]).relative().is_nan());
    }
}
