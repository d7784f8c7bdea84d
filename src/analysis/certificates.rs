//! Certificates: conditions that hold along every exact solution, evaluated on the computed one. `z` is in `K`, `G`
//! is complementary to it, and the differentiation lemmas hold (Stewart 2011, section 3.4): where `z` and `G` are
//! differentiable and `K` does not move, `<z', G> = 0` and `<z', G'> <= 0`.

use problem::{ConvexSet, Workspace};
use serde::Serialize;

/// The worst values of the certificates over a run and over the bounded variables; for an exact solution each is
/// zero, or has the stated sign. In a block of `K`, where `z` and `G` have no signs, the residual of the natural map
/// replaces `G` and the distance to a bound.
#[derive(Clone, Debug, Default, Serialize)]
pub struct Certificates {
    /// The largest natural-map residual `|z - P_K(z - G)|` at the end of a step, with the projection `P_K` onto `K`.
    pub natural_map: f64,
    /// The largest violation of its interval or block of `K` by a variable `z_i`, as a negative number; zero without
    /// violation.
    pub smallest_z: f64,
    /// The smallest `G_i` of a variable at its lower bound, `-G_i` at its upper bound or `-|G_i|` inside its interval,
    /// if below zero; zero for an exact solution.
    #[serde(rename = "smallest_G")]
    pub smallest_g: f64,
    /// The largest complementarity product: the distance of a variable `z_i` to its nearest bound times `|G_i|`.
    pub largest_product: f64,
    /// The largest `|<dz, G>|`, where `dz` is the change of `z` over a step without a switch of the active face; zero
    /// for an exact solution. It is not divided by the size of `G`, which is a mere rounding error if a variable is
    /// inside its interval.
    pub first_lemma: f64,
    /// The largest `<dz, dG>`, where `dz` and `dG` are the changes over a step without a switch of the active face;
    /// not above zero for an exact solution.
    pub second_lemma: f64,
    #[serde(skip)]
    work: Workspace,
    #[serde(skip)]
    last: Option<(Vec<f64>, Vec<f64>)>,
}

impl Certificates {
    /// Updates the complementarity certificates with the variables `z` and inequality functions `G` at the end of a
    /// step, for the variables with indices `bounded`; `smooth` if the step has kept one active face and `K` does not
    /// move.
    pub fn observe(&mut self, set: &ConvexSet, bounded: &[usize], z: &[f64], g: &[f64], smooth: bool) {
        for &k in bounded.iter().filter(|&&k| set.block_of(k).is_none()) {
            let (z, g) = (z[k], g[k]);
            let distance = (z - set.lower[k]).min(set.upper[k] - z);
            // As in the natural map, compare the distance of `z_k` to a bound with `G_k` to decide which bound, if any,
            // is active.
            let signed = if z - set.lower[k] <= g {
                g
            } else if set.upper[k] - z <= -g {
                -g
            } else {
                -g.abs()
            };
            self.natural_map = self.natural_map.max((z - set.project(k, z - g)).abs());
            self.smallest_z = self.smallest_z.min(distance);
            self.smallest_g = self.smallest_g.min(signed);
            self.largest_product = self.largest_product.max((distance * g).abs());
        }
        for (b, block) in set.blocks().iter().enumerate() {
            let defect = set.defect(b, z, g, 1.0, &mut self.work);
            let force = block.members.iter().fold(0.0_f64, |most, &k| most.max(g[k].abs()));
            self.natural_map = self.natural_map.max(defect);
            self.smallest_z = self.smallest_z.min(-set.defect(b, z, g, 0.0, &mut self.work));
            self.smallest_g = self.smallest_g.min(-defect);
            self.largest_product = self.largest_product.max(defect * force);
        }
        let pick = |values: &[f64]| bounded.iter().map(|&k| values[k]).collect::<Vec<f64>>();
        let (z, g) = (pick(z), pick(g));
        if let Some((last_z, last_g)) = &self.last
            && smooth
        {
            let (mut first, mut second) = (0.0, 0.0);
            for (((z, last_z), g), last_g) in z.iter().zip(last_z).zip(&g).zip(last_g) {
                first += (z - last_z) * g;
                second += (z - last_z) * (g - last_g);
            }
            self.first_lemma = self.first_lemma.max(f64::abs(first));
            self.second_lemma = self.second_lemma.max(second);
        }
        self.last = Some((z, g));
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Returns the complementarity certificates for a run with one nonnegative variable, from its pairs `(z, G)` at the
    /// ends of steps.
    fn observed(run: &[(f64, f64)]) -> Certificates {
        let set = ConvexSet::intervals(vec![0.0], vec![f64::INFINITY]);
        let mut certificates = Certificates::default();
        for &(z, g) in run {
            certificates.observe(&set, &[0], &[z], &[g], true);
        }
        certificates
    }

    #[test]
    fn the_lemmas_hold_where_the_pair_is_complementary() {
        let rests = observed(&[(0.0, 3.0), (0.0, 1.0), (0.0, 2.0)]);
        let moves = observed(&[(1.0, 0.0), (0.5, 0.0), (4.0, 0.0)]);
        for seen in [rests, moves] {
            assert_eq!((seen.first_lemma, seen.second_lemma, seen.natural_map), (0.0, 0.0, 0.0));
        }
    }

    #[test]
    fn the_lemmas_fail_where_both_grow() {
        let wrong = observed(&[(0.0, 0.0), (1.0, 2.0), (1.5, 2.5)]);
        assert_eq!((wrong.first_lemma, wrong.second_lemma), (2.0, 2.0));
        assert_eq!((wrong.natural_map, wrong.largest_product), (1.5, 3.75));
    }

    #[test]
    fn a_change_over_a_switch_is_no_concern_of_theirs() {
        let set = ConvexSet::intervals(vec![0.0], vec![f64::INFINITY]);
        let mut certificates = Certificates::default();
        for (z, g, smooth) in [(1.0, 0.0, true), (0.0, 5.0, false), (0.0, 6.0, true)] {
            certificates.observe(&set, &[0], &[z], &[g], smooth);
        }
        assert_eq!((certificates.first_lemma, certificates.second_lemma), (0.0, 0.0));
    }
}
