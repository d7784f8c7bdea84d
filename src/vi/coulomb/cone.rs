//! The friction cone `K_mu = { r : |r_t| <= mu r_n }` and its dual cone, `K_mu* = { v : mu |v_t| <= v_n }`.

use nalgebra::{Vector2, Vector3};

/// Returns the tangential part of a vector (normal, tangents).
pub(super) fn tangent(v: &Vector3<f64>) -> Vector2<f64> {
    Vector2::new(v.y, v.z)
}

/// Joins a normal and a tangential part to a vector.
pub(super) fn join(normal: f64, tangent: Vector2<f64>) -> Vector3<f64> {
    Vector3::new(normal, tangent.x, tangent.y)
}

/// The friction cone of one contact; a half-line for `mu = 0`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct FrictionCone {
    /// The coefficient of friction.
    pub mu: f64,
}

impl FrictionCone {
    /// Returns the Euclidean projection onto the friction cone `K_mu`.
    pub fn project(self, v: Vector3<f64>) -> Vector3<f64> {
        let slip = tangent(&v).norm();
        if self.mu * slip <= -v.x {
            return Vector3::zeros();
        }
        if slip <= self.mu * v.x {
            return v;
        }
        let normal = (v.x + self.mu * slip) / (1.0 + self.mu * self.mu);
        join(normal, tangent(&v) * (self.mu * normal / slip))
    }

    /// Returns the augmented velocity `u + (mu |u_t|, 0, 0)`: Coulomb's law requires it to lie in the dual cone
    /// `K_mu*`, orthogonal to `r`.
    pub fn augment(self, u: Vector3<f64>) -> Vector3<f64> {
        Vector3::new(u.x + self.mu * tangent(&u).norm(), u.y, u.z)
    }

    /// Returns the natural map `r - P_K(r - u - mu |u_t| n)`, which is zero if and only if Coulomb's law holds.
    pub fn natural_map(self, r: Vector3<f64>, u: Vector3<f64>) -> Vector3<f64> {
        r - self.project(r - self.augment(u))
    }
}
