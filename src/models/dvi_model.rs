//! A differential variational inequality with its names and initial values, which can be solved any number of times.

use super::{Closures, Linear, Outputs, Parameters, Symbolic};
use analysis::{Analysis, analyse};
use problem::Warning;
use problem::{Dvi, Structure};

/// The equations of a differential variational inequality, in one of three forms.
#[derive(Clone, Debug)]
pub enum Equations {
    /// Rates `F` and inequality functions `G` as symbolic expressions.
    Symbolic(Box<Symbolic>),
    /// A linear complementarity system: constant matrices, and a forcing that depends on time alone.
    Linear(Box<Linear>),
    /// Rates `F` and inequality functions `G` as Rust functions, of which only values are available.
    Closures(Box<Closures>),
}

/// Advice for the user when time steps chatter across a kink of the rates.
#[derive(Clone, Debug, Default)]
pub struct KinkAdvice {
    /// Descriptions of the kinks of the rates in the order of [`Dvi::kinks`], such as "`sign` of `x`".
    pub names: Vec<String>,
    /// The reformulated problem as a JSON specification, with each kink replaced by a variable in a convex set.
    pub as_set: Option<String>,
}

/// A differential variational inequality with its names, its initial values and its warnings.
#[derive(Clone, Debug)]
pub struct DviModel {
    /// The names of the `n` states of the differential variational inequality.
    pub state_names: Vec<String>,
    /// The names of the `m` variables of the differential variational inequality.
    pub variable_names: Vec<String>,
    /// The outputs of the model besides its states and variables.
    pub outputs: Outputs,
    /// The initial values of the `n` states, which are finite.
    pub initial: Vec<f64>,
    /// The compiled equations of the differential variational inequality.
    pub equations: Equations,
    /// Warnings to the user about the model, known before the problem is solved.
    pub warnings: Vec<Warning>,
    /// Advice for the user when time steps chatter across a kink of the rates.
    pub kinks: KinkAdvice,
    /// The parameters of the problem, to which new values can be bound; `None` if it has none or if they were folded
    /// into constants.
    pub parameters: Option<Parameters>,
}

impl Equations {
    /// Returns the sizes, the convex set `K` and the sparsity pattern of the equations.
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
    /// Returns a new evaluator of the model's equations with its own workspace.
    pub fn problem(&self) -> Box<dyn Dvi> {
        match &self.equations {
            Equations::Symbolic(equations) => equations.clone(),
            Equations::Linear(equations) => equations.clone(),
            Equations::Closures(equations) => equations.clone(),
        }
    }

    /// Returns whether the equations of the model are Rust functions, of which only values are available.
    pub fn is_opaque(&self) -> bool {
        matches!(self.equations, Equations::Closures(_))
    }

    /// Returns whether a rate of the model has a kink in a state; `warnings` then contains `kink_in_rate`.
    pub fn has_kinks(&self) -> bool {
        self.warnings.iter().any(|warning| warning.code == "kink_in_rate")
    }

    /// Returns the names of all columns of the solution: states, variables, outputs.
    pub fn names(&self) -> impl Iterator<Item = &String> {
        self.state_names.iter().chain(&self.variable_names).chain(&self.outputs.names)
    }

    /// Returns the sizes, the convex set `K` and the sparsity pattern of the model's equations.
    pub fn structure(&self) -> &Structure {
        self.equations.structure()
    }

    /// Analyses index, existence and uniqueness of the problem at time `t` and the initial states. Each variable `z_i`
    /// is set to the projection of zero onto its constant bounds.
    pub fn analyse(&self, t: f64) -> Analysis {
        let set = &self.structure().set;
        let variables = (0..set.dimension()).map(|k| set.project(k, 0.0));
        let y: Vec<f64> = self.initial.iter().copied().chain(variables).collect();
        let analysis = self.questioned(analyse(&mut *self.problem(), t, &y));
        self.restricted(analysis, t, &self.initial)
    }
}
