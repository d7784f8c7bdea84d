//! Access control by tokens. If machines other than this one can connect, every request for work must present a
//! token:
//!
//! - a token consists of a number, by which it is found, and a secret of 256 random bits, shown once at its creation;
//! - the disk has the SHA-256 digest of the secret. Only passwords that people choose need a slow hash;
//! - secrets are compared in constant time, so that the duration of a comparison reveals nothing about them;
//! - a token may expire;
//! - a token has scopes: to read own jobs, to submit and cancel own jobs, or to do both with the jobs of all clients.

mod scope;
mod token;
mod tokens;

pub use scope::Scope;
pub use token::Token;
pub use tokens::{Row, Tokens, Unreadable, create, in_days, list, revoke};
