//! The scopes of an access token, which say what its bearer may do.

use clap::ValueEnum;
use serde::{Deserialize, Serialize};
use std::fmt;

/// A permission that an access token grants.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize, ValueEnum)]
#[serde(rename_all = "snake_case")]
pub enum Scope {
    /// Look at own jobs and fetch their results
    Read,
    /// Submit, cancel and delete own jobs
    Submit,
    /// All of that, with everyone's jobs
    Admin,
}

impl fmt::Display for Scope {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Read => "read",
            Self::Submit => "submit",
            Self::Admin => "admin",
        })
    }
}
