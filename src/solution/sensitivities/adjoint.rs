//! The gradient of one number, the objective, with respect to many parameters and initial values, by the adjoint of
//! the accepted steps ([`radau::Adjoint`]). The objective is a function of the states at the end, or the integral of
//! such a function over time, given as a definition or an integral of the user.
//!
//! Beside the run, derivatives are propagated in one direction, in which all parameters and initial values move
//! together: they limit the step size as in forward mode, detect where no derivative exists, and must equal the
//! gradient in that direction up to rounding.

use super::{By, MOVED_ALONE, Sensitivities, generic_parts, shifted_by, unshifted};
use crate::observables::{Argument, Observables};
use crate::quadrature::{self, Integrals};
use crate::run::{Ended, Plan};
use crate::{CheckCode, Diagnostics};
use expression::Tape;
use models::DviModel;
use nalgebra::{DMatrix, DVector};
use numerics::CENTRAL_DIFFERENCE;
use radau::{Directions, IntegralWeights, StoredStep, Swept};
use serde::Serialize;
use utoipa::ToSchema;

/// Permitted difference of the gradient from the derivative in one direction, relative to the largest term of the
/// derivative. Both are sums over the same steps up to rounding, but derivatives of breakpoints in time and of hidden
/// constraints are central differences, along each parameter or along all at once, whose accuracy is limited by their
/// increment.
const ALIKE: f64 = CENTRAL_DIFFERENCE;

/// Relative rounding error of a derivative whose terms cancel, relative to the sum of their absolute values: half the
/// digits of a double, since the rounding errors of many steps add up.
const ROUNDING: f64 = 1.5e-8;

/// Largest memory of stored steps, in bytes: a run with few unknowns fills it with some hundred thousand steps, and
/// it is a small part of the memory of a machine.
pub(super) const MOST_STORED: usize = 64 << 20;

/// The quantity whose gradient is requested in adjoint mode: a user-defined quantity (`definitions`) at the end time,
/// or an integral over the run.
#[derive(Clone, Debug)]
pub struct Objective {
    /// The objective, as a set of observables that has it as the only definition or integral, with its derivatives.
    pub observables: Observables,
}

/// The work of the backward sweep over the steps.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, ToSchema)]
pub struct AdjointWork {
    /// Number of steps swept backwards.
    pub steps: u64,
    /// Number of steps that were repeated because storing all steps would have taken too much memory.
    pub repeated: u64,
    /// Number of evaluations of the Jacobian of the rates and of `G`.
    pub jacobians: u64,
    /// Number of factorisations of the transposed equations of a step, each with one solution, whatever the number of
    /// parameters.
    pub factorisations: u64,
    /// Central differences at breakpoints in time and where hidden constraints determine the time of a switch, one
    /// for each state and parameter: the number of differences grows with the number of parameters.
    pub differences: u64,
    /// The largest memory of the stored steps, in bytes.
    pub stored_bytes: u64,
}

/// A gradient, with the evidence for its accuracy.
#[derive(Clone, Debug)]
pub struct Gradient {
    value: f64,
    slopes: Vec<f64>,
    compared: Compared,
    /// The accuracy to which the objective and its derivatives are known.
    resolution: Resolution,
    work: AdjointWork,
}

/// The accuracy to which the objective of adjoint mode and its derivatives are known.
#[derive(Clone, Debug)]
pub(crate) struct Resolution {
    /// The sum over the states of the absolute tolerance of a state times the derivative of the objective with respect
    /// to this state.
    tolerated: f64,
    /// The sum of the absolute values of all terms of the directional derivative of the objective, before terms cancel.
    made_of: f64,
    /// The rate of change of each parameter and initial value along the direction of differentiation.
    speeds: Vec<f64>,
}

impl Resolution {
    /// Returns the accuracy of a finite difference of the objective along a direction.
    pub fn along(&self, direction: &[f64]) -> f64 {
        let parts = direction.iter().zip(&self.speeds).filter(|(_, speed)| **speed != 0.0);
        let farthest = parts.map(|(way, speed)| (way / speed).abs()).fold(0.0, f64::max);
        self.tolerated + ROUNDING * self.made_of * farthest
    }
}

/// The gradient of the objective, multiplied by the direction in which all parameters and initial values move together,
/// and the derivative propagated in that direction.
#[derive(Clone, Copy, Debug)]
struct Compared {
    /// The derivative of the objective in the direction of all parameters and initial values together, computed from
    /// the gradient.
    swept: f64,
    /// The derivative of the objective in the direction of all parameters and initial values together, propagated along
    /// the run.
    followed: f64,
    /// The largest term of the scalar product of gradient and direction, in absolute value.
    terms: f64,
    /// The sum of the absolute values of all terms of the directional derivative of the objective, before terms cancel.
    made_of: f64,
}

impl Compared {
    /// Returns the difference of the two derivatives relative to the permitted one: the errors of central
    /// differences, relative to the derivative and its terms, and rounding errors, relative to all terms that
    /// cancelled.
    fn off(self) -> f64 {
        let Self { swept, followed, terms, made_of } = self;
        let distance = (swept - followed).abs();
        let permitted = ALIKE * terms.max(followed.abs()) + ROUNDING * made_of;
        if distance == 0.0 { 0.0 } else { distance / permitted }
    }
}

impl Gradient {
    /// Writes the gradient of the objective, and the check of the gradient, into an answer.
    pub(crate) fn put(self, plan: &Plan, ended: &mut Ended) {
        let Some(asked) = &plan.sensitivities else { return };
        let solution = &mut ended.solution;
        solution.gradient = asked.to.iter().cloned().zip(self.slopes.iter().copied()).collect();
        solution.objective = Some(self.value);
        let Diagnostics { checks, adjoint, .. } = &mut solution.diagnostics;
        *adjoint = Some(self.work);
        let Compared { swept, followed, .. } = self.compared;
        checks.record(CheckCode::Derivatives, self.compared.off(), 1.0, || {
            format!(
                "the gradient gives {swept:e} in a direction in which the derivative of the same steps is {followed:e}"
            )
        });
        ended.derivatives = self.slopes;
        ended.resolution = Some(self.resolution);
    }
}

/// The objective (the quantity whose gradient is requested) of a run, and the direction along which derivatives are
/// propagated beside the run.
pub(super) struct SweptBack {
    objective: ObjectiveSlopes,
    /// The rate of change of each parameter and initial value along the direction of differentiation.
    pub direction: Vec<f64>,
    /// The user's time at which the time of the steps is zero.
    ahead: f64,
    /// The absolute tolerance of each state.
    atol: Vec<f64>,
    /// The largest memory that the stored steps have taken so far, in bytes.
    largest: usize,
}

/// Returns a single direction of differentiation, along which each parameter and initial value moves at its own speed.
pub(super) fn together(model: &DviModel, by: &[By], speeds: &[f64]) -> Result<Directions, String> {
    let Directions { initial, mut rows, mass, bounds, .. } = unshifted(model, by)?;
    let speeds_of_all = DVector::from_column_slice(speeds);
    let mut own = DMatrix::zeros(0, 0);
    let along = move |t: f64, y: &[f64], out: &mut DMatrix<f64>| {
        if own.nrows() != out.nrows() {
            own = DMatrix::zeros(out.nrows(), speeds_of_all.len());
        }
        rows(t, y, &mut own);
        out.column_mut(0).copy_from(&(&own * &speeds_of_all));
    };
    let moves = |parameter: usize| by.iter().position(|by| *by == By::Parameter(parameter)).map_or(0.0, |k| speeds[k]);
    let is_parametric = by.iter().any(|by| matches!(by, By::Parameter(_)));
    // The speed of each parameter along the direction already contains the size of the parameter.
    let shifted = is_parametric.then(|| shifted_by(model, CENTRAL_DIFFERENCE, moves)).transpose()?;
    Ok(Directions {
        initial: &initial * DMatrix::from_column_slice(speeds.len(), 1, speeds),
        rows: Box::new(along),
        mass: mass.into_iter().map(|(place, direction, value)| (place, 0, value * speeds[direction])).collect(),
        bounds: bounds.into_iter().map(|(bound, direction, value)| (bound, 0, value * speeds[direction])).collect(),
        shifted: vec![shifted],
    })
}

impl SweptBack {
    /// Prepares the requested objective of a run with the parameter values `values`.
    pub fn new(
        plan: &Plan,
        (asked, objective): (&Sensitivities, &Objective),
        values: &[f64],
        (rtol, atol): (f64, &[f64]),
        ahead: f64,
    ) -> Self {
        let size = |by: &By| match *by {
            By::Parameter(k) if values[k] == 0.0 => MOVED_ALONE,
            By::Parameter(k) => values[k].abs(),
            // A state that is zero at the start moves by an amount that its tolerance resolves.
            By::Initial(state) => plan.initial[state].abs().max(atol[state] / rtol),
        };
        let direction = asked.by.iter().zip(generic_parts()).map(|(by, part)| part * size(by)).collect();
        let objective = ObjectiveSlopes::new(&objective.observables, plan.names.len(), &asked.by);
        Self { objective, direction, ahead, atol: atol.to_vec(), largest: 0 }
    }

    /// Updates the largest memory of the stored steps by their present memory `bytes`.
    pub fn watch(&mut self, bytes: usize) {
        self.largest = self.largest.max(bytes);
    }

    /// Computes the gradient of the objective after the last step, where `t` is the end of the run in the user's time
    /// and `x` are the states. `back` propagates derivatives with respect to the states and the directions back to
    /// the start; `along` is the derivative of the objective that was propagated forwards.
    pub fn sweep(
        &mut self,
        (t, x): (f64, &[f64]),
        along: f64,
        back: impl FnOnce(&[f64], &[f64], IntegralOver<'_>) -> Result<(Swept, AdjointWork), String>,
    ) -> Result<Gradient, String> {
        let Self { objective, direction, ahead, atol, .. } = self;
        let of_tolerances =
            |slopes: &[f64]| slopes.iter().zip(&*atol).map(|(slope, atol)| slope.abs() * atol).sum::<f64>();
        let mut by_states = vec![0.0; x.len()];
        let mut by_directions = vec![0.0; direction.len()];
        // The value of the objective, the sum of its terms that depend directly on the directions, and the effect of
        // the tolerances.
        let (mut value, mut direct, mut tolerated) = (0.0, 0.0, 0.0);
        if !objective.is_integral {
            value = objective.at(t, x, &mut by_states, &mut by_directions);
            tolerated = of_tolerances(&by_states);
            direct = by_directions.iter().zip(&*direction).map(|(slope, speed)| (slope * speed).abs()).sum();
        }
        let mut over = |step: &mut StoredStep| {
            objective.is_integral.then(|| {
                let OverStep { gained, direct: sizes, weights } = objective.over(step, (x.len(), *ahead));
                value += gained;
                tolerated += of_tolerances(weights.sizes.as_slice());
                direct += sizes.iter().zip(&*direction).map(|(size, speed)| size * speed.abs()).sum::<f64>();
                weights
            })
        };
        let not_finite = "the objective or a derivative of it is not finite: a division by zero, a root of zero, or a \
                          number too large";
        let is_finite = |slopes: &[f64]| slopes.iter().all(|slope| slope.is_finite());
        if !is_finite(&by_states) || !is_finite(&by_directions) {
            return Err(not_finite.to_owned());
        }
        let (Swept { gradient: slopes, terms: made_of }, work) = back(&by_states, &by_directions, &mut over)?;
        if !value.is_finite() || !is_finite(&slopes) {
            return Err(not_finite.to_owned());
        }
        let terms = slopes.iter().zip(&self.direction).map(|(slope, speed)| slope * speed);
        let (swept, terms) = terms.fold((0.0, 0.0_f64), |(sum, most), term| (sum + term, most.max(term.abs())));
        let made_of = made_of + direct;
        let compared = Compared { swept, followed: along, terms, made_of };
        let resolution = Resolution { tolerated, made_of, speeds: self.direction.clone() };
        let work = AdjointWork { stored_bytes: self.largest as u64, ..work };
        Ok(Gradient { value, slopes, compared, resolution, work })
    }
}

/// Returns the quadrature weights of the objective over a step if the objective is an integral, and `None` otherwise.
pub(super) type IntegralOver<'a> = &'a mut dyn FnMut(&mut StoredStep) -> Option<IntegralWeights>;

impl From<radau::AdjointWork> for AdjointWork {
    fn from(work: radau::AdjointWork) -> Self {
        let radau::AdjointWork { steps, jacobians, factorisations, repeated, differences } = work;
        Self { steps, repeated, jacobians, factorisations, differences, stored_bytes: 0 }
    }
}

/// The contribution of one step of the run to an objective that is an integral.
struct OverStep {
    gained: f64,
    /// The integrals of the absolute values of the partial derivatives of the integrand with respect to the
    /// directions.
    direct: Vec<f64>,
    weights: IntegralWeights,
}

/// The objective, or its integrand if the objective is an integral, with its partial derivatives.
struct ObjectiveSlopes {
    is_integral: bool,
    program: Tape,
    slopes: Tape,
    pattern: Vec<Argument>,
    /// Pairs of the index of a parameter and the index of the direction along which it moves.
    directions: Vec<(usize, usize)>,
    count: usize,
    outputs: Vec<f64>,
}

impl ObjectiveSlopes {
    fn new(observables: &Observables, outputs: usize, by: &[By]) -> Self {
        let parameter = |(direction, by): (usize, &By)| match *by {
            By::Parameter(parameter) => Some((parameter, direction)),
            By::Initial(_) => None,
        };
        Self {
            is_integral: observables.integrals > 0,
            program: observables.program.clone(),
            slopes: observables.slopes.program.clone(),
            pattern: observables.slopes.pattern.iter().map(|&(_, argument)| argument).collect(),
            directions: by.iter().enumerate().filter_map(parameter).collect(),
            count: by.len(),
            outputs: vec![0.0; outputs],
        }
    }

    /// Returns the value of the objective (or of its integrand) at a time and states, and writes the partial
    /// derivatives with respect to the states and to the directions.
    fn at(&mut self, t: f64, x: &[f64], by_states: &mut [f64], by_directions: &mut [f64]) -> f64 {
        let mut value = [0.0];
        self.outputs[..x.len()].copy_from_slice(x);
        self.program.evaluate(t, &self.outputs, &mut value);
        let mut slopes = vec![0.0; self.pattern.len()];
        self.slopes.evaluate(t, x, &mut slopes);
        by_states.fill(0.0);
        by_directions.fill(0.0);
        for (argument, slope) in self.pattern.iter().zip(slopes) {
            match *argument {
                Argument::State(state) => by_states[state] += slope,
                Argument::Parameter(parameter) => {
                    let own = self.directions.iter().filter(|(of, _)| *of == parameter);
                    own.for_each(|&(_, direction)| by_directions[direction] += slope);
                }
            }
        }
        value[0]
    }

    /// Integrates the integrand of the objective and its derivatives over a step; `ahead` is added to the time of the
    /// step to obtain the user's time.
    fn over(&mut self, step: &mut StoredStep, (states, ahead): (usize, f64)) -> OverStep {
        let (n, s, p) = (states, step.step().tableau.stages(), self.count);
        let (mut x, mut by_states, mut by_directions) = (vec![0.0; n], vec![0.0; n], vec![0.0; p]);
        let mut weights = vec![0.0; s];
        let mut sums = Integrals::new(1 + (s + 2) * n + p);
        let (from, to) = step.ends();
        quadrature::integrate(from, to, &mut sums, |t: f64, out: &mut [f64]| {
            step.states_at(t, &mut x);
            out[0] = self.at(ahead + t, &x, &mut by_states, &mut by_directions);
            let of_slope = step.weights_at(t, &mut weights);
            let of_begin = 1.0 - weights.iter().sum::<f64>();
            let all = [of_begin, of_slope].into_iter().chain(weights.iter().copied());
            for (weight, out) in all.zip(out[1..].chunks_exact_mut(n.max(1))) {
                out.iter_mut().zip(&by_states).for_each(|(out, slope)| *out = weight * slope);
            }
            out[1 + (s + 2) * n..].copy_from_slice(&by_directions);
        });
        let row = |values: &[f64], place: usize| DVector::from_column_slice(&values[1 + place * n..][..n]);
        let mut sizes = row(sums.sizes(), 0);
        (0..s).for_each(|j| sizes += row(sums.sizes(), 2 + j));
        let weights = IntegralWeights {
            begin: row(&sums.values, 0),
            slope: row(&sums.values, 1),
            stages: (0..s).map(|j| row(&sums.values, 2 + j)).collect(),
            directions: DVector::from_column_slice(&sums.values[1 + (s + 2) * n..]),
            sizes,
        };
        OverStep { gained: sums.values[0], direct: sums.sizes()[1 + (s + 2) * n..].to_vec(), weights }
    }
}

#[cfg(test)]
mod tests {
    use super::Compared;

    #[test]
    fn rounding_of_what_cancels_is_permitted_and_a_wrong_gradient_is_not() {
        // A derivative whose terms, of size one, cancel up to rounding errors passes the check.
        let rest = Compared { swept: 1e-16, followed: -3e-15, terms: 1e-16, made_of: 1.0 };
        assert!(rest.off() < 1e-6, "{}", rest.off());
        // A difference of the two derivatives of a millionth of their terms exceeds rounding errors.
        assert!(Compared { swept: 1e-6, ..rest }.off() > 1.0);
        // If the derivative does not cancel, a relative error of 5e-5 and a wrong sign are both detected.
        let whole = Compared { swept: 2.0, followed: 2.0, terms: 2.0, made_of: 2.0 };
        assert_eq!(whole.off(), 0.0);
        assert!(Compared { swept: 2.0001, ..whole }.off() > 1.0);
        assert!(Compared { swept: -2.0, ..whole }.off() > 1e4);
        // A wrong sign is detected although the terms of the derivative were a million times larger before they
        // cancelled.
        assert!(Compared { swept: -2.0, made_of: 2e6, ..whole }.off() > 1.0);
        // A difference from a derivative without any terms is an error, however small.
        assert!(Compared { swept: 1e-300, followed: 0.0, terms: 0.0, made_of: 0.0 }.off() > 1.0);
        assert!(Compared { swept: f64::NAN, ..whole }.off().is_nan());
    }
}
