//! The coefficients of Radau IIA for any number of stages `s`.
//!
//! With `P_k` the shifted Legendre polynomials, orthonormal on `[0, 1]`, the nodes `c` are the zeros of
//! `P_s/sqrt(2s+1) - P_{s-1}/sqrt(2s-1)`, and with `W_ij = P_{j-1}(c_i)`, `B = diag(b)`:
//!
//! ```text
//! W^T B W = I,    A = W X W^T B,    X tridiagonal:  X_11 = 1/2,  X_{k+1,k} = -X_{k,k+1} = xi_k,  X_ss = 1/(4s-2)
//! ```
//!
//! with `xi_k = 1 / (2 sqrt(4k^2 - 1))` (Hairer and Wanner 1996, theorem IV.5.6 and table IV.5.13). All intermediate
//! numbers are of order one, so that the coefficients are accurate to the last digits.

use nalgebra::{Complex, DMatrix};
use std::sync::OnceLock;

/// Radau IIA with `s` stages: order `2s - 1`, stage order `s`, stiffly accurate.
#[derive(Clone, Debug)]
pub struct Tableau {
    /// The nodes `c`, increasing; the last is 1.
    pub c: Vec<f64>,
    /// The matrix `A` of coefficients, `s x s`; its last row is `b`.
    pub a: DMatrix<f64>,
    /// The weights `b`, all positive.
    pub b: Vec<f64>,
    /// Diagonal `d_i = b_i / c_i` of a matrix `D` for which `D A + A^T D` is positive definite (Hairer and Wanner
    /// 1996, IV.14), so that the inequalities at the stages, scaled by `D`, are monotone if the problem is.
    pub d: Vec<f64>,
    /// The inverse `A^-1` of the matrix of coefficients.
    pub a_inverse: DMatrix<f64>,
    /// The real eigenvalue of `A^-1`; `None` if `s` is even.
    pub gamma: Option<f64>,
    /// One of each pair of complex eigenvalues of `A^-1`, `alpha + i beta` with `beta > 0`.
    pub pairs: Vec<Complex<f64>>,
    /// Transformation `T` with `A^-1 = T L T^-1`, where the diagonal of `L` consists of `gamma` and a block
    /// `[[alpha, beta], [-beta, alpha]]` for each pair. The last row of `T` is one in the column of `gamma` and in
    /// the first column of each pair, and zero elsewhere.
    pub t: DMatrix<f64>,
    /// The inverse `T^-1` of the transformation that block-diagonalises `A^-1`.
    pub t_inverse: DMatrix<f64>,
    /// Largest row sum of `|T| |T^-1|`: the growth of rounding errors in the transform from `Z` to `W` and back.
    pub mixing: f64,
    /// Weights of the stage increments in the embedded error estimate: `-l_i(0) / c_i`, where `l_i` is the Lagrange
    /// polynomial of node `i` (as in RADAU; for `s = 3` the `-(13+7 sqrt 6)/3, ..` of RADAU5).
    pub estimate: Vec<f64>,
    /// Maps the stage increments `Z` to `h` times the Legendre coefficients of the slope of the collocation polynomial,
    /// in the orthonormal basis, from degree 0 on.
    pub spectrum: DMatrix<f64>,
    /// Coefficients of the polynomial `p` with `p(0) = p(1) = 0`, `p'(0) = 1` and `p'(c_i) = 0`, from the first power
    /// on: `p'` is the node polynomial, orthogonal to constants for `s >= 2`. Empty for one stage, for which `p` does
    /// not exist.
    bubble: Vec<f64>,
    bernstein: OnceLock<Vec<Vec<f64>>>,
    /// Barycentric weights of the nodes `0, c_1, .., c_s`.
    barycentric: Vec<f64>,
}

/// Maximum number of stages of a tableau of Radau IIA.
pub const MOST_STAGES: usize = 9;

static TABLEAUX: [OnceLock<Tableau>; MOST_STAGES] = [const { OnceLock::new() }; MOST_STAGES];

impl Tableau {
    /// Returns the coefficients of Radau IIA for `s` stages, where `s` is clamped to 1 to 9; they are computed on first
    /// use.
    pub fn of(s: usize) -> &'static Self {
        let s = s.clamp(1, MOST_STAGES);
        TABLEAUX[s - 1].get_or_init(|| Self::new(s))
    }

    /// Computes the coefficients of Radau IIA for `s >= 1` stages.
    fn new(s: usize) -> Self {
        let c = nodes(s);
        let w = DMatrix::from_fn(s, s, |i, j| legendre(c[i], s)[j]);
        let b: Vec<f64> = (0..s).map(|i| 1.0 / w.row(i).norm_squared()).collect();
        let weighted = DMatrix::from_fn(s, s, |i, j| w[(j, i)] * b[j]);
        let x = DMatrix::from_fn(s, s, |i, j| tridiagonal(s, i, j));
        let identity = DMatrix::identity(s, s);
        let x_inverse = x.clone().lu().solve(&identity).unwrap_or(identity);
        let a = &w * &x * &weighted;
        let spectrum = x_inverse * &weighted;
        let a_inverse = &w * &spectrum;

        let (gamma, pairs) = eigenvalues(&x);
        let mut t = DMatrix::zeros(s, s);
        let mut column = 0;
        if let Some(gamma) = gamma {
            let v = eigenvector(&w, Complex::new(1.0 / gamma, 0.0));
            for (i, v) in v.iter().enumerate() {
                t[(i, column)] = v.re;
            }
            column += 1;
        }
        for &pair in &pairs {
            let v = eigenvector(&w, 1.0 / pair);
            for (i, v) in v.iter().enumerate() {
                t[(i, column)] = v.re;
                t[(i, column + 1)] = v.im;
            }
            column += 2;
        }
        let t_inverse = t.clone().lu().solve(&DMatrix::identity(s, s)).unwrap_or_else(|| DMatrix::zeros(s, s));

        let estimate = (0..s)
            .map(|i| {
                let at_zero: f64 = (0..s).filter(|&j| j != i).map(|j| c[j] / (c[j] - c[i])).product();
                -at_zero / c[i]
            })
            .collect();
        let node = |i: usize| if i == 0 { 0.0 } else { c[i - 1] };
        let barycentric =
            (0..=s).map(|i| 1.0 / (0..=s).filter(|&j| j != i).map(|j| node(i) - node(j)).product::<f64>()).collect();
        let bubble = if s == 1 { Vec::new() } else { bubble(&c) };
        let d = b.iter().zip(&c).map(|(b, c)| b / c).collect();
        let mixing = (t.abs() * t_inverse.abs()).column_sum().amax();
        Self {
            c,
            a,
            b,
            d,
            a_inverse,
            gamma,
            pairs,
            t,
            t_inverse,
            mixing,
            estimate,
            spectrum,
            bubble,
            bernstein: OnceLock::new(),
            barycentric,
        }
    }

    /// Returns the value at `theta` of the bubble: the polynomial that vanishes at both ends of a step, with slope 1
    /// at its beginning and 0 at the nodes.
    pub fn bubble_at(&self, theta: f64) -> f64 {
        self.bubble.iter().rev().fold(0.0, |value, coefficient| (value + coefficient) * theta)
    }

    /// Returns the Bernstein coefficients of the bubble, the polynomial that vanishes at both ends of a step and has
    /// the slope 0 at the nodes, of degree `s + 1` on `[0, 1]`.
    pub fn bubble_in_bernstein(&self) -> Vec<f64> {
        let powers: Vec<f64> = std::iter::once(0.0).chain(self.bubble.iter().copied()).collect();
        in_bernstein(&powers, self.stages() + 1)
    }

    /// Returns the Bernstein coefficients of the collocation polynomials of the increments, of degree `s` on
    /// `[0, 1]`: one polynomial per stage.
    pub fn bernstein(&self) -> &[Vec<f64>] {
        self.bernstein.get_or_init(|| {
            let s = self.stages();
            let of_stage = |i: usize| {
                let others = self.c.iter().enumerate().filter(|&(j, _)| j != i).map(|(_, &c)| c);
                // Power coefficients of theta times the product of (theta - c_j) over the other nodes c_j.
                let mut powers = vec![0.0, self.barycentric[i + 1]];
                for c in others {
                    powers.push(0.0);
                    for k in (0..powers.len()).rev() {
                        powers[k] = if k > 0 { powers[k - 1] } else { 0.0 } - c * powers[k];
                    }
                }
                in_bernstein(&powers, s)
            };
            (0..s).map(of_stage).collect()
        })
    }

    /// Returns the number of stages `s` of the method.
    pub fn stages(&self) -> usize {
        self.c.len()
    }

    /// Returns the midpoints between the nodes `0, c_1, .., c_s` of the method.
    pub fn middles(&self) -> impl Iterator<Item = f64> {
        let left = std::iter::once(0.0).chain(self.c.iter().copied());
        left.zip(&self.c).map(|(left, right)| 0.5 * (left + right))
    }

    /// Returns the weights of the stage increments in the slope of the collocation polynomial at the beginning of a
    /// step, times the step size.
    pub fn begin_weights(&self) -> Vec<f64> {
        let at_begin = |j: usize| {
            let others = (0..self.stages()).filter(|i| *i != j);
            others.map(|i| -self.c[i] / (self.c[j] - self.c[i])).product::<f64>() / self.c[j]
        };
        (0..self.stages()).map(at_begin).collect()
    }

    /// Returns the weights of the stage increments in the slope of the collocation polynomial at the end of a step of
    /// size `h`.
    pub fn end_weights(&self, h: f64) -> Vec<f64> {
        let s = self.stages();
        (0..s).map(|j| self.a_inverse[(s - 1, j)] / h).collect()
    }

    /// Writes the values at `theta` of the Lagrange polynomials of the nodes `0, c_1, .., c_s`, except the first
    /// polynomial, to `values`, of length `s`: they give the collocation polynomial of increments that vanish at
    /// `theta = 0`.
    pub fn increments_at(&self, theta: f64, values: &mut [f64]) {
        let mut at_node = None;
        let mut product = theta;
        for (i, &c) in self.c.iter().enumerate() {
            if theta == c {
                at_node = Some(i);
            }
            product *= theta - c;
        }
        for (i, value) in values.iter_mut().enumerate() {
            *value = match at_node {
                Some(node) => f64::from(u8::from(i == node)),
                None => product * self.barycentric[i + 1] / (theta - self.c[i]),
            };
        }
    }

    /// Writes the values at `theta` of the Lagrange polynomials of the nodes `c_1, .., c_s` alone to `values`, of
    /// length `s`: they give the polynomial through values at the stages.
    pub fn stages_at(&self, theta: f64, values: &mut [f64]) {
        for (i, value) in values.iter_mut().enumerate() {
            let others = self.c.iter().enumerate().filter(|&(j, _)| j != i);
            *value = others.map(|(_, c)| (theta - c) / (self.c[i] - c)).product();
        }
    }
}

/// Returns the interpolation error of the collocation polynomial at a point: `value` minus the polynomial through
/// `begin` and the values at the stages, with the `weights` that [`Tableau::increments_at`] writes for that point.
pub fn interpolation_error(value: f64, begin: f64, at_stages: impl Iterator<Item = f64>, weights: &[f64]) -> f64 {
    value - begin - at_stages.zip(weights).map(|(stage, weight)| weight * (stage - begin)).sum::<f64>()
}

/// Converts power coefficients to the Bernstein basis of degree `degree`: `b_k = sum_i C(k,i)/C(n,i) a_i`.
fn in_bernstein(powers: &[f64], degree: usize) -> Vec<f64> {
    let of = |k: usize| {
        let mut ratio = 1.0;
        let mut sum = 0.0;
        for (i, power) in powers.iter().enumerate().take(k + 1) {
            sum += ratio * power;
            ratio *= (k - i) as f64 / (degree - i).max(1) as f64;
        }
        sum
    };
    (0..=degree).map(of).collect()
}

/// Returns the power coefficients of the integral of `prod_i (1 - theta / c_i)` from zero, without the constant term,
/// which vanishes.
fn bubble(c: &[f64]) -> Vec<f64> {
    let mut product = vec![1.0];
    for node in c {
        product.push(0.0);
        for k in (1..product.len()).rev() {
            product[k] -= product[k - 1] / node;
        }
    }
    product.iter().enumerate().map(|(k, coefficient)| coefficient / (k + 1) as f64).collect()
}

/// Returns the values of the first `s + 1` orthonormal shifted Legendre polynomials at `x` in `[0, 1]`.
fn legendre(x: f64, s: usize) -> Vec<f64> {
    let u = 2.0 * x - 1.0;
    let mut p = vec![1.0, u];
    for k in 1..s {
        let degree = k as f64;
        p.push(((2.0 * degree + 1.0) * u * p[k] - degree * p[k - 1]) / (degree + 1.0));
    }
    p.truncate(s + 1);
    for (k, value) in p.iter_mut().enumerate() {
        *value *= (2.0 * k as f64 + 1.0).sqrt();
    }
    p
}

/// Returns the value at `x` of `P_s - P_{s-1}` in Legendre's own scaling, whose zeros are the nodes, and its
/// derivative with respect to `x`.
fn node_polynomial(x: f64, s: usize) -> (f64, f64) {
    let u = 2.0 * x - 1.0;
    let (mut p0, mut p1) = (1.0, u);
    let (mut d0, mut d1) = (0.0, 1.0);
    for k in 1..s {
        let degree = k as f64;
        let p2 = ((2.0 * degree + 1.0) * u * p1 - degree * p0) / (degree + 1.0);
        let d2 = d0 + (2.0 * degree + 1.0) * p1;
        (p0, p1, d0, d1) = (p1, p2, d1, d2);
    }
    (p1 - p0, 2.0 * (d1 - d0))
}

/// Computes the nodes of Radau IIA with `s` stages: zeros bracketed on a fine cosine grid, then refined by Newton's
/// method.
fn nodes(s: usize) -> Vec<f64> {
    let cells = 40 * s;
    let grid = |k: usize| 0.5 * (1.0 - (std::f64::consts::PI * k as f64 / cells as f64).cos());
    let mut c = Vec::with_capacity(s);
    for k in 0..cells {
        let (mut low, mut high) = (grid(k), grid(k + 1).min(1.0 - 1e-9));
        let sign = node_polynomial(low, s).0;
        if sign * node_polynomial(high, s).0 > 0.0 || low >= high {
            continue;
        }
        for _ in 0..30 {
            let middle = 0.5 * (low + high);
            if node_polynomial(middle, s).0 * sign > 0.0 { low = middle } else { high = middle }
        }
        let mut x = 0.5 * (low + high);
        for _ in 0..4 {
            let (value, derivative) = node_polynomial(x, s);
            x -= value / derivative;
        }
        c.push(x);
    }
    c.truncate(s - 1);
    c.push(1.0);
    c
}

/// Returns the entry `(i, j)` of the tridiagonal matrix `X` of the W-transformation.
fn tridiagonal(s: usize, i: usize, j: usize) -> f64 {
    let xi = |k: usize| 0.5 / (4.0 * (k * k) as f64 - 1.0).sqrt();
    if i == j {
        let first = if i == 0 { 0.5 } else { 0.0 };
        let last = if i + 1 == s { 1.0 / (4.0 * s as f64 - 2.0) } else { 0.0 };
        if s == 1 { 1.0 } else { first + last }
    } else if i == j + 1 {
        xi(i)
    } else if j == i + 1 {
        -xi(j)
    } else {
        0.0
    }
}

/// Returns the eigenvalues of `X^-1`: the real one, if there is one, and the one with positive imaginary part of each
/// complex pair.
fn eigenvalues(x: &DMatrix<f64>) -> (Option<f64>, Vec<Complex<f64>>) {
    let s = x.nrows();
    let rough = x.complex_eigenvalues();
    let mut real = None;
    let mut pairs = Vec::new();
    for &mu in rough.iter() {
        let mu = refine(s, mu);
        // The matrix X has one real eigenvalue if s is odd, and none if s is even.
        if mu.im.abs() < 1e-9 {
            real = Some(1.0 / mu.re);
        } else if mu.im < 0.0 {
            pairs.push(1.0 / mu);
        }
    }
    pairs.sort_by(|p, q| p.im.total_cmp(&q.im));
    (real, pairs)
}

/// Refines an eigenvalue `mu` of `X` by Newton's method on `det(X - mu I)`, by the three-term recurrence of a
/// tridiagonal determinant.
fn refine(s: usize, mut mu: Complex<f64>) -> Complex<f64> {
    for _ in 0..3 {
        let one = Complex::new(1.0, 0.0);
        let (mut p0, mut p1) = (one, tridiagonal(s, 0, 0) - mu);
        let (mut d0, mut d1) = (Complex::new(0.0, 0.0), -one);
        for k in 1..s {
            let diagonal = tridiagonal(s, k, k) - mu;
            let coupling = tridiagonal(s, k, k - 1) * tridiagonal(s, k - 1, k);
            let p2 = diagonal * p1 - coupling * p0;
            let d2 = diagonal * d1 - p1 - coupling * d0;
            (p0, p1, d0, d1) = (p1, p2, d1, d2);
        }
        mu -= p1 / d1;
    }
    mu
}

/// Returns `W v` for the eigenvector `v` with `X v = mu v`, scaled so that its last component is one.
fn eigenvector(w: &DMatrix<f64>, mu: Complex<f64>) -> Vec<Complex<f64>> {
    let s = w.nrows();
    let mut v = vec![Complex::new(1.0, 0.0)];
    for k in 1..s {
        let below = if k >= 2 { tridiagonal(s, k - 1, k - 2) * v[k - 2] } else { Complex::new(0.0, 0.0) };
        v.push((below + (tridiagonal(s, k - 1, k - 1) - mu) * v[k - 1]) / -tridiagonal(s, k - 1, k));
    }
    let product: Vec<Complex<f64>> = (0..s).map(|i| (0..s).map(|j| v[j] * w[(i, j)]).sum()).collect();
    let last = product[s - 1];
    product.into_iter().map(|value| value / last).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn three_stages_are_those_of_radau5() {
        let tableau = Tableau::of(3);
        let r6 = 6.0_f64.sqrt();
        let a = [
            [(88.0 - 7.0 * r6) / 360.0, (296.0 - 169.0 * r6) / 1800.0, (-2.0 + 3.0 * r6) / 225.0],
            [(296.0 + 169.0 * r6) / 1800.0, (88.0 + 7.0 * r6) / 360.0, (-2.0 - 3.0 * r6) / 225.0],
            [(16.0 - r6) / 36.0, (16.0 + r6) / 36.0, 1.0 / 9.0],
        ];
        for (i, row) in a.iter().enumerate() {
            for (j, exact) in row.iter().enumerate() {
                assert!((tableau.a[(i, j)] - exact).abs() < 4e-16, "a{i}{j}");
            }
        }
        let d = [-(13.0 + 7.0 * r6) / 3.0, (-13.0 + 7.0 * r6) / 3.0, -1.0 / 3.0];
        for (i, (computed, exact)) in tableau.estimate.iter().zip(d).enumerate() {
            assert!((computed - exact).abs() < 2e-14, "estimate {i}");
        }
        // The eigenvalues of `A^-1` for three stages, as in the code RADAU5.
        assert!((tableau.gamma.unwrap() - 3.637_834_252_744_496).abs() < 4e-15);
        assert!((tableau.pairs[0].re - 2.681_082_873_627_752).abs() < 4e-15);
        assert!((tableau.pairs[0].im - 3.050_430_199_247_41).abs() < 4e-15);
    }

    #[test]
    fn every_number_of_stages_meets_the_order_conditions() {
        for s in 1..=9 {
            let tableau = Tableau::of(s);
            for q in 1..=(2 * s - 1) {
                let sum: f64 = (0..s).map(|i| tableau.b[i] * tableau.c[i].powi(q as i32 - 1)).sum();
                assert!((sum - 1.0 / q as f64).abs() < 2e-15, "B({q}) at s = {s}: {sum}");
            }
            for q in 1..=s {
                for i in 0..s {
                    let sum: f64 = (0..s).map(|j| tableau.a[(i, j)] * tableau.c[j].powi(q as i32 - 1)).sum();
                    assert!((sum - tableau.c[i].powi(q as i32) / q as f64).abs() < 3e-15, "C({q}) at s = {s}");
                }
            }
            for j in 0..s {
                assert!((tableau.a[(s - 1, j)] - tableau.b[j]).abs() < 1e-15, "stiffly accurate at s = {s}");
            }
            let product = &tableau.a * &tableau.a_inverse - DMatrix::identity(s, s);
            assert!(product.amax() < 1e-12, "inverse at s = {s}");
        }
    }

    #[test]
    fn the_transformation_gives_back_the_inverse() {
        for s in 1..=9 {
            let tableau = Tableau::of(s);
            assert_eq!(tableau.gamma.is_some(), s % 2 == 1, "s = {s}");
            let mut l = DMatrix::zeros(s, s);
            let mut k = 0;
            if let Some(gamma) = tableau.gamma {
                l[(0, 0)] = gamma;
                k = 1;
            }
            for pair in &tableau.pairs {
                l[(k, k)] = pair.re;
                l[(k + 1, k + 1)] = pair.re;
                l[(k, k + 1)] = pair.im;
                l[(k + 1, k)] = -pair.im;
                k += 2;
            }
            assert_eq!(k, s);
            let back = &tableau.t * l * &tableau.t_inverse - &tableau.a_inverse;
            let condition = tableau.t.amax() * tableau.t_inverse.amax() * tableau.a_inverse.amax();
            assert!(back.amax() < 1e-14 * condition, "s = {s}: {} of {condition}", back.amax());
        }
    }

    #[test]
    fn increments_are_interpolated_exactly() {
        let tableau = Tableau::of(4);
        let polynomial = |x: f64| x * (3.0 - x * (1.0 + x * (2.0 - 0.5 * x)));
        let mut values = [0.0; 4];
        for theta in [0.0, 0.1, tableau.c[1], 0.77, 1.0, 1.9] {
            tableau.increments_at(theta, &mut values);
            let sum: f64 = (0..4).map(|i| values[i] * polynomial(tableau.c[i])).sum();
            assert!((sum - polynomial(theta)).abs() < 1e-13, "theta = {theta}: {sum}");
        }
    }

    #[test]
    fn the_bubble_vanishes_at_both_ends_and_is_flat_at_the_nodes() {
        for s in 2..=9 {
            let tableau = Tableau::of(s);
            assert!(tableau.bubble_at(1.0).abs() < 1e-11, "s = {s}: {}", tableau.bubble_at(1.0));
            let slope = |x: f64| (tableau.bubble_at(x + 1e-6) - tableau.bubble_at(x - 1e-6)) / 2e-6;
            assert!((slope(0.0) - 1.0).abs() < 1e-5);
            assert!(tableau.c.iter().all(|&c| slope(c).abs() < 1e-5), "s = {s}");
        }
    }
}
