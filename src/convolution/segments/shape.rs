//! The basis functions of `z` on an element `[0, 1]`, and the collocation points.
//!
//! The basis is `s` Legendre polynomials, with collocation at the nodes of Radau IIA. On the first element behind a
//! switch polynomials times `theta^beta` are added: a kernel like `t^(a-1)` makes the solution there a sum of the
//! powers `theta^j` and `theta^(j + beta)`, where `beta` is the distance of `a` to the next integer. The nodes are
//! squared, to be as dense at the beginning as the variation of the solution requires. One additional function and node
//! serve to estimate the error.

use crate::gauss_jacobi::gauss_jacobi;
use nalgebra::DMatrix;
use radau::Tableau;

/// Number of nodes of the quadrature rules for integrals of the basis functions, exact for all of them.
const NODES: usize = 12;
/// Largest numbers of polynomials and of singular functions on an element with singular functions. Polynomials with and
/// without the factor `theta^beta` are nearly dependent: with five and four the matrix of their values at the nodes has
/// a condition of up to `1e7`, with one more of each it is forty times as large. Fewer have a lower order behind
/// switches.
const SMOOTH: usize = 5;
const SINGULAR: usize = 4;

/// A space of functions on the element `[0, 1]` with its collocation nodes.
pub struct Shape {
    /// For each basis function, the degree of its polynomial in `theta`, the position in the element, and whether it
    /// has the factor `theta^beta`; the last function estimates the error.
    functions: Vec<(usize, bool)>,
    /// The exponent `beta` of the singular basis functions, which are polynomials times `theta^beta`.
    pub beta: f64,
    /// The collocation nodes, the last of them equal to 1, followed by the node that estimates the error.
    pub nodes: Vec<f64>,
    /// The values of the basis functions at the nodes, a row for each node.
    pub values: DMatrix<f64>,
    /// The values of the basis functions at the beginning, at the nodes and in the middles between nodes, where
    /// errors are largest: collocation is more accurate at its nodes.
    pub samples: DMatrix<f64>,
    /// The integrals of the basis functions from zero to the nodes.
    pub integrals: DMatrix<f64>,
    /// The maps from the values of a function at the nodes to its coefficients, without and with the additional
    /// function and node for the error estimate.
    inverses: [DMatrix<f64>; 2],
    /// The maps from the coefficients of a function to those of its integral, interpolated at the nodes.
    antiderivatives: [DMatrix<f64>; 2],
    plain: Vec<(f64, f64)>,
    weighted: Vec<(f64, f64)>,
}

impl Shape {
    /// Creates the shape of an element with `s` polynomials.
    pub fn smooth(s: usize) -> Self {
        Self::new((0..=s).map(|degree| (degree, false)).collect(), 0.0, Tableau::of(s).c.clone())
    }

    /// Creates the shape of an element behind a switch, if the other elements have `s` polynomials.
    ///
    /// Kernels that are integrated amplify rounding errors, the more the closer the first node is to the beginning:
    /// their shape has fewer functions.
    pub fn behind_switch(s: usize, beta: f64, integrations: usize) -> Self {
        if beta == 0.0 {
            return Self::smooth(s);
        }
        let fewer = integrations.min(1);
        let (smooth, singular) = (s.min(SMOOTH - fewer), s.min(SINGULAR - fewer));
        let mut functions: Vec<_> = (0..smooth).map(|degree| (degree, false)).collect();
        functions.extend((0..singular).map(|degree| (degree, true)));
        functions.push(if singular < smooth { (singular, true) } else { (smooth, false) });
        let nodes = Tableau::of(smooth + singular).c.iter().map(|c| c * c).collect();
        Self::new(functions, beta, nodes)
    }

    fn new(functions: Vec<(usize, bool)>, beta: f64, mut nodes: Vec<f64>) -> Self {
        let gap = |i: usize| nodes[i] - if i == 0 { 0.0 } else { nodes[i - 1] };
        let widest = (0..nodes.len()).max_by(|&i, &j| gap(i).total_cmp(&gap(j))).unwrap_or(0);
        nodes.push(nodes[widest] - 0.5 * gap(widest));
        let count = nodes.len();
        let mut shape = Self {
            functions,
            beta,
            nodes,
            values: DMatrix::zeros(count, count),
            samples: DMatrix::zeros(2 * count, count),
            integrals: DMatrix::zeros(count, count),
            inverses: [DMatrix::zeros(0, 0), DMatrix::zeros(0, 0)],
            antiderivatives: [DMatrix::zeros(0, 0), DMatrix::zeros(0, 0)],
            plain: gauss_jacobi(NODES, 0.0),
            weighted: gauss_jacobi(NODES, beta),
        };
        let mut row = vec![0.0; count];
        for i in 0..count {
            shape.evaluate(shape.nodes[i], &mut row);
            row.iter().enumerate().for_each(|(j, value)| shape.values[(i, j)] = *value);
            shape.integrate(shape.nodes[i], &mut row);
            row.iter().enumerate().for_each(|(j, value)| shape.integrals[(i, j)] = *value);
        }
        let mut sorted = shape.nodes.clone();
        sorted.sort_by(f64::total_cmp);
        sorted.insert(0, 0.0);
        let middles = sorted.windows(2).map(|pair| 0.5 * (pair[0] + pair[1]));
        let points: Vec<f64> = middles.chain(sorted[..count].iter().copied()).collect();
        for (i, theta) in points.into_iter().enumerate() {
            shape.evaluate(theta, &mut row);
            row.iter().enumerate().for_each(|(j, value)| shape.samples[(i, j)] = *value);
        }
        shape.inverses = [count - 1, count].map(|size| {
            let square = shape.values.view((0, 0), (size, size)).into_owned();
            // The functions are a Chebyshev system: one combination interpolates any values.
            let inverse = square.clone().try_inverse().unwrap_or_else(|| DMatrix::identity(size, size));
            // A Newton step removes the rounding error of the inverse of the matrix of values at the nodes.
            &inverse * 2.0 - &inverse * (square * &inverse)
        });
        shape.antiderivatives = [count - 1, count].map(|size| {
            let (inverse, integrals) = (shape.inverse(size), shape.integrals.view((0, 0), (size, size)));
            let first = inverse * integrals;
            let left = integrals - shape.values.view((0, 0), (size, size)) * &first;
            first + inverse * left
        });
        shape
    }

    /// Returns the number of basis functions, which is that of nodes, without the additional ones that estimate the
    /// error.
    pub fn len(&self) -> usize {
        self.nodes.len() - 1
    }

    /// Whether some basis functions are singular at the beginning of the element.
    pub fn is_singular(&self) -> bool {
        self.functions[..self.len()].iter().any(|function| function.1)
    }

    /// Returns the map from values of a function at the first `size` nodes to coefficients; `size` is [`Self::len`] or
    /// one more.
    pub fn inverse(&self, size: usize) -> &DMatrix<f64> {
        &self.inverses[size - self.len()]
    }

    /// Returns the amplification of rounding errors from values at the first `size` nodes to coefficients and back.
    pub fn transform_condition(&self, size: usize) -> f64 {
        let product = self.values.view((0, 0), (size, size)).abs() * self.inverse(size).abs();
        product.row_iter().map(|row| row.sum()).fold(0.0, f64::max)
    }

    /// Returns the map from the coefficients of a function to those of its integral from zero, interpolated at the
    /// first `size` nodes.
    pub fn antiderivative(&self, size: usize) -> &DMatrix<f64> {
        &self.antiderivatives[size - self.len()]
    }

    /// Writes the values of the first basis functions at `theta`, as many as `out` has entries.
    pub fn evaluate(&self, theta: f64, out: &mut [f64]) {
        let power = if self.is_singular() { theta.powf(self.beta) } else { 1.0 };
        for (value, &(degree, is_singular)) in out.iter_mut().zip(&self.functions) {
            *value = legendre(degree, theta) * if is_singular { power } else { 1.0 };
        }
    }

    /// Writes the polynomial factors, at the position `theta`, of the singular or of the regular basis functions, and
    /// zero for the others.
    pub fn polynomials(&self, singular: bool, theta: f64, out: &mut [f64]) {
        for (value, &(degree, is_singular)) in out.iter_mut().zip(&self.functions) {
            *value = if is_singular == singular { legendre(degree, theta) } else { 0.0 };
        }
    }

    /// Bounds the magnitude of a combination of basis functions at complex points, where Legendre polynomials grow
    /// with their degree no faster than powers of `growth`, and no point is farther from zero than `reach`.
    pub fn bound(&self, coefficients: impl Iterator<Item = f64>, growth: f64, reach: f64) -> f64 {
        let power = reach.powf(self.beta);
        let functions = coefficients.zip(&self.functions);
        functions.map(|(c, f)| c.abs() * growth.powi(f.0 as i32) * if f.1 { power } else { 1.0 }).sum()
    }

    /// Bounds the change of a combination of basis functions from zero to any point up to `theta`.
    pub fn change(&self, coefficients: impl Iterator<Item = f64>, theta: f64) -> f64 {
        let power = theta.powf(self.beta);
        // Legendre polynomials on `[0, 1]` are at most 1, and their slopes at most `k (k + 1)`.
        let of = |(degree, is_singular): (usize, bool)| {
            if is_singular { power } else { (theta * (degree * (degree + 1)) as f64).min(2.0) }
        };
        coefficients.zip(&self.functions).map(|(c, f)| c.abs() * of(*f)).sum()
    }

    /// Writes the integrals of the basis functions from zero to `theta`.
    pub fn integrate(&self, theta: f64, out: &mut [f64]) {
        for (value, &(degree, is_singular)) in out.iter_mut().zip(&self.functions) {
            let (rule, factor) = match is_singular {
                true => (&self.weighted, theta.powf(1.0 + self.beta)),
                false => (&self.plain, theta),
            };
            *value = factor * rule.iter().map(|(x, w)| w * legendre(degree, theta * x)).sum::<f64>();
        }
    }
}

/// Evaluates the Legendre polynomial on `[0, 1]`, normalised to one at the end of the interval.
fn legendre(degree: usize, theta: f64) -> f64 {
    let u = 2.0 * theta - 1.0;
    let (mut before, mut value) = (0.0, 1.0);
    for k in 0..degree {
        let k = k as f64;
        (before, value) = (value, ((2.0 * k + 1.0) * u * value - k * before) / (k + 1.0));
    }
    value
}
