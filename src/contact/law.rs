//! The contact law of one step: from velocities without impulses to impulses,
//!
//! ```text
//! u = W r + u_free,    0 <= r_n  _|_  u_n + max(gap, 0) / h >= 0,    friction by Coulomb's law
//! ```
//!
//! where a contact that closes within the step and restores takes `u_n + e u_n- >= 0` for its gap (Newton's law in the form
//! of Moreau 1988).

use crate::problem::Control;
use crate::vi::coulomb::{BlockMatrix, Coulomb, CoulombProblem};
use nalgebra::Vector3;

/// The contacts of a step, normal component first.
pub struct Rows<'a> {
    /// The Delassus operator.
    pub matrix: &'a BlockMatrix,
    /// Velocities without impulses.
    pub free: &'a [Vector3<f64>],
    /// Velocities before the step.
    pub before: &'a [Vector3<f64>],
    /// Gaps at the start of the step.
    pub gap: &'a [f64],
    /// Coefficients of friction.
    pub friction: &'a [f64],
    /// Coefficients of restitution.
    pub restitution: &'a [f64],
    /// The step.
    pub h: f64,
}

/// The law with its workspace.
#[derive(Debug, Default)]
pub struct Law {
    coulomb: Coulomb,
}

impl Law {
    /// Solves from the impulses `r`, and leaves the impulses there; the residual, infinite where the data are no contact
    /// problem.
    pub fn impulses(&mut self, rows: &Rows<'_>, r: &mut [Vector3<f64>], control: &Control) -> f64 {
        let mut q = rows.free.to_vec();
        for (k, q) in q.iter_mut().enumerate() {
            let (gap, e, before) = (rows.gap[k], rows.restitution[k], rows.before[k].x);
            let closing = gap + rows.h * q.x <= 0.0;
            q.x += if closing && e > 0.0 && before < 0.0 { e * before } else { gap.max(0.0) / rows.h };
        }
        match CoulombProblem::new(rows.matrix.clone(), q, rows.friction.to_vec()) {
            Ok(problem) => self.coulomb.solve(&problem, r, control).evidence.relative,
            Err(_) => f64::INFINITY,
        }
    }
}
