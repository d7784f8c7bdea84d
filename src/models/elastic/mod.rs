//! Elastic and viscoelastic bodies in dynamic contact, in small displacements `u` (Kelvin and Voigt):
//!
//! ```text
//! rho u_tt = div s + f,    s = A e(u) + B e(u_t),    0 <= p perp gap(t,x) - n.u >= 0  where contact is possible
//! ```
//!
//! with the pressure `p = -n.s n`, in multilinear finite elements with lumped masses. A node with a possible contact
//! has no mass in the normal direction; its mass is moved to the next node inwards (Khenous, Laborde and Renard 2008,
//! Mass redistribution method for finite element contact problems in elastodynamics). Let `N` denote the normal
//! displacements with a possible contact and `I` all others. Contact forces are then functions, not impulses:
//!
//! ```text
//! m u_I'' + (C u')_I + (K u)_I = f_I,    (C u')_N + (K u)_N = f_N - n r,    0 <= r perp gap - n u_N >= 0
//! ```
//!
//! Without viscosity (`C = 0`), the second equation is a variational inequality with the symmetric positive definite
//! matrix `K_NN`: `u_N` is a Lipschitz function of `(t, u_I)`, the first equation is an ordinary differential
//! equation with a Lipschitz right-hand side, and energy is conserved because `r u_N' = 0` almost everywhere. With
//! viscosity, `u_N` is a state with `C_NN u_N' = .. - n r`, of index 1 with the symmetric positive definite matrix `n
//! C_NN^-1 n`. With friction, whose bound is a multiple of the contact force `r`, elastic bodies use the form with
//! states `u_N` as well, where `u_N` are states without mass.
//!
//! A string may meet an obstacle anywhere. Every other node of the string then has no mass and is bounded by the
//! obstacle, and the nodes in between rebound with unchanged speed, which is the solution that conserves energy
//! (Schatzman 1980, A hyperbolic problem of second order with unilateral constraints).

mod continuum;
mod energy;
mod friction;
mod lame;
mod semidiscrete;
mod unknowns;

pub use continuum::{ContactNode, Continuum};
pub use energy::{EnergyForm, Power};
pub use friction::{Frictional, Slip};
pub use lame::Lame;
pub use semidiscrete::{Semidiscrete, semidiscretise};
pub use unknowns::{DisplacementIndex, Unknowns};
