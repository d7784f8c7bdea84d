//! A primal-dual interior-point method for Coulomb's law, in the form of de Saxce,
//!
//! ```text
//! u = W r + q,    y = u + (mu |u_t|, 0, 0),    r in K_mu,  y in K_mu*,  r o y = 0
//! ```
//!
//! (Acary, Armand, Nguyen and Prasad 2023, *Second-order cone programming for frictional contact mechanics using interior point
//! algorithm*, with the slip speed as a function of the unknowns in place of an outer iteration; Mehrotra 1992; the scaling of
//! Nesterov and Todd 1997). In the coordinates `z = (mu r_n, r_t)` and `s = (y_n/mu, y_t)` both cones are the cone of Lorentz. With the
//! scaling `V`, for which `V z = V^-1 s = l`, a step solves
//!
//! ```text
//! N W dr + T V^2 T dr = T V d - (u + (mu |u_t|, 0, 0) - y),    N = I + n (0, mu u_t/|u_t|)^T,    T = diag(mu, 1, 1)
//! ```
//!
//! where `l o d = sigma m e - l o l - (V^-1 ds) o (V dz)`. The matrix has the pattern of `W`, and is regular also where `W` is not. The
//! number of steps hardly depends on the number of contacts; what the last digits need, Newton's method does from here.

use super::cone::{FrictionCone, join, tangent};
use super::linear::BlockSystem;
use super::portfolio::Task;
use super::scaling::{Residual, Scaling};
use nalgebra::{Matrix3, Vector2, Vector3};

/// The fraction of the way to the boundary of the cones that a step takes; the rest vanishes with the residual.
const FRACTION: f64 = 0.995;

/// A step shorter than this is no progress; after `STALLS` in a row the method ends.
const SHORT: f64 = 1e-3;
const STALLS: usize = 3;

/// The state of a contact: `z` and `s`, in Lorentz cones; on a half-line, without friction.
#[derive(Clone, Copy, Debug)]
struct Pair {
    mu: f64,
    z: Vector3<f64>,
    s: Vector3<f64>,
}

/// The scaling of a contact: `V = beta (2 v v^T - J)`; the square root of `s/z` without friction.
#[derive(Clone, Copy, Debug)]
enum Nt {
    Cone { beta: f64, v: Vector3<f64> },
    Line(f64),
}

/// `J v`, the reflection of the tangential part.
fn reflect(v: &Vector3<f64>) -> Vector3<f64> {
    Vector3::new(v.x, -v.y, -v.z)
}

/// `v^T J v`, positive within the cone.
fn determinant(v: &Vector3<f64>) -> f64 {
    let slip = tangent(v).norm();
    (v.x - slip) * (v.x + slip)
}

/// The product of the Jordan algebra of the cone.
fn jordan(a: &Vector3<f64>, b: &Vector3<f64>) -> Vector3<f64> {
    join(a.dot(b), tangent(b) * a.x + tangent(a) * b.x)
}

/// The solution `d` of `l o d = b`.
fn divide(b: &Vector3<f64>, l: &Vector3<f64>) -> Vector3<f64> {
    let normal = (l.x * b.x - tangent(l).dot(&tangent(b))) / determinant(l);
    join(normal, (tangent(b) - tangent(l) * normal) / l.x)
}

impl Nt {
    fn of(pair: &Pair) -> Self {
        if pair.mu == 0.0 {
            return Self::Line((pair.s.x / pair.z.x).sqrt());
        }
        let [of_z, of_s] = [&pair.z, &pair.s].map(|v| determinant(v).sqrt());
        let (z, s) = (pair.z / of_z, pair.s / of_s);
        let gamma = (0.5 * (1.0 + z.dot(&s))).sqrt();
        let w = (s + reflect(&z)) / (2.0 * gamma);
        let v = (w + Vector3::x()) / (2.0 * (w.x + 1.0)).sqrt();
        Self::Cone { beta: (of_s / of_z).sqrt(), v }
    }

    /// `V x`.
    fn times(&self, x: &Vector3<f64>) -> Vector3<f64> {
        match self {
            Self::Cone { beta, v } => (v * (2.0 * v.dot(x)) - reflect(x)) * *beta,
            Self::Line(root) => x * *root,
        }
    }

    /// `V^-1 x`.
    fn divide(&self, x: &Vector3<f64>) -> Vector3<f64> {
        match self {
            Self::Cone { beta, v } => {
                let v = reflect(v);
                (v * (2.0 * v.dot(x)) - reflect(x)) / *beta
            }
            Self::Line(root) => x / *root,
        }
    }

    /// `V^2`.
    fn square(&self) -> Matrix3<f64> {
        let columns = [Vector3::x(), Vector3::y(), Vector3::z()].map(|e| self.times(&self.times(&e)));
        Matrix3::from_columns(&columns)
    }
}

/// The largest step, up to 1, from `x` along `dx` within the cone of Lorentz.
fn longest(x: &Vector3<f64>, dx: &Vector3<f64>) -> f64 {
    // The first positive root of det(x + a dx) = c + 2 b a + a^2 d.
    let (c, d) = (determinant(x), determinant(dx));
    let b = x.x * dx.x - tangent(x).dot(&tangent(dx));
    let mut most = if dx.x < 0.0 { -x.x / dx.x } else { f64::INFINITY };
    let discriminant = b * b - c * d;
    if discriminant >= 0.0 {
        let q = -(b + discriminant.sqrt().copysign(b));
        for root in [q / d, c / q] {
            if root > 0.0 {
                most = most.min(root);
            }
        }
    }
    most.min(1.0)
}

impl Pair {
    /// `T v` and `T^-1 v`.
    fn widen(&self, v: &Vector3<f64>) -> Vector3<f64> {
        Vector3::new(self.mu * v.x, v.y, v.z)
    }

    fn narrow(&self, v: &Vector3<f64>) -> Vector3<f64> {
        Vector3::new(v.x / self.mu, v.y, v.z)
    }

    /// The pair of an impulse and a velocity, moved into the interior by `room`.
    fn inside(mu: f64, r: &Vector3<f64>, u: &Vector3<f64>, room: f64) -> Self {
        let room = Vector3::x() * room;
        if mu == 0.0 {
            return Self { mu, z: Vector3::x() * r.x.max(0.0) + room, s: Vector3::x() * u.x.max(0.0) + room };
        }
        let unset = Self { mu, z: Vector3::zeros(), s: Vector3::zeros() };
        let lorentz = FrictionCone { mu: 1.0 };
        let y = FrictionCone { mu }.augment(*u);
        Self { mu, z: lorentz.project(unset.widen(r)) + room, s: lorentz.project(unset.narrow(&y)) + room }
    }

    fn impulse(&self) -> Vector3<f64> {
        if self.mu == 0.0 { self.z } else { self.narrow(&self.z) }
    }

    /// The largest step within both cones.
    fn longest(&self, (dz, ds): &(Vector3<f64>, Vector3<f64>)) -> f64 {
        if self.mu == 0.0 {
            let of = |x: f64, dx: f64| if dx < 0.0 { (-x / dx).min(1.0) } else { 1.0 };
            return of(self.z.x, dz.x).min(of(self.s.x, ds.x));
        }
        longest(&self.z, dz).min(longest(&self.s, ds))
    }

    /// `u + (mu |u_t|, 0, 0) - y`; in the normal direction only without friction.
    fn gap(&self, u: &Vector3<f64>) -> Vector3<f64> {
        if self.mu == 0.0 {
            return Vector3::x() * (u.x - self.s.x);
        }
        FrictionCone { mu: self.mu }.augment(*u) - self.widen(&self.s)
    }
}

/// The method, for problems of one pattern; allocates when built.
pub(super) struct InteriorPoint {
    system: BlockSystem,
    pairs: Vec<Pair>,
    scalings: Vec<Nt>,
    velocities: Vec<Vector3<f64>>,
    directions: Vec<(Vector3<f64>, Vector3<f64>)>,
    right: Vec<f64>,
    impulses: Vec<Vector3<f64>>,
    changes: Vec<Vector3<f64>>,
}

impl InteriorPoint {
    /// A solver for the pattern of a scaled problem; `None` if memory does not suffice.
    pub fn new(scaling: &Scaling) -> Option<Self> {
        let n = scaling.problem.contacts();
        Some(Self {
            system: BlockSystem::new(scaling.problem.matrix())?,
            pairs: Vec::with_capacity(n),
            scalings: Vec::with_capacity(n),
            velocities: Vec::with_capacity(n),
            directions: vec![Default::default(); n],
            right: vec![0.0; 3 * n],
            impulses: Vec::with_capacity(n),
            changes: vec![Vector3::zeros(); n],
        })
    }

    /// Improves `r`, which has the residual `residual`, within `budget` steps; returns their number and the residual of the best
    /// point found, which is written to `r`.
    pub fn improve(
        &mut self,
        task: &Task<'_>,
        r: &mut [Vector3<f64>],
        mut residual: Residual,
        budget: usize,
    ) -> (usize, Residual) {
        let problem = &task.scaling.problem;
        let n = problem.contacts();
        let room = (problem.q().iter().map(Vector3::norm_squared).sum::<f64>() / n as f64).sqrt();
        self.pairs.clear();
        self.pairs.extend((0..n).map(|k| Pair::inside(problem.mu()[k], &r[k], &problem.velocity(k, r), room)));
        let (mut stalls, mut steps) = (0, 0);
        while steps < budget && stalls < STALLS && !task.is_over(residual.strict) {
            steps += 1;
            let Some(length) = self.step(task.scaling) else { break };
            stalls = if length < SHORT { stalls + 1 } else { 0 };
            self.refresh(task.scaling);
            let found = task.scaling.residual(&self.impulses);
            if found.strict < residual.strict {
                residual = found;
                r.copy_from_slice(&self.impulses);
            }
        }
        (steps, residual)
    }

    /// Writes impulses and velocities of the current point.
    fn refresh(&mut self, scaling: &Scaling) {
        self.impulses.clear();
        self.impulses.extend(self.pairs.iter().map(Pair::impulse));
        self.velocities.clear();
        self.velocities.extend((0..self.pairs.len()).map(|k| scaling.problem.velocity(k, &self.impulses)));
    }

    /// Makes a step, and returns its length; `None` if there is no direction.
    fn step(&mut self, scaling: &Scaling) -> Option<f64> {
        self.refresh(scaling);
        self.scalings.clear();
        self.scalings.extend(self.pairs.iter().map(Nt::of));
        let (pairs, scalings, velocities) = (&self.pairs, &self.scalings, &self.velocities);
        let factored = self.system.factorise(scaling.problem.matrix(), |i, j, block| {
            let product = turned(&pairs[i], &velocities[i], block);
            if i == j { product + stiffness(&pairs[i], &scalings[i]) } else { product }
        });
        if !factored {
            return None;
        }
        let gap = self.complementarity();
        let forward = |nt: &Nt, pair: &Pair| -> Vector3<f64> {
            let l = nt.times(&pair.z);
            if pair.mu == 0.0 { -l } else { divide(&-jordan(&l, &l), &l) }
        };
        let targets: Vec<Vector3<f64>> =
            self.scalings.iter().zip(&self.pairs).map(|(nt, pair)| forward(nt, pair)).collect();
        let affine = self.direct(&targets)?;
        let left: f64 = self
            .pairs
            .iter()
            .zip(&self.directions)
            .map(|(pair, (dz, ds))| (pair.z + dz * affine).dot(&(pair.s + ds * affine)))
            .sum();
        let sigma = (left / (gap * self.pairs.len() as f64)).clamp(0.0, 1.0).powi(3);
        let corrected = |(nt, pair, (dz, ds)): (&Nt, &Pair, &(Vector3<f64>, Vector3<f64>))| -> Vector3<f64> {
            let l = nt.times(&pair.z);
            let second = jordan(&nt.divide(ds), &nt.times(dz));
            let first = jordan(&l, &l);
            let wanted = Vector3::x() * (sigma * gap) - first - second;
            if pair.mu == 0.0 { Vector3::x() * (wanted.x / l.x) } else { divide(&wanted, &l) }
        };
        let targets: Vec<Vector3<f64>> = self
            .scalings
            .iter()
            .zip(&self.pairs)
            .zip(&self.directions)
            .map(|((nt, pair), direction)| corrected((nt, pair, direction)))
            .collect();
        let most = self.direct(&targets)?;
        let length = (FRACTION * most).min(1.0);
        for (pair, (dz, ds)) in self.pairs.iter_mut().zip(&self.directions) {
            pair.z += dz * length;
            pair.s += ds * length;
        }
        Some(length)
    }

    /// The mean of `<z, s>` over the contacts.
    fn complementarity(&self) -> f64 {
        self.pairs.iter().map(|pair| pair.z.dot(&pair.s)).sum::<f64>() / self.pairs.len() as f64
    }

    /// Computes the directions for the targets `d`; returns the largest step along them, `None` if they are not finite.
    fn direct(&mut self, targets: &[Vector3<f64>]) -> Option<f64> {
        for (k, right) in self.right.chunks_exact_mut(3).enumerate() {
            let (pair, nt) = (&self.pairs[k], &self.scalings[k]);
            let wanted = nt.times(&targets[k]);
            let wanted = if pair.mu == 0.0 { Vector3::x() * wanted.x } else { pair.widen(&wanted) };
            right.copy_from_slice((wanted - pair.gap(&self.velocities[k])).as_slice());
        }
        if !self.system.solve(&mut self.right) {
            return None;
        }
        for (change, d) in self.changes.iter_mut().zip(self.right.chunks_exact(3)) {
            *change = Vector3::new(d[0], d[1], d[2]);
        }
        let mut most = 1.0_f64;
        for (k, direction) in self.directions.iter_mut().enumerate() {
            let (pair, nt) = (&self.pairs[k], &self.scalings[k]);
            let dz = if pair.mu == 0.0 { Vector3::x() * self.changes[k].x } else { pair.widen(&self.changes[k]) };
            *direction = (dz, nt.times(&targets[k]) - nt.times(&nt.times(&dz)));
            let longest = pair.longest(direction);
            if longest.is_nan() {
                return None;
            }
            most = most.min(longest);
        }
        Some(most)
    }
}

/// `N W_ij`; of a contact without friction the normal row alone.
fn turned(pair: &Pair, u: &Vector3<f64>, block: &Matrix3<f64>) -> Matrix3<f64> {
    if pair.mu == 0.0 {
        return Matrix3::from_rows(&[
            block.row(0).into_owned(),
            Vector3::zeros().transpose(),
            Vector3::zeros().transpose(),
        ]);
    }
    let slip = tangent(u);
    let speed = slip.norm();
    let along = if speed > 0.0 { slip * (pair.mu / speed) } else { Vector2::zeros() };
    let mut turned = *block;
    let more = block.row(1) * along.x + block.row(2) * along.y;
    turned.row_mut(0).zip_apply(&more, |entry, more| *entry += more);
    turned
}

/// `T V^2 T`.
fn stiffness(pair: &Pair, nt: &Nt) -> Matrix3<f64> {
    match nt {
        Nt::Line(root) => Matrix3::from_diagonal(&Vector3::new(root * root, 1.0, 1.0)),
        Nt::Cone { .. } => {
            let widen = Matrix3::from_diagonal(&Vector3::new(pair.mu, 1.0, 1.0));
            widen * nt.square() * widen
        }
    }
}
