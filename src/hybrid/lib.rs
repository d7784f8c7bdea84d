//! The hybrid automaton: a mode, its smooth equations, the events that end it, and what comes after them. What every engine
//! shares that follows one, whatever its modes are: faces of `K`, modes of contacts, faces of a problem with memory.

mod breaks;
mod monitors;

pub use breaks::Breaks;
pub use monitors::{Crossing, Followed, Monitors};
