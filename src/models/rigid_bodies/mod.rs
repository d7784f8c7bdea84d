//! Rigid bodies in space: spheres to convex hulls that touch, slide, roll and hang on joints.
//!
//! A [`MultibodySystem`] is what a user describes; a [`MoreauStepping`] steps it. Positions and orientations move on the group, contacts
//! obey Coulomb's law itself, and joints are eliminated exactly.

mod action;
pub mod collision;
mod contact;
mod delassus;
mod drive;
mod frame;
mod island;
mod joint;
mod linkage;
mod load;
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
pub use drive::{Drive, DriveLaw, ForceLaw, Limits, Servo};
pub use joint::{Joint, JointKind};
pub use load::Load;
pub use motion::Motion;
pub use outputs::{OF_BODY, OF_SCENE, between};
pub use polyhedron::Polyhedron;
pub use prescribed::{Linear, Prescription};
pub use scene::{Body, Law, Laws, MultibodySystem, Overlap};
pub use shape::Shape;
pub use signals::Signals;
pub use simulation::{ContactReport, MoreauStepping, StepFailure};
