//! What the types of specification lower to: equations that make a [`Dvi`](crate::problem::Dvi) as often as one is
//! needed, with the names that their columns go by.

pub mod circuit;
pub mod filippov;
mod linear;
mod model;
mod symbolic;

pub use linear::{Linear, LinearRows};
pub use model::{Equations, Model};
pub use symbolic::{Refusal, Rows, Symbolic};
