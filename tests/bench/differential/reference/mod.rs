//! Independent answers, which share no code with what they are compared with.
//!
//! - [`modes`] solves a linear complementarity system, a relay or a system between constant bounds mode by mode: the flow of
//!   each mode is a matrix exponential, the mode is found by enumeration and by the signs of derivatives of all orders.
//! - [`stop`] does so for an oscillator that strikes a stop.
//! - [`projected`] solves over any set by small steps of one size and projections, at two sizes.
//! - [`membrane`] does so for an obstacle problem on an interval.

mod flow;
mod membrane;
mod modes;
mod projected;
mod stop;

pub use membrane::Membrane;
pub use modes::solve as by_modes;
pub use projected::solve as by_projection;
pub use stop::Stop;

/// Fields over time, and how far each may be off.
#[derive(Clone, Debug)]
pub struct Values {
    /// Of each field the values.
    pub columns: Vec<Vec<f64>>,
    /// Of each field its uncertainty.
    pub accuracy: Vec<f64>,
}
