//! User-defined quantities beside the outputs of a problem: `definitions`, `integrals` and `stop`.
//!
//! All of them are expressions in `t`, the parameters, the outputs of the problem and the definitions. Outputs such as
//! `v(C1)` or `ball.x`, whose names are not valid identifiers, are written by these names.

use super::error::{Errors, SpecificationError};
use super::expression::Expression;
use super::label;
use super::lowering::{Lowering, Named, Start};
use super::model::Model;
use super::pointer::Pointer;
use super::sensitivities::Objective;
use super::view::View;
use super::wording::abridged;
use expression::{Node, Tape};
use serde::{Deserialize, Serialize};
use solution::{Argument, Direction, Monitored, ObservableSlopes, Observables};
use utoipa::ToSchema;

/// Largest number of definitions, integrals and event functions together.
const MOST: usize = 10_000;

/// A monitor (event function): where it changes sign, the run ends, or an event is recorded and the run continues.
#[derive(Clone, Debug, Deserialize, Serialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct Stop {
    /// An expression in `t`, parameters, outputs and definitions that changes sign at the event. An expression that
    /// reaches zero and stays there has its event when it reaches zero; leaving zero to the other side is not a
    /// further event, leaving it to the former side is one, and so is leaving zero if the expression has been zero
    /// since the start of the run.
    pub when: Expression,
    /// The sign changes that count, by direction. Default `either`.
    #[serde(default)]
    #[schema(value_type = Direction, default = "either")]
    pub direction: Direction,
    /// Name of the event in the answer. Default: the expression.
    #[schema(max_length = 200)]
    pub label: Option<String>,
    /// Whether to record the event as `crossed` and continue the run.
    #[serde(default)]
    #[schema(default = false)]
    pub record: bool,
}

/// The user's definitions, integrals and events, as written.
pub(super) struct Request<'a> {
    pub named: Named<'a>,
    pub stop: &'a [Stop],
    pub view: Option<&'a View>,
    /// The number of states, if derivatives with respect to states and parameters are requested.
    pub differentiated: Option<usize>,
}

/// Names of the functions with jumps (discontinuities).
const JUMPS: [&str; 6] = ["sign", "heaviside", "floor", "round", "mod", "previous"];

impl Request<'_> {
    /// Compiles the expressions of definitions, integrals and events, which refer to the given outputs by name;
    /// `are_inputs` says whether the parameters are inputs of the graph, so that they can be bound to other values.
    pub fn lower(
        &self,
        outputs: &[&str],
        are_inputs: bool,
        (place, start): (&Pointer<'_>, Start<'_>),
        errors: &mut Errors,
    ) -> Observables {
        let Named { definitions, integrals, .. } = self.named;
        let count = definitions.len() + integrals.len() + self.stop.len();
        if count == 0 && self.view.is_none() {
            return Observables::default();
        }
        if count > MOST {
            let detail = format!("{count} definitions, integrals and entries of `stop`");
            let error = SpecificationError::new(place.to_string(), "too_many_unknowns", detail);
            errors.push(error.expected(format!("at most {MOST}")));
            return Observables::default();
        }
        let mut lowering = match are_inputs {
            true => Lowering::with_inputs(start, self.named, place),
            false => Lowering::new(start, self.named, place),
        };
        lowering.bind_outputs(outputs);
        let mut nodes: Vec<Node> = lowering.define(definitions, place);
        // For each definition, the largest index of the graph inputs that it depends on: input 0 is the time, inputs
        // 1, 2, ... are the outputs of the problem, states first.
        let reach = nodes.iter().map(|&node| lowering.graph.inputs(node).into_iter().max().unwrap_or(0)).collect();
        let of_integrals = place.key("integrals");
        for (name, integrand) in integrals.iter() {
            let place = of_integrals.key(name);
            nodes.push(lowering.node_or_zero(integrand, &place));
        }
        let of_stop = Pointer::Root.key("stop");
        let mut monitors = Vec::with_capacity(self.stop.len());
        for (i, stop) in self.stop.iter().enumerate() {
            let place = of_stop.index(i);
            nodes.push(lowering.node_or_zero(&stop.when, &place.key("when")));
            monitors.push(stop.monitored(&place, &mut lowering.errors));
        }
        // Reserve the names of integrals only now: integrands and event functions cannot refer to integrals, which have
        // no value yet when these are evaluated.
        integrals.iter().for_each(|(name, _)| lowering.keep_name(name, &of_integrals.key(name)));
        if let Some(view) = self.view {
            view.check(&mut lowering);
        }
        let names: Vec<String> = definitions.names().chain(integrals.names()).map(String::from).collect();
        let slopes = self.differentiated.map(|states| {
            let is_integral = |row: usize| row >= definitions.len();
            slopes(&mut lowering, &nodes[..names.len()], states, is_integral)
        });
        let slopes = slopes.unwrap_or_default();
        let program = Tape::compile(&lowering.graph, &nodes);
        let inputs = nodes.iter().map(|&node| outputs_in(&lowering, node)).collect();
        errors.append(lowering.errors);
        Observables { names, integrals: integrals.len(), reach, inputs, monitors, program, slopes }
    }

    /// Compiles the objective of adjoint mode as the only definition or integral. Errors in the definitions that it
    /// uses are reported elsewhere, where the definitions are compiled.
    pub fn lower_objective(
        &self,
        objective: &Objective,
        outputs: &[&str],
        (are_inputs, states): (bool, usize),
        (problem, start): (&Pointer<'_>, Start<'_>),
        errors: &mut Errors,
    ) -> Option<Observables> {
        let mut lowering = match are_inputs {
            true => Lowering::with_inputs(start, self.named, problem),
            false => Lowering::new(start, self.named, problem),
        };
        lowering.bind_outputs(outputs);
        lowering.use_definitions(self.named.definitions);
        lowering.errors = Errors::default();
        let (key, expression) = objective.expression();
        let place = Pointer::Root.key("sensitivities");
        let place = place.key("objective");
        let place = place.key(key);
        let node = lowering.node(expression, &place);
        errors.append(std::mem::take(&mut lowering.errors));
        let node = node?;
        let is_integral = matches!(objective, Objective::Integral(_));
        let slopes = slopes(&mut lowering, &[node], states, |_| is_integral);
        if let Some(why) = slopes.refused[0] {
            let detail = format!("the objective has no derivative here: {why}");
            let error = SpecificationError::new(place.to_string(), "conflict", detail);
            errors.push(error.expected(
                "an expression in states, definitions, parameters and `t`, without jumps where it is integrated",
            ));
            return None;
        }
        let reach = vec![lowering.graph.inputs(node).into_iter().max().unwrap_or(0)];
        Some(Observables {
            names: vec!["objective".to_owned()],
            integrals: usize::from(is_integral),
            reach: if is_integral { Vec::new() } else { reach },
            inputs: vec![outputs_in(&lowering, node)],
            monitors: Vec::new(),
            program: Tape::compile(&lowering.graph, &[node]),
            slopes,
        })
    }

    /// Refuses events that end the run early where the problem or another request needs the whole run.
    pub fn check(&self, model: &dyn Model, (global_error, study, adjoint): (bool, bool, bool), errors: &mut Errors) {
        let Some(i) = self.stop.iter().position(|stop| !stop.record) else { return };
        let why = match model.no_stop() {
            Some(why) => why,
            None if global_error => "`output.global_error` compares two runs at `time.end`",
            None if adjoint => {
                "the gradient of adjoint mode is that of a run to `time.end`, and a `stop` ends it elsewhere"
            }
            None if study => "a `study` compares runs at `time.end`",
            None => return,
        };
        let error = SpecificationError::new(Pointer::Root.key("stop").index(i).to_string(), "conflict", why);
        errors.push(error.expected("`\"record\": true`, which only records the event, or no `stop`"));
    }
}

/// Returns the outputs of the problem that a node depends on. Input 0 of the expression graph is the time, input
/// `k + 1` is output `k`.
pub(super) fn outputs_in(lowering: &Lowering<'_>, node: Node) -> Vec<usize> {
    lowering.graph.inputs(node).into_iter().filter_map(|input| input.checked_sub(1)).collect()
}

/// Returns the derivatives of definitions and integrands with respect to the states and the parameters, or why they
/// have none.
fn slopes(
    lowering: &mut Lowering<'_>,
    nodes: &[Node],
    states: usize,
    is_integral: impl Fn(usize) -> bool,
) -> ObservableSlopes {
    let (mut pattern, mut terms, mut refused) = (Vec::new(), Vec::new(), Vec::new());
    for (row, &node) in nodes.iter().enumerate() {
        let graph = &mut lowering.graph;
        let jumps = || graph.kinks(node).iter().any(|(name, _)| JUMPS.contains(name));
        if graph.inputs(node).into_iter().max().unwrap_or(0) > states {
            refused.push(Some("it depends on more than states"));
            continue;
        }
        if is_integral(row) && jumps() {
            refused.push(Some("its integrand jumps"));
            continue;
        }
        let (Ok(by_inputs), Ok(by_parameters)) = (graph.gradient(node), graph.gradient_by_parameters(node)) else {
            refused.push(Some("its derivative is too long"));
            continue;
        };
        // Input 0 of the expression graph is the time, and input `i + 1` is state `i`.
        let by_states = by_inputs.into_iter().filter(|(input, _)| *input > 0);
        let by_states = by_states.map(|(input, node)| (Argument::State(input - 1), node));
        let by_parameters = by_parameters.into_iter().map(|(parameter, node)| (Argument::Parameter(parameter), node));
        for (argument, node) in by_states.chain(by_parameters) {
            pattern.push((row, argument));
            terms.push(node);
        }
        refused.push(None);
    }
    ObservableSlopes { pattern, program: Tape::compile(&lowering.graph, &terms), refused }
}

impl Stop {
    fn monitored(&self, place: &Pointer<'_>, errors: &mut Errors) -> Monitored {
        let label = self.label.clone().unwrap_or_else(|| match &self.when {
            Expression::Number(value) => value.to_string(),
            Expression::Text(text) => abridged(text).to_string(),
        });
        label::check(self.label.as_deref(), &place.key("label"), errors);
        if let Expression::Number(_) = self.when {
            let error =
                SpecificationError::new(place.key("when").to_string(), "constant", "a number never changes its sign");
            errors.push(error.expected("an expression that is zero where the run is to end, such as \"x - 1\""));
        }
        Monitored { label, direction: self.direction, ends: !self.record }
    }
}
