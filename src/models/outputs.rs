//! Outputs that are neither states nor variables but functions of them, `w(t, x, z)`.

use crate::expression::{Graph, Node, Tape};

/// Further outputs by name; none by default.
#[derive(Clone, Debug, Default)]
pub struct Outputs {
    /// Their names.
    pub names: Vec<String>,
    values: Tape,
    inputs: Vec<f64>,
}

impl Outputs {
    /// Compiles nodes whose inputs are `t`, then `x`, then `z`, one for each name; `unknowns` is the length of `(x, z)`.
    pub fn new(graph: &Graph, names: Vec<String>, nodes: &[Node], unknowns: usize) -> Self {
        Self { names, values: Tape::compile(graph, nodes), inputs: vec![0.0; 1 + unknowns] }
    }

    /// Writes their values behind `(x, z)` in `y`.
    pub fn append(&mut self, t: f64, y: &mut [f64]) {
        if self.names.is_empty() {
            return;
        }
        let (unknowns, values) = y.split_at_mut(self.inputs.len() - 1);
        self.inputs[0] = t;
        self.inputs[1..].copy_from_slice(unknowns);
        self.values.evaluate(&self.inputs, values);
    }
}
