//! A static variational inequality, `z in K`, `<G(z), z~ - z> >= 0` for all `z~ in K`: the equations of a differential one
//! without states, and where a search for its solution begins.

use super::{DviModel, Unbindable};
use problem::{ConvexSet, Dvi};
use vi::SparseVi;

/// A static problem with its names.
#[derive(Clone, Debug)]
pub struct StaticModel {
    /// The equations, without states.
    pub equations: DviModel,
    /// The variables where a search begins.
    pub start: Vec<f64>,
}

impl StaticModel {
    /// The same problem with other values of its parameters; the start stays.
    ///
    /// # Errors
    /// As of [`DviModel::with_parameters`].
    pub fn with_parameters(&self, values: &[f64]) -> Result<Self, Unbindable> {
        Ok(Self { equations: self.equations.with_parameters(values)?, start: self.start.clone() })
    }

    /// An evaluator with registers of its own.
    pub fn inequality(&self) -> Inequality {
        Inequality(self.equations.problem())
    }
}

/// `G` and its derivative.
pub struct Inequality(pub Box<dyn Dvi>);

impl SparseVi for Inequality {
    fn set(&self) -> &ConvexSet {
        &self.0.structure().set
    }

    fn pattern(&self) -> &[(usize, usize)] {
        &self.0.structure().pattern
    }

    fn evaluate(&mut self, z: &[f64], f: &mut [f64]) {
        self.0.evaluate(0.0, z, f);
    }

    fn derivatives(&mut self, z: &[f64], values: &mut [f64]) {
        self.0.jacobian(0.0, z, values);
    }
}
