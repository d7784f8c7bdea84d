//! What is wrong with a specification, where, and what would be right.

use super::pointer::Pointer;
use serde::Serialize;
use utoipa::ToSchema;

/// One thing wrong with a specification.
#[derive(Clone, Debug, PartialEq, Serialize, ToSchema)]
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

const INTERRUPTED: &str = "interrupted";

impl SpecificationError {
    pub(super) fn new(pointer: impl Into<String>, code: &'static str, detail: impl Into<String>) -> Self {
        Self { pointer: pointer.into(), code, detail: detail.into(), expected: None, did_you_mean: None }
    }

    /// The one error of a document whose reading was stopped from outside.
    pub(super) fn interrupted() -> Self {
        Self::new("", INTERRUPTED, "reading and checking the specification was stopped before it was done")
    }

    /// Whether it says nothing of the document: reading it was stopped.
    pub fn is_interruption(&self) -> bool {
        self.code == INTERRUPTED
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
pub(super) const MOST: usize = 100;

/// The errors found so far.
#[derive(Debug, Default)]
pub struct Errors {
    listed: Vec<SpecificationError>,
    cut: bool,
}

impl Errors {
    /// Adds an error, which is made only if there is room: to find the nearest of many names takes time.
    pub(super) fn push_with(&mut self, error: impl FnOnce() -> SpecificationError) {
        if self.has_room() {
            self.listed.push(error());
        }
    }

    pub(super) fn push(&mut self, error: SpecificationError) {
        self.push_with(|| error);
    }

    /// Adds an error at `place`.
    pub(super) fn report(&mut self, place: &Pointer<'_>, code: &'static str, detail: impl Into<String>) {
        self.push_with(|| SpecificationError::new(place.to_string(), code, detail));
    }

    /// Whether another error can be listed. One who asks and is told no need not look for it.
    pub(super) fn has_room(&mut self) -> bool {
        self.cut |= self.listed.len() >= MOST;
        !self.cut
    }

    /// Adds the errors of another list after those of this one.
    pub(super) fn append(&mut self, other: Self) {
        for error in other.listed {
            self.push(error);
        }
        self.cut |= other.cut;
    }

    pub(super) fn is_empty(&self) -> bool {
        self.listed.is_empty()
    }

    /// Keeps the errors whose pointer passes.
    pub(super) fn retain(&mut self, mut keep: impl FnMut(&str) -> bool) {
        self.listed.retain(|error| keep(&error.pointer));
    }

    /// The list, with a last entry if it was cut; where reading was stopped, that alone: the rest may be its consequence.
    pub(super) fn into_list(mut self) -> Vec<SpecificationError> {
        if let Some(interrupted) = self.listed.iter().position(SpecificationError::is_interruption) {
            return vec![self.listed.swap_remove(interrupted)];
        }
        if self.cut {
            let detail = format!("these are the first {MOST} errors; what comes after them was not checked in full");
            self.listed.push(SpecificationError::new("", "more_errors", detail));
        }
        self.listed
    }
}
