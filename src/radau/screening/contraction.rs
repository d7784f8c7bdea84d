//! Errors of variables whose equations are not linear.
//!
//! If `r` bounds the residual of `g(z) = 0` along a polynomial, and the derivative of `g` lies in `A +- R` over a box, the
//! distance `e` from the root satisfies
//!
//! ```text
//! e <= |A^-1| r + |A^-1| R e,    that is    e <= (I - |A^-1| R)^-1 |A^-1| r
//! ```
//!
//! if the spectral radius of `|A^-1| R` is below one (Neumaier 1990, *Interval Methods for Systems of Equations*, section
//! 4.1). Otherwise the box proves nothing, and has to be smaller.

use nalgebra::{DMatrix, DVector};
use numerics::Interval;

/// A matrix of intervals, stored by midpoints and radii.
#[derive(Clone, Debug)]
pub(crate) struct Enclosed {
    pub middle: DMatrix<f64>,
    pub radius: DMatrix<f64>,
}

impl Enclosed {
    pub fn zeros(rows: usize, columns: usize) -> Self {
        Self { middle: DMatrix::zeros(rows, columns), radius: DMatrix::zeros(rows, columns) }
    }

    /// Adds an interval to an entry of the matrix; an interval that is not defined everywhere has an infinite radius.
    pub fn add(&mut self, at: (usize, usize), value: Interval) {
        let (middle, radius) = value.ball();
        let is_known = value.defined && middle.is_finite();
        self.middle[at] += if is_known { middle } else { 0.0 };
        self.radius[at] += if is_known { radius } else { f64::INFINITY };
    }

    /// Returns the product of this matrix of intervals with another matrix of intervals on the right.
    pub fn times(&self, other: &Self) -> Self {
        let (a, b) = (self.middle.abs(), other.middle.abs());
        Self { middle: &self.middle * &other.middle, radius: a * &other.radius + &self.radius * (b + &other.radius) }
    }

    /// Returns the product of this matrix of intervals with a known matrix on the left.
    pub fn combined(&self, left: &DMatrix<f64>) -> Self {
        Self { middle: left * &self.middle, radius: left.abs() * &self.radius }
    }

    /// Bounds the distances from the root of equations whose derivative lies in this matrix, for residuals of the
    /// magnitudes `residuals`.
    pub fn errors(&self, residuals: &DVector<f64>) -> Errors {
        let count = residuals.len();
        if count == 0 {
            return Errors::Bounded(DVector::zeros(0));
        }
        if self.radius.iter().any(|radius| !radius.is_finite()) {
            return Errors::Unbounded;
        }
        let Some(inverse) = self.middle.clone().try_inverse() else { return Errors::Unbounded };
        let inverse = inverse.abs();
        let first = &inverse * residuals;
        let matrix = DMatrix::identity(count, count) - &inverse * &self.radius;
        // For a nonnegative `P`, `(I - P) x = 1` has a positive solution if and only if the spectral radius is below one.
        let factors = matrix.lu();
        let ones = DVector::from_element(count, 1.0);
        match (factors.solve(&ones), factors.solve(&first)) {
            (Some(scale), Some(errors)) if scale.iter().all(|x| *x >= 1.0) => {
                Errors::Bounded(errors.map(|error| if error.is_finite() { error.max(0.0) } else { f64::INFINITY }))
            }
            _ => Errors::Wide,
        }
    }
}

/// Bounds on the distances of variables from the roots of their equations, if there are any, over a box.
#[derive(Clone, Debug, PartialEq)]
pub(crate) enum Errors {
    /// A bound on the distance of each variable from its root.
    Bounded(DVector<f64>),
    /// No bounds over this box, since the derivatives vary too much; a smaller box may have bounds.
    Wide,
    /// No bounds: the equations are singular, or derivatives are not bounded.
    Unbounded,
}

impl Errors {
    /// Writes the bounds on the distances of `variables` from the roots of their equations to `out`, infinite without
    /// bounds; returns whether the box is too wide for bounds.
    pub fn write(self, variables: &[usize], out: &mut [f64]) -> bool {
        match &self {
            Self::Bounded(errors) => variables.iter().zip(errors).for_each(|(&k, error)| out[k] = *error),
            Self::Wide | Self::Unbounded => variables.iter().for_each(|&k| out[k] = f64::INFINITY),
        }
        self == Self::Wide
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn roots_lie_within_their_bounds_and_singular_boxes_bound_nothing() {
        // The equations 2 z + w = 0.1 and z + 3 w = 0.2 with coefficients that may be off by a tenth: the largest
        // roots over the corners of the box.
        let mut matrix = Enclosed::zeros(2, 2);
        for (at, value) in [((0, 0), 2.0), ((0, 1), 1.0), ((1, 0), 1.0), ((1, 1), 3.0)] {
            matrix.add(at, Interval::new(value - 0.1, value + 0.1));
        }
        let Errors::Bounded(bound) = matrix.errors(&DVector::from_vec(vec![0.1, 0.2])) else { panic!("no bound") };
        let mut largest: [f64; 2] = [0.0; 2];
        for corner in 0..64_u32 {
            let of = |bit: u32, value: f64, by: f64| value + if corner >> bit & 1 == 1 { by } else { -by };
            let (a, b, c, d) = (of(0, 2.0, 0.1), of(1, 1.0, 0.1), of(2, 1.0, 0.1), of(3, 3.0, 0.1));
            let (r, s) = (of(4, 0.0, 0.1), of(5, 0.0, 0.2));
            let determinant = a * d - b * c;
            largest[0] = largest[0].max(((d * r - b * s) / determinant).abs());
            largest[1] = largest[1].max(((a * s - c * r) / determinant).abs());
        }
        for (bound, largest) in bound.iter().zip(largest) {
            assert!(*bound >= largest && *bound <= 1.5 * largest, "{bound} {largest}");
        }
        matrix.add((0, 0), Interval::new(-2.0, 2.0));
        assert_eq!(matrix.errors(&DVector::from_vec(vec![0.1, 0.2])), Errors::Wide);
    }
}
