//! Measured orders of convergence, against closed forms.

mod blocks;
mod orders;
mod switches;
