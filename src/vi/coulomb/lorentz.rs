//! The Lorentz (second-order) cone, `L = { x : |x_t| <= x_0 }`, with its Jordan algebra, as interior-point methods
//! need it (Nesterov and Todd 1997; Vandenberghe 2010, *The CVXOPT linear and quadratic cone program solvers*).
//! Friction cones and their duals become this cone in the coordinates `z = (mu r_n, r_t)` and `s = (y_n/mu, y_t)`.
//! Without friction only the normal components count, on the half-line.

use super::cone::{join, tangent};
use nalgebra::{Matrix3, Vector3};

/// Returns `J x` with `J = diag(1, -1, -1)`: the vector with its tangential part reversed.
fn reflect(x: &Vector3<f64>) -> Vector3<f64> {
    Vector3::new(x.x, -x.y, -x.z)
}

/// Returns `x^T J x` with `J = diag(1, -1, -1)`, which is positive inside the cone.
fn determinant(x: &Vector3<f64>) -> f64 {
    let slip = tangent(x).norm();
    (x.x - slip) * (x.x + slip)
}

/// Returns the Jordan product `a o b`.
pub(super) fn product(a: &Vector3<f64>, b: &Vector3<f64>) -> Vector3<f64> {
    join(a.dot(b), tangent(b) * a.x + tangent(a) * b.x)
}

/// Returns the solution `d` of `l o d = b` with the Jordan product.
pub(super) fn quotient(b: &Vector3<f64>, l: &Vector3<f64>) -> Vector3<f64> {
    let normal = (l.x * b.x - tangent(l).dot(&tangent(b))) / determinant(l);
    join(normal, (tangent(b) - tangent(l) * normal) / l.x)
}

/// The scaling of Nesterov and Todd, the symmetric matrix `V` with `V z = V^-1 s` that maps the cone onto itself:
/// `V = beta (2 v v^T - J)` with `J = diag(1, -1, -1)`.
#[derive(Clone, Copy, Debug)]
pub(super) struct NtScaling {
    beta: f64,
    v: Vector3<f64>,
}

impl NtScaling {
    /// Returns the scaling of two points inside the cone.
    pub fn of(z: &Vector3<f64>, s: &Vector3<f64>) -> Self {
        let [of_z, of_s] = [z, s].map(|x| determinant(x).sqrt());
        let (z, s) = (z / of_z, s / of_s);
        let w = (s + reflect(&z)) / (2.0 * (1.0 + z.dot(&s))).sqrt();
        Self { beta: (of_s / of_z).sqrt(), v: (w + Vector3::x()) / (2.0 * (w.x + 1.0)).sqrt() }
    }

    /// Returns the product `V x` with the Nesterov-Todd scaling `V`.
    pub fn times(&self, x: &Vector3<f64>) -> Vector3<f64> {
        (self.v * (2.0 * self.v.dot(x)) - reflect(x)) * self.beta
    }

    /// Returns the product `V^-1 x` with the inverse of the Nesterov-Todd scaling.
    pub fn divide(&self, x: &Vector3<f64>) -> Vector3<f64> {
        let v = reflect(&self.v);
        (v * (2.0 * v.dot(x)) - reflect(x)) / self.beta
    }

    /// Returns the square `V^2` of the Nesterov-Todd scaling.
    pub fn square(&self) -> Matrix3<f64> {
        Matrix3::from_columns(&[Vector3::x(), Vector3::y(), Vector3::z()].map(|e| self.times(&self.times(&e))))
    }
}

/// Returns the largest `a <= 1` for which `x + a dx` lies in the cone, for `x` inside the cone.
pub(super) fn longest(x: &Vector3<f64>, dx: &Vector3<f64>) -> f64 {
    // The first positive root of (x + a dx)^T J (x + a dx) = c + 2 b a + d a^2, in the form that does not cancel.
    let (c, d) = (determinant(x), determinant(dx));
    let b = x.x * dx.x - tangent(x).dot(&tangent(dx));
    let apex = if dx.x < 0.0 { -x.x / dx.x } else { 1.0 };
    let discriminant = b * b - c * d;
    if discriminant < 0.0 {
        return apex.min(1.0);
    }
    let q = -(b + discriminant.sqrt().copysign(b));
    [q / d, c / q].into_iter().filter(|root| *root > 0.0).fold(apex.min(1.0), f64::min)
}

#[cfg(test)]
mod tests {
    use super::*;

    const Z: Vector3<f64> = Vector3::new(2.0, 0.5, -1.5);
    const S: Vector3<f64> = Vector3::new(0.7, -0.3, 0.6);

    #[test]
    fn both_points_are_scaled_to_one() {
        let scaling = NtScaling::of(&Z, &S);
        assert!((scaling.times(&Z) - scaling.divide(&S)).norm() < 1e-14);
        assert!((scaling.square() * Z - S).norm() < 1e-14);
        assert!((scaling.divide(&scaling.times(&S)) - S).norm() < 1e-14);
    }

    #[test]
    fn a_quotient_undoes_a_product() {
        assert!((quotient(&product(&Z, &S), &Z) - S).norm() < 1e-14);
    }

    #[test]
    fn the_longest_step_ends_on_the_boundary() {
        for dx in [Vector3::new(-3.0, 0.0, 0.0), Vector3::new(0.0, 4.0, 1.0), Vector3::new(-5.0, 1.0, 2.0)] {
            let length = longest(&Z, &dx);
            let end = Z + dx * length;
            assert!((end.x - tangent(&end).norm()).abs() < 1e-14, "{dx}: {end}");
        }
        assert_eq!(longest(&Z, &Vector3::new(1.0, 0.5, 0.5)), 1.0);
    }
}
