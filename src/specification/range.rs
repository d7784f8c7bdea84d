//! Constants restricted to a range.

use super::error::SpecificationError;
use super::expression::Expression;
use super::lowering::Lowering;
use super::pointer::Pointer;

/// Evaluates a constant expression that must be a positive number; reports any other number and returns 1.
pub(super) fn positive(value: &Expression, what: &str, place: &Pointer<'_>, lowering: &mut Lowering) -> f64 {
    in_range(value, what, (|x| x > 0.0, "above 0"), place, lowering).unwrap_or(1.0)
}

/// Evaluates a constant expression that must be in a range; reports a number outside the range.
pub(super) fn in_range(
    value: &Expression,
    what: &str,
    (belongs, range): (fn(f64) -> bool, &str),
    place: &Pointer<'_>,
    lowering: &mut Lowering,
) -> Option<f64> {
    let value = lowering.constant(value, place)?;
    if belongs(value) {
        return Some(value);
    }
    let error = SpecificationError::new(place.to_string(), "out_of_range", format!("the {what} is {value}"));
    lowering.errors.push(error.expected(format!("a {what} {range}")));
    None
}
