//! A problem with memory: an inequality for the convolution of the variables with a kernel. The equations are those of
//! [`models::ConvolutionModel`](models::ConvolutionModel).

mod kernel;
mod plan;

pub(super) use plan::{check, numbers, plan_of};

use super::dvi::refused;
use super::error::SpecificationError;
use super::expression::Expression;
use super::lowering::{Lowering, Named, Start};
use super::matrix::Matrix;
use super::model::Model;
use super::ordered::Ordered;
use super::pointer::Pointer;
use super::set::{self, Block, LoweredSet};
use super::start;
use super::tables::TableOfPoints;
use super::written::{Lowered, Written};
use models::{ConvolutionModel, DviModel, Equations, KinkAdvice, Outputs, Rows};
use problem::{Mass, Workspace};
use serde::Deserialize;
use solution::Warning;
use std::sync::Arc;
use utoipa::ToSchema;

/// `z in K`, `<(m * z)(t) + q(t), z~ - z> >= 0` for all `z~ in K`, with `(m * z)(t)` the integral of `m(t - s) z(s)`
/// over `s` from the start to `t`. The outputs are `z`, its integral and `G = m * z + q`.
#[derive(Clone, Debug, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct ConvolutionProblem {
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
    /// The variables `z` by name, at least one. Their order is that of the rows and columns of the kernel.
    #[schema(value_type = std::collections::BTreeMap<String, ConvolutionVariable>)]
    pub variables: Ordered<ConvolutionVariable>,
    /// The kernel `m` of the convolution.
    pub kernel: KernelOfTime,
    /// The set `K` as a product of blocks, each variable in exactly one; bounds may vary with `t`.
    pub set: Option<Vec<Block>>,
}

/// A variable `z_i` of a problem with memory.
#[derive(Clone, Debug, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct ConvolutionVariable {
    /// The forcing `q_i` of the inequality of the variable, an expression in `t`.
    pub q: Expression,
}

/// The kernel of a problem with memory: either `fractional` or `entries`.
#[derive(Clone, Debug, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct KernelOfTime {
    /// A kernel that is a power of time, times a constant matrix.
    pub fractional: Option<FractionalKernel>,
    /// A kernel as a matrix of expressions in `t`, the time between cause and effect; each expression is smooth from
    /// `t = 0` on.
    pub entries: Option<Matrix>,
    /// The exponent `a`, above 0 and at most 2: the kernel is `t^(a-1)` times `entries`. Default 1.
    pub exponent: Option<Expression>,
}

/// The fractional kernel `m(t) = t^(a-1) / Gamma(a) M`.
#[derive(Clone, Debug, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct FractionalKernel {
    /// The exponent `a`, above 0 and at most 2, which is the index of the problem.
    pub exponent: Expression,
    /// The constant matrix `M` of the kernel. Default: the identity.
    pub matrix: Option<Matrix>,
}

impl Written for ConvolutionProblem {
    fn key(&self) -> &'static str {
        "convolution"
    }

    fn named(&self) -> Named<'_> {
        let Self { parameters, tables, definitions, integrals, .. } = self;
        Named { parameters, tables, definitions, integrals }
    }

    fn unknowns(&self) -> usize {
        self.variables.len()
    }

    fn lower<'c>(&self, place: &Pointer<'_>, start: Start<'c>) -> Lowered<'c> {
        let mut lowering = Lowering::new(start, self.named(), place);
        lowering.use_definitions(&self.definitions);
        let m = self.variables.len();
        let variables = place.key("variables");
        if m == 0 {
            let error = SpecificationError::new(variables.to_string(), "empty_variables", "there are no variables");
            lowering.errors.push(error.expected("at least one variable"));
            return (lowering, None);
        }
        // Read the forcing `q` and the kernel before the names of the variables are bound, since neither may depend on
        // variables.
        let mut inequality = Vec::with_capacity(m);
        for (name, variable) in self.variables.iter() {
            inequality.push(lowering.node_or_zero(&variable.q, &variables.key(name).key("q")));
        }
        let kernel = self.kernel.lower(m, &place.key("kernel"), &mut lowering);
        lowering.bind_unknowns(self.variables.names(), |i| variables.key(self.variables.name(i)).to_string());
        let variable_names: Vec<String> = self.variables.names().map(String::from).collect();
        let pointer = |i: usize| variables.key(self.variables.name(i)).to_string();
        let LoweredSet { set, moving, moving_pointers, .. } =
            set::lower(self.set.as_deref(), 0, &variable_names, place, pointer, &mut lowering);

        let rows = Rows { mass: Mass::Identity, rates: Vec::new(), inequality, set, moving };
        let row_pointer = |row: usize| match row.checked_sub(m) {
            Some(bound) => moving_pointers[bound].clone(),
            None => variables.key(self.variables.name(row)).key("q").to_string(),
        };
        let equations = match Equations::new(&mut lowering.graph, rows) {
            Ok(equations) => equations,
            Err(refusals) => {
                for refusal in refusals {
                    lowering.errors.push(refused(refusal, &[], &variable_names, row_pointer));
                }
                return (lowering, None);
            }
        };
        let mut forcing = DviModel {
            state_names: Vec::new(),
            variable_names,
            outputs: Outputs::default(),
            initial: Vec::new(),
            equations,
            warnings: Vec::new(),
            kinks: KinkAdvice::default(),
            parameters: None,
        };
        if let Some(t) = lowering.start.filter(|_| lowering.errors.is_empty()) {
            start::check(&forcing, t, row_pointer, &mut lowering.errors);
            forcing.warnings.extend(impulse(&forcing, t));
        }
        let model = kernel.map(|(kernel, index, at_zero)| {
            Arc::new(ConvolutionModel::new(forcing, kernel, index, at_zero)) as Arc<dyn Model>
        });
        (lowering, model)
    }
}

/// Warns of an impulse at the start, where the memory is empty: `z` minimises `<q, z>` over `K`, and the minimum is
/// attained at no finite point if `-q` lies outside the polar of the recession cone of `K`.
fn impulse(forcing: &DviModel, t: f64) -> Option<Warning> {
    let structure = forcing.structure();
    let (m, mut set) = (structure.variables, structure.set.clone());
    let mut values = vec![0.0; structure.rows()];
    forcing.problem().evaluate(t, &vec![0.0; m], &mut values);
    for (bound, &value) in structure.moving.iter().zip(&values[m..]) {
        bound.place(value, &mut set);
    }
    let against: Vec<f64> = values[..m].iter().map(|q| -q).collect();
    let unbounded = !set.support(&against, &mut Workspace::default()).is_finite();
    unbounded.then(|| Warning {
        code: "impulse_at_start",
        message:
            "at the start, where the memory is empty, `q` alone does not satisfy the inequality: the variables are \
             unbounded there, and their values near the start are means over a step; their integral and `G` converge"
                .to_owned(),
    })
}
