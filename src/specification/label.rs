//! Labels: the user's own words for a run or an event.

use super::error::{Errors, SpecificationError};
use super::pointer::Pointer;
use super::wording::abridged;

/// Maximum length of a label of a run or an event, in characters.
pub(super) const LONGEST: usize = 200;

/// Reports a label of a run or an event that is too long.
pub(super) fn check(label: Option<&str>, place: &Pointer<'_>, errors: &mut Errors) {
    let Some(length) = label.map(|label| label.chars().count()).filter(|length| *length > LONGEST) else {
        return;
    };
    let detail = format!("the label has {length} characters: {}", abridged(label.unwrap_or_default()));
    let error = SpecificationError::new(place.to_string(), "label_too_long", detail);
    errors.push(error.expected(format!("at most {LONGEST} characters")));
}
