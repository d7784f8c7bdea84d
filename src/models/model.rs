//! Problems with their names and their start, to be solved any number of times.

use super::obstacle::Obstacle;
use super::rigid_bodies::Scene;
use super::{ConvolutionModel, Linear, MechanicalModel, Outputs, Symbolic};
use analysis::{Analysis, analyse};
use problem::Warning;
use problem::{ConvexSet, Dvi, Structure};
use std::ops::Range;

/// What a specification comes to.
#[derive(Clone, Debug)]
pub enum Model {
    /// A differential variational inequality, for Radau IIA.
    Dvi(Box<DviModel>),
    /// A mechanical system, for the steppers of contact.
    Mechanical(Box<MechanicalModel>),
    /// Rigid bodies in space, for time stepping.
    RigidBodies(Scene),
    /// A parabolic obstacle problem on a grid, for the trapezoidal rule with backward differences.
    Obstacle(Box<Obstacle>),
    /// A problem with memory, for convolution quadrature.
    Convolution(Box<ConvolutionModel>),
}

impl Model {
    /// The names of the states; with memory, which has none, of the variables.
    pub fn state_names(&self) -> Vec<String> {
        match self {
            Self::Dvi(model) => model.state_names.clone(),
            Self::Mechanical(model) => model.state_names.clone(),
            Self::RigidBodies(scene) => scene.state_names(),
            Self::Obstacle(_) => vec!["u".to_owned()],
            Self::Convolution(model) => model.forcing.variable_names.clone(),
        }
    }

    /// The names of all outputs, those of the states first.
    pub fn output_names(&self) -> Vec<String> {
        match self {
            Self::Dvi(model) => model.names().cloned().collect(),
            Self::Mechanical(model) => model.output_names.clone(),
            Self::RigidBodies(scene) => scene.output_names(),
            Self::Obstacle(problem) => problem.output_names(),
            Self::Convolution(model) => model.output_names.clone(),
        }
    }

    /// The outputs that are kept where nothing is asked for, as places in their names.
    pub fn default_outputs(&self) -> Range<usize> {
        let all = self.output_names().len();
        match self {
            Self::Dvi(model) if model.outputs.stand_for_unknowns => all - model.outputs.names.len()..all,
            _ => 0..all,
        }
    }

    /// The states at the start; with memory zeros, as nothing is given there.
    pub fn initial(&self) -> Vec<f64> {
        match self {
            Self::Dvi(model) => model.initial.clone(),
            Self::Mechanical(model) => model.initial.clone(),
            Self::RigidBodies(scene) => scene.initial(),
            Self::Obstacle(_) => vec![0.0],
            Self::Convolution(model) => vec![0.0; model.variables()],
        }
    }

    /// What the user should know before it is solved.
    pub fn warnings(&self) -> &[Warning] {
        match self {
            Self::Dvi(model) => &model.warnings,
            Self::Mechanical(model) => &model.warnings,
            Self::RigidBodies(scene) => &scene.warnings,
            Self::Obstacle(problem) => &problem.warnings,
            Self::Convolution(model) => &model.forcing.warnings,
        }
    }

    /// What the theory says of the problem at time `t` and its initial states.
    pub fn analyse(&self, t: f64) -> Analysis {
        match self {
            Self::Dvi(model) => model.analyse(t),
            Self::Mechanical(model) => model.analyse(),
            Self::RigidBodies(scene) => scene.analyse(),
            Self::Obstacle(problem) => problem.analyse(),
            Self::Convolution(model) => model.analyse(),
        }
    }

    /// The differential variational inequality, if it is posed as one.
    pub fn dvi(&self) -> Option<&DviModel> {
        match self {
            Self::Dvi(model) => Some(model),
            Self::Mechanical(_) | Self::RigidBodies(_) | Self::Obstacle(_) | Self::Convolution(_) => None,
        }
    }

    /// The set that variables are in, where the user gives one.
    pub fn set(&self) -> Option<&ConvexSet> {
        match self {
            Self::Dvi(model) => Some(&model.structure().set),
            Self::Convolution(model) => Some(&model.forcing.structure().set),
            Self::Mechanical(_) | Self::RigidBodies(_) | Self::Obstacle(_) => None,
        }
    }
}

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
    /// What is told beside them.
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

    /// Whether a rate has a kink of a state, of which its reader warned.
    pub fn has_kinks(&self) -> bool {
        self.warnings.iter().any(|warning| warning.code == "kink_in_rate")
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
        let analysis = self.questioned(analyse(&mut *self.problem(), t, &y));
        self.restricted(analysis, t, &self.initial)
    }
}
