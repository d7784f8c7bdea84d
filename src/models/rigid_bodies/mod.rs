//! Rigid bodies in space: spheres to convex hulls that touch, slide, roll and hang on joints.

pub mod collision;
mod joint;
mod motion;
mod polyhedron;
mod rotation;
mod scene;
mod shape;

pub use collision::Collider;
pub use joint::{Joint, JointKind, Row};
pub use motion::Motion;
pub use polyhedron::Polyhedron;
pub use scene::{Body, Law, Laws, Overlap, Scene};
pub use shape::Shape;
