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
    /// The mean; `null` where an impulse leaves it undefined, as that of a function that is not linear in the variable.
    pub mean: Option<f64>,
    /// The root mean square; `null` where an impulse leaves it undefined, as that of a variable with impulses.
    pub rms: Option<f64>,
    /// The minimum.
    pub min: f64,
    /// The maximum.
    pub max: f64,
    /// The maximum minus the minimum.
    pub ripple: f64,
}

/// Statistics of outputs of the problem and of definitions during a run.
pub(super) struct Statistics {
    /// The fields, by their places among the outputs of the problem, then the definitions.
    places: Vec<usize>,
    place: EvaluationBuffer,
    time: f64,
    /// All fields, then their squares, and their integrals.
    integrands: Vec<(usize, bool)>,
    integrals: Integrals,
    extremes: Extremes,
}

impl Statistics {
    /// Statistics of these fields of a problem with so many outputs.
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

    /// Adds the last step, from `from` to `to`, with its impulses.
    pub fn step(&mut self, stepper: &mut impl Stepper, (from, to): (f64, f64), impulses: &[Impulse]) {
        let Self { places, place, time, integrands, integrals, extremes } = self;
        integrate(from, to, integrals, quadrature::Along { stepper, place, integrands });
        extremes.step(from, to, &mut Along { stepper, place, places, uncertain: &[] });
        for impulse in impulses.iter().filter(|impulse| impulse.at <= to) {
            integrals.pass(impulse, place, integrands);
        }
        *time += to - from;
    }

    /// The largest relative uncertainty of a mean or mean square.
    pub fn uncertainty(&self) -> Option<f64> {
        self.integrals.uncertainty().map(|(_, uncertainty)| uncertainty)
    }

    /// The field whose mean square, or mean, an impulse leaves undefined, and the time of that.
    pub fn undefined(&self) -> Option<(usize, f64)> {
        let (integral, t) = self.integrals.undefined()?;
        Some((self.integrands[integral].0, t))
    }

    /// The field whose extremes may be exceeded by most, by what part of its size, and when.
    pub fn open(&self) -> Option<(usize, f64, f64)> {
        let (field, by, t) = self.extremes.open()?;
        Some((self.places[field], by, t))
    }

    /// Returns the statistics of each field.
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
