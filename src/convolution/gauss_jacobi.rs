//! Gauss quadrature on `[0, 1]` with the weight `x^beta`, its nodes by the eigenvalues of the Jacobi matrix (Golub and
//! Welsch 1969, Calculation of Gauss quadrature rules):
//!
//! ```text
//! int_0^1 x^beta g(x) dx = sum_k w_k g(x_k)    for all polynomials g of degree below 2n
//! ```

use nalgebra::DMatrix;

/// Returns the nodes, increasing, and the weights of the Gauss-Jacobi rule with `n >= 1` nodes on `[0, 1]` for the
/// weight function `x^beta`, `beta > -1`.
pub fn gauss_jacobi(n: usize, beta: f64) -> Vec<(f64, f64)> {
    let (diagonal, off): (Vec<f64>, Vec<f64>) = (0..=n).map(|k| recurrence(k, beta)).unzip();
    let jacobi = DMatrix::from_fn(n, n, |i, j| match i.abs_diff(j) {
        0 => diagonal[i],
        1 => off[i.max(j)],
        _ => 0.0,
    });
    let mut nodes: Vec<f64> = jacobi.symmetric_eigenvalues().iter().copied().collect();
    nodes.sort_by(f64::total_cmp);
    let total = 1.0 / (1.0 + beta);
    let rule = nodes.into_iter().map(|x| {
        // A Newton step gives the node to full accuracy; the weight of the node is 1 / sum_k p_k^2.
        let (value, slope, _) = polynomials(x, &diagonal, &off);
        let x = (x - value / slope).clamp(0.0, 1.0);
        let (_, _, squares) = polynomials(x, &diagonal, &off);
        (x, total / squares)
    });
    rule.collect()
}

/// Returns the coefficients `a_k`, `b_k` of the recurrence `b_{k+1} p_{k+1} = (x - a_k) p_k - b_k p_{k-1}` of
/// orthonormal polynomials.
fn recurrence(k: usize, beta: f64) -> (f64, f64) {
    let degree = k as f64;
    let twice = 2.0 * degree + beta;
    let diagonal = if k == 0 { beta / (beta + 2.0) } else { beta * beta / (twice * (twice + 2.0)) };
    let square = match k {
        0 => 0.0,
        // The general form of the recurrence coefficient, with the factor 1 + beta cancelled from numerator and
        // denominator.
        1 => 4.0 * (1.0 + beta) / ((2.0 + beta).powi(2) * (3.0 + beta)),
        _ => 4.0 * (degree * (degree + beta)).powi(2) / (twice * twice * (twice + 1.0) * (twice - 1.0)),
    };
    // Map the recurrence coefficients from [-1, 1], with the weight (1 + u)^beta, to [0, 1].
    (0.5 * (1.0 + diagonal), 0.5 * square.sqrt())
}

/// Returns the value at `x` of the orthonormal polynomial of the highest degree, its derivative, and the sum of
/// squares of the polynomials of lower degree.
fn polynomials(x: f64, diagonal: &[f64], off: &[f64]) -> (f64, f64, f64) {
    let (mut p, mut slope, mut before, mut slope_before) = (1.0, 0.0, 0.0, 0.0);
    let mut squares = 0.0;
    for k in 0..diagonal.len() - 1 {
        squares += p * p;
        let next = ((x - diagonal[k]) * p - off[k] * before) / off[k + 1];
        let slope_next = (p + (x - diagonal[k]) * slope - off[k] * slope_before) / off[k + 1];
        (before, slope_before, p, slope) = (p, slope, next, slope_next);
    }
    (p, slope, squares)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn powers_are_integrated_exactly() {
        for beta in [-0.99, -0.5, -0.01, 0.0, 0.3, 1.0] {
            let rule = gauss_jacobi(12, beta);
            for power in 0..24 {
                let sum: f64 = rule.iter().map(|(x, w)| w * x.powi(power)).sum();
                let exact = 1.0 / (1.0 + beta + f64::from(power));
                assert!((sum / exact - 1.0).abs() < 1e-13, "x^{power} with beta = {beta}: {sum}, not {exact}");
            }
        }
    }
}
