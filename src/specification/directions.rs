//! The directions of space, for each of which something may be given.

use super::lowering::Lowering;
use super::pointer::Pointer;

/// Their names.
pub(super) const DIRECTIONS: [&str; 3] = ["x", "y", "z"];

/// Reports that nothing is given for a direction that `what` has.
pub(super) fn missing(key: &str, what: &str, place: &Pointer<'_>, lowering: &mut Lowering) {
    lowering.errors.report(place, "missing_key", format!("there is no `{key}`, and the {what} has that direction"));
}

/// Reports that something is given for a direction that `what` has not.
pub(super) fn surplus(key: &str, what: &str, place: &Pointer<'_>, lowering: &mut Lowering) {
    lowering.errors.report(&place.key(key), "no_such_direction", format!("the {what} has no direction `{key}`"));
}
