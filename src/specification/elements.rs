//! Numbers of elements of a body or domain in each direction: one number for all, or `{"x": .., "y": ..}`.

use super::directions::{DIRECTIONS, missing, surplus};
use super::error::SpecificationError;
use super::lowering::Lowering;
use super::pointer::Pointer;
use serde::Deserialize;
use serde::de::value::MapAccessDeserializer;
use serde::de::{Deserializer, Error, MapAccess, Visitor};
use std::fmt;
use utoipa::openapi::schema::{ObjectBuilder, OneOfBuilder, Schema, Type};
use utoipa::openapi::{Ref, RefOr};
use utoipa::{PartialSchema, ToSchema};

/// Numbers of finite elements of a body or domain, in each direction.
#[derive(Clone, Copy, Debug)]
pub enum Elements {
    /// One number of finite elements for every direction.
    Same(u64),
    /// A number of finite elements for each direction.
    Each(ElementsOf),
}

/// The number of elements in each direction.
#[derive(Clone, Copy, Debug, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct ElementsOf {
    /// Number of elements along `x`.
    #[schema(minimum = 1)]
    pub x: u64,
    /// Number of elements along `y`, if the body or domain has that direction.
    #[schema(minimum = 1)]
    pub y: Option<u64>,
    /// Number of elements along `z`, if the body or domain has that direction.
    #[schema(minimum = 1)]
    pub z: Option<u64>,
}

impl Elements {
    /// Returns the number of elements in each of the first `dimension` directions; `None` where it is not given.
    fn of(&self, dimension: usize) -> Vec<Option<u64>> {
        let all = match self {
            Self::Same(n) => [Some(*n); 3],
            Self::Each(ElementsOf { x, y, z }) => [Some(*x), *y, *z],
        };
        all[..dimension].to_vec()
    }

    /// Returns the number of nodes in `dimension` directions, counting one element where the number of elements is
    /// not given.
    pub(super) fn nodes(&self, dimension: usize) -> usize {
        self.of(dimension).iter().fold(1, |nodes: usize, &n| {
            let n = usize::try_from(n.unwrap_or(1)).unwrap_or(usize::MAX);
            nodes.saturating_mul(n.saturating_add(1))
        })
    }

    /// Returns the JSON pointer to the number of finite elements in a direction.
    pub(super) fn pointer(&self, direction: usize, place: &Pointer<'_>) -> String {
        match self {
            Self::Same(_) => place.to_string(),
            Self::Each(_) => place.key(DIRECTIONS[direction]).to_string(),
        }
    }

    /// Checks that each direction of `what`, a body or a domain, has at least `fewest` elements, and reports errors
    /// at the pointer `place`.
    pub(super) fn counts(
        &self,
        dimension: usize,
        (fewest, what): (u64, &str),
        place: &Pointer<'_>,
        lowering: &mut Lowering,
    ) -> Vec<Option<usize>> {
        let is_each = matches!(self, Self::Each(_));
        let mut counts = vec![None; dimension];
        for (k, (key, number)) in DIRECTIONS.into_iter().zip(self.of(3)).enumerate() {
            match (number, k < dimension) {
                (None, true) => missing(key, what, place, lowering),
                (Some(_), false) if is_each => surplus(key, what, place, lowering),
                (Some(number), true) if number < fewest => {
                    let error =
                        SpecificationError::new(self.pointer(k, place), "out_of_range", format!("{number} elements"));
                    lowering.errors.push(error.expected(format!("at least {fewest}")));
                }
                (Some(number), true) => counts[k] = usize::try_from(number).ok(),
                (_, false) => {}
            }
        }
        counts
    }
}

impl PartialSchema for Elements {
    fn schema() -> RefOr<Schema> {
        OneOfBuilder::new()
            .item(ObjectBuilder::new().schema_type(Type::Integer).minimum(Some(1.0)))
            .item(Ref::from_schema_name("ElementsOf"))
            .description(Some("The number of elements: one number for every direction, or one for each."))
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
