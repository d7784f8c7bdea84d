//! Workers: processes of this program that solve, `dvi worker`, each under the supervision of the front.
//!
//! What a specification makes a solve do, in memory, on the stack or by a defect, it does to the worker that has it, and
//! to no other job. A worker
//!
//! - limits itself before it takes anything ([`Confinement`]);
//! - takes one document at a time and reports what becomes of it ([`Order`], [`Report`]), whatever carries the messages:
//!   between the front and its workers, pipes ([`frame`]);
//! - ends at the end of its orders, even while it solves, so that none is left when the front is killed.
//!
//! The front keeps a worker from one job to the next, and starts another when it has died, when it did not heed its
//! deadline, or when it has grown ([`Supervisor`]). What is checked and not solved has workers apart ([`Checkers`]). A worker that dies has one job, which is told why ([`Death`]).

mod checkers;
mod confinement;
mod death;
pub mod frame;
mod launcher;
mod link;
mod message;
mod solving;
mod supervisor;

pub use checkers::{Checked, Checkers};
pub use confinement::Confinement;
pub use death::Death;
pub use launcher::{Launcher, SELF, Start, program};
pub use link::{FAIR, Finished, Left, Slice, Task, Watch};
pub use message::{Facts, Failed, Finding, Limits, Order, Origin, Prints, Progress, Report, Solved, VERSION};
pub use solving::{Solver, serve};
pub use supervisor::{Event, Loss, Notice, Supervisor};
