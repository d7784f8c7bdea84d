//! Multilinear finite elements on structured grids: P1 on an interval, Q1 on a rectangle or a box.
//!
//! On an element of sides `h_1 .. h_d` every shape function is a product of hats, so that every integral of two of them
//! is a product of integrals over one direction; on a grid of equal elements the same local matrices serve all of them,
//! and coefficients are taken at the centre of each, which keeps the second order of the space (Strang and Fix 1973, *An
//! Analysis of the Finite Element Method*, section 4.3).

mod assembly;
mod element;
mod grid;
mod side;

pub use assembly::{Assembly, Neighbours};
pub use element::{Element, Quadrature};
pub use grid::{Axis, Grid};
pub use side::{Face, Side};
