//! Static variational inequalities, by the portfolio of solvers.

use super::{By, Model, Request, Sizes, Varied, WithStages, refuse, refuse_impacts};
use crate::checked::Specification;
use crate::error::Errors;
use crate::method::MethodName;
use crate::plan::{VI_TOLERANCE, solver};
use crate::stages::Stages;
use analysis::Analysis;
use models::{Parameters, StaticModel, Unbindable};
use problem::{Control, ConvexSet, Warning};
use solution::{Diagnostics, Plan, Solution, StaticPlan};
use std::sync::Arc;

/// Number of stored values per entry of a sparse Jacobian including its factors, at the fill of a grid problem.
const OF_AN_ENTRY: usize = 40;
/// Largest number of variables of a static problem for which solvers allocate dense tableaus.
const TABLEAU: usize = 300;

impl Model for StaticModel {
    fn state_names(&self) -> Vec<String> {
        Vec::new()
    }

    fn output_names(&self) -> Vec<String> {
        self.equations.variable_names.clone()
    }

    fn initial(&self) -> Vec<f64> {
        Vec::new()
    }

    fn warnings(&self) -> &[Warning] {
        &self.equations.warnings
    }

    fn parameters(&self) -> Option<&Parameters> {
        self.equations.parameters.as_ref()
    }

    fn with_parameters(&self, values: &[f64]) -> Result<Arc<dyn Model>, Unbindable> {
        StaticModel::with_parameters(self, values).map(|model| Arc::new(model) as Arc<dyn Model>)
    }

    fn sizes(&self) -> Sizes {
        let structure = self.equations.structure();
        Sizes {
            states: 0,
            variables: structure.variables,
            moving_bounds: 0,
            jacobian_nonzeros: structure.pattern.len(),
            constant_jacobian: structure.constant_jacobian,
        }
    }

    fn set(&self) -> Option<&ConvexSet> {
        Some(&self.equations.structure().set)
    }

    fn analyse(&self, _t: f64) -> Analysis {
        let because = "a static problem: uniqueness is examined at the solution".to_owned();
        Analysis { because, ..Analysis::default() }
    }

    fn check_method(&self, asked: &Request<'_>, errors: &mut Errors) {
        let method = asked.method;
        if method.name != MethodName::Auto {
            refuse("name", "a static problem has no steps", "`auto`, or to be left out", errors);
        }
        if method.stages != Stages::Auto {
            refuse("stages", "a static problem has no stages", "to be left out", errors);
        }
        for (key, given) in [
            ("step", method.step.is_some()),
            ("first_step", method.first_step.is_some()),
            ("max_step", method.max_step.is_some()),
            ("min_step", method.min_step.is_some()),
        ] {
            if given {
                refuse(key, "a static problem has no steps", "to be left out", errors);
            }
        }
        refuse_impacts(method, errors);
    }

    fn no_stop(&self) -> Option<&'static str> {
        Some("a static problem has no time, and so no events")
    }

    fn no_global_error(&self) -> Option<&'static str> {
        Some("a static problem has no time steps whose errors could accumulate; see its residual in `solution`")
    }

    fn numbers(&self, _specification: &Specification) -> usize {
        let structure = self.equations.structure();
        let m = structure.variables;
        let dense = if m <= TABLEAU || structure.set.has_blocks() { m.saturating_mul(m).saturating_mul(6) } else { 0 };
        structure.pattern.len().saturating_mul(OF_AN_ENTRY).saturating_add(dense).saturating_add(20 * m)
    }

    fn describe(&self, _specification: &Specification) -> Diagnostics {
        solution::describe_static(self)
    }

    fn run(&self, specification: &Specification, plan: &Plan, control: &Control) -> Solution {
        let method = specification.method();
        let asked =
            StaticPlan { kind: solver(method.vi_solver), tolerance: method.vi_tolerance.unwrap_or(VI_TOLERANCE) };
        solution::solve_static(self, plan, asked, control)
    }

    fn method_name(&self, _stages: Stages) -> String {
        "static".to_owned()
    }

    fn varied(&self) -> Varied {
        Varied { tolerance: false, stages: WithStages::Never, reference: By::Tolerance, ladders: &[], balances: &[] }
    }
}
