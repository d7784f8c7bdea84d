//! Measured orders of convergence, against closed forms.

#[path = "../systems/harness.rs"]
mod harness;
mod orders;
mod switches;
