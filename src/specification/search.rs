//! What is looked for in place of a run over a given time: a periodic orbit or a state of rest.

use super::document::Time;
use super::error::{Errors, SpecificationError};
use super::expression::Expression;
use super::lowering::{Lowering, Named, Start};
use super::method::out_of_range;
use super::model::Model;
use super::pointer::Pointer;
use super::sensitivities::differentiable;
use super::wording::{abridged, listed};
use expression::nearest;
use serde::de::value::MapAccessDeserializer;
use serde::de::{Error, MapAccess, Visitor};
use serde::{Deserialize, Deserializer};
use solution::{Fit, Periodic};
use std::fmt;
use std::sync::Arc;
use utoipa::openapi::RefOr;
use utoipa::openapi::schema::{AdditionalProperties, ObjectBuilder, OneOfBuilder, Schema, Type};
use utoipa::{PartialSchema, ToSchema};

/// A periodic orbit: the start is looked for from which the problem comes back to itself, near to the initial values. The answer
/// is a run along it, and `orbit`. Of `time`, which may be left out, `start` alone counts: there the orbit begins.
#[derive(Clone, Debug, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct PeriodicRequest {
    /// The period.
    pub period: Period,
}

/// A period that is given, by what drives the problem, or that is looked for too.
#[derive(Clone, Debug)]
pub enum Period {
    /// A number, or an expression in parameters.
    Given(Expression),
    /// That of a problem which nothing drives.
    Free(FreePeriod),
}

/// A period that is not known beforehand.
#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct FreePeriod {
    /// About how long it is.
    pub free: Expression,
    /// The state that keeps its initial value, as an orbit may begin anywhere on it.
    pub phase: String,
}

/// A state of rest: states and variables that stay as they are, near to the initial values. The answer is `steady_state`. Of
/// `time`, which may be left out, `start` alone counts.
#[derive(Clone, Copy, Debug, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct SteadyStateRequest {}

/// What is looked for.
#[derive(Clone, Debug)]
pub enum Search {
    /// An orbit.
    Periodic(Periodic),
    /// A state of rest.
    SteadyState,
    /// Parameters that fit data.
    Fit(Arc<Fit>),
}

/// What was asked for, before it is checked.
pub(super) struct Request<'a> {
    pub periodic: Option<&'a PeriodicRequest>,
    pub steady_state: Option<SteadyStateRequest>,
}

impl Request<'_> {
    /// The key, where there is one.
    pub fn key(&self) -> Option<&'static str> {
        match (self.periodic, self.steady_state) {
            (Some(_), _) => Some("periodic"),
            (None, Some(_)) => Some("steady_state"),
            (None, None) => None,
        }
    }

    /// The time of a run, or of a search; none where it is missing.
    pub fn time(
        &self,
        given: Option<Time>,
        (named, problem): (Named<'_>, &Pointer<'_>),
        start: Start<'_>,
        errors: &mut Errors,
    ) -> Option<Time> {
        let begin = given.map_or(0.0, |time| time.start);
        let Some(PeriodicRequest { period }) = self.periodic else {
            return match (given, self.steady_state) {
                (Some(time), None) => Some(time),
                (_, Some(_)) => Some(Time { start: begin, end: begin + 1.0 }),
                (None, None) => None,
            };
        };
        let place = Pointer::Root.key("periodic");
        let place = place.key("period");
        let of_free = place.key("free");
        let (expression, place) = match period {
            Period::Given(expression) => (expression, &place),
            Period::Free(FreePeriod { free, .. }) => (free, &of_free),
        };
        let mut lowering = Lowering::new(start, named, problem);
        let period = lowering.constant(expression, place);
        // What is wrong with the problem itself is told where it is lowered.
        let mut found = lowering.errors;
        found.retain(|pointer| pointer.starts_with("/periodic"));
        errors.append(found);
        let end = begin + period?;
        if end > begin && (end - begin).is_finite() {
            return Some(Time { start: begin, end });
        }
        out_of_range(place, period?, "above 0, and finite", errors);
        None
    }

    /// Checks it for a model, with a horizon of a period; `others` are the keys beside it that do not go with it.
    pub fn check(
        &self,
        model: &dyn Model,
        time: Time,
        others: &[(&'static str, bool)],
        errors: &mut Errors,
    ) -> Option<Search> {
        let key = self.key()?;
        let place = Pointer::Root.key(key);
        let mut found = Errors::default();
        if self.periodic.is_some() && self.steady_state.is_some() {
            found.report(&place, "conflict", "one thing is looked for at a time: `periodic` or `steady_state`");
        }
        for (other, _) in others.iter().filter(|(_, given)| *given) {
            found.report(&place, "conflict", format!("`{other}` belongs to a run over a given time"));
        }
        let what = if key == "periodic" { "an orbit is looked for" } else { "a state of rest is looked for" };
        let dvi = differentiable(model, what, &place, &mut found);
        let search = dvi.and_then(|dvi| {
            let Some(PeriodicRequest { period }) = self.periodic else { return Some(Search::SteadyState) };
            let length = time.end - time.start;
            let Period::Free(FreePeriod { phase, .. }) = period else {
                return Some(Search::Periodic(Periodic { period: length, phase: None }));
            };
            let names = || dvi.state_names.iter().map(String::as_str);
            let at = names().position(|name| name == phase);
            if at.is_none() {
                let place = place.key("period");
                let error = SpecificationError::new(
                    place.key("phase").to_string(),
                    "unknown_name",
                    format!("`{}` is not a state", abridged(phase)),
                );
                found.push(error.expected(listed(names())).did_you_mean(nearest(phase, names())));
            }
            Some(Search::Periodic(Periodic { period: length, phase: Some(at?) }))
        });
        let search = search.filter(|_| found.is_empty());
        errors.append(found);
        search
    }
}

impl PartialSchema for Period {
    fn schema() -> RefOr<Schema> {
        let free = ObjectBuilder::new()
            .schema_type(Type::Object)
            .property("free", Expression::schema())
            .property("phase", ObjectBuilder::new().schema_type(Type::String))
            .required("free")
            .required("phase")
            .additional_properties(Some(AdditionalProperties::FreeForm(false)));
        OneOfBuilder::new()
            .item(Expression::schema())
            .item(free)
            .description(Some(
                "The period of what drives the problem, a number or an expression in parameters such as \"1/f\"; or, where \
                 nothing drives it, `{\"free\": 6.3, \"phase\": \"v\"}`: about how long it is, and the state that keeps its \
                 initial value.",
            ))
            .into()
    }
}

impl ToSchema for Period {}

impl<'de> Deserialize<'de> for Period {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        deserializer.deserialize_any(PeriodVisitor)
    }
}

struct PeriodVisitor;

impl<'de> Visitor<'de> for PeriodVisitor {
    type Value = Period;

    fn expecting(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        formatter.write_str("a number, an expression such as \"1/f\", or {\"free\": 6.3, \"phase\": \"v\"}")
    }

    fn visit_f64<E: Error>(self, value: f64) -> Result<Period, E> {
        Ok(Period::Given(Expression::Number(value)))
    }

    fn visit_u64<E: Error>(self, value: u64) -> Result<Period, E> {
        self.visit_f64(value as f64)
    }

    fn visit_i64<E: Error>(self, value: i64) -> Result<Period, E> {
        self.visit_f64(value as f64)
    }

    fn visit_str<E: Error>(self, text: &str) -> Result<Period, E> {
        Ok(Period::Given(Expression::Text(text.to_owned())))
    }

    fn visit_map<A: MapAccess<'de>>(self, access: A) -> Result<Period, A::Error> {
        FreePeriod::deserialize(MapAccessDeserializer::new(access)).map(Period::Free)
    }
}
