//! Fits of parameters and initial values to data.

use super::choices::choices;
use super::document::Time;
use super::error::{Errors, SpecificationError};
use super::method::{Method, out_of_range};
use super::model::Model;
use super::ordered::Ordered;
use super::pointer::Pointer;
use super::sensitivities::{INITIAL, WITH_MOTIONS, differentiable, differentiable_motion};
use super::varied::check_structure;
use super::wording::{abridged, listed};
use expression::nearest;

use serde::de::{Error, MapAccess, Visitor};
use serde::{Deserialize, Deserializer};
use solution::{By, DataColumn, Fit, Fitted, Loss, Observables, Quantity};
use std::fmt;
use utoipa::openapi::RefOr;
use utoipa::openapi::schema::{AdditionalProperties, ArrayBuilder, ObjectBuilder, OneOfBuilder, Schema, Type};
use utoipa::{PartialSchema, ToSchema};

/// Largest number of data values of a fit, and of fitted parameters.
const MOST_VALUES: usize = 100_000;
const MOST_PARAMETERS: usize = 50;
/// Largest number of starting points from which the parameters of a fit are searched.
const MOST_STARTS: u64 = 1000;

/// Parameters and initial values to fit to data. The answer has `fit`, with estimates, 95 % intervals and the parameter
/// combinations that the data do not determine; the trajectory is the fitted one.
#[derive(Clone, Debug, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct FitRequest {
    /// The fitted quantities: parameters of the problem, and initial values as `x.initial`.
    #[schema(value_type = std::collections::HashMap<String, FitParameter>)]
    pub parameters: Ordered<FitParameter>,
    /// The measured data that the parameters are fitted to.
    pub data: FitData,
    /// The objective that the fit minimises. Default `squares`.
    #[serde(default)]
    pub loss: LossName,
    /// Number of starting points of the search: the first is `initial`, the others are spread over the bounds, which
    /// all parameters must then have. Default 1.
    #[serde(default = "one")]
    #[schema(minimum = 1, maximum = 1000, default = 1)]
    pub starts: u64,
}

fn one() -> u64 {
    1
}

/// The starting value and the bounds of a fitted parameter.
#[derive(Clone, Copy, Debug, Default, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct FitParameter {
    /// Starting value of the search. Default: the value of the parameter in the problem.
    pub initial: Option<f64>,
    /// Lower bound of the parameter.
    pub lower: Option<f64>,
    /// Upper bound of the parameter.
    pub upper: Option<f64>,
}

choices! {
    /// The objective to minimise in a fit.
    LossName {
        "squares" Squares: "The sum of squared residuals."
        "huber" Huber: "Huber's loss: quadratic up to 1.345 `sd` and linear beyond, so that outliers have little \
                        weight."
    }
}

/// Data over time: values of states, and of definitions that depend on states alone, `{"t": [..], "x": [..], "sd":
/// 0.01}`.
#[derive(Clone, Debug)]
pub struct FitData {
    /// Times of the measurements, increasing, within the time horizon.
    pub t: Vec<f64>,
    /// Standard deviations of the data; if absent, all data have equal weight.
    pub sd: Option<Spread>,
    /// Measured values by the name of the state or definition; null where there is no measurement.
    pub columns: Ordered<Vec<Option<f64>>>,
}

/// Standard deviations of the data of a fit.
#[derive(Clone, Debug)]
pub enum Spread {
    /// One standard deviation for all data of the fit.
    Uniform(f64),
    /// Standard deviations of the data of a fit, by column of the data.
    PerState(Ordered<SpreadOfState>),
}

/// Standard deviations of one column of the data of a fit.
#[derive(Clone, Debug)]
pub enum SpreadOfState {
    /// One standard deviation for all values of the column of data.
    Uniform(f64),
    /// One standard deviation per value of the column of data.
    Each(Vec<f64>),
}

impl FitRequest {
    /// Checks the request for a fit of a model; `others` lists incompatible keys, and whether each is present.
    pub(super) fn check(
        &self,
        (model, method, observables): (&dyn Model, &Method, &Observables),
        time: Time,
        others: &[(&'static str, bool)],
        errors: &mut Errors,
    ) -> Option<Fit> {
        let place = Pointer::Root.key("fit");
        let mut found = Errors::default();
        for (other, _) in others.iter().filter(|(_, given)| *given) {
            found.report(&place, "conflict", format!("`{other}` cannot be combined with `fit`"));
        }
        let is_differentiable = match model.mechanical() {
            Some(motion) => differentiable_motion(motion, method, &place, &mut found),
            None => differentiable(model, ("fits are made", WITH_MOTIONS), &place, &mut found).map(|_| ()),
        };
        let states = model.state_names();
        let fit = is_differentiable.map(|()| Fit {
            parameters: self.parameters(model, &states, &place, &mut found),
            t: self.data.t.clone(),
            data: self.data.check((&states, observables), time, &place, &mut found),
            is_scaled: self.data.sd.is_some(),
            loss: match self.loss {
                LossName::Squares => Loss::Squares,
                LossName::Huber => Loss::Huber,
            },
            starts: self.starts,
        });
        if let Some(fit) = &fit {
            self.check_together(fit, &place, &mut found);
        }
        let fit = fit.filter(|_| found.is_empty());
        errors.append(found);
        fit
    }

    fn parameters(&self, model: &dyn Model, states: &[String], place: &Pointer<'_>, found: &mut Errors) -> Vec<Fitted> {
        let place = place.key("parameters");
        let (names, values) =
            model.parameters().map_or((&[][..], &[][..]), |parameters| (parameters.names(), parameters.values()));
        let (initial, begins): (Vec<String>, Vec<f64>) =
            (states.iter().map(|name| format!("{name}{INITIAL}")).collect(), model.initial());
        if self.parameters.is_empty() {
            let error = SpecificationError::new(place.to_string(), "empty", "there is nothing to fit");
            found.push(error.expected("parameters, or initial values such as `x.initial`"));
        }
        if self.parameters.len() > MOST_PARAMETERS {
            let detail = format!("{} parameters", self.parameters.len());
            let error = SpecificationError::new(place.to_string(), "too_many_unknowns", detail);
            found.push(error.expected(format!("at most {MOST_PARAMETERS}")));
        }
        let mut fitted: Vec<Fitted> = Vec::new();
        for (name, given) in self.parameters.iter() {
            let place = place.key(name);
            let all = || names.iter().chain(&initial).map(String::as_str);
            let Some(at) = all().position(|known| known == name) else {
                let detail = format!("there is no parameter or initial value `{}`", abridged(name));
                let error = SpecificationError::new(place.to_string(), "unknown_name", detail);
                found.push(error.expected(listed(all())).did_you_mean(nearest(name, all())));
                continue;
            };
            let (by, default) = match at.checked_sub(names.len()) {
                None => {
                    check_structure(model, at, &place, found);
                    (By::Parameter(at), values.get(at))
                }
                Some(state) => (By::Initial(state), begins.get(state)),
            };
            let begin = given.initial.or(default.copied()).unwrap_or(0.0);
            let lower = given.lower.unwrap_or(f64::NEG_INFINITY);
            let upper = given.upper.unwrap_or(f64::INFINITY);
            if lower >= upper {
                let detail = format!("the lower bound {lower} is not below the upper bound {upper}");
                let error = SpecificationError::new(place.key("lower").to_string(), "out_of_range", detail);
                found.push(error.expected(format!("a number below {upper}")));
            } else if !(lower..=upper).contains(&begin) {
                let detail = format!("the search begins at {begin}, outside the bounds {lower} to {upper}");
                let at = if given.initial.is_some() { place.key("initial").to_string() } else { place.to_string() };
                let error = SpecificationError::new(at, "out_of_range", detail);
                found.push(error.expected("an `initial` within the bounds"));
            }
            if self.starts > 1 && !(lower.is_finite() && upper.is_finite()) {
                let detail = "several starts are spread over the bounds, and this parameter lacks one";
                let error = SpecificationError::new(place.to_string(), "missing_key", detail);
                found.push(error.expected("`lower` and `upper`"));
            }
            fitted.push(Fitted { name: name.to_owned(), by, initial: begin, lower, upper });
        }
        fitted
    }

    fn check_together(&self, fit: &Fit, place: &Pointer<'_>, found: &mut Errors) {
        if !(1..=MOST_STARTS).contains(&self.starts) {
            out_of_range(&place.key("starts"), self.starts as f64, &format!("1 to {MOST_STARTS}"), found);
        }
        let of_data = place.key("data");
        let count = fit.data.iter().flat_map(|column| &column.values).flatten().count();
        let parameters = self.parameters.len();
        if count > MOST_VALUES {
            let error = SpecificationError::new(of_data.to_string(), "too_many_unknowns", format!("{count} values"));
            found.push(error.expected(format!("at most {MOST_VALUES}")));
        }
        let needed = if fit.is_scaled { parameters } else { parameters + 1 };
        if count < needed && found.is_empty() {
            let detail = format!("{count} values do not determine {parameters} parameters");
            let and = if fit.is_scaled { "" } else { ", or one less with `sd`" };
            let error = SpecificationError::new(of_data.to_string(), "too_few_data", detail);
            found.push(error.expected(format!("at least {needed} values{and}")));
        }
        let why = match (fit.is_scaled, fit.loss) {
            (true, _) => return,
            (false, Loss::Huber) => "huber's loss counts residuals in standard deviations, which are not given",
            (false, Loss::Squares) if fit.data.len() > 1 => {
                "several columns are weighed against each other by their standard deviations, which are not given"
            }
            (false, Loss::Squares) => return,
        };
        let error = SpecificationError::new(of_data.to_string(), "missing_key", why);
        found.push(error.expected("`sd`, one number or one for each column: `{\"x\": 0.01, \"v\": 0.1}`"));
    }
}

impl FitData {
    fn check(
        &self,
        (states, observables): (&[String], &Observables),
        time: Time,
        place: &Pointer<'_>,
        found: &mut Errors,
    ) -> Vec<DataColumn> {
        let place = place.key("data");
        // Definitions that depend on variables are not allowed as data of a fit, since sensitivities of variables are
        // not computed.
        let defined = observables
            .names
            .iter()
            .zip(&observables.reach)
            .enumerate()
            .filter(|(_, (_, reach))| **reach <= states.len());
        let defined: Vec<(&str, Quantity)> =
            defined.map(|(k, (name, _))| (name.as_str(), Quantity::Definition(k))).collect();
        let of_states = states.iter().enumerate().map(|(k, name)| (name.as_str(), Quantity::State(k)));
        let all: Vec<(&str, Quantity)> = of_states.chain(defined).collect();
        let names = || all.iter().map(|(name, _)| *name);
        self.check_times(time, &place.key("t"), found);
        if self.columns.is_empty() {
            let error = SpecificationError::new(place.to_string(), "empty", "there are no values");
            found.push(error.expected("a list of values beside `t`, named by its state"));
        }
        if let Some(Spread::PerState(spreads)) = &self.sd {
            let of_sd = place.key("sd");
            for name in spreads.names().filter(|name| !self.columns.names().any(|column| column == *name)) {
                let detail = format!("`{}` is not among the data", abridged(name));
                let error = SpecificationError::new(of_sd.key(name).to_string(), "unknown_name", detail);
                let columns = || self.columns.names();
                found.push(error.expected(listed(columns())).did_you_mean(nearest(name, columns())));
            }
        }
        let mut columns: Vec<DataColumn> = Vec::new();
        for (name, values) in self.columns.iter() {
            let of_column = place.key(name);
            if values.len() != self.t.len() && !self.t.is_empty() {
                let detail = format!("{} values at {} times", values.len(), self.t.len());
                let error = SpecificationError::new(of_column.to_string(), "wrong_count", detail);
                found.push(error.expected("a value for each time, `null` where none was measured"));
            }
            let sd = self.spread(name, &place, found);
            let Some(&(_, of)) = all.iter().find(|(known, _)| *known == name) else {
                let detail = format!("`{}` is neither a state nor a definition of states alone", abridged(name));
                let error = SpecificationError::new(of_column.to_string(), "unknown_name", detail);
                found.push(error.expected(listed(names())).did_you_mean(nearest(name, names())));
                continue;
            };
            if columns.iter().any(|column| column.of == of) {
                found.report(&of_column, "duplicate_name", format!("`{name}` is given already"));
            }
            columns.push(DataColumn { name: name.to_owned(), of, values: values.clone(), sd });
        }
        columns
    }

    fn check_times(&self, time: Time, place: &Pointer<'_>, found: &mut Errors) {
        if self.t.is_empty() {
            let error = SpecificationError::new(place.to_string(), "empty", "there are no times");
            found.push(error.expected("the times of the data, increasing"));
        }
        for (i, t) in self.t.iter().enumerate() {
            let place = place.index(i);
            if !(time.start..=time.end).contains(t) {
                let detail = format!("{t} is outside the time of the run");
                let error = SpecificationError::new(place.to_string(), "out_of_range", detail);
                found.push(error.expected(format!("a time from {} to {}", time.start, time.end)));
            }
            if i > 0 && self.t[i - 1] >= *t {
                let detail = format!("the time {t} does not come after {}", self.t[i - 1]);
                let error = SpecificationError::new(place.to_string(), "not_increasing", detail);
                found.push(error.expected("times that increase; of values at one time their mean"));
            }
        }
    }

    /// Returns the standard deviations of a column of the data of a fit, one per sampling time.
    fn spread(&self, name: &str, place: &Pointer<'_>, found: &mut Errors) -> Vec<f64> {
        let of_sd = place.key("sd");
        let count = self.t.len();
        let mut check = |value: f64, place: &Pointer<'_>| {
            if value <= 0.0 {
                out_of_range(place, value, "above 0", found);
            }
        };
        match &self.sd {
            None => vec![1.0; count],
            Some(Spread::Uniform(value)) => {
                check(*value, &of_sd);
                vec![*value; count]
            }
            Some(Spread::PerState(spreads)) => match spreads.iter().find(|(of, _)| *of == name) {
                Some((_, SpreadOfState::Uniform(value))) => {
                    check(*value, &of_sd.key(name));
                    vec![*value; count]
                }
                Some((_, SpreadOfState::Each(values))) => {
                    let place = of_sd.key(name);
                    values.iter().enumerate().for_each(|(i, value)| check(*value, &place.index(i)));
                    if values.len() != count {
                        let detail = format!("{} standard deviations at {count} times", values.len());
                        found.report(&place, "wrong_count", detail);
                    }
                    let mut values = values.clone();
                    values.resize(count, 1.0);
                    values
                }
                None => {
                    found.report(&of_sd, "missing_key", format!("there is no standard deviation of `{name}`"));
                    vec![1.0; count]
                }
            },
        }
    }
}

impl<'de> Deserialize<'de> for FitData {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        deserializer.deserialize_map(DataVisitor)
    }
}

struct DataVisitor;

impl<'de> Visitor<'de> for DataVisitor {
    type Value = FitData;

    fn expecting(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        formatter.write_str("an object such as {\"t\": [0, 1], \"x\": [1, 0.4], \"sd\": 0.01}")
    }

    fn visit_map<A: MapAccess<'de>>(self, mut access: A) -> Result<FitData, A::Error> {
        let (mut t, mut sd, mut columns) = (None, None, Vec::new());
        while let Some(key) = access.next_key::<String>()? {
            match key.as_str() {
                "t" => t = Some(access.next_value()?),
                "sd" => sd = Some(access.next_value()?),
                _ => columns.push((key, access.next_value()?)),
            }
        }
        let t = t.ok_or_else(|| A::Error::missing_field("t"))?;
        Ok(FitData { t, sd, columns: columns.into_iter().collect() })
    }
}

impl PartialSchema for FitData {
    fn schema() -> RefOr<Schema> {
        let number = || ObjectBuilder::new().schema_type(Type::Number);
        let value = ObjectBuilder::new()
            .schema_type(utoipa::openapi::schema::SchemaType::from_iter([Type::Number, Type::Null]));
        ObjectBuilder::new()
            .schema_type(Type::Object)
            .property("t", ArrayBuilder::new().items(number()).description(Some("The times, increasing.")))
            .property("sd", Spread::schema())
            .required("t")
            .additional_properties(Some(AdditionalProperties::RefOr(ArrayBuilder::new().items(value).into())))
            .description(Some(
                "Values of states, and of definitions in them, over time, `{\"t\": [0, 1], \"x\": [1, 0.4], \"sd\": 0.01}`: a list for each state that was \
                 measured, with null where it was not.",
            ))
            .into()
    }
}

impl ToSchema for FitData {}

impl PartialSchema for Spread {
    fn schema() -> RefOr<Schema> {
        let positive = || ObjectBuilder::new().schema_type(Type::Number).exclusive_minimum(Some(0.0));
        let of_state = OneOfBuilder::new().item(positive()).item(ArrayBuilder::new().items(positive()));
        OneOfBuilder::new()
            .item(positive())
            .item(
                ObjectBuilder::new()
                    .schema_type(Type::Object)
                    .additional_properties(Some(AdditionalProperties::RefOr(of_state.into()))),
            )
            .description(Some(
                "The standard deviation of the values: one number, or by state a number or a list with one for each value. \
                 Where it is absent, it is estimated from the residuals.",
            ))
            .into()
    }
}

impl<'de> Deserialize<'de> for Spread {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        deserializer.deserialize_any(SpreadVisitor)
    }
}

struct SpreadVisitor;

impl<'de> Visitor<'de> for SpreadVisitor {
    type Value = Spread;

    fn expecting(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        formatter.write_str("a number, or an object of numbers or lists by state")
    }

    fn visit_f64<E: Error>(self, value: f64) -> Result<Spread, E> {
        Ok(Spread::Uniform(value))
    }

    fn visit_u64<E: Error>(self, value: u64) -> Result<Spread, E> {
        self.visit_f64(value as f64)
    }

    fn visit_i64<E: Error>(self, value: i64) -> Result<Spread, E> {
        self.visit_f64(value as f64)
    }

    fn visit_map<A: MapAccess<'de>>(self, access: A) -> Result<Spread, A::Error> {
        Ordered::deserialize(serde::de::value::MapAccessDeserializer::new(access)).map(Spread::PerState)
    }
}

impl<'de> Deserialize<'de> for SpreadOfState {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        deserializer.deserialize_any(SpreadOfStateVisitor)
    }
}

struct SpreadOfStateVisitor;

impl<'de> Visitor<'de> for SpreadOfStateVisitor {
    type Value = SpreadOfState;

    fn expecting(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        formatter.write_str("a number, or a list of numbers")
    }

    fn visit_f64<E: Error>(self, value: f64) -> Result<SpreadOfState, E> {
        Ok(SpreadOfState::Uniform(value))
    }

    fn visit_u64<E: Error>(self, value: u64) -> Result<SpreadOfState, E> {
        self.visit_f64(value as f64)
    }

    fn visit_i64<E: Error>(self, value: i64) -> Result<SpreadOfState, E> {
        self.visit_f64(value as f64)
    }

    fn visit_seq<A: serde::de::SeqAccess<'de>>(self, access: A) -> Result<SpreadOfState, A::Error> {
        Vec::deserialize(serde::de::value::SeqAccessDeserializer::new(access)).map(SpreadOfState::Each)
    }
}
