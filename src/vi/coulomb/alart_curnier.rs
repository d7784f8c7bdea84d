//! The function of Alart and Curnier (1991, *A mixed formulation for frictional contact problems prone to Newton like
//! solution methods*), in the variant of Jean and Moreau, for one contact with unit diagonal:
//!
//! ```text
//! F_n = r_n - [y_n]_+,    F_t = r_t - P_D(y_t),    y = r - u,    D the disk of radius mu [y_n]_+
//! ```
//!
//! Its zeros are the solutions of Coulomb's law, and its generalised Jacobian separates the open, stick and slip
//! cases, so that a Newton step solves for the guessed contact states: `r = 0`, `u = 0`, or `u_n = 0` with friction
//! along `y_t`.

use super::cone::{join, tangent};
use nalgebra::{Matrix2, Matrix3, Vector2, Vector3};

/// The Alart-Curnier function `F` and its derivatives at one contact.
#[derive(Clone, Copy, Debug)]
pub(super) struct Linearised {
    pub value: Vector3<f64>,
    pub by_u: Matrix3<f64>,
    pub by_r: Matrix3<f64>,
}

/// Evaluates the Alart-Curnier function `F(r, u)`.
pub(super) fn value(r: &Vector3<f64>, u: &Vector3<f64>, mu: f64) -> Vector3<f64> {
    let y = r - u;
    if y.x <= 0.0 {
        return *r;
    }
    let (radius, y_t) = (mu * y.x, tangent(&y));
    let size = y_t.norm();
    if size < radius { *u } else { join(u.x, tangent(r) - direction(y_t, size) * radius) }
}

/// Evaluates the Alart-Curnier function `F` with an element of its generalised Jacobian.
pub(super) fn linearise(r: &Vector3<f64>, u: &Vector3<f64>, mu: f64) -> Linearised {
    let value = value(r, u, mu);
    let y = r - u;
    if y.x <= 0.0 {
        return Linearised { value, by_u: Matrix3::zeros(), by_r: Matrix3::identity() };
    }
    let (radius, y_t) = (mu * y.x, tangent(&y));
    let size = y_t.norm();
    if size < radius {
        return Linearised { value, by_u: Matrix3::identity(), by_r: Matrix3::zeros() };
    }
    // The derivative of P_D(y_t): as y_n grows, the projection grows along e, and as y_t turns, the projection turns
    // across e.
    let e = direction(y_t, size);
    let turn = if size == 0.0 { Matrix2::zeros() } else { (Matrix2::identity() - e * e.transpose()) * (radius / size) };
    let mut by_y = Matrix3::zeros();
    by_y[(0, 0)] = 1.0;
    by_y.fixed_view_mut::<2, 1>(1, 0).copy_from(&(e * mu));
    by_y.fixed_view_mut::<2, 2>(1, 1).copy_from(&turn);
    Linearised { value, by_u: by_y, by_r: Matrix3::identity() - by_y }
}

/// Returns the direction `y_t / |y_t|` of a tangential vector, or zero if `y_t` is zero.
fn direction(y_t: Vector2<f64>, size: f64) -> Vector2<f64> {
    if size == 0.0 { Vector2::zeros() } else { y_t / size }
}
