//! Evidence of the error of time stepping over impacts: a second run with steps twice as long
//! ([`longer_run`](super::longer_run)), made beside the first at half its cost.
//!
//! For a method of first order the difference of the two runs is the error of the first, on the average: an impact happens at
//! any point of its step, and where both runs move it to the same time, they do not differ. So an impact also counts by
//! what a step misplaces it, beside the time at which the gap closes. Impacts add up like independent errors; what they have
//! in common, the runs show. Impacts that are located in time are not misplaced; at second order the difference of the runs is
//! three times the error of the first, and the whole of it counts.
//!
//! What is asked for is compared, be it a state, another output, a definition, an integral, a monitor or what a sweep
//! collects. What is continuous in time is compared at every common time, relative to its largest change over the run, or to its
//! largest value if that is smaller: where it is zero may be a convention. Velocities, energies and forces jump, at times that
//! differ from run to run by up to a step, and are compared in the mean over time, relative to their largest values. What never changes by more than what the forces of a single step would make of it is relative to that, since no step
//! resolves less.

use super::given_steps::{GIVEN_STEPS, is_worse};
use super::{CheckCode, Checks};

/// The number of moving bodies up to which rigid bodies are compared. What many bodies that collide with each other do one by
/// one is not reproducible: each collision multiplies a difference several times, so that some tens of collisions in a
/// row make one of rounding as large as a body. Such runs are also the long ones.
pub const MOST_COMPARED: usize = 100;

/// The part of the time in which both runs may have the same steps. What these hide is then no more than what the others
/// show.
const MOST_REPEATED: f64 = 0.5;

/// The part of the largest energy below which energies are not compared with themselves: losses that are zero, such as those of
/// elastic impacts, are known up to the tolerance of the law of contact, 1e-10, which is then a small part of what is permitted.
pub(super) const KNOWN_ENERGY: f64 = 1e-6;

/// A change this small beside the largest value is rounding.
const ROUNDING: f64 = 1e-12;

/// The kind of an output of a problem.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Kind {
    /// It is continuous in time.
    Continuous,
    /// It jumps, or is a mean over a step.
    Jumping,
    /// It is a sum over a step, such as an impulse, and is compared in the mean over the step.
    OfStep,
    /// It is zero but for the error of the steps, and has a check of its own.
    Residual,
}

/// What of a column is compared.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Measure {
    /// Its values.
    Values,
    /// Its integral over time, or that of its square.
    Integral { is_squared: bool },
    /// The times at which it changes its sign.
    Crossings,
}

/// What is compared, and its distance from that of the run with longer steps.
#[derive(Clone, Debug)]
pub(super) struct Quantity {
    /// What it is called in messages.
    pub name: String,
    /// The column of its values.
    pub column: usize,
    /// The kind of the column.
    pub kind: Kind,
    /// What of it is compared.
    pub measure: Measure,
    /// The value at the start, once the run has started.
    start: Option<f64>,
    /// Its size so far: its largest change if it is continuous, else its largest value; and the largest value.
    size: f64,
    largest: f64,
    /// What the forces of a step make of it.
    least: f64,
    /// The largest distance of what is continuous; the integral over time of that of what jumps.
    distance: f64,
    /// The integral over time, and how far the integrals are apart.
    integrals: [f64; 2],
    /// Whether nothing but its values at the output times is asked for.
    pub is_at_times: bool,
    /// The time over which it was compared.
    compared: f64,
    /// The sum of the squares of what impacts so far, each off by a step, change of it, and the largest such sum.
    carried: f64,
    impacts: f64,
    /// The largest displacement by impacts in a wrong direction; for what jumps, its integral over time.
    misled: f64,
    /// The largest displacement by data that steps do not see.
    missed: f64,
    /// The sum of the distances of values within steps from the lines between the ends.
    held: f64,
    /// The largest distance of values within steps from them by impacts.
    bent: f64,
    /// The value at the end of the last step.
    last: f64,
    /// The numbers of changes of sign of both runs, and the largest error of the time of one, relative to the time since the
    /// start.
    crossings: [u32; 2],
    late: f64,
}

impl Quantity {
    /// Something to compare.
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

    /// The value of the column, with sums over a step of length `h` as means.
    fn value(&self, y: &[f64], h: f64) -> f64 {
        let value = y[self.column];
        match (self.kind, self.measure) {
            (Kind::OfStep, _) if h > 0.0 => value / h,
            (_, Measure::Integral { is_squared: true }) => value * value,
            _ => value,
        }
    }

    /// Whether it is compared by its largest distance.
    fn is_continuous(&self) -> bool {
        self.kind == Kind::Continuous || self.measure != Measure::Values
    }

    /// Notes a value of the run.
    fn meet(&mut self, value: f64) {
        let start = *self.start.get_or_insert(value);
        let from = if self.kind == Kind::Continuous { start } else { 0.0 };
        self.size = self.size.max((value - from).abs());
        self.largest = self.largest.max(value.abs());
    }

    /// Notes values of both runs at the end of a step of length `h` of the run, at a time `elapsed` since the start, where the
    /// step of the run with longer steps is of length `over`, or goes on; places are compared if they are `known`.
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

    /// The error relative to its size, and how it is told.
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
        // Where both runs have the same steps they do not differ, whatever their error.
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

/// The comparison of a run with one whose steps are twice as long.
#[derive(Clone, Debug)]
pub(super) struct Comparison {
    /// What is compared.
    pub quantities: Vec<Quantity>,
    /// Whether the steps have the default size.
    is_default: bool,
    /// What to do about errors.
    pub remedy: &'static str,
    start: f64,
    /// The time over which velocities were compared, and the time in which both runs had the same steps.
    compared: f64,
    repeated: f64,
    /// The part of a difference that is the error.
    share: f64,
    /// The number of output times within steps.
    within: u32,
    /// Whether what is asked for at the output times depends on the present time.
    counts: bool,
    /// Errors of other kinds, relative, with what they are errors of.
    others: Vec<(f64, String)>,
    /// Why the other run came to an end.
    failed: Option<String>,
}

impl Comparison {
    /// Prepares a comparison from the time `start` on.
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

    /// Notes the columns of the run at the end of a step of length `h`, or at the start.
    pub fn meet(&mut self, y: &[f64], h: f64) {
        for quantity in &mut self.quantities {
            let value = quantity.value(y, h);
            quantity.meet(value);
            if h == 0.0 {
                quantity.last = value;
            }
        }
    }

    /// Notes what the forces of a step make of the columns.
    pub fn resolve(&mut self, least: &[f64]) {
        self.quantities.iter_mut().for_each(|of| of.least = of.least.max(least[of.column]));
    }

    /// Takes the sizes of what is continuous: its largest change, or its largest value if that is smaller, as of a swing between
    /// two sides of zero.
    pub fn settle(&mut self) {
        for quantity in
            self.quantities.iter_mut().filter(|of| of.kind == Kind::Continuous && of.measure == Measure::Values)
        {
            quantity.size = quantity.size.min(quantity.largest);
        }
    }

    /// Whether the values of a column are compared.
    pub fn compares(&self, column: usize) -> bool {
        self.quantities.iter().any(|of| of.column == column && of.measure == Measure::Values)
    }

    /// Lets columns be measured in one unit, as the coordinates of two bodies along the line on which they meet: none of them
    /// counts as smaller than the others.
    pub fn share_units(&mut self, groups: &[Vec<usize>]) {
        let members = |group: &Vec<usize>| -> Vec<usize> {
            let is_member = |of: &Quantity| group.contains(&of.column) && of.measure == Measure::Values;
            (0..self.quantities.len()).filter(|&k| is_member(&self.quantities[k])).collect()
        };
        let groups: Vec<Vec<usize>> = groups.iter().map(members).collect();
        // A size passes through one group a round.
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

    /// Notes by what impacts of a step, each off by the step, displace the columns; the time `remaining` is left of the run.
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

    /// Whether impacts have displaced anything.
    pub fn carries(&self) -> bool {
        self.quantities.iter().any(|of| of.carried != 0.0)
    }

    /// Completes what impacts displace: of columns that contacts hold, earlier impacts displace nothing any more.
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

    /// Notes whether the present time counts for values at the output times. Where runs differ they may agree at a single time, and
    /// so the latter half of the time up to each output counts.
    pub fn count(&mut self, counts: bool) {
        self.counts = counts;
    }

    /// Compares columns at a time within a step with those on the line between its ends, for what is not continuous: of what is
    /// held throughout a step, the end says nothing of the values before it.
    pub fn look_within(&mut self, at: &[f64], line: &[f64]) {
        self.within += 1;
        for quantity in self.quantities.iter_mut().filter(|of| !of.is_continuous()) {
            quantity.held += (at[quantity.column] - line[quantity.column]).abs();
        }
    }

    /// Notes that the rates of columns change within a step by as much as the step makes of `bends`, at an output time within it
    /// that has the product `parts` of the parts of the step before and after it.
    pub fn bend(&mut self, bends: &[f64], parts: f64) {
        for quantity in self.quantities.iter_mut().filter(|of| of.measure == Measure::Values) {
            let by = parts * bends[quantity.column].abs();
            if quantity.kind == Kind::Continuous && is_worse(by, quantity.bent) {
                quantity.bent = by;
            }
        }
    }

    /// Notes by how much impacts in a wrong direction displace the columns, at the end of a step of length `h`.
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

    /// Notes by how much data that vary within steps displace the columns, beyond what the steps see of them.
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

    /// Compares columns of both runs at a time `t` at the end of a step of length `h`, within or at the end of a step of the
    /// other run of length `length`. Within a step that impacts bend, the longer step knows less of what is continuous than the
    /// shorter ones, which end there.
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

    /// Notes that both runs had the same steps for some time.
    pub fn repeat(&mut self, time: f64) {
        self.repeated += time;
    }

    /// Notes an error of another kind, relative, and what it is an error of.
    pub fn note(&mut self, error: f64, what: String) {
        self.others.push((error, what));
    }

    /// Notes the part of a difference that is the error.
    pub fn share(&mut self, share: f64) {
        self.share = share;
    }

    /// Notes that the run with longer steps failed.
    pub fn fail(&mut self, why: String) {
        self.failed = Some(why);
    }

    /// Whether the run with longer steps goes on.
    pub fn goes_on(&self) -> bool {
        self.failed.is_none()
    }

    /// Records the largest error relative to the size of its quantity, beside the permitted error `allowed`. A permitted error
    /// that leaves less than three digits is a caveat.
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

    /// The largest error relative to the size of its quantity, and what it is an error of.
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

/// The largest error that is told as a number: larger ones are errors of what is zero, but for rounding.
const MOST_TOLD: f64 = 1e3;

/// An error relative to the size of something, in words.
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

/// Says that steps over impacts were not compared with longer ones, and why.
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
