//! Problems that are solved with derivatives for many values of their parameters: in fits, and along branches of
//! orbits.

use super::Solution;
use super::contact::{ContactPlan, integrate_contact, integrate_contact_once};
use super::integrate::{integrate, integrate_once};
use super::run::{Ended, Plan};
use super::shooting::Subject;
use analysis::Analysis;
use models::{DviModel, MechanicalModel};
use problem::Control;
use radau::Settings;

/// A model whose parameters can be bound to values; for a motion, with its contact settings.
#[derive(Clone)]
pub(super) enum Bindable<'a> {
    /// The model of a differential variational inequality.
    Dvi(Box<DviModel>),
    /// The model of a motion with located impacts, with its contact settings.
    Motion(Box<MechanicalModel>, &'a ContactPlan),
}

impl<'a> Bindable<'a> {
    /// Returns the values to which the parameters of the model are bound.
    pub fn values(&self) -> &[f64] {
        let parameters = match self {
            Self::Dvi(model) => model.parameters.as_ref(),
            Self::Motion(model, _) => model.parameters.as_ref().map(|(parameters, _)| parameters),
        };
        parameters.map_or(&[][..], |parameters| parameters.values())
    }

    /// Returns the initial states of the model.
    pub fn initial(&self) -> &[f64] {
        match self {
            Self::Dvi(model) => &model.initial,
            Self::Motion(model, _) => &model.initial,
        }
    }

    /// Returns the model bound to other values of its parameters, or the reason why these are invalid.
    pub fn bound(&self, values: &[f64]) -> Result<Self, String> {
        if values.is_empty() {
            return Ok(self.clone());
        }
        match self {
            Self::Dvi(model) => model.with_parameters(values).map(|model| Self::Dvi(Box::new(model))),
            Self::Motion(model, contact) => {
                model.with_parameters(values).map(|model| Self::Motion(Box::new(model), contact))
            }
        }
        .map_err(|why| why.to_string())
    }

    /// Returns the structural analysis of the model at the start time.
    pub fn analyse(&self, start: f64) -> Analysis {
        match self {
            Self::Dvi(model) => model.analyse(start),
            Self::Motion(model, _) => model.analyse(),
        }
    }

    /// Returns the model as the subject of runs over one period (shooting).
    pub fn subject<'m>(&'m self, settings: &'m Settings) -> Subject<'m> {
        match self {
            Self::Dvi(model) => Subject::Dvi(model, settings),
            Self::Motion(model, contact) => Subject::Motion(model, contact, settings),
        }
    }

    /// Runs the model with all checks of accuracy, including those that need further runs.
    pub fn run(&self, plan: &Plan, settings: &Settings, analysis: &Analysis, control: &Control) -> Solution {
        match self {
            Self::Dvi(model) => integrate(model, plan, settings, analysis, control),
            Self::Motion(model, contact) => integrate_contact(model, plan, contact, analysis, control),
        }
    }

    /// Runs the model once, without the checks that need other runs.
    pub fn run_once(&self, plan: &Plan, settings: &Settings, analysis: &Analysis, control: &Control) -> Ended {
        match self {
            Self::Dvi(model) => integrate_once(model, plan, settings, analysis, control),
            Self::Motion(model, contact) => integrate_contact_once(model, plan, contact, analysis, control),
        }
    }
}
