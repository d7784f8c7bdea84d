//! The equations of the face that a step kept, and which of them determine the free variables.

use crate::consistent_variables::ConsistentVariables;
use crate::constraints::Constraints;
use crate::free_variables::FreeVariables;
use crate::newton_control::NewtonControl;
use crate::system::System;

/// Equations that determine the free variables on the active face of `K`.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Told {
    /// The equations `G_I = 0` of the free variables suffice.
    ByEquations,
    /// The equations `G_I = 0` of the free variables suffice with hidden constraints, both with constant
    /// coefficients.
    ByHiddenConstraints,
    /// Neither suffices: these equations determine the free variables only in part.
    InPart,
}

/// The equations of the active face of `K` that a step kept, with the solvers that bring the unknowns from their
/// polynomials onto them.
pub(super) struct OnFace<'a, 'p> {
    pub system: &'a mut System<'p>,
    pub control: &'a NewtonControl,
    pub inside: &'a mut FreeVariables,
    pub constraints: &'a mut Constraints,
    pub consistent: Option<&'a mut ConsistentVariables>,
}

impl OnFace<'_, '_> {
    /// Returns which equations determine the free variables on the active face of the step.
    pub fn told(&mut self) -> Told {
        if self.inside.tells_all(self.system) {
            return Told::ByEquations;
        }
        let Some(consistent) = &mut self.consistent else { return Told::InPart };
        let is_affine = self.system.constant_jacobian() && self.system.forcing_slopes().is_some();
        if is_affine && consistent.response(self.system).is_some() { Told::ByHiddenConstraints } else { Told::InPart }
    }
}
