//! The derivatives of the states by parameters and initial values: columns `dx/dm` beside the states, followed with the run
//! ([`radau::Tangents`]) and held to a finite difference in one direction.

use super::integrate::integrate_once;
use super::run::Ended;
use super::{CheckCode, Failure, Plan, Status};
use analysis::Analysis;
use models::DviModel;
use nalgebra::DMatrix;
use numerics::CENTRAL_DIFFERENCE;
use problem::Control;
use radau::{Directions, NoDerivative, Radau, Settings, Shifted, Tangents};
use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

/// Differences of whole runs are as exact as the tolerances: by the root of them parameters are moved, which leaves half of
/// their digits. Farther off a phase may have gone round, and both differences agree on what is no derivative.
const POWER: f64 = 0.5;
/// The part of a parameter by which it is moved at most.
const MOST_MOVED: f64 = 1e-2;
/// By how much derivatives may differ from the difference of runs, beside what two differences differ by.
const SLACK: f64 = 20.0;

/// What is differentiated, and by what.
#[derive(Clone, Debug)]
pub struct Sensitivities {
    /// By what.
    pub by: Vec<By>,
    /// The states.
    pub of: Vec<usize>,
    /// The names of the columns, those of one state after the other.
    pub names: Vec<String>,
}

/// What a run is differentiated by.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum By {
    /// A parameter, by its number.
    Parameter(usize),
    /// A state at the start.
    Initial(usize),
}

/// How derivatives compare with the difference of two runs.
#[derive(Clone, Debug, PartialEq, Deserialize, Serialize, ToSchema)]
pub struct Checked {
    /// The state whose derivative differs most from its finite difference.
    pub of: String,
    /// By how much the parameters and initial values are moved together, in the order of `to`, and back.
    pub direction: Vec<f64>,
    /// The derivative in that direction at the end.
    pub derivative: f64,
    /// The difference of two runs that are moved so, over twice that.
    pub finite_difference: f64,
    /// What two such differences, one twice as far, differ by.
    pub uncertainty: f64,
}

/// Derivatives on the way of a run.
pub(super) struct Followed {
    tangents: Tangents,
    of: Vec<usize>,
    by: usize,
}

impl Followed {
    /// Begins at the start.
    pub fn new(model: &DviModel, of: &Sensitivities) -> Result<Self, String> {
        let directions = directions(model, &of.by)?;
        let tangents = Tangents::new(model.problem(), directions).map_err(|error| error.to_string())?;
        Ok(Self { tangents, of: of.of.clone(), by: of.by.len() })
    }

    /// Follows the last step.
    pub fn step(&mut self, radau: &mut Radau<'_>) -> Result<(), NoDerivative> {
        self.tangents.follow(radau)
    }

    /// Writes the columns at a time within the last step.
    pub fn write(&self, radau: &Radau<'_>, t: f64, out: &mut [f64]) {
        for (out, &state) in out.chunks_exact_mut(self.by).zip(&self.of) {
            self.tangents.write(radau, t, state, out);
        }
    }
}

/// The failure of a run whose derivatives end.
pub(super) fn failure(why: &str, time: f64, state: &[f64]) -> Failure {
    let message =
        format!("there are no derivatives from t = {time:?} on: {why}; without `sensitivities` the run itself goes on");
    Failure { code: "no_derivative".into(), message, time, state: state.to_vec() }
}

fn directions(model: &DviModel, by: &[By]) -> Result<Directions, String> {
    let structure = model.structure();
    let (n, count) = (structure.states, by.len());
    let slopes = model.slopes().map_err(|error| error.to_string())?;
    let mut initial = DMatrix::zeros(n, count);
    let mut shifted = Vec::with_capacity(count);
    for (direction, by) in by.iter().enumerate() {
        shifted.push(match *by {
            By::Initial(state) => {
                initial[(state, direction)] = 1.0;
                None
            }
            By::Parameter(parameter) => Some(moved(model, parameter)?),
        });
    }
    let Some(mut slopes) = slopes else {
        let rows = Box::new(|_: f64, _: &[f64], out: &mut DMatrix<f64>| out.fill(0.0));
        return Ok(Directions { initial, rows, mass: Vec::new(), bounds: Vec::new(), shifted });
    };
    // The direction of a parameter; each is named once.
    let column = |parameter: usize| by.iter().position(|by| *by == By::Parameter(parameter));
    for (state, parameter, value) in slopes.initial() {
        // An initial value that is a direction of its own does not follow parameters.
        if let Some(direction) = column(parameter).filter(|_| !by.contains(&By::Initial(state))) {
            initial[(state, direction)] = value;
        }
    }
    let mass = slopes.mass().filter_map(|(place, parameter, value)| Some((place, column(parameter)?, value))).collect();
    let bounds = slopes.bounds().filter_map(|(bound, parameter, value)| Some((bound, column(parameter)?, value)));
    let bounds = bounds.collect();
    let pattern = slopes.pattern().iter().enumerate();
    let places: Vec<(usize, usize, usize)> =
        pattern.filter_map(|(place, &(row, parameter))| Some((place, row, column(parameter)?))).collect();
    let mut values = vec![0.0; slopes.pattern().len()];
    let rows = Box::new(move |t: f64, y: &[f64], out: &mut DMatrix<f64>| {
        slopes.evaluate(t, y, &mut values);
        out.fill(0.0);
        places.iter().for_each(|&(place, row, direction)| out[(row, direction)] += values[place]);
    });
    Ok(Directions { initial, rows, mass, bounds, shifted })
}

/// A problem with one parameter a little above and below its value.
fn moved(model: &DviModel, parameter: usize) -> Result<Shifted, String> {
    let values = model.parameters.as_ref().map_or(&[][..], |parameters| parameters.values());
    let size = if values[parameter] == 0.0 { 1.0 } else { values[parameter].abs() };
    let by = CENTRAL_DIFFERENCE * size;
    let at = |by: f64| {
        let mut values = values.to_vec();
        values[parameter] += by;
        model.with_parameters(&values).map(|model| model.problem()).map_err(|error| error.to_string())
    };
    Ok(Shifted { by, problems: [at(by)?, at(-by)?] })
}

/// Holds the derivatives at the end of a run to differences of runs.
pub(super) fn check(
    model: &DviModel,
    plan: &Plan,
    settings: &Settings,
    analysis: &Analysis,
    control: &Control,
    ended: &mut Ended,
) {
    let Some(asked) = &plan.sensitivities else { return };
    if ended.solution.ended_by.is_some() {
        let message =
            "`stop` ended the run, and runs with other parameters, which derivatives are compared with, end elsewhere";
        ended.solution.diagnostics.checks.caveat("derivatives_not_checked", message.to_owned());
        return;
    }
    let rows: Vec<Vec<f64>> = ended.derivatives.chunks(asked.by.len()).map(<[f64]>::to_vec).collect();
    let values = model.parameters.as_ref().map_or(&[][..], |parameters| parameters.values());
    let part = settings.rtol.powf(POWER).min(MOST_MOVED);
    let size_of = |by: &By| match *by {
        By::Parameter(k) => values[k].abs(),
        By::Initial(state) => plan.initial[state].abs().max(ended.x[state].abs()),
    };
    // Not one of them alone, nor all to one side.
    let signs = asked.by.iter().enumerate().map(|(k, _)| if k % 3 == 1 { -0.7 } else { 1.0 });
    let direction: Vec<f64> = asked
        .by
        .iter()
        .zip(signs)
        .map(|(by, sign)| sign * part * if size_of(by) > 0.0 { size_of(by) } else { 1.0 })
        .collect();
    let run = |multiple: f64| -> Option<Vec<f64>> {
        let mut moved = values.to_vec();
        for (by, change) in asked.by.iter().zip(&direction) {
            if let By::Parameter(k) = by {
                moved[*k] += multiple * change;
            }
        }
        let bound = if model.parameters.is_some() { model.with_parameters(&moved).ok()? } else { model.clone() };
        let mut initial = bound.initial.clone();
        for (by, change) in asked.by.iter().zip(&direction) {
            if let By::Initial(state) = by {
                initial[*state] = plan.initial[*state] + multiple * change;
            }
        }
        let reference = Plan {
            times: Some(vec![plan.end]),
            fields: Vec::new(),
            observables: Default::default(),
            sensitivities: None,
            initial,
            reducers: None,
            interpolants: None,
            ..plan.clone()
        };
        let ended = integrate_once(&bound, &reference, settings, analysis, control);
        (ended.solution.status == Status::Completed).then_some(ended.x)
    };
    let [Some(above), Some(below), Some(far_above), Some(far_below)] = [1.0, -1.0, 2.0, -2.0].map(run) else {
        let message = "runs with other parameters, which the derivatives are compared with, did not reach the end";
        ended.solution.diagnostics.checks.caveat("derivatives_not_checked", message.to_owned());
        return;
    };
    let mut worst: Option<(f64, Checked)> = None;
    for (&state, row) in asked.of.iter().zip(&rows) {
        let derivative: f64 = row.iter().zip(&direction).map(|(slope, change)| slope * change).sum();
        let near = 0.5 * (above[state] - below[state]);
        let far = 0.25 * (far_above[state] - far_below[state]);
        let noise = settings.rtol * ended.x[state].abs() + settings.atol[state];
        let uncertainty = (near - far).abs() + noise;
        let off = (derivative - near).abs() / (SLACK * uncertainty);
        if worst.as_ref().is_none_or(|(worst, _)| off > *worst) {
            let of = plan.names[state].clone();
            let direction = direction.clone();
            worst = Some((off, Checked { of, direction, derivative, finite_difference: near, uncertainty }));
        }
    }
    if let Some((off, checked)) = worst {
        ended.solution.diagnostics.checks.record(CheckCode::Derivatives, off, 1.0, || {
            format!(
                "the derivative of `{}` at the end is {:e} in a direction in which the difference of two runs is {:e}, with an \
                 uncertainty of {:.0e}: the order of switches may change nearby, or a tolerance is too loose",
                checked.of, checked.derivative, checked.finite_difference, checked.uncertainty
            )
        });
        ended.solution.sensitivities = Some(checked);
    }
}
