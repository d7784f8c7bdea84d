//! The variables that are consistent with given states on a face.
//!
//! The stage values of `z` have order `s` only. Given `x`, of order `2s - 1`, the free variables follow to the same
//! order from `G = 0` if `D = G_z` is regular, and from the hidden constraint `dG/dt = G_t + G_x M^-1 F = 0` if `D`
//! vanishes. If `D` is singular but not zero, they follow from
//!
//! ```text
//! V^T G = 0,    U^T (G_t + G_x M^-1 F) = 0,
//! ```
//!
//! where `U` is a basis of the left null space of `D` and `V` one of the complement (`D z'` drops out of the second
//! equation). The equations of a block on its face replace its `G`; those of a curved face depend on `z` even if `G`
//! does not. Hairer and Wanner 1996, VII.1; Ascher and Petzold 1998, 9.2.

mod dense;
pub mod inequality;
mod sparse;

use super::face::Activity;
use super::layout::Storage;
use super::newton_control::NewtonControl;
use super::screening::contraction::Errors;
use super::system::System;
use dense::Dense;
pub use dense::Response;
use nalgebra::DMatrix;
use numerics::Interval;
use problem::Face;
use sparse::Sparse;

/// Newton's method for the consistent variables (those that satisfy the equations of the active face of `K` at given
/// states), with its workspace.
pub struct ConsistentVariables {
    equations: Equations,
    inside: Vec<usize>,
    /// Values of the equations of the active face of `K` (`Phi`).
    phi: Vec<f64>,
    /// Partial derivatives, with respect to time, of the equations of the active face of `K` that belong to variables.
    drift: Vec<f64>,
    /// Newton step of each free variable (one not on a bound).
    step: Vec<f64>,
    start: Vec<f64>,
}

#[expect(clippy::large_enum_variant, reason = "one of them lives as long as its stepper; a box would only add a hop")]
enum Equations {
    Dense(Dense),
    Sparse(Sparse),
}

/// The inverse of the mass matrix `M` of the problem.
#[derive(Clone, Copy, Debug)]
pub enum InverseMass<'a> {
    Identity,
    Entries(&'a DMatrix<f64>),
}

/// Maximum number of Newton iterations for the consistent variables; equations affine in `z` need one.
const ITERATIONS: usize = 6;
/// Tolerance on the Newton step of the consistent variables, relative to the variables: the level of their rounding
/// errors.
const ENOUGH: f64 = 1e-14;

impl ConsistentVariables {
    /// Allocates the solver for the consistent variables of `system`; returns `None` without variables, or if the mass
    /// matrix `M` is singular: the states `x` alone then do not determine `z`.
    pub fn new(system: &System<'_>) -> Option<Self> {
        let variables = system.unknowns - system.states;
        if variables == 0 {
            return None;
        }
        let equations = match &system.layout.storage {
            Storage::Dense => Equations::Dense(Dense::new(system)?),
            Storage::Sparse { pattern, analysis } => Equations::Sparse(Sparse::new(system, pattern, analysis)?),
        };
        let vector = || vec![0.0; variables];
        let inside = Vec::with_capacity(variables);
        let phi = vec![0.0; system.unknowns];
        Some(Self { equations, inside, phi, drift: vector(), step: vector(), start: vector() })
    }

    /// Whether a solve for the consistent variables needs no sparse factorisation, so that it is affordable between
    /// the stages of every step.
    pub fn is_cheap(&self) -> bool {
        matches!(self.equations, Equations::Dense(_))
    }

    /// Writes to `out`, for each free variable, a first-order bound on its distance from the value that is consistent
    /// with the states, if `G` has the magnitudes `sizes` and `dG/dt` the magnitudes `hidden`: infinite if the
    /// equations are singular, or a block is on its boundary. Writes nothing if the system is sparse.
    pub fn find_errors(&mut self, system: &System<'_>, sizes: &[f64], hidden: &[f64], out: &mut [f64]) {
        self.inside.clear();
        self.inside.extend((0..out.len()).filter(|&k| system.face.places[k] == Activity::Inactive));
        let Equations::Dense(equations) = &mut self.equations else { return };
        if are_plain(system) && equations.errors(system, &self.inside, sizes, hidden, &mut self.step) {
            self.inside.iter().for_each(|&k| out[k] = self.step[k]);
        } else {
            self.inside.iter().for_each(|&k| out[k] = f64::INFINITY);
        }
    }

    /// Bounds the distance of each free variable from the value that is consistent with the states, as
    /// [`Self::find_errors`] does, for derivatives that vary within the enclosures `jacobian`, one for each nonzero
    /// in the order of the sparsity pattern. Returns whether the derivatives vary too much for a bound.
    pub fn find_errors_over(
        &mut self,
        system: &System<'_>,
        jacobian: &[Interval],
        (sizes, hidden): (&[f64], &[f64]),
        out: &mut [f64],
    ) -> bool {
        self.inside.clear();
        self.inside.extend((0..out.len()).filter(|&k| system.face.places[k] == Activity::Inactive));
        let Equations::Dense(equations) = &mut self.equations else { return false };
        let errors = are_plain(system).then(|| equations.errors_over(system, &self.inside, jacobian, (sizes, hidden)));
        errors.flatten().unwrap_or(Errors::Unbounded).write(&self.inside, out)
    }

    /// Returns the linear response of the free variables to residuals of the equations of the active face; `None` if
    /// the equations are singular, a block is on a curved face, or the system is sparse.
    pub fn response(&mut self, system: &mut System<'_>) -> Option<&Response> {
        let Equations::Dense(equations) = &mut self.equations else { return None };
        if !are_flat(system) {
            return None;
        }
        self.inside.clear();
        self.inside.extend((0..self.drift.len()).filter(|&k| system.has_equation(k)));
        if !equations.is_known(system, &self.inside) {
            system.linearise_flat_blocks();
        }
        equations.response(system, &self.inside)
    }

    /// Returns the inverse of the mass matrix `M`; `None` if the system is sparse.
    pub fn inverse_mass(&self) -> Option<InverseMass<'_>> {
        match &self.equations {
            Equations::Dense(equations) => Some(match &equations.inverse_mass {
                Some(inverse) => InverseMass::Entries(inverse),
                None => InverseMass::Identity,
            }),
            Equations::Sparse(_) => None,
        }
    }

    /// Replaces the free variables and those of blocks in `y = (x, z)` at `t` by consistent ones, and sets variables on
    /// a bound to that bound. Leaves `y` unchanged and returns false if the equations are singular or the iteration
    /// fails.
    pub fn solve(&mut self, system: &mut System<'_>, control: &NewtonControl, t: f64, y: &mut [f64]) -> bool {
        let n = system.states;
        if !system.evaluate(t, y) {
            return false;
        }
        system.put_on_bounds(y);
        self.inside.clear();
        self.inside.extend((0..system.unknowns - n).filter(|&k| system.has_equation(k)));
        if self.inside.is_empty() {
            return true;
        }
        self.start.copy_from_slice(&y[n..]);
        let mut last = f64::INFINITY;
        // Largest magnitude of the variables so far: where a variable passes through zero, its value is no scale for
        // errors.
        let mut scale = self.inside.iter().fold(0.0_f64, |scale, &k| scale.max(y[n + k].abs()));
        for _ in 0..ITERATIONS {
            if !self.newton_step(system, control, t, y) {
                break;
            }
            let size = self.step[..self.inside.len()].iter().fold(0.0_f64, |size, step| size.max(step.abs()));
            if size > last {
                break;
            }
            for (a, &k) in self.inside.iter().enumerate() {
                y[n + k] -= self.step[a];
            }
            last = size;
            scale = self.inside.iter().fold(scale.max(size), |scale, &k| scale.max(y[n + k].abs()));
            // Stop early for affine equations: the next Newton step would only be the rounding error of the present
            // one.
            let enough = if system.constant_jacobian() { f64::EPSILON.sqrt() } else { ENOUGH };
            if size <= enough * scale {
                return true;
            }
        }
        if last <= 1e-8 * scale {
            return true;
        }
        y[n..].copy_from_slice(&self.start);
        false
    }

    /// Computes one Newton step for the free variables; returns false if the equations are singular, or the step is
    /// not finite.
    fn newton_step(&mut self, system: &mut System<'_>, control: &NewtonControl, t: f64, y: &[f64]) -> bool {
        if !system.phi(t, y, &mut self.phi) || !system.differentiate(t, y) {
            return false;
        }
        // Linearise with the noise levels of `control`: if a multiplier is zero within noise, the curvature of the
        // face must have no effect at all.
        system.linearise_blocks(y, Some(control));
        system.time_derivative(t, y, &mut self.drift);
        system.combine_drift(&mut self.drift);
        let step = &mut self.step[..self.inside.len()];
        let found = match &mut self.equations {
            Equations::Dense(equations) => equations.solve(system, &self.inside, &self.phi, &self.drift, step),
            Equations::Sparse(equations) => equations.solve(system, &self.inside, &self.phi, &self.drift, step),
        };
        found && step.iter().all(|step| step.is_finite())
    }
}

/// Whether the equations of all free variables are rows of `G`, not combinations of rows, as on the boundary of the set
/// of a block.
fn are_plain(system: &System<'_>) -> bool {
    let mut blocks = system.set.blocks().iter().zip(&system.face.blocks);
    blocks.all(|(block, face)| matches!(face, Face::Interior | Face::Vertex) || system.face.holds(&block.members))
}

/// Whether the equations of the active faces of the sets of all blocks are linear in `z` and `G`.
fn are_flat(system: &System<'_>) -> bool {
    let mut blocks = system.set.blocks().iter().zip(&system.face.blocks);
    blocks.all(|(block, face)| !matches!(face, Face::Boundary(_)) || system.face.holds(&block.members))
}
