//! Nonlinear least squares within bounds by the Levenberg-Marquardt method: a step `d` from the parameters `p` solves,
//! with the residuals `r(p)`, their weights `W`, the Jacobian `J` and the scaling `D` of its columns to length one
//! (Moré 1978, *The Levenberg-Marquardt algorithm*, section 6),
//!
//! ```text
//! (D^-1 J' W J D^-1 + lambda I) D d = -D^-1 J' W r,    p+ = P(p + d)
//! ```
//!
//! over the free parameters, which are those not held at a bound by the gradient; `P` projects onto the bounds (Kanzow,
//! Yamashita and Fukushima 2004, *Levenberg-Marquardt methods for constrained nonlinear equations with strong local
//! convergence properties*). The damping `lambda` follows the ratio of the actual to the predicted decrease of the loss
//! (Nielsen 1999, *Damping parameter in Marquardt's method*). Huber's loss enters through the weights `psi(r)/r` (Huber
//! and Ronchetti 2009, section 7.8).

use factorisation::Singular;
use nalgebra::{DMatrix, DVector};
use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

/// The largest number of evaluations of the residuals in the search from one starting point.
const MOST_RUNS: u64 = 100;
/// The initial damping of the Levenberg-Marquardt method, relative to the diagonal of the scaled normal matrix, which
/// is one.
const DAMPING: f64 = 1e-3;
/// The least factor of the damping of the Levenberg-Marquardt method after a step with the predicted gain: small, since
/// undamped steps converge fast.
const LESS: f64 = 0.1;
/// The damping of the Levenberg-Marquardt method above which steps are shorter than rounding errors.
const MOST_DAMPING: f64 = 1e20;
/// The distance to the minimum of the loss, in standard errors of the parameters, at which the search ends.
const CLOSE: f64 = 1e-8;
/// The distance to the minimum of the loss, in standard errors of the parameters, up to which estimates are accepted.
const ALLOWED: f64 = 1e-2;
/// The search continues until the distance to the minimum of the loss is this fraction of the uncertainty due to errors
/// of the residuals. These errors are nearly equal at nearby points, so that they do not disturb the search earlier.
const BELOW_NOISE: f64 = 1e-2;
/// The relative rounding error of a loss, a sum of many terms.
const ROUNDING: f64 = 1e-14;
/// The residual, in standard deviations, above which Huber's loss is linear; its efficiency is 95 % for normal errors
/// (Huber and Ronchetti 2009, section 4.5).
const HUBER: f64 = 1.345;

/// The loss to be minimised: the sum of `rho(r)` over all residuals `r`.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Deserialize, Serialize, ToSchema)]
#[serde(rename_all = "snake_case")]
pub enum Loss {
    /// Squares: `rho(r) = r^2`.
    #[default]
    Squares,
    /// Huber's loss: `rho(r) = r^2` up to `1.345 sd`, and its tangent beyond, so that outliers have little weight.
    Huber,
}

impl Loss {
    fn rho(self, r: f64) -> f64 {
        match self {
            Self::Huber if r.abs() > HUBER => HUBER * (2.0 * r.abs() - HUBER),
            _ => r * r,
        }
    }

    /// Returns `psi(r)`, half the derivative of the loss `rho` of one residual.
    pub fn psi(self, r: f64) -> f64 {
        match self {
            Self::Huber => r.clamp(-HUBER, HUBER),
            Self::Squares => r,
        }
    }

    /// Whether the loss `rho` of one residual is quadratic at the residual `r`.
    pub fn is_quadratic(self, r: f64) -> bool {
        self == Self::Squares || r.abs() <= HUBER
    }

    /// Returns the loss: the sum of `rho(r)` over all residuals `r`.
    pub fn of(self, residuals: &DVector<f64>) -> f64 {
        residuals.iter().map(|r| self.rho(*r)).sum()
    }
}

/// Residuals of a least-squares problem and their derivatives at a point.
#[derive(Clone, Debug)]
pub struct Residuals {
    /// The residuals `r`, in standard deviations of the data.
    pub values: DVector<f64>,
    /// The Jacobian `J` of the residuals, with a column for each parameter.
    pub jacobian: DMatrix<f64>,
    /// The Euclidean norm of the errors of the residuals, in standard deviations of the data.
    pub noise: f64,
}

/// The result of a search for a minimum of the loss.
#[derive(Clone, Debug)]
pub struct Minimum {
    /// The values of the parameters at the end of the search.
    pub point: Vec<f64>,
    /// The residuals at the parameters `point`.
    pub residuals: Residuals,
    /// The loss at the parameters `point`.
    pub loss: f64,
    /// The distance to the minimum of the loss that the linearised problem predicts, in standard errors of the
    /// parameters.
    pub distance: f64,
    /// The largest distance to the minimum of the loss, in standard errors, that is accepted, given the accuracy of the
    /// residuals.
    pub allowed: f64,
    /// The number of evaluations of the residuals in the search.
    pub runs: u64,
}

/// A least-squares problem with bounds on the parameters.
#[derive(Clone, Copy, Debug)]
pub struct LeastSquares<'a> {
    /// The lower bounds of the parameters, possibly infinite.
    pub lower: &'a [f64],
    /// The upper bounds of the parameters, possibly infinite.
    pub upper: &'a [f64],
    /// The loss (such as the sum of squares) that is minimised over the residuals.
    pub loss: Loss,
    /// Whether residuals are in units of known standard deviations; otherwise the standard deviation is estimated from
    /// the residuals.
    pub is_scaled: bool,
    /// Singular values of the scaled Jacobian below this fraction of the largest count as zero.
    pub rank: f64,
}

/// The least-squares problem linearised at a point, over the free parameters (those not held at a bound).
struct Linear {
    free: Vec<usize>,
    /// The lengths of the weighted columns of the Jacobian `J`: the diagonal of the scaling matrix `D`.
    scale: Vec<f64>,
    svd: Singular,
    /// The vector `U' W^(1/2) r`, where `U` are the left singular vectors of the scaled Jacobian, `W` the weights and
    /// `r` the residuals.
    right: DVector<f64>,
}

impl LeastSquares<'_> {
    /// Searches for a minimum from `start`, a point within the bounds with the residuals `first`. `evaluate` returns
    /// the residuals at a point, or `None` if they cannot be computed there; the search ends when `goes_on`, which is
    /// called before each evaluation, returns false.
    pub fn minimise(
        &self,
        start: Vec<f64>,
        first: Residuals,
        mut evaluate: impl FnMut(&[f64], u64) -> Option<Residuals>,
        goes_on: impl Fn() -> bool,
    ) -> Minimum {
        let (mut point, mut here) = (start, first);
        let mut loss = self.loss.of(&here.values);
        let (mut damping, mut growth, mut runs) = (DAMPING, 2.0, 1);
        let mut linear = self.linearised(&point, &here);
        loop {
            let distance = self.distance(&linear, &here, loss);
            let noise = here.noise / self.unit(&here, loss);
            let allowed = ALLOWED.max(noise);
            let ended =
                distance <= CLOSE.max(BELOW_NOISE * noise) || runs >= MOST_RUNS || damping > MOST_DAMPING || !goes_on();
            let Some(linear_here) = linear.as_ref().filter(|_| !ended) else {
                return Minimum { point, residuals: here, loss, distance, allowed, runs };
            };
            let next = self.step(linear_here, &point, damping);
            let moved: Vec<f64> = next.iter().zip(&point).map(|(next, point)| next - point).collect();
            if next == point {
                return Minimum { point, residuals: here, loss, distance, allowed, runs };
            }
            runs += 1;
            let there = evaluate(&next, runs);
            let gain = there.as_ref().map_or(f64::NAN, |there| loss - self.loss.of(&there.values));
            // The decrease of the loss that the linearised problem predicts for the projected step.
            let change = &here.jacobian * DVector::from_column_slice(&moved);
            let terms = here.values.iter().zip(change.iter());
            let predicted: f64 = terms.map(|(r, d)| -(2.0 * self.loss.psi(*r) * d + self.weight(*r) * d * d)).sum();
            let ratio = gain / predicted.max(f64::MIN_POSITIVE);
            match there {
                Some(there) if gain > 0.0 && predicted > 0.0 => {
                    loss -= gain;
                    (point, here) = (next, there);
                    linear = self.linearised(&point, &here);
                    damping *= (1.0 - (2.0 * ratio - 1.0).powi(3)).max(LESS);
                    growth = 2.0;
                }
                // The predicted decrease of the loss is below its errors, which are due to the errors of the
                // residuals.
                Some(_) if predicted <= (here.noise * here.noise).max(ROUNDING * loss) && distance <= allowed => {
                    return Minimum { point, residuals: here, loss, distance, allowed, runs };
                }
                _ => {
                    damping *= growth;
                    growth *= 2.0;
                }
            }
        }
    }

    fn weight(&self, r: f64) -> f64 {
        if r == 0.0 { 1.0 } else { self.loss.psi(r) / r }
    }

    /// Whether a fitted parameter is at a bound, and the loss would decrease beyond the bound.
    pub fn is_held(&self, k: usize, point: &[f64], here: &Residuals) -> bool {
        let column = here.jacobian.column(k);
        let slope: f64 = column.iter().zip(here.values.iter()).map(|(j, r)| j * self.loss.psi(*r)).sum();
        (point[k] <= self.lower[k] && slope >= 0.0) || (point[k] >= self.upper[k] && slope <= 0.0)
    }

    fn linearised(&self, point: &[f64], here: &Residuals) -> Option<Linear> {
        let free: Vec<usize> = (0..point.len()).filter(|&k| !self.is_held(k, point, here)).collect();
        let roots: Vec<f64> = here.values.iter().map(|r| self.weight(*r).sqrt()).collect();
        let mut matrix = here.jacobian.select_columns(&free);
        matrix.row_iter_mut().zip(&roots).for_each(|(mut row, root)| row *= *root);
        let scale: Vec<f64> = matrix.column_iter().map(|column| column.norm()).collect();
        let scale: Vec<f64> = scale.into_iter().map(|norm| if norm > 0.0 { norm } else { 1.0 }).collect();
        matrix.column_iter_mut().zip(&scale).for_each(|(mut column, scale)| column /= *scale);
        let weighted = DVector::from_iterator(roots.len(), here.values.iter().zip(&roots).map(|(r, root)| r * root));
        if free.is_empty() {
            return None;
        }
        let svd = Singular::of(&matrix)?;
        let right = svd.u.tr_mul(&weighted);
        Some(Linear { free, scale, svd, right })
    }

    /// Returns the parameters after a damped step of the linearised problem, projected onto the bounds.
    fn step(&self, linear: &Linear, point: &[f64], damping: f64) -> Vec<f64> {
        let Linear { free, scale, svd, right } = linear;
        let pairs = svd.values.iter().zip(right.iter());
        let damped = pairs.map(|(sigma, right)| -sigma * right / (sigma * sigma + damping));
        let direction = svd.v_t.tr_mul(&DVector::from_iterator(svd.values.len(), damped));
        let mut next = point.to_vec();
        for ((&k, scale), d) in free.iter().zip(scale).zip(direction.iter()) {
            next[k] = (point[k] + d / scale).clamp(self.lower[k], self.upper[k]);
        }
        next
    }

    /// Returns the length of the undamped step of the linearised problem in standard errors, in the directions that the
    /// data determine.
    fn distance(&self, linear: &Option<Linear>, here: &Residuals, loss: f64) -> f64 {
        let Some(Linear { svd, right, .. }) = linear else { return 0.0 };
        let least = self.rank * svd.values.first().copied().unwrap_or(0.0);
        let parts = svd.values.iter().zip(right.iter()).filter(|(sigma, _)| **sigma > least);
        parts.map(|(_, right)| right * right).sum::<f64>().sqrt() / self.unit(here, loss)
    }

    /// Returns the standard deviation of a residual: 1 if known, otherwise estimated from the loss.
    pub fn unit(&self, here: &Residuals, loss: f64) -> f64 {
        let freedoms = here.values.len().saturating_sub(here.jacobian.ncols()).max(1);
        if self.is_scaled { 1.0 } else { (loss / freedoms as f64).sqrt().max(f64::MIN_POSITIVE) }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn search(
        start: &[f64],
        bounds: [f64; 2],
        loss: Loss,
        evaluate: impl Fn(&[f64]) -> (Vec<f64>, Vec<f64>),
    ) -> Minimum {
        let p = start.len();
        let (lower, upper) = (vec![bounds[0]; p], vec![bounds[1]; p]);
        let problem = LeastSquares { lower: &lower, upper: &upper, loss, is_scaled: true, rank: 1e-12 };
        let at = |point: &[f64]| {
            let (values, jacobian) = evaluate(point);
            let jacobian = DMatrix::from_row_slice(values.len(), p, &jacobian);
            Residuals { values: DVector::from_vec(values), jacobian, noise: 1e-12 }
        };
        problem.minimise(start.to_vec(), at(start), |point, _| Some(at(point)), || true)
    }

    fn rosenbrock(p: &[f64]) -> (Vec<f64>, Vec<f64>) {
        (vec![10.0 * (p[1] - p[0] * p[0]), 1.0 - p[0]], vec![-20.0 * p[0], 10.0, -1.0, 0.0])
    }

    #[test]
    fn rosenbrocks_valley_is_followed_to_its_end() {
        let found = search(&[-1.2, 1.0], [-1e9, 1e9], Loss::Squares, rosenbrock);
        assert!((found.point[0] - 1.0).abs() < 1e-4 && (found.point[1] - 1.0).abs() < 2e-4, "{found:?}");
        assert!(found.runs < 40, "{}", found.runs);
    }

    #[test]
    fn a_bound_holds_where_the_minimum_is_beyond_it() {
        // The minimum of Rosenbrock's function for `p_1 <= 1/2` is at `(1/2, 1/4)`.
        let at = |p: &[f64]| rosenbrock(p);
        let found = search(&[-1.2, 0.4], [-2.0, 0.5], Loss::Squares, at);
        assert!((found.point[0] - 0.5).abs() < 1e-12 && (found.point[1] - 0.25).abs() < 1e-5, "{found:?}");
    }

    #[test]
    fn one_value_that_is_far_off_moves_hubers_mean_by_its_bound_alone() {
        // Huber's estimate `m` of the mean of nine zeros and one outlier satisfies `9 m = 1.345`.
        let at = |p: &[f64]| {
            let values = (0..10).map(|k| p[0] - if k == 0 { 1e3 } else { 0.0 }).collect();
            (values, vec![1.0; 10])
        };
        let found = search(&[0.3], [-1e9, 1e9], Loss::Huber, at);
        assert!((found.point[0] - HUBER / 9.0).abs() < 1e-4, "{found:?}");
    }
}
