//! The systems of the theory, each solved from its example as by a user, and compared with an answer from outside: a
//! closed form, or a reference computed in extended precision by two independent codes (`tests/reference/`).

mod branches;
mod certificates;
mod circuits;
mod contact;
mod converters;
mod decks;
mod elastic;
mod features;
mod filippov;
mod fits;
mod friction;
mod functions_of_time;
mod global_error;
pub mod harness;
pub mod memory;
mod memory_switches;
mod netlists;
mod nonunique;
mod observables;
mod obstacle;
mod orbits;
mod pendulum;
mod queues;
pub mod reference;
mod relays;
mod report;
mod rigid_bodies;
mod sensitivities;
mod sets;
mod size;
mod sliding;
mod static_problems;
mod stiff;
mod study;
mod sweeps;
mod verdicts;
