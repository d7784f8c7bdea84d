//! Residuals of Coulomb's law: the error measure of the FCLIB collection (Acary, Bremond, Huber, Koziara and others
//! 2014, *FCLIB: a collection of discrete 3D frictional contact problems*), and each part of the law separately.

use super::CoulombProblem;
use super::cone::{FrictionCone, tangent};
use nalgebra::Vector3;

/// The residuals of Coulomb's law at a point. Norms are those of the user's `r` and `u`, unscaled.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Evidence {
    /// `sqrt(sum_k |r_k - P_K(r_k - u_k - mu |u_t| n)|^2)`.
    pub natural_map: f64,
    /// `natural_map` relative to `max(|q|, |r|, |u|)`; zero if all of these are.
    pub relative: f64,
    /// `max_k |min(r_n, u_n)|`: Signorini's condition.
    pub signorini: f64,
    /// `max_k (|r_t| - mu r_n)`, at least zero: the violation of the friction cones.
    pub cone_violation: f64,
    /// `max_k |r_t . u_t + mu r_n |u_t||`: the deviation of friction from maximal dissipation.
    pub dissipation_gap: f64,
}

impl Evidence {
    /// Evaluates the residuals at `r`; NaN if a value is not finite.
    pub fn of(problem: &CoulombProblem, r: &[Vector3<f64>]) -> Self {
        Self::of_contacts((0..r.len()).map(|k| (problem.mu()[k], problem.q()[k], r[k], problem.velocity(k, r))))
    }

    /// Evaluates the residuals of contacts with their `mu`, `q`, `r` and `u`.
    pub(super) fn of_contacts(contacts: impl Iterator<Item = (f64, Vector3<f64>, Vector3<f64>, Vector3<f64>)>) -> Self {
        let mut evidence = Self::default();
        let (mut map, mut q_norm, mut r_norm, mut u_norm) = (0.0, 0.0, 0.0, 0.0);
        for (mu, q, r_k, u) in contacts {
            map += FrictionCone { mu }.natural_map(r_k, u).norm_squared();
            q_norm += q.norm_squared();
            r_norm += r_k.norm_squared();
            u_norm += u.norm_squared();
            let (slip, friction) = (tangent(&u), tangent(&r_k));
            evidence.signorini = evidence.signorini.max(r_k.x.min(u.x).abs());
            evidence.cone_violation = evidence.cone_violation.max(friction.norm() - mu * r_k.x);
            let gap = (friction.dot(&slip) + mu * r_k.x * slip.norm()).abs();
            evidence.dissipation_gap = evidence.dissipation_gap.max(gap);
        }
        evidence.natural_map = f64::sqrt(map);
        let size: f64 = q_norm.max(r_norm).max(u_norm).sqrt();
        evidence.relative = if size == 0.0 { 0.0 } else { evidence.natural_map / size };
        if !(q_norm + r_norm + u_norm).is_finite() {
            evidence.relative = f64::NAN;
        }
        evidence
    }
}
