//! Contact: impacts and friction at the level of velocities.

pub mod islands;
pub mod law;
