//! Mean, root mean square, minimum and maximum of outputs over a run, along the dense output: by quadrature, and by
//! searches for extremes within steps, so that output times have no influence.

use super::evaluation::EvaluationBuffer;
use super::extremes::Extremes;
use super::impulse::Impulse;
use super::observables::Observables;
use super::quadrature::{Integrals, Integrand, integrate};
use super::run::Stepper;
use hybrid::Followed;
use numerics::Interval;
use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

/// Statistics of an output over a time interval.
#[derive(Clone, Copy, Debug, PartialEq, Deserialize, Serialize, ToSchema)]
pub struct OverTime {
    /// The mean.
    pub mean: f64,
    /// The root mean square.
    pub rms: f64,
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
    pub places: Vec<usize>,
    place: EvaluationBuffer,
    time: f64,
    /// The integrals of all fields, then of their squares.
    integrals: Integrals,
    extremes: Extremes,
}

/// The fields along the last step of a method.
struct Along<'a, S> {
    stepper: &'a mut S,
    place: &'a mut EvaluationBuffer,
    places: &'a [usize],
}

impl<S: Stepper> Followed for Along<'_, S> {
    fn monitors(&mut self, t: f64, out: &mut [f64]) {
        self.place.at(self.stepper, t);
        select(self.places, [&self.place.outputs, &self.place.values], out);
    }

    fn enclose(&mut self, from: f64, to: f64, out: &mut [Interval]) -> bool {
        let ranges = self.place.enclose(self.stepper, (from, to), &[]);
        ranges.is_some_and(|ranges| {
            select(self.places, ranges, out);
            true
        })
    }
}

impl<S: Stepper> Integrand for Along<'_, S> {
    fn at(&mut self, t: f64, out: &mut [f64]) {
        let (values, squares) = out.split_at_mut(self.places.len());
        self.monitors(t, values);
        square(values, squares);
        self.place.sample();
    }

    fn begin(&mut self) {
        self.place.begin();
    }

    fn hidden(&mut self, from: f64, to: f64, out: &mut [f64]) {
        out.fill(0.0);
        if !self.place.judge(from, to) {
            return;
        }
        let (values, squares) = out.split_at_mut(self.places.len());
        let outputs = self.place.outputs.len();
        let definitions = self.places.iter().map(|place| place.checked_sub(outputs));
        for ((value, square), definition) in values.iter_mut().zip(squares).zip(definitions) {
            let Some(definition) = definition else { continue };
            let (hidden, size) = self.place.hidden(definition);
            *value = hidden;
            *square = if hidden > 0.0 { 2.0 * size * hidden } else { hidden };
        }
    }
}

/// Selects what stands at these places among outputs, then definitions.
fn select<T: Copy>(places: &[usize], [outputs, definitions]: [&[T]; 2], out: &mut [T]) {
    let at = |place: usize| outputs.get(place).copied().unwrap_or_else(|| definitions[place - outputs.len()]);
    out.iter_mut().zip(places).for_each(|(out, &place)| *out = at(place));
}

fn square(values: &[f64], squares: &mut [f64]) {
    squares.iter_mut().zip(values).for_each(|(square, value)| *square = value * value);
}

impl Statistics {
    /// Statistics of these fields of a problem with so many outputs.
    pub fn new(places: Vec<usize>, outputs: usize, of: &Observables) -> Self {
        let (integrals, extremes) = (Integrals::new(2 * places.len()), Extremes::new(places.len()));
        Self {
            place: EvaluationBuffer::new(&of.program, [outputs, of.values()], true),
            places,
            time: 0.0,
            integrals,
            extremes,
        }
    }

    /// Adds the last step, from `from` to `to`, with its impulses.
    pub fn step(&mut self, stepper: &mut impl Stepper, (from, to): (f64, f64), impulses: &[Impulse]) {
        let Self { places, place, time, integrals, extremes } = self;
        integrate(from, to, integrals, Along { stepper, place, places });
        extremes.step(from, to, &mut Along { stepper, place, places });
        for impulse in impulses.iter().filter(|impulse| impulse.at <= to) {
            integrals.pass(impulse, |t, outputs, out| {
                let (values, squares) = out.split_at_mut(places.len());
                place.take(t, outputs);
                select(places, [&place.outputs, &place.values], values);
                square(values, squares);
            });
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
        Some((self.places[integral % self.places.len()], t))
    }

    /// The field whose extremes may be exceeded by most, by what part of its size, and when.
    pub fn open(&self) -> Option<(usize, f64, f64)> {
        let (field, by, t) = self.extremes.open()?;
        Some((self.places[field], by, t))
    }

    /// Returns the statistics of each field.
    pub fn finish(self) -> Vec<(usize, OverTime)> {
        let (means, squares) = self.integrals.values.split_at(self.places.len());
        let all = self.places.iter().zip(means.iter().zip(squares)).enumerate();
        all.map(|(k, (place, (mean, square)))| {
            let (min, max) = self.extremes.of(k);
            let rms = (square / self.time).max(0.0).sqrt();
            (*place, OverTime { mean: mean / self.time, rms, min, max, ripple: max - min })
        })
        .collect()
    }
}
