//! Differential variational inequalities, by Radau IIA.

use super::{By, FIXED, Ladder, Model, Request, Sizes, Varied, WithStages, name_of_stages, refuse, refuse_impacts};
use crate::checked::Specification;
use crate::error::{Errors, SpecificationError};
use crate::method::MethodName;
use crate::pointer::Pointer;
use crate::search::Search;
use crate::stages::Stages;
use crate::start;
use analysis::{Analysis, analysis_numbers};
use models::{DviModel, Parameters, Unbindable};
use problem::{Control, ConvexSet, Warning};
use radau::run_numbers;
use solution::{BranchOf, Diagnostics, Plan, Solution};
use std::ops::Range;
use std::sync::Arc;

/// Largest number of stages of a run with adaptive order, for the estimate of memory.
const MOST_STAGES: usize = 7;

impl Model for DviModel {
    fn state_names(&self) -> Vec<String> {
        self.state_names.clone()
    }

    fn output_names(&self) -> Vec<String> {
        self.names().cloned().collect()
    }

    fn default_outputs(&self) -> Range<usize> {
        let all = self.names().count();
        if self.outputs.stand_for_unknowns { all - self.outputs.names.len()..all } else { 0..all }
    }

    fn initial(&self) -> Vec<f64> {
        self.initial.clone()
    }

    fn warnings(&self) -> &[Warning] {
        &self.warnings
    }

    fn sizes(&self) -> Sizes {
        let structure = self.structure();
        Sizes {
            states: structure.states,
            variables: structure.variables,
            moving_bounds: structure.moving.len(),
            jacobian_nonzeros: structure.pattern.len(),
            constant_jacobian: structure.constant_jacobian,
        }
    }

    fn set(&self) -> Option<&ConvexSet> {
        Some(&self.structure().set)
    }

    fn dvi(&self) -> Option<&DviModel> {
        Some(self)
    }

    fn parameters(&self) -> Option<&Parameters> {
        self.parameters.as_ref()
    }

    fn with_parameters(&self, values: &[f64]) -> Result<Arc<dyn Model>, Unbindable> {
        DviModel::with_parameters(self, values).map(|model| Arc::new(model) as Arc<dyn Model>)
    }

    fn check_start(&self, t: f64, problem: &Pointer<'_>, errors: &mut Errors) {
        start::check(self, t, |_| problem.to_string(), errors);
    }

    fn analyse(&self, t: f64) -> Analysis {
        DviModel::analyse(self, t)
    }

    fn has_theory_of_uniqueness(&self) -> bool {
        true
    }

    fn check_method(&self, asked: &Request<'_>, errors: &mut Errors) {
        check_index(self, asked, errors);
        match asked.method.name {
            MethodName::Contact | MethodName::TrBdf2 => {
                refuse("name", "this problem has no contacts and no grid", "`auto` or `radau`", errors);
            }
            MethodName::Convolution => refuse("name", "this problem has no memory", "`auto`", errors),
            MethodName::Auto | MethodName::Radau => {}
        }
        refuse_impacts(asked.method, errors);
    }

    fn no_global_error(&self) -> Option<&'static str> {
        None
    }

    fn numbers(&self, specification: &Specification) -> usize {
        let stages = match specification.method().stages {
            Stages::Fixed(stages) => stages as usize,
            Stages::Auto => MOST_STAGES,
        };
        let structure = self.structure();
        // The structural analysis is repeated after the run, on the active faces of `K` that occurred; by then the
        // memory of the solvers is free.
        let analysed = if structure.variables > 0 { analysis_numbers(structure.unknowns()) } else { 0 };
        let run = run_numbers(structure, stages);
        // The sensitivity equations of all stages form one dense matrix.
        let (unknowns, directions) = (stages * structure.unknowns(), specification.directions());
        let derived = if directions > 0 { run + unknowns * (unknowns + 3 * directions) } else { 0 };
        run.max(analysed) + derived
    }

    fn describe(&self, specification: &Specification) -> Diagnostics {
        solution::describe(self.structure(), &specification.settings(), specification.analysis())
    }

    fn run(&self, specification: &Specification, plan: &Plan, control: &Control) -> Solution {
        let (settings, analysis) = (specification.settings(), specification.analysis());
        match specification.search() {
            None => solution::integrate(self, plan, &settings, analysis, control),
            Some(Search::Periodic(asked, _)) => solution::find_orbit(self, plan, *asked, &settings, analysis, control),
            Some(Search::Fit(fit)) => solution::fit(self, plan, fit, &settings, analysis, control),
            Some(Search::SteadyState) => solution::find_steady_state(self, plan, &settings, analysis, control),
            Some(Search::Branch(asked)) => match &asked.of {
                BranchOf::Rests => solution::follow_rests(self, plan, asked, &settings, analysis, control),
                BranchOf::Orbits(periodic, program) => {
                    let of = (&**asked, *periodic, program.as_ref());
                    solution::follow_orbits(self, plan, of, &settings, analysis, control)
                }
            },
        }
    }

    fn method_name(&self, stages: Stages) -> String {
        name_of_stages(stages, "stages chosen")
    }

    fn varied(&self) -> Varied {
        const LADDERS: [Ladder; 2] = [
            Ladder { by: By::Tolerance, name: "", stages: &[Stages::Fixed(3), Stages::Fixed(5), Stages::Auto] },
            Ladder { by: By::Step, name: FIXED, stages: &[Stages::Fixed(1), Stages::Fixed(2), Stages::Fixed(3)] },
        ];
        Varied {
            tolerance: true,
            stages: WithStages::Always,
            reference: By::Tolerance,
            ladders: &LADDERS,
            balances: &[By::Tolerance],
        }
    }
}

/// Refuses problems that no method solves as posed. Only variables in unbounded sets count, since variables in bounded
/// sets have no impulses.
fn check_index(model: &DviModel, asked: &Request<'_>, errors: &mut Errors) {
    let Request { analysis, method, .. } = asked;
    match analysis.unbounded_index {
        Some(index) if index >= 3.0 && !method.accept_index_three => {
            let detail = format!(
                "the index is {index}: the variables appear only in derivative number {index} of the inequalities, so \
                 that solutions exist for special data only, and limits of approximate solutions need not be solutions"
            );
            let expected = "an inequality of lower index (for a velocity in place of a position), or \
                            `\"accept_index_three\": true` in `method`";
            let error = SpecificationError::new("/problem", "index_too_high", detail);
            errors.push(error.expected(expected));
        }
        // Whether the states jump when a bound is reached can only be decided in advance if the Jacobian is constant.
        Some(2.0)
            if model.structure().has_impulses()
                && model.structure().constant_jacobian
                && !(method.step.is_some() && matches!(method.stages, Stages::Fixed(1))) =>
        {
            let detail = "the index is 2 (CB = 0): where a bound is reached the states jump, and only implicit Euler \
                          with a fixed step handles such impulses";
            let error = SpecificationError::new("/method", "index_two_needs_euler", detail);
            errors.push(error.expected("`\"stages\": 1` and a fixed `step`, or the inequality posed for velocities"));
        }
        _ => {}
    }
}
