//! Measured orders of convergence, against closed forms.

mod orders;
mod switches;
