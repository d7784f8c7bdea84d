//! The inertia of a body, checked for physical consistency: some mass distribution must have it.

use crate::error::SpecificationError;
use crate::expression::Expression;
use crate::lowering::Lowering;
use crate::pointer::Pointer;
use crate::range;
use nalgebra::{Matrix3, Vector3};
use serde::Deserialize;
use utoipa::ToSchema;

/// Three moments of inertia about the axes of the body, or the symmetric matrix `[[xx, xy, xz], [xy, yy, yz], [xz, yz,
/// zz]]`. Its off-diagonal entries are those of the inertia tensor: `xy` is minus the integral of `x y` over the mass.
/// In kilogram square metres.
#[derive(Clone, Debug, Deserialize, ToSchema)]
#[serde(untagged, expecting = "three moments of inertia, or a symmetric matrix of three rows")]
pub enum Inertia {
    /// Principal moments of inertia, about the axes of the body.
    Moments([Expression; 3]),
    /// The inertia tensor, row by row.
    Matrix([[Expression; 3]; 3]),
}

/// Relative tolerance for rounding of the inertia that the user gives.
const ROUNDING: f64 = 1e-9;

/// Reads the inertia tensor of a body, which must be positive definite, with no principal moment above the sum of the
/// other two.
pub(super) fn lower(inertia: &Inertia, place: &Pointer<'_>, lowering: &mut Lowering) -> Option<Matrix3<f64>> {
    let matrix = match inertia {
        Inertia::Moments(moments) => {
            let value = |i, _| range::positive(&moments[i], "moment of inertia", &place.index(i), lowering);
            Matrix3::from_diagonal(&Vector3::from_fn(value))
        }
        Inertia::Matrix(rows) => {
            let value = |k: usize| lowering.constant(&rows[k / 3][k % 3], &place.index(k / 3).index(k % 3));
            let values: Vec<f64> = (0..9).map(value).collect::<Option<_>>()?;
            Matrix3::from_row_slice(&values)
        }
    };
    let mut refuse = |code: &'static str, detail: String, expected: &str| {
        let error = SpecificationError::new(place.to_string(), code, detail);
        lowering.errors.push(error.expected(expected));
        None
    };
    let skew = matrix - matrix.transpose();
    if skew.amax() > ROUNDING * matrix.amax() {
        let detail =
            format!("the matrix of inertia is not symmetric: entries across the diagonal differ by {}", skew.amax());
        return refuse("mass_not_symmetric", detail, "a symmetric matrix");
    }
    let matrix = (matrix + matrix.transpose()) * 0.5;
    let principal = matrix.symmetric_eigenvalues();
    let (least, greatest, sum) = (principal.min(), principal.max(), principal.sum());
    if least <= 0.0 || least <= f64::EPSILON * greatest {
        let detail = format!("the least principal moment of inertia is {least}");
        return refuse("out_of_range", detail, "moments of inertia above 0");
    }
    let excess = 2.0 * greatest - sum;
    if excess > ROUNDING * sum {
        let detail = format!("the principal moment {greatest} is greater than the sum of the two others, by {excess}");
        return refuse("triangle_inequality", detail, "moments of which none is greater than the sum of the others");
    }
    Some(matrix)
}
