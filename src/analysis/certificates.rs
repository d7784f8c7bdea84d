//! What holds along every exact solution, evaluated on the computed one: `z` in `K`, `G` complementary to it, and the
//! differentiation lemmas (Stewart 2011, section 3.4): where `z` and `G` are differentiable and `K` does not move,
//! `<z', G> = 0` and `<z', G'> <= 0`.

use crate::problem::{ConvexSet, Workspace};
use serde::Serialize;

/// The worst figures over a run, over the bounded variables; each is zero, or of the sign stated, for an exact solution.
/// In a block, where `z` and `G` have no signs, the natural map stands for that of `G`, and for the distance.
#[derive(Clone, Debug, Default, Serialize)]
pub struct Certificates {
    /// The largest natural-map residual `|z - P_K(z - G)|`.
    pub natural_map: f64,
    /// How far a `z_i` leaves its interval or block, as a number below zero.
    pub smallest_z: f64,
    /// How far a `G_i`, signed so that it should not be negative, is below zero.
    #[serde(rename = "smallest_G")]
    pub smallest_g: f64,
    /// The largest product of the distance to a bound and `|G_i|`.
    pub largest_product: f64,
    /// The largest `|<dz, G>|` over steps without a switch, beside the largest `|dz| |G|`: zero.
    pub first_lemma: f64,
    /// The largest `<dz, dG>` over steps without a switch, beside the largest `|dz| |dG|`: not above zero.
    pub second_lemma: f64,
    #[serde(skip)]
    work: Workspace,
    #[serde(skip)]
    last: Option<(Vec<f64>, Vec<f64>)>,
    /// The largest `|<dz, G>|` and `|dz| |G|`, `<dz, dG>` and `|dz| |dG|`.
    #[serde(skip)]
    products: [f64; 4],
}

impl Certificates {
    /// Takes the bounded variables, as indices into `z`, at the end of a step into account; `smooth` if the step has kept
    /// one face and `K` does not move.
    pub fn observe(&mut self, set: &ConvexSet, bounded: &[usize], z: &[f64], g: &[f64], smooth: bool) {
        for &k in bounded.iter().filter(|&&k| set.block_of(k).is_none()) {
            let (z, g) = (z[k], g[k]);
            let distance = (z - set.lower[k]).min(set.upper[k] - z);
            // The natural map tells which bound, if any, the variable rests on.
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
            let change = |new: &[f64], old: &[f64]| new.iter().zip(old).map(|(a, b)| a - b).collect::<Vec<f64>>();
            let (dz, dg) = (change(&z, last_z), change(&g, last_g));
            let [first, first_size, second, second_size] = &mut self.products;
            *first = first.max(dot(&dz, &g).abs());
            *first_size = first_size.max(norm(&dz) * norm(&g));
            *second = second.max(dot(&dz, &dg));
            *second_size = second_size.max(norm(&dz) * norm(&dg));
            let ratio = |a: f64, b: f64| if b > 0.0 { a / b } else { 0.0 };
            self.first_lemma = ratio(*first, *first_size);
            self.second_lemma = ratio(*second, *second_size);
        }
        self.last = Some((z, g));
    }
}

fn dot(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(a, b)| a * b).sum()
}

fn norm(a: &[f64]) -> f64 {
    dot(a, a).sqrt()
}
