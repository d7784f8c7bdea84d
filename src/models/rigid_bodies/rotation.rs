//! The free rotation of a rigid body over a step of size `h`, with the orientation `Q`, and the angular velocity `W`
//! and the inertia `J` in the body frame:
//!
//! ```text
//! J (W+ - W) = k J Wm x Wm,    Q+ = Q exp(h Wm),    Wm = (W + W+) / 2,    k = 2 tan(h |Wm| / 2) / |Wm|
//! ```
//!
//! This is the implicit midpoint rule on the group (Austin, Krishnaprasad and Wang 1993, *Almost Poisson integration
//! of rigid body systems*). Since `exp(h Wm)` is the Cayley transform of `k Wm`, both equations together imply
//! conservation of the angular momentum, `Q+ J W+ = Q J W`, and of the energy `W.J W / 2`, up to rounding and for any
//! step size. Steady rotation about a principal axis is exact. The order is two.

use nalgebra::{Matrix3, UnitQuaternion, Vector3};

/// Maximum number of Newton iterations for the free rotation of a body. From the explicit guess, three to five suffice;
/// for fast rotation see [`LARGEST_ANGLE`].
const ITERATIONS: usize = 20;

/// The angle of rotation per step, in radians, above which the Cayley factor `k = h` is used: the rotation is not
/// resolved, and `tan` would become unbounded.
const LARGEST_ANGLE: f64 = 2.0;

/// Rotates a body without torque for a time `h`: returns the rotation and the new angular velocity, both in the body
/// frame.
pub fn rotate(inertia: &Matrix3<f64>, omega: &Vector3<f64>, h: f64) -> (UnitQuaternion<f64>, Vector3<f64>) {
    let momentum = inertia * omega;
    let mut next = *omega;
    for _ in 0..ITERATIONS {
        let mean = (omega + next) * 0.5;
        let k = cayley_step(&mean, h);
        let residual = inertia * next - momentum - (inertia * mean).cross(&mean) * k;
        // The gyroscopic term has the derivative `d(J w x w) = (J dw) x w + (J w) x dw`; the mean angular velocity
        // changes by half of the change of its value at the end.
        let spin = (inertia * mean).cross_matrix() - mean.cross_matrix() * inertia;
        let Some(change) = (inertia - spin * (0.5 * k)).lu().solve(&residual) else { break };
        next -= change;
        if change.norm() <= 4.0 * f64::EPSILON * next.norm() {
            break;
        }
    }
    let mean = (omega + next) * 0.5;
    let angle = if cayley_step(&mean, h) == h { 2.0 * (0.5 * h * mean.norm()).atan() } else { h * mean.norm() };
    let axis = nalgebra::Unit::try_new(mean, 0.0);
    (axis.map_or_else(UnitQuaternion::identity, |axis| UnitQuaternion::from_axis_angle(&axis, angle)), next)
}

/// Returns the factor `k` for which the Cayley transform of `k w` is the rotation by the angular velocity `w` in the
/// time `h`, the exponential of `h w`.
fn cayley_step(omega: &Vector3<f64>, h: f64) -> f64 {
    let half = 0.5 * h * omega.norm();
    if half == 0.0 || 2.0 * half > LARGEST_ANGLE { h } else { h * half.tan() / half }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn run(inertia: &Matrix3<f64>, omega: Vector3<f64>, h: f64, steps: usize) -> (UnitQuaternion<f64>, Vector3<f64>) {
        (0..steps).fold((UnitQuaternion::identity(), omega), |(q, omega), _| {
            let (turn, omega) = rotate(inertia, &omega, h);
            (UnitQuaternion::new_normalize((q * turn).into_inner()), omega)
        })
    }

    #[test]
    fn energy_and_momentum_of_a_tumbling_racket_are_kept_over_many_steps() {
        let inertia = Matrix3::from_diagonal(&Vector3::new(1.0, 2.0, 3.0));
        let omega = Vector3::new(1e-3, 5.0, 1e-3);
        let (q, end) = run(&inertia, omega, 0.01, 100_000);
        let energy = |w: &Vector3<f64>| 0.5 * w.dot(&(inertia * w));
        assert!((energy(&end) / energy(&omega) - 1.0).abs() < 1e-10);
        let momentum = q * (inertia * end);
        assert!((momentum - inertia * omega).norm() < 1e-9 * (inertia * omega).norm(), "{momentum}");
    }

    #[test]
    fn steady_rotation_about_a_principal_axis_is_exact() {
        let inertia = Matrix3::from_diagonal(&Vector3::new(1.0, 2.0, 3.0));
        let (q, omega) = run(&inertia, Vector3::new(0.0, 0.0, 7.0), 0.1, 10);
        assert!((omega - Vector3::new(0.0, 0.0, 7.0)).norm() < 1e-14);
        let exact = UnitQuaternion::from_axis_angle(&Vector3::z_axis(), 7.0);
        assert!(q.angle_to(&exact) < 1e-14);
    }

    /// Compares the period of a free asymmetric top with Jacobi's solution: the middle component of the angular
    /// velocity is the elliptic function `sn`, whose quarter period `K(m)` is given by the arithmetic-geometric mean.
    #[test]
    fn the_period_of_eulers_top_comes_out_at_second_order() {
        let (j, omega) = (Vector3::new(1.0_f64, 2.0, 3.0), Vector3::new(1.0_f64, 0.0, 1.0));
        let energy = 0.5 * j.dot(&omega.component_mul(&omega));
        let momentum = j.component_mul(&omega).norm_squared();
        // Jacobi's formulas hold for squared momentum `> 2 E J_2` (Landau and Lifshitz, Mechanics, section 37), with
        // the energy `E` and `J_3` the largest moment of inertia.
        let (upper, lower) = (momentum - 2.0 * energy * j.x, 2.0 * energy * j.z - momentum);
        let rate = ((j.z - j.y) * upper / (j.x * j.y * j.z)).sqrt();
        let m = (j.y - j.x) * lower / ((j.z - j.y) * upper);
        assert!(m < 1.0);
        let (mut a, mut b) = (1.0_f64, (1.0 - m).sqrt());
        for _ in 0..8 {
            (a, b) = (0.5 * (a + b), (a * b).sqrt());
        }
        let period = 4.0 * std::f64::consts::FRAC_PI_2 / a / rate;
        let error = |steps: usize| {
            let inertia = Matrix3::from_diagonal(&j);
            (run(&inertia, omega, period / steps as f64, steps).1 - omega).norm()
        };
        let (coarse, fine) = (error(200), error(400));
        assert!(fine < 1e-3 && (coarse / fine).log2() > 1.95, "{coarse:e} {fine:e}");
    }
}
