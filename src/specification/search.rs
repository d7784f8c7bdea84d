//! Searches in place of a run over a given time: a periodic orbit or a steady state.

use super::document::Time;
use super::error::{Errors, SpecificationError};
use super::expression::Expression;
use super::lowering::{Lowering, Named, Start};
use super::method::{Method, out_of_range};
use super::model::Model;
use super::pointer::Pointer;
use super::sensitivities::{OF_DVI, WITH_MOTIONS, differentiable, differentiable_motion};
use super::varied::check_structure;
use super::wording::{abridged, listed};
use expression::{Tape, nearest};
use problem::ConvexSet;
use serde::de::value::MapAccessDeserializer;
use serde::de::{Error, MapAccess, Visitor};
use serde::{Deserialize, Deserializer};
use solution::{BranchOf, BranchPlan, Fit, Periodic};
use std::fmt;
use std::sync::Arc;
use utoipa::openapi::RefOr;
use utoipa::openapi::schema::{AdditionalProperties, ObjectBuilder, OneOfBuilder, Schema, Type};
use utoipa::{PartialSchema, ToSchema};

/// Search for a periodic orbit: initial values near the given ones from which the solution returns to itself. The
/// answer is a run along the orbit, and `orbit`. `time` is optional, and only its `start`, where the orbit begins, is
/// used.
#[derive(Clone, Debug, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct PeriodicRequest {
    /// The period of the orbit.
    pub period: Period,
    /// Continuation of the periodic orbit over a parameter.
    #[serde(rename = "continue")]
    pub branch: Option<ContinueRequest>,
}

/// Continuation over one parameter by pseudo-arclength, so that the branch may turn back. The answer is `branch`, with
/// its folds, period doublings, torus and Hopf bifurcations, and the points at which an orbit or a steady state meets a
/// contact or a bound that it did not touch before.
#[derive(Clone, Debug, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct ContinueRequest {
    /// Name of the parameter that varies along the branch.
    pub parameter: String,
    /// The value of the parameter at the beginning of the branch. Default: its value in the problem.
    pub from: Option<f64>,
    /// The value of the parameter at which the branch ends, if the branch reaches it.
    pub to: f64,
    /// Largest number of points of the branch, 2 to 10,000. Default 200.
    #[schema(minimum = 2, maximum = 10_000)]
    pub points: Option<u32>,
}

/// The period of an orbit: given by the forcing of the problem, or unknown.
#[derive(Clone, Debug)]
pub enum Period {
    /// A given period of the orbit: a number, or an expression in parameters.
    Given(Expression),
    /// The unknown period of an orbit of an autonomous problem.
    Free(FreePeriod),
}

/// The unknown period of an autonomous problem, by an initial guess and a phase condition.
#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct FreePeriod {
    /// Initial guess of the period of the orbit.
    pub free: Expression,
    /// The state that keeps its initial value, which fixes the phase of the orbit.
    pub phase: String,
}

/// Search for a steady state: constant states and variables, near the initial values. The answer is `steady_state`.
/// `time` is optional, and only its `start` is used.
#[derive(Clone, Debug, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct SteadyStateRequest {
    /// Continuation of the steady state over a parameter.
    #[serde(rename = "continue")]
    pub branch: Option<ContinueRequest>,
}

/// A search that is computed in place of a run over the time horizon.
#[derive(Clone, Debug)]
pub enum Search {
    /// A periodic orbit, with the compiled expression of the period if the period depends on parameters.
    Periodic(Periodic, Option<Tape>),
    /// A steady state of the problem.
    SteadyState,
    /// A branch of periodic orbits or steady states, continued in a parameter.
    Branch(Arc<BranchPlan>),
    /// Parameters of the problem that are fitted to data.
    Fit(Arc<Fit>),
}

impl Search {
    /// Whether the given parameter values change the period of the orbit.
    pub(super) fn changes_period(&self, parameters: &[f64]) -> bool {
        let Self::Periodic(periodic, Some(program)) = self else { return false };
        let (mut program, mut period) = (program.clone(), [0.0]);
        program.bind(parameters);
        program.evaluate(0.0, &[], &mut period);
        period[0] != periodic.period
    }
}

/// The requests for a search in the document (`periodic` and `steady_state`), before they are checked.
pub(super) struct Request<'a> {
    pub periodic: Option<&'a PeriodicRequest>,
    pub steady_state: Option<&'a SteadyStateRequest>,
}

/// Default (`POINTS`) and largest (`MOST_POINTS`) number of points of a branch of orbits or steady states.
const POINTS: u32 = 200;
const MOST_POINTS: u32 = 10_000;

impl<'a> Request<'a> {
    /// Returns the requested continuation of the orbit or steady state, if there is one.
    pub fn branch(&self) -> Option<&'a ContinueRequest> {
        match (self.periodic, self.steady_state) {
            (Some(asked), _) => asked.branch.as_ref(),
            (None, asked) => asked.and_then(|asked| asked.branch.as_ref()),
        }
    }

    /// Returns the key of the requested search in the document, if there is one.
    pub fn key(&self) -> Option<&'static str> {
        match (self.periodic, self.steady_state) {
            (Some(_), _) => Some("periodic"),
            (None, Some(_)) => Some("steady_state"),
            (None, None) => None,
        }
    }

    /// Returns the time horizon of a run or a search, one period for an orbit; `None` if it is missing.
    pub fn time(
        &self,
        given: Option<Time>,
        (named, problem): (Named<'_>, &Pointer<'_>),
        start: Start<'_>,
        errors: &mut Errors,
    ) -> Option<Time> {
        let begin = given.map_or(0.0, |time| time.start);
        let Some(PeriodicRequest { period, .. }) = self.periodic else {
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
        // Errors in the problem itself are reported when the problem is translated to its model.
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

    /// Checks the search for a model, over a horizon of one period; `others` lists incompatible keys, and whether each
    /// is present.
    pub fn check(
        &self,
        (model, method, time): (&dyn Model, &Method, Time),
        (named, problem, start): (Named<'_>, &Pointer<'_>, Start<'_>),
        others: &[(&'static str, bool)],
        errors: &mut Errors,
    ) -> Option<Search> {
        let key = self.key()?;
        let place = Pointer::Root.key(key);
        let mut found = Errors::default();
        if self.periodic.is_some() && self.steady_state.is_some() {
            found.report(&place, "conflict", "`periodic` and `steady_state` cannot be combined");
        }
        let branch = self.branch();
        for (other, _) in others.iter().filter(|(other, given)| *given && (*other != "sweep" || branch.is_some())) {
            let detail = if *other == "sweep" {
                "a branch belongs to one problem, and `sweep` asks for many".to_owned()
            } else {
                format!("`{other}` applies only to a run over a given time")
            };
            found.report(&place, "conflict", detail);
        }
        let states = model.state_names();
        match (model.mechanical(), self.periodic) {
            (Some(motion), Some(_)) => {
                differentiable_motion(motion, method, &place, &mut found);
            }
            (_, Some(_)) => {
                differentiable(model, ("periodic orbits are found", WITH_MOTIONS), &place, &mut found);
            }
            (_, None) => {
                differentiable(model, ("steady states are found", OF_DVI), &place, &mut found);
            }
        }
        let of = match self.periodic {
            None => Some(BranchOf::Rests),
            Some(PeriodicRequest { period, .. }) => {
                let length = time.end - time.start;
                match period {
                    Period::Given(expression) => {
                        let mut lowering = Lowering::with_inputs(start, named, problem);
                        let constant = lowering.parametric(expression, &place.key("period"));
                        let program = constant.and_then(|constant| constant.node);
                        let program = program.map(|node| Tape::compile(&lowering.graph, &[node]));
                        Some(BranchOf::Orbits(Periodic { period: length, phase: None }, program))
                    }
                    Period::Free(FreePeriod { phase, .. }) => {
                        let names = || states.iter().map(String::as_str);
                        let at = names().position(|name| name == phase);
                        if at.is_none() {
                            let place = place.key("period");
                            let detail = format!("`{}` is not a state", abridged(phase));
                            let error = SpecificationError::new(place.key("phase").to_string(), "unknown_name", detail);
                            found.push(error.expected(listed(names())).did_you_mean(nearest(phase, names())));
                        }
                        at.map(|at| BranchOf::Orbits(Periodic { period: length, phase: Some(at) }, None))
                    }
                }
            }
        };
        let search = of.and_then(|of| match branch {
            Some(asked) => asked.check(model, of, &place.key("continue"), &mut found),
            None => Some(match of {
                BranchOf::Rests => Search::SteadyState,
                BranchOf::Orbits(periodic, program) => Search::Periodic(periodic, program),
            }),
        });
        let search = search.filter(|_| found.is_empty());
        errors.append(found);
        search
    }
}

impl ContinueRequest {
    fn check(&self, model: &dyn Model, of: BranchOf, place: &Pointer<'_>, errors: &mut Errors) -> Option<Search> {
        if matches!(of, BranchOf::Rests) && model.set().is_some_and(ConvexSet::has_blocks) {
            let detail = "steady states are continued only if all variables are in intervals";
            let error = SpecificationError::new(place.to_string(), "conflict", detail);
            errors.push(error.expected("a set of intervals, or no `continue`"));
            return None;
        }
        let names = model.parameters().map_or(&[][..], |parameters| parameters.names());
        let values = model.parameters().map_or(&[][..], |parameters| parameters.values());
        let known = || names.iter().map(String::as_str);
        let Some(parameter) = known().position(|name| name == self.parameter) else {
            let detail = format!("`{}` is not a parameter that may vary", abridged(&self.parameter));
            let error = SpecificationError::new(place.key("parameter").to_string(), "unknown_name", detail);
            errors.push(error.expected(listed(known())).did_you_mean(nearest(&self.parameter, known())));
            return None;
        };
        check_structure(model, parameter, &place.key("parameter"), errors);
        let from = self.from.unwrap_or(values[parameter]);
        if from == self.to {
            out_of_range(
                &place.key("to"),
                self.to,
                &format!("another value than {from}, where the branch begins"),
                errors,
            );
            return None;
        }
        let points = self.points.unwrap_or(POINTS);
        if !(2..=MOST_POINTS).contains(&points) {
            out_of_range(&place.key("points"), f64::from(points), &format!("2 to {MOST_POINTS}"), errors);
            return None;
        }
        let name = self.parameter.clone();
        Some(Search::Branch(Arc::new(BranchPlan { of, parameter, name, from, to: self.to, points: points as usize })))
    }
}

impl PartialSchema for Period {
    fn schema() -> RefOr<Schema> {
        let phase = ObjectBuilder::new()
            .schema_type(Type::String)
            .description(Some("The state that keeps its initial value, which fixes the phase of the orbit."));
        let free = ObjectBuilder::new()
            .schema_type(Type::Object)
            .property("free", Expression::schema())
            .property("phase", phase)
            .required("free")
            .required("phase")
            .additional_properties(Some(AdditionalProperties::FreeForm(false)));
        OneOfBuilder::new()
            .item(Expression::schema())
            .item(free)
            .description(Some(
                "The period of the forcing, a number or an expression in parameters such as \"1/f\"; or, for an \
                 autonomous problem, `{\"free\": 6.3, \"phase\": \"v\"}`: an initial guess, and the state that keeps \
                 its initial value.",
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
