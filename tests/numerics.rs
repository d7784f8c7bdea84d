//! The numerics, each against an answer from outside: the systems of the theory, and measured orders of convergence.

mod convergence;
mod systems;
