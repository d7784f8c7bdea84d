//! Absolute tolerances: one number, or one per state by name.

use super::error::{Errors, SpecificationError};
use super::method::{Method, out_of_range};
use super::ordered::Ordered;
use super::pointer::Pointer;
use super::wording::listed;
use expression::nearest;
use serde::de::value::MapAccessDeserializer;
use serde::de::{Deserialize, Deserializer, Error, MapAccess, Visitor};
use std::collections::HashMap;
use std::fmt;
use utoipa::openapi::RefOr;
use utoipa::openapi::schema::{AdditionalProperties, ObjectBuilder, OneOfBuilder, Schema, Type};
use utoipa::{PartialSchema, ToSchema};

/// Absolute tolerances of the states.
#[derive(Clone, Debug)]
pub enum AbsoluteTolerance {
    /// One absolute tolerance for every state.
    Uniform(f64),
    /// Absolute tolerances by the name of the state.
    PerState(Ordered<f64>),
}

/// Default absolute tolerance of a state, as a fraction of the relative tolerance `rtol`.
const FRACTION_OF_RTOL: f64 = 1e-3;

impl Method {
    /// Returns the absolute tolerance of each state.
    pub(super) fn absolute_tolerances(&self, states: &[String], place: &Pointer<'_>, errors: &mut Errors) -> Vec<f64> {
        let place = place.key("atol");
        let mut atol = vec![self.rtol * FRACTION_OF_RTOL; states.len()];
        match &self.atol {
            None => {}
            Some(AbsoluteTolerance::Uniform(value)) => {
                check(*value, &place, errors);
                atol.fill(*value);
            }
            Some(AbsoluteTolerance::PerState(values)) => {
                let positions: HashMap<&str, usize> = states.iter().map(String::as_str).zip(0..).collect();
                for (name, value) in values.iter() {
                    let place = place.key(name);
                    check(*value, &place, errors);
                    match positions.get(name) {
                        Some(&i) => atol[i] = *value,
                        None => errors.push_with(|| unknown_state(name, states, &place)),
                    }
                }
            }
        }
        atol
    }
}

fn check(value: f64, place: &Pointer<'_>, errors: &mut Errors) {
    if value <= 0.0 {
        out_of_range(place, value, "above 0", errors);
    }
}

fn unknown_state(name: &str, states: &[String], place: &Pointer<'_>) -> SpecificationError {
    let names = || states.iter().map(String::as_str);
    SpecificationError::new(place.to_string(), "unknown_name", format!("`{name}` is not a state"))
        .expected(listed(names()))
        .did_you_mean(nearest(name, names()))
}

impl PartialSchema for AbsoluteTolerance {
    fn schema() -> RefOr<Schema> {
        let positive = || ObjectBuilder::new().schema_type(Type::Number).exclusive_minimum(Some(0.0));
        OneOfBuilder::new()
            .item(positive())
            .item(
                ObjectBuilder::new()
                    .schema_type(Type::Object)
                    .additional_properties(Some(AdditionalProperties::RefOr(positive().into()))),
            )
            .description(Some("One number for every state, or one for each by its name."))
            .into()
    }
}

impl ToSchema for AbsoluteTolerance {}

impl<'de> Deserialize<'de> for AbsoluteTolerance {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        deserializer.deserialize_any(ToleranceVisitor)
    }
}

struct ToleranceVisitor;

impl<'de> Visitor<'de> for ToleranceVisitor {
    type Value = AbsoluteTolerance;

    fn expecting(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        formatter.write_str("a number, or an object of numbers by state")
    }

    fn visit_f64<E: Error>(self, value: f64) -> Result<Self::Value, E> {
        Ok(AbsoluteTolerance::Uniform(value))
    }

    fn visit_u64<E: Error>(self, value: u64) -> Result<Self::Value, E> {
        self.visit_f64(value as f64)
    }

    fn visit_i64<E: Error>(self, value: i64) -> Result<Self::Value, E> {
        self.visit_f64(value as f64)
    }

    fn visit_map<A: MapAccess<'de>>(self, access: A) -> Result<Self::Value, A::Error> {
        Ordered::deserialize(MapAccessDeserializer::new(access)).map(AbsoluteTolerance::PerState)
    }
}
