//! Models: compiled equations of a problem (cheap to clone) with the names of its outputs.
//!
//! Parameters are inputs of the compiled equations: new values can be bound without recompilation
//! ([`DviModel::with_parameters`], [`MechanicalModel::with_parameters`]), and derivatives with respect to parameters
//! are available ([`DviModel::slopes`]). Models of elastic bodies, obstacles, rigid bodies and memory kernels fold
//! their parameters into constants.

pub mod circuit;
mod closures;
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

pub use closures::{Closures, DerivativeFunction, RowFunction};
pub use convolution::ConvolutionModel;
pub use dvi_model::{DviModel, Equations, KinkAdvice};
pub use linear::{Linear, LinearRows};
pub use mechanical::{DifferentiationError, MechanicalRows, SymbolicMechanics, slip_speed_input};
pub use mechanical_model::{ContactCoefficient, ENERGIES, MechanicalModel, velocity_name};
pub use outputs::Outputs;
pub use parameters::{Parameters, ParametricTerms};
pub use slopes::Slopes;
pub use static_model::{Inequality, StaticModel};
pub use symbolic::{LoweringError, Rows, Symbolic};
pub use unbindable::Unbindable;
