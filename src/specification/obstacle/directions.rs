//! A coefficient of an obstacle problem that may differ between the directions of space.

use super::field;
use crate::directions::{missing, surplus};
use crate::error::SpecificationError;
use crate::expression::Expression;
use crate::lowering::Lowering;
use crate::pointer::Pointer;
use models::obstacle::Field;
use serde::Deserialize;
use serde::de::value::MapAccessDeserializer;
use serde::de::{Deserializer, Error, MapAccess, Visitor};
use std::fmt;
use utoipa::openapi::schema::{OneOfBuilder, Schema};
use utoipa::openapi::{Ref, RefOr};
use utoipa::{PartialSchema, ToSchema};

/// A coefficient as one expression for all directions of space, or as one expression for each.
#[derive(Clone, Debug)]
pub enum PerDirection {
    /// One expression for the coefficient in all directions of space.
    Same(Expression),
    /// One expression for the coefficient in each direction of the domain.
    Each(Box<Directions>),
}

/// A coefficient as an expression for each direction of space.
#[derive(Clone, Debug, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct Directions {
    /// Coefficient along `x`.
    pub x: Expression,
    /// Coefficient along `y`, if the domain has that direction.
    pub y: Option<Expression>,
    /// Coefficient along `z`, if the domain has that direction.
    pub z: Option<Expression>,
}

impl PerDirection {
    /// Returns the coefficient in each of `dimension` directions as a function of time and space. A single expression
    /// applies to several directions only if `spreads` is true.
    pub(super) fn lower(
        &self,
        dimension: usize,
        spreads: bool,
        place: &Pointer<'_>,
        lowering: &mut Lowering,
    ) -> Vec<Field> {
        match self {
            Self::Same(expression) => {
                if dimension > 1 && !spreads {
                    let detail = format!("one expression is given for {dimension} directions");
                    let error = SpecificationError::new(place.to_string(), "wrong_shape", detail);
                    lowering.errors.push(error.expected("an object with an expression for each direction"));
                }
                vec![field(expression, place, lowering); dimension]
            }
            Self::Each(each) => {
                let given = [("x", Some(&each.x)), ("y", each.y.as_ref()), ("z", each.z.as_ref())];
                let mut fields = Vec::with_capacity(dimension);
                for (k, (key, expression)) in given.into_iter().enumerate() {
                    match (expression, k < dimension) {
                        (Some(expression), true) => fields.push(field(expression, &place.key(key), lowering)),
                        (None, true) => missing(key, "domain", place, lowering),
                        (Some(_), false) => surplus(key, "domain", place, lowering),
                        (None, false) => {}
                    }
                }
                fields
            }
        }
    }
}

impl PartialSchema for PerDirection {
    fn schema() -> RefOr<Schema> {
        OneOfBuilder::new()
            .item(Ref::from_schema_name("Expression"))
            .item(Ref::from_schema_name("Directions"))
            .description(Some("An expression for every direction, or one for each."))
            .into()
    }
}

impl ToSchema for PerDirection {
    fn schemas(schemas: &mut Vec<(String, RefOr<Schema>)>) {
        schemas.push((Directions::name().into_owned(), Directions::schema()));
        Directions::schemas(schemas);
    }
}

impl<'de> Deserialize<'de> for PerDirection {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        deserializer.deserialize_any(PerDirectionVisitor)
    }
}

struct PerDirectionVisitor;

impl<'de> Visitor<'de> for PerDirectionVisitor {
    type Value = PerDirection;

    fn expecting(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        formatter.write_str("an expression, or {\"x\": .., \"y\": ..} with one for each direction")
    }

    fn visit_f64<E: Error>(self, value: f64) -> Result<PerDirection, E> {
        Ok(PerDirection::Same(Expression::Number(value)))
    }

    fn visit_u64<E: Error>(self, value: u64) -> Result<PerDirection, E> {
        self.visit_f64(value as f64)
    }

    fn visit_i64<E: Error>(self, value: i64) -> Result<PerDirection, E> {
        self.visit_f64(value as f64)
    }

    fn visit_str<E: Error>(self, text: &str) -> Result<PerDirection, E> {
        Ok(PerDirection::Same(Expression::Text(text.into())))
    }

    fn visit_map<A: MapAccess<'de>>(self, access: A) -> Result<PerDirection, A::Error> {
        Directions::deserialize(MapAccessDeserializer::new(access)).map(|each| PerDirection::Each(Box::new(each)))
    }
}
