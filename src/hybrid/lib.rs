//! The hybrid automaton: a mode, its smooth equations, the events that end it, and the mode that follows. All engines
//! that follow an automaton share these parts, whatever its modes are: faces of `K`, contact modes, faces of a problem
//! with a memory kernel.

mod breaks;
mod monitors;

pub use breaks::Breaks;
pub use monitors::{Crossing, Followed, Monitors};
