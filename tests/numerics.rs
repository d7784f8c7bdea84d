//! Tests of the numerical methods: test systems compared with independent solutions, measured orders of convergence,
//! and stability at the limits of the methods.

mod convergence;
mod stability;
mod systems;
