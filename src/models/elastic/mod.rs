//! Elastic and viscoelastic bodies in dynamic contact, in small displacements `u` (Kelvin and Voigt):
//!
//! ```text
//! rho u_tt = div s + f,    s = A e(u) + B e(u_t),    0 <= p perp gap(t,x) - n.u >= 0  where contact is possible
//! ```
//!
//! with the pressure `p = -n.s n`, in multilinear finite elements of which the nodes carry the mass. A node that can come
//! into contact carries none in its normal direction; its mass is given to the next node inwards (Khenous, Laborde and
//! Renard 2008, Mass redistribution method for finite element contact problems in elastodynamics). With `N` for those
//! displacements and `I` for all others the pressure is then no impulse any more:
//!
//! ```text
//! m u_I'' + (C u')_I + (K u)_I = f_I,    (C u')_N + (K u)_N = f_N - n r,    0 <= r perp gap - n u_N >= 0
//! ```
//!
//! With no viscosity, `C = 0`, the second is a variational inequality with the symmetric positive definite matrix `K_NN`:
//! `u_N` is a Lipschitz function of `(t, u_I)`, what is left is an ordinary differential equation with a Lipschitz
//! right-hand side, and `r u_N' = 0` almost everywhere keeps the energy. With viscosity `u_N` is a state with
//! `C_NN u_N' = .. - n r`, of index 1 with the symmetric positive definite matrix `n C_NN^-1 n`; with friction, whose limit is the force `r`, the second
//! form serves elastic bodies as well, `u_N` being states without mass.
//!
//! A string may meet an obstacle anywhere. Every other node of it then carries no mass and meets the obstacle, and a node
//! between them is thrown back with its own speed: of the solutions it is the one that conserves the energy (Schatzman
//! 1980, A hyperbolic problem of second order with unilateral constraints).

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
