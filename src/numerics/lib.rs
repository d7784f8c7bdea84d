//! The ground of the numerics, which knows of no problem: intervals, the ranges of polynomials, and roots.

pub mod bernstein;
mod interval;
mod root;
mod shown;

pub use interval::{Interval, between};
pub use root::Bracket;
pub use shown::{is_seen, is_shown, variation};
