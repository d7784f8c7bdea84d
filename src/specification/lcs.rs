//! The linear complementarity system
//!
//! ```text
//! M x' = A x + B z + a(t),    z in K(t,x),    G = C x + D z + g(t)
//! ```

use super::error::SpecificationError;
use super::expression::Expression;
use super::lowering::{Lowering, Named, Start};
use super::mass;
use super::matrix::{Entries, Matrix};
use super::ordered::Ordered;
use super::pointer::Pointer;
use super::set::{self, Block};
use super::start;
use super::tables::TableOfPoints;
use super::written::{Lowered, Written};
use expression::Node;
use models::{DviModel, Equations, KinkAdvice, Linear, LinearRows, Outputs, ParametricTerms};
use serde::Deserialize;
use std::sync::Arc;
use utoipa::ToSchema;

/// The linear complementarity system `M x' = A x + B z + a(t)`, `G = C x + D z + g(t)`, `z in K`. Terms left out are
/// zero.
#[derive(Clone, Debug, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
#[expect(non_snake_case, reason = "the matrices go by the names that they have in the formula")]
pub struct LcsProblem {
    /// Constants by name; each may be an expression in the others, without circular references.
    #[serde(default)]
    #[schema(value_type = std::collections::BTreeMap<String, Expression>)]
    pub parameters: Ordered<Expression>,
    /// Tables by name: functions of one argument, called as `load(t)`.
    #[serde(default)]
    #[schema(value_type = std::collections::BTreeMap<String, TableOfPoints>)]
    pub tables: Ordered<TableOfPoints>,
    /// Expressions by name, in states, variables, parameters, `t` and each other, without circular references. Each can be
    /// reported as a column, and used by its name in other expressions.
    #[serde(default)]
    #[schema(value_type = std::collections::BTreeMap<String, Expression>)]
    pub definitions: Ordered<Expression>,
    /// Integrals over time of expressions by name, from zero at the start: further columns.
    #[serde(default)]
    #[schema(value_type = std::collections::BTreeMap<String, Expression>)]
    pub integrals: Ordered<Expression>,
    /// The initial states, as expressions in the parameters; their number is `n`.
    pub initial: Vec<Expression>,
    /// The matrix `A`, `n x n`: effect of the states on the rates.
    pub A: Option<Matrix>,
    /// The matrix `B`, `n x m`: effect of the variables on the rates.
    pub B: Option<Matrix>,
    /// The matrix `C`, `m x n`: effect of the states on the inequalities `G`.
    pub C: Option<Matrix>,
    /// The matrix `D`, `m x m`: effect of the variables on the inequalities `G`.
    pub D: Option<Matrix>,
    /// Forcing of the states: `n` expressions in `t`.
    pub a: Option<Vec<Expression>>,
    /// Forcing of the inequalities: `m` expressions in `t`.
    pub g: Option<Vec<Expression>>,
    /// The set `K` as a product of blocks. Required if there are variables; each variable belongs to exactly one block.
    pub set: Option<Vec<Block>>,
    /// The constant mass matrix `M`, `n x n`; it may be singular. Default: the identity.
    pub mass: Option<Matrix>,
    /// Names of the `n` states. Default `x1`, `x2`, ...
    pub state_names: Option<Vec<String>>,
    /// Names of the `m` variables. Default `z1`, `z2`, ...
    pub variable_names: Option<Vec<String>>,
}

impl LcsProblem {
    /// The number of variables `m`: the number of names, or else the size of the first matrix or forcing that
    /// determines it.
    pub(super) fn variables(&self) -> usize {
        self.variable_names
            .as_ref()
            .map(Vec::len)
            .or_else(|| self.D.as_ref().map(Matrix::rows))
            .or_else(|| self.C.as_ref().map(Matrix::rows))
            .or_else(|| self.g.as_ref().map(Vec::len))
            .or_else(|| self.B.as_ref().map(Matrix::columns))
            .unwrap_or(0)
    }
}

impl Written for LcsProblem {
    fn key(&self) -> &'static str {
        "lcs"
    }

    fn named(&self) -> Named<'_> {
        let Self { parameters, tables, definitions, integrals, .. } = self;
        Named { parameters, tables, definitions, integrals }
    }

    fn unknowns(&self) -> usize {
        self.initial.len() + self.variables()
    }

    fn lower<'c>(&self, place: &Pointer<'_>, start: Start<'c>) -> Lowered<'c> {
        let mut lowering = Lowering::with_inputs(start, self.named(), place);
        let (n, m) = (self.initial.len(), self.variables());
        if n == 0 {
            let error =
                SpecificationError::new(place.key("initial").to_string(), "empty_states", "there are no states");
            lowering.errors.push(error.expected("at least one initial value"));
        }
        let state_names = names(self.state_names.as_deref(), "x", n, &place.key("state_names"), &mut lowering);
        let variable_names = names(self.variable_names.as_deref(), "z", m, &place.key("variable_names"), &mut lowering);
        let name_pointer = |i: usize| match i.checked_sub(n) {
            None => place.key("state_names").index(i).to_string(),
            Some(i) if self.variable_names.is_some() => place.key("variable_names").index(i).to_string(),
            Some(_) => place.to_string(),
        };
        lowering.bind_unknowns(state_names.iter().chain(&variable_names).map(String::as_str), name_pointer);
        let values = self.initial.iter().enumerate();
        let (initial, start_terms) =
            values.map(|(i, value)| lowering.initial(value, &place.key("initial").index(i))).unzip();
        let Entries { values: matrix, terms: parametric } = self.matrix(n, m, place, &mut lowering);
        let state_forcing = forcing(self.a.as_deref(), n, &place.key("a"), &mut lowering);
        let inequality_forcing = forcing(self.g.as_deref(), m, &place.key("g"), &mut lowering);
        let (mass, mass_terms) = mass::lower(self.mass.as_ref(), n, place, &mut lowering);
        let set = set::lower(self.set.as_deref(), n, &variable_names, place, |i| name_pointer(n + i), &mut lowering);
        let pointers = set.moving_pointers;
        let rows = LinearRows {
            mass,
            matrix,
            parametric,
            state_forcing,
            inequality_forcing,
            set: set.set,
            moving: set.moving,
        };
        let terms = ParametricTerms { initial: start_terms, mass: mass_terms, bounds: set.parametric, ..rows.terms() };
        let equations = match Linear::new(&mut lowering.graph, rows) {
            Ok(equations) => Equations::Linear(Box::new(equations)),
            Err((row, error)) => {
                let forcing = |i: usize| place.key("g").index(i).to_string();
                let pointer = pointers.get(row).cloned().unwrap_or_else(|| forcing(row - pointers.len()));
                lowering.errors.push(SpecificationError::new(pointer, error.code, error.message));
                return (lowering, None);
            }
        };
        let parameters = lowering.parameters(terms, &equations.structure().mass);
        let model = DviModel {
            state_names,
            variable_names,
            outputs: Outputs::default(),
            initial,
            equations,
            warnings: Vec::new(),
            kinks: KinkAdvice::default(),
            parameters,
        };
        if let Some(t) = lowering.start.filter(|_| lowering.errors.is_empty()) {
            let pointer = |row: usize| match (row.checked_sub(n), row.checked_sub(n + m)) {
                (_, Some(bound)) => pointers[bound].clone(),
                (Some(i), None) => place.key("g").index(i).to_string(),
                (None, None) => place.key("a").index(row).to_string(),
            };
            start::check(&model, t, pointer, &mut lowering.errors);
        }
        (lowering, Some(Arc::new(model)))
    }
}

impl LcsProblem {
    /// The block matrix `[A B; C D]` of the linear complementarity system, as its nonzero entries.
    fn matrix(&self, n: usize, m: usize, place: &Pointer<'_>, lowering: &mut Lowering) -> Entries {
        let blocks = [
            ("A", &self.A, (0, 0), (n, n)),
            ("B", &self.B, (0, n), (n, m)),
            ("C", &self.C, (n, 0), (m, n)),
            ("D", &self.D, (n, n), (m, m)),
        ];
        let mut matrix = Entries::default();
        for (key, block, (top, left), shape) in blocks {
            let Some(block) = block else { continue };
            let Entries { values, terms } = block.parametric(shape, &place.key(key), lowering);
            matrix.values.extend(values.into_iter().map(|(i, j, value)| (top + i, left + j, value)));
            matrix.terms.extend(terms.into_iter().map(|(i, j, node)| (top + i, left + j, node)));
        }
        matrix
    }
}

fn names(
    given: Option<&[String]>,
    letter: &str,
    count: usize,
    place: &Pointer<'_>,
    lowering: &mut Lowering,
) -> Vec<String> {
    match given {
        Some(names) if names.len() == count => return names.to_vec(),
        Some(names) => wrong_length(place, names.len(), count, lowering),
        None => {}
    }
    (1..=count).map(|i| format!("{letter}{i}")).collect()
}

/// Reads the expressions of a forcing vector, which may only depend on `t`, as graph nodes; zeros if the vector is
/// absent.
fn forcing(given: Option<&[Expression]>, count: usize, place: &Pointer<'_>, lowering: &mut Lowering) -> Vec<Node> {
    let zero = lowering.graph.constant(0.0);
    let given = given.unwrap_or_default();
    if !given.is_empty() && given.len() != count {
        wrong_length(place, given.len(), count, lowering);
    }
    let mut nodes: Vec<Node> = given
        .iter()
        .enumerate()
        .map(|(i, expression)| {
            let place = place.index(i);
            let node = lowering.node(expression, &place).unwrap_or(zero);
            if lowering.graph.inputs(node).into_iter().any(|input| input > 0) {
                let detail =
                    "a forcing depends on `t` alone; write terms in the states or variables as entries of the matrices";
                lowering.errors.report(&place, "forcing_depends_on_unknown", detail);
            }
            node
        })
        .collect();
    nodes.resize(count, zero);
    nodes
}

fn wrong_length(place: &Pointer<'_>, found: usize, expected: usize, lowering: &mut Lowering) {
    let detail = format!("expected {expected} entries, got {found}");
    let error = SpecificationError::new(place.to_string(), "wrong_shape", detail);
    lowering.errors.push(error.expected(format!("{expected} entries")));
}
