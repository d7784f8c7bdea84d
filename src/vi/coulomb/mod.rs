//! Frictional contact with Coulomb's law itself, not its convex relaxation. For each contact, with components
//! (normal, first tangent, second tangent),
//!
//! ```text
//! u = W r + q,    K_mu = { r : |r_t| <= mu r_n },    K_mu in r  _|_  u + (mu |u_t|, 0, 0) in K_mu*
//! ```
//!
//! where `r` are impulses (or forces), `u` relative velocities and `W` the Delassus operator (de Saxce and Feng 1998,
//! *The bipotential method*). The problem is neither an optimisation nor monotone, and `W` is singular as soon as
//! contacts outnumber degrees of freedom, so that no one method solves every instance (Acary, Bremond and Huber 2018,
//! *On solving contact problems with Coulomb friction: formulations and numerical comparisons*): [`Coulomb`] runs
//! block Gauss-Seidel, an interior-point method, proximal Newton and ADMM in turn, depending on the residual.
//!
//! A contact patch, with drilling and rolling friction, takes two block rows with an admissible set of its own.

mod admm;
mod alart_curnier;
mod anderson;
mod blocks;
mod cone;
mod evidence;
mod factored;
mod gauss_seidel;
mod interior_point;
mod limit_surface;
mod linear;
mod local;
mod local_patch;
mod lorentz;
mod newton;
mod patch;
mod portfolio;
mod problem;
mod proximal;
mod scaling;
#[cfg(test)]
mod tests;

pub use blocks::BlockMatrix;
pub use cone::FrictionCone;
pub use evidence::Evidence;
pub use factored::{Factored, Grip, Mobility, Twist};
pub use limit_surface::mean_speed;
pub use local::solve_contact;
pub use local_patch::solve_patch;
pub use patch::{Reach, Role};
pub use portfolio::{Attempt, Coulomb, Limits, Method, Report};
pub use problem::{CoulombProblem, CoulombProblemError};
pub use proximal::{ProximalReport, ProximalSweeps};
