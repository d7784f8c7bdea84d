//! Differential variational inequalities, solved with evidence:
//!
//! ```text
//! x' = f(t,x) + B(t,x) z,    z in K,    <G(t,x,z), z~ - z> >= 0  for all z~ in K
//! ```
//!
//! A [`Specification`] is read from JSON and checked as a whole; [`solve`] gives a
//! [`Solution`]: the trajectory in columns, and the evidence that it is right.
//!
//! ```
//! use dvi::{problem::Control, specification::Specification};
//!
//! let text = br#"{"problem": {"dvi": {"states": {"x": {"initial": 1, "rate": "-x"}}}}, "time": {"end": 1}}"#;
//! let specification = Specification::from_json(text).expect("a valid specification");
//! let solution = dvi::solve(&specification, &Control::new());
//! let x = solution.trajectory.field("x").expect("a state named x");
//! assert!((x.last().expect("a value at the end") - (-1.0_f64).exp()).abs() < 1e-6);
//! ```

pub mod analysis;
pub mod contact;
pub mod convolution;
pub mod expression;
pub mod factorisation;
pub mod models;
pub mod problem;
pub mod radau;
pub mod service;
pub mod solution;
pub mod specification;
pub mod study;
pub mod vi;

use models::Model;
use problem::Control;
use solution::Solution;
use specification::Specification;

/// Solves a checked specification. Stops at the next step when `control` says so; never panics on a user's input.
pub fn solve(specification: &Specification, control: &Control) -> Solution {
    let Some(plan) = specification.study() else { return solve_once(specification, control) };
    let mut solution = control.part(0.0..FIRST, || solve_once(specification, control));
    solution.study = Some(control.part(FIRST..1.0, || study::study(specification, plan, control)));
    solution
}

/// The part of the work of a study that the solve as it is asked for makes up, about.
const FIRST: f64 = 0.1;

/// One solve, without a study.
fn solve_once(specification: &Specification, control: &Control) -> Solution {
    let (model, plan) = (specification.model(), specification.plan());
    let mut solution = match model {
        Model::Dvi(model) => {
            let (settings, analysis) = (specification.settings(), specification.analysis());
            solution::integrate(model, &plan, &settings, analysis, control)
        }
        Model::Mechanical(model) => {
            let (contact, analysis) = (specification.contact_plan(), specification.analysis());
            solution::integrate_contact(model, &plan, &contact, analysis, control)
        }
        Model::RigidBodies(scene) => {
            let (settings, analysis) = (specification.contact_plan().settings, specification.analysis());
            solution::step_rigid_bodies(scene, &plan, &settings, analysis, control)
        }
        Model::Obstacle(problem) => {
            let (settings, analysis) = (specification.obstacle_settings(), specification.analysis());
            solution::integrate_obstacle(problem, &plan, &settings, analysis, control)
        }
        Model::Convolution(model) => {
            let (convolution, analysis) = (specification.convolution_plan(model), specification.analysis());
            solution::integrate_convolution(model, &plan, &convolution, analysis, control)
        }
    };
    solution.diagnostics.warnings.extend(model.warnings().iter().cloned());
    solution.judge(plan.end);
    solution
}
