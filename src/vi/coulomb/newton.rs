//! Nonsmooth Newton in a proximal-point iteration,
//!
//! ```text
//! r_{j+1} solves  u = (W + alpha_j I) r + q - alpha_j r_j  with Coulomb's law,    alpha_j -> 0
//! ```
//!
//! (Rockafellar 1976, *Monotone operators and the proximal point algorithm*; for friction Acary, Bremond and Huber
//! 2018, section 4.5). The proximal term regularises a singular `W`, and changes the solution only as long as the
//! iteration has not converged. Each inner problem takes a few Newton steps on the [Alart-Curnier
//! function](super::alart_curnier) with a line search on its norm. If no step length decreases the norm the full step
//! is taken, since shorter steps meet the same kinks; the outer iteration globalises: an iterate that does not lower
//! the residual of the original problem is rejected, and `alpha` raised.

use super::alart_curnier::{self, Linearised};
use super::linear::BlockSystem;
use super::patch::{PatchCone, Role};
use super::portfolio::Task;
use super::scaling::{Residual, Scaling};
use nalgebra::{Matrix3, Vector3};

/// Largest number of Newton steps for one inner problem of the proximal-point iteration; the method either has the
/// correct contact states after five steps or is chattering.
const INNER: usize = 10;

/// An inner problem is easy if solved in `EASY` Newton steps: then the proximal weight `alpha` is multiplied by
/// `SHRINK_FAST`, otherwise by `SHRINK`, and after a failure by `RAISE`.
const EASY: usize = 5;
const SHRINK_FAST: f64 = 0.1;
const SHRINK: f64 = 0.3;
const RAISE: f64 = 10.0;

/// Bounds of the proximal weight `alpha`, which follows the residual, in units of the scaled diagonal. Below
/// `ALPHA_LEAST` it is lost in the rounding of `W`.
const ALPHA_BY_RESIDUAL: f64 = 10.0;
const ALPHA_FIRST: [f64; 2] = [1e-8, 1e-2];
const ALPHA_LEAST: f64 = 1e-11;

/// An outer step of the proximal-point iteration must lower the residual to the fraction `OUTER_DECREASE`; after
/// `FAILURES` steps in a row that do not, another method takes over.
const OUTER_DECREASE: f64 = 0.5;
const FAILURES: usize = 3;

/// Residual of an inner problem, relative to `|q| + |r|`, that is ascribed to rounding and ends Newton's method.
const INNER_ACCURACY: f64 = 1e-14;

/// Armijo's fraction of the slope, and the shortest step length of the line search.
const ARMIJO: f64 = 1e-4;
const SHORTEST: f64 = 1e-3;

/// Proximal Newton for problems of one block pattern; allocates when built.
pub(super) struct ProximalNewton {
    system: BlockSystem,
    linearised: Vec<Linearised>,
    /// For each block row of a patch, the derivatives of its Alart-Curnier function by velocity and impulse of the
    /// patch's other row.
    across: Vec<[Matrix3<f64>; 2]>,
    direction: Vec<f64>,
    centre: Vec<Vector3<f64>>,
    iterate: Vec<Vector3<f64>>,
    trial: Vec<Vector3<f64>>,
}

impl ProximalNewton {
    /// Creates a solver for the pattern of a scaled problem; returns `None` if memory does not suffice.
    pub fn new(scaling: &Scaling) -> Option<Self> {
        let n = scaling.problem.contacts();
        let zero = Linearised { value: Vector3::zeros(), by_u: Default::default(), by_r: Default::default() };
        Some(Self {
            system: BlockSystem::new(scaling.problem.matrix())?,
            linearised: vec![zero; n],
            across: vec![Default::default(); if scaling.problem.has_patches() { n } else { 0 }],
            direction: vec![0.0; 3 * n],
            centre: vec![Vector3::zeros(); n],
            iterate: vec![Vector3::zeros(); n],
            trial: vec![Vector3::zeros(); n],
        })
    }

    /// Improves the impulses `r`, whose residual is `residual`, within `budget` factorisations; returns the number of
    /// factorisations used and the new residual.
    pub fn improve(
        &mut self,
        task: &Task<'_>,
        r: &mut [Vector3<f64>],
        mut residual: Residual,
        budget: usize,
    ) -> (usize, Residual) {
        let mut alpha = (ALPHA_BY_RESIDUAL * residual.relative).clamp(ALPHA_FIRST[0], ALPHA_FIRST[1]);
        let (mut used, mut failures) = (0, 0);
        self.centre.copy_from_slice(r);
        while used < budget && failures < FAILURES && !task.is_over(residual.strict) {
            let steps = self.inner(task.scaling, alpha);
            used += steps;
            let found = task.scaling.residual(&self.iterate);
            if found.strict <= task.tolerance || found.relative < OUTER_DECREASE * residual.relative {
                residual = found;
                self.centre.copy_from_slice(&self.iterate);
                alpha = (alpha * if steps <= EASY { SHRINK_FAST } else { SHRINK }).max(ALPHA_LEAST);
                failures = 0;
            } else {
                alpha *= RAISE;
                failures += 1;
            }
        }
        r.copy_from_slice(&self.centre);
        (used, residual)
    }

    /// Runs Newton's method on the inner problem, from the proximal centre, and leaves the result in `iterate`;
    /// returns the number of factorisations used.
    fn inner(&mut self, scaling: &Scaling, alpha: f64) -> usize {
        self.iterate.copy_from_slice(&self.centre);
        let size = norm(scaling.problem.q()) + norm(&self.centre);
        for step in 0..INNER {
            let before = self.linearise(scaling, alpha);
            if before <= INNER_ACCURACY * size {
                return step;
            }
            if !self.newton_direction(scaling, alpha) {
                return step + 1;
            }
            let mut length = 1.0;
            while self.norm_along(scaling, alpha, length) >= (1.0 - ARMIJO * length) * before {
                length *= 0.5;
                if length < SHORTEST {
                    self.norm_along(scaling, alpha, 1.0);
                    break;
                }
            }
            std::mem::swap(&mut self.iterate, &mut self.trial);
        }
        INNER
    }

    /// Evaluates the Alart-Curnier function with its generalised Jacobian at the iterate; returns the norm of the
    /// function.
    fn linearise(&mut self, scaling: &Scaling, alpha: f64) -> f64 {
        let problem = &scaling.problem;
        let mut sum = 0.0;
        let velocity = |k: usize| problem.velocity(k, &self.iterate) + (self.iterate[k] - self.centre[k]) * alpha;
        for k in 0..self.linearised.len() {
            let (r, mu) = (&self.iterate, problem.mu()[k]);
            match problem.role(k) {
                Role::Point => self.linearised[k] = alart_curnier::linearise(&r[k], &velocity(k), mu),
                Role::Force(reach) => {
                    let u = [velocity(k), velocity(k + 1)];
                    let rows = PatchCone { mu, reach }.linearise_rows(&[r[k], r[k + 1]], &u);
                    for (i, (own, across)) in rows.into_iter().enumerate() {
                        (self.linearised[k + i], self.across[k + i]) = (own, across);
                    }
                }
                Role::Torque => {}
            }
            sum += self.linearised[k].value.norm_squared();
        }
        sum.sqrt()
    }

    fn newton_direction(&mut self, scaling: &Scaling, alpha: f64) -> bool {
        let (linearised, across, problem) = (&self.linearised, &self.across, &scaling.problem);
        let factored = self.system.factorise(problem.matrix(), |i, j, block| {
            let row = &linearised[i];
            let mut product = row.by_u * block;
            if let Some(other) = problem.partner(i) {
                let [by_u, by_r] = &across[i];
                if let Some(block) = problem.matrix().block(other, j) {
                    product += by_u * block;
                }
                if other == j {
                    product += by_u * alpha + by_r;
                }
            }
            if i == j { product + row.by_u * alpha + row.by_r } else { product }
        });
        for (right, row) in self.direction.chunks_exact_mut(3).zip(linearised) {
            right.copy_from_slice((-row.value).as_slice());
        }
        factored && self.system.solve(&mut self.direction)
    }

    /// Writes the point at the given length along the direction to `trial`; returns the norm of the Alart-Curnier
    /// function at that point.
    fn norm_along(&mut self, scaling: &Scaling, alpha: f64, length: f64) -> f64 {
        let problem = &scaling.problem;
        for ((trial, r), d) in self.trial.iter_mut().zip(&self.iterate).zip(self.direction.chunks_exact(3)) {
            *trial = r + Vector3::new(d[0], d[1], d[2]) * length;
        }
        let velocity = |k: usize| problem.velocity(k, &self.trial) + (self.trial[k] - self.centre[k]) * alpha;
        let value = |(k, r): (usize, &Vector3<f64>)| match problem.role(k) {
            Role::Point => alart_curnier::value(r, &velocity(k), problem.mu()[k]).norm_squared(),
            Role::Force(reach) => {
                let (r, u) = ([*r, self.trial[k + 1]], [velocity(k), velocity(k + 1)]);
                let [force, torque] = PatchCone { mu: problem.mu()[k], reach }.value(&r, &u);
                force.norm_squared() + torque.norm_squared()
            }
            Role::Torque => 0.0,
        };
        self.trial.iter().enumerate().map(value).sum::<f64>().sqrt()
    }
}

fn norm(v: &[Vector3<f64>]) -> f64 {
    v.iter().map(Vector3::norm_squared).sum::<f64>().sqrt()
}
