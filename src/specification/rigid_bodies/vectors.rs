//! Vectors of three constants.

use crate::error::SpecificationError;
use crate::expression::Expression;
use crate::lowering::Lowering;
use crate::place::Place;
use nalgebra::{Unit, Vector3};

/// Three constant expressions.
pub type Vector = [Expression; 3];

/// The value; zero where a component has none, which is reported.
pub(super) fn lower(vector: &Vector, place: &Place<'_>, lowering: &mut Lowering) -> Vector3<f64> {
    Vector3::from_fn(|i, _| lowering.constant(&vector[i], &place.index(i)).unwrap_or(0.0))
}

/// A direction; a vector of no length is reported.
pub(super) fn direction(vector: &Vector, place: &Place<'_>, lowering: &mut Lowering) -> Unit<Vector3<f64>> {
    let before = lowering.errors.is_empty();
    let value = lower(vector, place, lowering);
    Unit::try_new(value, 0.0).unwrap_or_else(|| {
        if before {
            let error = SpecificationError::new(place.to_string(), "zero_direction", "this vector has no direction");
            lowering.errors.push(error.expected("a vector other than zero"));
        }
        Vector3::z_axis()
    })
}
