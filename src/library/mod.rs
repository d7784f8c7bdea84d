//! Problems of programs in Rust: a [`Problem`] in text or as functions, [`Settings`] with defaults, and what is [`Refused`].

mod problem;
mod refused;
mod settings;

pub use problem::{Problem, Set};
pub use refused::Refused;
pub use settings::{AbsoluteTolerance, Settings};
