//! Tables: functions of one argument, given by points.

use super::error::{Errors, SpecificationError};
use super::pointer::Pointer;
use expression::{Interpolation, Table, TableError};
use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

/// A function of one argument given by points, which expressions call by its name, as in `load(t)`. It is constant
/// before the first and after the last point. If the argument is time, integration steps end at each point where the
/// function has a kink or jump.
#[derive(Clone, Debug, Deserialize, Serialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct TableOfPoints {
    /// The arguments of the points: two or more, increasing.
    #[schema(min_items = 2)]
    pub x: Vec<f64>,
    /// The values of the function at the points, one per argument.
    #[schema(min_items = 2)]
    pub y: Vec<f64>,
    /// Interpolation between the points. Default `linear`.
    #[serde(default)]
    pub interpolation: InterpolationName,
}

/// Interpolation of a table between its points.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Deserialize, Serialize, ToSchema)]
#[serde(rename_all = "snake_case")]
pub enum InterpolationName {
    /// Piecewise linear interpolation.
    #[default]
    Linear,
    /// Monotone piecewise cubic interpolation, with a continuous slope (PCHIP).
    Pchip,
    /// Piecewise constant interpolation, with the value of the previous point. The function jumps, so states and
    /// variables are not allowed as arguments.
    Previous,
}

impl TableOfPoints {
    /// Builds the tabulated function, if its points are valid.
    pub(super) fn table(&self, place: &Pointer<'_>, errors: &mut Errors) -> Option<Table> {
        let interpolation = match self.interpolation {
            InterpolationName::Linear => Interpolation::Linear,
            InterpolationName::Pchip => Interpolation::Pchip,
            InterpolationName::Previous => Interpolation::Previous,
        };
        let error = match Table::new(&self.x, &self.y, interpolation) {
            Ok(table) => return Some(table),
            Err(error) => error,
        };
        let (code, place, expected) = match error {
            TableError::Lengths { .. } => ("wrong_count", place.key("y"), "a value for each argument"),
            TableError::TooFew(_) => ("too_few_members", place.key("x"), "two points or more"),
            TableError::Unsorted(k) => {
                let message = format!("{} comes after {}", self.x[k], self.x[k - 1]);
                let list = place.key("x");
                let error = SpecificationError::new(list.index(k).to_string(), "not_increasing", message);
                let expected =
                    "increasing numbers; a jump is two points close together, or \"interpolation\": \"previous\"";
                errors.push(error.expected(expected));
                return None;
            }
            TableError::NotFinite(_) => ("not_finite", place.key("y"), "finite numbers"),
        };
        errors.push(SpecificationError::new(place.to_string(), code, error.to_string()).expected(expected));
        None
    }
}
