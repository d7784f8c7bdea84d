//! Workers: solver processes of this program (`dvi worker`), each supervised by the front process.
//!
//! Whatever a specification makes a solve do (use up memory, overflow the stack, meet a defect) affects the worker that
//! runs it, and no other job. A worker
//!
//! - limits itself before it takes orders ([`Confinement`]);
//! - takes one document at a time and reports on it ([`Order`], [`Report`]), whatever the transport of the messages:
//!   between the front and its workers, pipes ([`frame`]);
//! - ends when its orders end, even during a solve, so that none is left when the front is killed.
//!
//! The front keeps a worker from one job to the next, and replaces it when it has died, when it did not heed its
//! deadline, or when its memory has grown ([`Supervisor`]). Checks without a solve have workers of their own
//! ([`Checkers`]). The death of a worker affects one job, which reports the cause ([`Death`]).

mod checkers;
mod confinement;
mod death;
pub mod frame;
mod launcher;
mod link;
mod message;
mod slice;
mod solving;
mod supervisor;

pub use checkers::{Checked, Checkers};
pub use confinement::Confinement;
pub use death::Death;
pub use launcher::{Launcher, SELF, Start, program};
pub use link::{FAIR, Finished, Left, Task, Watch};
pub use message::{
    Facts, Failed, Finding, Limits, Lost, Members, Order, Origin, Prints, Progress, Report, Solved, SweepFacts, VERSION,
};
pub use slice::Slice;
pub use solving::{Solver, serve};
pub use supervisor::{Event, Loss, Notice, Supervisor};
