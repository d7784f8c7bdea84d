//! A run with steps twice as long as those of time stepping, made beside it for comparison. It lags behind the run by
//! a few steps, so that the substeps of the run are known. If the number of steps is odd, the last step is joined
//! with the two before it. A run of a single step is compared with two steps of half its length.

use super::compared_columns::Columns;
use super::longer_steps::{Comparison, Kind, part_of};
use super::reducers::{Reduction, Selected};
use super::run::{Plan, Stepper};
use super::{Checks, Event, Failure};

/// An output time within this fraction of a time step from one of the ends of the step counts as that end.
const WITHIN: f64 = 1e-6;

/// A time-stepping method whose run can be compared with a run with longer steps.
pub(super) trait TimeStepped: Stepper + Sized {
    /// Returns the time at which the last step began.
    fn begin(&self) -> f64;

    /// Makes one step that ends at the time `end`.
    ///
    /// # Errors
    /// The reason why the step failed, for the user.
    fn step_to(&mut self, end: f64) -> Result<(), Failure>;

    /// Returns the behaviour of each output in time: whether it is continuous, jumps, or is a sum over a step.
    fn kinds(&self) -> Vec<Kind>;

    /// Returns groups of outputs that are the components of one vector; if all components are requested, their errors
    /// are relative to the largest component.
    fn vectors(&self) -> Vec<Vec<usize>> {
        Vec::new()
    }

    /// Writes, for each output, its change by the forces of the last step.
    fn resolve(&mut self, out: &mut [f64]);

    /// Writes, for each output, its displacement at the end of the last step if all impacts of the step had a timing
    /// error of one step; returns false if the step has no impacts.
    fn strike(&mut self, out: &mut [f64]) -> bool;

    /// Writes a nonzero number for each output that contacts hold fixed at the end of the last step, so that errors
    /// of earlier impacts no longer displace it.
    fn hold(&mut self, _out: &mut [f64]) {}

    /// Writes, for each output, the displacement at the end of the last step by the errors of direction of all
    /// impacts so far, since each impact takes its directions at the beginning of its step; returns false without
    /// such impacts.
    fn mislead(&mut self, _out: &mut [f64]) -> bool {
        false
    }

    /// Compares the order of the impacts with that in a run with longer steps over the same time. Writes, for each
    /// output, the displacement at the end of the last step by all impacts so far whose order is uncertain; returns
    /// false if there are no new ones.
    fn reorder(&mut self, _longer: &mut Self, _out: &mut [f64]) -> bool {
        false
    }

    /// Writes, for each output, the change of its rate by impacts in the last step, times the step size. At a time
    /// that divides the step into the fractions `a` and `1 - a`, the output may differ from the linear interpolation
    /// between the step ends by up to `a (1 - a)` times this number. Returns false if the step has no impacts, or if
    /// outputs within steps account for them.
    fn bend(&mut self, _out: &mut [f64]) -> bool {
        false
    }

    /// Writes, for each output, the displacement at the end of the last step by variations of data (such as forces)
    /// between the times at which steps evaluate them; returns false if there are none.
    fn miss(&mut self, _out: &mut [f64]) -> bool {
        false
    }

    /// Returns the number of leading outputs that are as accurate within the last step as at its ends, because the step
    /// has located their jumps in time. All other outputs that jump are constant within a step.
    fn known_within(&self) -> usize {
        0
    }

    /// Returns the events of the last step.
    fn events(&self) -> Vec<Event>;

    /// Prepares the next step of the longer run, which ends at `_end`, to have substeps at least twice as long as those
    /// of the compared run `_run` over the same time.
    fn exceed(&mut self, _run: &mut Self, _end: f64) {}

    /// Returns the part of the last step, as a length of time, in which its substeps are not longer than those of the
    /// run `_shorter`, which has made shorter steps over the same time.
    fn repeats(&mut self, _shorter: &mut Self) -> f64 {
        0.0
    }
}

/// The columns (recorded quantities) of the compared run at the end of a step.
struct Row {
    t: f64,
    /// The length of the step that ends at the time `t`.
    h: f64,
    y: Vec<f64>,
}

/// The run with longer steps, for comparison with a run by time stepping.
pub(super) struct LongerRun<S> {
    stepper: S,
    columns: Columns,
    /// The comparison of the two runs so far.
    pub comparison: Comparison,
    /// The steps of the compared run that the longer run has not made yet (`open`), and row buffers for reuse
    /// (`free`).
    open: Vec<Row>,
    free: Vec<Row>,
    y: Vec<f64>,
    changes: Vec<f64>,
    /// The columns (recorded quantities) at the end of the last step of the compared run.
    last: Vec<f64>,
    /// The output times, and the index of the next output time.
    times: Vec<f64>,
    next: usize,
    start: f64,
    end: f64,
    events: Vec<SelectedEvents>,
}

/// The events of one kind and origin in both runs, whose number or time a sweep collects.
struct SelectedEvents {
    name: String,
    /// Whether the number of the events is collected; otherwise the time of the first or the last event is collected.
    is_count: bool,
    of: Selected,
    counts: [u32; 2],
    /// For both runs, the times of the first and the last selected event.
    times: [Option<[f64; 2]>; 2],
    /// The length of the longest step with a selected event whose time was not located.
    h: f64,
}

impl SelectedEvents {
    fn of(plan: &Plan) -> Vec<Self> {
        let reductions = plan.reducers.iter().flat_map(|of| of.names.iter().zip(&of.reductions));
        let selected = reductions.filter_map(|(name, reduction)| match reduction {
            Reduction::Count(of) => Some((name, true, of)),
            Reduction::First(of) | Reduction::Last(of) => Some((name, false, of)),
            _ => None,
        });
        let new = |(name, is_count, of): (&String, bool, &Selected)| Self {
            name: name.clone(),
            is_count,
            of: of.clone(),
            counts: [0; 2],
            times: [None; 2],
            h: 0.0,
        };
        selected.map(new).collect()
    }

    fn take(&mut self, events: &[Event], run: usize, h: f64) {
        for event in events.iter().filter(|event| self.of.takes(event)) {
            self.counts[run] += 1;
            let [first, _] = self.times[run].unwrap_or([event.t; 2]);
            self.times[run] = Some([first, event.t]);
            self.h = self.h.max(h);
        }
    }

    /// Returns the relative error of the collected number, with a message. The time of an event that is not located
    /// has an error of at least one step, even where the two runs agree.
    fn error(&self, start: f64) -> (f64, String) {
        let [own, other] = self.counts.map(f64::from);
        let name = &self.name;
        let error = match (self.is_count, self.times) {
            (true, _) => (own - other).abs() / own.max(other).max(1.0),
            (false, [Some(a), Some(b)]) => {
                let late = |k: usize| (a[k] - b[k]).abs().max(self.h) / (a[k] - start);
                late(0).max(late(1))
            }
            (false, [None, None]) => 0.0,
            (false, _) => 1.0,
        };
        let part = part_of(error, "its value");
        (error, format!("and `{name}` is estimated to be off by {part}, beside steps twice as long"))
    }
}

impl<S: TimeStepped> LongerRun<S> {
    /// Creates a comparison with the run of `stepper`, which must be at the start and makes the longer steps.
    pub fn new(mut stepper: S, plan: &Plan, is_default: bool) -> Self {
        let mut columns = Columns::new(plan);
        let quantities = columns.asked(plan, &stepper.kinds());
        let mut comparison = Comparison::new(quantities, plan.start, is_default);
        let mut y = vec![0.0; columns.count()];
        stepper.values(plan.start, &mut y[..plan.names.len()]);
        columns.evaluate(plan.start, &mut y);
        comparison.meet(&y, 0.0);
        let (open, free) = (Vec::new(), Vec::new());
        let changes = vec![0.0; y.len()];
        let times = plan.times.clone().unwrap_or_default();
        let (start, end, last) = (plan.start, plan.end, y.clone());
        let events = SelectedEvents::of(plan);
        Self { stepper, columns, comparison, open, free, y, changes, last, times, next: 0, start, end, events }
    }

    /// Adds the last step of `run` to the comparison, and makes a step of the longer run if the run is more than
    /// three steps ahead of it.
    pub fn follow(&mut self, run: &mut S) {
        let (t, h) = (run.t(), run.t() - run.begin());
        if h <= 0.0 || !self.comparison.goes_on() {
            return;
        }
        let mut row = self.free.pop().unwrap_or_else(|| Row { t, h, y: vec![0.0; self.y.len()] });
        (row.t, row.h) = (t, h);
        self.read(run, t, &mut row.y);
        self.comparison.count(self.counts([run.begin(), t]));
        self.comparison.meet(&row.y, h);
        let outputs = self.columns.outputs();
        self.changes.fill(0.0);
        run.resolve(&mut self.changes[..outputs]);
        self.comparison.resolve(&self.changes);
        if self.open.is_empty() {
            self.columns.spread(t, &row.y, &mut self.changes);
            self.comparison.resolve(&self.changes);
        }
        self.changes.fill(0.0);
        if run.strike(&mut self.changes[..outputs]) {
            self.columns.displace(t, &row.y, &mut self.changes);
            self.comparison.strike(&self.changes, self.end - t);
        }
        self.changes.fill(0.0);
        if self.comparison.carries() {
            run.hold(&mut self.changes[..outputs]);
            self.columns.hold(&mut self.changes);
            self.comparison.carry(&self.changes);
        }
        self.changes.fill(0.0);
        if run.mislead(&mut self.changes[..outputs]) {
            self.columns.displace(t, &row.y, &mut self.changes);
            self.comparison.mislead(&self.changes, h);
        }
        self.changes.fill(0.0);
        if run.miss(&mut self.changes[..outputs]) {
            self.columns.displace(t, &row.y, &mut self.changes);
            self.comparison.miss(&self.changes);
        }
        while let Some(&at) = self.times.get(self.next)
            && at <= t
        {
            self.next += 1;
            let part = (at - run.begin()) / h;
            if part > WITHIN && part < 1.0 - WITHIN {
                let mut y = std::mem::take(&mut self.y);
                self.read(run, at, &mut y);
                let line = self.last.iter().zip(&row.y).map(|(from, to)| from + part * (to - from));
                self.changes.iter_mut().zip(line).for_each(|(out, line)| *out = line);
                let known = run.known_within();
                if known > 0 {
                    self.changes[..known].copy_from_slice(&y[..known]);
                    self.columns.evaluate(at, &mut self.changes);
                }
                self.comparison.look_within(&y, &self.changes);
                self.changes.fill(0.0);
                if run.bend(&mut self.changes[..outputs]) {
                    self.columns.displace(at, &y, &mut self.changes);
                    self.comparison.bend(&self.changes, part * (1.0 - part));
                }
                self.y = y;
            }
        }
        self.last.copy_from_slice(&row.y);
        if !self.events.is_empty() {
            let events = run.events();
            let late = if run.known_within() > 0 { 0.0 } else { h };
            self.events.iter_mut().for_each(|of| of.take(&events, 0, late));
        }
        self.open.push(row);
        if self.open.len() > 3 {
            self.join(run, 2);
        }
    }

    /// Whether the step from `begin` to `end` counts for the errors of values at the output times: it does if it
    /// reaches into the latter half of the time from the start to the next output time, or if every step is an output.
    fn counts(&self, [begin, end]: [f64; 2]) -> bool {
        let next = self.times.get(self.times.partition_point(|time| *time <= begin));
        self.times.is_empty() || next.is_some_and(|next| end - self.start >= 0.5 * (next - self.start))
    }

    /// Writes the columns (recorded quantities) of a run at a time within its last step.
    fn read(&mut self, run: &mut S, t: f64, y: &mut [f64]) {
        run.values(t, &mut y[..self.columns.outputs()]);
        self.columns.evaluate(t, y);
    }

    /// Makes one step of the longer run over the next `count` steps of the compared run `run`, which is ahead of it,
    /// and compares the two runs over this step.
    fn join(&mut self, run: &mut S, count: usize) {
        let Some(end) = self.open.get(count.wrapping_sub(1)).map(|row| row.t) else { return };
        self.stepper.exceed(run, end);
        if self.advance(end) {
            self.comparison.repeat(self.stepper.repeats(run));
            self.changes.fill(0.0);
            let outputs = self.columns.outputs();
            if run.reorder(&mut self.stepper, &mut self.changes[..outputs])
                && let Some(last) = self.open.last()
            {
                self.columns.displace(last.t, &last.y, &mut self.changes);
                self.comparison.mislead(&self.changes, 0.0);
            }
            self.compare(count);
        }
    }

    /// Makes a step of the longer run up to the time `end`; returns false if it fails.
    fn advance(&mut self, end: f64) -> bool {
        if let Err(failure) = self.stepper.step_to(end) {
            self.comparison.fail(failure.message);
            return false;
        }
        if !self.events.is_empty() {
            let events = self.stepper.events();
            self.events.iter_mut().for_each(|of| of.take(&events, 1, 0.0));
        }
        true
    }

    /// Compares the last step of the longer run with the `count` steps of the compared run that it spans.
    fn compare(&mut self, count: usize) {
        let length = self.stepper.t() - self.stepper.begin();
        self.changes.fill(0.0);
        let is_bent = self.stepper.bend(&mut self.changes[..self.columns.outputs()]);
        let mut y = std::mem::take(&mut self.y);
        let rows: Vec<Row> = self.open.drain(..count).collect();
        self.comparison.count(self.counts([self.stepper.begin(), self.stepper.t()]));
        for (k, row) in rows.iter().enumerate() {
            let values = &mut y[..self.columns.outputs()];
            self.stepper.values(row.t, values);
            self.columns.evaluate(row.t, &mut y);
            self.comparison.differ([&row.y, &y], [row.t, row.h], (length, k + 1 == count), is_bent);
        }
        self.y = y;
        self.free.extend(rows);
    }

    /// Completes the comparison at the end of the compared run: compares the steps that the longer run has not made
    /// yet, and sets the scales of errors.
    pub fn finish(&mut self, run: &mut S) {
        if self.comparison.goes_on() && self.open.len() == 1 {
            // At first order two steps of half the length have half the error of the single step, so that their
            // difference is half of the error.
            self.comparison.share(2.0);
            let Some((t, h)) = self.open.first().map(|row| (row.t, row.h)) else { return };
            if self.advance(t - 0.5 * h) && self.advance(t) {
                // Only the second of the two half steps is compared with the single step of the run.
                self.comparison.repeat(0.5 * run.repeats(&mut self.stepper));
                self.compare(1);
            }
        }
        while self.comparison.goes_on() && !self.open.is_empty() {
            let count = if self.open.len() > 3 { 2 } else { self.open.len() };
            self.join(run, count);
        }
        self.comparison.settle();
        // The error of a whole vector output relative to its length does not depend on the coordinate frame.
        let mut vectors = self.stepper.vectors();
        vectors.retain(|vector| vector.iter().all(|&column| self.comparison.compares(column)));
        self.comparison.share_units(&vectors);
        for of in &self.events {
            let (error, what) = of.error(self.start);
            self.comparison.note(error, what);
        }
    }

    /// Records the result of the comparison with longer steps as checks; see [`Comparison::judge`].
    pub fn judge(&self, allowed: f64, checks: &mut Checks) {
        self.comparison.judge(allowed, checks);
    }
}
