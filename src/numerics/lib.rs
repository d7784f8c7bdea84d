//! Numerical building blocks that are independent of any problem: intervals, ranges of polynomials, quadrature, and
//! roots.

pub mod bernstein;
mod components;
mod interval;
mod quadrature;
mod root;
mod shown;

/// Step of a central difference, relative to the size of its argument: the cube root of the rounding error of
/// doubles, at which truncation and rounding errors balance.
pub const CENTRAL_DIFFERENCE: f64 = 6e-6;

pub use components::components;
pub use interval::{Interval, between};
pub use quadrature::{KRONROD_GAP, kronrod, kronrod_ends};
pub use root::Bracket;
pub use shown::{WIDER, is_seen, is_shown, variation};
