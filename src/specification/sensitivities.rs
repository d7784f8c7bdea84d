//! Requested sensitivities: derivatives of outputs with respect to parameters and initial values.

use super::choices::choices;
use super::error::{Errors, SpecificationError};
use super::expression::Expression;
use super::method::{Impacts, Method};
use super::model::Model;
use super::pointer::Pointer;
use super::varied::check_structure;
use super::wording::{abridged, listed};
use expression::nearest;
use models::{DviModel, MechanicalModel};
use serde::{Deserialize, Serialize, Serializer};
use solution::{By, Observables, Sensitivities};
use std::sync::Arc;
use utoipa::ToSchema;

/// Largest number of unknowns of a differentiated problem: the sensitivity equations of all stages form one dense
/// matrix.
const MOST_UNKNOWNS: usize = 100;
/// Largest number of sensitivity columns of a trajectory.
const MOST_COLUMNS: usize = 10_000;

/// Suffix to the name of a state; the name with it denotes the initial value of the state.
pub(super) const INITIAL: &str = ".initial";

choices! {
    /// How derivatives are computed: with the run, or backwards from its end.
    SensitivityMode {
        "forward" Forward: "Columns `dx/dm` of any number of states, at a cost that grows with the number of parameters."
        "adjoint" Adjoint: "The gradient of one `objective`, at a cost that does not depend on the number of parameters."
    }
}

impl Serialize for SensitivityMode {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        serializer.serialize_str(self.name())
    }
}

/// The number whose gradient is computed in adjoint mode.
#[derive(Clone, Debug, Deserialize, Serialize, ToSchema)]
#[serde(rename_all = "snake_case")]
pub enum Objective {
    /// The value at the end of an expression in states, definitions, parameters and `t`.
    Final(Expression),
    /// The integral over time of an expression in states, definitions, parameters and `t`.
    Integral(Expression),
}

impl Objective {
    /// Returns the expression of the objective whose gradient is requested, with its key.
    pub(super) fn expression(&self) -> (&'static str, &Expression) {
        match self {
            Self::Final(expression) => ("final", expression),
            Self::Integral(expression) => ("integral", expression),
        }
    }
}

/// Derivatives of states, definitions and integrals with respect to parameters and initial values, as columns `dx/dm`
/// beside the states; for a motion with located impacts also the derivatives of the event times, as `event_slopes`.
/// In adjoint mode the `gradient` of one number with respect to any number of parameters and initial values.
#[derive(Clone, Debug, Deserialize, Serialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct SensitivitiesRequest {
    /// Parameters, and initial values as `x.initial`, to differentiate with respect to.
    pub to: Vec<String>,
    /// States to differentiate, and definitions and integrals made of states, parameters and `t`. Default: all states.
    pub of: Option<Vec<String>>,
    /// How derivatives are computed. Default `forward`.
    #[serde(default)]
    #[schema(default = "forward")]
    pub mode: SensitivityMode,
    /// The number whose gradient is computed, in adjoint mode.
    pub objective: Option<Objective>,
}

impl SensitivitiesRequest {
    /// Checks the request for sensitivities of a model, that is, for derivatives of its outputs.
    pub(super) fn check(
        &self,
        (model, observables, method): (&dyn Model, &Observables, &Method),
        place: &Pointer<'_>,
        objective: Option<Observables>,
        errors: &mut Errors,
    ) -> Option<Sensitivities> {
        self.check_mode(model, place, errors)?;
        match model.mechanical() {
            Some(motion) => differentiable_motion(motion, method, place, errors)?,
            None => differentiable(model, ("derivatives are computed", WITH_MOTIONS), place, errors).map(drop)?,
        }
        let states = model.state_names();
        let outputs = model.output_names().len();
        let parameters = model.parameters().map_or(&[][..], |parameters| parameters.names());
        let initial: Vec<String> = states.iter().map(|name| format!("{name}{INITIAL}")).collect();
        let mut found = Errors::default();
        let by = places(&self.to, parameters.iter().chain(&initial), &place.key("to"), &mut found);
        let by: Vec<By> =
            by.into_iter().map(|at| at.checked_sub(parameters.len()).map_or(By::Parameter(at), By::Initial)).collect();
        let is_start_moved = model.mechanical().is_some_and(|motion| motion.is_start_moved);
        if is_start_moved && by.iter().any(|by| matches!(by, By::Parameter(_))) {
            let detail = "the start is found by moving bodies apart, and its derivatives with respect to parameters are not known";
            let error = SpecificationError::new(place.key("to").to_string(), "conflict", detail);
            found.push(error.expected(
                "an initial state that satisfies gaps and joints, without `\"interpenetration\": \"resolve\"`",
            ));
        } else {
            for (index, by) in by.iter().enumerate() {
                let By::Parameter(at) = *by else { continue };
                check_structure(model, at, &place.key("to").index(index), &mut found);
            }
        }
        let of_names = place.key("of");
        let of = match &self.of {
            _ if self.mode == SensitivityMode::Adjoint => Vec::new(),
            Some(of) => places(of, states.iter().chain(&observables.names), &of_names, &mut found),
            None => (0..states.len()).collect(),
        };
        for (i, at) in of.iter().enumerate() {
            let refused = at.checked_sub(states.len()).and_then(|own| *observables.slopes.refused.get(own)?);
            let Some(why) = refused else { continue };
            let name = &observables.names[at - states.len()];
            let detail = format!("`{}` has no derivative here: {why}", abridged(name));
            let error = SpecificationError::new(of_names.index(i).to_string(), "conflict", detail);
            found.push(error.expected(
                "states, or definitions and integrals made of states, parameters and `t`, without jumps in integrands",
            ));
        }
        if self.to.is_empty() {
            let error = SpecificationError::new(
                place.key("to").to_string(),
                "empty",
                "`to` is empty: there is nothing to differentiate with respect to",
            );
            found.push(error.expected("parameters, or initial values such as `x.initial`"));
        }
        if by.len().saturating_mul(of.len().max(1)) > MOST_COLUMNS {
            let detail = format!("{} times {} derivatives", of.len(), by.len());
            let error = SpecificationError::new(place.to_string(), "too_many_unknowns", detail);
            found.push(error.expected(format!("at most {MOST_COLUMNS}")));
        }
        if !found.is_empty() {
            errors.append(found);
            return None;
        }
        let name_of = |by: &By| match *by {
            By::Parameter(k) => &parameters[k],
            By::Initial(state) => &initial[state],
        };
        let names = of
            .iter()
            .flat_map(|&state| by.iter().map(move |by| (state, by)))
            .map(|(at, by)| {
                let of = states.get(at).unwrap_or_else(|| &observables.names[at - states.len()]);
                format!("d{of}/d{}", name_of(by))
            })
            .collect();
        let to = by.iter().map(|by| name_of(by).clone()).collect();
        if let Some(observables) = objective {
            let objective = Some(Arc::new(solution::Objective { observables }));
            return Some(Sensitivities { by, to, of: vec![outputs], names: Vec::new(), objective });
        }
        // The columns of definitions and integrals follow those of all outputs of the problem.
        let of = of.into_iter().map(|at| if at < states.len() { at } else { at - states.len() + outputs }).collect();
        Some(Sensitivities { by, to, of, names, objective: None })
    }
}

impl SensitivitiesRequest {
    /// Refuses keys of the forward mode in adjoint mode and keys of the adjoint mode in forward mode, and problems
    /// without adjoint mode.
    fn check_mode(&self, model: &dyn Model, place: &Pointer<'_>, errors: &mut Errors) -> Option<()> {
        let refused = match (self.mode, &self.objective, &self.of) {
            (SensitivityMode::Forward, Some(_), _) => Some((
                "objective",
                "conflict",
                "an `objective` is that of adjoint mode: forward mode differentiates states, definitions and integrals",
                "`\"mode\": \"adjoint\"` beside it, or `of` in its place",
            )),
            (SensitivityMode::Adjoint, None, _) => Some((
                "objective",
                "missing_key",
                "adjoint mode computes the gradient of one number, and `objective` is missing",
                "`\"objective\": {\"final\": \"x^2\"}` or `{\"integral\": \"x^2\"}`; or no `mode`, for columns of all states",
            )),
            (SensitivityMode::Adjoint, Some(_), Some(_)) => Some((
                "of",
                "conflict",
                "adjoint mode computes the gradient of its `objective` alone, and `of` names columns of forward mode",
                "no `of`, or no `mode` and no `objective`",
            )),
            (SensitivityMode::Adjoint, Some(_), None) if model.dvi().is_none() && model.mechanical().is_none() => {
                Some((
                    "mode",
                    "conflict",
                    "adjoint mode goes back over the steps of Radau IIA, with variables in a set or with located impacts, and this \
                 problem has others; forward mode is not available either",
                    "a problem of type `dvi`, `lcs`, `filippov`, `circuit`, `elastic` or `mechanical`, or no `sensitivities`",
                ))
            }
            _ => None,
        };
        let Some((key, code, detail, expected)) = refused else { return Some(()) };
        errors.push(SpecificationError::new(place.key(key).to_string(), code, detail).expected(expected));
        None
    }
}

/// Refuses mechanical systems whose motion cannot be differentiated.
pub(super) fn differentiable_motion(
    model: &MechanicalModel,
    method: &Method,
    place: &Pointer<'_>,
    errors: &mut Errors,
) -> Option<()> {
    let unknowns = model.state_names.len();
    let refused = if method.impacts() != Impacts::Locate {
        let detail = "differences of time stepping do not converge to derivatives, nor do derivatives of its steps";
        Some(("conflict", detail.to_owned(), "`\"impacts\": \"locate\"` in `method`, without `step`".to_owned()))
    } else if unknowns > MOST_UNKNOWNS {
        let expected = format!("at most {MOST_UNKNOWNS} coordinates and velocities, for derivatives");
        Some(("too_many_unknowns", format!("{unknowns} coordinates and velocities"), expected))
    } else if let Some(k) = model.structure().contacts.iter().position(|contact| contact.varies) {
        let detail = format!(
            "the coefficient of friction of `{}` varies, and derivatives are computed only for constant ones",
            abridged(&model.contacts[k])
        );
        Some(("conflict", detail, "a number or an expression in parameters for its `friction`".to_owned()))
    } else if model.has_kinks {
        let detail = "a force, a mass, a gap or a slip has a kink or a jump in coordinates or velocities, across which the \
                      motion is not differentiable";
        let expected = "expressions that are smooth in coordinates and velocities; a gap of each surface of its own";
        Some(("conflict", detail.to_owned(), expected.to_owned()))
    } else {
        None
    };
    let Some((code, detail, expected)) = refused else { return Some(()) };
    errors.push(SpecificationError::new(place.to_string(), code, detail).expected(expected));
    None
}

/// The problem types that have derivatives, for messages: without and with mechanical systems.
pub(super) const OF_DVI: &str = "`dvi`, `lcs`, `filippov`, `circuit` or `elastic`";
pub(super) const WITH_MOTIONS: &str = "`dvi`, `lcs`, `filippov`, `circuit`, `elastic` or `mechanical`";

/// Returns the equations of a differentiable model, and refuses any other model. The message names the purpose `what`
/// and the problem types `types` that serve it.
pub(super) fn differentiable<'m>(
    model: &'m dyn Model,
    (what, types): (&str, &str),
    place: &Pointer<'_>,
    errors: &mut Errors,
) -> Option<&'m DviModel> {
    let Some(dvi) = model.dvi() else {
        let detail = format!("{what} only for problems that Radau IIA solves with variables in a set");
        let error = SpecificationError::new(place.to_string(), "conflict", detail);
        errors.push(error.expected(format!("a problem of type {types}")));
        return None;
    };
    let unknowns = dvi.structure().unknowns();
    if unknowns > MOST_UNKNOWNS {
        let error = SpecificationError::new(place.to_string(), "too_many_unknowns", format!("{unknowns} unknowns"));
        errors.push(error.expected(format!("at most {MOST_UNKNOWNS} states and variables, for derivatives")));
        return None;
    }
    if dvi.has_kinks() {
        let detail = "a rate has a kink or a jump in a state, whose crossing is not located, so that derivatives behind it would be wrong";
        let error = SpecificationError::new(place.to_string(), "conflict", detail);
        errors.push(error.expected("the kink written as a set, as the warning `kink_in_rate` shows"));
        return None;
    }
    Some(dvi)
}

/// Returns the indices of the requested names `asked` in a list of known names.
fn places<'a>(
    asked: &[String],
    known: impl Iterator<Item = &'a String> + Clone,
    place: &Pointer<'_>,
    errors: &mut Errors,
) -> Vec<usize> {
    let names = || known.clone().map(String::as_str);
    let mut found = Vec::with_capacity(asked.len());
    for (i, name) in asked.iter().enumerate() {
        let place = place.index(i);
        match names().position(|known| known == name) {
            Some(at) if found.contains(&at) => {
                errors.report(&place, "duplicate_name", format!("`{}` is named already", abridged(name)));
            }
            Some(at) => found.push(at),
            None => {
                let detail = format!("`{}` is not known here", abridged(name));
                let error = SpecificationError::new(place.to_string(), "unknown_name", detail);
                errors.push(error.expected(listed(names())).did_you_mean(nearest(name, names())));
            }
        }
    }
    found
}
