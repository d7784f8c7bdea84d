//! Integrals over time along the dense output of a step, by adaptive bisection: the part of the step with the largest
//! difference of two quadrature rules is halved next (Piessens et al. 1983, *QUADPACK*, QAG).
//!
//! Two rules that agree do not exclude a feature between their points. The variation of an integrand that the points
//! do not show ([`expression::Sight`]) is bounded over each part, and a part is halved as long as the bound is
//! significant.

use super::evaluation::EvaluationBuffer;
use super::impulse::Impulse;
use super::run::Stepper;
use numerics::{KRONROD_GAP, kronrod, kronrod_ends};
use std::cmp::Ordering;
use std::collections::BinaryHeap;

/// Difference of two quadrature rules over a part of a step at which they count as equal, relative to the integral of
/// the absolute value up to the end of the step.
const AGREE: f64 = 1e-13;
/// Largest number of parts of a step over which functions are integrated: about the number of periods of an integrand
/// that are resolved within one step. A kink needs some twenty parts.
const MOST_PARTS: usize = 2048;
/// Largest number of integrals that are stored for the parts of one step, if many functions are integrated.
const MOST_SUMS: usize = 200_000;
/// Least limit on the number of parts of a step over which functions are integrated, however many the functions are.
const LEAST_PARTS: usize = 64;
/// The largest relative uncertainty of an integral that is not reported: half the digits of a double.
pub(super) const NEGLIGIBLE: f64 = 1.5e-8;

/// A vector of functions of time to integrate.
pub(super) trait Integrand {
    /// Writes the values of the functions at a time within the step.
    fn at(&mut self, t: f64, out: &mut [f64]);

    /// Discards the samples of the functions to integrate, and begins those of another part of the step.
    fn begin(&mut self) {}

    /// Writes bounds on the variation of the functions to integrate between two times that the samples do not show.
    fn hidden(&mut self, _from: f64, _to: f64, out: &mut [f64]) {
        out.fill(0.0);
    }
}

impl<F: FnMut(f64, &mut [f64])> Integrand for F {
    fn at(&mut self, t: f64, out: &mut [f64]) {
        self(t, out);
    }
}

/// Functions of the outputs of a method to integrate along its last step.
pub(super) struct Along<'a, S> {
    pub stepper: &'a mut S,
    pub place: &'a mut EvaluationBuffer,
    /// The integrands, as indices into the outputs of the problem followed by the values of the expressions, each with
    /// a flag whether it is squared.
    pub integrands: &'a [(usize, bool)],
}

impl<S: Stepper> Integrand for Along<'_, S> {
    fn at(&mut self, t: f64, out: &mut [f64]) {
        self.place.at(self.stepper, t);
        self.place.sample();
        select(self.integrands, self.place, out);
    }

    fn begin(&mut self) {
        self.place.begin();
    }

    fn hidden(&mut self, from: f64, to: f64, out: &mut [f64]) {
        if !self.place.judge(from, to) {
            return out.fill(0.0);
        }
        for (out, &(at, squared)) in out.iter_mut().zip(self.integrands) {
            let (hidden, size) = self.place.hidden(at);
            *out = if squared && hidden > 0.0 { 2.0 * size * hidden } else { hidden };
        }
    }
}

/// Selects the integrands from the values that were evaluated last.
fn select(integrands: &[(usize, bool)], place: &EvaluationBuffer, out: &mut [f64]) {
    for (out, &(at, squared)) in out.iter_mut().zip(integrands) {
        let value = place.got(at);
        *out = if squared { value * value } else { value };
    }
}

/// The integrals of several functions over a run, with their uncertainties.
#[derive(Clone, Debug)]
pub(super) struct Integrals {
    /// The integral of each function up to the end of the last step.
    pub values: Vec<f64>,
    /// For each function, the sum of the differences of the two quadrature rules over those parts of steps at which
    /// bisection ended before the rules agreed.
    uncertain: Vec<f64>,
    /// The integrals of the absolute values of the functions over the run so far, to which uncertainties are related.
    sizes: Vec<f64>,
    /// The functions whose integrals over an impulse are undefined, each with the time of the impulse.
    undefined: Vec<(usize, f64)>,
}

impl Integrals {
    /// Creates integrals of `count` functions, all zero.
    pub fn new(count: usize) -> Self {
        let zeros = || vec![0.0; count];
        Self { values: zeros(), uncertain: zeros(), sizes: zeros(), undefined: Vec::new() }
    }

    /// Adds the integrals of the functions over the impulse at a jump of the states.
    pub fn pass(&mut self, impulse: &Impulse, place: &mut EvaluationBuffer, integrands: &[(usize, bool)]) {
        let evaluate = |t: f64, outputs: &[f64], out: &mut [f64]| {
            place.take(t, outputs);
            select(integrands, place, out);
        };
        for (k, over) in impulse.integrals(self.values.len(), evaluate).enumerate() {
            if let Some(over) = over {
                self.values[k] += over;
                self.sizes[k] += over.abs();
            } else if self.value(k).is_some() {
                self.undefined.push((k, impulse.t));
            }
        }
    }

    /// Returns the first function whose integral is undefined because of an impulse, and the time of the impulse.
    pub fn undefined(&self) -> Option<(usize, f64)> {
        self.undefined.first().copied()
    }

    /// Returns the integral of function `k`; `None` if it is undefined because of an impulse.
    pub fn value(&self, k: usize) -> Option<f64> {
        self.undefined.iter().all(|(undefined, _)| *undefined != k).then(|| self.values[k])
    }

    /// Returns the integrals of the absolute values of the functions over the run so far.
    pub fn sizes(&self) -> &[f64] {
        &self.sizes
    }

    /// Returns the function with the largest uncertainty of its integral relative to the integral of its absolute
    /// value, and this uncertainty.
    pub fn uncertainty(&self) -> Option<(usize, f64)> {
        let relative = self.uncertain.iter().zip(&self.sizes).map(|(uncertain, size)| uncertain / size);
        let known = relative.enumerate().filter(|(_, relative)| *relative > 0.0);
        known.max_by(|a, b| a.1.total_cmp(&b.1))
    }
}

/// The integrals of several functions over a part of a step.
struct Part {
    from: f64,
    to: f64,
    /// For each function: the integral, the difference of the two quadrature rules and of the values at the ends, the
    /// integral of the absolute value, and the bound on the variation that the samples do not show.
    sums: Vec<[f64; 4]>,
    /// The largest error of the integral of a function over this part of the step, in units of the permitted error.
    excess: f64,
}

impl Part {
    fn new(step: (f64, f64), (from, to): (f64, f64), values: &mut [f64], of: &mut impl Integrand) -> Self {
        let mut sums = vec![[0.0; 4]; values.len()];
        of.begin();
        let mut ends = vec![[0.0; 2]; values.len()];
        for ((t, weight, excess), to_ends) in kronrod(from, to).zip(kronrod_ends()) {
            of.at(t, values);
            for (([sum, difference, size, _], ends), value) in sums.iter_mut().zip(&mut ends).zip(&*values) {
                *sum += weight * value;
                *difference += excess * value;
                *size += (weight * value).abs();
                *ends = [0, 1].map(|end| ends[end] + to_ends[end] * value);
            }
        }
        sums.iter_mut().for_each(|[_, difference, ..]| *difference = difference.abs());
        for (end, t) in [from, to].into_iter().enumerate() {
            // The values at the ends of the whole step are not compared with those inside, since outputs may jump
            // there.
            if t == step.0 || t == step.1 {
                continue;
            }
            of.at(t, values);
            for (([_, difference, ..], ends), value) in sums.iter_mut().zip(&ends).zip(&*values) {
                *difference += KRONROD_GAP * (to - from) * (ends[end] - value).abs();
            }
        }
        of.hidden(from, to, values);
        for ([_, _, _, hidden], value) in sums.iter_mut().zip(&*values) {
            *hidden = value * (to - from);
        }
        Self { from, to, sums, excess: 0.0 }
    }

    /// Sets the largest error of the integrals relative to the permitted one, which is a fraction `agree` of the
    /// integrals of the absolute values, `totals`.
    fn weigh(&mut self, totals: &[f64], agree: f64) {
        let shares = [agree, agree.max(NEGLIGIBLE / MOST_PARTS as f64)];
        let excess = self
            .sums
            .iter()
            .zip(totals)
            .flat_map(|([_, difference, _, hidden], total)| {
                [(difference, total), (hidden, total)].into_iter().zip(shares)
            })
            .map(|((error, total), share)| if *error == 0.0 { 0.0 } else { error / (share * total) });
        self.excess = excess.fold(0.0, |most, excess| if excess > most { excess } else { most });
    }

    fn middle(&self) -> f64 {
        self.from + 0.5 * (self.to - self.from)
    }

    fn can_be_halved(&self) -> bool {
        self.from < self.middle() && self.middle() < self.to
    }
}

impl PartialEq for Part {
    fn eq(&self, other: &Self) -> bool {
        self.cmp(other) == Ordering::Equal
    }
}

impl Eq for Part {}

impl PartialOrd for Part {
    fn partial_cmp(&self, other: &Self) -> Option<Ordering> {
        Some(self.cmp(other))
    }
}

impl Ord for Part {
    fn cmp(&self, other: &Self) -> Ordering {
        let longer = (self.to - self.from).total_cmp(&(other.to - other.from));
        self.excess.total_cmp(&other.excess).then(longer).then(other.from.total_cmp(&self.from))
    }
}

/// Adds the integrals of several functions between two times to `integrals`, with their uncertainties.
pub(super) fn integrate(from: f64, to: f64, integrals: &mut Integrals, mut of: impl Integrand) {
    let Integrals { values: before, uncertain, sizes, .. } = integrals;
    let most = (MOST_SUMS / before.len().max(1)).clamp(LEAST_PARTS, MOST_PARTS);
    let mut values = vec![0.0; before.len()];
    // In a step that is short relative to the time itself, rounding errors of the time limit the accuracy of the
    // integrand.
    let agree = AGREE.max(f64::EPSILON * from.abs().max(to.abs()) / (to - from));
    let mut whole = Part::new((from, to), (from, to), &mut values, &mut of);
    let mut totals: Vec<f64> = sizes.iter().zip(&whole.sums).map(|(before, [_, _, size, _])| before + size).collect();
    whole.weigh(&totals, agree);
    let mut open = BinaryHeap::from([whole]);
    let mut done = Vec::new();
    while let Some(mut part) = open.pop() {
        // The permitted error is relative to the integrals of the absolute values, `totals`, which other parts may
        // have enlarged since the error of this part was computed.
        part.weigh(&totals, agree);
        if part.excess > 1.0 && part.can_be_halved() && done.len() + open.len() + 2 <= most {
            let middle = part.middle();
            let mut halves =
                [(part.from, middle), (middle, part.to)].map(|ends| Part::new((from, to), ends, &mut values, &mut of));
            for (k, total) in totals.iter_mut().enumerate() {
                let [of_first, of_last, of_part] = [&halves[0], &halves[1], &part].map(|part| part.sums[k][2]);
                *total = total.max(*total + (of_first + of_last - of_part));
            }
            halves.iter_mut().for_each(|half| half.weigh(&totals, agree));
            open.extend(halves);
        } else {
            done.push(part);
        }
    }
    done.sort_by(|a, b| a.from.total_cmp(&b.from));
    for Part { sums, excess, from: begin, to: end } in &done {
        let is_least = end - begin <= 2.0 * agree * (to - from);
        for (k, [sum, difference, size, hidden]) in sums.iter().enumerate() {
            before[k] += sum;
            sizes[k] += size;
            // Next to a singularity the variation of the integrand has no bound; in a part too short to be halved,
            // the integral of its absolute value is taken as the bound.
            let hidden = if hidden.is_finite() || !is_least { *hidden } else { *size };
            uncertain[k] += if *excess > 1.0 { difference + hidden } else { 0.0 };
        }
    }
}

#[cfg(test)]
mod tests {
    use super::{Integrals, NEGLIGIBLE, integrate};

    fn integral(to: f64, f: impl Fn(f64) -> f64) -> (f64, f64) {
        let mut integrals = Integrals::new(1);
        integrate(0.0, to, &mut integrals, |t: f64, out: &mut [f64]| out[0] = f(t));
        (integrals.values[0], integrals.uncertainty().map_or(0.0, |(_, uncertainty)| uncertainty))
    }

    #[test]
    fn hundreds_of_periods_within_one_step_are_resolved() {
        let (found, uncertain) = integral(10.0, |t| (50.0 * t).sin().powi(2));
        let exact = 5.0 - 1000.0_f64.sin() / 200.0;
        assert!((found - exact).abs() < 1e-11 && uncertain < NEGLIGIBLE, "{found:?}, {uncertain:e}");
    }

    #[test]
    fn kinks_are_resolved_and_what_is_not_is_counted() {
        let (found, uncertain) = integral(10.0, |t| (30.0 * t).sin().abs());
        // The exact integral of `|sin 30 t|` up to 10: 95 half periods with 2/30 each, and a part of another half
        // period.
        let exact = (95.0 * 2.0 + 1.0 - (300.0 - 95.0 * std::f64::consts::PI).cos()) / 30.0;
        assert!((found - exact).abs() < 1e-9 * exact && uncertain < 1e-6, "{found:?} for {exact}, {uncertain:e}");
        let (_, uncertain) = integral(1.0, |t| (1e6 * t).sin());
        assert!(uncertain > NEGLIGIBLE, "{uncertain:e}");
    }
}
