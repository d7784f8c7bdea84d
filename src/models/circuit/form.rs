//! Linear forms: a voltage or a current as a sum over what is given. Coefficients carry their derivative along one direction
//! of the values of elements, zero where none is asked for.

use expression::Node;
use std::collections::BTreeMap;
use std::ops::{Add, Div, Mul, Neg};

/// A number and its derivative.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Coefficient {
    /// The number.
    pub value: f64,
    /// Its derivative.
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

/// `sum_k c_k q_k`, by the nonzero `c_k`.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Form {
    coefficients: BTreeMap<usize, Coefficient>,
    /// Those that are terms in parameters.
    nodes: BTreeMap<usize, Node>,
}

impl Form {
    /// Adds `c q_k`; terms that cancel leave no trace.
    pub fn add_term(&mut self, k: usize, c: impl Into<Coefficient>) {
        let sum = self.coefficients.get(&k).copied().unwrap_or_default() + c.into();
        if sum == Coefficient::default() {
            self.coefficients.remove(&k);
        } else {
            self.coefficients.insert(k, sum);
        }
    }

    /// Adds `factor` times another form.
    pub fn add(&mut self, other: &Self, factor: impl Into<Coefficient>) {
        let factor = factor.into();
        other.coefficients.iter().for_each(|(&k, &c)| self.add_term(k, factor * c));
    }

    /// `factor` times this form.
    pub fn times(&self, factor: impl Into<Coefficient>) -> Self {
        let factor = factor.into();
        let coefficients = self.coefficients.iter().map(|(&k, &c)| (k, factor * c)).collect();
        Self { coefficients, nodes: BTreeMap::new() }
    }

    /// Divides by `divisor`.
    pub fn divide(&mut self, divisor: Coefficient) {
        self.coefficients.values_mut().for_each(|c| *c = *c / divisor);
    }

    /// `c_k`
    pub fn coefficient(&self, k: usize) -> f64 {
        self.with_slope(k).value
    }

    /// `c_k` with its derivative.
    pub fn with_slope(&self, k: usize) -> Coefficient {
        self.coefficients.get(&k).copied().unwrap_or_default()
    }

    /// The number of terms.
    pub fn len(&self) -> usize {
        self.coefficients.len()
    }

    /// Whether it is zero.
    pub fn is_empty(&self) -> bool {
        self.coefficients.is_empty()
    }

    /// The terms `(k, c_k)` by `k`.
    pub fn terms(&self) -> impl Iterator<Item = (usize, f64)> {
        self.coefficients.iter().map(|(&k, &c)| (k, c.value))
    }

    /// Lets a coefficient, which is kept from now on though it be zero, be the value of a term in parameters.
    pub(super) fn let_follow(&mut self, k: usize, node: Node) {
        self.coefficients.entry(k).or_default();
        self.nodes.insert(k, node);
    }

    /// The term in parameters that a coefficient is the value of.
    pub(super) fn node(&self, k: usize) -> Option<Node> {
        self.nodes.get(&k).copied()
    }
}
