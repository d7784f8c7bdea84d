//! The hybrid automaton: a mode, its smooth equations, the events that end it, and the mode that follows. All engines
//! that follow an automaton share these parts, whatever its modes are: faces of `K`, contact modes, faces of a problem
//! with a memory kernel.

mod break_slopes;
mod breaks;
mod driver;
mod monitors;
mod one_step;

pub use break_slopes::{NoSlope, Shift, break_slopes};
pub use breaks::{Breaking, Breaks};
pub use driver::{Automaton, Located, Proposal, Screened, Solved, advance};
pub use monitors::{Crossing, Followed, Monitors};
pub use one_step::OneStep;
