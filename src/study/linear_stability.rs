//! The stability function of each method as measured on its stepper: `x' = lambda x` in real form,
//!
//! ```text
//! x' = a x - b y,  y' = b x + a y,    lambda = a + i b,
//! ```
//!
//! integrated over one step of length one from `(1, 0)`, ends at `R(lambda)`. Its modulus is compared along rays in the
//! left half plane with `R(z) = e_s^T (I - z A)^-1 1` from the coefficients (Hairer and Wanner 1996, IV.3; the methods
//! are stiffly accurate).

use nalgebra::{Complex, DMatrix, DVector};
use problem::Control;
use radau::Tableau;
use serde::{Deserialize, Serialize};
use serde_json::json;
use solution::Solution;
use specification::Specification;
use std::f64::consts::PI;

/// Numbers of Radau IIA stages whose stability functions are measured.
pub const STAGES: [usize; 5] = [1, 2, 3, 5, 7];
/// Directions of the rays in the left half plane of `z`, in degrees from the positive real axis.
const RAYS: [u32; 7] = [90, 105, 120, 135, 150, 165, 180];
/// Values of `2 log10 |z|` at the points of a ray, so that `|z|` runs from `10^-2` to `10^8` in half decades.
const HALF_DECADES: std::ops::RangeInclusive<i32> = -4..=16;

/// The measured stability function along a ray in the left half plane, for one number of stages.
#[derive(Clone, Debug, Deserialize, Serialize)]
pub struct Ray {
    /// The number of Radau IIA stages of the stability function.
    pub stages: usize,
    /// The angle of `z` on the ray, in degrees from the positive real axis.
    pub degrees: u32,
    /// Pairs of `|z|` and the measured modulus `|R(z)|` of the stability function along the ray.
    pub points: Vec<(f64, f64)>,
    /// The largest modulus `|R(z)|` of the stability function on the ray; at most one for an A-stable method.
    pub largest: f64,
    /// The largest distance between the measured `R(z)` and `R(z)` computed from the Runge-Kutta coefficients.
    pub difference: f64,
}

/// Measures the stability functions along all rays; rays with a failed step are left out of the result.
pub fn rays() -> Vec<Ray> {
    let of_stages = |stages: usize| RAYS.iter().filter_map(move |&degrees| ray(stages, degrees));
    STAGES.into_iter().flat_map(of_stages).collect()
}

fn ray(stages: usize, degrees: u32) -> Option<Ray> {
    let mut ray = Ray { stages, degrees, points: Vec::new(), largest: 0.0, difference: 0.0 };
    for half_decade in HALF_DECADES {
        let modulus = 10_f64.powf(0.5 * f64::from(half_decade));
        let z = Complex::from_polar(modulus, f64::from(degrees) * PI / 180.0);
        // The cosine of a right angle is not exactly zero in floating point.
        let z = if degrees == 90 { Complex::new(0.0, modulus) } else { z };
        let (measured, exact) = (measured(stages, z)?, of_the_coefficients(stages, z)?);
        ray.points.push((modulus, measured.norm()));
        ray.largest = ray.largest.max(measured.norm());
        ray.difference = ray.difference.max((measured - exact).norm());
    }
    Some(ray)
}

fn measured(stages: usize, z: Complex<f64>) -> Option<Complex<f64>> {
    let document = json!({
        "problem": {"dvi": {"parameters": {"a": z.re, "b": z.im},
            "states": {"x": {"initial": 1, "rate": "a*x - b*y"}, "y": {"initial": 0, "rate": "b*x + a*y"}}}},
        "time": {"end": 1}, "method": {"step": 1, "stages": stages}, "output": {"times": [1]}});
    let specification = Specification::from_json(document.to_string().as_bytes()).ok()?;
    let solution = crate::solve(&specification, &Control::new());
    let end = |solution: &Solution, name: &str| solution.trajectory.field(name)?.last().copied();
    Some(Complex::new(end(&solution, "x")?, end(&solution, "y")?))
}

fn of_the_coefficients(stages: usize, z: Complex<f64>) -> Option<Complex<f64>> {
    let a = &Tableau::of(stages).a;
    let matrix = DMatrix::from_fn(stages, stages, |i, j| Complex::from(if i == j { 1.0 } else { 0.0 }) - z * a[(i, j)]);
    let values = matrix.lu().solve(&DVector::from_element(stages, Complex::from(1.0)))?;
    values.iter().next_back().copied()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_stepper_has_the_stability_function_of_its_coefficients() {
        let rays = rays();
        assert_eq!(rays.len(), STAGES.len() * RAYS.len());
        for ray in &rays {
            // Rounding errors are amplified by the condition of the transformation of the stages.
            let rounding = 1e2 * f64::EPSILON * Tableau::of(ray.stages).mixing;
            assert!(ray.difference < rounding, "{} stages at {}: {:e}", ray.stages, ray.degrees, ray.difference);
            assert!(ray.largest < 1.0 + rounding, "{} stages at {}: {}", ray.stages, ray.degrees, ray.largest);
            // L-stability: the stability function `R(z)` tends to zero as `|z|` grows.
            let far = ray.points.last().expect("points").1;
            assert!(far < 1e-6, "{} stages at {}: {far:e}", ray.stages, ray.degrees);
        }
    }

    #[test]
    fn three_stages_have_the_pade_approximation() {
        // The stability function of three stages is the Padé approximation (1 + 2z/5 + z^2/20) / (1 - 3z/5 + 3z^2/20 -
        // z^3/60).
        for z in [Complex::new(-1.0, 2.0), Complex::new(0.0, 5.0), Complex::new(-30.0, 0.0)] {
            let (one, square) = (Complex::from(1.0), z * z);
            let above = one + z * 0.4 + square * 0.05;
            let below = one - z * 0.6 + square * 0.15 - square * z / 60.0;
            let found = of_the_coefficients(3, z).expect("a regular matrix");
            assert!((found - above / below).norm() < 1e-14, "{z}");
        }
    }
}
