//! Measured orders of convergence, with closed-form solutions as reference.

mod blocks;
mod memory;
mod orders;
mod report;
mod saved;
mod switches;
