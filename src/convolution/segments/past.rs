//! The past as a source: contributions of earlier elements to the convolution at a later time.
//!
//! Elements farther away than twice their length act through point charges (values times quadrature weights) at the
//! nodes of Gauss rules, closer ones through integrals of the kernel against their functions.

use super::lag::Lag;
use super::shape::Shape;
use crate::gauss_jacobi::gauss_jacobi;
use crate::stepper::StepError;
use nalgebra::DMatrix;

/// Distance of a later time from an element, in lengths of the element, from which on the element acts through point
/// charges. The kernel is analytic within an ellipse about the element that extends to the later time, with the sum
/// `5 + 24^(1/2)` of its semi-axes for two lengths, and a rule converges by the square of that, a factor of
/// ninety-eight, with each node. Nearer elements would need more nodes; a larger distance, more integrals of the
/// kernel.
const FAR: f64 = 2.0;
/// Number of nodes of a quadrature rule beyond the number `n` of functions of an element: they leave polynomials of
/// degree `n + 12` to the kernel, which differs from its best polynomial by about `9.9^-(n + 12)`, below rounding
/// from four functions on.
const NODES: usize = 6;

/// An element: an interval of time on which the variables are one combination of basis functions.
pub struct Element {
    /// Time at the beginning of the element.
    pub start: f64,
    /// Time at the end of the element.
    pub end: f64,
    /// The index of the shape (the space of functions) of the element.
    pub shape: usize,
    /// The coefficients of the variables and of their repeated integrals, as many as the kernel takes: a row for each
    /// basis function, a column for each variable.
    pub coefficients: Vec<DMatrix<f64>>,
    /// The integral of the variables up to the beginning of the element.
    pub integral: Vec<f64>,
    /// The index of the first point charge (value times quadrature weight) of the element.
    charge: usize,
}

impl Element {
    /// Returns the length of the element.
    pub fn length(&self) -> f64 {
        self.end - self.start
    }
}

/// The quadrature rule of a shape (space of functions on an element): nodes with weights, and the values of the basis
/// functions at the nodes.
struct Rule {
    nodes: Vec<(f64, f64)>,
    values: Vec<Vec<f64>>,
}

/// All elements of a run so far, with their point charges (values times quadrature weights).
pub struct Past {
    variables: usize,
    /// The elements of the run, in order of time.
    pub elements: Vec<Element>,
    rules: Vec<Rule>,
    times: Vec<f64>,
    /// The point charges (values times quadrature weights) of the variables and of their integrals.
    charges: Vec<Vec<f64>>,
    /// Bounds on the absolute values of the variables and of their integrals.
    pub largest: Vec<Vec<f64>>,
}

impl Past {
    /// Allocates the past of a run with elements of the shapes `shapes`, with variables that are integrated at most
    /// `integrations` times.
    pub fn new(variables: usize, shapes: &[Shape], integrations: usize) -> Self {
        Self {
            variables,
            elements: Vec::new(),
            rules: shapes.iter().map(Rule::new).collect(),
            times: Vec::new(),
            charges: vec![Vec::new(); integrations + 1],
            largest: vec![vec![0.0; variables]; integrations + 1],
        }
    }

    /// Returns the index of the element of the run that contains the time `t`.
    pub fn place_of(&self, t: f64) -> usize {
        self.elements.partition_point(|element| element.start < t).saturating_sub(1)
    }

    /// Appends an element with its point charges (values times quadrature weights) to the past of the run.
    pub fn append(&mut self, start: f64, end: f64, shape: usize, coefficients: Vec<DMatrix<f64>>, integral: Vec<f64>) {
        let charge = self.times.len();
        let rule = &self.rules[shape];
        for ((x, w), values) in rule.nodes.iter().zip(&rule.values) {
            self.times.push(start + x * (end - start));
            for (charges, coefficients) in self.charges.iter_mut().zip(&coefficients) {
                let columns = coefficients.column_iter();
                let values = columns.map(|column| column.iter().zip(values).map(|(c, f)| c * f).sum::<f64>());
                charges.extend(values.map(|value| (end - start) * w * value));
            }
        }
        for (largest, coefficients) in self.largest.iter_mut().zip(&coefficients) {
            for (largest, column) in largest.iter_mut().zip(coefficients.column_iter()) {
                // All basis functions of an element are at most one in magnitude.
                *largest = largest.max(column.iter().map(|c| c.abs()).sum());
            }
        }
        self.elements.push(Element { start, end, shape, coefficients, integral, charge });
    }

    /// Adds the convolution of the variables, integrated `level` times, over the first `count` elements to `sum`, and
    /// the magnitudes of its terms to `size`, at the time `t + offset`. The times `t` and `offset` are not added: the
    /// rounding of their sum would be visible next to a switch.
    #[expect(clippy::too_many_arguments, reason = "what is convolved with what, when, and the two sums")]
    pub fn convolve(
        &self,
        lag: &mut Lag,
        shapes: &[Shape],
        level: usize,
        count: usize,
        (t, offset): (f64, f64),
        sum: &mut [f64],
        size: &mut [f64],
    ) -> Result<(), StepError> {
        let m = self.variables;
        let mut add = |k: usize, value: f64| {
            sum[k] += value;
            size[k] += value.abs();
        };
        let mut weights = Vec::new();
        for (place, element) in self.elements[..count].iter().enumerate() {
            let from = (t - element.end) + offset;
            if from >= FAR * element.length() {
                let last = self.elements.get(place + 1).map_or(self.times.len(), |next| next.charge);
                for charge in element.charge..last {
                    let kernel = lag.value((t - self.times[charge]) + offset)?;
                    let values = &self.charges[level][charge * m..][..m];
                    values.iter().enumerate().for_each(|(k, value)| add(k, kernel * value));
                }
            } else {
                let shape = &shapes[element.shape];
                weights.resize(shape.len(), 0.0);
                lag.behind(shape, element.length(), from.max(0.0), &mut weights)?;
                for (k, column) in element.coefficients[level].column_iter().enumerate() {
                    add(k, column.iter().zip(&weights).map(|(c, w)| c * w).sum());
                }
            }
        }
        Ok(())
    }
}

/// Writes the combination of the basis functions with the values `functions` and the coefficients `coefficients` to
/// `out`.
pub fn combine(coefficients: &DMatrix<f64>, functions: &[f64], out: &mut [f64]) {
    for (value, column) in out.iter_mut().zip(coefficients.column_iter()) {
        *value = column.iter().zip(functions).map(|(c, f)| c * f).sum();
    }
}

impl Rule {
    fn new(shape: &Shape) -> Self {
        let count = shape.len() + NODES;
        let mut row = vec![0.0; shape.len()];
        let mut rule = Self { nodes: Vec::new(), values: Vec::new() };
        for is_singular in [false, true] {
            if is_singular && !shape.is_singular() {
                continue;
            }
            for (x, w) in gauss_jacobi(count, if is_singular { shape.beta } else { 0.0 }) {
                shape.polynomials(is_singular, x, &mut row);
                rule.nodes.push((x, w));
                rule.values.push(row.clone());
            }
        }
        rule
    }
}
