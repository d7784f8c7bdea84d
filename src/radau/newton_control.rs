//! What decides that Newton's method has converged, and what an error that it lets pass makes of the quantities that
//! judge a face: below that they are noise.

use super::system::System;

/// What decides that Newton's method has converged.
#[derive(Clone, Debug)]
pub struct NewtonControl {
    /// `1/sc` for each component of `y`, in the norm `sqrt(sum (weight dW)^2 / (s (n+m)))`.
    pub weight: Vec<f64>,
    /// The bound on that norm.
    pub kappa: f64,
    /// The most iterations.
    pub most: usize,
    /// What rounding may have left in each component of `y` in the last step: at a switch, that in its time as well.
    pub rounding: Vec<f64>,
    /// The size of each component of `y` at the beginning of the step, beside which rounding errors are measured.
    pub size: Vec<f64>,
    /// How far each `G_i` is off at the beginning of the step since time is rounded there: sources that no state enters are known
    /// no better.
    pub by_time: Vec<f64>,
    /// The bound on `|G_i|` of bounded variables inside their interval, relative to the size of its terms.
    pub vi_tolerance: f64,
}

/// Down a chain of states at rest the terms of a short step shrink until they are subnormal, and have lost their
/// relative accuracy.
pub const UNDERFLOW: f64 = f64::MIN_POSITIVE;

impl NewtonControl {
    /// The size below which `G_k` at `y` is noise: the tolerance of the VI, or what the rounding of time or an error of the
    /// states that Newton's method lets pass makes of it.
    pub fn noise_of_g(&self, system: &System<'_>, k: usize, y: &[f64]) -> f64 {
        let [terms, passed] = system.terms(k, |j| [self.size[j].max(y[j].abs()), self.passed(system, j)]);
        (self.vi_tolerance * terms).max(passed).max(self.by_time[k]).max(UNDERFLOW)
    }

    /// An error of state `j` that Newton's method or rounding lets pass; none of variables.
    fn passed(&self, system: &System<'_>, j: usize) -> f64 {
        if j < system.states { (self.kappa / self.weight[j]).max(self.rounding[j]) } else { 0.0 }
    }

    /// The size below which a distance of variable `k` at `y` from a bound is noise, likewise.
    pub fn noise_of_z(&self, system: &System<'_>, k: usize, y: &[f64]) -> f64 {
        let at = system.states + k;
        let passed = if self.weight[at] > 0.0 { self.kappa / self.weight[at] } else { 0.0 };
        (self.vi_tolerance * self.size[at].max(y[at].abs())).max(passed)
    }

    /// The same of block `b`: of the distances on it, and of its multipliers.
    pub fn noise_of_block(&self, system: &System<'_>, b: usize, y: &[f64]) -> BlockNoise {
        let mut noise = BlockNoise { z: 0.0, g: 0.0 };
        for &k in &system.set.blocks()[b].members {
            let distance = self.noise_of_z(system, k, y).max(self.noise_of_width(system, k, y));
            noise = BlockNoise { z: noise.z.max(distance), g: noise.g + self.noise_of_g(system, k, y) };
        }
        noise
    }

    /// The size below which the distance of the bounds of variable `k` at `y` is noise, likewise.
    pub fn noise_of_width(&self, system: &System<'_>, k: usize, y: &[f64]) -> f64 {
        let at = system.states + k;
        let passed = system.terms_of_bounds(k, |j| self.passed(system, j));
        (self.vi_tolerance * self.size[at].max(y[at].abs())).max(passed)
    }
}

/// `sqrt(sum x^2 / count)` of `terms`, of which the `sum` of squares is known; where that overflows, what the largest of
/// them alone gives.
pub fn mean_square_root<I: Iterator<Item = f64>>(sum: f64, count: usize, terms: impl FnOnce() -> I) -> f64 {
    if sum < f64::INFINITY {
        return (sum / count as f64).sqrt();
    }
    let larger = |most: f64, x: f64| if x.abs() > most || x.is_nan() { x.abs() } else { most };
    terms().fold(0.0, larger) / (count as f64).sqrt()
}

/// The sizes below which what is measured on a block is noise.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct BlockNoise {
    /// In the unit of `z`.
    pub z: f64,
    /// In the unit of `G`.
    pub g: f64,
}
