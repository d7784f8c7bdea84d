//! Integrals over time of what is taken along the dense output of a step.

use numerics::kronrod;

/// The difference of both rules of quadrature, in parts of the integral of the size, at which they agree.
const AGREE: f64 = 1e-13;
/// The parts of a step that are integrated apart at most, as where an integrand has a kink: each halving takes two digits.
const MOST_PARTS: usize = 64;

/// Adds the integrals of functions between two times to `integrals`. `at` writes all of them at a time.
pub(super) fn integrate(from: f64, to: f64, integrals: &mut [f64], mut at: impl FnMut(f64, &mut [f64])) {
    let mut left = vec![(from, to)];
    let mut parts = 0;
    let mut values = vec![0.0; integrals.len()];
    let mut sums = vec![[0.0; 3]; integrals.len()];
    while let Some((a, b)) = left.pop() {
        parts += 1;
        sums.fill([0.0; 3]);
        for (t, weight, excess) in kronrod(a, b) {
            at(t, &mut values);
            for ([sum, difference, size], value) in sums.iter_mut().zip(&values) {
                *sum += weight * value;
                *difference += excess * value;
                *size += (weight * value).abs();
            }
        }
        let middle = a + 0.5 * (b - a);
        let agree = sums.iter().zip(&*integrals).all(|([_, difference, size], integral)| {
            difference.abs() <= AGREE * size.max(f64::EPSILON / AGREE * integral.abs())
        });
        if !agree && parts + left.len() < MOST_PARTS && a < middle && middle < b {
            left.extend([(middle, b), (a, middle)]);
        } else {
            integrals.iter_mut().zip(&sums).for_each(|(integral, [sum, ..])| *integral += sum);
        }
    }
}
