//! The values collected from each member of a sweep by reducers, such as the maximum of an expression along the dense
//! output or the number of located events.

use crate::error::{Errors, SpecificationError};
use crate::expression::Expression;
use crate::lowering::{Lowering, Named, Start};
use crate::observables::outputs_in;
use crate::ordered::Ordered;
use crate::pointer::Pointer;
use crate::wording::{abridged, listed};
use expression::{Node, Tape, nearest};
use problem::EventKind;
use serde::de::value::MapAccessDeserializer;
use serde::de::{Error, IntoDeserializer, MapAccess, Visitor};
use serde::{Deserialize, Deserializer};
use solution::{Over, Reducers, Reduction};
use std::fmt;
use utoipa::openapi::RefOr;
use utoipa::openapi::schema::{AdditionalProperties, ObjectBuilder, OneOfBuilder, Schema, Type};
use utoipa::{PartialSchema, ToSchema};

/// Largest number of collected columns of the table of a sweep.
const MOST: usize = 1000;

/// A number or a text collected from one run, at the accuracy of the solve: output times have no influence.
#[derive(Clone, Debug, Deserialize, ToSchema)]
#[serde(rename_all = "snake_case")]
pub enum Reducer {
    /// The value at the end of the run, also of an integral or a derivative, given by its name.
    Final(Expression),
    /// The value at the start of the run.
    Initial(Expression),
    /// The minimum of an expression over time.
    Min(Expression),
    /// The maximum of an expression over time.
    Max(Expression),
    /// The maximum minus the minimum of an expression over time.
    Ripple(Expression),
    /// The mean of an expression over time.
    Mean(Expression),
    /// The root mean square of an expression over time.
    Rms(Expression),
    /// The integral of an expression over time.
    Integral(Expression),
    /// The value at a given time.
    At(AtTime),
    /// The number of selected events.
    Count(Selector),
    /// The time of the first of the selected events; missing if there are none.
    TimeOfFirst(Selector),
    /// The time of the last of the selected events; missing if there are none.
    TimeOfLast(Selector),
    /// The sequence of active sets, joined by `>`, such as `F.lower>free>F.upper`; for problems with contacts the
    /// sequence of events, with repetitions as `*n`. A sequence beyond 4 KiB is cut, and a digest of the whole is
    /// appended.
    ModeWord,
}

/// The value of an expression at a given time.
#[derive(Clone, Debug, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct AtTime {
    /// The time of the value, within the horizon.
    pub t: f64,
    /// The expression to evaluate at the time `t`.
    pub of: Expression,
}

/// A selection of events of a run: by kind, and optionally by variable, contact or label.
#[derive(Clone, Debug)]
pub struct Selector {
    kind: EventKind,
    of: Option<String>,
}

/// A selection of events written as a JSON object.
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct InFull {
    kind: EventKind,
    of: Option<String>,
}

impl<'de> Deserialize<'de> for Selector {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        deserializer.deserialize_any(SelectorVisitor)
    }
}

struct SelectorVisitor;

impl<'de> Visitor<'de> for SelectorVisitor {
    type Value = Selector;

    fn expecting(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        formatter.write_str("a kind of events such as \"impact\", or {\"kind\": \"impact\", \"of\": \"floor\"}")
    }

    fn visit_str<E: Error>(self, text: &str) -> Result<Selector, E> {
        Ok(Selector { kind: EventKind::deserialize(text.into_deserializer())?, of: None })
    }

    fn visit_map<A: MapAccess<'de>>(self, access: A) -> Result<Selector, A::Error> {
        InFull::deserialize(MapAccessDeserializer::new(access)).map(|InFull { kind, of }| Selector { kind, of })
    }
}

impl PartialSchema for Selector {
    fn schema() -> RefOr<Schema> {
        let name = || ObjectBuilder::new().schema_type(Type::String);
        let full = ObjectBuilder::new()
            .schema_type(Type::Object)
            .property("kind", EventKind::schema())
            .property("of", name().description(Some("A variable, a contact, or a label of `stop`.")))
            .required("kind")
            .additional_properties(Some(AdditionalProperties::FreeForm(false)));
        OneOfBuilder::new()
            .item(EventKind::schema())
            .item(full)
            .description(Some("The events to select: a kind, or `{\"kind\": \"impact\", \"of\": \"floor\"}`."))
            .into()
    }
}

impl ToSchema for Selector {}

/// The names that the reducers (collected values) of a sweep may refer to.
#[derive(Clone, Copy, Debug)]
pub struct Nameable<'a> {
    /// Names of the outputs of the problem, states first.
    pub outputs: &'a [&'a str],
    /// Number of outputs of the problem that are states.
    pub states: usize,
    /// Definitions, integrals, tables and parameters of the problem.
    pub named: Named<'a>,
    /// The names of the sensitivity columns.
    pub derivatives: &'a [String],
    /// The variables or contacts of the problem that events can belong to, if known.
    pub of_events: Option<&'a [String]>,
    /// The labels of the events in `stop`.
    pub labels: &'a [String],
    /// Whether the parameters are bindable inputs of the model.
    pub are_inputs: bool,
}

/// Compiles the reducers of a sweep; the default is the final values of all states.
pub fn lower(
    asked: Option<&Ordered<Reducer>>,
    nameable: &Nameable<'_>,
    horizon: (f64, f64),
    (problem, start): (&Pointer<'_>, Start<'_>),
    errors: &mut Errors,
) -> Reducers {
    let of_sweep = Pointer::Root.key("sweep");
    let place = of_sweep.key("collect");
    let default: Ordered<Reducer>;
    let asked = match asked {
        Some(asked) => asked,
        None => {
            let states = &nameable.outputs[..nameable.states.min(nameable.outputs.len())];
            default = states
                .iter()
                .map(|&name| (name.to_owned(), Reducer::Final(Expression::Text(name.to_owned()))))
                .collect();
            &default
        }
    };
    if asked.len() > MOST {
        let error =
            SpecificationError::new(place.to_string(), "too_many_unknowns", format!("{} reducers", asked.len()));
        errors.push(error.expected(format!("at most {MOST}")));
        return Reducers::default();
    }
    let named = nameable.named;
    let mut lowering = match nameable.are_inputs {
        true => Lowering::with_inputs(start, named, problem),
        false => Lowering::new(start, named, problem),
    };
    lowering.bind_outputs(nameable.outputs);
    lowering.define(named.definitions, problem);
    let mut lowered = Lowered { lowering, nodes: Vec::new(), nameable, horizon };
    let mut reducers = Reducers::default();
    for (name, reducer) in asked.iter() {
        if let Some(reduction) = lowered.reduction(reducer, &place.key(name)) {
            reducers.names.push(name.to_owned());
            reducers.reductions.push(reduction);
        }
    }
    let Lowered { lowering, nodes, .. } = lowered;
    reducers.program = Tape::compile(&lowering.graph, &nodes);
    reducers.inputs = nodes.iter().map(|&node| outputs_in(&lowering, node)).collect();
    let mut found = lowering.errors;
    // Errors in parameters and definitions are reported when the problem is translated to its model.
    found.retain(|pointer| pointer.starts_with("/sweep"));
    errors.append(found);
    reducers
}

/// The state while the reducers of a sweep are read: their graph nodes so far, the names in scope, and the time
/// horizon.
struct Lowered<'a, 'c> {
    lowering: Lowering<'c>,
    nodes: Vec<Node>,
    nameable: &'a Nameable<'a>,
    horizon: (f64, f64),
}

impl Lowered<'_, '_> {
    fn reduction(&mut self, reducer: &Reducer, place: &Pointer<'_>) -> Option<Reduction> {
        let (expression, over, key) = match reducer {
            Reducer::Final(expression) => (expression, Over::Final, "final"),
            Reducer::Initial(expression) => (expression, Over::Initial, "initial"),
            Reducer::Min(expression) => (expression, Over::Min, "min"),
            Reducer::Max(expression) => (expression, Over::Max, "max"),
            Reducer::Ripple(expression) => (expression, Over::Ripple, "ripple"),
            Reducer::Mean(expression) => (expression, Over::Mean, "mean"),
            Reducer::Rms(expression) => (expression, Over::Rms, "rms"),
            Reducer::Integral(expression) => (expression, Over::Integral, "integral"),
            Reducer::At(AtTime { t, of }) => {
                let (from, to) = self.horizon;
                if !(from..=to).contains(t) {
                    let place = place.key("at");
                    let detail = format!("{t} is outside the time horizon");
                    let error = SpecificationError::new(place.key("t").to_string(), "outside_horizon", detail);
                    self.lowering.errors.push(error.expected(format!("from {from} to {to}")));
                }
                (of, Over::At(*t), "at")
            }
            Reducer::Count(selector) => return self.selected(selector, &place.key("count")).map(Reduction::Count),
            Reducer::TimeOfFirst(selector) => {
                return self.selected(selector, &place.key("time_of_first")).map(Reduction::First);
            }
            Reducer::TimeOfLast(selector) => {
                return self.selected(selector, &place.key("time_of_last")).map(Reduction::Last);
            }
            Reducer::ModeWord => return Some(Reduction::ModeWord),
        };
        let place = place.key(key);
        if let (Expression::Text(text), Over::Final) = (expression, over) {
            if let Some(at) = self.nameable.derivatives.iter().position(|name| name == text.trim()) {
                return Some(Reduction::Derivative(at));
            }
            // The final value of an integral is the integral of its integrand over the time horizon.
            if let Some((_, integrand)) = self.nameable.named.integrals.iter().find(|(name, _)| *name == text.trim()) {
                return self.value(integrand, Over::Integral, &place);
            }
        }
        if let Expression::Text(text) = expression
            && self.nameable.named.integrals.names().any(|name| name == text.trim())
        {
            let detail = format!("`{}` is an integral, which can only be collected at the end", abridged(text));
            let error = SpecificationError::new(place.to_string(), "conflict", detail);
            self.lowering.errors.push(error.expected(format!("{{\"final\": \"{}\"}}", abridged(text.trim()))));
            return None;
        }
        let of = if matches!(reducer, Reducer::At(_)) { place.key("of") } else { place };
        self.value(expression, over, &of)
    }

    fn value(&mut self, expression: &Expression, over: Over, place: &Pointer<'_>) -> Option<Reduction> {
        let node = self.lowering.node(expression, place)?;
        let at = self.nodes.iter().position(|known| *known == node).unwrap_or_else(|| {
            self.nodes.push(node);
            self.nodes.len() - 1
        });
        Some(Reduction::Value { at, over })
    }

    fn selected(&mut self, selector: &Selector, place: &Pointer<'_>) -> Option<solution::Selected> {
        let Selector { kind, of } = selector;
        let Nameable { outputs, states, labels, of_events, .. } = *self.nameable;
        let known: Option<Vec<&str>> = match kind {
            EventKind::Crossed => Some(labels.iter().map(String::as_str).collect()),
            // Events of the kind `Jumped` (jumps of a state) belong to states.
            EventKind::Jumped => Some(outputs[..states].to_vec()),
            _ => of_events.map(|names| names.iter().map(String::as_str).collect()),
        };
        if let (Some(known), Some(of)) = (known, of)
            && !known.contains(&of.as_str())
        {
            let names = || known.iter().copied();
            let detail = format!("there are no events of `{}`", abridged(of));
            let error = SpecificationError::new(place.key("of").to_string(), "unknown_name", detail);
            self.lowering.errors.push(error.expected(listed(names())).did_you_mean(nearest(of, names())));
            return None;
        }
        Some(solution::Selected { kind: *kind, of: of.clone() })
    }
}
