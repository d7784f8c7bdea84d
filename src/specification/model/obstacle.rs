//! Parabolic obstacle problems on a grid, by the trapezoidal rule with backward differences.

use super::{By, FIXED, Ladder, Model, Request, Sizes, Varied, WithStages, refuse, refuse_impacts};
use crate::checked::Specification;
use crate::error::Errors;
use crate::method::{MethodName, ViSolverName};
use crate::stages::Stages;
use analysis::Analysis;
use models::obstacle::Obstacle;
use problem::{Control, Warning};
use solution::{Diagnostics, Plan, Solution};

/// Measured number of stored values per node of a grid, and per neighbour of a node, in the matrices, their factors
/// and the coarser grids.
const NUMBERS_A_NODE: usize = 60;
const NUMBERS_A_NEIGHBOUR: usize = 6;

impl Model for Obstacle {
    fn state_names(&self) -> Vec<String> {
        vec!["u".to_owned()]
    }

    fn output_names(&self) -> Vec<String> {
        Obstacle::output_names(self)
    }

    fn initial(&self) -> Vec<f64> {
        vec![0.0]
    }

    fn warnings(&self) -> &[Warning] {
        &self.warnings
    }

    fn sizes(&self) -> Sizes {
        let nodes = self.grid.nodes();
        Sizes {
            states: nodes,
            variables: if self.has_obstacle() { nodes } else { 0 },
            constant_jacobian: self.has_constant_operator(),
            ..Sizes::default()
        }
    }

    fn analyse(&self, _t: f64) -> Analysis {
        Obstacle::analyse(self)
    }

    fn check_method(&self, asked: &Request<'_>, errors: &mut Errors) {
        let method = asked.method;
        if !matches!(method.name, MethodName::Auto | MethodName::TrBdf2) {
            refuse("name", "obstacle problems have a method of their own", "`auto` or `tr_bdf2`", errors);
        }
        refuse_impacts(method, errors);
        if method.stages != Stages::Auto {
            refuse("stages", "the method of obstacle problems has two stages", "to be left out", errors);
        }
        if !matches!(method.vi_solver, ViSolverName::Auto | ViSolverName::ActiveSet) {
            let detail = "obstacle problems are solved by the active set method";
            refuse("vi_solver", detail, "`auto` or `active_set`", errors);
        }
    }

    fn no_global_error(&self) -> Option<&'static str> {
        Some("it is estimated per state, and here every node of the grid would be one")
    }

    fn numbers(&self, _specification: &Specification) -> usize {
        let neighbours = 3_usize.pow(self.grid.dimension() as u32);
        self.grid.nodes().saturating_mul(NUMBERS_A_NODE + neighbours * NUMBERS_A_NEIGHBOUR)
    }

    fn describe(&self, specification: &Specification) -> Diagnostics {
        solution::describe_obstacle(self, &specification.obstacle_settings(), specification.analysis())
    }

    fn run(&self, specification: &Specification, plan: &Plan, control: &Control) -> Solution {
        let settings = specification.obstacle_settings();
        solution::integrate_obstacle(self, plan, &settings, specification.analysis(), control)
    }

    fn method_name(&self, _stages: Stages) -> String {
        "tr_bdf2".to_owned()
    }

    fn varied(&self) -> Varied {
        const LADDERS: [Ladder; 2] =
            [Ladder { by: By::Tolerance, name: "", stages: &[] }, Ladder { by: By::Step, name: FIXED, stages: &[] }];
        Varied { tolerance: true, stages: WithStages::Never, reference: By::Step, ladders: &LADDERS, balances: &[] }
    }
}
