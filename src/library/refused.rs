//! Errors for which a problem is refused.

use ::specification::SpecificationError;
use std::error::Error;
use std::fmt;

/// Every error of a problem and its settings, each with its JSON pointer, a code, and what to write instead.
#[derive(Clone, Debug)]
pub struct Refused(pub Vec<SpecificationError>);

impl fmt::Display for Refused {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        for (k, SpecificationError { pointer, code, detail, expected, did_you_mean }) in self.0.iter().enumerate() {
            let separator = if k > 0 { "; " } else { "" };
            write!(f, "{separator}{code} at `{pointer}`: {detail}")?;
            if let Some(expected) = expected {
                write!(f, " (expected: {expected})")?;
            }
            if let Some(name) = did_you_mean {
                write!(f, "; did you mean `{name}`?")?;
            }
        }
        Ok(())
    }
}

impl Error for Refused {}
