//! Weights of Radau IIA convolution quadrature for the kernel `t^(f-1) / Gamma(f)`, `0 < f < 1`, whose transform is
//! `K(s) = s^-f` (Lubich and Ostermann 1993, Runge-Kutta methods for parabolic equations and convolution quadrature):
//!
//! ```text
//! sum_n W_n zeta^n = Delta(zeta)^-f,    Delta(zeta) = (A + zeta / (1 - zeta) 1 b^T)^-1
//! ```
//!
//! for unit steps; a step `h` multiplies all weights by `h^f`. Contour integrals over a circle of `zeta` would give
//! eight digits. But `s^-f = sin(pi f) / pi int_0^inf u^-f / (s + u) du`, and the resolvent has a power series in
//! closed form, so that
//!
//! ```text
//! W_0 = A^f = sin(pi f) / pi int u^-f A (I + u A)^-1 du
//! W_n = sin(pi f) / pi int u^-f R(-u)^(n-1) (I + u A)^-1 1 b^T (I + u A)^-1 du,    n >= 1
//! ```
//!
//! with the stability function `R`: real integrals of smooth functions, by Gauss rules on dyadic panels between a
//! Gauss-Jacobi rule at zero and one at infinity.

use super::gauss_jacobi::gauss_jacobi;
use super::weights::Weights;
use nalgebra::DMatrix;
use problem::Control;
use radau::Tableau;
use std::f64::consts::PI;

/// Number of quadrature nodes of one panel of the integral over `u`.
const NODES: usize = 20;
/// End of the quadrature panels in `u`: beyond the eigenvalues of `A^-1` for every number of stages, so that the
/// series in `1/u` converges.
const LAST: f64 = 64.0;
/// Number of convolution weights summed at once, between two polls of the control.
const CHUNK: usize = 64;
/// Logarithm of the magnitude below which powers of the stability function `R` are neglected.
const NEGLIGIBLE: f64 = -40.0;

/// A node of the integral over `u`, with the factors of the integrand of the convolution weights.
struct Resolvent {
    /// The weight of the quadrature rule, including `sin(pi f) / pi u^-f`.
    weight: f64,
    /// The value `R(-u)` of the stability function, and the logarithm of its absolute value.
    r: f64,
    ln_r: f64,
    /// The column `(I + u A)^-1 1` times the row `b^T (I + u A)^-1`, by rows.
    product: Vec<f64>,
}

/// Computes the first `length` convolution weights of the fractional integral of order `f` for steps of unit size;
/// returns `None` if `control` asks to stop.
pub fn fractional(tableau: &Tableau, f: f64, length: usize, control: &Control) -> Option<Weights> {
    let s = tableau.stages();
    let mut weights = Weights::zeros(s, length);
    let mut resolvents = Vec::new();
    for (u, weight) in rule(f, length) {
        let shifted = DMatrix::identity(s, s) + &tableau.a * u;
        let inverse = shifted.try_inverse()?;
        let first = &tableau.a * &inverse * weight;
        for i in 0..s {
            for j in 0..s {
                weights.sequence_mut(i, j)[..1].iter_mut().for_each(|entry| *entry += first[(i, j)]);
            }
        }
        resolvents.push(Resolvent::new(tableau, u, weight, &inverse));
    }
    let mut powers = [0.0; CHUNK];
    for n in (1..length).step_by(CHUNK) {
        if control.poll().is_some() {
            return None;
        }
        let count = CHUNK.min(length - n);
        let before = (n - 1) as f64;
        resolvents.retain(|resolvent| n == 1 || before * resolvent.ln_r > NEGLIGIBLE);
        for resolvent in &resolvents {
            let sign = if resolvent.r < 0.0 && (n - 1) % 2 == 1 { -1.0 } else { 1.0 };
            let start = if n == 1 { 1.0 } else { sign * (before * resolvent.ln_r).exp() };
            let mut power = start * resolvent.weight;
            for value in &mut powers[..count] {
                *value = power;
                power *= resolvent.r;
            }
            for (place, &factor) in resolvent.product.iter().enumerate() {
                let sequence = &mut weights.sequence_mut(place / s, place % s)[n..n + count];
                for (entry, power) in sequence.iter_mut().zip(&powers) {
                    *entry += factor * power;
                }
            }
        }
    }
    Some(weights)
}

impl Resolvent {
    fn new(tableau: &Tableau, u: f64, weight: f64, inverse: &DMatrix<f64>) -> Self {
        let s = tableau.stages();
        let column: Vec<f64> = (0..s).map(|i| inverse.row(i).sum()).collect();
        let row: Vec<f64> = (0..s).map(|j| (0..s).map(|i| tableau.b[i] * inverse[(i, j)]).sum()).collect();
        // Stiff accuracy gives small values of R without cancellation; if R is near one, 1 - R is computed instead.
        let r = column[s - 1];
        let fall = u * column.iter().zip(&tableau.b).map(|(x, b)| x * b).sum::<f64>();
        let ln_r = if fall < 0.5 { (-fall).ln_1p() } else { r.abs().ln() };
        let product = column.iter().flat_map(|p| row.iter().map(move |q| p * q)).collect();
        Self { weight, r, ln_r, product }
    }
}

/// Returns the nodes `u` and weights of a quadrature rule for `sin(pi f) / pi int_0^inf u^-f g(u) du`, for functions
/// `g` that vary on scales of `1 / length` and above, and at infinity have a series in `1/u` without a constant term.
fn rule(f: f64, length: usize) -> Vec<(f64, f64)> {
    let factor = (PI * f).sin() / PI;
    let first = 1.0 / length.max(1) as f64;
    let mut rule: Vec<(f64, f64)> =
        gauss_jacobi(NODES, -f).into_iter().map(|(x, w)| (first * x, factor * w * first.powf(1.0 - f))).collect();
    let gauss = gauss_jacobi(NODES, 0.0);
    let mut left = first;
    while left < LAST {
        for &(x, w) in &gauss {
            let u = left * (1.0 + x);
            rule.push((u, factor * w * left * u.powf(-f)));
        }
        left *= 2.0;
    }
    // With v = 1/u, the weight function is v^(f-2) = v^(f-1) u.
    for (x, w) in gauss_jacobi(NODES, f - 1.0) {
        let u = left / x;
        rule.push((u, factor * w * left.powf(-f) * u));
    }
    rule
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Returns the largest difference of two sequences of weights, relative to the largest weight of the second.
    fn distance(a: &Weights, b: &Weights, s: usize) -> f64 {
        let (mut most, mut size) = (0.0_f64, 0.0_f64);
        for (i, j) in (0..s * s).map(|place| (place / s, place % s)) {
            for (a, b) in a.sequence(i, j).iter().zip(b.sequence(i, j)) {
                most = most.max((a - b).abs());
                size = size.max(b.abs());
            }
        }
        most / size
    }

    fn convolve(a: &Weights, b: &Weights, s: usize) -> Weights {
        let mut product = Weights::zeros(s, a.len());
        for (i, j) in (0..s * s).map(|place| (place / s, place % s)) {
            for n in 0..a.len() {
                let sum: f64 = (0..s)
                    .flat_map(|k| (0..=n).map(move |l| (k, l)))
                    .map(|(k, l)| a.sequence(i, k)[l] * b.sequence(k, j)[n - l])
                    .sum();
                product.sequence_mut(i, j)[n] = sum;
            }
        }
        product
    }

    #[test]
    fn two_fractional_integrals_are_one_whole() {
        let control = Control::new();
        for s in [1, 2, 3, 5, 9] {
            for f in [0.01, 0.25, 0.5, 0.9] {
                let tableau = Tableau::of(s);
                let weights = |f| fractional(tableau, f, 80, &control).expect("no one stops it");
                let product = convolve(&weights(f), &weights(1.0 - f), s);
                let mut whole = Weights::identity(s, 80);
                whole.integrate(tableau);
                let found = distance(&product, &whole, s);
                assert!(found < 2e-13, "s = {s}, f = {f}: {found}");
            }
        }
    }

    #[test]
    fn implicit_euler_has_binomial_weights() {
        // (1 - zeta)^-f: w_n = w_{n-1} (n - 1 + f) / n, to rounding for any n.
        for f in [0.25, 0.5, 0.75] {
            let weights = fractional(Tableau::of(1), f, 200_000, &Control::new()).expect("no one stops it");
            let mut exact = 1.0;
            for (n, found) in weights.sequence(0, 0).iter().enumerate() {
                if n > 0 {
                    exact *= (n as f64 - 1.0 + f) / n as f64;
                }
                assert!((found / exact - 1.0).abs() < 1e-12, "w_{n} for f = {f}: {found}, not {exact}");
            }
        }
    }
}
