//! Problems that are fitted: those whose runs have derivatives.

use crate::Solution;
use crate::contact::{ContactPlan, integrate_contact, integrate_contact_once};
use crate::integrate::{integrate, integrate_once};
use crate::run::{Ended, Plan};
use analysis::Analysis;
use models::{DviModel, MechanicalModel};
use problem::Control;
use radau::Settings;

/// A problem with what its runs need.
#[derive(Clone)]
pub(super) enum Fittable<'a> {
    /// A differential variational inequality.
    Dvi(Box<DviModel>, &'a Settings),
    /// A motion with located impacts.
    Motion(Box<MechanicalModel>, &'a ContactPlan, &'a Settings),
}

impl<'a> Fittable<'a> {
    /// The choices for Radau IIA.
    pub fn settings(&self) -> &'a Settings {
        match self {
            Self::Dvi(_, settings) | Self::Motion(_, _, settings) => settings,
        }
    }

    /// The values of its parameters.
    pub fn parameters(&self) -> &[f64] {
        let parameters = match self {
            Self::Dvi(model, _) => model.parameters.as_ref(),
            Self::Motion(model, ..) => model.parameters.as_ref().map(|(parameters, _)| parameters),
        };
        parameters.map_or(&[][..], |parameters| parameters.values())
    }

    /// The initial states.
    pub fn initial(&self) -> &[f64] {
        match self {
            Self::Dvi(model, _) => &model.initial,
            Self::Motion(model, ..) => &model.initial,
        }
    }

    /// The same problem with other values of its parameters; or why these have no meaning.
    pub fn bound(&self, values: &[f64]) -> Result<Self, String> {
        if values.is_empty() {
            return Ok(self.clone());
        }
        match self {
            Self::Dvi(model, settings) => model
                .with_parameters(values)
                .map(|model| Self::Dvi(Box::new(model), settings))
                .map_err(|error| error.to_string()),
            Self::Motion(model, contact, settings) => {
                let bound = model.with_parameters(values).map_err(|error| error.to_string());
                bound.map(|model| Self::Motion(Box::new(model), contact, settings))
            }
        }
    }

    /// The structural analysis at the start.
    pub fn analyse(&self, start: f64) -> Analysis {
        match self {
            Self::Dvi(model, _) => model.analyse(start),
            Self::Motion(model, ..) => model.analyse(),
        }
    }

    /// A run with all evidence.
    pub fn run(&self, plan: &Plan, analysis: &Analysis, control: &Control) -> Solution {
        match self {
            Self::Dvi(model, settings) => integrate(model, plan, settings, analysis, control),
            Self::Motion(model, contact, _) => integrate_contact(model, plan, contact, analysis, control),
        }
    }

    /// A run without the checks that need other runs.
    pub fn run_once(&self, plan: &Plan, analysis: &Analysis, control: &Control) -> Ended {
        match self {
            Self::Dvi(model, settings) => integrate_once(model, plan, settings, analysis, control),
            Self::Motion(model, contact, _) => integrate_contact_once(model, plan, contact, analysis, control),
        }
    }
}
