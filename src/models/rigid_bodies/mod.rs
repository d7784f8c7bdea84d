//! Rigid bodies in space, from spheres to convex hulls, with frictional contacts and joints.
//!
//! [`MultibodySystem`] holds the user's description of a system; [`MoreauStepping`] integrates it. Positions and
//! orientations are updated on the group, contacts obey Coulomb's law without regularisation, and joint constraints
//! are satisfied exactly.

mod action;
pub mod collision;
mod contact;
mod delassus;
mod drive;
mod frame;
mod friction;
mod island;
mod joint;
mod linkage;
mod load;
mod made_parts;
mod midpoint;
mod motion;
mod outputs;
mod polyhedron;
mod prescribed;
mod rotation;
mod scene;
mod shape;
mod signals;
mod simulation;
#[cfg(test)]
mod tests;
mod touches;

pub use action::{Action, DERIVED, OUTPUTS, inputs_of};
pub use collision::Collider;
pub use drive::{Coordinate, Drive, DriveLaw, ForceLaw, Limits, Servo};
pub use friction::{AxesOfGrain, Coefficient, Grain};
pub use joint::{Joint, JointKind};
pub use load::Load;
pub use made_parts::MadeParts;
pub use motion::Motion;
pub use outputs::{OF_BODY, OF_SCENE, between, state, state_of};
pub use polyhedron::Polyhedron;
pub use prescribed::{Angular, Linear, Prescription};
pub use scene::{Body, Law, Laws, MultibodySystem, Overlap, Patch};
pub use shape::Shape;
pub use signals::Signals;
pub use simulation::{Arc, ContactReport, Impact, MoreauStepping, Rubbing, StepFailure};
pub use touches::NewEvent;
