//! Mechanical systems in generalised coordinates, by the contact steppers.

use super::{By, FIXED, Ladder, Model, Request, Sizes, Varied, WithStages, refuse};
use crate::checked::Specification;
use crate::error::{Errors, SpecificationError};
use crate::mechanical;
use crate::method::{Impacts, Method, MethodName};
use crate::pointer::Pointer;
use crate::search::Search;
use crate::stages::Stages;
use analysis::Analysis;
use models::{MechanicalModel, Parameters, Unbindable};
use problem::{Control, Warning};
use solution::{BranchOf, ContactPlan, Diagnostics, Plan, Solution};
use std::sync::Arc;

/// Default relative residual of the contact law, small enough that bodies at rest do not creep.
const CONTACT_TOLERANCE: f64 = 1e-12;

/// Measured number of values per coordinate in a run with located impacts: stages and interpolants of smooth arcs,
/// including contact forces, and the events found.
const OF_ARCS: usize = 5000;

impl Model for MechanicalModel {
    fn state_names(&self) -> Vec<String> {
        self.state_names.clone()
    }

    fn output_names(&self) -> Vec<String> {
        self.output_names.clone()
    }

    fn initial(&self) -> Vec<f64> {
        self.initial.clone()
    }

    fn warnings(&self) -> &[Warning] {
        &self.warnings
    }

    fn mechanical(&self) -> Option<&MechanicalModel> {
        Some(self)
    }

    fn parameters(&self) -> Option<&Parameters> {
        self.parameters.as_ref().map(|(parameters, _)| parameters)
    }

    fn with_parameters(&self, values: &[f64]) -> Result<Arc<dyn Model>, Unbindable> {
        MechanicalModel::with_parameters(self, values).map(|model| Arc::new(model) as Arc<dyn Model>)
    }

    fn check_start(&self, t: f64, problem: &Pointer<'_>, errors: &mut Errors) {
        mechanical::check_start(self, t, problem, errors);
    }

    fn sizes(&self) -> Sizes {
        let structure = self.structure();
        Sizes {
            states: 2 * structure.coordinates,
            variables: structure.rows(),
            constant_jacobian: structure.constant_mass && structure.constant_forces,
            ..Sizes::default()
        }
    }

    fn analyse(&self, _t: f64) -> Analysis {
        MechanicalModel::analyse(self)
    }

    fn check_method(&self, asked: &Request<'_>, errors: &mut Errors) {
        let method = asked.method;
        match method.impacts() {
            Impacts::Locate => check_friction(self, errors),
            Impacts::TimeStepping if method.stages != Stages::Auto => {
                let expected = "to be left out, or `impacts` to be `locate`";
                refuse("stages", "time stepping has no stages", expected, errors);
            }
            Impacts::TimeStepping => {}
        }
        refuse_other_methods(method, errors);
    }

    fn no_global_error(&self) -> Option<&'static str> {
        Some(NOT_COMPARED)
    }

    fn runs(&self, specification: &Specification) -> usize {
        if specification.method().impacts() == Impacts::TimeStepping { 2 } else { 1 }
    }

    fn numbers(&self, specification: &Specification) -> usize {
        let structure = self.structure();
        let (n, rows) = (structure.coordinates, structure.rows());
        let located = specification.method().impacts() == Impacts::Locate;
        // A run of a member of a sweep stores neither smooth arcs nor events.
        let of_arcs = if located && specification.sweep().is_none() { OF_ARCS.saturating_mul(n) } else { 0 };
        // Values of the mass matrix, the matrix of an implicit step and two Jacobians, and of the responses to
        // impulses.
        let matrices = n.saturating_mul(n).saturating_mul(4).saturating_add(n.saturating_mul(rows));
        matrices.saturating_add(of_arcs)
    }

    fn describe(&self, specification: &Specification) -> Diagnostics {
        solution::describe_contact(self, &plan_of(specification), specification.analysis())
    }

    fn run(&self, specification: &Specification, plan: &Plan, control: &Control) -> Solution {
        let (contact, analysis) = (plan_of(specification), specification.analysis());
        match (specification.search(), &contact.located) {
            (Some(Search::Periodic(asked, _)), Some(radau)) => {
                solution::find_orbit_of_motion(self, plan, *asked, (&contact, radau), analysis, control)
            }
            (Some(Search::Fit(fit)), Some(radau)) => {
                solution::fit_motion(self, plan, fit, (&contact, radau), analysis, control)
            }
            (Some(Search::Branch(asked)), Some(radau)) => match &asked.of {
                BranchOf::Orbits(periodic, program) => {
                    let of = (&**asked, *periodic, program.as_ref());
                    solution::follow_orbits_of_motion(self, plan, of, (&contact, radau), analysis, control)
                }
                BranchOf::Rests => solution::integrate_contact(self, plan, &contact, analysis, control),
            },
            _ => solution::integrate_contact(self, plan, &contact, analysis, control),
        }
    }

    fn method_name(&self, _stages: Stages) -> String {
        "contact".to_owned()
    }

    fn varied(&self) -> Varied {
        const LADDERS: [Ladder; 2] = [
            Ladder { by: By::Tolerance, name: ", located", stages: &[] },
            Ladder { by: By::Step, name: FIXED, stages: &[] },
        ];
        Varied {
            tolerance: true,
            stages: WithStages::Located,
            reference: By::Tolerance,
            ladders: &LADDERS,
            balances: &[By::Tolerance, By::Step],
        }
    }
}

/// The reason why runs with impacts have no estimate of the global error.
pub(super) const NOT_COMPARED: &str = "runs with impacts at slightly different times cannot be compared at one time";

fn plan_of(specification: &Specification) -> ContactPlan {
    let settings = specification.contact_settings(CONTACT_TOLERANCE);
    let located = specification.method().impacts() == Impacts::Locate;
    ContactPlan { settings, located: located.then(|| specification.settings()) }
}

/// Refuses polyhedral friction cones for located impacts, whose smooth arcs support only the disk.
fn check_friction(model: &MechanicalModel, errors: &mut Errors) {
    let contacts = &model.structure().contacts;
    for k in (0..contacts.len()).filter(|&k| contacts[k].facets.is_some()) {
        let pointer = format!("/problem/mechanical/contacts/{k}/friction/cone");
        let detail = "with located impacts, friction forces must be in a disk";
        let error = SpecificationError::new(pointer, "conflict", detail);
        errors.push(error.expected("`quadratic`, or `time_stepping` with a `step` as the method"));
    }
}

/// Refuses methods of solution that cannot treat impacts.
pub(super) fn refuse_other_methods(method: &Method, errors: &mut Errors) {
    let why = match method.name {
        MethodName::Radau => ("Radau IIA alone does not treat impacts", "`auto` or `contact`"),
        MethodName::TrBdf2 => ("this is the method of obstacle problems", "`auto` or `contact`"),
        MethodName::Convolution => ("this problem has no memory", "`auto`"),
        MethodName::Auto | MethodName::Contact => return,
    };
    refuse("name", why.0, why.1, errors);
}
