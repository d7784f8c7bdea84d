//! Polynomials on `[0, 1]` in the Bernstein basis, given by their coefficients. The range of the coefficients
//! encloses the range of the polynomial, and under bisection by de Casteljau's algorithm both ranges converge
//! quadratically (Farouki 2012, *The Bernstein polynomial basis: a centennial retrospective*).

use crate::Interval;

/// Bound on the rounding error of a Bernstein coefficient, relative to the largest of the few terms that the
/// coefficient is a sum of.
const ROUNDING: f64 = 8.0 * f64::EPSILON;

/// Encloses the range on `[0, 1]` of the polynomial with the given Bernstein coefficients, widened by their rounding
/// errors.
pub fn range(coefficients: &[f64]) -> Interval {
    of_ends(coefficients.iter().copied())
}

/// Encloses the range on `[0, 1]` of the derivative of the polynomial with the given Bernstein coefficients.
pub fn range_of_rate(coefficients: &[f64]) -> Interval {
    let degree = coefficients.len().saturating_sub(1) as f64;
    let size = coefficients.iter().fold(0.0_f64, |size, c| size.max(c.abs()));
    let rate = of_ends(coefficients.windows(2).map(|pair| degree * (pair[1] - pair[0])));
    let noise = rounding_of_rate(coefficients.len(), size);
    Interval::new(rate.lo - noise, rate.hi + noise)
}

/// Bounds the rounding error of the derivative of a polynomial with `count` coefficients, each a sum of terms of
/// magnitude `size`.
pub fn rounding_of_rate(count: usize, size: f64) -> f64 {
    ROUNDING * count.saturating_sub(1) as f64 * size
}

/// Returns the value at `theta` of the polynomial with the given Bernstein coefficients.
pub fn value(coefficients: &[f64], theta: f64) -> f64 {
    // Horner's scheme for the Bernstein basis, with binomials and powers accumulated in the loop.
    let degree = coefficients.len().saturating_sub(1);
    let rest = 1.0 - theta;
    let (mut sum, mut weight) = (0.0, 1.0);
    for (k, coefficient) in coefficients.iter().enumerate() {
        sum = sum * rest + weight * coefficient;
        weight *= theta * (degree - k) as f64 / (k + 1) as f64;
    }
    sum
}

/// Subdivides a polynomial on `[0, 1]` at 1/2: replaces its Bernstein coefficients in `first` by those on the first
/// half, and writes those on the second half to `second`.
pub fn halve(first: &mut [f64], second: &mut [f64]) {
    let count = first.len();
    second.copy_from_slice(first);
    for (round, first) in first.iter_mut().enumerate().skip(1) {
        for i in 0..count - round {
            second[i] = 0.5 * (second[i] + second[i + 1]);
        }
        *first = second[0];
    }
}

fn of_ends(values: impl Iterator<Item = f64>) -> Interval {
    let (mut lo, mut hi, mut is_nan) = (f64::INFINITY, f64::NEG_INFINITY, false);
    for value in values {
        lo = lo.min(value);
        hi = hi.max(value);
        is_nan |= value.is_nan();
    }
    if is_nan {
        return Interval::LINE;
    }
    let noise = ROUNDING * lo.abs().max(hi.abs());
    Interval::new(lo - noise, hi + noise)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The Bernstein coefficients of the polynomial `(u - 1/4) (u - 3/4)`.
    const PARABOLA: [f64; 3] = [3.0 / 16.0, -5.0 / 16.0, 3.0 / 16.0];

    #[test]
    fn values_are_those_of_the_polynomial() {
        for (u, exact) in [(0.0, 0.1875), (0.25, 0.0), (0.5, -0.0625), (0.9, 0.0975), (1.0, 0.1875)] {
            assert!((value(&PARABOLA, u) - exact).abs() < 1e-15, "at {u}");
        }
    }

    #[test]
    fn halves_are_the_same_polynomial_and_their_ranges_are_sharper() {
        let (mut first, mut second) = (PARABOLA, [0.0; 3]);
        halve(&mut first, &mut second);
        for u in [0.0, 0.3, 1.0] {
            assert!((value(&first, u) - value(&PARABOLA, 0.5 * u)).abs() < 1e-15);
            assert!((value(&second, u) - value(&PARABOLA, 0.5 + 0.5 * u)).abs() < 1e-15);
        }
        assert!(range(&PARABOLA).contains(-0.3125) && !range(&first).contains(-0.0626));
        assert!(range_of_rate(&PARABOLA).contains(-1.0) && range_of_rate(&PARABOLA).hi < 1.001);
    }
}
