//! Measured orders of convergence of the integrators, with closed-form solutions as reference.

mod blocks;
mod memory;
mod orders;
mod report;
mod saved;
mod switches;
