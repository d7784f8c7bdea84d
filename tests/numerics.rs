//! Tests of the numerical methods against independent solutions: test systems, measured orders of convergence, and
//! stability at the limits.

mod convergence;
mod stability;
mod systems;
