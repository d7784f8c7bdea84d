//! Numerical building blocks that are independent of any problem: intervals, ranges of polynomials, quadrature, and
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
