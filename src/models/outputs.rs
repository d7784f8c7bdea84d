//! Outputs that are functions `w(t, x, z)` of states and variables.

use super::elastic::EnergyForm;
use expression::{Graph, Node, Tape};

/// The outputs of a model besides its states and variables, as compiled expressions; empty by default.
#[derive(Clone, Debug, Default)]
pub struct Outputs {
    /// The names of the outputs besides states and variables, energies last.
    pub names: Vec<String>,
    values: Tape,
    /// The length of the vector `(x, z)` of states and variables.
    unknowns: usize,
    /// The energies of an elastic body, whose names are the last of `names`; `None` if the problem defines no energies.
    energy: Option<EnergyForm>,
    /// Whether a solution contains only the outputs, without states and variables, unless the user selects columns. Set
    /// for problems with many unknowns.
    pub stand_for_unknowns: bool,
}

/// The names of the energy outputs of a model with energies.
const ENERGIES: [&str; 2] = ["kinetic_energy", "potential_energy"];

impl Outputs {
    /// Compiles the outputs: one expression node per name, with inputs `t`, `x`, `z`; `unknowns` is the length of
    /// `(x, z)`.
    pub fn new(graph: &Graph, names: Vec<String>, nodes: &[Node], unknowns: usize) -> Self {
        Self { names, values: Tape::compile(graph, nodes), unknowns, energy: None, stand_for_unknowns: false }
    }

    /// Appends the energies to the outputs, and omits states and variables from solutions unless the user selects
    /// columns.
    pub fn with_energy(mut self, energy: EnergyForm) -> Self {
        self.names.extend(ENERGIES.map(String::from));
        self.energy = Some(energy);
        self.stand_for_unknowns = true;
        self
    }

    /// Binds new parameter values to the compiled expressions of the outputs.
    pub(super) fn bind(&mut self, parameters: &[f64]) {
        self.values.bind(parameters);
    }

    /// Returns the energies of the model, if the problem defines them.
    pub fn energy(&self) -> Option<&EnergyForm> {
        self.energy.as_ref()
    }

    /// Writes the values of the outputs at time `t` into `y`, after the states and variables `(x, z)` at its beginning.
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
