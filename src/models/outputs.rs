//! Outputs that are neither states nor variables but functions of them, `w(t, x, z)`.

use super::elastic::EnergyForm;
use expression::{Graph, Node, Tape};

/// Further outputs by name; none unless they are given.
#[derive(Clone, Debug, Default)]
pub struct Outputs {
    /// Their names.
    pub names: Vec<String>,
    values: Tape,
    /// The length of `(x, z)`.
    unknowns: usize,
    /// The energies, whose names are the last; none where the problem has none.
    energy: Option<EnergyForm>,
    /// Whether they are kept in place of the unknowns where nothing is asked for: the unknowns are many.
    pub stand_for_unknowns: bool,
}

/// The names of the energies.
const ENERGIES: [&str; 2] = ["kinetic_energy", "potential_energy"];

impl Outputs {
    /// Compiles nodes whose inputs are `t`, then `x`, then `z`, one for each name; `unknowns` is the length of `(x, z)`.
    pub fn new(graph: &Graph, names: Vec<String>, nodes: &[Node], unknowns: usize) -> Self {
        Self { names, values: Tape::compile(graph, nodes), unknowns, energy: None, stand_for_unknowns: false }
    }

    /// The same with the energies behind them, in place of the unknowns where nothing is asked for.
    pub fn with_energy(mut self, energy: EnergyForm) -> Self {
        self.names.extend(ENERGIES.map(String::from));
        self.energy = Some(energy);
        self.stand_for_unknowns = true;
        self
    }

    /// Takes over other parameters.
    pub(super) fn bind(&mut self, parameters: &[f64]) {
        self.values.bind(parameters);
    }

    /// The energies, where the problem has them.
    pub fn energy(&self) -> Option<&EnergyForm> {
        self.energy.as_ref()
    }

    /// Writes their values behind `(x, z)` in `y`.
    pub fn append(&mut self, t: f64, y: &mut [f64]) {
        if self.names.is_empty() {
            return;
        }
        let (unknowns, values) = y.split_at_mut(self.unknowns);
        let values = match &self.energy {
            Some(energy) => {
                let (values, energies) = values.split_at_mut(values.len() - ENERGIES.len());
                (energies[0], energies[1]) = energy.at(unknowns);
                values
            }
            None => values,
        };
        self.values.evaluate(t, unknowns, values);
    }
}
