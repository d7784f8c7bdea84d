//! Workers: solver processes of this program (`dvi worker`), each supervised by the front process, which serves HTTP.
//!
//! Whatever a specification makes a solve do (use up memory, overflow the stack, hit a defect of the program) affects
//! the worker that runs it, and no other job. A worker
//!
//! - limits itself before it takes orders ([`Confinement`]);
//! - takes one specification document at a time and reports on it ([`Order`], [`Report`]), over any transport of
//!   messages: between the front process and its workers, pipes ([`frame`]);
//! - ends when its stream of orders ends, even during a solve, so that no worker is left when the front process is
//!   killed.
//!
//! The front process keeps a worker from one job to the next, and replaces it when it has died, when it did not stop
//! at its deadline, or when its memory has grown ([`Supervisor`]). Checks without a solve have workers of their own
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
