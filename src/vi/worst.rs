//! The relative residual of a point, component by component: over an interval
//!
//! ```text
//! r_i = |median((z_i - l_i) / |z_i|, G_i / terms, (z_i - u_i) / |z_i|)|
//! ```
//!
//! the natural map `z_i - P(z_i - G_i)` with `z_i` and `G_i` each relative to its own size, which loses no digit
//! where `z_i` is large. A point far away, relative to which every residual would be small, is thereby not accepted
//! as a solution. In a block the relative residual is that of [`of_block`], in the unit of `G`.

use super::residual::of_block;
use problem::{ConvexSet, Workspace};

/// The sizes of the terms of each row of a variational inequality at a point, to which residuals are relative.
#[derive(Clone, Debug)]
pub struct Terms {
    /// The size of the terms of each row, `|G| + |J| |z|`.
    pub sizes: Vec<f64>,
    /// The largest derivative of each row by the variables of its own block, in absolute value.
    pub slopes: Vec<f64>,
}

impl Terms {
    /// Computes the sizes of the terms at a point `z` with `g = G(z)` and the given entries of the Jacobian.
    pub fn of(
        set: &ConvexSet,
        (z, g): (&[f64], &[f64]),
        derivatives: impl Iterator<Item = ((usize, usize), f64)>,
    ) -> Self {
        let mut sizes: Vec<f64> = g.iter().map(|g| g.abs()).collect();
        let mut slopes = vec![0.0_f64; z.len()];
        for ((i, j), a) in derivatives {
            sizes[i] += (a * z[j]).abs();
            if set.block_of(i).is_some() && set.block_of(i) == set.block_of(j) {
                slopes[i] = slopes[i].max(a.abs());
            }
        }
        Self { sizes, slopes }
    }

    /// Returns the residual of one block at a point `z` with `g = G(z)`, in the unit of `G`, and the size of its
    /// terms.
    pub(super) fn residual_of_block(
        &self,
        set: &ConvexSet,
        number: usize,
        (z, g): (&[f64], &[f64]),
        work: &mut Workspace,
    ) -> (f64, f64) {
        let members = &set.blocks()[number].members;
        let over = |values: &[f64]| members.iter().fold(0.0_f64, |most, &i| most.max(values[i]));
        let (terms, slope) = (over(&self.sizes).max(f64::MIN_POSITIVE), over(&self.slopes));
        let relative = of_block(set, number, (z, g), (terms, slope), work);
        let is_finite = members.iter().all(|&i| g[i].is_finite());
        (if is_finite { relative * terms } else { f64::NAN }, terms)
    }
}

/// Returns the sizes of the variables that follow from the sizes of the terms of the rows: a change of a variable by
/// its size changes some row by its terms, and no row by more. The size is infinite for a variable that no row
/// depends on.
pub(super) fn sizes_of_variables(terms: &[f64], derivatives: impl Iterator<Item = ((usize, usize), f64)>) -> Vec<f64> {
    let mut sizes = vec![f64::INFINITY; terms.len()];
    for ((i, j), a) in derivatives.filter(|((i, _), a)| *a != 0.0 && terms[*i] > 0.0) {
        sizes[j] = sizes[j].min(terms[i] / a.abs());
    }
    sizes
}

/// The component of a variational inequality with the largest residual relative to the size of its terms.
#[derive(Clone, Copy, Debug)]
pub struct Worst {
    /// The index of the component with the largest relative residual.
    pub component: usize,
    /// The residual of the component, in the unit of `z_i` or of `G_i`.
    pub residual: f64,
    /// The size of the terms of the component: at least one, or the largest size of the problem if all are below one.
    pub terms: f64,
    /// The largest absolute residual of all components.
    pub largest: f64,
}

impl Worst {
    /// Finds the component with the largest relative residual at a point `z` with `g = G(z)`.
    pub fn of(set: &ConvexSet, (z, g): (&[f64], &[f64]), terms: &Terms) -> Self {
        let sizes = &terms.sizes;
        let size = |values: &[f64]| values.iter().fold(f64::MIN_POSITIVE, |most, value| most.max(value.abs()));
        let (least_term, least_z) = (size(sizes).min(1.0), size(z).min(1.0));
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
            let (of_z, of_g) = (z[i].abs().max(least_z), sizes[i].max(least_term));
            let force = g[i] / of_g;
            if !(g[i].is_finite() && z[i].is_finite()) {
                offer(i, f64::NAN, 1.0);
            } else if force > below / of_z {
                offer(i, below.abs(), of_z);
            } else if force < above / of_z {
                offer(i, above.abs(), of_z);
            } else {
                offer(i, g[i].abs(), of_g);
            }
        }
        let mut work = Workspace::default();
        for (number, block) in set.blocks().iter().enumerate() {
            let (residual, terms) = terms.residual_of_block(set, number, (z, g), &mut work);
            offer(block.members[0], residual, terms);
        }
        worst
    }

    /// Returns the residual of this component relative to the size of its terms.
    pub fn relative(&self) -> f64 {
        if self.residual == 0.0 { 0.0 } else { self.residual / self.terms }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_point_far_away_is_not_near_a_solution() {
        // w2 = -1 whatever z2 is, and z2 has no upper bound: relative to z2 = 5e16 a residual of one vanishes.
        let set = ConvexSet::nonnegative(2);
        let worst = |z: &[f64], g: &[f64], sizes: [f64; 2]| {
            Worst::of(&set, (z, g), &Terms { sizes: sizes.to_vec(), slopes: vec![0.0; 2] })
        };
        let far = worst(&[0.0, 5e16], &[5e16, -1.0], [5e16, 1.0]);
        assert_eq!((far.component, far.residual, far.relative()), (1, 1.0, 1.0));
        assert_eq!(worst(&[0.0, 3.0], &[2.0, 0.0], [2.0, 6.0]).relative(), 0.0);
        assert!(worst(&[0.0, 3.0], &[f64::NAN, 0.0], [2.0, 6.0]).relative().is_nan());
    }
}
