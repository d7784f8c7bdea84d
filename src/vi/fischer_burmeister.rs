//! The Fischer-Burmeister equation of one component of a variational inequality over an interval,
//!
//! ```text
//! phi(a, b) = a + b - sqrt(a^2 + b^2) = 0   if and only if   a >= 0, b >= 0, a b = 0
//! psi(z, w) = phi(z - l, -phi(u - z, -w))
//! ```
//!
//! with the inner or outer `phi` replaced by its limit if a bound is infinite: `psi = phi(z - l, w)`, `-phi(u - z,
//! -w)` or `w`. The square of `psi` is continuously differentiable (Billups 1995, *Algorithms for complementarity
//! problems and generalized equations*, chapter 3).

/// A value of the Fischer-Burmeister function `psi` with an element of its generalised gradient.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Psi {
    pub value: f64,
    /// The derivative of `psi` by the variable `z`.
    pub by_z: f64,
    /// The derivative of `psi` by the value `w` of the inequality.
    pub by_w: f64,
}

/// Evaluates `psi(z, w)` over the interval `[lower, upper]`.
pub(super) fn psi(z: f64, w: f64, lower: f64, upper: f64) -> Psi {
    let (below, above) = (lower > f64::NEG_INFINITY, upper < f64::INFINITY);
    if lower == upper {
        return Psi { value: z - lower, by_z: 1.0, by_w: 0.0 };
    }
    let mut psi = Psi { value: w, by_z: 0.0, by_w: 1.0 };
    if above {
        let (value, by_a, by_b) = phi(upper - z, -w);
        psi = Psi { value: -value, by_z: by_a, by_w: by_b };
    }
    if below {
        let (value, by_a, by_b) = phi(z - lower, psi.value);
        psi = Psi { value, by_z: by_a + by_b * psi.by_z, by_w: by_b * psi.by_w };
    }
    psi
}

/// Returns the Fischer-Burmeister function `phi` and its gradient; at the origin, the limit along `a = b > 0`.
fn phi(a: f64, b: f64) -> (f64, f64, f64) {
    let r = a.hypot(b);
    if r == 0.0 {
        let slope = 1.0 - std::f64::consts::FRAC_1_SQRT_2;
        return (0.0, slope, slope);
    }
    // Both forms are equal in exact arithmetic; the first does not cancel if `phi` is small relative to `a` and `b`.
    let value = if a + b > 0.0 { 2.0 * a * (b / (a + b + r)) } else { a + b - r };
    (value, slope(a, b, r), slope(b, a, r))
}

/// Returns `1 - a / r` for `r = sqrt(a^2 + b^2)`, the derivative of `phi` by `a`, without cancellation.
fn slope(a: f64, b: f64, r: f64) -> f64 {
    if a > 0.0 { (b / r) * (b / (r + a)) } else { 1.0 - a / r }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn psi_vanishes_exactly_at_the_solutions() {
        let inf = f64::INFINITY;
        for (z, w, l, u, solved) in [
            (0.0, 3.0, 0.0, inf, true),
            (2.0, 0.0, 0.0, inf, true),
            (0.0, -1.0, 0.0, inf, false),
            (1.0, 1.0, 0.0, inf, false),
            (-1.0, 0.0, 0.0, inf, false),
            (1.0, -4.0, -inf, 1.0, true),
            (1.0, 4.0, -inf, 1.0, false),
            (1.0, -4.0, -1.0, 1.0, true),
            (-1.0, 4.0, -1.0, 1.0, true),
            (0.3, 0.0, -1.0, 1.0, true),
            (0.3, 0.1, -1.0, 1.0, false),
            (7.0, 0.0, -inf, inf, true),
            (7.0, 1.0, -inf, inf, false),
            (2.0, -9.0, 2.0, 2.0, true),
            (2.1, -9.0, 2.0, 2.0, false),
        ] {
            assert_eq!(psi(z, w, l, u).value.abs() < 1e-14, solved, "z = {z}, w = {w} in [{l}, {u}]");
        }
    }

    #[test]
    fn the_gradient_is_the_limit_of_differences() {
        let inf = f64::INFINITY;
        for (l, u) in [(0.0, inf), (-inf, 1.0), (-1.0, 1.0), (-inf, inf)] {
            for (z, w) in [(0.3, 0.7), (0.3, -0.7), (-2.0, 0.5), (3.0, 2.0), (0.9, 1e-3)] {
                let h = 1e-6;
                let exact = psi(z, w, l, u);
                let by_z = (psi(z + h, w, l, u).value - psi(z - h, w, l, u).value) / (2.0 * h);
                let by_w = (psi(z, w + h, l, u).value - psi(z, w - h, l, u).value) / (2.0 * h);
                assert!((exact.by_z - by_z).abs() < 1e-8 && (exact.by_w - by_w).abs() < 1e-8);
            }
        }
    }

    #[test]
    fn a_small_value_of_phi_keeps_its_digits() {
        // The expansion phi(1, b) = b - b^2/2 + O(b^4) holds.
        let b = 1e-12;
        assert!((phi(1.0, b).0 / b - 1.0).abs() < 1e-11);
        assert!((phi(1.0, b).1 / (0.5 * b * b) - 1.0).abs() < 1e-11);
    }
}
