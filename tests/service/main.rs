//! The service as its clients see it: without a socket where none is needed, over one where it is the matter.

mod bounds;
mod browsers;
mod catalogue;
mod check;
mod connections;
mod durable;
mod events;
mod explanations;
mod glance;
mod harness;
mod hostile;
mod job_list;
mod jobs;
mod killers;
mod metrics;
mod openapi;
mod process;
mod program;
mod refusals;
mod remote;
mod results;
mod solve;
mod supervision;
mod tokens;
mod verdict;
mod workers;
