//! Problems with memory, by convolution quadrature.

use super::{By, FIXED, Ladder, Model, Request, Sizes, Varied, WithStages, name_of_stages, refuse, refuse_impacts};
use crate::checked::Specification;
use crate::convolution::{self, numbers, plan_of};
use crate::error::Errors;
use crate::method::MethodName;
use crate::stages::Stages;
use analysis::Analysis;
use models::ConvolutionModel;
use problem::{Control, ConvexSet, Warning};
use solution::{Diagnostics, Plan, Solution};

impl Model for ConvolutionModel {
    fn state_names(&self) -> Vec<String> {
        self.forcing.variable_names.clone()
    }

    fn output_names(&self) -> Vec<String> {
        self.output_names.clone()
    }

    fn initial(&self) -> Vec<f64> {
        vec![0.0; self.variables()]
    }

    fn warnings(&self) -> &[Warning] {
        &self.forcing.warnings
    }

    fn sizes(&self) -> Sizes {
        Sizes {
            states: 0,
            variables: self.variables(),
            moving_bounds: self.forcing.structure().moving.len(),
            jacobian_nonzeros: self.at_zero.iter().filter(|entry| **entry != 0.0).count(),
            constant_jacobian: true,
        }
    }

    fn set(&self) -> Option<&ConvexSet> {
        Some(&self.forcing.structure().set)
    }

    fn analyse(&self, _t: f64) -> Analysis {
        ConvolutionModel::analyse(self)
    }

    fn has_theory_of_uniqueness(&self) -> bool {
        true
    }

    fn check_method(&self, asked: &Request<'_>, errors: &mut Errors) {
        convolution::check(self, asked.method, asked.time, errors);
        if !matches!(asked.method.name, MethodName::Auto | MethodName::Convolution) {
            refuse("name", "this problem has a memory", "`auto` or `convolution`", errors);
        }
        refuse_impacts(asked.method, errors);
    }

    fn no_stop(&self) -> Option<&'static str> {
        Some("a problem with memory is solved over its whole time several times, until two runs agree")
    }

    fn no_global_error(&self) -> Option<&'static str> {
        Some("problems with memory have an error estimate only without `step`")
    }

    fn numbers(&self, specification: &Specification) -> usize {
        numbers(self, specification)
    }

    fn describe(&self, specification: &Specification) -> Diagnostics {
        solution::describe_convolution(self, &plan_of(self, specification), specification.analysis())
    }

    fn run(&self, specification: &Specification, plan: &Plan, control: &Control) -> Solution {
        let convolution = plan_of(self, specification);
        solution::integrate_convolution(self, plan, &convolution, specification.analysis(), control)
    }

    fn method_name(&self, stages: Stages) -> String {
        name_of_stages(stages, "convolution")
    }

    fn varied(&self) -> Varied {
        const LADDERS: [Ladder; 1] =
            [Ladder { by: By::Step, name: FIXED, stages: &[Stages::Fixed(1), Stages::Fixed(2), Stages::Fixed(3)] }];
        Varied { tolerance: true, stages: WithStages::Always, reference: By::Step, ladders: &LADDERS, balances: &[] }
    }
}
