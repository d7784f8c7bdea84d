//! Tables: functions of one argument, given by points.

use super::error::{Errors, SpecificationError};
use super::pointer::Pointer;
use expression::{Interpolation, Table, TableError};
use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

/// A function given by points, which expressions call by its name with one argument, as `load(t)`. Before the first point and
/// behind the last the value stays as it is there. Of time a step ends at each point at which the function changes its course.
#[derive(Clone, Debug, Deserialize, Serialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct TableOfPoints {
    /// The arguments, two or more, increasing.
    #[schema(min_items = 2)]
    pub x: Vec<f64>,
    /// The values, as many.
    #[schema(min_items = 2)]
    pub y: Vec<f64>,
    /// How the function goes on from point to point.
    #[serde(default)]
    pub interpolation: InterpolationName,
}

/// How a table goes on from point to point.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Deserialize, Serialize, ToSchema)]
#[serde(rename_all = "snake_case")]
pub enum InterpolationName {
    /// Along straight lines.
    #[default]
    Linear,
    /// By cubics with one slope at each point, which rise and fall only where the points do.
    Pchip,
    /// At the value of the point before: it jumps, so that states and variables are no arguments.
    Previous,
}

impl TableOfPoints {
    /// The table, if it is one.
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
