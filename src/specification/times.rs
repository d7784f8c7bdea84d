//! Output times: `"steps"`, `{"count": n}`, `{"every": dt}` or a list.

use serde::de::value::{MapAccessDeserializer, SeqAccessDeserializer};
use serde::de::{Deserialize, Deserializer, Error, MapAccess, SeqAccess, Unexpected, Visitor};
use std::fmt;
use utoipa::openapi::RefOr;
use utoipa::openapi::schema::{AdditionalProperties, ArrayBuilder, ObjectBuilder, OneOfBuilder, Schema, Type};
use utoipa::{PartialSchema, ToSchema};

/// The output times of a trajectory.
#[derive(Clone, Debug, Default)]
pub enum Times {
    /// Output at the end of every accepted step.
    #[default]
    Steps,
    /// Output at a number of equally spaced times, including start and end of the horizon.
    Count(u64),
    /// Output at multiples of an interval from the start, and at the end of the horizon.
    Every(f64),
    /// Output at the times of a list.
    List(Vec<f64>),
}

impl PartialSchema for Times {
    fn schema() -> RefOr<Schema> {
        let rule = |key: &str, value: ObjectBuilder| {
            ObjectBuilder::new()
                .schema_type(Type::Object)
                .property(key, value)
                .required(key)
                .additional_properties(Some(AdditionalProperties::FreeForm(false)))
        };
        let count = ObjectBuilder::new()
            .schema_type(Type::Integer)
            .minimum(Some(2))
            .maximum(Some(2_000_000))
            .description(Some("A number of equally spaced times, including start and end."));
        let every = ObjectBuilder::new()
            .schema_type(Type::Number)
            .exclusive_minimum(Some(0.0))
            .description(Some("An interval: its multiples from the start, and the end."));
        OneOfBuilder::new()
            .item(ObjectBuilder::new().schema_type(Type::String).enum_values(Some(["steps"])))
            .item(rule("count", count))
            .item(rule("every", every))
            .item(ArrayBuilder::new().items(ObjectBuilder::new().schema_type(Type::Number)).min_items(Some(1)))
            .description(Some(
                "`\"steps\"`: the end of every step; `{\"count\": n}`: n equally spaced times, including start and \
                 end; `{\"every\": dt}`: the start, then every `dt`, and the end; or a list of increasing times. \
                 Times between steps cost no extra steps.",
            ))
            .into()
    }
}

impl ToSchema for Times {}

impl<'de> Deserialize<'de> for Times {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        deserializer.deserialize_any(TimesVisitor)
    }
}

struct TimesVisitor;

/// The output times that are written as an object with one key.
#[derive(serde::Deserialize)]
#[serde(rename_all = "snake_case")]
enum Rule {
    Count(u64),
    Every(f64),
}

impl<'de> Visitor<'de> for TimesVisitor {
    type Value = Times;

    fn expecting(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        formatter.write_str("\"steps\", {\"count\": n}, {\"every\": dt} or a list of times")
    }

    fn visit_str<E: Error>(self, text: &str) -> Result<Times, E> {
        match text {
            "steps" => Ok(Times::Steps),
            _ => Err(E::invalid_value(Unexpected::Str(text), &self)),
        }
    }

    fn visit_seq<A: SeqAccess<'de>>(self, access: A) -> Result<Times, A::Error> {
        Vec::deserialize(SeqAccessDeserializer::new(access)).map(Times::List)
    }

    fn visit_map<A: MapAccess<'de>>(self, access: A) -> Result<Times, A::Error> {
        Ok(match Rule::deserialize(MapAccessDeserializer::new(access))? {
            Rule::Count(count) => Times::Count(count),
            Rule::Every(dt) => Times::Every(dt),
        })
    }
}
