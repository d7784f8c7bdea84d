//! What is wrong with a specification, where, and what would be right.

use super::place::Place;
use serde::Serialize;

/// One thing wrong with a specification.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct SpecificationError {
    /// The JSON pointer (RFC 6901) of the offender.
    pub pointer: String,
    /// A stable word for programs, such as `unknown_key`.
    pub code: &'static str,
    /// What is wrong, for people.
    pub detail: String,
    /// What would be right.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub expected: Option<String>,
    /// The nearest valid name.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub did_you_mean: Option<String>,
}

impl SpecificationError {
    pub(super) fn new(pointer: impl Into<String>, code: &'static str, detail: impl Into<String>) -> Self {
        Self { pointer: pointer.into(), code, detail: detail.into(), expected: None, did_you_mean: None }
    }

    pub(super) fn expected(mut self, expected: impl Into<String>) -> Self {
        self.expected = Some(expected.into());
        self
    }

    pub(super) fn did_you_mean(mut self, name: Option<impl Into<String>>) -> Self {
        self.did_you_mean = name.map(Into::into);
        self
    }
}

/// The most errors one answer lists: a large matrix can hold a million of the same kind.
const MOST: usize = 100;

/// The errors found so far.
#[derive(Debug, Default)]
pub(super) struct Errors {
    listed: Vec<SpecificationError>,
    found: usize,
}

impl Errors {
    pub(super) fn push(&mut self, error: SpecificationError) {
        self.found += 1;
        if self.listed.len() < MOST {
            self.listed.push(error);
        }
    }

    /// Adds an error at `place`.
    pub(super) fn report(&mut self, place: &Place<'_>, code: &'static str, detail: impl Into<String>) {
        self.push(SpecificationError::new(place.to_string(), code, detail));
    }

    /// Adds the errors of another list after those of this one.
    pub(super) fn append(&mut self, other: Self) {
        self.found += other.found;
        self.listed.extend(other.listed.into_iter().take(MOST - self.listed.len().min(MOST)));
    }

    /// How many were found, listed or not.
    pub(super) fn found(&self) -> usize {
        self.found
    }

    /// Keeps the listed errors whose pointer passes.
    pub(super) fn retain(&mut self, mut keep: impl FnMut(&str) -> bool) {
        let before = self.listed.len();
        self.listed.retain(|error| keep(&error.pointer));
        self.found -= before - self.listed.len();
    }

    /// The list, with a last entry that says how many more there are.
    pub(super) fn into_list(mut self) -> Vec<SpecificationError> {
        if self.found > self.listed.len() {
            let more = self.found - self.listed.len();
            self.listed.push(SpecificationError::new("", "more_errors", format!("{more} more errors are not listed")));
        }
        self.listed
    }
}
