//! Weights of product integration (Brunner 2004, Collocation Methods for Volterra Integral and Related Functional
//! Differential Equations, section 2.2) for a kernel `t^(a-1) g(t)`, `0 < a <= 1`, known in the time domain only: in
//! each step `z` is the polynomial through its values at the stages, and the kernel is integrated against it,
//!
//! ```text
//! (W_n)_ij = int_0^h k(n h + c_i h - s) l_j(s / h) ds,    k(t) = 0 for t < 0
//! ```
//!
//! Gauss-Jacobi rules integrate the singularity at zero, and rules in the logarithm of the lag the steps next to it.
//! For `k = 1` the weights are those of Radau IIA; for any smooth kernel the order in `z` is that of the stages.

use super::gauss_jacobi::gauss_jacobi;
use super::kernel::NoWeights;
use super::weights::Weights;
use expression::Tape;
use problem::Control;
use radau::Tableau;

/// Number of quadrature nodes in each step near the singularity of the kernel.
const NEAR: usize = 24;
/// Number of steps near the singularity of the kernel, with more quadrature nodes each.
const NEAR_STEPS: usize = 4;
/// Number of quadrature nodes, in addition to the number of stages, in each step farther from the singularity of the
/// kernel: each node reduces the error by the square of twice the distance.
const FAR: usize = 5;
/// Number of convolution weights between two polls of the control.
const CHUNK: usize = 1024;

/// Computes the first `length` convolution weights by product integration for a step size `h`.
///
/// # Errors
/// If the kernel is not finite, or on interruption.
pub fn product_integration(
    tableau: &Tableau,
    exponent: f64,
    factor: &mut Tape,
    h: f64,
    length: usize,
    control: &Control,
) -> Result<Weights, NoWeights> {
    let s = tableau.stages();
    let (singular, near, far) =
        (gauss_jacobi(NEAR, exponent - 1.0), gauss_jacobi(NEAR, 0.0), gauss_jacobi(s + FAR, 0.0));
    let mut weights = Weights::zeros(s, length);
    let mut lagrange = vec![0.0; s];
    let mut value = [0.0];
    // Adds the integrand of the convolution weights at the lag `theta h`; `w` contains the weight of the quadrature
    // rule and the singularity.
    let mut add = |weights: &mut Weights, n: usize, i: usize, theta: f64, w: f64| {
        factor.evaluate(theta * h, &[], &mut value);
        let w = w * value[0];
        if !w.is_finite() {
            return Err(NoWeights::NotFinite(theta * h));
        }
        tableau.stages_at(n as f64 + tableau.c[i] - theta, &mut lagrange);
        for (j, l) in lagrange.iter().enumerate() {
            weights.sequence_mut(i, j)[n] += w * l;
        }
        Ok(())
    };
    let scale = h.powf(exponent);
    for n in 0..length {
        if n % CHUNK == CHUNK - 1 && control.poll().is_some() {
            return Err(NoWeights::Interrupted);
        }
        for (i, &c) in tableau.c.iter().enumerate() {
            let first = n as f64 + c - 1.0;
            if n == 0 {
                for &(x, w) in &singular {
                    add(&mut weights, n, i, c * x, scale * c.powf(exponent) * w)?;
                }
            } else if n <= NEAR_STEPS {
                let (from, ratio) = (first.ln(), ((first + 1.0) / first).ln());
                for &(x, w) in &near {
                    let theta = (from + ratio * x).exp();
                    add(&mut weights, n, i, theta, scale * w * ratio * theta.powf(exponent))?;
                }
            } else {
                for &(x, w) in &far {
                    let theta = first + x;
                    add(&mut weights, n, i, theta, scale * w * theta.powf(exponent - 1.0))?;
                }
            }
        }
    }
    Ok(weights)
}

#[cfg(test)]
mod tests {
    use super::*;
    use expression::{Graph, Scope};

    fn tape(text: &str) -> Tape {
        let (mut graph, mut scope) = (Graph::new(), Scope::new());
        let t = graph.input(0);
        scope.bind("t", t).expect("a new name");
        let node = graph.parse(text, &scope).expect("an expression");
        Tape::compile(&graph, &[node])
    }

    /// Returns the convolution of a kernel with `z = t^power` at the last stage of the last step.
    fn convolved(s: usize, exponent: f64, factor: &str, power: i32, h: f64, length: usize) -> f64 {
        let tableau = Tableau::of(s);
        let weights = product_integration(tableau, exponent, &mut tape(factor), h, length, &Control::new()).unwrap();
        let z = |n: usize, j: usize| ((n as f64 + tableau.c[j]) * h).powi(power);
        (0..length)
            .flat_map(|k| (0..s).map(move |j| (k, j)))
            .map(|(k, j)| weights.sequence(s - 1, j)[length - 1 - k] * z(k, j))
            .sum()
    }

    #[test]
    fn polynomials_below_the_number_of_stages_are_convolved_exactly() {
        // int_0^t (t-s)^(a-1) s^p ds = B(a, p+1) t^(a+p), and B(a, p+1) = p! / (a (a+1) .. (a+p)).
        for (s, power) in [(1, 0), (2, 1), (3, 2), (5, 4)] {
            for exponent in [0.1, 0.5, 1.0] {
                let factorial: f64 = (1..=power).map(f64::from).product();
                let product: f64 = (0..=power).map(|k| exponent + f64::from(k)).product();
                let end: f64 = 0.3 * 11.0;
                let exact = factorial / product * end.powf(exponent + f64::from(power));
                let found = convolved(s, exponent, "1", power, 0.3, 11);
                assert!((found / exact - 1.0).abs() < 1e-13, "s = {s}, a = {exponent}: {found}, not {exact}");
            }
        }
    }

    #[test]
    fn a_smooth_factor_is_integrated_as_well() {
        // int_0^2 exp(-(2-s)) s^2 ds = 2 - 2 exp(-2).
        let found = convolved(3, 1.0, "exp(-t)", 2, 0.1, 20);
        assert!((found - (2.0 - 2.0 * (-2.0_f64).exp())).abs() < 1e-14, "{found}");
    }

    #[test]
    fn a_constant_kernel_has_the_weights_of_radau() {
        let tableau = Tableau::of(3);
        let found = product_integration(tableau, 1.0, &mut tape("1"), 0.5, 6, &Control::new()).unwrap();
        let mut exact = Weights::identity(3, 6);
        exact.integrate(tableau);
        for (i, j) in (0..9).map(|place| (place / 3, place % 3)) {
            for (found, exact) in found.sequence(i, j).iter().zip(exact.sequence(i, j)) {
                assert!((found - 0.5 * exact).abs() < 1e-14, "({i}, {j}): {found}, not {}", 0.5 * exact);
            }
        }
    }
}
