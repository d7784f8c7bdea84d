//! Multilinear finite elements on structured grids: P1 on an interval, Q1 on a rectangle or a box.
//!
//! On an element with sides `h_1 .. h_d`, every shape function is a product of one-dimensional hat functions, so that
//! integrals of products of two shape functions are products of one-dimensional integrals. All elements of a grid have
//! the same element matrices; coefficients are evaluated at element centres, which preserves second order (Strang and
//! Fix 1973, *An Analysis of the Finite Element Method*, section 4.3).

mod assembly;
mod element;
mod grid;
mod side;

pub use assembly::{Assembly, Neighbours};
pub use element::{Element, Quadrature};
pub use grid::{Axis, Grid};
pub use side::{Face, Side};
