//! Integrals over time along the dense output of a step.

use numerics::kronrod;

/// Relative difference of the two quadrature rules at which they count as equal.
const AGREE: f64 = 1e-13;
/// Most subintervals of a step, for integrands with kinks: each bisection gains two digits.
const MOST_PARTS: usize = 64;

/// Adds the integrals of several functions between two times to `integrals`; `at` evaluates all of them at a time.
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
