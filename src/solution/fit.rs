//! Fits of parameters and initial values to data. The sum of a loss over the residuals `(x(t_i; p) - x_i)/sd_i` is
//! minimised by the Levenberg-Marquardt method, with derivatives that are exact through switches ([`radau::Tangents`]),
//! on request from several starting points. The first is given by the user; the others fill the bounds evenly, as
//! multiples of the powers of the generalised golden ratio (Roberts 2018, *The unreasonable effectiveness of
//! quasirandom sequences*), on a logarithmic scale if the bounds are positive and far apart.

mod intervals;
mod least_squares;

pub use least_squares::Loss;

use super::bindable::Bindable;
use super::contact::ContactPlan;
use super::observables::Observables;
use super::run::{Ended, Plan, ending};
use super::sensitivities::{By, Sensitivities};
use super::{CheckCode, Failure, Solution, Status};
use analysis::Analysis;
use intervals::{Intervals, Stretches, intervals, is_too_large, long_stretches};
use least_squares::{LeastSquares, Minimum, Residuals};
use models::{DviModel, MechanicalModel};
use nalgebra::{DMatrix, DVector};
use numerics::CENTRAL_DIFFERENCE;
use problem::Control;
use radau::Settings;
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;
use std::time::Instant;
use utoipa::ToSchema;

/// Least ratio of positive bounds of a fitted parameter for which the starting points of the search are chosen on a
/// logarithmic scale.
const FAR_APART: f64 = 100.0;
/// Relative tolerance of the rank of the Jacobian of the residuals, in units of `rtol`, since derivatives are as
/// accurate as a run.
const TOLERANCES: f64 = 10.0;
/// Fraction of the progress reported to the user that the search for the estimates accounts for; the rest is for the
/// final run and its sensitivity check.
const SHARE: f64 = 0.9;
/// Reported progress at which the search for the estimates begins. It is above 0 because only the events of a run that
/// begins at 0 are recorded as those of the answer.
const BEGIN: f64 = 1e-9;
/// Largest ratio of the squared errors of the runs to the sum of squared residuals at which the residuals are
/// attributed to the data.
const EXACT: f64 = 0.01;
/// Relative difference of the losses of two minima below which they count as equal.
const SAME: f64 = 1e-3;

/// A request for a fit: the fitted quantities and the data.
#[derive(Clone, Debug)]
pub struct Fit {
    /// The parameters and initial values to fit to the data.
    pub parameters: Vec<Fitted>,
    /// The times of the measurements, increasing, within the horizon of the run.
    pub t: Vec<f64>,
    /// The measured values of each fitted output.
    pub data: Vec<DataColumn>,
    /// Whether the standard deviations of the measured values are known; otherwise all of them are set to one.
    pub is_scaled: bool,
    /// The loss (such as the sum of squared residuals) that the fit minimises.
    pub loss: Loss,
    /// The number of starting points of the search for the minimum of the loss.
    pub starts: u64,
}

/// A fitted parameter or initial value.
#[derive(Clone, Debug)]
pub struct Fitted {
    /// The name of the fitted parameter, or of the state with a fitted initial value.
    pub name: String,
    /// The parameter or initial value of the model with respect to which residuals are differentiated.
    pub by: By,
    /// Starting value of the parameter or initial value in the search for the minimum of the loss.
    pub initial: f64,
    /// Lower bound of the fitted parameter or initial value.
    pub lower: f64,
    /// Upper bound of the fitted parameter or initial value.
    pub upper: f64,
}

/// An output of the problem with measured values.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Quantity {
    /// A measured state, given by its index.
    State(usize),
    /// A measured quantity of the user (`definitions`), by its index; it depends on states, parameters and time alone.
    Definition(usize),
}

/// The measured values of a state or of a user-defined quantity (`definitions`).
#[derive(Clone, Debug)]
pub struct DataColumn {
    /// The name of the measured state or user-defined quantity.
    pub name: String,
    /// The output to which the measured values belong.
    pub of: Quantity,
    /// The measured values; `None` where there is no measurement.
    pub values: Vec<Option<f64>>,
    /// The standard deviations of the measured values, one for each.
    pub sd: Vec<f64>,
}

/// The result of a fit.
#[derive(Clone, Debug, PartialEq, Deserialize, Serialize, ToSchema)]
pub struct FitAnswer {
    /// The estimates of the fitted parameters, by name.
    pub parameters: BTreeMap<String, Estimate>,
    /// The names of the fitted parameters, in the order of the rows and columns of `covariance`.
    pub names: Vec<String>,
    /// The covariance matrix of the estimates. Null for an estimate that the data do not determine, or that is at a
    /// bound.
    pub covariance: Vec<Vec<Option<f64>>>,
    /// The sum of the loss over all residuals, in units of standard deviations if `sd` is given.
    pub loss: f64,
    /// The root of the sum of squared residuals over the degrees of freedom: about 1 if `sd` is given and correct,
    /// otherwise the standard deviation of the data.
    pub spread: f64,
    /// The number of measured values that were fitted.
    pub observations: u64,
    /// Singular values, in decreasing order, of the Jacobian with respect to relative changes of the parameters, in
    /// units of standard deviations: the inverse of each is the standard error of a combination of relative changes.
    pub singular_values: Vec<f64>,
    /// The combinations of relative changes that the data do not determine, by name: `{"a": 1, "b": -1}` means that `a`
    /// may be raised by a percent while `b` is lowered by one.
    pub undetermined: Vec<BTreeMap<String, f64>>,
    /// The data minus the fitted values, at the times of the data.
    pub residuals: BTreeMap<String, Vec<Option<f64>>>,
    /// The starting points and the minima found from them, in order.
    pub starts: Vec<FitStart>,
}

/// The estimate of one fitted parameter, with its confidence interval.
#[derive(Clone, Copy, Debug, PartialEq, Deserialize, Serialize, ToSchema)]
pub struct Estimate {
    /// The estimated value of the parameter.
    pub estimate: f64,
    /// The standard error of the estimate. Absent if the data do not determine the parameter, or it is at a bound.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub sd: Option<f64>,
    /// Lower end of the 95 % confidence interval of the parameter, within its bounds.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub lower: Option<f64>,
    /// Upper end of the 95 % confidence interval of the parameter, within its bounds.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub upper: Option<f64>,
}

/// The search for a minimum of the loss from one starting point.
#[derive(Clone, Debug, PartialEq, Deserialize, Serialize, ToSchema)]
pub struct FitStart {
    /// The starting point, by the names of the parameters.
    pub from: BTreeMap<String, f64>,
    /// The minimum, by the names of the parameters; absent if the problem could not be solved at the starting point.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub to: Option<BTreeMap<String, f64>>,
    /// The loss at the minimum that the search found.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub loss: Option<f64>,
    /// The number of runs in the search.
    pub runs: u64,
}

impl Fit {
    fn observations(&self) -> usize {
        self.data.iter().flat_map(|column| &column.values).flatten().count()
    }

    fn named(&self, point: &[f64]) -> BTreeMap<String, f64> {
        self.parameters.iter().map(|fitted| fitted.name.clone()).zip(point.iter().copied()).collect()
    }

    /// Returns the starting point of the search with the given number, counted from zero.
    fn start(&self, number: u64) -> Vec<f64> {
        if number == 0 {
            return self.parameters.iter().map(|fitted| fitted.initial).collect();
        }
        let ratio = generalised_golden_ratio(self.parameters.len());
        let parts = (1..).map(|k: i32| (0.5 + number as f64 * ratio.powi(-k)).fract());
        let of = |(fitted, part): (&Fitted, f64)| match fitted.lower > 0.0 && fitted.upper >= FAR_APART * fitted.lower {
            true => fitted.lower * (fitted.upper / fitted.lower).powf(part),
            false => fitted.lower + part * (fitted.upper - fitted.lower),
        };
        self.parameters.iter().zip(parts).map(of).collect()
    }
}

/// Returns the positive root of `x^(d+1) = x + 1`, whose powers give starting points that fill the box of the bounds
/// evenly.
fn generalised_golden_ratio(d: usize) -> f64 {
    let mut x = 2.0_f64;
    // The fixed-point iteration for the root contracts by at least a factor of two per step.
    for _ in 0..f64::MANTISSA_DIGITS {
        x = (1.0 + x).powf(1.0 / (d as f64 + 1.0));
    }
    x
}

/// The user-defined quantities (`definitions`) as functions of states and parameters.
struct Definitions {
    of: Observables,
    parameters: Vec<f64>,
    outputs: Vec<f64>,
    values: Vec<f64>,
}

impl Definitions {
    fn new(of: Observables, outputs: usize, parameters: &[f64]) -> Self {
        let values = vec![0.0; of.names.len() + of.monitors.len()];
        Self { values, parameters: parameters.to_vec(), outputs: vec![0.0; outputs], of }
    }

    fn at(&mut self, definition: usize, t: f64, x: &[f64]) -> f64 {
        self.outputs[..x.len()].copy_from_slice(x);
        self.of.program.evaluate(t, &self.outputs, &mut self.values);
        self.values[definition]
    }

    /// Returns the central difference of a user-defined quantity, without division by the increment, along `dx` in the
    /// states and `step` in a parameter.
    fn difference(
        &mut self,
        definition: usize,
        t: f64,
        (x, dx): (&[f64], &[f64]),
        (parameter, step): (Option<usize>, f64),
    ) -> f64 {
        let mut moved = self.parameters.clone();
        let [above, below] = [1.0, -1.0].map(|sign| {
            if let Some(parameter) = parameter {
                moved[parameter] = self.parameters[parameter] + sign * step;
                self.of.program.bind(&moved);
            }
            let x: Vec<f64> = x.iter().zip(dx).map(|(x, dx)| x + sign * dx).collect();
            self.at(definition, t, &x)
        });
        if parameter.is_some() {
            self.of.program.bind(&self.parameters);
        }
        above - below
    }
}

/// The search for the minimum of the loss, with the problem and the plan of its runs.
struct Search<'a> {
    model: Bindable<'a>,
    settings: &'a Settings,
    plan: &'a Plan,
    fit: &'a Fit,
    analysis: &'a Analysis,
    control: &'a Control,
}

/// Fits a differential variational inequality to data, and runs it with the estimates.
pub fn fit(
    model: &DviModel,
    plan: &Plan,
    fit: &Fit,
    settings: &Settings,
    analysis: &Analysis,
    control: &Control,
) -> Solution {
    Search { model: Bindable::Dvi(Box::new(model.clone())), settings, plan, fit, analysis, control }.run()
}

/// Fits a motion with located impacts to data, and runs it with the estimates.
pub fn fit_motion(
    model: &MechanicalModel,
    plan: &Plan,
    fit: &Fit,
    (contact, settings): (&ContactPlan, &Settings),
    analysis: &Analysis,
    control: &Control,
) -> Solution {
    Search { model: Bindable::Motion(Box::new(model.clone()), contact), settings, plan, fit, analysis, control }.run()
}

impl<'a> Search<'a> {
    /// Searches from all starting points, and runs the problem with the best estimates.
    fn run(&self) -> Solution {
        let began = Instant::now();
        let (found, starts) = self.best_of_all_starts();
        let start = self.fit.start(0);
        let point = found.as_ref().map_or(&start, |minimum| &minimum.point);
        let derivatives =
            Sensitivities { by: self.fit.parameters.iter().map(|fitted| fitted.by).collect(), ..self.columns() };
        let bound = self.bound(point, Some(derivatives));
        let (bound, along) = bound.unwrap_or_else(|_| (self.model.clone(), self.plan.clone()));
        let analysis = bound.analyse(self.plan.start);
        let mut solution = self.control.part(SHARE..1.0, || bound.run(&along, self.settings, &analysis, self.control));
        solution.diagnostics.wall_seconds = began.elapsed().as_secs_f64();
        match found {
            Ok(minimum) if solution.status == Status::Completed => self.answer(&minimum, starts, &mut solution),
            Ok(_) => {}
            Err(failure) => {
                let (status, failure) = ending(self.control, failure);
                (solution.status, solution.error) = (status, Some(failure));
            }
        }
        solution
    }

    fn problem<'b>(&self, bounds: &'b [Vec<f64>; 2]) -> LeastSquares<'b> {
        let [lower, upper] = bounds;
        let rank = TOLERANCES * self.settings.rtol;
        LeastSquares { lower, upper, loss: self.fit.loss, is_scaled: self.fit.is_scaled, rank }
    }

    fn bounds(&self) -> [Vec<f64>; 2] {
        let of = |end: fn(&Fitted) -> f64| self.fit.parameters.iter().map(end).collect();
        [of(|fitted| fitted.lower), of(|fitted| fitted.upper)]
    }

    /// Returns the best minimum of the loss from all starting points, or the failure at the first starting point if no
    /// search succeeds.
    fn best_of_all_starts(&self) -> (Result<Minimum, Failure>, Vec<FitStart>) {
        let bounds = self.bounds();
        let problem = self.problem(&bounds);
        let mut best: Result<Minimum, Option<Failure>> = Err(None);
        let mut starts = Vec::new();
        let share = SHARE / self.fit.starts.max(1) as f64;
        for number in 0..self.fit.starts.max(1) {
            if number > 0 && self.control.poll().is_some() {
                break;
            }
            let start = self.fit.start(number);
            let from = self.fit.named(&start);
            let begin = (number as f64 * share).max(BEGIN);
            let found = self.control.part(begin..(number + 1) as f64 * share, || {
                let first = self.residuals(&start)?;
                let goes_on = || self.control.poll().is_none();
                Ok(problem.minimise(start, first, |point, run| self.at(point, run), goes_on))
            });
            let loss = found.as_ref().ok().map(|minimum| minimum.loss);
            let to = found.as_ref().ok().map(|minimum| self.fit.named(&minimum.point));
            starts.push(FitStart { from, to, loss, runs: found.as_ref().map_or(1, |minimum| minimum.runs) });
            best = match (best, found) {
                (Ok(best), Ok(minimum)) if minimum.loss >= best.loss => Ok(best),
                (_, Ok(minimum)) => Ok(minimum),
                (Ok(best), Err(_)) => Ok(best),
                (Err(first), Err(failure)) => Err(first.or(Some(failure))),
            };
        }
        let best = best.map_err(|failure| {
            let failure = failure.unwrap_or_else(|| self.failure("there is no start".to_owned()));
            match failure.code.as_ref() {
                "cancelled" | "wall_time" => failure,
                _ => {
                    let at = if self.fit.starts > 1 {
                        "at any starting point of the fit"
                    } else {
                        "at the starting point of the fit"
                    };
                    let message = format!("the problem cannot be solved {at}: {}", failure.message);
                    Failure { message, ..failure }
                }
            }
        });
        (best, starts)
    }

    fn failure(&self, message: String) -> Failure {
        Failure { code: "no_fit".into(), message, time: self.plan.start, state: self.plan.initial.clone() }
    }

    /// Returns the sensitivities to compute: those of the states that the fitted outputs depend on, with respect to the
    /// fitted parameters and initial values.
    fn columns(&self) -> Sensitivities {
        let states = || self.fit.data.iter().map(|column| column.of);
        let of: Vec<usize> = match states().all(|of| matches!(of, Quantity::State(_))) {
            true => {
                states().filter_map(|of| if let Quantity::State(state) = of { Some(state) } else { None }).collect()
            }
            false => (0..self.plan.initial.len()).collect(),
        };
        let by: Vec<By> = self.fit.parameters.iter().map(|fitted| fitted.by).collect();
        let names = of.iter().flat_map(|&state| {
            let of = &self.plan.names[state];
            self.fit.parameters.iter().map(move |fitted| format!("d{of}/d{}", fitted.name))
        });
        let to = self.fit.parameters.iter().map(|fitted| fitted.name.clone()).collect();
        Sensitivities { names: names.collect(), by, to, of, objective: None }
    }

    /// Binds the model to given parameter values, and sets the initial values in the plan of its run.
    fn bound(&self, point: &[f64], sensitivities: Option<Sensitivities>) -> Result<(Bindable<'a>, Plan), Failure> {
        let mut values = self.model.values().to_vec();
        for (fitted, &value) in self.fit.parameters.iter().zip(point) {
            if let By::Parameter(k) = fitted.by {
                values[k] = value;
            }
        }
        let model = self.model.bound(&values).map_err(|error| self.failure(error))?;
        let mut plan = Plan { initial: model.initial().to_vec(), sensitivities, ..self.plan.clone() };
        plan.observables.bind(&values);
        for (fitted, &value) in self.fit.parameters.iter().zip(point) {
            if let By::Initial(state) = fitted.by {
                plan.initial[state] = value;
            }
        }
        Ok((model, plan))
    }

    fn at(&self, point: &[f64], run: u64) -> Option<Residuals> {
        // The number of runs is unknown in advance: each run accounts for a fraction of the progress that remains to
        // be reported to the user.
        let done = |run: u64| 1.0 - 1.0 / run as f64;
        self.control.part(done(run)..done(run + 1), || self.residuals(point).ok())
    }

    /// Computes the residuals of the fit and their derivatives at given parameters, by one run up to the last time of
    /// the data.
    fn residuals(&self, point: &[f64]) -> Result<Residuals, Failure> {
        let (fit, p) = (self.fit, point.len());
        let columns = self.columns();
        let of = columns.of.clone();
        let (model, mut plan) = self.bound(point, Some(columns))?;
        let observables = std::mem::take(&mut plan.observables);
        let first = plan.names.len();
        plan.fields = of.iter().copied().chain(first..first + of.len() * p).collect();
        plan.times = Some(fit.t.clone());
        plan.end = fit.t.last().copied().filter(|last| *last > plan.start).unwrap_or(plan.end);
        plan.global_error = false;
        let Ended { solution, .. } = model.run_once(&plan, self.settings, self.analysis, self.control);
        if let Some(failure) = solution.error {
            return Err(failure);
        }
        let fields: Vec<&[f64]> = solution.trajectory.fields.iter().map(|field| field.values.as_slice()).collect();
        let (states, derivatives) = fields.split_at(of.len());
        let mut definitions = Definitions::new(observables, first, model.values());
        let m = fit.observations();
        let mut values = DVector::zeros(m);
        let mut jacobian = DMatrix::zeros(m, p);
        let (mut row, mut noise) = (0, 0.0);
        for (number, column) in fit.data.iter().enumerate() {
            for (i, (value, sd)) in column.values.iter().zip(&column.sd).enumerate() {
                let Some(value) = value else { continue };
                let (found, error) = match column.of {
                    Quantity::State(state) => {
                        // If all measured quantities are states, the columns of derivatives are already in the order
                        // of the data.
                        let at = of.iter().position(|of| *of == state).unwrap_or(number);
                        derivatives[at * p..][..p]
                            .iter()
                            .enumerate()
                            .for_each(|(k, by)| jacobian[(row, k)] = by[i] / sd);
                        let found = states[at][i];
                        (found, self.settings.atol[state] + self.settings.rtol * found.abs())
                    }
                    Quantity::Definition(definition) => {
                        let x: Vec<f64> = states.iter().map(|state| state[i]).collect();
                        let found = definitions.at(definition, fit.t[i], &x);
                        for (k, fitted) in fit.parameters.iter().enumerate() {
                            let step = CENTRAL_DIFFERENCE * size(point[k], fitted);
                            let dx: Vec<f64> =
                                (0..of.len()).map(|state| step * derivatives[state * p + k][i]).collect();
                            let parameter =
                                if let By::Parameter(parameter) = fitted.by { Some(parameter) } else { None };
                            let difference = definitions.difference(definition, fit.t[i], (&x, &dx), (parameter, step));
                            jacobian[(row, k)] = difference / (2.0 * step * sd);
                        }
                        (found, self.settings.rtol * found.abs())
                    }
                };
                values[row] = (found - value) / sd;
                noise += (error / sd).powi(2);
                row += 1;
            }
        }
        // The residuals must have finite squares, since the loss sums these.
        if !(values.norm_squared().is_finite() && jacobian.norm_squared().is_finite() && noise.is_finite()) {
            let message = "a residual or its derivative, divided by the standard deviation and squared, is not finite";
            return Err(self.failure(message.to_owned()));
        }
        Ok(Residuals { values, jacobian, noise: noise.sqrt() })
    }

    /// Writes the estimates at a minimum of the loss to the answer, with checks and caveats.
    fn answer(&self, minimum: &Minimum, starts: Vec<FitStart>, solution: &mut Solution) {
        let (fit, bounds) = (self.fit, self.bounds());
        let problem = self.problem(&bounds);
        let checks = &mut solution.diagnostics.checks;
        checks.record(CheckCode::FitDistance, minimum.distance, minimum.allowed, || {
            format!(
                "the estimates are {:.1e} standard errors from the minimum that the derivatives there predict: the search ended \
                 after {} runs without reaching it",
                minimum.distance, minimum.runs
            )
        });
        let size: Vec<f64> =
            minimum.point.iter().zip(&fit.parameters).map(|(value, fitted)| size(*value, fitted)).collect();
        let Some(found) = intervals(&problem, minimum, &size) else {
            let message = "the Jacobian of the fit has no singular values: there are no intervals";
            checks.caveat("no_intervals", message.to_owned());
            return;
        };
        let Intervals { sd, width, covariance, singular_values, undetermined, held } = found;
        let estimate = |k: usize| {
            let (fitted, estimate) = (&fit.parameters[k], minimum.point[k]);
            let end = |sign: f64| sd[k].map(|sd| (estimate + sign * width * sd).clamp(fitted.lower, fitted.upper));
            Estimate { estimate, sd: sd[k], lower: end(-1.0), upper: end(1.0) }
        };
        let parameters = fit.parameters.iter().enumerate().map(|(k, fitted)| (fitted.name.clone(), estimate(k)));
        let undetermined: Vec<BTreeMap<String, f64>> = undetermined
            .iter()
            .map(|parts| {
                let parts = fit.parameters.iter().zip(parts).filter(|(_, part)| **part != 0.0);
                parts.map(|(fitted, part)| (fitted.name.clone(), *part)).collect()
            })
            .collect();
        let m = fit.observations();
        let freedoms = m.saturating_sub(held.iter().filter(|held| !**held).count());
        let squares = minimum.residuals.values.norm_squared();
        let mut values = minimum.residuals.values.iter();
        let mut residual = |(value, sd): (&Option<f64>, &f64)| value.and_then(|_| values.next()).map(|r| -r * sd);
        let residuals = fit
            .data
            .iter()
            .map(|column| (column.name.clone(), column.values.iter().zip(&column.sd).map(&mut residual).collect()))
            .collect();
        let answer = FitAnswer {
            parameters: parameters.collect(),
            names: fit.parameters.iter().map(|fitted| fitted.name.clone()).collect(),
            covariance,
            loss: minimum.loss,
            spread: (squares / freedoms.max(1) as f64).sqrt(),
            observations: m as u64,
            singular_values,
            undetermined,
            residuals,
            starts,
        };
        self.warn(minimum, &answer, (&held, freedoms), solution);
        solution.fit = Some(answer);
    }

    /// Adds caveats about the estimates of a fit to the answer.
    fn warn(&self, minimum: &Minimum, answer: &FitAnswer, (held, freedoms): (&[bool], usize), solution: &mut Solution) {
        let (fit, checks) = (self.fit, &mut solution.diagnostics.checks);
        for parts in &answer.undetermined {
            let parts: Vec<String> = parts.iter().map(|(name, part)| format!("{part:.3} for `{name}`")).collect();
            let message = format!(
                "the data do not determine one combination of the parameters: relative changes in the proportion {} \
                 leave everything that was measured unchanged; fix one of them, or measure a quantity that \
                 distinguishes them",
                parts.join(", ")
            );
            checks.caveat("undetermined", message);
        }
        if let Some(k) = held.iter().position(|held| *held) {
            let (name, value) = (&fit.parameters[k].name, minimum.point[k]);
            let message = format!(
                "`{name}` is at its bound {value:?}, beyond which the loss does not rise: the intervals of the other \
                 parameters assume this value"
            );
            checks.caveat("at_bound", message);
        }
        let squares = minimum.residuals.values.norm_squared();
        if fit.is_scaled && fit.loss == Loss::Squares && is_too_large(squares, freedoms) {
            let message = format!(
                "residuals are {:.2} times the standard deviations given, more than chance makes them: the model does not \
                 describe the data, or `sd` is too small, and the intervals are too narrow",
                answer.spread
            );
            checks.caveat("misfit", message);
        }
        let noise = minimum.residuals.noise;
        // Signs of residuals that are due to the errors of runs are not random, and are not tested.
        if noise.powi(2) < EXACT * squares {
            for (name, residuals) in &answer.residuals {
                let Some(Stretches { count, expected }) = long_stretches(residuals.iter().flatten().copied()) else {
                    continue;
                };
                let message = format!(
                    "the residuals of `{name}` have one sign for long: they form {count} stretches, where chance makes {expected:.0}: \
                     the model does not describe the data, the search ended in a minimum that is not the least, or errors that \
                     follow each other are alike, and the intervals are too narrow"
                );
                checks.caveat("misfit", message);
            }
        }
        let unit = self.problem(&self.bounds()).unit(&minimum.residuals, minimum.loss);
        let rms = noise / (answer.observations as f64).sqrt();
        if fit.is_scaled && rms > 0.1 * unit {
            let message = format!(
                "runs are as exact as {rms:.1e} standard deviations of the data: tighten `rtol` and `atol`, so that the fit is one \
                 of the model and not of its errors"
            );
            checks.caveat("fit_tolerance", message);
        }
        let others = answer.starts.iter().filter_map(|start| start.loss);
        let worse = others.filter(|loss| *loss - minimum.loss > SAME * minimum.loss.max(1.0)).count();
        if worse > 0 {
            let all = answer.starts.len();
            let message = format!(
                "from {worse} of {all} starts the search ended elsewhere, with a larger loss; see `fit.starts`"
            );
            checks.caveat("several_minima", message);
        }
    }
}

/// Returns the magnitude to which relative changes of a fitted parameter with this value refer.
fn size(value: f64, fitted: &Fitted) -> f64 {
    let span = fitted.upper - fitted.lower;
    [value.abs(), fitted.initial.abs(), span].into_iter().find(|size| *size > 0.0 && size.is_finite()).unwrap_or(1.0)
}
