//! Independent reference solutions, which share no code with the solvers under test.
//!
//! - [`modes`] solves a linear complementarity system, a relay or a system between constant bounds mode by mode: the
//!   flow of each mode is a matrix exponential, and the mode is found by enumeration, from the signs of derivatives of
//!   all orders.
//! - [`stop`] solves an oscillator that strikes a stop in the same way.
//! - [`projected`] solves problems over any set by small fixed steps and projections, with several step sizes.
//! - [`membrane`] solves an obstacle problem on an interval, with three step sizes.

mod flow;
mod membrane;
mod modes;
mod projected;
mod stop;

pub use membrane::Membrane;
pub use modes::solve as by_modes;
pub use projected::solve as by_projection;
pub use stop::Stop;

/// The values of fields over time, and their error estimates.
#[derive(Clone, Debug)]
pub struct Values {
    /// The values of each field at the output times.
    pub columns: Vec<Vec<f64>>,
    /// The error estimate of each field.
    pub accuracy: Vec<f64>,
}
