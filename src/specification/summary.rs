//! What a checked specification comes to, told without a solve.

use super::checked::Specification;
use analysis::Analysis;
use models::Model;
use serde::Serialize;
use solution::{
    Warning, describe, describe_contact, describe_convolution, describe_obstacle, describe_rigid_bodies,
    uniqueness_caveat,
};

/// Sizes, what the theory says, and what a solve would build.
#[derive(Clone, Debug, Serialize)]
pub struct Summary {
    /// The user's own words for it.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub label: Option<String>,
    /// The number of states.
    pub states: usize,
    /// The number of variables of the variational inequality.
    pub variables: usize,
    /// The bounds that vary with time or states.
    pub moving_bounds: usize,
    /// The places of the Jacobian that may be nonzero.
    pub jacobian_nonzeros: usize,
    /// Whether the Jacobian is the same everywhere.
    pub constant_jacobian: bool,
    /// Memory that a solve is known to take before it runs, in bytes.
    pub memory_bytes: usize,
    /// Index and uniqueness at the start, and why.
    #[serde(flatten)]
    pub analysis: Analysis,
    /// The method that a solve would take.
    pub method: &'static str,
    /// The parts that it would build.
    pub built: Vec<&'static str>,
    /// The parts that the problem does not need, each with the reason.
    pub left_out: Vec<String>,
    /// What the user should know.
    pub warnings: Vec<Warning>,
}

impl Specification {
    /// What this specification comes to.
    pub fn summary(&self) -> Summary {
        let model = self.model();
        let Sizes { states, variables, moving_bounds, jacobian_nonzeros, constant_jacobian } = Sizes::of(model);
        let described = match model {
            Model::Dvi(model) => describe(model.structure(), &self.settings(), self.analysis()),
            Model::Mechanical(model) => describe_contact(model, &self.contact_plan(), self.analysis()),
            Model::RigidBodies(scene) => describe_rigid_bodies(scene, &self.contact_plan().settings, self.analysis()),
            Model::Obstacle(problem) => describe_obstacle(problem, &self.obstacle_settings(), self.analysis()),
            Model::Convolution(model) => describe_convolution(model, &self.convolution_plan(model), self.analysis()),
        };
        let mut warnings = described.warnings;
        if matches!(model, Model::Dvi(_) | Model::Convolution(_)) {
            warnings.extend(uniqueness_caveat(self.analysis()));
        }
        warnings.extend(model.warnings().iter().cloned());
        Summary {
            label: self.label().map(str::to_owned),
            states,
            variables,
            moving_bounds,
            jacobian_nonzeros,
            constant_jacobian,
            memory_bytes: self.memory_bytes(),
            analysis: self.analysis().clone(),
            method: described.method,
            built: described.built,
            left_out: described.left_out,
            warnings,
        }
    }
}

/// The sizes of a model.
struct Sizes {
    states: usize,
    variables: usize,
    moving_bounds: usize,
    jacobian_nonzeros: usize,
    constant_jacobian: bool,
}

impl Sizes {
    fn of(model: &Model) -> Self {
        match model {
            Model::Dvi(model) => {
                let structure = model.structure();
                Self {
                    states: structure.states,
                    variables: structure.variables,
                    moving_bounds: structure.moving.len(),
                    jacobian_nonzeros: structure.pattern.len(),
                    constant_jacobian: structure.constant_jacobian,
                }
            }
            Model::Mechanical(model) => {
                let structure = model.structure();
                Self {
                    states: 2 * structure.coordinates,
                    variables: structure.rows(),
                    moving_bounds: 0,
                    jacobian_nonzeros: 0,
                    constant_jacobian: structure.constant_mass && structure.constant_forces,
                }
            }
            Model::Obstacle(problem) => {
                let nodes = problem.grid.nodes();
                Self {
                    states: nodes,
                    variables: if problem.has_obstacle() { nodes } else { 0 },
                    moving_bounds: 0,
                    jacobian_nonzeros: 0,
                    constant_jacobian: problem.has_constant_operator(),
                }
            }
            Model::Convolution(model) => Self {
                states: 0,
                variables: model.variables(),
                moving_bounds: model.forcing.structure().moving.len(),
                jacobian_nonzeros: model.at_zero.iter().filter(|entry| **entry != 0.0).count(),
                constant_jacobian: true,
            },
            Model::RigidBodies(_) => Self {
                states: model.state_names().len(),
                variables: 0,
                moving_bounds: 0,
                jacobian_nonzeros: 0,
                constant_jacobian: false,
            },
        }
    }
}
