//! What the types of specification lower to: equations that can be handed out as often as they are needed, with the
//! names that their columns go by.

pub mod circuit;
mod convolution;
mod dvi_model;
pub mod elastic;
pub mod filippov;
pub mod finite_elements;
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
mod symbolic;

pub use convolution::ConvolutionModel;
pub use dvi_model::{DviModel, Equations, KinkAdvice};
pub use linear::{Linear, LinearRows};
pub use mechanical::{MechanicalRows, SymbolicMechanics, Underivable};
pub use mechanical_model::{ContactCoefficient, ENERGIES, MechanicalModel};
pub use outputs::Outputs;
pub use parameters::{Parameters, ParametricTerms, Unbindable};
pub use slopes::Slopes;
pub use symbolic::{Refusal, Rows, Symbolic};
