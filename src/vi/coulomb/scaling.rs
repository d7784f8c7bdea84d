//! Scaling of each contact by its own unit: `W' = D W D`, `q' = D q`, `r' = D^-1 r`, `u' = D u` with a positive `d_k`
//! for each contact preserves every cone, and therefore Coulomb's law. With `d_k = (tr W_kk / 3)^(-1/2)` the diagonal
//! blocks have unit mean eigenvalue, and `r'` and `u'` have the same unit, the square root of an energy, so that
//! their difference in the natural map is meaningful and the parameters of every method can be pure numbers.

use super::CoulombProblem;
use super::cone::FrictionCone;
use super::patch::Role;
use nalgebra::{Matrix3, Vector3};

/// The residual of Coulomb's law at a point.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(super) struct Residual {
    /// The larger of the relative natural maps of `r'` in the scaled problem and of `r = D r'` in the user's units.
    /// It shows progress also while heavy loads still increase the impulses.
    pub relative: f64,
    /// The larger of `relative` and the scaled natural map relative to velocities alone; a point is a solution if it
    /// is small. If no solution exists, impulses grow without bound, and relative to them every residual would be
    /// small.
    pub strict: f64,
}

/// Scale of impulses in the strict residual. Scaled impulses have the size of scaled velocities, or are larger by the
/// ratio of masses that press on each other, and so are the rounding errors of `W r`. The residual relative to
/// velocities is therefore allowed the fraction `IMPULSE_ROOM` of `|r|`, and at most the multiple `LARGEST_ROOM` of
/// `|q|`, so that mass ratios up to 1e8 can reach residuals of 1e-10.
const IMPULSE_ROOM: f64 = 1e-4;
const LARGEST_ROOM: f64 = 1e4;

/// The scales `d_k` of the contacts, and the scaled problem.
#[derive(Clone, Debug, Default)]
pub(super) struct Scaling {
    pub d: Vec<f64>,
    pub problem: CoulombProblem,
}

impl Scaling {
    pub fn fit(&mut self, problem: &CoulombProblem) {
        self.d.clear();
        self.d.extend((0..problem.contacts()).map(|k| unit(problem.matrix().diagonal(k))));
        // A patch has one unit for both of its block rows: that of its force.
        for k in (0..problem.contacts()).filter(|&k| problem.role(k) == Role::Torque) {
            self.d[k] = self.d[k - 1];
        }
        problem.scale_into(&self.d, &mut self.problem);
    }

    pub fn residual(&self, r: &[Vector3<f64>]) -> Residual {
        if self.problem.has_patches() {
            return self.residual_with_patches(r);
        }
        let contact = |(k, r_k): (usize, &Vector3<f64>)| {
            let cone = FrictionCone { mu: self.problem.mu()[k] };
            (cone, self.d[k], *r_k, self.problem.velocity(k, r), self.problem.q()[k])
        };
        residual(r.iter().enumerate().map(contact))
    }

    fn residual_with_patches(&self, r: &[Vector3<f64>]) -> Residual {
        let u: Vec<Vector3<f64>> = (0..r.len()).map(|k| self.problem.velocity(k, r)).collect();
        let (mut scaled, mut plain) = ([0.0; 4], [0.0; 4]);
        for (sums, power) in [(&mut scaled, 0), (&mut plain, 1)] {
            let unit = |k: usize| self.d[k].powi(power);
            let of = |k: usize, map: Vector3<f64>| {
                let terms = [map, self.problem.q()[k] / unit(k), r[k] * unit(k), u[k] / unit(k)];
                sums.iter_mut().zip(terms).for_each(|(sum, v)| *sum += v.norm_squared());
            };
            self.problem.natural_maps(|k| r[k] * unit(k), |k| u[k] / unit(k), of);
        }
        Residual::of(scaled, plain)
    }

    pub fn scale<'a>(&'a self, r: &'a [Vector3<f64>]) -> impl Iterator<Item = Vector3<f64>> + 'a {
        r.iter().zip(&self.d).map(|(r, d)| r / *d)
    }

    pub fn unscale<'a>(&'a self, r: &'a [Vector3<f64>]) -> impl Iterator<Item = Vector3<f64>> + 'a {
        r.iter().zip(&self.d).map(|(r, d)| r * *d)
    }
}

/// Returns the scale `d_k` of a contact with the diagonal block `W_kk`.
pub(super) fn unit(diagonal: &Matrix3<f64>) -> f64 {
    let d = (diagonal.trace() / 3.0).powf(-0.5);
    if d.is_finite() && d > 0.0 { d } else { 1.0 }
}

/// Returns the residual of Coulomb's law over all contacts, each given by its cone, its scale `d`, and the scaled
/// `r`, `u` and `q`.
pub(super) fn residual(
    contacts: impl Iterator<Item = (FrictionCone, f64, Vector3<f64>, Vector3<f64>, Vector3<f64>)>,
) -> Residual {
    let (mut scaled, mut plain) = ([0.0; 4], [0.0; 4]);
    for (cone, d, r, u, q) in contacts {
        for (sums, r, u, q) in [(&mut scaled, r, u, q), (&mut plain, r * d, u / d, q / d)] {
            for (sum, v) in sums.iter_mut().zip([cone.natural_map(r, u), q, r, u]) {
                *sum += v.norm_squared();
            }
        }
    }
    Residual::of(scaled, plain)
}

impl Residual {
    /// Computes the residual from the squared norms of the natural map, `q`, `r` and `u`.
    fn of(scaled: [f64; 4], plain: [f64; 4]) -> Self {
        let [map, q, r, u] = scaled.map(f64::sqrt);
        if map == 0.0 || map.is_nan() {
            return Self { relative: map, strict: map };
        }
        let [plain_map, plain_q, plain_r, plain_u] = plain.map(f64::sqrt);
        let relative = (map / q.max(r).max(u)).max(plain_map / plain_q.max(plain_r).max(plain_u));
        Self { relative, strict: relative.max(map / (q.max(u) + (IMPULSE_ROOM * r).min(LARGEST_ROOM * q))) }
    }
}
