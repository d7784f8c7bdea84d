//! Polynomials on a panel `[a, b]` of an element, for a function that is analytic except at the beginning of the
//! element, with a bound of the remainder: if the function is at most `M` within the Bernstein ellipse of the panel
//! with the sum `rho` of its semi-axes,
//!
//! ```text
//! |f - p| <= 4 M rho^-n / (rho - 1)
//! ```
//!
//! for the polynomial `p` of degree `n` through the Chebyshev points (Trefethen 2013, *Approximation Theory and
//! Approximation Practice*, theorem 8.2). The ellipse extends to the beginning of the element.

use nalgebra::{DMatrix, DVector};
use numerics::bernstein;

/// The degree of the polynomials on a panel, at least that of the basis functions of all elements.
pub const DEGREE: usize = 10;

/// A panel `[begin, begin + length]` of an element `[0, 1]`.
#[derive(Clone, Copy, Debug)]
pub struct Panel {
    pub begin: f64,
    pub length: f64,
}

impl Panel {
    /// The panel that is the whole element `[0, 1]`.
    pub const WHOLE: Self = Self { begin: 0.0, length: 1.0 };

    pub fn end(self) -> f64 {
        self.begin + self.length
    }

    pub fn middle(self) -> f64 {
        self.begin + 0.5 * self.length
    }

    pub fn halves(self) -> [Self; 2] {
        let length = 0.5 * self.length;
        [Self { length, ..self }, Self { begin: self.begin + length, length }]
    }

    /// Returns the bound of the remainder of interpolation on the panel by a polynomial, relative to the bound of the
    /// function on the Bernstein ellipse that extends to zero.
    pub fn remainder(self) -> f64 {
        let ratio = 2.0 * self.middle() / self.length;
        let rho = ratio + (ratio * ratio - 1.0).max(0.0).sqrt();
        4.0 * rho.powi(-(DEGREE as i32)) / (rho - 1.0)
    }

    /// Returns the largest distance from zero of a point of the Bernstein ellipse of the panel.
    pub fn reach(self) -> f64 {
        2.0 * self.middle()
    }

    /// Returns the growth of Legendre polynomials on `[0, 1]` with their degree, on the Bernstein ellipse of the
    /// panel and between it and zero: the sum of the semi-axes of an ellipse about `[0, 1]` that contains both.
    pub fn growth(self) -> f64 {
        let axes = 1.0 + self.reach();
        axes + (axes * axes - 1.0).sqrt()
    }
}

/// Polynomial interpolation: the map from the values of a function at the Chebyshev points to Bernstein coefficients.
pub struct Interpolation {
    /// The Chebyshev points on `[0, 1]`.
    pub points: Vec<f64>,
    inverse: DMatrix<f64>,
    /// The amplification of rounding errors of the values by the map.
    pub growth: f64,
}

impl Interpolation {
    pub fn new() -> Self {
        let point = |i: usize| 0.5 - 0.5 * (std::f64::consts::PI * i as f64 / DEGREE as f64).cos();
        let points: Vec<f64> = (0..=DEGREE).map(point).collect();
        let mut unit = vec![0.0; DEGREE + 1];
        let values = DMatrix::from_fn(DEGREE + 1, DEGREE + 1, |i, j| {
            unit.fill(0.0);
            unit[j] = 1.0;
            bernstein::value(&unit, points[i])
        });
        // Bernstein polynomials are a basis, and the points are distinct, so the inverse exists.
        let inverse = values.try_inverse().unwrap_or_else(|| DMatrix::identity(DEGREE + 1, DEGREE + 1));
        let growth = inverse.row_iter().map(|row| row.iter().map(|x| x.abs()).sum()).fold(0.0, f64::max);
        Self { points, inverse, growth }
    }

    /// Returns the Bernstein coefficients of the polynomial through values at the Chebyshev points.
    pub fn coefficients(&self, values: &[f64]) -> Vec<f64> {
        (&self.inverse * DVector::from_column_slice(values)).as_slice().to_vec()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn remainders_are_within_their_bound_and_it_is_sharp() {
        // Powers of theta are at most `reach^p` on the ellipse.
        let interpolation = Interpolation::new();
        for power in [0.3, 0.8, 1.5] {
            let mut panel = Panel { begin: 0.5, length: 0.5 };
            for _ in 0..3 {
                let values: Vec<f64> =
                    interpolation.points.iter().map(|u| (panel.begin + u * panel.length).powf(power)).collect();
                let coefficients = interpolation.coefficients(&values);
                let off = |i: i32| {
                    let u = f64::from(i) / 200.0;
                    (bernstein::value(&coefficients, u) - (panel.begin + u * panel.length).powf(power)).abs()
                };
                let found = (0..=200).map(off).fold(0.0, f64::max);
                let bound = panel.remainder() * panel.reach().powf(power);
                let rounding = interpolation.growth * 4.0 * f64::EPSILON;
                assert!(found <= bound + rounding, "theta^{power} on {panel:?}: {found:e}, not {bound:e}");
                assert!(found >= 1e-4 * bound, "theta^{power} on {panel:?}: {found:e} against {bound:e}");
                [_, panel] = panel.halves();
            }
        }
    }
}
