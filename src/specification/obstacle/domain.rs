//! The domain and its elements.

use super::COORDINATES;
use super::directions::no_direction;
use crate::models::finite_elements::{Axis, Grid};
use crate::specification::error::SpecificationError;
use crate::specification::expression::Expression;
use crate::specification::lowering::Lowering;
use crate::specification::place::Place;
use serde::Deserialize;
use serde::de::value::MapAccessDeserializer;
use serde::de::{Deserializer, Error, MapAccess, Visitor};
use std::fmt;
use utoipa::openapi::schema::{ObjectBuilder, OneOfBuilder, Schema, Type};
use utoipa::openapi::{Ref, RefOr};
use utoipa::{PartialSchema, ToSchema};

/// An interval, a rectangle or a box: `[from, to]` along each direction, constants.
#[derive(Clone, Debug, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct Domain {
    /// Along `x`.
    pub x: [Expression; 2],
    /// Along `y`: a rectangle.
    pub y: Option<[Expression; 2]>,
    /// Along `z`: a box.
    pub z: Option<[Expression; 2]>,
}

/// Numbers of elements.
#[derive(Clone, Copy, Debug)]
pub enum Elements {
    /// The same in every direction.
    Same(u64),
    /// In each direction.
    Each(ElementsOf),
}

/// The number of elements in each direction.
#[derive(Clone, Copy, Debug, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct ElementsOf {
    /// Along `x`.
    #[schema(minimum = 1)]
    pub x: u64,
    /// Along `y`, where the domain has it.
    #[schema(minimum = 1)]
    pub y: Option<u64>,
    /// Along `z`, where the domain has it.
    #[schema(minimum = 1)]
    pub z: Option<u64>,
}

impl Elements {
    /// The number in each of so many directions, where it is given.
    pub(super) fn of(&self, dimension: usize) -> Vec<Option<u64>> {
        let all = match self {
            Self::Same(n) => [Some(*n); 3],
            Self::Each(ElementsOf { x, y, z }) => [Some(*x), *y, *z],
        };
        all[..dimension].to_vec()
    }
}

/// The fewest elements in a direction: between two sides where `u` is given there is a node to solve for.
const FEWEST: u64 = 2;

impl Domain {
    /// The number of directions; a `z` without a `y` is an error of its own.
    pub(super) fn dimension(&self) -> usize {
        match (&self.y, &self.z) {
            (None, _) => 1,
            (Some(_), None) => 2,
            (Some(_), Some(_)) => 3,
        }
    }

    /// The grid, if it is one.
    pub(super) fn grid(&self, given: &Elements, problem: &Place<'_>, lowering: &mut Lowering) -> Option<Grid> {
        let (place, place_of_elements) = (problem.key("domain"), problem.key("elements"));
        let dimension = self.dimension();
        if self.z.is_some() && dimension == 1 {
            let error = SpecificationError::new(place.to_string(), "missing_key", "there is a `z` and no `y`");
            lowering.errors.push(error.expected("`x`, then `y`, then `z`"));
        }
        if let Elements::Each(ElementsOf { y, z, .. }) = given {
            for (k, key, number) in [(1, "y", y), (2, "z", z)] {
                if number.is_some() && k >= dimension {
                    no_direction(key, &place_of_elements, lowering);
                }
            }
        }
        let ends = [Some(&self.x), self.y.as_ref(), self.z.as_ref()];
        let mut axes = Vec::with_capacity(dimension);
        for (k, (ends, elements)) in ends.into_iter().flatten().zip(given.of(dimension)).enumerate() {
            let key = COORDINATES[k];
            let interval = interval(ends, &place.key(key), lowering);
            let place_of_key = place_of_elements.key(key);
            let place = if matches!(given, Elements::Each(_)) { place_of_key } else { place_of_elements };
            let Some(elements) = elements else {
                let detail = format!("there is no `{key}`, and the domain has that direction");
                lowering.errors.report(&place_of_elements, "missing_key", detail);
                continue;
            };
            if elements < FEWEST {
                let error = SpecificationError::new(place.to_string(), "out_of_range", format!("{elements} elements"));
                lowering.errors.push(error.expected(format!("at least {FEWEST}")));
                continue;
            }
            let Some((lower, upper)) = interval else { continue };
            axes.push(Axis { lower, upper, elements: elements as usize });
        }
        (axes.len() == dimension).then(|| Grid::new(axes))
    }
}

fn interval(ends: &[Expression; 2], place: &Place<'_>, lowering: &mut Lowering) -> Option<(f64, f64)> {
    let [lower, upper] = [0, 1].map(|end| lowering.constant(&ends[end], &place.index(end)));
    let (lower, upper) = (lower?, upper?);
    if upper - lower > 1e-12 * lower.abs().max(upper.abs()) && (upper - lower).is_finite() {
        return Some((lower, upper));
    }
    let detail = format!("[{lower}, {upper}] has no length to be divided");
    let error = SpecificationError::new(place.to_string(), "empty_interval", detail);
    lowering.errors.push(error.expected("two numbers, the first below the second"));
    None
}

impl PartialSchema for Elements {
    fn schema() -> RefOr<Schema> {
        OneOfBuilder::new()
            .item(ObjectBuilder::new().schema_type(Type::Integer).minimum(Some(FEWEST as f64)))
            .item(Ref::from_schema_name("ElementsOf"))
            .description(Some("The number of elements in every direction, or in each."))
            .into()
    }
}

impl ToSchema for Elements {
    fn schemas(schemas: &mut Vec<(String, RefOr<Schema>)>) {
        schemas.push((ElementsOf::name().into_owned(), ElementsOf::schema()));
    }
}

impl<'de> Deserialize<'de> for Elements {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        deserializer.deserialize_any(ElementsVisitor)
    }
}

struct ElementsVisitor;

impl<'de> Visitor<'de> for ElementsVisitor {
    type Value = Elements;

    fn expecting(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        formatter.write_str("a number of elements, or {\"x\": .., \"y\": ..} with one for each direction")
    }

    fn visit_u64<E: Error>(self, value: u64) -> Result<Elements, E> {
        Ok(Elements::Same(value))
    }

    fn visit_map<A: MapAccess<'de>>(self, access: A) -> Result<Elements, A::Error> {
        ElementsOf::deserialize(MapAccessDeserializer::new(access)).map(Elements::Each)
    }
}
