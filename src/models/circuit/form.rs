//! Linear forms: a voltage or a current as a sum over what is given.

use std::collections::BTreeMap;

/// `sum_k c_k q_k`, by the nonzero `c_k`.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Form(BTreeMap<usize, f64>);

impl Form {
    /// Adds `c q_k`; terms that cancel leave no trace.
    pub fn add_term(&mut self, k: usize, c: f64) {
        let sum = self.coefficient(k) + c;
        if sum == 0.0 {
            self.0.remove(&k);
        } else {
            self.0.insert(k, sum);
        }
    }

    /// Adds `factor` times another form.
    pub fn add(&mut self, other: &Self, factor: f64) {
        other.terms().for_each(|(k, c)| self.add_term(k, factor * c));
    }

    /// `factor` times this form.
    pub fn times(&self, factor: f64) -> Self {
        Self(self.terms().map(|(k, c)| (k, factor * c)).collect())
    }

    /// Divides by `divisor`.
    pub fn divide(&mut self, divisor: f64) {
        self.0.values_mut().for_each(|c| *c /= divisor);
    }

    /// `c_k`
    pub fn coefficient(&self, k: usize) -> f64 {
        self.0.get(&k).copied().unwrap_or(0.0)
    }

    /// The number of terms.
    pub fn len(&self) -> usize {
        self.0.len()
    }

    /// Whether it is zero.
    pub fn is_empty(&self) -> bool {
        self.0.is_empty()
    }

    /// The terms `(k, c_k)` by `k`.
    pub fn terms(&self) -> impl Iterator<Item = (usize, f64)> {
        self.0.iter().map(|(&k, &c)| (k, c))
    }
}
