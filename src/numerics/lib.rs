//! The ground of the numerics, which knows of no problem: intervals.

mod interval;

pub use interval::{Interval, between};
