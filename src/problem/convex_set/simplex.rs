//! The unit simplex `{z : z >= 0, sum z = 1}`, with the projection `P` and its derivative
//!
//! ```text
//! P(x) = max(x - tau, 0),    P'(x) = I_S - 1_S 1_S^T / |S|,    S = {i : P(x)_i > 0}
//! ```
//!
//! with the shift `tau` such that the components of `P(x)` sum to one, found by sorting (Held, Wolfe and Crowder
//! 1974, *Validation of subgradient optimization*).

/// Writes the projection of `x` onto the unit simplex to `p`; `sorted` is a workspace of the length of `x`.
pub(super) fn project(x: &[f64], p: &mut [f64], sorted: &mut [f64]) {
    if !x.iter().all(|x| x.is_finite()) {
        p.fill(f64::NAN);
        return;
    }
    sorted.copy_from_slice(x);
    sorted.sort_unstable_by(|a, b| b.total_cmp(a));
    // Subtract the largest component of `x` first, so that a large mean of `x` does not cause cancellation.
    let top = sorted[0];
    let (mut sum, mut tau) = (0.0, -1.0);
    for (count, &x) in sorted.iter().enumerate() {
        sum += x - top;
        let candidate = (sum - 1.0) / (count + 1) as f64;
        if x - top <= candidate {
            break;
        }
        tau = candidate;
    }
    for (p, x) in p.iter_mut().zip(x) {
        *p = (x - top - tau).max(0.0);
    }
}

/// Writes the derivative of the projection onto the unit simplex, by columns, given the projected point `p`.
pub(super) fn derivative(p: &[f64], out: &mut [f64]) {
    let support = p.iter().filter(|p| **p > 0.0).count().max(1) as f64;
    for (j, column) in out.chunks_exact_mut(p.len()).enumerate() {
        for (i, out) in column.iter_mut().enumerate() {
            let both = p[i] > 0.0 && p[j] > 0.0;
            *out = if both { f64::from(i == j) - 1.0 / support } else { 0.0 };
        }
    }
}
