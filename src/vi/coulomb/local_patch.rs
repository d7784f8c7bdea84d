//! Solution of one contact patch: `u = W r + q` with a 6 x 6 `W`, by Newton's method on the [function of Alart and
//! Curnier](super::patch), and if that stalls by a bracket of the normal impulse.
//!
//! For a given normal impulse `nu` the law of friction is a convex problem,
//!
//! ```text
//! s(nu) = argmin { s . W_ss s / 2 + s . (q_s + W_sn nu) : s in nu S }
//! ```
//!
//! and one equation is left, `u_n(nu) = W_nn nu + W_ns s(nu) + q_n = 0`. Its left side is continuous if `W` is
//! positive definite, negative at zero if the contact closes, and positive for large `nu`: `s(nu)/nu` tends to some
//! `t`, where `W_ns t <= -t . W_ss t` since zero lies in `S`, and with `(W_ns t)^2 < W_nn t . W_ss t` it follows that
//! `-W_ns t < W_nn`. So there is a root, which a bracket finds from any start. The convex problem is solved by
//! Newton's method on the fixed points of projected gradients; projected gradient steps take over if a Newton step
//! does not halve the length of the gradient step: they never lengthen it, and converge.

use super::BlockMatrix;
use super::patch::{Pair, Parts, PatchCone, Projected, Reach, both, joined, pair, parts};
use super::scaling::unit;
use nalgebra::{Matrix6, SMatrix, Vector3, Vector6};

/// Largest number of Newton steps for one patch, and the residual, relative to its terms, below which no further step
/// is made.
const STEPS: usize = 60;
const SOLVED: f64 = 1e-14;

/// The shortest step length of Newton's method, and the relative residual of its result above which bracketing takes
/// over.
const SHORTEST: f64 = 1e-4;
const ROUGH: f64 = 1e-12;

/// Largest number of halvings of a bracket of the normal impulse, and of doublings that find a bracket from any
/// scale.
const BISECTIONS: usize = 100;
const DOUBLINGS: usize = 200;

/// Largest number of iterations for the convex problem of friction; each is a Newton step or, if that does not halve
/// the gradient step, a number of projected gradient steps (`GRADIENTS`).
const TURNS: usize = 100;
const GRADIENTS: usize = 20;

/// Returns the impulses (force and torque) of one contact patch whose force is block row `k` of `W`. `q` are the
/// velocities of its two rows without these impulses. The iteration starts from `r`; the result is never worse than
/// `r`.
pub fn solve_patch(matrix: &BlockMatrix, k: usize, q: &Pair, mu: f64, reach: Reach, r: &Pair) -> Pair {
    let mut own = Matrix6::zeros();
    for (i, j) in [(0, 0), (0, 1), (1, 0), (1, 1)] {
        if let Some(block) = matrix.block(k + i, k + j) {
            own.fixed_view_mut::<3, 3>(3 * i, 3 * j).copy_from(block);
        }
    }
    // Scale to the unit of the contact, in which impulses and velocities have the same unit.
    let d = unit(&own.fixed_view::<3, 3>(0, 0).into_owned());
    let contact = PatchContact { cone: PatchCone { mu, reach }, matrix: own * (d * d), q: both(q) * d };
    contact.solve(&r.map(|r| r / d)).map(|r| r * d)
}

/// One contact patch, scaled to units in which impulses and velocities have the same unit.
struct PatchContact {
    cone: PatchCone,
    matrix: Matrix6<f64>,
    q: Vector6<f64>,
}

impl PatchContact {
    fn velocity(&self, r: &Vector6<f64>) -> Pair {
        pair(&(self.matrix * r + self.q))
    }

    fn residual(&self, r: &Vector6<f64>) -> f64 {
        both(&self.cone.value(&pair(r), &self.velocity(r))).norm()
    }

    fn is_within(&self, accuracy: f64, size: f64, r: &Vector6<f64>) -> bool {
        size <= accuracy * (r.norm() + self.q.norm())
    }

    /// Returns the impulses of the patch, starting from `r`; the result is never worse than `r`.
    fn solve(&self, r: &Pair) -> Pair {
        if self.q.x >= 0.0 {
            return [Vector3::zeros(); 2];
        }
        let (mut r, size) = self.newton(&both(r));
        if !self.is_within(ROUGH, size, &r)
            && let Some(found) = self.bracketed(&r)
        {
            let (found, at) = self.newton(&found);
            if at < size {
                r = found;
            }
        }
        pair(&r)
    }

    /// Runs Newton's method with a line search, as long as the residual decreases; returns the last impulses and
    /// their residual.
    fn newton(&self, r: &Vector6<f64>) -> (Vector6<f64>, f64) {
        let (mut r, mut size) = (*r, self.residual(r));
        for _ in 0..STEPS {
            if self.is_within(SOLVED, size, &r) {
                break;
            }
            let (value, by_y) = self.cone.linearise(&pair(&r), &self.velocity(&r));
            let newton = (by_y * self.matrix + Matrix6::identity() - by_y).lu().solve(&-value);
            let Some(direction) = newton.filter(|newton| newton.iter().all(|x| x.is_finite())) else { break };
            let mut length = 1.0;
            let mut found = None;
            while length >= SHORTEST && found.is_none() {
                let trial = r + direction * length;
                let at = self.residual(&trial);
                found = (at < (1.0 - SHORTEST * length) * size).then_some((trial, at));
                length *= 0.5;
            }
            let Some(next) = found else { break };
            (r, size) = next;
        }
        (r, size)
    }

    /// Finds the normal impulse `nu` at which the normal velocity `u_n(nu)` is zero, in a bracket with Newton steps
    /// inside it; returns `None` if the root is beyond all scales.
    fn bracketed(&self, start: &Vector6<f64>) -> Option<Vector6<f64>> {
        let (w_nn, q_n) = (self.matrix[(0, 0)], self.q.x);
        let w_ns = self.matrix.fixed_view::<1, 5>(0, 1);
        let (mut lower, mut upper) = (0.0, f64::INFINITY);
        let mut nu = if start.x > 0.0 { start.x } else { -q_n / w_nn };
        if !(nu.is_finite() && nu > 0.0) {
            return None;
        }
        let mut s = parts(&pair(start));
        for _ in 0..BISECTIONS + DOUBLINGS {
            let by_nu;
            (s, by_nu) = self.friction(nu, &s);
            let along = (w_ns * s).x;
            let u_n = w_nn * nu + along + q_n;
            if u_n.abs() <= SOLVED * (w_nn * nu + along.abs() - q_n) {
                return Some(both(&joined(nu, &s)));
            }
            *if u_n < 0.0 { &mut lower } else { &mut upper } = nu;
            let slope = w_nn + by_nu.map_or(0.0, |by_nu| (w_ns * by_nu).x);
            let newton = nu - u_n / slope;
            let middle = if upper.is_finite() { 0.5 * (lower + upper) } else { 2.0 * lower };
            let next = if newton > lower && newton < upper.min(2.0 * middle) { newton } else { middle };
            if next == nu || !next.is_finite() {
                break;
            }
            nu = next;
        }
        upper.is_finite().then(|| both(&joined(nu, &s)))
    }

    /// Returns the friction of the patch for the normal impulse `nu`, starting from `s`, and its derivative by `nu`.
    fn friction(&self, nu: f64, s: &Parts) -> (Parts, Option<Parts>) {
        let w_ss = self.matrix.fixed_view::<5, 5>(1, 1).into_owned();
        let w_sn = self.matrix.fixed_view::<5, 1>(1, 0).into_owned();
        let q = self.q.fixed_rows::<5>(1) + w_sn * nu;
        // The step length of projected gradients is below the reciprocal of the largest eigenvalue.
        let step = w_ss.trace().recip();
        let step = if step.is_finite() { step } else { 1.0 };
        let kept = SMatrix::<f64, 5, 5>::identity() - w_ss * step;
        let project = |s: &Parts| self.cone.onto(&(kept * s - q * step), nu);
        let newton = |at: &Projected| (SMatrix::<f64, 5, 5>::identity() - at.by_point * kept).lu();
        let mut s = *s;
        let mut at = project(&s);
        for _ in 0..TURNS {
            let size = (at.value - s).norm();
            if size <= SOLVED * (at.value.norm() + step * q.norm()) {
                break;
            }
            let halves = |trial: &Parts, next: &Projected| (next.value - trial).norm() <= 0.5 * size;
            let found = newton(&at).solve(&(at.value - s)).map(|direction| s + direction);
            let found = found.map(|trial| (trial, project(&trial))).filter(|(trial, next)| halves(trial, next));
            (s, at) = found.unwrap_or_else(|| {
                for _ in 0..GRADIENTS {
                    s = at.value;
                    at = project(&s);
                }
                (s, at)
            });
        }
        let by_nu = newton(&at).solve(&(at.by_rho - at.by_point * w_sn * step));
        (at.value, by_nu)
    }
}

#[cfg(test)]
mod tests {
    use super::super::tests::{REACHES, Random};
    use super::*;

    #[test]
    fn one_contact_is_solved_from_any_start() {
        let mut random = Random(11);
        for (mu, reach) in [0.0, 0.2, 0.8, 3.0].into_iter().flat_map(|mu| REACHES.map(|reach| (mu, reach))) {
            for (turn, unit) in (0..200).zip([1.0, 1e-9, 1e9].into_iter().cycle()) {
                let a = Matrix6::from_fn(|_, _| 0.5 * random.number());
                let w = (a * a.transpose() + Matrix6::identity() * if turn % 2 == 0 { 0.5 } else { 0.01 }) * unit;
                let q = Vector6::from_fn(|_, _| 2.0 * random.number());
                let starts = [Vector6::zeros(), Vector6::from_fn(|_, _| 50.0 / unit * random.number())];
                for start in starts {
                    let blocks =
                        (0..4).map(|k| (k / 2, k % 2, w.fixed_view::<3, 3>(3 * (k / 2), 3 * (k % 2)).into_owned()));
                    let matrix = BlockMatrix::from_blocks(2, blocks).unwrap();
                    let r = both(&solve_patch(&matrix, 0, &pair(&q), mu, reach, &pair(&start)));
                    // Require that the residual of the contact law, in the unit in which the matrix `w` is of size one,
                    // is at most the tolerance plus the effect of rounding errors of the velocities.
                    let cone = PatchCone { mu, reach };
                    let rounding = 16.0 * f64::EPSILON * (w.norm() * r.norm() + q.norm());
                    let (u, r) = (pair(&(w * r + q)), r * unit);
                    let map = both(&cone.natural_map(&pair(&r), &u)).norm();
                    let size = r.norm() + cone.support(&u) + q.norm();
                    let most = 1e-10 * size + cone.support(&[Vector3::repeat(rounding); 2]);
                    assert!(map < most, "{mu} {reach:?} {turn} {start:?} {q:?}: {map:e} of {size:e}");
                }
            }
        }
    }
}
