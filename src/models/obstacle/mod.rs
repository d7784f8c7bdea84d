//! The parabolic obstacle problem: find `u` between the obstacles `phi` and `psi` with
//!
//! ```text
//! u_t - div(a grad u) + b . grad u + c u = f + w,    0 <= w where u = phi,  w <= 0 where u = psi,  w = 0 elsewhere
//! ```
//!
//! on an interval, a rectangle or a box, with `u` or the flux `a du/dn` given on each side (Glowinski, Lions and
//! Tremolieres 1981, *Numerical Analysis of Variational Inequalities*, chapter 6). Finite elements give the
//! differential variational inequality
//!
//! ```text
//! M u' + A(t) u = f(t) + w,    u in K(t) = [phi(t), psi(t)],    <w, v - u> <= 0  for all v in K(t)
//! ```
//!
//! of index one, because `CB = M^-1` is symmetric and positive definite. [`Semidiscrete`] assembles the system,
//! [`TrBdf2`] integrates it with a variational inequality at each of two stages, and [`Contact`] measures the contact
//! set.

mod contact;
mod data_error;
mod equations;
mod field;
mod hidden;
mod load;
mod operator;
mod resting;
mod semidiscrete;
mod settings;
mod stage;
mod tr_bdf2;
mod unseen;

pub use contact::Contact;
pub use data_error::ObstacleDataError;
pub use equations::{Condition, Obstacle, Probe};
pub use field::Field;
pub use operator::largest_peclet;
pub use semidiscrete::Semidiscrete;
pub use settings::{Counts, ObstacleError, Settings};
pub use tr_bdf2::{ContactChange, GAMMA, TrBdf2};
