//! Conversion of texts in the formats of other programs to documents.

use super::{robot, spice};
use std::borrow::Cow;

/// Returns the document for a text: a SPICE deck with `.tran` and the description of a robot in URDF or MJCF become
/// specifications, any other text stays as it is.
pub fn document_of(text: &[u8]) -> Cow<'_, [u8]> {
    let described = str::from_utf8(text).ok().map(|text| text.strip_prefix('\u{feff}').unwrap_or(text));
    match described.and_then(robot::document) {
        Some(document) => Cow::Owned(document.to_string().into_bytes()),
        None => spice::document(text),
    }
}
