//! The general form of a differential variational inequality, as expressions:
//!
//! ```text
//! M x' = F(t,x,z),    z in K(t,x),    <G(t,x,z), z~ - z> >= 0  for all z~ in K(t,x)
//! ```
//!
//! A problem without variables is an ordinary differential equation; one with only free variables is
//! differential-algebraic.

use super::as_set;
use super::error::SpecificationError;
use super::expression::Expression;
use super::kinks;
use super::lowering::{Lowering, Named, Start};
use super::mass;
use super::matrix::Matrix;
use super::ordered::Ordered;
use super::pointer::Pointer;
use super::set::{self, Block, LoweredSet};
use super::start;
use super::tables::TableOfPoints;
use super::wording::abridged;
use super::written::{Lowered, Written};
use expression::Node;
use models::{DviModel, Equations, LoweringError, Outputs, ParametricTerms, Rows};
use serde::{Deserialize, Serialize};
use std::sync::Arc;
use utoipa::ToSchema;

/// The general form of a differential variational inequality: rates of the states, an inequality for each variable,
/// and the set `K` of the variables.
#[derive(Clone, Debug, Deserialize, Serialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct DviProblem {
    /// Constants by name; each may be an expression in the others, without circular references.
    #[serde(default, skip_serializing_if = "Ordered::is_empty")]
    #[schema(value_type = std::collections::BTreeMap<String, Expression>)]
    pub parameters: Ordered<Expression>,
    /// Tables by name: functions of one argument, called as `load(t)`.
    #[serde(default, skip_serializing_if = "Ordered::is_empty")]
    #[schema(value_type = std::collections::BTreeMap<String, TableOfPoints>)]
    pub tables: Ordered<TableOfPoints>,
    /// Expressions by name, in states, variables, parameters, `t` and each other, without circular references. Each can be
    /// reported as a column, and used by its name in other expressions.
    #[serde(default, skip_serializing_if = "Ordered::is_empty")]
    #[schema(value_type = std::collections::BTreeMap<String, Expression>)]
    pub definitions: Ordered<Expression>,
    /// Integrals over time of expressions by name, from zero at the start: further columns.
    #[serde(default, skip_serializing_if = "Ordered::is_empty")]
    #[schema(value_type = std::collections::BTreeMap<String, Expression>)]
    pub integrals: Ordered<Expression>,
    /// The states `x` by name, at least one. The outputs are in the order of the states.
    #[schema(value_type = std::collections::BTreeMap<String, State>)]
    pub states: Ordered<State>,
    /// The variables `z` by name. None for an ordinary differential equation.
    #[serde(default)]
    #[schema(value_type = std::collections::BTreeMap<String, Variable>)]
    pub variables: Ordered<Variable>,
    /// The set `K` as a product of blocks. Required if there are variables; each variable belongs to exactly one block.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub set: Option<Vec<Block>>,
    /// The constant mass matrix `M`, as many rows and columns as states; it may be singular. Default: the identity.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub mass: Option<Matrix>,
}

/// A state `x_i` of a differential variational inequality.
#[derive(Clone, Debug, Deserialize, Serialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct State {
    /// Initial value of the state, an expression in the parameters.
    pub initial: Expression,
    /// Rate of the state: row `i` of `F` in `M x' = F(t,x,z)`. It must be affine in the variables, which is checked.
    pub rate: Expression,
}

/// A variable `z_i` of a differential variational inequality.
#[derive(Clone, Debug, Deserialize, Serialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct Variable {
    /// The component of `G(t,x,z)` paired with the variable. For `z_i >= 0` it is nonnegative, and zero while `z_i >
    /// 0`; for a free variable it is zero; between bounds it is nonnegative at the lower bound, nonpositive at the
    /// upper bound, and zero in between.
    pub inequality: Expression,
}

impl Written for DviProblem {
    fn key(&self) -> &'static str {
        "dvi"
    }

    fn named(&self) -> Named<'_> {
        let Self { parameters, tables, definitions, integrals, .. } = self;
        Named { parameters, tables, definitions, integrals }
    }

    fn unknowns(&self) -> usize {
        self.states.len() + self.variables.len()
    }

    fn lower<'c>(&self, place: &Pointer<'_>, start: Start<'c>) -> Lowered<'c> {
        let mut lowering = Lowering::with_inputs(start, self.named(), place);
        let (n, m) = (self.states.len(), self.variables.len());
        if n == 0 {
            let error = SpecificationError::new(place.key("states").to_string(), "empty_states", "there are no states");
            lowering.errors.push(error.expected("at least one state"));
        }
        let state_names: Vec<String> = self.states.names().map(String::from).collect();
        let variable_names: Vec<String> = self.variables.names().map(String::from).collect();
        lowering.bind_unknowns(self.states.names().chain(self.variables.names()), |i| {
            let (section, name) = match i.checked_sub(n) {
                None => ("states", self.states.name(i)),
                Some(i) => ("variables", self.variables.name(i)),
            };
            place.key(section).key(name).to_string()
        });
        lowering.use_definitions(&self.definitions);
        let (initial, start_terms) = self.initial(place, &mut lowering);
        let rates = self.rates(place, &mut lowering);
        let inequality = self.inequality(place, &mut lowering);
        let (mass, mass_terms) = mass::lower(self.mass.as_ref(), n, place, &mut lowering);
        let variable_pointer = |i: usize| place.key("variables").key(self.variables.name(i)).to_string();
        let LoweredSet { set, moving, moving_pointers, parametric } =
            set::lower(self.set.as_deref(), n, &variable_names, place, variable_pointer, &mut lowering);
        let warnings = self
            .states
            .names()
            .zip(&rates)
            .flat_map(|(name, &rate)| kinks::warnings(name, rate, &state_names, &lowering.graph))
            .collect();
        let rows = Rows { mass, rates, inequality, set, moving };
        let terms = ParametricTerms { initial: start_terms, mass: mass_terms, bounds: parametric, ..rows.terms() };
        let row_pointer = |row: usize| match (row.checked_sub(n), row.checked_sub(n + m)) {
            (_, Some(bound)) => moving_pointers[bound].clone(),
            (Some(i), None) => place.key("variables").key(self.variables.name(i)).key("inequality").to_string(),
            (None, None) => place.key("states").key(self.states.name(row)).key("rate").to_string(),
        };
        let equations = match Equations::new(&mut lowering.graph, rows) {
            Ok(equations) => equations,
            Err(refusals) => {
                for refusal in refusals {
                    lowering.errors.push(refused(refusal, &state_names, &variable_names, row_pointer));
                }
                return (lowering, None);
            }
        };
        let kinks = kinks::advice(&equations, &state_names, &variable_names, || self.as_set(start));
        let outputs = Outputs::default();
        let parameters = lowering.parameters(terms, &equations.structure().mass);
        let model = DviModel { state_names, variable_names, outputs, initial, equations, warnings, kinks, parameters };
        if let Some(t) = lowering.start.filter(|_| lowering.errors.is_empty()) {
            start::check(&model, t, row_pointer, &mut lowering.errors);
        }
        (lowering, Some(Arc::new(model)))
    }
}

impl DviProblem {
    /// Returns the problem as JSON with its kinks (functions such as `abs`) rewritten by variables in a set, if
    /// possible.
    fn as_set(&self, start: Start<'_>) -> Option<String> {
        let problem = as_set::rewritten(self)?;
        let (lowering, model) = problem.lower(&Pointer::Root, start);
        model.filter(|_| lowering.errors.is_empty())?;
        serde_json::to_string(&problem).ok().map(|problem| format!("{{\"dvi\":{problem}}}"))
    }

    fn initial(&self, place: &Pointer<'_>, lowering: &mut Lowering) -> (Vec<f64>, Vec<Node>) {
        let place = place.key("states");
        self.states
            .iter()
            .map(|(name, state)| lowering.initial(&state.initial, &place.key(name).key("initial")))
            .unzip()
    }

    fn rates(&self, place: &Pointer<'_>, lowering: &mut Lowering) -> Vec<Node> {
        let place = place.key("states");
        self.states
            .iter()
            .map(|(name, state)| lowering.node_or_zero(&state.rate, &place.key(name).key("rate")))
            .collect()
    }

    fn inequality(&self, place: &Pointer<'_>, lowering: &mut Lowering) -> Vec<Node> {
        let place = place.key("variables");
        self.variables
            .iter()
            .map(|(name, variable)| lowering.node_or_zero(&variable.inequality, &place.key(name).key("inequality")))
            .collect()
    }
}

pub(super) fn refused(
    refusal: LoweringError,
    states: &[String],
    variables: &[String],
    pointer: impl Fn(usize) -> String,
) -> SpecificationError {
    match refusal {
        LoweringError::NotAffine { rate, variable } => {
            let (state, variable) = (abridged(&states[rate]), abridged(&variables[variable]));
            let detail = format!(
                "the rate of `{state}` is not affine in the variables: its derivative with respect to `{variable}` \
                 depends on them"
            );
            SpecificationError::new(pointer(rate), "rate_not_affine", detail)
                .expected("f(t,x) + B(t,x) z; write a nonlinear law as an `inequality`")
        }
        LoweringError::Derivative { row, error } => {
            SpecificationError::new(pointer(row), error.code, error.message).did_you_mean(error.did_you_mean)
        }
    }
}
