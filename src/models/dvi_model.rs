//! A differential variational inequality with its names and initial values. A model can be solved any number of times.

use super::{Closures, Linear, Outputs, Parameters, Symbolic};
use analysis::{Analysis, analyse};
use problem::Warning;
use problem::{Dvi, Structure};

/// The equations of a differential variational inequality, in one of three forms.
#[derive(Clone, Debug)]
pub enum Equations {
    /// Rates and inequality functions as symbolic expressions.
    Symbolic(Box<Symbolic>),
    /// A linear complementarity system: constant matrices, and a forcing that depends on time.
    Linear(Box<Linear>),
    /// `F` and `G` as Rust functions, of which only values are available.
    Closures(Box<Closures>),
}

/// Advice for the user when time steps chatter across a kink of the rates.
#[derive(Clone, Debug, Default)]
pub struct KinkAdvice {
    /// Descriptions of the kinks of the equations in the order of [`Dvi::kinks`], such as "`sign` of `x`".
    pub names: Vec<String>,
    /// The problem as a JSON specification, with each kink replaced by a variable in a convex set.
    pub as_set: Option<String>,
}

/// A differential variational inequality with its names, its initial values and its warnings.
#[derive(Clone, Debug)]
pub struct DviModel {
    /// The names of the `n` states of the problem.
    pub state_names: Vec<String>,
    /// The names of the `m` variables of the problem.
    pub variable_names: Vec<String>,
    /// The outputs of the model besides its states and variables.
    pub outputs: Outputs,
    /// The initial states, `n` finite values.
    pub initial: Vec<f64>,
    /// The compiled equations of the differential variational inequality.
    pub equations: Equations,
    /// Warnings for the user, known before the problem is solved.
    pub warnings: Vec<Warning>,
    /// Advice for the user when time steps chatter across a kink of the rates.
    pub kinks: KinkAdvice,
    /// The parameters of the problem; `None` if it has none or if they were folded into constants.
    pub parameters: Option<Parameters>,
}

impl Equations {
    /// Returns the sizes, the convex set and the sparsity pattern of the equations.
    pub fn structure(&self) -> &Structure {
        match self {
            Self::Symbolic(equations) => equations.structure(),
            Self::Linear(equations) => equations.structure(),
            Self::Closures(equations) => equations.structure(),
        }
    }

    pub(super) fn structure_mut(&mut self) -> &mut Structure {
        match self {
            Self::Symbolic(equations) => equations.structure_mut(),
            Self::Linear(equations) => equations.structure_mut(),
            Self::Closures(equations) => equations.structure_mut(),
        }
    }

    pub(super) fn bind(&mut self, parameters: &[f64]) {
        match self {
            Self::Symbolic(equations) => equations.bind(parameters),
            Self::Linear(equations) => equations.bind(parameters),
            Self::Closures(_) => {}
        }
    }
}

impl DviModel {
    /// Returns a new evaluator of the equations with its own workspace.
    pub fn problem(&self) -> Box<dyn Dvi> {
        match &self.equations {
            Equations::Symbolic(equations) => equations.clone(),
            Equations::Linear(equations) => equations.clone(),
            Equations::Closures(equations) => equations.clone(),
        }
    }

    /// Returns whether the equations are Rust functions, of which only values are available.
    pub fn is_opaque(&self) -> bool {
        matches!(self.equations, Equations::Closures(_))
    }

    /// Returns whether a rate has a kink in a state; `warnings` then contains `kink_in_rate`.
    pub fn has_kinks(&self) -> bool {
        self.warnings.iter().any(|warning| warning.code == "kink_in_rate")
    }

    /// Returns the names of all columns of the solution: states, variables, outputs.
    pub fn names(&self) -> impl Iterator<Item = &String> {
        self.state_names.iter().chain(&self.variable_names).chain(&self.outputs.names)
    }

    /// Returns the sizes, the convex set and the sparsity pattern of the problem.
    pub fn structure(&self) -> &Structure {
        self.equations.structure()
    }

    /// Analyses index, existence and uniqueness at time `t` and the initial states. Each variable is set to the
    /// projection of zero onto its constant bounds.
    pub fn analyse(&self, t: f64) -> Analysis {
        let set = &self.structure().set;
        let variables = (0..set.dimension()).map(|k| set.project(k, 0.0));
        let y: Vec<f64> = self.initial.iter().copied().chain(variables).collect();
        let analysis = self.questioned(analyse(&mut *self.problem(), t, &y));
        self.restricted(analysis, t, &self.initial)
    }
}
