//! Residuals of Coulomb's law: the error measure of the FCLIB collection (Acary, Bremond, Huber, Koziara and others
//! 2014, *FCLIB: a collection of discrete 3D frictional contact problems*), and each part of the law separately.

use super::CoulombProblem;
use super::cone::{FrictionCone, tangent};
use super::patch::Role;
use nalgebra::Vector3;

/// The residuals of Coulomb's law at a point. Norms are those of the user's `r` and `u`, unscaled.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Evidence {
    /// The norm of the natural map, `sqrt(sum_k |r_k - P_K(r_k - u_k - mu |u_t| n)|^2)`.
    pub natural_map: f64,
    /// The norm of the natural map relative to `max(|q|, |r|, |u|)`; zero if all of these are zero.
    pub relative: f64,
    /// The violation of Signorini's condition, `max_k |min(r_n, u_n)|`.
    pub signorini: f64,
    /// The violation of the friction cones, `max_k (|r_t| - mu r_n)`, at least zero.
    pub cone_violation: f64,
    /// The deviation of friction from maximal dissipation, `max_k |r_t . u_t + mu r_n |u_t||`.
    pub dissipation_gap: f64,
}

/// A block row of a contact problem: its role, friction coefficient, vectors `q`, `r` and `u`, and natural map.
pub(super) struct Row {
    pub role: Role,
    pub mu: f64,
    pub q: Vector3<f64>,
    pub r: Vector3<f64>,
    pub u: Vector3<f64>,
    pub map: Vector3<f64>,
}

impl Row {
    /// Builds the block row of a point contact.
    pub fn of_point(mu: f64, q: Vector3<f64>, r: Vector3<f64>, u: Vector3<f64>) -> Self {
        Self { role: Role::Point, mu, q, r, u, map: FrictionCone { mu }.natural_map(r, u) }
    }
}

impl Evidence {
    /// Evaluates the residuals at the impulses `r`; the relative residual is NaN if a value is not finite.
    pub fn of(problem: &CoulombProblem, r: &[Vector3<f64>]) -> Self {
        let u: Vec<Vector3<f64>> = (0..r.len()).map(|k| problem.velocity(k, r)).collect();
        let mut maps = vec![Vector3::zeros(); r.len()];
        problem.natural_maps(|k| r[k], |k| u[k], |k, map| maps[k] = map);
        let row = |k: usize| {
            let (role, mu, q) = (problem.role(k), problem.mu()[k], problem.q()[k]);
            Row { role, mu, q, r: r[k], u: u[k], map: maps[k] }
        };
        Self::of_rows((0..r.len()).map(row))
    }

    /// Computes the residuals from the given block rows.
    pub(super) fn of_rows(rows: impl Iterator<Item = Row>) -> Self {
        let mut evidence = Self::default();
        let (mut map, mut q_norm, mut r_norm, mut u_norm) = (0.0, 0.0, 0.0, 0.0);
        for Row { role, mu, q, r, u, map: of_row } in rows {
            map += of_row.norm_squared();
            q_norm += q.norm_squared();
            r_norm += r.norm_squared();
            u_norm += u.norm_squared();
            if role == Role::Torque {
                continue;
            }
            let (slip, friction) = (tangent(&u), tangent(&r));
            evidence.signorini = evidence.signorini.max(r.x.min(u.x).abs());
            evidence.cone_violation = evidence.cone_violation.max(friction.norm() - mu * r.x);
            let gap = (friction.dot(&slip) + mu * r.x * slip.norm()).abs();
            // The power of friction of a patch has further terms; a violation shows in the natural map.
            if role == Role::Point {
                evidence.dissipation_gap = evidence.dissipation_gap.max(gap);
            }
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
