//! Linear forms: a voltage or a current of a circuit as a linear combination of the columns of
//! [`Columns`](super::Columns). Each coefficient has a derivative along one direction in the space of element values,
//! zero if no direction is given.

use expression::Node;
use std::collections::BTreeMap;
use std::ops::{Add, Div, Mul, Neg};

/// A coefficient of a linear form of a circuit, with its directional derivative (dual number).
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Coefficient {
    /// The value of the coefficient of the linear form.
    pub value: f64,
    /// The derivative of the coefficient along the chosen direction in the space of the circuit's element values.
    pub slope: f64,
}

impl From<f64> for Coefficient {
    fn from(value: f64) -> Self {
        Self { value, slope: 0.0 }
    }
}

impl Add for Coefficient {
    type Output = Self;

    fn add(self, other: Self) -> Self {
        Self { value: self.value + other.value, slope: self.slope + other.slope }
    }
}

impl Neg for Coefficient {
    type Output = Self;

    fn neg(self) -> Self {
        Self { value: -self.value, slope: -self.slope }
    }
}

impl Mul for Coefficient {
    type Output = Self;

    fn mul(self, other: Self) -> Self {
        Self { value: self.value * other.value, slope: self.slope * other.value + self.value * other.slope }
    }
}

impl Div for Coefficient {
    type Output = Self;

    fn div(self, other: Self) -> Self {
        let value = self.value / other.value;
        Self { value, slope: (self.slope - value * other.slope) / other.value }
    }
}

/// A linear form `sum_k c_k q_k` over the columns `q_k` (states, variables, sources) of a circuit, stored by its
/// nonzero coefficients `c_k`.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Form {
    coefficients: BTreeMap<usize, Coefficient>,
    /// The coefficients of the linear form that depend on parameters, as nodes of the expression graph.
    nodes: BTreeMap<usize, Node>,
}

impl Form {
    /// Adds a term `c q_k` to the linear form; removes the term if its coefficient becomes zero.
    pub fn add_term(&mut self, k: usize, c: impl Into<Coefficient>) {
        let sum = self.coefficients.get(&k).copied().unwrap_or_default() + c.into();
        if sum == Coefficient::default() {
            self.coefficients.remove(&k);
        } else {
            self.coefficients.insert(k, sum);
        }
    }

    /// Adds `factor` times another linear form to this linear form.
    pub fn add(&mut self, other: &Self, factor: impl Into<Coefficient>) {
        let factor = factor.into();
        other.coefficients.iter().for_each(|(&k, &c)| self.add_term(k, factor * c));
    }

    /// Returns `factor` times this linear form.
    pub fn times(&self, factor: impl Into<Coefficient>) -> Self {
        let factor = factor.into();
        let coefficients = self.coefficients.iter().map(|(&k, &c)| (k, factor * c)).collect();
        Self { coefficients, nodes: BTreeMap::new() }
    }

    /// Divides the linear form by `divisor`.
    pub fn divide(&mut self, divisor: Coefficient) {
        self.coefficients.values_mut().for_each(|c| *c = *c / divisor);
    }

    /// Returns the coefficient `c_k` of column `k` in the linear form.
    pub fn coefficient(&self, k: usize) -> f64 {
        self.with_slope(k).value
    }

    /// Returns the coefficient `c_k` of column `k` in the linear form, with its directional derivative.
    pub fn with_slope(&self, k: usize) -> Coefficient {
        self.coefficients.get(&k).copied().unwrap_or_default()
    }

    /// Returns the number of nonzero terms of the linear form.
    pub fn len(&self) -> usize {
        self.coefficients.len()
    }

    /// Returns whether the linear form is zero, without terms.
    pub fn is_empty(&self) -> bool {
        self.coefficients.is_empty()
    }

    /// Returns the terms `(k, c_k)` of the linear form in increasing order of `k`.
    pub fn terms(&self) -> impl Iterator<Item = (usize, f64)> {
        self.coefficients.iter().map(|(&k, &c)| (k, c.value))
    }

    /// Associates coefficient `k` of the linear form with a node of the expression graph that depends on parameters;
    /// the coefficient is stored even if it is zero.
    pub(super) fn let_follow(&mut self, k: usize, node: Node) {
        self.coefficients.entry(k).or_default();
        self.nodes.insert(k, node);
    }

    /// Returns the node of the expression graph of coefficient `k` of the linear form, if the coefficient depends on
    /// parameters.
    pub(super) fn node(&self, k: usize) -> Option<Node> {
        self.nodes.get(&k).copied()
    }
}
