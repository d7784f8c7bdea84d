//! The number of stages of a Radau IIA method: a whole number, or `"auto"`.

use serde::de::{Deserialize, Deserializer, Error, Unexpected, Visitor};
use serde::{Serialize, Serializer};
use std::fmt;
use utoipa::openapi::RefOr;
use utoipa::openapi::schema::{ObjectBuilder, OneOfBuilder, Schema, Type};
use utoipa::{PartialSchema, ToSchema};

/// The number of stages of a Radau IIA method.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Stages {
    /// A number of stages that is chosen and adapted to the solution during the solve.
    #[default]
    Auto,
    /// A fixed number of stages of the Radau IIA method, 1 to 9.
    Fixed(u64),
}

impl PartialSchema for Stages {
    fn schema() -> RefOr<Schema> {
        OneOfBuilder::new()
            .item(ObjectBuilder::new().schema_type(Type::Integer).minimum(Some(1)).maximum(Some(9)))
            .item(ObjectBuilder::new().schema_type(Type::String).enum_values(Some(["auto"])))
            .description(Some("A whole number from 1 to 9, or `auto`: chosen and adapted during the solve."))
            .into()
    }
}

impl ToSchema for Stages {}

impl Serialize for Stages {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        match self {
            Self::Auto => serializer.serialize_str("auto"),
            Self::Fixed(stages) => serializer.serialize_u64(*stages),
        }
    }
}

impl<'de> Deserialize<'de> for Stages {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        deserializer.deserialize_any(StagesVisitor)
    }
}

struct StagesVisitor;

impl Visitor<'_> for StagesVisitor {
    type Value = Stages;

    fn expecting(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        formatter.write_str("a whole number from 1 to 9, or \"auto\"")
    }

    fn visit_u64<E: Error>(self, stages: u64) -> Result<Stages, E> {
        Ok(Stages::Fixed(stages))
    }

    fn visit_str<E: Error>(self, text: &str) -> Result<Stages, E> {
        match text {
            "auto" => Ok(Stages::Auto),
            _ => Err(E::invalid_value(Unexpected::Str(text), &self)),
        }
    }
}
