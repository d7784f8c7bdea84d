//! Failures of time steps of a multibody system, and the report of a step.

use super::super::island::{Unsolved, Work};
use contact::law;
use problem::Interrupted;
use vi::Outcome;

/// Why a time step of a multibody system failed.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum StepFailure {
    /// The motion of a body is not finite.
    NotFinite {
        /// The index in the multibody system of the body whose motion is not finite.
        body: usize,
    },
    /// The constraint equations of the joints have no solution.
    Joints,
    /// A coefficient of friction of a contact is negative or not finite.
    Friction {
        /// The indices of the two bodies in contact in the multibody system.
        bodies: [usize; 2],
        /// The value of the coefficient of friction, negative or not finite.
        mu: f64,
        /// The position of the contact at which the coefficient of friction was evaluated.
        place: [f64; 3],
    },
    /// The contact law was not solved to the required accuracy.
    Unsolved {
        /// The residual of the contact law, above the required accuracy.
        residual: f64,
    },
    /// The contacts of the step exceed the memory limit.
    TooMuchMemory {
        /// The number of contacts found before contact detection stopped.
        contacts: usize,
        /// The index of the body with the most contacts, and the number of its contacts.
        most_touched: Option<(usize, u32)>,
        /// The estimated memory for the contacts found, in bytes.
        bytes: usize,
    },
    /// The step was interrupted through [`Control`](problem::Control).
    Interrupted,
}

impl From<Unsolved> for StepFailure {
    fn from(unsolved: Unsolved) -> Self {
        match unsolved {
            Unsolved::Friction { bodies, mu, place } => Self::Friction { bodies, mu, place },
            Unsolved::Joints | Unsolved::TooLong => Self::Joints,
        }
    }
}

impl From<Interrupted> for StepFailure {
    fn from(_: Interrupted) -> Self {
        Self::Interrupted
    }
}

/// The report of a time step of a multibody system: contacts, energies, joints and solver statistics.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct ContactReport {
    /// The number of contacts, joint stops excluded, that have an impulse in the step.
    pub closed: usize,
    /// The deepest penetration of a contact at the beginning of the step, in metres.
    pub penetration: f64,
    /// The sum of the normal impulses of contacts, joint stops excluded, in newton seconds.
    pub normal_impulse: f64,
    /// The deepest penetration of a contact at the beginning of the step, relative to the smaller body's size.
    pub overlap: f64,
    /// The work `r . (u+ + u-) / 2` of contact impulses `r` with the relative velocities `u-` before and `u+` after the
    /// step, by normal and tangential components, in joules.
    pub work: [f64; 2],
    /// The normal work of contacts, counted only if all contacts with an impulse in the step have restitution one; zero
    /// in exact arithmetic.
    pub elastic_work: f64,
    /// The kinetic energy of all bodies before contacts and joints act, in joules.
    pub kinetic: f64,
    /// The largest constraint violation of a joint, relative to the size of the joint's bodies or in radians.
    pub drift: f64,
    /// The index in the multibody system of the joint with the largest constraint violation.
    pub drifted: usize,
    /// The number of islands with contacts or joints.
    pub islands: usize,
    /// The number of parts into which the step was divided; more than one if the step was too long for the joint
    /// equations.
    pub parts: u64,
    /// In a comparison run with longer steps, the time in parts of the step that are not at least twice as long as
    /// those of the first run.
    pub repeated: f64,
    /// The number of Newton iterations for implicit islands (with joints or motion-dependent forces) in solved steps.
    pub newton: u64,
    /// The work of drives and applied forces in the step.
    pub done: Work,
    /// The number of contact problems solved in the step.
    pub solves: u64,
    /// The total number of pivots or iterations of the contact solvers in the step.
    pub iterations: u64,
    /// The name of the contact solver used last in the step.
    pub solver: &'static str,
    /// The largest residual of the contact law in the step, over all islands.
    pub residual: f64,
    /// The largest residual of the contact law with a proximal (regularising) term, which is solved in islands of many
    /// contacts; `None` if there was no such island.
    pub proximal_residual: Option<f64>,
    /// Whether a coefficient of restitution was reduced in the step because it would have added energy.
    pub is_limited: bool,
}

impl ContactReport {
    /// Adds the contact solver's report for one island to the report of the step.
    pub(super) fn take(&mut self, law: &law::Report) {
        self.solves += law.solves;
        self.iterations += law.iterations;
        self.solver = law.solver;
        let residual = if law.outcome == Outcome::Breakdown { f64::INFINITY } else { law.residual };
        self.residual = self.residual.max(residual);
        self.proximal_residual = law::worse_of(self.proximal_residual, law.proximal_residual);
        self.is_limited |= law.restitution < 1.0;
    }
}
