//! Uncertainty of fitted parameters: covariance, 95 % confidence intervals, and combinations that the data do not
//! determine.
//!
//! With residuals in units of the standard deviations of the data, the covariance is that of the linear problem at the
//! minimum, `s^2 (J'J)^-1`, with `s = 1`. If the standard deviations are unknown, `s^2` is the loss divided by the
//! degrees of freedom, and the intervals follow Student's distribution. For Huber's loss,
//! `s^2 = K^2 [sum psi^2/(m - p)]/[mean psi']^2` with `K = 1 + (p/m) var(psi')/(mean psi')^2` (Huber and Ronchetti
//! 2009, equation 7.81).
//!
//! The singular values are those of `J diag(size)/s`, with the magnitude `size` of each parameter: the inverse of a
//! singular value is the standard error of its combination of relative changes. A combination with a singular value of
//! zero, to the accuracy of `J`, is not determined.

use super::least_squares::{LeastSquares, Loss, Minimum};
use expression::cube_root;
use factorisation::Singular;
use nalgebra::DMatrix;
/// Components of a singular vector of the Jacobian below this value count as zero: the accuracy of singular vectors.
const PART: f64 = 1e-6;
/// The confidence level of the intervals of fitted parameters.
const CONFIDENCE: f64 = 0.95;
/// The two-sided 5 % quantile of the standard normal distribution.
const NORMAL: f64 = 1.959_963_984_540_054;
/// The degrees of freedom above which Student's distribution equals the normal distribution to four digits.
const MANY: usize = 20_000;
/// The 0.999 quantile of the standard normal distribution, beyond which a statistic of the residuals counts as
/// improbable.
const RARE: f64 = 3.090;

/// The least number of residuals for which the normal approximation of the number of runs of equal signs is accurate.
const NORMAL_FROM: usize = 20;

/// The uncertainties of all fitted parameters, in the order of the parameters.
#[derive(Clone, Debug)]
pub struct Intervals {
    /// Standard errors of the parameters; `None` for parameters that the data do not determine or that are at a
    /// bound.
    pub sd: Vec<Option<f64>>,
    /// Half the width of the confidence intervals of the parameters, in standard errors.
    pub width: f64,
    /// The covariance matrix of the parameters; `None` for parameters that have no standard error.
    pub covariance: Vec<Vec<Option<f64>>>,
    /// The singular values of the scaled Jacobian of the residuals, over the free parameters, decreasing.
    pub singular_values: Vec<f64>,
    /// The combinations of relative changes of the parameters that the data do not determine, with one coefficient per
    /// parameter.
    pub undetermined: Vec<Vec<f64>>,
    /// Whether each fitted parameter is at one of its bounds and is held there.
    pub held: Vec<bool>,
}

/// Computes the uncertainty of the fitted parameters at a minimum of the loss, with the magnitudes `size` of the
/// parameters; returns `None` if the singular value decomposition fails.
pub fn intervals(problem: &LeastSquares<'_>, minimum: &Minimum, size: &[f64]) -> Option<Intervals> {
    let here = &minimum.residuals;
    let (m, p) = here.jacobian.shape();
    let held: Vec<bool> = (0..p).map(|k| problem.is_held(k, &minimum.point, here)).collect();
    let free: Vec<usize> = (0..p).filter(|&k| !held[k]).collect();
    let freedoms = m.saturating_sub(free.len()).max(1);
    let unit = match problem.loss {
        Loss::Squares => problem.unit(here, minimum.loss),
        Loss::Huber => {
            let psi: f64 = here.values.iter().map(|r| problem.loss.psi(*r).powi(2)).sum::<f64>() / freedoms as f64;
            let inside = here.values.iter().filter(|r| problem.loss.is_quadratic(**r)).count() as f64 / m as f64;
            let k = 1.0 + free.len() as f64 / m as f64 * (1.0 - inside) / inside;
            k * psi.sqrt() / inside
        }
    };
    let is_normal = problem.loss == Loss::Squares && problem.is_scaled;
    let width = if is_normal { NORMAL } else { student(freedoms) };
    let mut matrix = here.jacobian.select_columns(&free);
    matrix.column_iter_mut().zip(&free).for_each(|(mut column, &k)| column *= size[k] / unit);
    let mut covariance = vec![vec![None; p]; p];
    let mut sd = vec![None; p];
    let (mut singular_values, mut undetermined) = (Vec::new(), Vec::new());
    if !free.is_empty() {
        // Zero rows are appended to the Jacobian, so that there is a singular value for each parameter.
        let rows = m.max(free.len());
        let matrix = matrix.resize(rows, free.len(), 0.0);
        let Singular { values, v_t, .. } = Singular::of(&matrix)?;
        let least = problem.rank * values.first().copied().unwrap_or(0.0);
        singular_values.extend(values);
        let rank = singular_values.iter().filter(|sigma| **sigma > least).count();
        let open: Vec<bool> = (0..free.len()).map(|j| (rank..free.len()).any(|i| v_t[(i, j)].abs() > PART)).collect();
        for (a, &k) in free.iter().enumerate() {
            for (b, &l) in free.iter().enumerate().filter(|(b, _)| !open[a] && !open[*b]) {
                let sum: f64 = (0..rank).map(|i| v_t[(i, a)] * v_t[(i, b)] / singular_values[i].powi(2)).sum();
                covariance[k][l] = Some(size[k] * size[l] * sum).filter(|value| value.is_finite());
            }
            sd[k] = covariance[k][k].map(f64::sqrt);
        }
        undetermined = combinations(&v_t.rows(rank, free.len() - rank).into_owned(), &free, p);
    }
    Some(Intervals { sd, width, covariance, singular_values, undetermined, held })
}

/// Reduces the rows, combinations of parameters that the data do not determine, to a sparse basis of their span by
/// Gauss-Jordan elimination: each row has a leading parameter, which no other row contains. Coefficients are scaled to
/// a largest magnitude of one.
fn combinations(rows: &DMatrix<f64>, free: &[usize], p: usize) -> Vec<Vec<f64>> {
    let mut rows = rows.clone();
    for i in 0..rows.nrows() {
        let lead = (0..rows.ncols()).max_by(|a, b| rows[(i, *a)].abs().total_cmp(&rows[(i, *b)].abs())).unwrap_or(0);
        let size = rows[(i, lead)];
        if size.abs() <= PART {
            continue;
        }
        rows.row_mut(i).scale_mut(size.recip());
        let row = rows.row(i).into_owned();
        for other in (0..rows.nrows()).filter(|other| *other != i) {
            let part = rows[(other, lead)];
            let mut changed = rows.row_mut(other);
            changed -= &row * part;
        }
    }
    let of = |row: usize| {
        let mut parts = vec![0.0; p];
        let largest = rows.row(row).amax();
        for (j, &k) in free.iter().enumerate() {
            let part = rows[(row, j)] / largest;
            parts[k] = if part.abs() > PART { part } else { 0.0 };
        }
        parts
    };
    (0..rows.nrows()).map(of).collect()
}

/// Returns the two-sided 5 % quantile of Student's distribution, by bisection on its distribution function for
/// integer degrees of freedom (Abramowitz and Stegun 1972, 26.7.3 and 26.7.4).
fn student(freedoms: usize) -> f64 {
    if freedoms > MANY {
        return NORMAL;
    }
    let (mut low, mut high) = (0.0, std::f64::consts::FRAC_PI_2);
    // Bisection on the angle whose tangent is the quantile divided by the square root of the degrees of freedom.
    loop {
        let middle = 0.5 * (low + high);
        if middle <= low || middle >= high {
            return middle.tan() * (freedoms as f64).sqrt();
        }
        if within(middle, freedoms) < CONFIDENCE { low = middle } else { high = middle }
    }
}

/// Returns the probability that the magnitude of a variable of Student's distribution is below
/// `tan(angle) sqrt(freedoms)`.
fn within(angle: f64, freedoms: usize) -> f64 {
    let (sin, cos) = angle.sin_cos();
    let is_odd = freedoms % 2 == 1;
    let mut term = if is_odd { cos } else { 1.0 };
    let mut sum = if freedoms == 1 { 0.0 } else { term };
    let mut k = if is_odd { 3 } else { 2 };
    while k < freedoms {
        term *= cos * cos * (k - 1) as f64 / k as f64;
        sum += term;
        k += 2;
    }
    if is_odd { std::f64::consts::FRAC_2_PI * (angle + sin * sum) } else { sin * sum }
}

/// Whether the sum of squares `squares` exceeds the 0.999 quantile of the chi-squared distribution, by the cube-root
/// approximation (Wilson and Hilferty 1931).
pub fn is_too_large(squares: f64, freedoms: usize) -> bool {
    let part = 2.0 / (9.0 * freedoms as f64);
    freedoms > 0 && (cube_root(squares / freedoms as f64) - (1.0 - part)) / part.sqrt() > RARE
}

/// Runs of successive residuals with equal signs (Wald and Wolfowitz 1940).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Stretches {
    /// The number of runs of equal signs.
    pub count: usize,
    /// The expected number of runs of equal signs for independent residuals.
    pub expected: f64,
}

/// Counts the runs of equal signs of residuals in the order of time; returns `None` unless they are fewer than those
/// of independent residuals with a probability of 0.999, by the normal approximation (Wald and Wolfowitz 1940).
pub fn long_stretches(residuals: impl Iterator<Item = f64>) -> Option<Stretches> {
    let signs: Vec<bool> = residuals.filter(|residual| *residual != 0.0).map(|residual| residual > 0.0).collect();
    let count = 1 + signs.windows(2).filter(|pair| pair[0] != pair[1]).count();
    let positive = signs.iter().filter(|is_positive| **is_positive).count() as f64;
    let all = signs.len() as f64;
    let expected = 1.0 + 2.0 * positive * (all - positive) / all;
    let variance = (expected - 1.0) * (expected - 2.0) / (all - 1.0);
    let is_rare = signs.len() >= NORMAL_FROM && expected - count as f64 >= RARE * variance.max(0.0).sqrt();
    is_rare.then_some(Stretches { count, expected })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn residuals_of_one_sign_for_long_are_told_from_independent_ones() {
        // 20 positive and 20 negative signs form 21 runs on average, with a standard deviation of
        // `sqrt(20 * 19 / 39) = 3.12`, so that 11 runs are improbable.
        let with_runs = |runs: usize| {
            let lengths = move |k: usize| 20 / (runs / 2) + usize::from(k / 2 < 20 % (runs / 2));
            (0..runs).flat_map(move |k| vec![if k % 2 == 0 { 1.0 } else { -1.0 }; lengths(k)])
        };
        assert_eq!(long_stretches(with_runs(12)), None);
        assert_eq!(long_stretches(with_runs(10)), Some(Stretches { count: 10, expected: 21.0 }));
        assert_eq!(long_stretches([-1.0; 20].into_iter()), Some(Stretches { count: 1, expected: 1.0 }));
        assert_eq!(long_stretches([-1.0; 10].into_iter()), None);
        assert_eq!(long_stretches(std::iter::empty()), None);
    }

    #[test]
    fn student_has_the_values_of_tables() {
        for (freedoms, value) in [
            // Values of the inverse of the incomplete beta function, computed with 30 digits; the first is
            // `tan(0.475 pi)`.
            (1, 12.706_204_736_174_7),
            (2, 4.302_652_729_749_464),
            (5, 2.570_581_835_636_314),
            (10, 2.228_138_851_986_275),
            (30, 2.042_272_456_301_238),
            (120, 1.979_930_405_082_424),
        ] {
            assert!((student(freedoms) - value).abs() < 1e-11 * value, "{freedoms}: {}", student(freedoms));
        }
        assert!((student(MANY) - NORMAL).abs() < 2e-4 && student(MANY + 1) == NORMAL);
    }

    #[test]
    fn a_sum_of_squares_is_too_large_beyond_its_quantile() {
        // The 0.999 quantiles of the chi-squared distribution are 29.588 for 10 degrees of freedom and 149.449 for
        // 100. The approximation by Wilson and Hilferty has an error of at most a hundredth of the quantile for 10
        // degrees of freedom, and less for more.
        assert!(is_too_large(29.9, 10) && !is_too_large(29.3, 10));
        assert!(is_too_large(149.6, 100) && !is_too_large(149.2, 100));
    }
}
