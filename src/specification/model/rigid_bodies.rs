//! Rigid bodies in space, by time stepping or with located impacts.

use super::mechanical::{NOT_COMPARED, refuse_other_methods};
use super::{By, FIXED, Ladder, Model, Request, Sizes, Varied, WithStages, refuse};
use crate::checked::Specification;
use crate::error::Errors;
use crate::method::{Impacts, Switches, ViSolverName};
use crate::stages::Stages;
use analysis::Analysis;
use models::rigid_bodies::{Body, Load, MultibodySystem};
use problem::{Control, Warning};
use solution::{Diagnostics, Plan, Solution};

/// Default relative residual of the contact law: many redundant contacts do not allow more digits.
const TOLERANCE: f64 = 1e-10;
/// The estimate of memory for contacts stops counting at this multiple of the memory limit, since the solve is
/// certain not to fit.
const FAR_BEYOND: usize = 1000;
/// Largest number of bytes up to which the estimate of memory for contacts counts, the size of the address space.
const ENOUGH: usize = 1 << 47;
/// Number of values in the state of a body: position, quaternion, velocity, angular velocity.
const NUMBERS_A_BODY: usize = 13;
/// Number of values stored for each output in the comparison of a run with a run of longer steps: the sums of the
/// output over time, and its values in the steps compared.
const NUMBERS_COMPARED: usize = 50;

impl Model for MultibodySystem {
    fn state_names(&self) -> Vec<String> {
        MultibodySystem::state_names(self)
    }

    fn output_names(&self) -> Vec<String> {
        MultibodySystem::output_names(self)
    }

    fn initial(&self) -> Vec<f64> {
        MultibodySystem::initial(self)
    }

    fn warnings(&self) -> &[Warning] {
        &self.warnings
    }

    fn sizes(&self) -> Sizes {
        Sizes { states: MultibodySystem::state_names(self).len(), ..Sizes::default() }
    }

    fn analyse(&self, _t: f64) -> Analysis {
        MultibodySystem::analyse(self)
    }

    fn check_method(&self, asked: &Request<'_>, errors: &mut Errors) {
        let method = asked.method;
        if method.impacts == Some(Impacts::Locate)
            && let Some(reason) = not_located(self)
        {
            let detail = format!("impacts cannot be located: {reason}");
            refuse("impacts", &detail, "`time_stepping`, or to be left out", errors);
        }
        for key in method.error_controls() {
            let detail = "rigid bodies are stepped with a fixed step, without an error estimate";
            refuse(key, detail, "`step` alone", errors);
        }
        let choices = [
            ("stages", method.stages != Stages::Auto, "the steppers of rigid bodies have no stages to choose"),
            (
                "switches",
                method.switches != Switches::default(),
                "the fixed steps of rigid bodies step over all events",
            ),
            (
                "accept_index_three",
                method.accept_index_three,
                "rigid bodies are not solved as a problem of index three",
            ),
        ];
        for (key, _, detail) in choices.into_iter().filter(|(_, given, _)| *given) {
            refuse(key, detail, "to be left out", errors);
        }
        if method.vi_solver != ViSolverName::Auto {
            let detail = "the contact law has its own solvers";
            refuse("vi_solver", detail, "`auto`, or to be left out", errors);
        }
        refuse_other_methods(method, errors);
    }

    fn no_global_error(&self) -> Option<&'static str> {
        Some(NOT_COMPARED)
    }

    fn load(&self, most: usize, control: &Control) -> Load {
        MultibodySystem::load(self, most.saturating_mul(FAR_BEYOND).min(ENOUGH), control).unwrap_or_default()
    }

    fn runs(&self, _specification: &Specification) -> usize {
        if moving(self).count() <= solution::MOST_COMPARED { 2 } else { 1 }
    }

    fn numbers(&self, specification: &Specification) -> usize {
        // Two states of all bodies and the changes of these states; for each output, the values stored to compare the
        // run with a run of longer steps.
        let outputs = if self.runs(specification) > 1 { self.output_names().len() } else { 0 };
        let compared = NUMBERS_COMPARED * outputs;
        4 * NUMBERS_A_BODY * self.bodies.len() + compared
    }

    fn describe(&self, specification: &Specification) -> Diagnostics {
        let (settings, impacts) = (specification.contact_settings(TOLERANCE), impacts(self, specification));
        solution::describe_rigid_bodies(self, (&settings, impacts), specification.analysis())
    }

    fn run(&self, specification: &Specification, plan: &Plan, control: &Control) -> Solution {
        let (settings, impacts) = (specification.contact_settings(TOLERANCE), impacts(self, specification));
        solution::step_rigid_bodies(self, plan, (&settings, impacts), specification.analysis(), control)
    }

    fn method_name(&self, _stages: Stages) -> String {
        "contact".to_owned()
    }

    fn varied(&self) -> Varied {
        const LADDERS: [Ladder; 1] = [Ladder { by: By::Step, name: FIXED, stages: &[] }];
        Varied {
            tolerance: false,
            stages: WithStages::Never,
            reference: By::Step,
            ladders: &LADDERS,
            balances: &[By::Step],
        }
    }
}

/// Returns the bodies of a scene that move by forces.
fn moving(scene: &MultibodySystem) -> impl Iterator<Item = &Body> {
    scene.bodies.iter().filter(|body| !body.fixed)
}

/// Returns the reason why impacts of a multibody system cannot be located, if there is one.
fn not_located(scene: &MultibodySystem) -> Option<&'static str> {
    let reasons = [
        (!scene.joints.is_empty(), "there are joints or springs"),
        (!scene.actions.is_empty(), "there are forces besides gravity"),
        (!scene.laws.patches.is_empty(), "there is friction on patches"),
    ];
    reasons.into_iter().find(|(applies, _)| *applies).map(|(_, reason)| reason)
}

/// Largest number of moving bodies for which impacts are located by default: each arc moves all bodies, so that the
/// cost of a run grows with the square of their number.
const LOCATED: usize = 100;

/// Returns how the steps of a run treat impacts (located or stepped over), and why.
fn impacts(scene: &MultibodySystem, specification: &Specification) -> solution::Impacts {
    let reason = not_located(scene);
    let can_be_located = reason.is_none();
    let by =
        |are_located, unless_many, because| solution::Impacts { are_located, unless_many, can_be_located, because };
    match (specification.method().impacts, reason) {
        (Some(Impacts::Locate), _) => by(true, false, "`impacts` is `locate`"),
        (Some(Impacts::TimeStepping), _) => by(false, false, "`impacts` is `time_stepping`"),
        (None, Some(reason)) => by(false, false, reason),
        (None, None) if moving(scene).any(|body| !body.collider.is_smooth()) => {
            by(false, false, "a body that moves has edges, and `impacts` is not `locate`, which is of second order")
        }
        (None, None) if moving(scene).count() > LOCATED => {
            by(false, false, "more than 100 bodies move, and `impacts` is not `locate`, which is of second order")
        }
        (None, None) => by(
            true,
            true,
            "at most 100 bodies without edges move, without joints and forces besides gravity; it takes over while impacts are many",
        ),
    }
}
