//! Products and inverses of small column-major matrices in slices. The common sizes are compile-time constants: six for
//! a body, three for a ball joint, five for a hinge or slider, one for a spring.

use std::array::from_fn;

/// Computes `c -= a b` for column-major matrices with sizes `[rows, inner, columns]`.
pub fn subtract_product(sizes: [usize; 3], c: &mut [f64], a: &[f64], b: &[f64]) {
    match sizes[0] {
        6 => with_rows::<6>(sizes, c, a, b),
        3 => with_rows::<3>(sizes, c, a, b),
        5 => with_rows::<5>(sizes, c, a, b),
        _ => {
            let [rows, inner, columns] = sizes;
            for column in 0..columns {
                for k in 0..inner {
                    let factor = b[column * inner + k];
                    (0..rows).for_each(|i| c[column * rows + i] -= a[k * rows + i] * factor);
                }
            }
        }
    }
}

fn with_rows<const M: usize>([_, inner, columns]: [usize; 3], c: &mut [f64], a: &[f64], b: &[f64]) {
    match inner {
        6 => with_inner::<M, 6>(columns, c, a, b),
        3 => with_inner::<M, 3>(columns, c, a, b),
        5 => with_inner::<M, 5>(columns, c, a, b),
        _ => product::<M>(inner, c, a, b),
    }
}

fn with_inner<const M: usize, const K: usize>(columns: usize, c: &mut [f64], a: &[f64], b: &[f64]) {
    let columns_of_a: [[f64; M]; K] = from_fn(|k| from_fn(|i| a[k * M + i]));
    for (c, b) in c.chunks_exact_mut(M).zip(b.chunks_exact(K)).take(columns) {
        let mut sum: [f64; M] = from_fn(|i| c[i]);
        for (a, factor) in columns_of_a.iter().zip(b) {
            (0..M).for_each(|i| sum[i] -= a[i] * factor);
        }
        c.copy_from_slice(&sum);
    }
}

fn product<const M: usize>(inner: usize, c: &mut [f64], a: &[f64], b: &[f64]) {
    for (c, b) in c.chunks_exact_mut(M).zip(b.chunks_exact(inner)) {
        for (a, factor) in a.chunks_exact(M).zip(b) {
            (0..M).for_each(|i| c[i] -= a[i] * factor);
        }
    }
}

/// Inverts an `n x n` matrix in place by Gauss-Jordan elimination with partial pivoting; returns false if the matrix is
/// singular.
pub fn invert(n: usize, a: &mut [f64]) -> bool {
    match n {
        6 => invert_of::<6>(a),
        3 => invert_of::<3>(a),
        5 => invert_of::<5>(a),
        1 => invert_of::<1>(a),
        2 => invert_of::<2>(a),
        _ => invert_of::<4>(a),
    }
}

fn invert_of<const N: usize>(entries: &mut [f64]) -> bool {
    let mut a: [[f64; N]; N] = from_fn(|column| from_fn(|row| entries[column * N + row]));
    let mut swaps = [0; N];
    for k in 0..N {
        let pivot = (k..N).fold(k, |best, row| if a[k][row].abs() > a[k][best].abs() { row } else { best });
        swaps[k] = pivot;
        let value = a[k][pivot];
        if value == 0.0 || !value.is_finite() {
            return false;
        }
        a.iter_mut().for_each(|column| column.swap(k, pivot));
        let inverse = 1.0 / value;
        let mut factors = a[k];
        factors[k] = 0.0;
        a[k] = [0.0; N];
        a[k][k] = 1.0;
        for column in &mut a {
            let scaled = column[k] * inverse;
            (0..N).for_each(|row| column[row] -= factors[row] * scaled);
            column[k] = scaled;
        }
    }
    // Row exchanges of a matrix are column exchanges of its inverse, in reverse order.
    for k in (0..N).rev() {
        a.swap(k, swaps[k]);
    }
    for (column, a) in entries.chunks_exact_mut(N).zip(&a) {
        column.copy_from_slice(a);
    }
    true
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_matrix_times_its_inverse_is_the_identity_for_every_size() {
        for n in 1..=6 {
            // The test matrix is chosen so that the pivots of some columns are not on the diagonal.
            let a: Vec<f64> = (0..n * n).map(|k| ((7 * k * k + 3 * k + 2) % 11) as f64 - 3.5).collect();
            let mut inverse = a.clone();
            assert!(invert(n, &mut inverse), "{n}");
            let mut rest: Vec<f64> = (0..n * n).map(|k| f64::from(u8::from(k % (n + 1) == 0))).collect();
            subtract_product([n, n, n], &mut rest, &a, &inverse);
            assert!(rest.iter().all(|rest| rest.abs() < 1e-12), "{n}: {rest:?}");
        }
        assert!(!invert(3, &mut [0.0; 9]) && !invert(2, &mut [1.0, 1.0, 1.0, 1.0]));
    }
}
