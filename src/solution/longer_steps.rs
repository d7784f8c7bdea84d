//! Evidence of the error of time stepping over impacts: a second run with steps twice as long
//! ([`longer_run`](super::longer_run)), made beside the first at half its cost.
//!
//! For a method of first order the difference of the two runs equals the error of the first run, on average. But an
//! impact may happen at any point of its step, and where both runs move an impact to the same time they do not
//! differ. So each impact also contributes the displacement that follows from its distance in time from the closing
//! of the gap. Contributions of single impacts are summed as independent errors; their systematic part shows in the
//! difference of the runs. Impacts that are located in time contribute nothing. At second order the difference of the
//! runs is three times the error of the first run, and the whole difference counts.
//!
//! Every requested quantity is compared: a state, another output, a user's definition, an integral, a monitor, or a
//! number that a sweep collects. Quantities that are continuous in time are compared at every common time, relative
//! to their largest change over the run, or to their largest value if that is smaller, since the place of zero may be
//! a convention. Velocities, energies and forces jump, at times that differ between the runs by up to a step; their
//! difference is averaged over time, and is relative to their largest value. A quantity that never changes by more
//! than the forces of a single step would change it is compared with that change, since no step resolves less.

use super::given_steps::{GIVEN_STEPS, is_worse};
use super::{CheckCode, Checks};

/// Largest number of moving rigid bodies for which the runs are compared. The single trajectories of many colliding
/// bodies are not reproducible: each collision multiplies a difference several times, so that some tens of collisions
/// in a row amplify a rounding error to the size of a body. Such runs are also the long ones.
pub const MOST_COMPARED: usize = 100;

/// Largest fraction of the time in which a run and the run with longer steps may have identical steps. The error hidden
/// there is then at most the error that the remaining steps show.
const MOST_REPEATED: f64 = 0.5;

/// Fraction of the largest energy that is the least scale for errors of energies. Losses that are zero, such as those
/// of elastic impacts, are only known up to the tolerance of the contact law, 1e-10, which is small compared with the
/// permitted part of this scale.
pub(super) const KNOWN_ENERGY: f64 = 1e-6;

/// Changes of a quantity below this fraction of its largest value are treated as rounding errors.
const ROUNDING: f64 = 1e-12;

/// Behaviour of an output in time, which decides how the output is compared with the run with longer steps.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Kind {
    /// An output that is continuous in time.
    Continuous,
    /// An output that jumps in time, or is a mean over a step.
    Jumping,
    /// An output that is a sum over a step, such as an impulse, and is compared as a mean over the step.
    OfStep,
    /// An output that is zero up to the error of the steps, such as a violation of a constraint, and has a check of
    /// its own.
    Residual,
}

/// The functional of a column (one recorded quantity over time) that is compared between a run and the run with longer
/// steps.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Measure {
    /// The values of the column.
    Values,
    /// The integral of the column over time, or of its square.
    Integral { is_squared: bool },
    /// The times at which the column changes sign.
    Crossings,
}

/// A compared quantity, with its distance from the run with longer steps.
#[derive(Clone, Debug)]
pub(super) struct Quantity {
    /// The name of the quantity in messages.
    pub name: String,
    /// The index of the column that contains the values of the quantity.
    pub column: usize,
    /// The behaviour in time of the column that contains the values.
    pub kind: Kind,
    /// The functional of the column that is compared.
    pub measure: Measure,
    /// The value of the quantity at the start of the run; `None` before the run starts.
    start: Option<f64>,
    /// The scale of the errors of the quantity, `size`: the largest change so far if it is continuous, or else the
    /// largest absolute value; and the largest absolute value, `largest`.
    size: f64,
    largest: f64,
    /// Largest change of the quantity by the forces of one step: the least scale of its errors.
    least: f64,
    /// The largest difference of the quantity between the two runs if it is continuous; the integral of the difference
    /// over time if the quantity jumps.
    distance: f64,
    /// The integral over time of the quantity, and the difference of this integral between the two runs.
    integrals: [f64; 2],
    /// Whether only the values of the quantity at the output times are requested.
    pub is_at_times: bool,
    /// The length of time over which the quantity was compared between the two runs.
    compared: f64,
    /// The sum of the squares of the displacements of the quantity by all impacts so far, each with a timing error of
    /// one step (`carried`), and the largest such sum (`impacts`).
    carried: f64,
    impacts: f64,
    /// The largest displacement of the quantity by impacts in a wrong direction; for a quantity that jumps, the
    /// integral of this displacement over time.
    misled: f64,
    /// The largest displacement of the quantity by variations of data (such as forces) between the times at which steps
    /// evaluate them.
    missed: f64,
    /// The sum, over output times within steps, of the distances of the quantity from its linear interpolation between
    /// the step ends.
    held: f64,
    /// The largest distance, within a step, of the quantity from its linear interpolation between the step ends, due to
    /// impacts.
    bent: f64,
    /// The value of the quantity at the end of the last step.
    last: f64,
    /// The numbers of sign changes of the quantity in both runs, and the largest error of the time of a sign change,
    /// relative to the time since the start.
    crossings: [u32; 2],
    late: f64,
}

impl Quantity {
    /// Creates a quantity to compare, with no measurements.
    pub fn new(name: String, column: usize, kind: Kind, measure: Measure) -> Self {
        Self {
            name,
            column,
            kind,
            measure,
            start: None,
            size: 0.0,
            largest: 0.0,
            least: 0.0,
            distance: 0.0,
            integrals: [0.0; 2],
            is_at_times: false,
            compared: 0.0,
            carried: 0.0,
            impacts: 0.0,
            misled: 0.0,
            missed: 0.0,
            held: 0.0,
            bent: 0.0,
            last: 0.0,
            crossings: [0; 2],
            late: 0.0,
        }
    }

    /// Returns the value of the quantity's column; a sum over a step of length `h` is converted to its mean.
    fn value(&self, y: &[f64], h: f64) -> f64 {
        let value = y[self.column];
        match (self.kind, self.measure) {
            (Kind::OfStep, _) if h > 0.0 => value / h,
            (_, Measure::Integral { is_squared: true }) => value * value,
            _ => value,
        }
    }

    /// Whether the quantity is compared by its largest distance, and not by a mean over time.
    fn is_continuous(&self) -> bool {
        self.kind == Kind::Continuous || self.measure != Measure::Values
    }

    /// Updates the scale and the largest value of the quantity by a value of the run.
    fn meet(&mut self, value: f64) {
        let start = *self.start.get_or_insert(value);
        let from = if self.kind == Kind::Continuous { start } else { 0.0 };
        self.size = self.size.max((value - from).abs());
        self.largest = self.largest.max(value.abs());
    }

    /// Adds the difference of the values of both runs at the end of a step of length `h`, at the time `elapsed` since
    /// the start. `over` is the length of the longer step if it ends at this time, and `None` within the longer step;
    /// values of continuous quantities are compared only if they are `known`.
    fn differ(&mut self, [value, other]: [f64; 2], [h, elapsed]: [f64; 2], over: Option<f64>, known: bool) {
        let distance = (value - other).abs();
        match self.measure {
            Measure::Values if self.kind == Kind::Continuous => {
                if known && is_worse(distance, self.distance) {
                    self.distance = distance;
                }
            }
            Measure::Values => self.distance += over.map_or(0.0, |over| distance * over),
            Measure::Integral { .. } => {
                self.integrals[0] += value * h;
                self.integrals[1] += (value - other) * h;
                self.size = self.size.max(self.integrals[0].abs());
                if is_worse(self.integrals[1].abs(), self.distance) {
                    self.distance = self.integrals[1].abs();
                }
            }
            Measure::Crossings => {
                let rate = (value - self.last) / h;
                if self.last * value < 0.0 || value == 0.0 && self.last != 0.0 {
                    self.crossings[0] += 1;
                    let late = distance / rate.abs() / elapsed;
                    self.late = if is_worse(late, self.late) { late } else { self.late };
                }
                self.last = value;
            }
        }
    }

    /// Returns the relative errors from four sources with their messages: impacts, interpolation within steps, unseen
    /// data, and the difference of the two runs, of which a fraction `repeated` of the time had identical steps;
    /// `within` counts the output times within steps.
    fn errors(&self, repeated: f64, within: u32) -> [(f64, String); 4] {
        let over = if self.is_continuous() || self.compared == 0.0 { 1.0 } else { self.compared };
        let size = self.size.max(self.least).max(ROUNDING * self.largest);
        let relative = |error: f64| if error == 0.0 { 0.0 } else { error / size };
        let by_impacts = relative(self.impacts.sqrt().hypot(self.misled / over));
        let name = &self.name;
        let (of, when) = match self.kind {
            Kind::Continuous => ("change", "by up to"),
            _ => ("value", "in the mean over time by"),
        };
        let part = |error: f64| part_of(error, &format!("its largest {of}"));
        let impacts =
            format!("and impacts whose times or order the steps do not resolve move {name} by {}", part(by_impacts));
        // Where both runs have identical steps, their quantities do not differ, whatever their error.
        let apart = relative(self.distance / over) / (1.0 - repeated);
        let apart = if self.measure == Measure::Crossings { self.late } else { apart };
        let what = format!(
            "and {name} is estimated to be off {when} {}, by which it differs with steps twice as long",
            part(apart)
        );
        let (held, how) = match self.is_continuous() {
            true => (relative(self.bent), "by impacts"),
            false => (relative(self.held / f64::from(within.max(1))), "in the mean"),
        };
        let between =
            format!("and {name} is off by {} at times within steps, {how}: ask for ends of steps", part(held));
        let missed = relative(self.missed);
        let unseen = format!("and data that vary within a step move {name} by {}, unseen by it", part(missed));
        [(by_impacts, impacts), (held, between), (missed, unseen), (apart, what)]
    }
}

/// The comparison of the quantities of a run with another run whose steps are twice as long.
#[derive(Clone, Debug)]
pub(super) struct Comparison {
    /// The quantities that are compared between the two runs.
    pub quantities: Vec<Quantity>,
    /// Whether the steps of the compared run have the default size, and not a size that the user gave.
    is_default: bool,
    /// Advice to the user on how to reduce the errors of the run, for messages.
    pub remedy: &'static str,
    start: f64,
    /// The length of time over which velocities were compared, and the length of time in which both runs had
    /// identical steps.
    compared: f64,
    repeated: f64,
    /// Factor that converts a difference of the two compared runs to the error of the run whose error is sought.
    share: f64,
    /// Number of output times of the run that lie within steps, and not at their ends.
    within: u32,
    /// Whether differences of the two runs at the current time count as errors of the values at the output times; see
    /// [`Comparison::count`].
    counts: bool,
    /// Relative errors from sources other than the difference of the two runs, each with a message that names the
    /// quantity in error.
    others: Vec<(f64, String)>,
    /// The reason why the run with longer steps failed; `None` if it did not.
    failed: Option<String>,
}

impl Comparison {
    /// Creates a comparison of two runs that begins at the time `start`.
    pub fn new(quantities: Vec<Quantity>, start: f64, is_default: bool) -> Self {
        let (compared, repeated, share) = (0.0, 0.0, 1.0);
        let (others, remedy) = (Vec::new(), "give a smaller `step`");
        Self {
            quantities,
            is_default,
            remedy,
            start,
            compared,
            repeated,
            share,
            within: 0,
            counts: true,
            others,
            failed: None,
        }
    }

    /// Updates the scales of errors by the columns `y` of the run at the end of a step of length `h`, or at the start
    /// if `h` is zero.
    pub fn meet(&mut self, y: &[f64], h: f64) {
        for quantity in &mut self.quantities {
            let value = quantity.value(y, h);
            quantity.meet(value);
            if h == 0.0 {
                quantity.last = value;
            }
        }
    }

    /// Raises the least scale of the errors of each quantity to the change of its column by the forces of one step.
    pub fn resolve(&mut self, least: &[f64]) {
        self.quantities.iter_mut().for_each(|of| of.least = of.least.max(least[of.column]));
    }

    /// Reduces the scale of the errors of each continuous quantity from its largest change to its largest absolute
    /// value if that is smaller, as for an oscillation about zero.
    pub fn settle(&mut self) {
        for quantity in
            self.quantities.iter_mut().filter(|of| of.kind == Kind::Continuous && of.measure == Measure::Values)
        {
            quantity.size = quantity.size.min(quantity.largest);
        }
    }

    /// Whether the values of a column are compared between the two runs.
    pub fn compares(&self, column: usize) -> bool {
        self.quantities.iter().any(|of| of.column == column && of.measure == Measure::Values)
    }

    /// Makes all columns of a group, which have one unit, share the largest scale of errors among them, as for the
    /// coordinates of two bodies along the line on which they meet.
    pub fn share_units(&mut self, groups: &[Vec<usize>]) {
        let members = |group: &Vec<usize>| -> Vec<usize> {
            let is_member = |of: &Quantity| group.contains(&of.column) && of.measure == Measure::Values;
            (0..self.quantities.len()).filter(|&k| is_member(&self.quantities[k])).collect()
        };
        let groups: Vec<Vec<usize>> = groups.iter().map(members).collect();
        // Groups of columns may overlap: a scale is passed on through one group per round.
        let mut grows = true;
        while grows {
            grows = false;
            for group in &groups {
                let largest = group.iter().map(|&k| self.quantities[k].size).fold(0.0, f64::max);
                for &k in group {
                    grows |= self.quantities[k].size < largest;
                    self.quantities[k].size = self.quantities[k].size.max(largest);
                }
            }
        }
    }

    /// Adds the squared displacements of the columns by the impacts of a step, each with a timing error of one step;
    /// `remaining` is the time to the end of the run.
    pub fn strike(&mut self, displaced: &[f64], remaining: f64) {
        for quantity in &mut self.quantities {
            let by = displaced[quantity.column];
            quantity.carried += match quantity.measure {
                Measure::Values if quantity.kind == Kind::Continuous => by * by,
                Measure::Integral { is_squared: false } => (by * remaining).powi(2),
                Measure::Integral { is_squared: true } => (2.0 * quantity.largest * by * remaining).powi(2),
                Measure::Values | Measure::Crossings => 0.0,
            };
        }
    }

    /// Whether impacts so far have displaced any compared quantity.
    pub fn carries(&self) -> bool {
        self.quantities.iter().any(|of| of.carried != 0.0)
    }

    /// Updates the largest displacement of each quantity by impacts; for columns that contacts hold fixed (`held` is
    /// not zero) the displacements by earlier impacts are set to zero.
    pub fn carry(&mut self, held: &[f64]) {
        let counts = self.counts;
        for quantity in &mut self.quantities {
            if held[quantity.column] != 0.0 && quantity.measure == Measure::Values {
                quantity.carried = 0.0;
            }
            if counts || !quantity.is_at_times {
                quantity.impacts = quantity.impacts.max(quantity.carried);
            }
        }
    }

    /// Sets whether differences of the two runs at the current time count as errors of the values at the output
    /// times. Runs that differ may agree at a single time by chance, so that differences in the latter half of the
    /// time up to each output time count.
    pub fn count(&mut self, counts: bool) {
        self.counts = counts;
    }

    /// Adds the distances of the columns `at`, those at an output time within a step, from their linear interpolation
    /// `line` between the step ends, for quantities that are not continuous: the value at the end of a step says
    /// little about earlier values within the step.
    pub fn look_within(&mut self, at: &[f64], line: &[f64]) {
        self.within += 1;
        for quantity in self.quantities.iter_mut().filter(|of| !of.is_continuous()) {
            quantity.held += (at[quantity.column] - line[quantity.column]).abs();
        }
    }

    /// Updates the largest distances from linear interpolation at an output time within a step. `bends` is the step
    /// size times the change of the rates of the columns by impacts in the step, and `parts` is the product of the
    /// fractions of the step before and after the output time.
    pub fn bend(&mut self, bends: &[f64], parts: f64) {
        for quantity in self.quantities.iter_mut().filter(|of| of.measure == Measure::Values) {
            let by = parts * bends[quantity.column].abs();
            if quantity.kind == Kind::Continuous && is_worse(by, quantity.bent) {
                quantity.bent = by;
            }
        }
    }

    /// Updates the errors of the quantities by `displaced`, the displacements of the columns at the end of a step of
    /// length `h` that result from impacts in a wrong direction.
    pub fn mislead(&mut self, displaced: &[f64], h: f64) {
        let counts = self.counts;
        let is_compared = |of: &&mut Quantity| of.measure == Measure::Values && (counts || !of.is_at_times);
        for quantity in self.quantities.iter_mut().filter(is_compared) {
            let by = displaced[quantity.column].abs();
            if quantity.kind != Kind::Continuous {
                quantity.misled += h * by;
            } else if is_worse(by, quantity.misled) {
                quantity.misled = by;
            }
        }
    }

    /// Updates the errors of the quantities by `displaced`, the displacements of the columns that result from
    /// variations of data between the times at which steps evaluate them.
    pub fn miss(&mut self, displaced: &[f64]) {
        let counts = self.counts;
        let is_compared = |of: &&mut Quantity| of.measure == Measure::Values && (counts || !of.is_at_times);
        for quantity in self.quantities.iter_mut().filter(is_compared) {
            let by = displaced[quantity.column].abs();
            if is_worse(by, quantity.missed) {
                quantity.missed = by;
            }
        }
    }

    /// Compares the columns of both runs at the time `t`, the end of a step of length `h` of the first run. This time
    /// lies within or, if `ends` is set, at the end of a step of length `length` of the other run. Within a longer
    /// step that contains impacts (`is_bent`) continuous quantities are not compared, since the shorter steps resolve
    /// them better.
    pub fn differ(&mut self, [run, other]: [&[f64]; 2], [t, h]: [f64; 2], (length, ends): (f64, bool), is_bent: bool) {
        let counts = self.counts;
        let over = ends.then_some(length);
        self.compared += over.unwrap_or(0.0);
        let times = [h, t - self.start];
        for quantity in self.quantities.iter_mut().filter(|of| counts || !of.is_at_times) {
            quantity.compared += over.unwrap_or(0.0);
            let values = [quantity.value(run, h), quantity.value(other, length)];
            quantity.differ(values, times, over, !is_bent || ends);
        }
    }

    /// Adds a length of time in which both compared runs had identical steps.
    pub fn repeat(&mut self, time: f64) {
        self.repeated += time;
    }

    /// Adds a relative error from a source other than the difference of the two runs, with the message that names the
    /// quantity in error.
    pub fn note(&mut self, error: f64, what: String) {
        self.others.push((error, what));
    }

    /// Sets the factor that converts a difference of the two compared runs to the error of the run whose error is
    /// sought.
    pub fn share(&mut self, share: f64) {
        self.share = share;
    }

    /// Records that the run with longer steps failed, and why.
    pub fn fail(&mut self, why: String) {
        self.failed = Some(why);
    }

    /// Whether the run with longer steps has not failed.
    pub fn goes_on(&self) -> bool {
        self.failed.is_none()
    }

    /// Records the largest relative error of all compared quantities as a check against the permitted error `allowed`.
    /// An error that is permitted but exceeds a thousandth is reported as a caveat.
    pub fn judge(&self, allowed: f64, checks: &mut Checks) {
        let size = match self.is_default {
            true => "the steps have the default size",
            false => "the steps have the size that `method` gives",
        };
        if let Some(why) = &self.failed {
            checks.record(CheckCode::LocalError, f64::INFINITY, allowed, || {
                format!("{size}, and a run with steps twice as long, which would show what they are worth, failed: {why}; {}", self.remedy)
            });
            return;
        }
        let (error, message) = self.worst();
        let message = format!("{size}, {message}; {}", self.remedy);
        if error > GIVEN_STEPS && error <= allowed {
            checks.caveat("coarse_steps", message.clone());
        }
        checks.record(CheckCode::LocalError, error, allowed, || message);
    }

    /// Returns the largest relative error of all compared quantities, with the message that names the quantity in
    /// error.
    fn worst(&self) -> (f64, String) {
        let mut worst = (0.0, "and what is asked for does not differ with steps twice as long".to_owned());
        let repeated = if self.compared > 0.0 { self.repeated / self.compared } else { 0.0 };
        let moves = |of: &Quantity| of.kind != Kind::Residual && of.size > ROUNDING * of.largest;
        if repeated > MOST_REPEATED && self.quantities.iter().any(moves) {
            let what = format!(
                "and a run with longer steps, which would show what they are worth, could not be made for {:.0} % of the time",
                100.0 * repeated
            );
            return (f64::INFINITY, what);
        }
        let repeated = repeated.min(MOST_REPEATED);
        let judged = self.quantities.iter().filter(|of| of.kind != Kind::Residual);
        let errors = judged.flat_map(|of| {
            let [impacts, held, missed, (apart, what)] = of.errors(repeated, self.within);
            [impacts, held, missed, (self.share * apart, what)]
        });
        for (error, what) in errors.chain(self.others.iter().cloned()) {
            if is_worse(error, worst.0) {
                worst = (error, what);
            }
        }
        worst
    }
}

/// Largest relative error of a quantity that is reported as a number: a larger one belongs to a quantity that is zero
/// up to rounding.
const MOST_TOLD: f64 = 1e3;

/// Formats an error relative to the size of a quantity in words.
pub(super) fn part_of(error: f64, what: &str) -> String {
    if error.is_nan() {
        format!("an unknown part of {what}")
    } else if error <= 1.0 {
        format!("{error:.1e} of {what}")
    } else if error <= MOST_TOLD {
        format!("{error:.1} times {what}")
    } else {
        format!("far more than {what}, which is next to zero")
    }
}

/// Adds the caveat that steps over impacts were not compared with longer steps, with the reason `why`.
pub(super) fn not_compared(checks: &mut Checks, why: &str) {
    checks.caveat("error_not_estimated", format!("what the steps are worth was not estimated: {why}"));
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn errors_of_what_is_next_to_zero_are_told_in_words() {
        let part = |error| part_of(error, "its largest change");
        assert_eq!(part(0.02), "2.0e-2 of its largest change");
        assert_eq!(part(3.0), "3.0 times its largest change");
        for error in [5e14, f64::INFINITY] {
            assert_eq!(part(error), "far more than its largest change, which is next to zero");
        }
        assert_eq!(part(f64::NAN), "an unknown part of its largest change");
    }
}
