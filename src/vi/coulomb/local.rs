//! Exact solution of one contact: `u = W r + q` with a 3 x 3 `W`, by the cases of Coulomb's law.
//!
//! - *open*: `r = 0`, if `q_n >= 0`;
//! - *stick*: `u = 0`, if `-W^-1 q` lies in the cone;
//! - *slip*: `u_n = 0` and `u_t = -s r_t` with `s > 0` and `|r_t| = mu r_n`. With `r_n` eliminated,
//!
//! ```text
//! (S + s I) r_t = -p,    S = W_tt - W_tn W_nt / W_nn,    p = q_t - W_tn q_n / W_nn,
//! r_n(s) = -(q_n + W_nt r_t(s)) / W_nn
//! ```
//!
//! and `s` is a root of the quartic `|r_t|^2 = mu^2 r_n^2` (Bonnefon and Daviet 2011, *Quartic formulation of Coulomb
//! 3D frictional contact*). A root exists: the sticking impulse, at `s = 0`, lies outside the cone, and `r_t`
//! vanishes as `s` grows. The root is computed from `mu r_n / |r_t| - 1`, which is nearly linear in `s` (as is More's
//! secular equation), by a bracketed Newton iteration.

use super::cone::{join, tangent};
use nalgebra::{Matrix2, Matrix3, Vector2, Vector3};

/// Largest number of iterations for one slipping contact, far beyond the convergence of the bracket; Newton's method
/// takes three to six.
const ITERATIONS: usize = 100;

/// Relative accuracy to which the friction bound `|r_t| = mu r_n` is reached.
const ACCURACY: f64 = 1e-15;

/// A 2 x 2 matrix counts as singular if its determinant is below this fraction of the squared trace. A slip with `s`
/// below this fraction of the trace counts as sticking.
const SINGULAR: f64 = 1e-14;

/// Largest number of doublings that find a bracket of the root `s` from any scale.
const DOUBLINGS: usize = 200;

/// Returns the impulse of one contact by Coulomb's law; `None` if `W_nn <= 0` and the contact closes, as no impulse can
/// stop it.
pub fn solve_contact(matrix: &Matrix3<f64>, q: &Vector3<f64>, mu: f64) -> Option<Vector3<f64>> {
    Diagonal::new(matrix).solve(*q, mu)
}

/// The diagonal block `W_kk` of one contact, classified by the form of its solution.
#[derive(Clone, Copy, Debug)]
pub(super) enum Diagonal {
    /// Normal and tangents are decoupled, and the tangents are isotropic, as for spheres: stick and slip have closed
    /// forms with `1 / W_nn` and `1 / W_tt`.
    Isotropic { w_nn: f64, w_tt: f64, of_normal: f64, of_tangent: f64 },
    /// A matrix in which the directions are coupled, or the tangents are anisotropic.
    Full(Matrix3<f64>),
}

/// Off-diagonal entries below this fraction of `W_tt` are treated as zero.
const DECOUPLED: f64 = 1e-14;

impl Diagonal {
    /// Classifies the diagonal block of a contact.
    pub fn new(matrix: &Matrix3<f64>) -> Self {
        let w_tt = 0.5 * (matrix[(1, 1)] + matrix[(2, 2)]);
        let rest = [
            matrix[(0, 1)],
            matrix[(0, 2)],
            matrix[(1, 0)],
            matrix[(2, 0)],
            matrix[(1, 2)],
            matrix[(2, 1)],
            matrix[(1, 1)] - matrix[(2, 2)],
        ];
        let w_nn = matrix[(0, 0)];
        if w_nn > 0.0 && w_tt > 0.0 && rest.iter().all(|x| x.abs() <= DECOUPLED * w_tt) {
            Self::Isotropic { w_nn, w_tt, of_normal: w_nn.recip(), of_tangent: w_tt.recip() }
        } else {
            Self::Full(*matrix)
        }
    }

    /// Returns the product `W r` of the diagonal block and the impulse `r`.
    #[inline]
    pub fn times(&self, r: &Vector3<f64>) -> Vector3<f64> {
        match *self {
            Self::Isotropic { w_nn, w_tt, .. } => Vector3::new(w_nn * r.x, w_tt * r.y, w_tt * r.z),
            Self::Full(ref matrix) => matrix * r,
        }
    }

    /// Returns the impulse `r` for `u = W r + q`; see [`solve_contact`].
    #[inline]
    pub fn solve(&self, q: Vector3<f64>, mu: f64) -> Option<Vector3<f64>> {
        if q.x >= 0.0 {
            return Some(Vector3::zeros());
        }
        match *self {
            Self::Isotropic { of_normal, of_tangent, .. } => {
                let normal = -q.x * of_normal;
                let stick = tangent(&q) * -of_tangent;
                let (size, radius) = (stick.norm_squared(), mu * normal);
                if size <= radius * radius {
                    return Some(join(normal, stick));
                }
                Some(join(normal, stick * (radius / size.sqrt())))
            }
            Self::Full(ref matrix) => solve_full(matrix, &q, mu),
        }
    }
}

/// Returns the impulse of a closing contact whose diagonal block is a full matrix.
fn solve_full(matrix: &Matrix3<f64>, q: &Vector3<f64>, mu: f64) -> Option<Vector3<f64>> {
    let w_nn = matrix[(0, 0)];
    if w_nn <= 0.0 {
        return None;
    }
    if mu == 0.0 {
        return Some(Vector3::new(-q.x / w_nn, 0.0, 0.0));
    }
    let slip = Slip::new(matrix, q, w_nn);
    let least = if slip.schur.determinant() > SINGULAR * slip.trace * slip.trace { 0.0 } else { SINGULAR * slip.trace };
    let (stick, _) = slip.impulse(least)?;
    if tangent(&stick).norm() <= mu * stick.x {
        return Some(stick);
    }
    slip.root(mu, least)
}

/// The impulses that slip by `u_t = -s r_t`, as a function of `s`.
struct Slip {
    schur: Matrix2<f64>,
    trace: f64,
    p: Vector2<f64>,
    q_n: f64,
    w_nn: f64,
    w_nt: Vector2<f64>,
}

impl Slip {
    fn new(matrix: &Matrix3<f64>, q: &Vector3<f64>, w_nn: f64) -> Self {
        let w_tn = Vector2::new(matrix[(1, 0)], matrix[(2, 0)]);
        let w_nt = Vector2::new(matrix[(0, 1)], matrix[(0, 2)]);
        let schur = matrix.fixed_view::<2, 2>(1, 1) - w_tn * w_nt.transpose() / w_nn;
        let trace = (schur[(0, 0)] + schur[(1, 1)]).max(f64::EPSILON * matrix.trace());
        Self { schur, trace, p: tangent(q) - w_tn * (q.x / w_nn), q_n: q.x, w_nn, w_nt }
    }

    /// Returns the impulse `r(s)` of a slipping contact, and its derivative `d r / d s`.
    fn impulse(&self, s: f64) -> Option<(Vector3<f64>, Vector3<f64>)> {
        let inverse = (self.schur + Matrix2::identity() * s).try_inverse()?;
        let friction = -inverse * self.p;
        let by_s = -inverse * friction;
        let normal = -(self.q_n + self.w_nt.dot(&friction)) / self.w_nn;
        Some((join(normal, friction), join(-self.w_nt.dot(&by_s) / self.w_nn, by_s)))
    }

    /// Returns the impulse `r(s)` at the root of `phi(s) = mu r_n / |r_t| - 1`, where `lower` is a value with
    /// `phi(lower) < 0`.
    fn root(&self, mu: f64, mut lower: f64) -> Option<Vector3<f64>> {
        let phi = |s: f64| {
            let (r, by_s) = self.impulse(s)?;
            let (friction, by_s_t) = (tangent(&r), tangent(&by_s));
            let size = friction.norm();
            let ratio = mu * r.x / size;
            Some((r, ratio - 1.0, mu * by_s.x / size - ratio * friction.dot(&by_s_t) / (size * size)))
        };
        let mut upper = lower + self.trace;
        for _ in 0..DOUBLINGS {
            if phi(upper)?.1 >= 0.0 {
                break;
            }
            (lower, upper) = (upper, 2.0 * upper);
        }
        let mut s = lower;
        let mut r = None;
        for _ in 0..ITERATIONS {
            let (impulse, value, slope) = phi(s)?;
            r = Some(impulse);
            if value.abs() <= ACCURACY {
                break;
            }
            *if value < 0.0 { &mut lower } else { &mut upper } = s;
            let newton = s - value / slope;
            let next = if newton > lower && newton < upper { newton } else { 0.5 * (lower + upper) };
            if next == s {
                break;
            }
            s = next;
        }
        // Scale the friction to the bound `mu r_n`, so that `r` lies on the cone despite the rounding of `s`.
        r.map(|r| join(r.x, tangent(&r) * (mu * r.x / tangent(&r).norm())))
    }
}
