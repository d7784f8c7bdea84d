//! Errors in a specification: what is wrong, where, and what to write instead.

use super::pointer::Pointer;
use serde::Serialize;
use utoipa::ToSchema;

/// One error in a specification.
#[derive(Clone, Debug, PartialEq, Serialize, ToSchema)]
pub struct SpecificationError {
    /// The JSON pointer (RFC 6901) to the erroneous part.
    pub pointer: String,
    /// A stable code for programs, such as `unknown_key`.
    pub code: &'static str,
    /// What is wrong with the erroneous part, in words.
    pub detail: String,
    /// What to write instead of the erroneous part.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub expected: Option<String>,
    /// The valid name that is nearest to the given name.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub did_you_mean: Option<String>,
}

const INTERRUPTED: &str = "interrupted";

impl SpecificationError {
    /// Creates an error at a JSON pointer, with a stable code and a description of what is wrong.
    pub fn new(pointer: impl Into<String>, code: &'static str, detail: impl Into<String>) -> Self {
        Self { pointer: pointer.into(), code, detail: detail.into(), expected: None, did_you_mean: None }
    }

    /// Returns the only error of a document whose check was stopped from outside.
    pub(super) fn interrupted() -> Self {
        Self::new("", INTERRUPTED, "reading and checking the specification was stopped before it was done")
    }

    /// Whether the error reports that the check of the document was stopped, so that nothing is known about the
    /// document.
    pub fn is_interruption(&self) -> bool {
        self.code == INTERRUPTED
    }

    /// Sets the text that says what to write instead of the erroneous part of the specification.
    #[must_use]
    pub fn expected(mut self, expected: impl Into<String>) -> Self {
        self.expected = Some(expected.into());
        self
    }

    pub(super) fn did_you_mean(mut self, name: Option<impl Into<String>>) -> Self {
        self.did_you_mean = name.map(Into::into);
        self
    }
}

/// Largest number of errors listed in one answer: a large matrix may contain a million errors of one kind.
pub(super) const MOST: usize = 100;

/// The errors found so far in a specification.
#[derive(Debug, Default)]
pub struct Errors {
    listed: Vec<SpecificationError>,
    cut: bool,
}

impl Errors {
    /// Adds an error, which is constructed only if there is room in the list: a search for the nearest of many names
    /// takes time.
    pub(super) fn push_with(&mut self, error: impl FnOnce() -> SpecificationError) {
        if self.has_room() {
            self.listed.push(error());
        }
    }

    pub(super) fn push(&mut self, error: SpecificationError) {
        self.push_with(|| error);
    }

    /// Adds an error at the JSON pointer `place` of the specification.
    pub(super) fn report(&mut self, place: &Pointer<'_>, code: &'static str, detail: impl Into<String>) {
        self.push_with(|| SpecificationError::new(place.to_string(), code, detail));
    }

    /// Whether there is room in the list for another error. A caller that gets `false` need not look for one: the list
    /// will be marked as cut.
    pub(super) fn has_room(&mut self) -> bool {
        self.cut |= self.listed.len() >= MOST;
        !self.cut
    }

    /// The number of errors found so far in the specification.
    pub(super) fn count(&self) -> usize {
        self.listed.len()
    }

    /// Adds the line number `line`, of a text within the document, to the errors after the first `known`.
    pub(super) fn at_line(&mut self, known: usize, line: usize) {
        for error in self.listed.iter_mut().skip(known) {
            error.detail = format!("line {line}: {}", error.detail);
        }
    }

    /// Appends the errors of another list, as long as there is room.
    pub(super) fn append(&mut self, other: Self) {
        for error in other.listed {
            self.push(error);
        }
        self.cut |= other.cut;
    }

    pub(super) fn is_empty(&self) -> bool {
        self.listed.is_empty()
    }

    /// Keeps only the errors whose JSON pointer satisfies `keep`.
    pub(super) fn retain(&mut self, mut keep: impl FnMut(&str) -> bool) {
        self.listed.retain(|error| keep(&error.pointer));
    }

    /// Returns the list, with a note if it was cut. After an interruption, returns the interruption alone: other errors
    /// may be its consequence.
    pub(super) fn into_list(mut self) -> Vec<SpecificationError> {
        if let Some(interrupted) = self.listed.iter().position(SpecificationError::is_interruption) {
            return vec![self.listed.swap_remove(interrupted)];
        }
        if self.cut {
            let detail =
                format!("these are the first {MOST} errors; the rest of the document was not checked completely");
            self.listed.push(SpecificationError::new("", "more_errors", detail));
        }
        self.listed
    }
}
