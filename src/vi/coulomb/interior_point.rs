//! A primal-dual interior-point method for Coulomb's law in the form of de Saxce,
//!
//! ```text
//! u = W r + q,    y = u + (mu |u_t|, 0, 0),    K_mu in r  _|_  y in K_mu*
//! ```
//!
//! (Acary, Armand, Nguyen and Prasad 2023, *Second-order cone programming for frictional contact mechanics using
//! interior point algorithm*, here with the slip speed as a function of the unknowns in place of an outer iteration;
//! Mehrotra 1992). In the coordinates `z = T r`, `s = T^-1 y`, `T = diag(mu, 1, 1)`, both cones are the [Lorentz
//! cone](super::lorentz). With the Nesterov-Todd scaling `V`, for which `V z = V^-1 s = l`, a step solves
//!
//! ```text
//! (N W + T V^2 T) dr = T V d - (u + (mu |u_t|, 0, 0) - y),    N = I + n (0, mu u_t/|u_t|)^T,
//! l o d = sigma m e - l o l - (V^-1 ds) o (V dz)
//! ```
//!
//! where `m` is the mean of `<z, s>`. The matrix has the pattern of `W`, and is regular even if `W` is singular. The
//! number of steps hardly depends on the number of contacts.
//!
//! The slip speed makes the law non-monotone, so that iterates may leave the neighbourhood of the central path, where
//! steps become short. A short step is followed by a pure centring step; if the method stalls all the same, it
//! restarts at another distance from the boundary of the cones.

use super::cone::{FrictionCone, tangent};
use super::linear::BlockSystem;
use super::lorentz::{NtScaling, longest, product, quotient};
use super::portfolio::Task;
use super::scaling::{Residual, Scaling};
use nalgebra::{Matrix3, Vector3};

/// The step length as a fraction of the distance to the boundary of the cones. Values near 1, as for convex problems,
/// lead to the boundary and away from the central path.
const FRACTION: f64 = 0.9;

/// If a step is shorter than this fraction of the Newton step, the next step only centres.
const LONG: f64 = 0.5;

/// A step shorter than this fraction of the Newton step is no progress; after `STALLS` such steps in a row the method
/// restarts.
const SHORT: f64 = 1e-3;
const STALLS: usize = 3;

/// For each start in turn, the distance of the starting point from the boundary of the cones, in units of the root
/// mean square of `q`.
const ROOMS: [f64; 3] = [1.0, 10.0, 0.1];

/// The target residual of the method, as a fraction of the tolerance. The margin costs little, since each step gains
/// a digit, and it is needed, since impulses between bodies of very different masses are less accurate than the
/// residual suggests.
const BEYOND: f64 = 1e-3;

/// Residual below which the method does not restart: the contact states are then known, so that Newton's method needs
/// one or two steps.
const KNOWN: f64 = 1e-8;

/// The state of a contact inside the cones: the scaled impulse `z` and the scaled velocity `s`.
#[derive(Clone, Copy, Debug)]
struct Pair {
    mu: f64,
    z: Vector3<f64>,
    s: Vector3<f64>,
}

impl Pair {
    /// Projects an impulse and the augmented velocity of `u` into the cones, and moves both by `room` along the axis
    /// into the interior.
    fn inside(mu: f64, r: &Vector3<f64>, u: &Vector3<f64>, room: f64) -> Self {
        let room = Vector3::x() * room;
        if mu == 0.0 {
            return Self { mu, z: Vector3::x() * r.x.max(0.0) + room, s: Vector3::x() * u.x.max(0.0) + room };
        }
        let y = FrictionCone { mu }.augment(*u);
        let lorentz = FrictionCone { mu: 1.0 };
        let z = lorentz.project(widened(mu, r)) + room;
        Self { mu, z, s: lorentz.project(Vector3::new(y.x / mu, y.y, y.z)) + room }
    }

    /// Returns the Nesterov-Todd scaling `V` of the contact. Without friction the cones are half-lines, and only the
    /// first column of `V` counts.
    fn scaling(&self) -> NtScaling {
        NtScaling::of(&self.z, &self.s)
    }

    /// Returns the impulse `r` of the contact.
    fn impulse(&self) -> Vector3<f64> {
        if self.mu == 0.0 { self.z } else { Vector3::new(self.z.x / self.mu, self.z.y, self.z.z) }
    }

    /// Returns the residual of the equation for the augmented velocity `y`, which is `u + (mu |u_t|, 0, 0) - y`.
    fn defect(&self, u: &Vector3<f64>) -> Vector3<f64> {
        if self.mu == 0.0 {
            return Vector3::x() * (u.x - self.s.x);
        }
        FrictionCone { mu: self.mu }.augment(*u) - widened(self.mu, &self.s)
    }

    /// Returns a block of the matrix `N W` of an interior-point step, from the block of the Delassus operator `W` and
    /// the velocity `u`, on which `N` depends; without friction only the normal row of the block is nonzero.
    fn turned(&self, u: &Vector3<f64>, block: &Matrix3<f64>) -> Matrix3<f64> {
        let mut turned = *block;
        if self.mu == 0.0 {
            turned.row_mut(1).fill(0.0);
            turned.row_mut(2).fill(0.0);
            return turned;
        }
        let (slip, speed) = (tangent(u), tangent(u).norm());
        if speed > 0.0 {
            let along = slip * (self.mu / speed);
            let more = block.row(1) * along.x + block.row(2) * along.y;
            turned.set_row(0, &(block.row(0) + more));
        }
        turned
    }

    /// Returns the diagonal term `T V^2 T` of the matrix of an interior-point step; without friction the term makes the
    /// tangential impulses zero.
    fn stiffness(&self, scaling: &NtScaling) -> Matrix3<f64> {
        let square = scaling.square();
        if self.mu == 0.0 {
            return Matrix3::from_diagonal(&Vector3::new(square[(0, 0)], 1.0, 1.0));
        }
        let widen = Matrix3::from_diagonal(&Vector3::new(self.mu, 1.0, 1.0));
        widen * square * widen
    }

    /// Returns `T dr`, the change of the scaled impulse `z` that belongs to a change `dr` of the impulse; without
    /// friction only its normal component is nonzero.
    fn change(&self, dr: &Vector3<f64>) -> Vector3<f64> {
        if self.mu == 0.0 { Vector3::x() * dr.x } else { widened(self.mu, dr) }
    }

    /// Returns the largest step length, up to 1, along which both `z` and `s` stay in their cones.
    fn longest(&self, change: &Change) -> f64 {
        longest(&self.z, &change.z).min(longest(&self.s, &change.s))
    }
}

/// Returns `T x` with `T = diag(mu, 1, 1)`, which multiplies the normal component by the friction coefficient.
fn widened(mu: f64, x: &Vector3<f64>) -> Vector3<f64> {
    Vector3::new(mu * x.x, x.y, x.z)
}

/// The changes `dz` of the scaled impulse and `ds` of the scaled velocity of a contact in one step.
#[derive(Clone, Copy, Debug, Default)]
struct Change {
    z: Vector3<f64>,
    s: Vector3<f64>,
}

/// The target point of an interior-point step.
#[derive(Clone, Copy, Debug)]
enum Aim {
    /// The solution itself, where all products `z o s` vanish; products of changes are neglected (predictor).
    Solution,
    /// The point of the central path with the mean `sigma m` of `<z, s>`, with the products of the changes of the
    /// predictor taken into account (corrector). Holds `sigma m`.
    Path(f64),
    /// The point of the central path with the current mean `m` of `<z, s>`, which is held.
    Centre(f64),
}

/// The interior-point method for problems of one block pattern; allocates when built.
pub(super) struct InteriorPoint {
    system: BlockSystem,
    pairs: Vec<Pair>,
    scalings: Vec<NtScaling>,
    impulses: Vec<Vector3<f64>>,
    velocities: Vec<Vector3<f64>>,
    /// For each contact, the right-hand side `V d` and the change of `z` and `s` in the last interior-point step.
    targets: Vec<Vector3<f64>>,
    changes: Vec<Change>,
    right: Vec<f64>,
    /// The length of the last interior-point step, as a fraction of the Newton step.
    last: f64,
}

impl InteriorPoint {
    /// Creates a solver for the pattern of a scaled problem; returns `None` if memory does not suffice.
    pub fn new(scaling: &Scaling) -> Option<Self> {
        let n = scaling.problem.contacts();
        Some(Self {
            system: BlockSystem::new(scaling.problem.matrix())?,
            pairs: Vec::with_capacity(n),
            scalings: Vec::with_capacity(n),
            impulses: Vec::with_capacity(n),
            velocities: Vec::with_capacity(n),
            targets: vec![Vector3::zeros(); n],
            changes: vec![Change::default(); n],
            right: vec![0.0; 3 * n],
            last: 1.0,
        })
    }

    /// Improves the impulses `r`, whose residual is `residual`, within `budget` steps from each start; returns the
    /// number of steps and the residual of the best point found, which is written to `r`.
    pub fn improve(
        &mut self,
        task: &Task<'_>,
        r: &mut [Vector3<f64>],
        mut residual: Residual,
        budget: usize,
    ) -> (usize, Residual) {
        let problem = &task.scaling.problem;
        let n = problem.contacts();
        let size = (problem.q().iter().map(Vector3::norm_squared).sum::<f64>() / n as f64).sqrt();
        let mut steps = 0;
        for room in ROOMS {
            if residual.strict <= KNOWN {
                break;
            }
            let pair = |k: usize| Pair::inside(problem.mu()[k], &r[k], &problem.velocity(k, r), room * size);
            self.pairs.clear();
            self.pairs.extend((0..n).map(pair));
            self.last = 1.0;
            steps += self.descend(task, r, &mut residual, budget);
        }
        (steps, residual)
    }

    /// Makes steps from the current point, and writes each point that lowers the residual to `r`; returns the number
    /// of steps.
    fn descend(&mut self, task: &Task<'_>, r: &mut [Vector3<f64>], residual: &mut Residual, budget: usize) -> usize {
        let (mut stalls, mut steps) = (0, 0);
        self.evaluate(task.scaling);
        while steps < budget && stalls < STALLS && !task.is_over(residual.strict / BEYOND) {
            steps += 1;
            if self.step(task.scaling).is_none() {
                break;
            }
            stalls = if self.last < SHORT { stalls + 1 } else { 0 };
            self.evaluate(task.scaling);
            let found = task.scaling.residual(&self.impulses);
            if found.strict < residual.strict {
                *residual = found;
                r.copy_from_slice(&self.impulses);
            } else if task.is_over(residual.strict) {
                break;
            }
        }
        steps
    }

    /// Computes the contact impulses and relative velocities of the current iterate.
    fn evaluate(&mut self, scaling: &Scaling) {
        self.impulses.clear();
        self.impulses.extend(self.pairs.iter().map(Pair::impulse));
        self.velocities.clear();
        self.velocities.extend((0..self.pairs.len()).map(|k| scaling.problem.velocity(k, &self.impulses)));
    }

    /// Makes one interior-point step from the current point; returns `None` if the linear system gives no finite
    /// direction.
    fn step(&mut self, scaling: &Scaling) -> Option<()> {
        self.scalings.clear();
        self.scalings.extend(self.pairs.iter().map(Pair::scaling));
        let (pairs, scalings, velocities) = (&self.pairs, &self.scalings, &self.velocities);
        let factored = self.system.factorise(scaling.problem.matrix(), |i, j, block| {
            let turned = pairs[i].turned(&velocities[i], block);
            if i == j { turned + pairs[i].stiffness(&scalings[i]) } else { turned }
        });
        if !factored {
            return None;
        }
        let mean = self.mean_after(0.0);
        let most = if self.last < LONG {
            self.direct(Aim::Centre(mean))?
        } else {
            let to_solution = self.direct(Aim::Solution)?;
            let sigma = (self.mean_after(to_solution) / mean).clamp(0.0, 1.0).powi(3);
            self.direct(Aim::Path(sigma * mean))?
        };
        self.last = (FRACTION * most).min(1.0);
        for (pair, change) in self.pairs.iter_mut().zip(&self.changes) {
            pair.z += change.z * self.last;
            pair.s += change.s * self.last;
        }
        Some(())
    }

    /// Returns the mean of `<z, s>` over the contacts after a step of the given length.
    fn mean_after(&self, length: f64) -> f64 {
        let after = |(pair, change): (&Pair, &Change)| (pair.z + change.z * length).dot(&(pair.s + change.s * length));
        self.pairs.iter().zip(&self.changes).map(after).sum::<f64>() / self.pairs.len() as f64
    }

    /// Computes the changes of all contacts in a step towards `aim`; returns the largest length of the step, `None`
    /// if a change is not finite.
    fn direct(&mut self, aim: Aim) -> Option<f64> {
        for (k, (target, right)) in self.targets.iter_mut().zip(self.right.chunks_exact_mut(3)).enumerate() {
            let (pair, scaling) = (&self.pairs[k], &self.scalings[k]);
            let l = scaling.times(&pair.z);
            let square = product(&l, &l);
            let wanted = match aim {
                Aim::Solution => -square,
                Aim::Centre(mean) => Vector3::x() * mean - square,
                Aim::Path(mean) => {
                    let Change { z, s } = self.changes[k];
                    Vector3::x() * mean - square - product(&scaling.divide(&s), &scaling.times(&z))
                }
            };
            *target = scaling.times(&quotient(&wanted, &l));
            right.copy_from_slice((pair.change(target) - pair.defect(&self.velocities[k])).as_slice());
        }
        if !self.system.solve(&mut self.right) {
            return None;
        }
        let mut most = 1.0_f64;
        for (k, (change, dr)) in self.changes.iter_mut().zip(self.right.chunks_exact(3)).enumerate() {
            let (pair, scaling) = (&self.pairs[k], &self.scalings[k]);
            change.z = pair.change(&Vector3::new(dr[0], dr[1], dr[2]));
            change.s = self.targets[k] - scaling.times(&scaling.times(&change.z));
            let longest = pair.longest(change);
            if !longest.is_finite() {
                return None;
            }
            most = most.min(longest);
        }
        Some(most)
    }
}
