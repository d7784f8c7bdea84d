//! Variations of the rates within a step that its stages miss: a pulse between all of them, a hill that a particle
//! passes, a ripple that all stages meet at the same phase. No error estimate detects them.
//!
//! Along the polynomial `p` of the step, rates, the equations of free variables and the bounds at which others are held
//! are functions of time alone,
//!
//! ```text
//! phi(theta) = F(t + theta h, p(theta)),    dphi = dF/dy dp + dF/dt h dtheta,
//! ```
//!
//! and the step misses the mean of their deviations from the polynomial through their values at the stages, from which
//! all terms linear in `p` cancel. A part of the step is bisected until the bound on the variation that its sample
//! points miss (see [`bounds`]) is less than allowed, or less than a fraction of the variation that the stages show. If
//! the means then exceed that fraction, and by so much that the step misses a tolerance, the step is repeated with a
//! smaller size.

mod bounds;

use super::screening::part::Part;
use super::stepper::Radau;
use super::tableau::{MOST_STAGES, interpolation_error};
use numerics::{Interval, is_seen};

/// Largest deviation of a row from the polynomial through its values at the stages, relative to its range at the
/// stages: within it, the stages show the shape of the row, and the error estimate bounds its error.
const SHOWN: f64 = 0.1;

/// Largest phase of a time dependence that may pass within a step whose stages show it: half a turn, over which even
/// three stages interpolate a sine to within 8 parts in 100, by `0.018 phase^4/4!` with the largest product of the
/// distances to their nodes and to the beginning.
const SHOWN_PHASE: f64 = std::f64::consts::PI;

/// Maximum number of parts into which one step is divided in the search for variations of the rows that the stages
/// miss. A part that is still undecided then contributes the whole width of its enclosure in time, and its observed
/// deviation in space.
const MOST_PARTS: usize = 400;

/// Allowance for unsuccessful searches: `FREE` parts, those of two steps, and `SHARE` parts for each evaluation of the
/// rates, so that where derivatives cannot be enclosed narrowly, the work of the steps bounds that of the search. A
/// part costs about forty evaluations, for derivatives in intervals and at three points, and evaluations are about half
/// of a run, so that a tenth of its time is spent on the search. A run reports the steps that were not searched for
/// this reason.
const FREE: f64 = 2.0 * MOST_PARTS as f64;
const SHARE: f64 = 0.005;

/// A row of the problem that is compared with the polynomial through its values at the stages.
#[derive(Clone, Copy, Debug)]
struct Row {
    at: usize,
    /// The equation of the face in which the row occurs, and the factor of the row in that equation.
    equation: usize,
    factor: f64,
    /// Admissible error, from missed variations, of the mean of the row over the step.
    allowed: f64,
    /// Whether the row is more than a polynomial of low degree in the unknowns `y`.
    has_feature: bool,
}

/// A part of the step, with the values of the rows at its ends and at its midpoint.
struct Piece {
    part: Part,
    values: [Vec<f64>; 3],
    /// Bound on the deviation of the mean of each row from the mean that the values at the ends and the midpoint of the
    /// part show.
    unseen: Vec<f64>,
    /// The largest bound on a deviation, relative to the admissible error of the mean over the whole step.
    size: f64,
}

impl Piece {
    fn new(part: Part, values: [Vec<f64>; 3], unseen: Vec<f64>, rows: &[Row]) -> Self {
        let size = unseen.iter().zip(rows).map(|(unseen, row)| unseen / row.allowed).fold(0.0, f64::max);
        Self { part, values, unseen, size }
    }
}

/// Samples of the rows of the problem over a step, to be compared with their polynomials.
struct StepSamples {
    h: f64,
    /// Least distance of a sample from the ends of the step, where a breakpoint may be, as a fraction of the step.
    end: f64,
    rows: Vec<Row>,
    /// The unknowns at the midpoint, used for all samples if only the dependence of the rows on time is examined.
    still: Option<Vec<f64>>,
    /// Values of all rows at the beginning of the step, sampled at `end`, and at the stages.
    at_nodes: Vec<Vec<f64>>,
    /// Admissible deviation of each row from its polynomial: a fraction of its range at the stages.
    shown: Vec<f64>,
}

impl StepSamples {
    /// Writes the unknowns at the position `u` in `[0, 1]` within a part of the step to `y`.
    fn unknowns_at(&self, part: &Part, u: f64, y: &mut [f64]) {
        match &self.still {
            Some(still) => y.copy_from_slice(still),
            None => part.values(u, y),
        }
    }
}

/// Workspace of the search for variations of the rows that the stages miss, with an account of the parts of steps
/// enclosed.
#[derive(Debug, Default)]
pub(super) struct Unseen {
    y: Vec<Interval>,
    values: Vec<Interval>,
    jacobian: Vec<Interval>,
    by_time: Vec<Interval>,
    /// The unknowns at both ends and at the midpoint of a part of the step, and the variations of derivatives between
    /// these points.
    points: Vec<f64>,
    variations: Vec<(f64, f64)>,
    /// The largest magnitude of the slope of each unknown over a part of the step.
    slopes: Vec<f64>,
    /// Number of parts enclosed in the search over the last step, and in all searches that are charged to the
    /// allowance because they found no missed variation.
    looked: f64,
    spent: f64,
    /// Whether the search did not decide if the stages of the last step miss variations of functions of the states.
    is_open: bool,
    /// Fraction of the last step at which a variation begins that its stages miss; one if no part of the variation
    /// exceeds its admissible error by itself.
    pub seen: f64,
}

impl Unseen {
    /// Charges the search for missed variations in the last step to the allowance.
    pub fn charge(&mut self) {
        self.spent += self.looked;
    }

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
    /// Returns the largest error of a state from variations that the stages of the step of size `h` miss, in units of
    /// its tolerance.
    pub(super) fn missed(&mut self, h: f64) -> f64 {
        let missed = self.missed_errors(h).map_or(0.0, |errors| self.in_tolerances(&errors));
        if missed <= 1.0 {
            self.unseen.charge();
        }
        missed
    }

    /// Returns the errors of the states from the variations of the rows that the stages of the step of size `h` miss;
    /// `None` if there are none, if the rows neither depend on time nor have features, or if they cannot be enclosed.
    pub(super) fn missed_errors(&mut self, h: f64) -> Option<Vec<f64>> {
        let rounding = self.clock.rounding(h);
        self.unseen.is_open = false;
        self.unseen.looked = 0.0;
        if h <= 4.0 * rounding || !self.is_fast(h) && self.system.features.is_empty() {
            return None;
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
        // Evaluations for the search for missed variations are not counted as work of the method.
        self.system.work.rates = evaluations;
        let means = means.filter(|means| means.iter().any(|mean| *mean != 0.0));
        means.map(|means| self.made_of(h, means))
    }

    /// Whether the stages of the last step are known to show how functions of the states vary in the time between them.
    pub fn are_rates_shown(&self) -> bool {
        !self.unseen.is_open
    }

    /// Whether rates, inequalities or bounds, at the unknowns at the beginning of a step of size `h`, vary with time
    /// by more than their values at both ends and the midpoint of the step show. A step that is coupled over its
    /// stages keeps no face along which these rows could be followed.
    pub(super) fn varies_unseen(&mut self, h: f64) -> bool {
        if !self.is_fast(h) {
            return false;
        }
        let (n, unknowns, evaluations) = (self.system.states, self.system.unknowns, self.system.work.rates);
        let (t, y, end) = (self.clock.t, self.y.clone(), self.clock.rounding(h));
        let mut ranges = vec![Interval::LINE; self.system.values.len()];
        let at_rest: Vec<Interval> = y.iter().map(|y| Interval::point(*y)).collect();
        let times = Interval::new(t + end, (t + h - end).max((t + end).next_up()));
        let is_enclosed = self.system.problem().enclose(times, &at_rest, &mut ranges);
        let seen = [times.lo, t + 0.5 * h, times.hi].map(|t| {
            self.system.evaluate(t, &y);
            self.system.values.clone()
        });
        self.system.work.rates = evaluations;
        let uncertainties = self.uncertainties(h);
        let of_variable = |k: usize| uncertainties.at_last(&self.system, k);
        let allowed = |row: usize| match row {
            row if row < n => {
                let mass = self.system.mass_diagonal[row].abs();
                self.uncertainty(row) / h * if mass == 0.0 { 1.0 } else { mass }
            }
            row if row < unknowns => of_variable(row - n)[1],
            row => of_variable(self.system.variable_of_bound(row - unknowns))[0],
        };
        let [first, middle, last] = &seen;
        is_enclosed
            && (0..ranges.len()).any(|row| {
                let values = [first[row], middle[row], last[row]];
                ranges[row].defined && !is_seen(ranges[row], values, allowed(row))
            })
    }

    /// Whether the phase of functions of time alone advances within a step of size `h` by more than the stages can
    /// show.
    fn is_fast(&self, h: f64) -> bool {
        self.system.pace * h > SHOWN_PHASE
    }

    /// Returns the largest of the errors `errors` of the states, in units of their tolerances.
    fn in_tolerances(&self, errors: &[f64]) -> f64 {
        let of_state = |(j, error): (usize, &f64)| error / self.uncertainty(j).max(f64::MIN_POSITIVE);
        errors.iter().enumerate().map(of_state).fold(0.0, f64::max)
    }

    /// Returns the errors of the states that errors `means` of the means of the rates over a step cause.
    fn made_of(&mut self, h: f64, mut means: Vec<f64>) -> Vec<f64> {
        match self.tableau().gamma {
            Some(gamma) if self.factors.solve_real(&mut means) => {
                means.iter_mut().for_each(|mean| *mean *= gamma);
                // Filter once more: an error that stiff states forget before the end of the step does not count.
                let mut forced = vec![0.0; means.len()];
                self.system.multiply_by_mass(&means, &mut forced);
                forced.iter_mut().for_each(|forced| *forced *= gamma / h);
                if self.factors.solve_real(&mut forced) {
                    means = forced;
                }
            }
            _ => means.iter_mut().for_each(|mean| *mean *= h),
        }
        means.truncate(self.system.states);
        means.iter_mut().for_each(|mean| *mean = mean.abs());
        means
    }

    /// Returns the means over the step of the deviations of rows from the polynomial through their values at the
    /// stages; `None` if no examination is necessary, or the rows cannot be enclosed.
    fn missed_means(&mut self, h: f64, end: f64, whole: Part, room: &mut Unseen) -> Option<Vec<f64>> {
        let effects = self.effects_through_others(h);
        let rows = self.rows_compared(h, &effects);
        // If the search for missed variations in functions of the states is not affordable, examine only the
        // dependence of rows on time.
        let is_affordable = room.spent <= FREE + SHARE * self.system.work.rates as f64;
        room.is_open = !is_affordable && !self.system.features.is_empty();
        let unknowns = self.system.unknowns;
        let middle = || {
            let mut y = vec![0.0; unknowns];
            whole.values(0.5, &mut y);
            y
        };
        let still = (self.system.features.is_empty() || !is_affordable).then(middle);
        let mut samples = StepSamples { h, end, shown: vec![0.0; rows.len()], rows, still, at_nodes: Vec::new() };
        let is_slow = !self.is_fast(h) || self.is_narrow_in_time(&samples, &whole, room)?;
        // The sum of the squared gaps between the stages, for the bound on deviations from chords between the stages.
        let gaps = std::iter::once(0.0).chain(self.tableau().c.iter().copied());
        let squares: f64 = gaps.zip(&self.tableau().c).map(|(left, right)| (right - left).powi(2)).sum();
        let unseen = self.unseen_in_space(&samples, &whole, squares, room)?;
        let is_plain = unseen.iter().zip(&samples.rows).all(|(unseen, row)| *unseen <= row.allowed);
        if is_plain {
            if is_slow {
                return None;
            }
            samples.still = Some(middle());
        }
        self.look_at_nodes(&mut samples, &whole);
        let is_told = |(i, unseen): (usize, &f64)| *unseen <= samples.rows[i].allowed.max(samples.shown[i]);
        if is_slow && unseen.iter().enumerate().all(is_told) {
            return None;
        }
        self.missed_in_parts(&samples, whole, room)
    }

    /// Returns the largest error of a state, in tolerances, for a unit error of the mean of each equation over a step
    /// of size `h`; `None` except for equations with features of variables that enter no rate, and act through other
    /// variables.
    fn effects_through_others(&mut self, h: f64) -> Vec<Option<f64>> {
        let (n, unknowns) = (self.system.states, self.system.unknowns);
        let mut effects = Vec::with_capacity(unknowns - n);
        for k in 0..unknowns - n {
            let has_feature = |l: usize| self.system.features.binary_search(&(n + l)).is_ok();
            let acts_through_others = self.control.weight[n + k] == 0.0
                && self.system.has_equation(k)
                && self.system.rows_of_equation(k).any(|(l, _)| has_feature(l));
            effects.push(acts_through_others.then(|| {
                let mut unit = vec![0.0; unknowns];
                unit[n + k] = 1.0;
                let errors = self.made_of(h, unit);
                self.in_tolerances(&errors)
            }));
        }
        effects
    }

    /// Returns the rows to be examined for variations that the stages miss, with the admissible errors of their means
    /// over a step of size `h`.
    fn rows_compared(&self, h: f64, effects: &[Option<f64>]) -> Vec<Row> {
        let n = self.system.states;
        let has_feature = |at: usize| self.system.features.binary_search(&at).is_ok();
        let rates = (0..n).map(|at| {
            let mass = if self.system.mass_diagonal[at] != 0.0 { self.system.mass_diagonal[at].abs() } else { 1.0 };
            let allowed = mass * self.uncertainty(at) / h;
            Row { at, equation: at, factor: 1.0, allowed, has_feature: has_feature(at) }
        });
        let uncertainties = self.uncertainties(h);
        // A variable is known only to within a change that affects no state by more than its tolerance.
        let of_variable = |l: usize, k: usize| {
            let [of_z, of_g] = uncertainties.at_last(&self.system, l);
            let directly = self.system.place_of_own(l).map_or(0.0, |at| self.system.derivatives[at].abs() * of_z);
            of_g.max(directly).max(effects[k].map_or(0.0, |effect| 1.0 / effect))
        };
        let of_equation = |k: usize| {
            let of_row = |(l, factor): (usize, f64)| {
                let allowed = of_variable(l, k) / factor.abs();
                Row { at: n + l, equation: n + k, factor, allowed, has_feature: has_feature(n + l) }
            };
            self.system.rows_of_equation(k).map(of_row).collect::<Vec<Row>>()
        };
        let equations = (0..self.system.unknowns - n).filter(|&k| self.system.has_equation(k)).flat_map(of_equation);
        let of_bound = |p: usize| {
            let at = self.system.unknowns + p;
            self.system.equations_of_bound(p).into_iter().map(move |(equation, factor)| (at, equation, factor))
        };
        let bounds = (0..self.system.bounds()).flat_map(of_bound).map(|(at, equation, factor)| {
            let allowed = uncertainties.at_last(&self.system, equation - n)[0] / factor.abs();
            Row { at, equation, factor, allowed, has_feature: has_feature(at) }
        });
        let rows = rates.chain(equations).chain(bounds);
        rows.filter(|row| self.is_fast(h) || row.has_feature).collect()
    }

    fn rows_at(&mut self, theta: f64, samples: &StepSamples, y: &[f64]) -> Vec<f64> {
        self.system.evaluate(self.clock.t + theta.clamp(samples.end, 1.0 - samples.end) * samples.h, y);
        self.system.values.clone()
    }

    /// Evaluates the rows at the beginning of the step and at its stages, and sets the admissible deviations from the
    /// ranges of the rows at these points, apart from linear terms.
    fn look_at_nodes(&mut self, samples: &mut StepSamples, whole: &Part) {
        let mut y = vec![0.0; self.system.unknowns];
        let (mut lowest, mut highest) =
            (vec![[f64::INFINITY; 2]; samples.rows.len()], vec![[f64::NEG_INFINITY; 2]; samples.rows.len()]);
        for theta in std::iter::once(0.0).chain(self.tableau().c.iter().copied()) {
            samples.unknowns_at(whole, theta, &mut y);
            let values = self.rows_at(theta, samples, &y);
            let begin = if samples.still.is_some() { &y } else { &self.y };
            for (i, row) in samples.rows.iter().enumerate() {
                let linear: f64 = self.system.entries_of_row(row.at).map(|(j, value)| value * (y[j] - begin[j])).sum();
                for (k, value) in [values[row.at], values[row.at] - linear].into_iter().enumerate() {
                    lowest[i][k] = lowest[i][k].min(value);
                    highest[i][k] = highest[i][k].max(value);
                }
            }
            samples.at_nodes.push(values);
        }
        // If the phase of an oscillation in time advances by more than half a turn over every two stages, the values
        // at the stages show nothing of it, however small the oscillating part of the rows is.
        let part =
            if self.system.pace * samples.h > 0.5 * self.tableau().stages() as f64 * SHOWN_PHASE { 0.0 } else { SHOWN };
        for (shown, (low, high)) in samples.shown.iter_mut().zip(lowest.iter().zip(&highest)) {
            *shown = part * (high[0] - low[0]).min(high[1] - low[1]);
        }
    }

    /// Returns the deviations of the rows at the position `theta` of the step from the polynomial through their values
    /// at the nodes.
    fn off_at(&self, theta: f64, samples: &StepSamples, values: &[f64]) -> Vec<f64> {
        let mut weights = [0.0; MOST_STAGES];
        let weights = &mut weights[..self.tableau().stages()];
        self.tableau().increments_at(theta, weights);
        let (begin, stages) = (&samples.at_nodes[0], &samples.at_nodes[1..]);
        let at_stages = |at: usize| stages.iter().map(move |values| values[at]);
        let off = |&Row { at, .. }: &Row| interpolation_error(values[at], begin[at], at_stages(at), weights);
        samples.rows.iter().map(off).collect()
    }

    /// Returns the means over the step of the deviations of rows from the polynomial through their values at the
    /// nodes.
    fn missed_in_parts(&mut self, samples: &StepSamples, whole: Part, room: &mut Unseen) -> Option<Vec<f64>> {
        room.seen = 1.0;
        let mut missed = vec![0.0; self.system.unknowns];
        let mut y = vec![0.0; self.system.unknowns];
        let mut look = |radau: &mut Self, samples: &StepSamples, part: &Part, u: f64| {
            samples.unknowns_at(part, u, &mut y);
            radau.rows_at(part.begin + u * part.length, samples, &y)
        };
        let values = [0.0, 0.5, 1.0].map(|u| look(self, samples, &whole, u));
        let unseen = self.unseen_of(samples, &whole, &values, room)?;
        let (mut pieces, mut enclosed) = (vec![Piece::new(whole, values, unseen, &samples.rows)], 1);
        // The part with the widest bound is examined first, so that rounding errors of enclosures elsewhere do not
        // hide a variation.
        let widest = |pieces: &[Piece]| (0..pieces.len()).max_by(|&i, &j| pieces[i].size.total_cmp(&pieces[j].size));
        while let Some(at) = widest(&pieces) {
            let Piece { mut part, values, unseen, .. } = pieces.swap_remove(at);
            let (length, times) = (part.length, self.times(samples, &part));
            let offs: [Vec<f64>; 3] =
                std::array::from_fn(|i| self.off_at(part.begin + 0.5 * i as f64 * length, samples, &values[i]));
            let is_open = |i: usize| {
                let largest = offs.iter().map(|off| off[i].abs()).fold(samples.shown[i], |a, b| a.max(SHOWN * b));
                let allowed = samples.rows[i].allowed;
                unseen[i] > allowed.max(largest) && unseen[i] * length > allowed
            };
            let can_halve = enclosed + 2 <= MOST_PARTS && times.width() > self.clock.rounding(samples.h);
            if can_halve && (0..unseen.len()).any(is_open) {
                enclosed += 2;
                let mut second = Part::default();
                part.halve(&mut second);
                let (quarter, later) = (look(self, samples, &part, 0.5), look(self, samples, &second, 0.5));
                let [first, middle, last] = values;
                for (part, values) in [(part, [first, quarter, middle.clone()]), (second, [middle, later, last])] {
                    let unseen = self.unseen_of(samples, &part, &values, room)?;
                    pieces.push(Piece::new(part, values, unseen, &samples.rows));
                }
                continue;
            }
            for (i, row) in samples.rows.iter().enumerate() {
                let off = 0.25 * (offs[0][i] + 2.0 * offs[1][i] + offs[2][i]);
                // For functions of the states, the enclosure is mostly too wide to be an estimate: its bound does not
                // count as an error.
                room.is_open |= samples.still.is_none() && is_open(i);
                let counts = samples.still.is_some() && unseen[i].is_finite() && is_open(i);
                let open = if counts { unseen[i] } else { 0.0 };
                let off = if off.abs() > samples.shown[i] { off } else { 0.0 };
                if off.abs().max(open) > row.allowed {
                    room.seen = room.seen.min(part.begin);
                }
                missed[row.equation] += row.factor * length * (off + open);
            }
        }
        room.looked = if samples.still.is_none() { enclosed as f64 } else { 0.0 };
        Some(missed)
    }
}
