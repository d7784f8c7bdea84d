//! Interface for programs in Rust: a [`Problem`] in text or as functions, [`Settings`] with defaults, and the errors
//! of a [`Refused`] problem.

mod problem;
mod refused;
mod settings;

pub use problem::{Problem, Set};
pub use refused::Refused;
pub use settings::{AbsoluteTolerance, Settings};
