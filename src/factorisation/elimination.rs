//! LU factors `P A = L U` of small matrices, real and complex, with partial pivoting, in place and without allocation
//! (Golub and Van Loan 2013, algorithm 3.4.1). A complex matrix is stored as its real and its imaginary part: the
//! loops over a column are then loops over real numbers, which the compiler vectorises.
//!
//! The real and the complex elimination write, for each row of the factors, the row of the matrix, and the
//! reciprocals of the pivots, by which a substitution multiplies: a division would take as long as all of its other
//! operations. The reciprocal of a zero pivot is not finite, which shows in every solution.

/// Computes the LU factors of a real `n x n` matrix in place, column by column.
pub(super) fn eliminate(matrix: &mut [f64], permutation: &mut [usize], reciprocals: &mut [f64]) {
    of_size!(permutation.len(), |n| eliminate_of(n, matrix, permutation, reciprocals));
}

#[inline(always)]
fn eliminate_of(n: usize, a: &mut [f64], permutation: &mut [usize], reciprocals: &mut [f64]) {
    let (a, permutation, reciprocals) = (&mut a[..n * n], &mut permutation[..n], &mut reciprocals[..n]);
    permutation.iter_mut().enumerate().for_each(|(row, from)| *from = row);
    for k in 0..n {
        let (done, right) = a.split_at_mut((k + 1) * n);
        let column = &mut done[k * n..];
        let mut pivot = k;
        for i in k + 1..n {
            if column[i].abs() > column[pivot].abs() {
                pivot = i;
            }
        }
        let reciprocal = 1.0 / column[pivot];
        reciprocals[k] = reciprocal;
        if column[pivot] == 0.0 {
            continue;
        }
        column.swap(k, pivot);
        if pivot != k {
            permutation.swap(k, pivot);
            done[..k * n].chunks_exact_mut(n).for_each(|column| column.swap(k, pivot));
        }
        let factors = &mut done[k * n + k + 1..];
        factors.iter_mut().for_each(|factor| *factor *= reciprocal);
        for column in right.chunks_exact_mut(n) {
            column.swap(k, pivot);
            let (above, below) = column.split_at_mut(k + 1);
            let value = above[k];
            below.iter_mut().zip(&*factors).for_each(|(entry, factor)| *entry -= factor * value);
        }
    }
}

/// A vector of complex numbers, or a complex matrix in column-major order, as real and imaginary parts.
#[derive(Clone, Debug, Default)]
struct Split {
    re: Vec<f64>,
    im: Vec<f64>,
}

impl Split {
    fn new(length: usize) -> Self {
        Self { re: vec![0.0; length], im: vec![0.0; length] }
    }
}

/// LU factors of a small complex matrix.
#[derive(Clone, Debug)]
pub struct ComplexLu {
    entries: Split,
    permutation: Vec<usize>,
    reciprocals: Split,
    permuted: Split,
}

impl ComplexLu {
    /// Largest number of rows for which the unblocked complex elimination is used. With fifteen rows (the ring
    /// modulator), integration steps are rejected more often than with faer's blocked elimination.
    pub const MOST: usize = 10;

    /// Allocates the factors and the workspace for an `n x n` matrix.
    pub fn new(n: usize) -> Self {
        let vector = || Split::new(n);
        Self { entries: Split::new(n * n), permutation: vec![0; n], reciprocals: vector(), permuted: vector() }
    }

    /// Returns the real and the imaginary parts of the matrix entries in column-major order, to be written before
    /// [`ComplexLu::factorise`], which overwrites them.
    pub fn entries(&mut self) -> (&mut [f64], &mut [f64]) {
        (&mut self.entries.re, &mut self.entries.im)
    }

    /// Computes the LU factors of the matrix that was written to [`ComplexLu::entries`].
    pub fn factorise(&mut self) {
        of_size!(self.permutation.len(), |n| self.factorise_of(n));
    }

    #[inline(always)]
    fn factorise_of(&mut self, n: usize) {
        let Self { entries: Split { re, im }, permutation, reciprocals, .. } = self;
        let (re, im, permutation) = (&mut re[..n * n], &mut im[..n * n], &mut permutation[..n]);
        permutation.iter_mut().enumerate().for_each(|(row, from)| *from = row);
        for k in 0..n {
            let (done_re, right_re) = re.split_at_mut((k + 1) * n);
            let (done_im, right_im) = im.split_at_mut((k + 1) * n);
            let (column_re, column_im) = (&mut done_re[k * n..], &mut done_im[k * n..]);
            let size = |i: usize| column_re[i].abs() + column_im[i].abs();
            let (mut pivot, mut largest) = (k, size(k));
            for i in k + 1..n {
                let size = size(i);
                if size > largest {
                    (pivot, largest) = (i, size);
                }
            }
            let (p, q) = (column_re[pivot], column_im[pivot]);
            let square = p * p + q * q;
            let (a, b) = (p / square, -q / square);
            (reciprocals.re[k], reciprocals.im[k]) = (a, b);
            if largest == 0.0 {
                continue;
            }
            column_re.swap(k, pivot);
            column_im.swap(k, pivot);
            if pivot != k {
                permutation.swap(k, pivot);
                done_re[..k * n].chunks_exact_mut(n).for_each(|column| column.swap(k, pivot));
                done_im[..k * n].chunks_exact_mut(n).for_each(|column| column.swap(k, pivot));
            }
            let (factors_re, factors_im) = (&mut done_re[k * n + k + 1..], &mut done_im[k * n + k + 1..]);
            for (re, im) in factors_re.iter_mut().zip(&mut *factors_im) {
                (*re, *im) = (*re * a - *im * b, *re * b + *im * a);
            }
            for (column_re, column_im) in right_re.chunks_exact_mut(n).zip(right_im.chunks_exact_mut(n)) {
                column_re.swap(k, pivot);
                column_im.swap(k, pivot);
                let (above_re, below_re) = column_re.split_at_mut(k + 1);
                let (above_im, below_im) = column_im.split_at_mut(k + 1);
                subtract(below_re, below_im, (above_re[k], above_im[k]), factors_re, factors_im);
            }
        }
    }

    /// Solves the linear system in place of the real and imaginary parts of its right-hand side; returns false if the
    /// solution is not finite, as the matrix is then singular.
    pub fn solve(&mut self, right_re: &mut [f64], right_im: &mut [f64]) -> bool {
        of_size!(self.permutation.len(), |n| self.solve_of(n, right_re, right_im))
    }

    #[inline(always)]
    fn solve_of(&mut self, n: usize, right_re: &mut [f64], right_im: &mut [f64]) -> bool {
        let Self { entries, permutation, reciprocals, permuted } = self;
        let (right_re, right_im, permutation) = (&mut right_re[..n], &mut right_im[..n], &permutation[..n]);
        let (x, y) = (&mut permuted.re[..n], &mut permuted.im[..n]);
        for ((x, y), &row) in x.iter_mut().zip(&mut *y).zip(permutation) {
            (*x, *y) = (right_re[row], right_im[row]);
        }
        for k in 0..n {
            let ((known_x, below_x), (known_y, below_y)) = (x.split_at_mut(k + 1), y.split_at_mut(k + 1));
            let column = k * n + k + 1..(k + 1) * n;
            subtract(below_x, below_y, (known_x[k], known_y[k]), &entries.re[column.clone()], &entries.im[column]);
        }
        for k in (0..n).rev() {
            let ((above_x, rest_x), (above_y, rest_y)) = (x.split_at_mut(k), y.split_at_mut(k));
            let ((p, q), (a, b)) = ((rest_x[0], rest_y[0]), (reciprocals.re[k], reciprocals.im[k]));
            let value = (p * a - q * b, p * b + q * a);
            (rest_x[0], rest_y[0]) = value;
            let column = k * n..k * n + k;
            subtract(above_x, above_y, value, &entries.re[column.clone()], &entries.im[column]);
        }
        right_re.copy_from_slice(x);
        right_im.copy_from_slice(y);
        // Read all entries without early exit, so that the loop is vectorised.
        x.iter().chain(&*y).fold(true, |finite, x| finite & x.is_finite())
    }
}

/// Subtracts a multiple of a column, `x -= factor column`, for complex numbers.
#[inline(always)]
fn subtract(x: &mut [f64], y: &mut [f64], (p, q): (f64, f64), column_re: &[f64], column_im: &[f64]) {
    for ((x, y), (a, b)) in x.iter_mut().zip(y).zip(column_re.iter().zip(column_im)) {
        *x -= a * p - b * q;
        *y -= a * q + b * p;
    }
}
