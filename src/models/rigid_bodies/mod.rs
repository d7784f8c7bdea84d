//! Rigid bodies in space: spheres to convex hulls that touch, slide, roll and hang on joints.
//!
//! A [`Scene`] is what a user describes; a [`Simulation`] steps it. Positions and orientations move on the group, contacts
//! obey Coulomb's law itself, and joints are eliminated exactly.

pub mod collision;
mod contact;
mod delassus;
mod frame;
mod island;
mod joint;
mod linkage;
mod load;
mod midpoint;
mod motion;
mod outputs;
mod polyhedron;
mod rotation;
mod scene;
mod shape;
mod simulation;
#[cfg(test)]
mod tests;
mod touches;

pub use collision::Collider;
pub use joint::{Joint, JointKind};
pub use load::Load;
pub use motion::Motion;
pub use outputs::{OF_SCENE, between};
pub use polyhedron::Polyhedron;
pub use scene::{Body, Law, Laws, Overlap, Scene};
pub use shape::Shape;
pub use simulation::{ContactReport, Simulation, StepFailure};
