//! The ground of the numerics, which knows of no problem: intervals, and the ranges of polynomials.

pub mod bernstein;
mod interval;
mod shown;

pub use interval::{Interval, between};
pub use shown::{is_seen, is_shown, variation};
