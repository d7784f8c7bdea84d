//! A problem with its names and its start, to be solved any number of times.

use super::{Linear, Symbolic};
use crate::analysis::{Analysis, analyse};
use crate::problem::{Dvi, Structure};
use crate::solution::{Outputs, Warning};

/// The equations of a model.
#[derive(Clone, Debug)]
pub enum Equations {
    /// Rates and inequality as expressions.
    Symbolic(Symbolic),
    /// Constant matrices and a forcing.
    Linear(Linear),
}

/// A differential variational inequality with its names, its initial values and what is to be said of it.
#[derive(Clone, Debug)]
pub struct Model {
    /// The names of the `n` states.
    pub state_names: Vec<String>,
    /// The names of the `m` variables.
    pub variable_names: Vec<String>,
    /// What is told beside them.
    pub outputs: Outputs,
    /// The states at the start, `n` finite values.
    pub initial: Vec<f64>,
    /// The equations.
    pub equations: Equations,
    /// What the user should know before it is solved.
    pub warnings: Vec<Warning>,
}

impl Model {
    /// An evaluator with registers of its own.
    pub fn problem(&self) -> Box<dyn Dvi> {
        match &self.equations {
            Equations::Symbolic(equations) => Box::new(equations.clone()),
            Equations::Linear(equations) => Box::new(equations.clone()),
        }
    }

    /// The names of all that is told: states, variables, outputs.
    pub fn names(&self) -> impl Iterator<Item = &String> {
        self.state_names.iter().chain(&self.variable_names).chain(&self.outputs.names)
    }

    /// Sizes, set and sparsity.
    pub fn structure(&self) -> &Structure {
        match &self.equations {
            Equations::Symbolic(equations) => equations.structure(),
            Equations::Linear(equations) => equations.structure(),
        }
    }

    /// What the theory says of the problem at time `t` and its initial states, with each variable as near to zero as its
    /// constant bounds allow.
    pub fn analyse(&self, t: f64) -> Analysis {
        let set = &self.structure().set;
        let variables = (0..set.dimension()).map(|k| set.project(k, 0.0));
        let y: Vec<f64> = self.initial.iter().copied().chain(variables).collect();
        analyse(&mut *self.problem(), t, &y)
    }
}
