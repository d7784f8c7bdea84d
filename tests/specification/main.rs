//! Tests of specifications: the examples pass all checks, every faulty document gets exact error messages, and the
//! published JSON Schema agrees with the Rust types.

mod circuits;
mod decks;
mod documents;
mod elastic;
mod equations;
mod examples;
mod filippov;
mod fit;
mod guide;
mod hostile;
mod index;
mod mechanical;
mod memory;
mod obstacle;
mod parameters;
mod rigid_bodies;
mod schema;
mod semantics;
mod slips;
mod static_vi;
mod strings;
mod structure;
mod study;
mod sweep;
mod uniqueness;
mod vectors;
mod view;
