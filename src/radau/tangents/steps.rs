//! Steps that resolve the derivatives as well as the states: a solution at rest is exact in steps of any length, but
//! solutions near it are not. The slopes of the derivatives jump from the polynomial of one step to that of the next;
//! the jump, `gamma e` of the embedded estimate `e` for nonstiff equations, bounds the size of the next step as it
//! does for the states.
//!
//! Errors are measured against the largest value of a derivative so far, plus the derivative that changes a state by
//! its absolute tolerance if the parameter is changed by its own magnitude, or by one if that is smaller (Hindmarsh
//! et al. 2005, *SUNDIALS*: `atol_i` divided by the magnitude of the parameter, which would leave no digit of the
//! derivatives with respect to a tiny one), plus the effect of rounding errors of the states.

use super::Tangents;
use crate::stepper::Radau;
use crate::tableau::Tableau;
use hybrid::OneStep;
use nalgebra::DMatrix;
use numerics::CENTRAL_DIFFERENCE;

/// Safety factor of the step size that the error of the derivatives allows, and the bounds of its change from one step
/// to the next.
const SAFETY: f64 = 0.9;
const LEAST_CHANGE: f64 = 0.2;
const LARGEST_CHANGE: f64 = 8.0;

/// Rounding error of the states in a step, relative to their magnitudes: that of some hundred operations.
const ROUNDING: f64 = 1e-13;

/// Relative error that rounding of its ends leaves in the length of the shortest step that is made for the sake of
/// the derivatives.
const KNOWN: f64 = 1e-4;

/// Largest size of a repeated step, relative to the step that it replaces: less than one, so that attempts come to an
/// end.
const LARGEST_RETRIED: f64 = 0.5;

impl Tangents {
    pub(super) fn remember_largest(&mut self) {
        self.largest.zip_apply(&self.now, |largest, now| *largest = largest.max(now.abs()));
    }

    /// Estimates the error of the derivatives in the last step, and bounds the size of the next step by that error.
    pub(super) fn limit_step(&mut self, radau: &mut Radau<'_>) {
        let Some(lacking) = &self.slopes[0] else { return };
        self.error = radau.limit_next_step(lacking, &self.largest, |direction| self.size_of(direction));
    }

    /// Returns the size of a step to replace the last one if the derivatives in it are not accurate enough; `None` if
    /// they are, or if no other size may be taken.
    pub(super) fn shorter(&self, radau: &Radau<'_>) -> Option<f64> {
        let error = self.error.filter(|error| *error > 1.0 && radau.settings.step.is_none())?;
        let h = radau.last.h * change_of_step(error, radau.orders.last().tableau).min(LARGEST_RETRIED);
        (h >= radau.shortest_of_derivatives()).then_some(h)
    }

    /// Bounds the size of the first step behind a switch: derivatives may have jumped in a direction in which the
    /// states do not move.
    pub(super) fn limit_first_step(&mut self, radau: &mut Radau<'_>) {
        let (now, y) = (self.now.clone(), radau.y().to_vec());
        let slopes = match self.mass.nrows() == y.len() {
            true => self.slopes_at(radau.t(), &y, &now),
            false => self.slopes_on_face(radau),
        };
        if let Some(slopes) = slopes {
            radau.limit_first_step(&slopes, &self.largest, |direction| self.size_of(direction));
        }
    }

    /// Returns the magnitude of the parameter that a direction changes, and the effect of the direction on the states
    /// at the start.
    fn size_of(&self, direction: usize) -> DirectionSize<'_> {
        let shifted = self.directions.shifted.get(direction).and_then(Option::as_ref);
        // The shift of a parameter is a fixed fraction of its magnitude.
        let of_parameter = shifted.map_or(0.0, |shifted| shifted.by / CENTRAL_DIFFERENCE);
        DirectionSize::new(of_parameter, &self.directions.initial, direction)
    }
}

/// Magnitude of the parameter or initial values that a direction of differentiation changes.
#[derive(Clone, Copy, Debug)]
pub struct DirectionSize<'a> {
    /// The magnitude of the parameter; zero if there is none, or it is unknown.
    pub of_parameter: f64,
    /// The derivatives of the states at the start along the direction.
    pub initial: &'a [f64],
}

impl<'a> DirectionSize<'a> {
    /// Creates the magnitude of the direction with the index `direction`, a column of `initial`.
    pub fn new(of_parameter: f64, initial: &'a DMatrix<f64>, direction: usize) -> Self {
        let states = initial.nrows();
        Self { of_parameter, initial: &initial.as_slice()[direction * states..][..states] }
    }
}

impl Radau<'_> {
    /// Bounds the next step by the error of the derivatives in the last one, and returns that error in units of the
    /// tolerances. `lacking` are the slopes that the polynomials of the derivatives lack at the beginning of the
    /// step, times the step size, one direction per column; `largest` are the largest derivatives so far.
    pub fn limit_next_step<'a>(
        &mut self,
        lacking: &DMatrix<f64>,
        largest: &DMatrix<f64>,
        size_of: impl Fn(usize) -> DirectionSize<'a>,
    ) -> Option<f64> {
        let method = self.orders.last();
        let gamma = method.tableau.gamma?;
        let rtol = self.settings.rtol;
        let least =
            |per_size: f64, atol: f64, size: f64| (per_size.min(1.0) * atol + ROUNDING * per_size * size) / rtol;
        let error = self.norm_of_derivatives((lacking, largest), size_of, least) / (gamma * method.tolerance.rtol);
        let wished = self.last.h * change_of_step(error, method.tableau);
        self.h = self.h.min(wished.max(self.shortest_of_derivatives()));
        Some(error)
    }

    /// Returns the size of the shortest step that is made for the sake of the derivatives. Near the end of a motion
    /// that varies with a fractional power of the time left, as the direction of a slip does, no step resolves the
    /// derivatives; there the step size follows from the states alone.
    fn shortest_of_derivatives(&self) -> f64 {
        self.clock.rounding(0.0) / KNOWN
    }

    /// Bounds the size of the first step behind an event, at which the derivatives have the slopes (time derivatives)
    /// `slopes`.
    pub fn limit_first_step<'a>(
        &mut self,
        slopes: &DMatrix<f64>,
        largest: &DMatrix<f64>,
        size_of: impl Fn(usize) -> DirectionSize<'a>,
    ) {
        let method = self.orders.current();
        let reach = method.tolerance.rtol.powf(1.0 / (method.tableau.stages() as f64 + 1.0));
        let rtol = self.settings.rtol;
        let least = |per_size, atol, size| per_size * (size + atol / rtol);
        let speed = self.norm_of_derivatives((slopes, largest), size_of, least);
        if speed > 0.0 {
            self.h = self.h.min((reach / speed).max(self.shortest_of_derivatives()));
        }
    }

    /// Returns the largest root mean square, over the directions, of the changes of the derivatives relative to their
    /// sizes. The size of a derivative is its largest value plus `least`, a function of the inverse magnitude of the
    /// direction, and of the absolute tolerance and the magnitude of a state.
    fn norm_of_derivatives<'a>(
        &self,
        (changes, largest): (&DMatrix<f64>, &DMatrix<f64>),
        size_of: impl Fn(usize) -> DirectionSize<'a>,
        least: impl Fn(f64, f64, f64) -> f64,
    ) -> f64 {
        let (settings, reached) = (&self.settings, &self.largest()[..changes.nrows()]);
        let of_direction = |(direction, (changes, largest)): (usize, (&[f64], &[f64]))| {
            let DirectionSize { of_parameter, initial } = size_of(direction);
            let moved = initial.iter().zip(reached).filter(|(_, size)| **size > 0.0);
            let moved = moved.map(|(initial, size)| initial.abs() / size);
            let per_size = moved.fold(if of_parameter > 0.0 { of_parameter.recip() } else { 0.0 }, f64::max);
            let sizes = settings.atol.iter().zip(reached).map(|(atol, size)| least(per_size, *atol, *size));
            let terms = changes.iter().zip(largest).zip(sizes).map(|((change, largest), least)| {
                let size = largest + least;
                if size > 0.0 { (change / size).powi(2) } else { 0.0 }
            });
            (terms.sum::<f64>() / reached.len().max(1) as f64).sqrt()
        };
        let n = changes.nrows().max(1);
        let directions = changes.as_slice().chunks(n).zip(largest.as_slice().chunks(n));
        directions.enumerate().map(of_direction).fold(0.0, f64::max)
    }
}

/// Returns the change of the step size, as a factor, that brings an error of the derivatives to the tolerance.
fn change_of_step(error: f64, tableau: &Tableau) -> f64 {
    let change = SAFETY * error.powf(-1.0 / (tableau.stages() as f64 + 1.0));
    change.clamp(LEAST_CHANGE, LARGEST_CHANGE)
}
