//! The directions of space, for members given per direction.

use super::lowering::Lowering;
use super::pointer::Pointer;

/// Names of the directions of space.
pub(super) const DIRECTIONS: [&str; 3] = ["x", "y", "z"];

/// Reports that an object has no member for one of the directions of `what`, a body or a domain.
pub(super) fn missing(key: &str, what: &str, place: &Pointer<'_>, lowering: &mut Lowering) {
    lowering.errors.report(place, "missing_key", format!("`{key}` is missing, a direction of the {what}"));
}

/// Reports that an object has a member for a direction that `what`, a body or a domain, does not have.
pub(super) fn surplus(key: &str, what: &str, place: &Pointer<'_>, lowering: &mut Lowering) {
    lowering.errors.report(&place.key(key), "no_such_direction", format!("the {what} has no direction `{key}`"));
}
