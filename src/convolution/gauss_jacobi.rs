//! Gauss quadrature on `[0, 1]` with the weight `x^beta`, by the eigenvalues of the Jacobi matrix (Golub and Welsch 1969,
//! Calculation of Gauss quadrature rules):
//!
//! ```text
//! int_0^1 x^beta g(x) dx = sum_k w_k g(x_k)    for all polynomials g of degree below 2n
//! ```

use nalgebra::{DMatrix, SymmetricEigen};

/// Nodes, increasing, and weights of the rule with `n >= 1` nodes; `beta > -1`.
pub fn gauss_jacobi(n: usize, beta: f64) -> Vec<(f64, f64)> {
    let mut jacobi = DMatrix::zeros(n, n);
    for k in 0..n {
        let degree = k as f64;
        let twice = 2.0 * degree + beta;
        // On [-1, 1] with the weight (1 + u)^beta.
        let diagonal = if k == 0 { beta / (beta + 2.0) } else { beta * beta / (twice * (twice + 2.0)) };
        jacobi[(k, k)] = 0.5 * (1.0 + diagonal);
        if k > 0 {
            // With one factor n + beta taken out of numerator and denominator, which are zero together.
            let square = match k {
                1 => 4.0 * (1.0 + beta) / ((2.0 + beta).powi(2) * (3.0 + beta)),
                _ => 4.0 * (degree * (degree + beta)).powi(2) / (twice * twice * (twice + 1.0) * (twice - 1.0)),
            };
            let off = 0.5 * square.sqrt();
            jacobi[(k, k - 1)] = off;
            jacobi[(k - 1, k)] = off;
        }
    }
    let SymmetricEigen { eigenvectors, eigenvalues } = SymmetricEigen::new(jacobi);
    let total = 1.0 / (1.0 + beta);
    let mut rule: Vec<(f64, f64)> = eigenvalues
        .iter()
        .zip(eigenvectors.row(0).iter())
        .map(|(&x, &first)| (x.clamp(0.0, 1.0), total * first * first))
        .collect();
    rule.sort_by(|a, b| a.0.total_cmp(&b.0));
    rule
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
                assert!((sum / exact - 1.0).abs() < 2e-12, "x^{power} with beta = {beta}: {sum}, not {exact}");
            }
        }
    }
}
