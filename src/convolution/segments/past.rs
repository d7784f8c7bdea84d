//! The past as a source: contributions of earlier elements to the convolution at a later time.
//!
//! Elements farther away than twice their length act through point charges at the nodes of Gauss rules, closer ones
//! through integrals of the kernel against their functions.

use super::lag::Lag;
use super::shape::Shape;
use crate::gauss_jacobi::gauss_jacobi;
use crate::stepper::StepError;
use nalgebra::DMatrix;

/// Distance, in lengths of an element, from which on it acts through charges. The kernel is analytic within an ellipse
/// about the element that extends to the present, with the sum `5 + 24^(1/2)` of its semi-axes for two lengths, and a
/// rule converges by the square of that, a factor of ninety-eight, with each node. Nearer elements would need more
/// nodes; a larger distance, more integrals of the kernel.
const FAR: f64 = 2.0;
/// Number of nodes of a rule beyond the number `n` of functions: they leave polynomials of degree `n + 12` to the
/// kernel, which differs from its best polynomial by about `9.9^-(n + 12)`, below rounding from four functions on.
const NODES: usize = 6;

/// An element: an interval of time on which the variables are one combination of functions.
pub struct Element {
    /// Its beginning.
    pub start: f64,
    /// Its end.
    pub end: f64,
    /// The index of its shape.
    pub shape: usize,
    /// The coefficients of the variables and of their repeated integrals, as many as the kernel takes: a row for each
    /// function, a column for each variable.
    pub coefficients: Vec<DMatrix<f64>>,
    /// The integral of the variables up to the beginning of the element.
    pub integral: Vec<f64>,
    /// The index of its first charge.
    charge: usize,
}

impl Element {
    /// Its length.
    pub fn length(&self) -> f64 {
        self.end - self.start
    }
}

/// The quadrature rule of a shape: nodes with weights, and the values of the functions there.
struct Rule {
    nodes: Vec<(f64, f64)>,
    values: Vec<Vec<f64>>,
}

/// All elements so far.
pub struct Past {
    variables: usize,
    /// The elements, in order of time.
    pub elements: Vec<Element>,
    rules: Vec<Rule>,
    times: Vec<f64>,
    /// The charges of the variables and of their integrals.
    charges: Vec<Vec<f64>>,
    /// Bounds of the largest absolute values of the variables and of their integrals.
    pub largest: Vec<Vec<f64>>,
}

impl Past {
    /// Allocates for elements of these shapes, with variables that are integrated at most `integrations` times.
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

    /// The index of the element that contains a time.
    pub fn place_of(&self, t: f64) -> usize {
        self.elements.partition_point(|element| element.start < t).saturating_sub(1)
    }

    /// Appends an element.
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
                // All functions are at most one.
                *largest = largest.max(column.iter().map(|c| c.abs()).sum());
            }
        }
        self.elements.push(Element { start, end, shape, coefficients, integral, charge });
    }

    /// Adds the convolution of the variables, integrated `level` times, over the first `count` elements to `sum`, and
    /// the sizes of its terms to `size`, at the time `t + offset`. The two are not added: the rounding of their sum
    /// would be visible next to a switch.
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

/// Computes the combination of functions with these coefficients.
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
