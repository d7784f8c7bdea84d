//! What became of a step, and what is to be said of its contacts.

use super::super::island::Work;
use contact::law;
use problem::Interrupted;
use vi::Outcome;

/// What became of a step.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum StepFailure {
    /// A body's motion is no longer finite.
    NotFinite {
        /// Its place in the scene.
        body: usize,
    },
    /// The joints contradict each other.
    Joints,
    /// The contact law was not solved.
    Unsolved {
        /// What was left of it.
        residual: f64,
    },
    /// The contacts take more memory than they may.
    TooMuchMemory {
        /// Those that were found until then.
        contacts: usize,
        /// The body with the most of them, as its place in the scene, and how many it has.
        most_touched: Option<(usize, u32)>,
        /// The bytes that they would take.
        bytes: usize,
    },
    /// It was stopped from outside.
    Interrupted,
}

impl From<Interrupted> for StepFailure {
    fn from(_: Interrupted) -> Self {
        Self::Interrupted
    }
}

/// What is to be said of the contacts of a step.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct ContactReport {
    /// Contacts that carried an impulse.
    pub closed: usize,
    /// The deepest overlap at the start of the step, in metres.
    pub penetration: f64,
    /// The sum of the normal impulses, in newton seconds.
    pub normal_impulse: f64,
    /// The deepest overlap as a part of the smaller body's size.
    pub overlap: f64,
    /// Work done on normals and on tangents, `r . (u+ + u-) / 2`, in joules.
    pub work: [f64; 2],
    /// Work done on normals in a step in which every contact that carried an impulse gives all back: it should be zero.
    pub elastic_work: f64,
    /// The kinetic energy before contacts and joints act, in joules.
    pub kinetic: f64,
    /// How far the worst joint is off, as a part of the size of its bodies, or in radians.
    pub drift: f64,
    /// The place of that joint.
    pub drifted: usize,
    /// Islands with contacts or joints.
    pub islands: usize,
    /// The steps in which it was made: more than one where it was too long for the joints.
    pub parts: u64,
    /// Newton's iterations of bodies on joints, as far as steps were made.
    pub newton: u64,
    /// What drives and forces did.
    pub done: Work,
    /// Contact problems solved.
    pub solves: u64,
    /// Pivots or iterations in all.
    pub iterations: u64,
    /// The solver that answered last.
    pub solver: &'static str,
    /// The largest residual of the contact law.
    pub residual: f64,
    /// Whether a restitution would have added energy, and was cut.
    pub is_limited: bool,
}

impl ContactReport {
    /// Takes over how one island was solved.
    pub(super) fn take(&mut self, law: &law::Report) {
        self.solves += law.solves;
        self.iterations += law.iterations;
        self.solver = law.solver;
        let residual = if law.outcome == Outcome::Breakdown { f64::INFINITY } else { law.residual };
        self.residual = self.residual.max(residual);
        self.is_limited |= law.restitution < 1.0;
    }
}
