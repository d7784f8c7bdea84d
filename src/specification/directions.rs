//! The directions of space, for members given per direction.

use super::lowering::Lowering;
use super::pointer::Pointer;

/// Names of the directions of space.
pub(super) const DIRECTIONS: [&str; 3] = ["x", "y", "z"];

/// Reports a missing member for a direction that `what` has.
pub(super) fn missing(key: &str, what: &str, place: &Pointer<'_>, lowering: &mut Lowering) {
    lowering.errors.report(place, "missing_key", format!("`{key}` is missing, a direction of the {what}"));
}

/// Reports a member for a direction that `what` does not have.
pub(super) fn surplus(key: &str, what: &str, place: &Pointer<'_>, lowering: &mut Lowering) {
    lowering.errors.report(&place.key(key), "no_such_direction", format!("the {what} has no direction `{key}`"));
}
