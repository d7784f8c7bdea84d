//! Element matrices of multilinear finite elements with shape functions `N_a`, as tensor products over directions of
//! the one-dimensional matrices
//!
//! ```text
//! m = int N_a N_b = h/6 [2 1; 1 2],    k = int N_a' N_b' = 1/h [1 -1; -1 1],    d = int N_a N_b' = 1/2 [-1 1; -1 1]
//! ```
//!
//! With the trapezoidal rule instead of the exact integral, `m` is `h/2` times the identity: the mass is lumped, and
//! the stiffness of a diagonal tensor couples neighbours along the axes alone, with the signs of an M-matrix for
//! elements of any aspect ratio (Thomee 2006, *Galerkin Finite Element Methods for Parabolic Problems*, chapter 15).

use super::Grid;
use nalgebra::{DMatrix, Matrix2};

/// The quadrature of products of two shape functions in directions in which neither factor is differentiated.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Quadrature {
    /// Exact integration of products of two shape functions.
    Exact,
    /// The trapezoidal rule, whose points are the nodes of the element.
    Nodal,
}

/// A box-shaped finite element, given by the lengths of its sides.
#[derive(Clone, Debug)]
pub struct Element {
    sides: Vec<f64>,
    quadrature: Quadrature,
}

impl Element {
    /// Returns the element of a grid; all elements of a grid are equal.
    pub fn of(grid: &Grid, quadrature: Quadrature) -> Self {
        Self { sides: grid.axes().iter().map(|axis| axis.spacing()).collect(), quadrature }
    }

    /// Returns the length, area or volume of the element, according to its dimension.
    pub fn volume(&self) -> f64 {
        self.sides.iter().product()
    }

    /// Returns the mass matrix `int N_a N_b` of the element, with the shape functions `N_a`.
    pub fn mass(&self) -> DMatrix<f64> {
        self.product(|_, h| self.one_dimensional_mass(h))
    }

    /// Returns the element matrix `int d_p N_a d_q N_b` of the derivatives of shape functions `N_a` in directions `p`
    /// and `q`.
    pub fn gradients(&self, p: usize, q: usize) -> DMatrix<f64> {
        let derivative = Matrix2::new(-0.5, 0.5, -0.5, 0.5);
        self.product(|direction, h| match (direction == p, direction == q) {
            (true, true) => Matrix2::new(1.0, -1.0, -1.0, 1.0) / h,
            (true, false) => derivative.transpose(),
            (false, true) => derivative,
            (false, false) => self.one_dimensional_mass(h),
        })
    }

    /// Returns the element matrix `int N_a d_q N_b` of shape functions `N_a`, with the derivative in direction `q`.
    pub fn derivative(&self, q: usize) -> DMatrix<f64> {
        self.product(|direction, h| match direction == q {
            true => Matrix2::new(-0.5, 0.5, -0.5, 0.5),
            false => self.one_dimensional_mass(h),
        })
    }

    fn one_dimensional_mass(&self, h: f64) -> Matrix2<f64> {
        match self.quadrature {
            Quadrature::Exact => Matrix2::new(2.0, 1.0, 1.0, 2.0) * (h / 6.0),
            Quadrature::Nodal => Matrix2::identity() * (h / 2.0),
        }
    }

    fn product(&self, factor: impl Fn(usize, f64) -> Matrix2<f64>) -> DMatrix<f64> {
        let factors: Vec<Matrix2<f64>> = self.sides.iter().enumerate().map(|(k, &h)| factor(k, h)).collect();
        let corners = 1 << factors.len();
        let end = |corner: usize, direction: usize| corner >> direction & 1;
        DMatrix::from_fn(corners, corners, |a, b| {
            factors.iter().enumerate().map(|(k, factor)| factor[(end(a, k), end(b, k))]).product()
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::finite_elements::Axis;

    fn element(quadrature: Quadrature) -> (Grid, Element) {
        let axes = [(0.0, 0.5), (1.0, 1.25), (-2.0, 0.0)];
        let grid = Grid::new(axes.map(|(lower, upper)| Axis { lower, upper, elements: 1 }).to_vec());
        let element = Element::of(&grid, quadrature);
        (grid, element)
    }

    /// Returns the nodal values of a function on a grid of a single element.
    fn nodal(grid: &Grid, u: impl Fn([f64; 3]) -> f64) -> nalgebra::DVector<f64> {
        nalgebra::DVector::from_iterator(8, (0..8).map(|node| u(grid.coordinates(node))))
    }

    #[test]
    fn exact_integrals_are_those_of_calculus() {
        let (grid, element) = element(Quadrature::Exact);
        let (u, v) = (nodal(&grid, |[x, y, _]| x * y), nodal(&grid, |[_, y, z]| y * z));
        let close = |value: f64, expected: f64| assert!((value - expected).abs() < 1e-13, "{value} {expected}");
        // Integrals of the coordinate and of its square over the intervals [0, 1/2] in `x`, [1, 5/4] in `y` and [-2, 0]
        // in `z`, whose product is the element.
        let (x, x2) = (1.0 / 8.0, 1.0 / 24.0);
        let (y, y2) = ((1.5625 - 1.0) / 2.0, (1.953125 - 1.0) / 3.0);
        let (z, z2) = (-2.0, 8.0 / 3.0);
        close((u.transpose() * element.mass() * &v)[0], x * y2 * z);
        close((u.transpose() * element.gradients(0, 0) * &u)[0], 0.5 * y2 * 2.0);
        close((u.transpose() * element.gradients(1, 2) * &v)[0], x * y * 2.0);
        close((u.transpose() * element.gradients(0, 1) * &v)[0], 0.5 * y * z);
        close((v.transpose() * element.derivative(1) * &u)[0], x * y * z);
        close((v.transpose() * element.gradients(1, 1) * &v)[0], 0.5 * 0.25 * z2);
        close((u.transpose() * element.gradients(1, 1) * &u)[0], x2 * 0.25 * 2.0);
    }

    #[test]
    fn the_trapezoidal_rule_leaves_an_m_matrix_on_a_long_element() {
        let (_, element) = element(Quadrature::Nodal);
        let mass = element.mass();
        assert!((mass.trace() - element.volume()).abs() < 1e-15 && mass == DMatrix::from_diagonal(&mass.diagonal()));
        let stiffness: DMatrix<f64> = (0..3).map(|k| element.gradients(k, k)).sum();
        for (a, row) in stiffness.row_iter().enumerate() {
            assert!(row.sum().abs() < 1e-13);
            for (b, &value) in row.iter().enumerate() {
                let steps = (a ^ b).count_ones();
                assert!(if steps == 1 { value < 0.0 } else { (steps == 0) == (value != 0.0) }, "{a} {b} {value}");
            }
        }
    }
}
