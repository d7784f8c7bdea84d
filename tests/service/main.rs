//! The service as its clients see it: without a socket where none is needed, over one where it is the matter.

mod bounds;
mod catalogue;
mod check;
mod connections;
mod durable;
mod harness;
mod jobs;
mod process;
mod program;
mod refusals;
mod solve;
mod tokens;
