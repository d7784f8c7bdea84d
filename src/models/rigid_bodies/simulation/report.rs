//! Step failures and the report of a step.

use super::super::island::{Unsolved, Work};
use contact::law;
use problem::Interrupted;
use vi::Outcome;

/// Why a step failed.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum StepFailure {
    /// A body's motion is no longer finite.
    NotFinite {
        /// The index of the body.
        body: usize,
    },
    /// The joint equations have no solution.
    Joints,
    /// A coefficient of friction is negative or not finite.
    Friction {
        /// The indices of both bodies.
        bodies: [usize; 2],
        /// The coefficient.
        mu: f64,
        /// The place of the contact.
        place: [f64; 3],
    },
    /// The contact law was not solved.
    Unsolved {
        /// The residual of the contact law.
        residual: f64,
    },
    /// The contacts exceed the memory limit.
    TooMuchMemory {
        /// The number of contacts found until then.
        contacts: usize,
        /// The index of the body with the most contacts, and the number of its contacts.
        most_touched: Option<(usize, u32)>,
        /// The estimated bytes for the contacts.
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

/// The report of a step: contacts, energies, joints and solver statistics.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct ContactReport {
    /// The number of contacts with an impulse.
    pub closed: usize,
    /// The deepest penetration at the beginning of the step, in metres.
    pub penetration: f64,
    /// The sum of the normal impulses, in newton seconds.
    pub normal_impulse: f64,
    /// The deepest penetration relative to the smaller body's size.
    pub overlap: f64,
    /// The work `r . (u+ + u-) / 2` of contacts by normal and tangential components, in joules.
    pub work: [f64; 2],
    /// The normal work of a step in which all contacts with an impulse have restitution one; zero in exact arithmetic.
    pub elastic_work: f64,
    /// The kinetic energy before contacts and joints act, in joules.
    pub kinetic: f64,
    /// The largest joint constraint violation, relative to the size of its bodies or in radians.
    pub drift: f64,
    /// The index of the joint with the largest violation.
    pub drifted: usize,
    /// The number of islands with contacts or joints.
    pub islands: usize,
    /// The number of parts of the step; more than one if the step was too long for joints.
    pub parts: u64,
    /// The time in which parts are not at least twice as long as those of the run that they should exceed.
    pub repeated: f64,
    /// The number of Newton iterations of implicit islands in solved steps.
    pub newton: u64,
    /// The work of drives and forces.
    pub done: Work,
    /// The number of contact problems solved.
    pub solves: u64,
    /// The total number of pivots or iterations.
    pub iterations: u64,
    /// The solver used last.
    pub solver: &'static str,
    /// The largest residual of the contact law.
    pub residual: f64,
    /// The largest residual of the law with a proximal term, which is solved in islands of many contacts.
    pub proximal_residual: Option<f64>,
    /// Whether a restitution was reduced because it would have added energy.
    pub is_limited: bool,
}

impl ContactReport {
    /// Adds the report of the contact law of one island.
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
