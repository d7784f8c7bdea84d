//! The past as a source: what the elements so far contribute to the convolution at a later time.
//!
//! Elements that are farther away than twice their length act through point charges at the nodes of Gauss rules, closer ones
//! through integrals of the kernel against their functions.

use super::lag::Lag;
use super::shape::Shape;
use crate::gauss_jacobi::gauss_jacobi;
use crate::stepper::StepError;
use nalgebra::DMatrix;

/// An element that ended this many of its lengths ago, or more, acts through charges. The kernel is analytic within an
/// ellipse about the element that reaches to the present, with the sum `5 + 24^(1/2)` of its semi-axes for two lengths, and a
/// rule converges by the square of that, a factor of ninety-eight, with each node. Nearer elements would need more nodes; a
/// larger distance, more integrals of the kernel.
const FAR: f64 = 2.0;
/// Nodes of a rule beyond the number `n` of functions: these leave polynomials of degree `n + 12` to the kernel, which differs from
/// one of them by about `9.9^-(n + 12)`, below rounding from four functions on.
const NODES: usize = 6;

/// A part of the time on which the variables are one combination of functions.
pub struct Element {
    /// Its beginning.
    pub start: f64,
    /// Its end.
    pub end: f64,
    /// Which of the shapes it has.
    pub shape: usize,
    /// Of the variables, and of their integrals as often as the kernel takes them: a row for each function, a column for each
    /// variable.
    pub coefficients: Vec<DMatrix<f64>>,
    /// The integral of the variables up to its beginning.
    pub integral: Vec<f64>,
    /// The first of its charges.
    charge: usize,
}

impl Element {
    /// Its length.
    pub fn length(&self) -> f64 {
        self.end - self.start
    }
}

/// The rules of a shape: places, weights and the functions there.
struct Rule {
    nodes: Vec<(f64, f64)>,
    values: Vec<Vec<f64>>,
}

/// All elements so far.
pub struct Past {
    variables: usize,
    /// The elements, one behind the other.
    pub elements: Vec<Element>,
    rules: Vec<Rule>,
    times: Vec<f64>,
    /// Of the variables and of their integrals.
    charges: Vec<Vec<f64>>,
    /// Of the variables and of their integrals, the largest that each has been.
    pub largest: Vec<Vec<f64>>,
}

impl Past {
    /// No elements yet, of these shapes, with variables that are integrated at most `integrations` times.
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

    /// The place of the element that a time is in.
    pub fn place_of(&self, t: f64) -> usize {
        self.elements.partition_point(|element| element.start < t).saturating_sub(1)
    }

    /// Takes an element.
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
                // No function is larger than one.
                *largest = largest.max(column.iter().map(|c| c.abs()).sum());
            }
        }
        self.elements.push(Element { start, end, shape, coefficients, integral, charge });
    }

    /// Adds the convolution of the variables, integrated `level` times, over the first `count` elements to `sum`, and the
    /// sizes of its terms to `size`, at the time `offset` after `t`: the sum of both is rounded, and next to a switch that
    /// would be seen.
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

/// The combination of functions by coefficients.
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
