//! Mean, root mean square, minimum and maximum of outputs over a run, along the dense output: by quadrature, and by
//! searches for extremes within steps, so that output times have no influence.

use super::evaluation::{Along, EvaluationBuffer};
use super::extremes::Extremes;
use super::impulse::Impulse;
use super::observables::Observables;
use super::quadrature::{self, Integrals, integrate};
use super::run::Stepper;
use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

/// Statistics of an output over a time interval.
#[derive(Clone, Copy, Debug, PartialEq, Deserialize, Serialize, ToSchema)]
pub struct OverTime {
    /// The mean; `null` if it is undefined because of an impulse, such as for a nonlinear function of the variable.
    pub mean: Option<f64>,
    /// The root mean square; `null` if it is undefined because of an impulse, such as for a variable with impulses.
    pub rms: Option<f64>,
    /// The minimum of the output over the interval.
    pub min: f64,
    /// The maximum of the output over the interval.
    pub max: f64,
    /// The maximum minus the minimum of the output over the interval.
    pub ripple: f64,
}

/// Statistics of outputs of the problem and of definitions during a run.
pub(super) struct Statistics {
    /// The fields with statistics, as indices into the outputs of the problem followed by the user's definitions.
    places: Vec<usize>,
    place: EvaluationBuffer,
    time: f64,
    /// The integrands of the means: all fields, then their squares.
    integrands: Vec<(usize, bool)>,
    integrals: Integrals,
    extremes: Extremes,
}

impl Statistics {
    /// Creates the statistics of a problem with `outputs` outputs; `places` are the indices of the fields into the
    /// outputs followed by the definitions.
    pub fn new(places: Vec<usize>, outputs: usize, of: &Observables) -> Self {
        let (integrals, extremes) = (Integrals::new(2 * places.len()), Extremes::new(places.len()));
        Self {
            place: EvaluationBuffer::new(&of.program, [outputs, of.values()], true),
            integrands: [false, true]
                .iter()
                .flat_map(|squared| places.iter().map(|place| (*place, *squared)))
                .collect(),
            places,
            time: 0.0,
            integrals,
            extremes,
        }
    }

    /// Adds the last step of a run, from `from` to `to`, with its impulses.
    pub fn step(&mut self, stepper: &mut impl Stepper, (from, to): (f64, f64), impulses: &[Impulse]) {
        let Self { places, place, time, integrands, integrals, extremes } = self;
        integrate(from, to, integrals, quadrature::Along { stepper, place, integrands });
        extremes.step(from, to, &mut Along { stepper, place, places, uncertain: &[] });
        for impulse in impulses.iter().filter(|impulse| impulse.at <= to) {
            integrals.pass(impulse, place, integrands);
        }
        *time += to - from;
    }

    /// Returns the largest relative uncertainty of a mean or mean square.
    pub fn uncertainty(&self) -> Option<f64> {
        self.integrals.uncertainty().map(|(_, uncertainty)| uncertainty)
    }

    /// Returns the first field whose mean or mean square is undefined because of an impulse, and the time of the
    /// impulse.
    pub fn undefined(&self) -> Option<(usize, f64)> {
        let (integral, t) = self.integrals.undefined()?;
        Some((self.integrands[integral].0, t))
    }

    /// Returns the field whose minimum or maximum is least certain: by how much the extreme may be exceeded, relative
    /// to its size, and at what time.
    pub fn open(&self) -> Option<(usize, f64, f64)> {
        let (field, by, t) = self.extremes.open()?;
        Some((self.places[field], by, t))
    }

    /// Returns the statistics of each field, with the index of the field.
    pub fn finish(self) -> Vec<(usize, OverTime)> {
        let over_time = |k: usize| self.integrals.value(k).map(|integral| integral / self.time);
        let of = |(k, place): (usize, &usize)| {
            let (min, max) = self.extremes.of(k);
            let rms = over_time(self.places.len() + k).map(|square| square.max(0.0).sqrt());
            (*place, OverTime { mean: over_time(k), rms, min, max, ripple: max - min })
        };
        self.places.iter().enumerate().map(of).collect()
    }
}
