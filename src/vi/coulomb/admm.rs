//! The alternating direction method of multipliers (ADMM) on de Saxce's form of Coulomb's law, over-relaxed:
//!
//! ```text
//! (W + rho I) r = rho (z - y) - q - g,    g = (mu |u_t|, 0, 0),  u_t = -rho y_t
//! z <- P_K(x r + (1 - x) z + y),    y <- y + x r + (1 - x) z_old - z
//! ```
//!
//! (Boyd, Parikh, Chu, Peleato and Eckstein 2011, *Distributed optimization and statistical learning via the
//! alternating direction method of multipliers*, section 3; Acary, Bremond and Huber 2018; as a Douglas-Rachford
//! splitting it needs no symmetry of `W`). At a fixed point `-rho y = u + g` and `z = r`. One factorisation serves
//! many iterations; `rho` balances the relative primal and dual residuals, at growing intervals, so that it becomes
//! constant.

use super::cone::{FrictionCone, tangent};
use super::linear::BlockSystem;
use super::patch::{PatchCone, Role};
use super::portfolio::Task;
use super::scaling::{Residual, Scaling};
use nalgebra::{Matrix3, Vector3};

/// Over-relaxation factor `x` of ADMM; 1.5 to 1.8 is the customary range.
const RELAXATION: f64 = 1.6;

/// Number of ADMM iterations between two evaluations of the residuals.
const CHECK: usize = 25;

/// The penalty `rho` is changed if the primal and dual residuals differ by more than the factor `UNBALANCED`, and by
/// at most the factor `LARGEST_CHANGE` at a time.
const UNBALANCED: f64 = 3.0;
const LARGEST_CHANGE: f64 = 10.0;

/// Smallest number of iterations with one value of the penalty `rho`; the number grows by a quarter with each change
/// of `rho`.
const DWELL: usize = 50;

/// ADMM for one contact problem; keeps its state between runs.
pub(super) struct Admm {
    system: BlockSystem,
    rho: f64,
    is_factored: bool,
    r: Vec<f64>,
    z: Vec<Vector3<f64>>,
    previous: Vec<Vector3<f64>>,
    y: Vec<Vector3<f64>>,
    iterations: usize,
    factorisations: usize,
    changed: usize,
}

impl Admm {
    /// Prepares a run of ADMM that starts from the impulses `r`; returns `None` if memory does not suffice.
    pub fn new(scaling: &Scaling, r: &[Vector3<f64>]) -> Option<Self> {
        let problem = &scaling.problem;
        let mut y: Vec<Vector3<f64>> = (0..r.len()).map(|k| problem.velocity(k, r)).collect();
        for k in 0..r.len() {
            let mu = problem.mu()[k];
            match problem.role(k) {
                Role::Point => {
                    let cone = FrictionCone { mu };
                    let of = -cone.augment(y[k]);
                    y[k] = of - cone.project(of);
                }
                Role::Force(reach) => {
                    let cone = PatchCone { mu, reach };
                    let of = cone.augment([y[k], y[k + 1]]).map(|u| -u);
                    let projected = cone.project(of);
                    (y[k], y[k + 1]) = (of[0] - projected[0], of[1] - projected[1]);
                }
                Role::Torque => {}
            }
        }
        Some(Self {
            system: BlockSystem::new(problem.matrix())?,
            rho: 1.0,
            is_factored: false,
            r: vec![0.0; 3 * r.len()],
            z: r.to_vec(),
            previous: r.to_vec(),
            y,
            iterations: 0,
            factorisations: 0,
            changed: 0,
        })
    }

    /// Returns the number of ADMM iterations so far.
    pub fn iterations(&self) -> usize {
        self.iterations
    }

    /// Returns the current contact impulses, which lie in their friction cones.
    pub fn impulses(&self) -> &[Vector3<f64>] {
        &self.z
    }

    /// Makes a number of ADMM iterations, fewer if the residual falls below the tolerance; returns the residual, or
    /// `None` if `W + rho I` is singular.
    pub fn run(&mut self, task: &Task<'_>, iterations: usize) -> Option<Residual> {
        let scaling = task.scaling;
        for _ in 0..iterations.div_ceil(CHECK) {
            for _ in 0..CHECK {
                if !self.iterate(scaling) {
                    return None;
                }
            }
            let residual = scaling.residual(&self.z);
            if task.is_over(residual.strict) {
                return Some(residual);
            }
            self.balance(scaling);
        }
        Some(scaling.residual(&self.z))
    }

    fn iterate(&mut self, scaling: &Scaling) -> bool {
        let problem = &scaling.problem;
        let rho = self.rho;
        if !self.is_factored {
            self.is_factored = self.system.factorise(problem.matrix(), |i, j, block| {
                if i == j { block + Matrix3::from_diagonal_element(rho) } else { *block }
            });
            self.factorisations += 1;
        }
        for (k, right) in self.r.chunks_exact_mut(3).enumerate() {
            let y = self.y[k];
            let mut b = (self.z[k] - y) * rho - problem.q()[k];
            b.x -= rho
                * match problem.role(k) {
                    Role::Point => problem.mu()[k] * tangent(&y).norm(),
                    Role::Force(reach) => PatchCone { mu: problem.mu()[k], reach }.support(&[y, self.y[k + 1]]),
                    Role::Torque => 0.0,
                };
            right.copy_from_slice(b.as_slice());
        }
        if !(self.is_factored && self.system.solve(&mut self.r)) {
            return false;
        }
        std::mem::swap(&mut self.z, &mut self.previous);
        let (r, previous) = (&self.r, &self.previous);
        let relaxed =
            |k: usize| Vector3::from_column_slice(&r[3 * k..3 * k + 3]) * RELAXATION + previous[k] * (1.0 - RELAXATION);
        for k in 0..self.z.len() {
            let mu = problem.mu()[k];
            match problem.role(k) {
                Role::Point => {
                    let relaxed = relaxed(k);
                    self.z[k] = FrictionCone { mu }.project(relaxed + self.y[k]);
                    self.y[k] += relaxed - self.z[k];
                }
                Role::Force(reach) => {
                    let relaxed = [relaxed(k), relaxed(k + 1)];
                    let target = [relaxed[0] + self.y[k], relaxed[1] + self.y[k + 1]];
                    [self.z[k], self.z[k + 1]] = PatchCone { mu, reach }.project(target);
                    self.y[k] += relaxed[0] - self.z[k];
                    self.y[k + 1] += relaxed[1] - self.z[k + 1];
                }
                Role::Torque => {}
            }
        }
        self.iterations += 1;
        true
    }

    fn balance(&mut self, scaling: &Scaling) {
        if self.iterations - self.changed < DWELL + self.factorisations * DWELL / 4 {
            return;
        }
        let mut sums = [0.0; 6];
        for (k, r) in self.r.chunks_exact(3).enumerate() {
            let (r, z, y, q) = (Vector3::from_column_slice(r), self.z[k], self.y[k], scaling.problem.q()[k]);
            for (sum, v) in sums.iter_mut().zip([r - z, r, z, z - self.previous[k], y, q / self.rho]) {
                *sum += v.norm_squared();
            }
        }
        let [gap, r, z, change, y, q] = sums;
        let primal = gap / r.max(z);
        let dual = change / y.max(q);
        let factor = (primal / dual).powf(0.25);
        if !factor.is_finite() || (factor > UNBALANCED.recip() && factor < UNBALANCED) {
            return;
        }
        let factor = factor.clamp(LARGEST_CHANGE.recip(), LARGEST_CHANGE);
        self.rho *= factor;
        for y in &mut self.y {
            *y /= factor;
        }
        self.is_factored = false;
        self.changed = self.iterations;
    }
}
