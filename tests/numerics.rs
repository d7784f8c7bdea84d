//! The numerics, each against an answer from outside: the systems of the theory, measured orders of
//! convergence, and stability at the limits.

mod convergence;
mod stability;
mod systems;
