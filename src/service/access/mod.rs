//! Who may do what. Where others than this machine can connect, every request for work names a token:
//!
//! - a token is a number, by which it is found, and a secret of 256 random bits, told once, when it is created;
//! - the disk holds the SHA-256 of the secret. A slow hash is for secrets that people think of, not for these;
//! - secrets are compared in a time that tells nothing of them;
//! - a token may expire;
//! - a token has scopes: to read jobs, to submit and cancel them, to see those of everyone.

mod scope;
mod token;
mod tokens;

pub use scope::Scope;
pub use token::Token;
pub use tokens::{Row, Tokens, Unreadable, create, in_days, list, revoke};
