//! A static variational inequality, as expressions:
//!
//! ```text
//! z in K,    <G(z), z~ - z> >= 0  for all z~ in K
//! ```
//!
//! Examples are equilibria of traffic or markets, contact at rest, and the optimality conditions of a convex program.

use super::dvi::refused;
use super::error::SpecificationError;
use super::expression::Expression;
use super::lowering::{Lowering, Named, Start};
use super::ordered::Ordered;
use super::pointer::Pointer;
use super::set::{self, Block, LoweredSet};
use super::tables::TableOfPoints;
use super::wording::abridged;
use super::written::{Lowered, Written};
use expression::Node;
use models::{DviModel, Equations, KinkAdvice, Outputs, ParametricTerms, Rows, StaticModel};
use problem::Mass;
use serde::{Deserialize, Serialize};
use std::sync::Arc;
use utoipa::ToSchema;

/// A static variational inequality, without time. The answer is `solution`, with what is known about its uniqueness.
#[derive(Clone, Debug, Deserialize, Serialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct ViProblem {
    /// Constants by name; each may be an expression in the others, without circular references.
    #[serde(default, skip_serializing_if = "Ordered::is_empty")]
    #[schema(value_type = std::collections::BTreeMap<String, Expression>)]
    pub parameters: Ordered<Expression>,
    /// Tables by name: functions of one argument, called as `cost(z)`.
    #[serde(default, skip_serializing_if = "Ordered::is_empty")]
    #[schema(value_type = std::collections::BTreeMap<String, TableOfPoints>)]
    pub tables: Ordered<TableOfPoints>,
    /// Expressions by name, in variables, parameters and each other, without circular references. Each can be reported
    /// as a column, and used by its name in other expressions.
    #[serde(default, skip_serializing_if = "Ordered::is_empty")]
    #[schema(value_type = std::collections::BTreeMap<String, Expression>)]
    pub definitions: Ordered<Expression>,
    /// The variables `z` by name.
    #[schema(value_type = std::collections::BTreeMap<String, StaticVariable>)]
    pub variables: Ordered<StaticVariable>,
    /// The set `K` as a product of blocks; each variable belongs to exactly one block. Bounds are expressions in
    /// parameters.
    pub set: Option<Vec<Block>>,
}

/// A variable `z_i` of a static variational inequality.
#[derive(Clone, Debug, Deserialize, Serialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct StaticVariable {
    /// Starting value of the variable for the solver, an expression in the parameters. Default 0, projected onto the
    /// bounds.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub initial: Option<Expression>,
    /// The component of `G(z)` paired with the variable. For `z_i >= 0` it is nonnegative, and zero while `z_i > 0`;
    /// for a free variable it is zero; between bounds it is nonnegative at the lower bound, nonpositive at the upper
    /// bound, and zero in between.
    pub inequality: Expression,
}

/// The empty list of integrals: a static problem has no time.
static NOTHING: std::sync::LazyLock<Ordered<Expression>> = std::sync::LazyLock::new(Ordered::default);

impl Written for ViProblem {
    fn key(&self) -> &'static str {
        "vi"
    }

    fn named(&self) -> Named<'_> {
        let Self { parameters, tables, definitions, .. } = self;
        Named { parameters, tables, definitions, integrals: &NOTHING }
    }

    fn unknowns(&self) -> usize {
        self.variables.len()
    }

    fn is_static(&self) -> bool {
        true
    }

    fn lower<'c>(&self, place: &Pointer<'_>, start: Start<'c>) -> Lowered<'c> {
        let mut lowering = Lowering::with_inputs(start, self.named(), place);
        let of_variables = place.key("variables");
        if self.variables.is_empty() {
            let error = SpecificationError::new(of_variables.to_string(), "empty", "there are no variables");
            lowering.errors.push(error.expected("at least one variable"));
        }
        let names: Vec<String> = self.variables.names().map(String::from).collect();
        let pointer = |i: usize| of_variables.key(self.variables.name(i)).to_string();
        lowering.bind_unknowns(self.variables.names(), pointer);
        lowering.use_definitions(&self.definitions);
        let mut inequality = Vec::with_capacity(names.len());
        let mut begin = Vec::with_capacity(names.len());
        for (name, variable) in self.variables.iter() {
            let place = of_variables.key(name);
            begin.push(
                variable.initial.as_ref().map_or(0.0, |initial| lowering.initial(initial, &place.key("initial")).0),
            );
            let place = place.key("inequality");
            let node = lowering.node_or_zero(&variable.inequality, &place);
            refuse_time(node, name, &place, &mut lowering);
            inequality.push(node);
        }
        let LoweredSet { set, moving, moving_pointers, parametric } =
            set::lower(self.set.as_deref(), 0, &names, place, pointer, &mut lowering);
        let mut told: Vec<&String> = moving_pointers.iter().collect();
        told.dedup();
        for pointer in told {
            let error = SpecificationError::new(
                pointer.clone(),
                "depends_on_time",
                "a bound of a static problem must be constant",
            );
            lowering.errors.push(error.expected("an expression in the parameters"));
        }
        let rows = Rows { mass: Mass::Identity, rates: Vec::new(), inequality, set, moving };
        let terms = ParametricTerms { bounds: parametric, ..rows.terms() };
        let row = |row: usize| match row.checked_sub(names.len()) {
            Some(bound) => moving_pointers.get(bound).cloned().unwrap_or_default(),
            None => of_variables.key(self.variables.name(row)).key("inequality").to_string(),
        };
        let equations = match Equations::new(&mut lowering.graph, rows) {
            Ok(equations) => equations,
            Err(refusals) => {
                refusals.into_iter().for_each(|refusal| lowering.errors.push(refused(refusal, &[], &names, row)));
                return (lowering, None);
            }
        };
        let parameters = lowering.parameters(terms, &equations.structure().mass);
        let equations = DviModel {
            state_names: Vec::new(),
            variable_names: names,
            outputs: Outputs::default(),
            initial: Vec::new(),
            equations,
            warnings: Vec::new(),
            kinks: KinkAdvice::default(),
            parameters,
        };
        (lowering, Some(Arc::new(StaticModel { equations, start: begin })))
    }
}

fn refuse_time(node: Node, name: &str, place: &Pointer<'_>, lowering: &mut Lowering) {
    if lowering.graph.inputs(node).contains(&0) {
        let detail = format!("the inequality of `{}` depends on `t`, and a static problem has no time", abridged(name));
        let error = SpecificationError::new(place.to_string(), "depends_on_time", detail);
        lowering.errors.push(error.expected("an expression in variables and parameters"));
    }
}
