//! A differential variational inequality with its names and its start, to be solved any number of times.

use super::{Linear, Outputs, Symbolic};
use analysis::{Analysis, analyse};
use problem::Warning;
use problem::{Dvi, Structure};

/// The equations of a differential variational inequality.
#[derive(Clone, Debug)]
pub enum Equations {
    /// Rates and inequality as expressions.
    Symbolic(Box<Symbolic>),
    /// Constant matrices and a forcing.
    Linear(Box<Linear>),
}

/// What is to be said where steps chatter across a kink.
#[derive(Clone, Debug, Default)]
pub struct KinkAdvice {
    /// The kinks in the order of [`Dvi::kinks`], such as "`sign` of `x`".
    pub names: Vec<String>,
    /// The problem with its kinks written as a set, as JSON.
    pub as_set: Option<String>,
}

/// A differential variational inequality with its names, its initial values and what is to be said of it.
#[derive(Clone, Debug)]
pub struct DviModel {
    /// The names of the `n` states.
    pub state_names: Vec<String>,
    /// The names of the `m` variables.
    pub variable_names: Vec<String>,
    /// The further outputs.
    pub outputs: Outputs,
    /// The states at the start, `n` finite values.
    pub initial: Vec<f64>,
    /// The equations.
    pub equations: Equations,
    /// What the user should know before it is solved.
    pub warnings: Vec<Warning>,
    /// What is to be said where steps chatter across a kink.
    pub kinks: KinkAdvice,
}

impl DviModel {
    /// An evaluator with registers of its own.
    pub fn problem(&self) -> Box<dyn Dvi> {
        match &self.equations {
            Equations::Symbolic(equations) => equations.clone(),
            Equations::Linear(equations) => equations.clone(),
        }
    }

    /// Whether a rate has a kink of a state; the user was warned of it.
    pub fn has_kinks(&self) -> bool {
        self.warnings.iter().any(|warning| warning.code == "kink_in_rate")
    }

    /// The names of all columns: states, variables, outputs.
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
        let analysis = self.questioned(analyse(&mut *self.problem(), t, &y));
        self.restricted(analysis, t, &self.initial)
    }
}
