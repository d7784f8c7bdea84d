//! What the types of specification lower to: equations that can be handed out as often as they are needed, with the
//! names that their columns go by.
//!
//! Parameters are inputs of these equations: other values are bound to a model that is compiled
//! ([`DviModel::with_parameters`], [`MechanicalModel::with_parameters`]), and it has derivatives by them
//! ([`DviModel::slopes`]). Elastic bodies, obstacles, rigid bodies and memory have theirs folded into constants.

pub mod circuit;
mod convolution;
mod dvi_model;
pub mod elastic;
pub mod filippov;
pub mod finite_elements;
mod forcing_slopes;
mod linear;
mod mechanical;
mod mechanical_model;
pub mod obstacle;
mod outputs;
mod parameters;
mod regularity;
mod reversal;
pub mod rigid_bodies;
mod slopes;
mod static_model;
mod symbolic;
#[cfg(test)]
mod tests;
mod unbindable;

pub use convolution::ConvolutionModel;
pub use dvi_model::{DviModel, Equations, KinkAdvice};
pub use linear::{Linear, LinearRows};
pub use mechanical::{DifferentiationError, MechanicalRows, SymbolicMechanics};
pub use mechanical_model::{ContactCoefficient, ENERGIES, MechanicalModel, velocity_name};
pub use outputs::Outputs;
pub use parameters::{Parameters, ParametricTerms};
pub use slopes::Slopes;
pub use static_model::{Inequality, StaticModel};
pub use symbolic::{LoweringError, Rows, Symbolic};
pub use unbindable::Unbindable;
