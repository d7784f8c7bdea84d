//! The measure itself.
