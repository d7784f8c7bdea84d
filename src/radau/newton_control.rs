//! Convergence criteria of Newton's method, and the noise levels of the quantities that decide about a face: the effect
//! of errors that Newton's method accepts.

use super::system::System;

/// Convergence criteria of Newton's method on the stages, and scales for noise levels of the quantities that decide
/// about a face of `K`.
#[derive(Clone, Debug)]
pub struct NewtonControl {
    /// Weight `1/sc`, the inverse of the tolerance, of each component of `y` in the norm
    /// `sqrt(sum (weight dW)^2 / (s (n+m)))`.
    pub weight: Vec<f64>,
    /// The tolerance on the weighted norm of the remaining Newton increment.
    pub kappa: f64,
    /// Maximum number of Newton iterations on the stages of a step.
    pub most: usize,
    /// Rounding error of each component of `y` in the last step; at a switch, including the rounding of its time.
    pub rounding: Vec<f64>,
    /// Magnitude of each component of `y` at the beginning of the step, relative to which rounding errors are measured.
    pub size: Vec<f64>,
    /// Error of each `G_i` at the beginning of the step from the rounding of time: the accuracy of sources that no
    /// state enters.
    pub by_time: Vec<f64>,
    /// The tolerance on `|G_i|` of bounded variables inside their interval, relative to the magnitude of its terms.
    pub vi_tolerance: f64,
}

/// Noise floor: along a chain of states at rest, the terms of a short step shrink until they are subnormal and lose
/// their relative accuracy.
pub const UNDERFLOW: f64 = f64::MIN_POSITIVE;

impl NewtonControl {
    /// Returns the noise level of `G_k` at `y`: the tolerance of the variational inequality, the rounding of time, or
    /// the effect of an error of the states that Newton's method accepts, whichever is largest.
    pub fn noise_of_g(&self, system: &System<'_>, k: usize, y: &[f64]) -> f64 {
        self.noise_of_g_by(system, k, y, |at| system.derivatives[at].abs())
    }

    /// Returns the noise level of `G_k` as [`Self::noise_of_g`] does, where `slope` returns the magnitude of the
    /// derivative that is stored at a place of the Jacobian.
    pub fn noise_of_g_by(&self, system: &System<'_>, k: usize, y: &[f64], slope: impl Fn(usize) -> f64) -> f64 {
        let row = system.states + k;
        let [terms, passed] = system.terms_by(row, slope, |j| [self.size[j].max(y[j].abs()), self.passed(system, j)]);
        (self.vi_tolerance * terms).max(passed).max(self.by_time[k]).max(UNDERFLOW)
    }

    /// Returns the error of unknown `j` that Newton's method or rounding leaves undetected; zero for the variables `z`.
    fn passed(&self, system: &System<'_>, j: usize) -> f64 {
        if j < system.states { (self.kappa / self.weight[j]).max(self.rounding[j]) } else { 0.0 }
    }

    /// Returns the noise level of the distance of variable `k` at `y` from one of its bounds.
    pub fn noise_of_z(&self, system: &System<'_>, k: usize, y: &[f64]) -> f64 {
        let at = system.states + k;
        let passed = if self.weight[at] > 0.0 { self.kappa / self.weight[at] } else { 0.0 };
        (self.vi_tolerance * self.size[at].max(y[at].abs())).max(passed)
    }

    /// Returns the noise levels of block `b` at `y`: that of the distances from the boundary of its set, and that of
    /// its multipliers.
    pub fn noise_of_block(&self, system: &System<'_>, b: usize, y: &[f64]) -> BlockNoise {
        let mut noise = BlockNoise { z: 0.0, g: 0.0 };
        for &k in &system.set.blocks()[b].members {
            let distance = self.noise_of_z(system, k, y).max(self.noise_of_width(system, k, y));
            noise = BlockNoise { z: noise.z.max(distance), g: noise.g + self.noise_of_g(system, k, y) };
        }
        noise
    }

    /// Returns the noise level of the distance between the bounds of variable `k` at `y`.
    pub fn noise_of_width(&self, system: &System<'_>, k: usize, y: &[f64]) -> f64 {
        let at = system.states + k;
        let passed = system.terms_of_bounds(k, |j| self.passed(system, j));
        (self.vi_tolerance * self.size[at].max(y[at].abs())).max(passed)
    }
}

/// Returns the root mean square `sqrt(sum x^2 / count)` of `terms`, given the `sum` of their squares; if that sum
/// overflows, the contribution of the largest term alone.
pub fn mean_square_root<I: Iterator<Item = f64>>(sum: f64, count: usize, terms: impl FnOnce() -> I) -> f64 {
    if sum < f64::INFINITY {
        return (sum / count as f64).sqrt();
    }
    let larger = |most: f64, x: f64| if x.abs() > most || x.is_nan() { x.abs() } else { most };
    terms().fold(0.0, larger) / (count as f64).sqrt()
}

/// Noise levels of the monitors (event functions) of a block of variables.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct BlockNoise {
    /// Noise level of the distances of the block from the boundary of its set, in the unit of `z`.
    pub z: f64,
    /// Noise level of the multipliers of the block, in the unit of `G`.
    pub g: f64,
}
