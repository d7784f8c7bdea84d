//! Measured orders of convergence, against closed forms.

mod blocks;
mod memory;
mod orders;
mod report;
mod saved;
mod switches;
