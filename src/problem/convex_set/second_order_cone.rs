//! The second-order cone `{(s, v) : s >= |v|}`. The projection `P` of `x = (s, v)` follows from the spectral
//! decomposition of the cone's Jordan algebra,
//!
//! ```text
//! x = l1 u1 + l2 u2,    l1,2 = s -+ |v|,    u1,2 = (1, -+ v/|v|)/2,    P(x) = max(l1, 0) u1 + max(l2, 0) u2
//! ```
//!
//! (Fukushima, Luo and Tseng 2002, *Smoothing functions for second-order-cone complementarity problems*, section 3).
//! Between the cone and its polar, with `c = s/|v|` and `e = v/|v|`,
//!
//! ```text
//! P'(x) = 1/2 [ 1  e^T ; e  (1 + c) I - c e e^T ]
//! ```
//!
//! Where `P` has a kink, `P'` is set to the identity on the boundary of the cone, and to zero on the boundary of its
//! polar.

use super::ball::norm;

/// Writes the projection of `x` onto the second-order cone to `p`.
pub(super) fn project(x: &[f64], p: &mut [f64]) {
    let (s, v) = (x[0], norm(&x[1..]));
    if v <= s {
        p.copy_from_slice(x);
    } else if v <= -s {
        p.fill(0.0);
    } else {
        let half = 0.5 * (s + v);
        p[0] = half;
        for (p, x) in p[1..].iter_mut().zip(&x[1..]) {
            *p = half * (x / v);
        }
    }
}

/// Writes the derivative at `x` of the projection onto the second-order cone, by columns.
pub(super) fn derivative(x: &[f64], out: &mut [f64]) {
    let (s, v) = (x[0], norm(&x[1..]));
    let outside = v > s && v > -s;
    for (j, column) in out.chunks_exact_mut(x.len()).enumerate() {
        for (i, out) in column.iter_mut().enumerate() {
            let unit = f64::from(i == j);
            *out = match (i, j) {
                _ if !outside => unit * f64::from(v <= s),
                (0, 0) => 0.5,
                (0, k) | (k, 0) => 0.5 * (x[k] / v),
                _ => 0.5 * ((1.0 + s / v) * unit - s / v * (x[i] / v) * (x[j] / v)),
            };
        }
    }
}
