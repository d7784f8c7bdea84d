//! The Euclidean ball `{z : |z| <= r}`, with the projection `P` and its derivative
//!
//! ```text
//! P(x) = x  or  r x/|x|,    P'(x) = I  or  (r/|x|) (I - u u^T),  u = x/|x|
//! ```
//!
//! inside and outside the ball, respectively. On the sphere `|x| = r`, where `P` has a kink, `P'` is set to the
//! identity.

/// Writes the projection of `x` onto the ball `|z| <= radius` to `p`.
pub(super) fn project(radius: f64, x: &[f64], p: &mut [f64]) {
    let norm = norm(x);
    let factor = if norm <= radius { 1.0 } else { radius / norm };
    for (p, x) in p.iter_mut().zip(x) {
        *p = factor * x;
    }
}

/// Writes the derivative at `x` of the projection onto the ball `|z| <= radius`, by columns.
pub(super) fn derivative(radius: f64, x: &[f64], out: &mut [f64]) {
    let norm = norm(x);
    let inside = norm <= radius;
    for (j, column) in out.chunks_exact_mut(x.len()).enumerate() {
        for (i, out) in column.iter_mut().enumerate() {
            let unit = f64::from(i == j);
            *out = if inside { unit } else { radius / norm * (unit - x[i] / norm * (x[j] / norm)) };
        }
    }
}

/// Returns the Euclidean norm of `x`, scaled by the largest component to avoid overflow.
pub(super) fn norm(x: &[f64]) -> f64 {
    let largest = x.iter().fold(0.0_f64, |largest, x| if x.is_nan() { f64::NAN } else { largest.max(x.abs()) });
    if largest == 0.0 || !largest.is_finite() {
        return x.iter().map(|x| x.abs()).sum();
    }
    largest * x.iter().map(|x| (x / largest) * (x / largest)).sum::<f64>().sqrt()
}

/// Returns the index of the component of `x` of largest absolute value.
pub(super) fn largest(x: &[f64]) -> usize {
    (0..x.len()).max_by(|&i, &j| x[i].abs().total_cmp(&x[j].abs())).unwrap_or(0)
}
