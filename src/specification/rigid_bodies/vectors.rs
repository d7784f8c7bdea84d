//! Vectors of three constants.

use crate::error::SpecificationError;
use crate::expression::Expression;
use crate::lowering::Lowering;
use crate::pointer::Pointer;
use nalgebra::{Quaternion, Unit, UnitQuaternion, Vector3};

/// A vector of three constant expressions.
pub type Vector = [Expression; 3];

/// Evaluates a vector of three constant expressions; a faulty component is reported and set to zero.
pub(super) fn lower(vector: &Vector, place: &Pointer<'_>, lowering: &mut Lowering) -> Vector3<f64> {
    Vector3::from_fn(|i, _| lowering.constant(&vector[i], &place.index(i)).unwrap_or(0.0))
}

/// Evaluates a vector and normalises it to a direction; a zero vector is reported.
pub(super) fn direction(vector: &Vector, place: &Pointer<'_>, lowering: &mut Lowering) -> Unit<Vector3<f64>> {
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

/// Evaluates and normalises the quaternion of an orientation, and returns its norm, too; a zero quaternion is reported.
pub(super) fn orientation(
    given: Option<&[Expression; 4]>,
    place: &Pointer<'_>,
    lowering: &mut Lowering,
) -> (UnitQuaternion<f64>, f64) {
    let none = (UnitQuaternion::identity(), 1.0);
    let Some(given) = given else { return none };
    let values = [0, 1, 2, 3].map(|i| lowering.constant(&given[i], &place.index(i)));
    let [Some(w), Some(x), Some(y), Some(z)] = values else { return none };
    let quaternion = Quaternion::new(w, x, y, z);
    let norm = quaternion.norm();
    if !(norm > 0.0 && norm.is_finite()) {
        let error =
            SpecificationError::new(place.to_string(), "zero_quaternion", "this quaternion is zero or not finite");
        lowering.errors.push(error.expected("a unit quaternion [w, x, y, z]"));
        return none;
    }
    (UnitQuaternion::new_normalize(quaternion), norm)
}
