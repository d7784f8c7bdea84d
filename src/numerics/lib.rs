//! The ground of the numerics, which knows of no problem: intervals, the ranges of polynomials, quadrature, and
//! roots.

pub mod bernstein;
mod interval;
mod quadrature;
mod root;
mod shown;

pub use interval::{Interval, between};
pub use quadrature::kronrod;
pub use root::Bracket;
pub use shown::{is_seen, is_shown, variation};
