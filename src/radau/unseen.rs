//! What the rates do within a step whose stages do not show it: a pulse between all of them, a hill that a particle passes, a
//! ripple that all stages meet at the same phase. No error estimate sees that.
//!
//! Along the polynomial `p` of the step, rates and the equations of variables inside are functions of time alone,
//!
//! ```text
//! phi(theta) = F(t + theta h, p(theta)),    dphi = dF/dy dp + dF/dt h dtheta,
//! ```
//!
//! and what the step misses is the mean of what they are beside the polynomial through their values at the stages, in which
//! all that is linear in `p` falls out. A part of the step is halved until the bound on what points of it do not show (see
//! [`bounds`]) is less than is allowed, or than a part of what the stages show. If the means are larger than that then, and by
//! so much that the step misses a tolerance, the step is made again, shorter.

mod bounds;

use super::face::Activity;
use super::screening::part::Part;
use super::stepper::Radau;
use super::tableau::{MOST_STAGES, interpolation_error};
use numerics::Interval;

/// The part of their range at the stages by which rows may be off the polynomial through their values there: within it the
/// stages show the shape, and the error estimate its error.
const SHOWN: f64 = 0.1;

/// The phase that passes within a step whose stages show it: half a turn, over which even three are within 8 parts in 100 of
/// a sine: `0.018 phase^4/4!`, with the largest product of the distances to their nodes and to the beginning.
const SHOWN_PHASE: f64 = std::f64::consts::PI;

/// Parts of one step; a part that is left undecided then is off by all that its enclosure leaves open in time, and by what is
/// seen of it in space.
const MOST_PARTS: usize = 400;

/// Looking into parts in vain may cost this many parts, those of two steps, and this many for each evaluation of the rates:
/// where derivatives cannot be enclosed narrowly, the work of steps bounds that of looking. A part costs some forty
/// evaluations, for derivatives in intervals and at three points, and these are about half of a run, so that a tenth of its
/// time goes into looking. A run reports the steps that were not looked into for that reason.
const FREE: f64 = 2.0 * MOST_PARTS as f64;
const SHARE: f64 = 0.005;

/// One row of the rows that are compared.
#[derive(Clone, Copy, Debug)]
struct Row {
    at: usize,
    /// What its mean over the step may be off by.
    allowed: f64,
    /// Whether it is more than a polynomial of low degree in `y`.
    has_feature: bool,
}

/// A part of the step, with the rows at its ends and in its middle.
struct Piece {
    part: Part,
    values: [Vec<f64>; 3],
    /// The bound on how far the mean of each row may be from what these values show.
    unseen: Vec<f64>,
    /// The largest of these bounds, in units of what is allowed in the mean over the whole step.
    size: f64,
}

impl Piece {
    fn new(part: Part, values: [Vec<f64>; 3], unseen: Vec<f64>, rows: &[Row]) -> Self {
        let size = unseen.iter().zip(rows).map(|(unseen, row)| unseen / row.allowed).fold(0.0, f64::max);
        Self { part, values, unseen, size }
    }
}

/// What is known of a step.
struct StepSamples {
    h: f64,
    /// The least distance to its ends, where there may be a break, in parts of it.
    end: f64,
    rows: Vec<Row>,
    /// The unknowns in the middle, where rows vary with time alone beside what is linear.
    still: Option<Vec<f64>>,
    /// The values of all rows where the step begins and at the stages, the first of them at `end`.
    at_nodes: Vec<Vec<f64>>,
    /// The part of what the stages show that each row may be off by.
    shown: Vec<f64>,
}

impl StepSamples {
    /// The unknowns at `u` in `[0, 1]` of a part.
    fn unknowns_at(&self, part: &Part, u: f64, y: &mut [f64]) {
        match &self.still {
            Some(still) => y.copy_from_slice(still),
            None => part.values(u, y),
        }
    }
}

/// Room for enclosures.
#[derive(Debug, Default)]
pub(super) struct Unseen {
    y: Vec<Interval>,
    values: Vec<Interval>,
    jacobian: Vec<Interval>,
    by_time: Vec<Interval>,
    /// The unknowns at both ends and in the middle of a part, and how derivatives vary between these.
    points: Vec<f64>,
    variations: Vec<(f64, f64)>,
    /// The largest slopes of the unknowns.
    slopes: Vec<f64>,
    /// The parts that were enclosed of the last step, and those of all steps in which nothing was found.
    looked: f64,
    spent: f64,
    /// Whether functions of the states were left undecided in the last step.
    is_open: bool,
    /// The part of the last step up to where rows do what its stages do not show.
    pub seen: f64,
}

impl Unseen {
    fn resize(&mut self, unknowns: usize, variables: usize, rows: usize, derivatives: usize) {
        self.y.resize(unknowns, Interval::LINE);
        self.values.resize(rows, Interval::LINE);
        self.jacobian.resize(derivatives, Interval::LINE);
        self.variations.resize(derivatives, (0.0, 0.0));
        self.by_time.resize(variables, Interval::LINE);
        self.slopes.resize(unknowns, 0.0);
    }
}

impl Radau<'_> {
    /// How far the states would be off for what the stages of the step of size `h` do not show of the rows, in units of their
    /// tolerances; zero where rows neither depend on time nor have features, or cannot be enclosed.
    pub(super) fn missed(&mut self, h: f64) -> f64 {
        let rounding = self.clock.rounding(h);
        self.unseen.is_open = false;
        if h <= 4.0 * rounding || !self.is_fast(h) && self.system.features.is_empty() {
            return 0.0;
        }
        let evaluations = self.system.work.rates;
        let mut room = std::mem::take(&mut self.unseen);
        let (n, unknowns) = (self.system.states, self.system.unknowns);
        room.resize(unknowns, unknowns - n, self.system.values.len(), self.system.derivatives.len());
        let mut whole = Part::default();
        whole.set_whole(self.tableau(), &self.y, &self.stages.z[..self.tableau().stages() * unknowns]);
        room.looked = 0.0;
        let means = self.missed_means(h, rounding / h, whole, &mut room);
        self.unseen = room;
        // Evidence is no part of the method.
        self.system.work.rates = evaluations;
        let means = means.filter(|means| means.iter().any(|mean| *mean != 0.0));
        let missed = means.map_or(0.0, |means| self.made_of(h, means));
        self.unseen.spent += if missed > 1.0 { 0.0 } else { self.unseen.looked };
        missed
    }

    /// Whether the last step is known to show what functions of the states do between its stages.
    pub fn are_rates_shown(&self) -> bool {
        !self.unseen.is_open
    }

    /// Whether more of a phase passes within a step of size `h` than its stages show of what depends on time alone.
    fn is_fast(&self, h: f64) -> bool {
        self.system.pace * h > SHOWN_PHASE
    }

    /// What states become of means of their rates over a step, in units of their tolerances.
    fn made_of(&mut self, h: f64, mut means: Vec<f64>) -> f64 {
        match self.tableau().gamma {
            Some(gamma) if self.factors.solve_real(&mut means) => {
                means.iter_mut().for_each(|mean| *mean *= gamma);
                // Filtered once more: what stiff states forget before the step ends counts no longer.
                let mut forced = vec![0.0; means.len()];
                self.system.multiply_by_mass(&means, &mut forced);
                forced.iter_mut().for_each(|forced| *forced *= gamma / h);
                if self.factors.solve_real(&mut forced) {
                    means = forced;
                }
            }
            _ => means.iter_mut().for_each(|mean| *mean *= h),
        }
        let states = 0..self.system.states;
        states.map(|j| means[j].abs() / self.uncertainty(j).max(f64::MIN_POSITIVE)).fold(0.0, f64::max)
    }

    /// The means over the step of what rows are beside the polynomial through their values at the stages; `None` where they
    /// need not be looked at, or cannot be enclosed.
    fn missed_means(&mut self, h: f64, end: f64, whole: Part, room: &mut Unseen) -> Option<Vec<f64>> {
        let rows = self.rows_compared(h);
        // Where functions of the states may not be looked at, time alone is.
        let is_affordable = room.spent <= FREE + SHARE * self.system.work.rates as f64;
        room.is_open = !is_affordable && !self.system.features.is_empty();
        let unknowns = self.system.unknowns;
        let middle = || {
            let mut y = vec![0.0; unknowns];
            whole.values(0.5, &mut y);
            y
        };
        let still = (self.system.features.is_empty() || !is_affordable).then(middle);
        let mut course = StepSamples { h, end, shown: vec![0.0; rows.len()], rows, still, at_nodes: Vec::new() };
        let is_slow = !self.is_fast(h) || self.is_narrow_in_time(&course, &whole, room)?;
        // The gaps between the stages, squared: for chords between these.
        let gaps = std::iter::once(0.0).chain(self.tableau().c.iter().copied());
        let squares: f64 = gaps.zip(&self.tableau().c).map(|(left, right)| (right - left).powi(2)).sum();
        let unseen = self.unseen_in_space(&course, &whole, squares, room)?;
        let is_plain = unseen.iter().zip(&course.rows).all(|(unseen, row)| *unseen <= row.allowed);
        if is_plain {
            if is_slow {
                return None;
            }
            course.still = Some(middle());
        }
        self.look_at_nodes(&mut course, &whole);
        let is_told = |(i, unseen): (usize, &f64)| *unseen <= course.rows[i].allowed.max(course.shown[i]);
        if is_slow && unseen.iter().enumerate().all(is_told) {
            return None;
        }
        self.missed_in_parts(&course, whole, room)
    }

    /// The rows whose course matters, with what their means may be off by over a step of size `h`.
    fn rows_compared(&self, h: f64) -> Vec<Row> {
        let n = self.system.states;
        let has_feature = |at: usize| self.system.features.binary_search(&at).is_ok();
        let row = |at: usize, allowed: f64| Row { at, allowed, has_feature: has_feature(at) };
        let rates = (0..n).map(|at| {
            let mass = if self.system.mass_diagonal[at] != 0.0 { self.system.mass_diagonal[at].abs() } else { 1.0 };
            row(at, mass * self.uncertainty(at) / h)
        });
        let inside = (0..self.system.unknowns - n).filter(|&k| self.system.face.places[k] == Activity::Inactive);
        let rows = rates.chain(inside.map(|k| row(n + k, self.uncertainties(k, h)[1])));
        rows.filter(|row| self.is_fast(h) || row.has_feature).collect()
    }

    fn rows_at(&mut self, theta: f64, course: &StepSamples, y: &[f64]) -> Vec<f64> {
        self.system.evaluate(self.clock.t + theta.clamp(course.end, 1.0 - course.end) * course.h, y);
        self.system.values.clone()
    }

    /// The values of rows where the step begins and at its stages, and what they show beside what is linear.
    fn look_at_nodes(&mut self, course: &mut StepSamples, whole: &Part) {
        let mut y = vec![0.0; self.system.unknowns];
        let (mut lowest, mut highest) =
            (vec![[f64::INFINITY; 2]; course.rows.len()], vec![[f64::NEG_INFINITY; 2]; course.rows.len()]);
        for theta in std::iter::once(0.0).chain(self.tableau().c.iter().copied()) {
            course.unknowns_at(whole, theta, &mut y);
            let values = self.rows_at(theta, course, &y);
            let begin = if course.still.is_some() { &y } else { &self.y };
            for (i, row) in course.rows.iter().enumerate() {
                let linear: f64 = self.system.entries_of_row(row.at).map(|(j, value)| value * (y[j] - begin[j])).sum();
                for (k, value) in [values[row.at], values[row.at] - linear].into_iter().enumerate() {
                    lowest[i][k] = lowest[i][k].min(value);
                    highest[i][k] = highest[i][k].max(value);
                }
            }
            course.at_nodes.push(values);
        }
        // Of more than half a turn from every second stage to the next they show nothing, however small a part of the rows it is.
        let part =
            if self.system.pace * course.h > 0.5 * self.tableau().stages() as f64 * SHOWN_PHASE { 0.0 } else { SHOWN };
        for (shown, (low, high)) in course.shown.iter_mut().zip(lowest.iter().zip(&highest)) {
            *shown = part * (high[0] - low[0]).min(high[1] - low[1]);
        }
    }

    /// How far rows at `theta` are from the polynomial through their values at the nodes.
    fn off_at(&self, theta: f64, course: &StepSamples, values: &[f64]) -> Vec<f64> {
        let mut weights = [0.0; MOST_STAGES];
        let weights = &mut weights[..self.tableau().stages()];
        self.tableau().increments_at(theta, weights);
        let (begin, stages) = (&course.at_nodes[0], &course.at_nodes[1..]);
        let at_stages = |at: usize| stages.iter().map(move |values| values[at]);
        let off = |&Row { at, .. }: &Row| interpolation_error(values[at], begin[at], at_stages(at), weights);
        course.rows.iter().map(off).collect()
    }

    /// The means over the step of what rows are beside the polynomial through their values at the nodes.
    fn missed_in_parts(&mut self, course: &StepSamples, whole: Part, room: &mut Unseen) -> Option<Vec<f64>> {
        room.seen = 1.0;
        let mut missed = vec![0.0; self.system.unknowns];
        let mut y = vec![0.0; self.system.unknowns];
        let mut look = |radau: &mut Self, course: &StepSamples, part: &Part, u: f64| {
            course.unknowns_at(part, u, &mut y);
            radau.rows_at(part.begin + u * part.length, course, &y)
        };
        let values = [0.0, 0.5, 1.0].map(|u| look(self, course, &whole, u));
        let unseen = self.unseen_of(course, &whole, &values, room)?;
        let (mut pieces, mut enclosed) = (vec![Piece::new(whole, values, unseen, &course.rows)], 1);
        // The piece with the widest bound comes first: the rounding errors of enclosures elsewhere do not bury a feature.
        let widest = |pieces: &[Piece]| (0..pieces.len()).max_by(|&i, &j| pieces[i].size.total_cmp(&pieces[j].size));
        while let Some(at) = widest(&pieces) {
            let Piece { mut part, values, unseen, .. } = pieces.swap_remove(at);
            let (length, times) = (part.length, self.times(course, &part));
            let offs: [Vec<f64>; 3] =
                std::array::from_fn(|i| self.off_at(part.begin + 0.5 * i as f64 * length, course, &values[i]));
            let is_open = |i: usize| {
                let largest = offs.iter().map(|off| off[i].abs()).fold(course.shown[i], |a, b| a.max(SHOWN * b));
                let allowed = course.rows[i].allowed;
                unseen[i] > allowed.max(largest) && unseen[i] * length > allowed
            };
            let can_halve = enclosed + 2 <= MOST_PARTS && times.width() > self.clock.rounding(course.h);
            if can_halve && (0..unseen.len()).any(is_open) {
                enclosed += 2;
                let mut second = Part::default();
                part.halve(&mut second);
                let (quarter, later) = (look(self, course, &part, 0.5), look(self, course, &second, 0.5));
                let [first, middle, last] = values;
                for (part, values) in [(part, [first, quarter, middle.clone()]), (second, [middle, later, last])] {
                    let unseen = self.unseen_of(course, &part, &values, room)?;
                    pieces.push(Piece::new(part, values, unseen, &course.rows));
                }
                continue;
            }
            for (i, row) in course.rows.iter().enumerate() {
                let off = 0.25 * (offs[0][i] + 2.0 * offs[1][i] + offs[2][i]);
                // Of functions of the states it is mostly their enclosure that is too wide.
                room.is_open |= course.still.is_none() && is_open(i);
                let counts = course.still.is_some() && unseen[i].is_finite() && is_open(i);
                let open = if counts { unseen[i] } else { 0.0 };
                let off = if off.abs() > course.shown[i] { off } else { 0.0 };
                if off.abs().max(open) > row.allowed {
                    room.seen = room.seen.min(part.begin);
                }
                missed[row.at] += length * (off + open);
            }
        }
        room.looked = if course.still.is_none() { enclosed as f64 } else { 0.0 };
        Some(missed)
    }
}
