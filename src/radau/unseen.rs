//! What the rates do within a step whose stages do not show it: a pulse between all of them, a hill that a particle passes, a
//! ripple of which each happens to be at the same phase. No error estimate sees that.
//!
//! Along the polynomial `p` of the step, rates and the equations of variables inside are functions of time alone,
//!
//! ```text
//! phi(theta) = F(t + theta h, p(theta)),    dphi = dF/dy dp + dF/dt h dtheta,
//! ```
//!
//! and what the step misses is the mean of what they are beside the polynomial through their values at the stages, in which
//! all that is linear in `p` falls out. So the derivatives by `y` are enclosed over the ranges of `p`: with their middles
//! subtracted, as a linear part, `phi` has slopes within their radii times those of `p`, and between points that were looked
//! at is beside its chord by no more than that allows. Time is enclosed with `y` as it is in the middle, and shows where its
//! enclosure is not much wider than what is seen at both ends and in the middle, and nearly straight there. Where rows jump,
//! their own enclosure is all that is known. A part of the step is halved until what is unseen of it is less than is allowed,
//! or than a part of what the stages show; where the means are more than that then, and by so much that the step misses a
//! tolerance, the step is made again, shorter.

use super::face::Place;
use super::screening::part::Part;
use super::stepper::Radau;
use super::tableau::MOST_STAGES;
use numerics::{Interval, is_seen, is_shown};

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
/// time goes into looking. What is not looked at then is told.
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

/// A part of the step, with the rows at its ends and in its middle, and what is unseen of them between.
struct Piece {
    part: Part,
    values: [Vec<f64>; 3],
    unseen: Vec<f64>,
}

impl Piece {
    /// What is unseen of it in its own mean, whatever its length, in units of what is allowed.
    fn size(&self, course: &Course) -> f64 {
        let rows = self.unseen.iter().zip(&course.rows);
        rows.map(|(unseen, row)| unseen / row.allowed).fold(0.0, f64::max)
    }
}

/// What is known of a step.
struct Course {
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

impl Course {
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
        let rounding = self.rounding_of_time(h);
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
        let still = (self.system.features.is_empty() || !is_affordable).then(|| {
            let mut y = vec![0.0; self.system.unknowns];
            whole.values(0.5, &mut y);
            y
        });
        let mut course = Course { h, end, shown: vec![0.0; rows.len()], rows, still, at_nodes: Vec::new() };
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
            let mut y = vec![0.0; self.system.unknowns];
            whole.values(0.5, &mut y);
            course.still = Some(y);
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
        let inside = (0..self.system.unknowns - n).filter(|&k| self.system.face.places[k] == Place::Inside);
        let rows = rates.chain(inside.map(|k| row(n + k, self.uncertainties(k, h)[1])));
        rows.filter(|row| self.is_fast(h) || row.has_feature).collect()
    }

    /// Whether rows vary with time by less than is allowed, all over a step.
    fn is_narrow_in_time(&mut self, course: &Course, part: &Part, room: &mut Unseen) -> Option<bool> {
        self.enclose_in_time(course, part, room)?;
        Some(course.rows.iter().all(|row| {
            let range = room.values[row.at];
            range.defined && range.hi - range.lo <= row.allowed
        }))
    }

    /// The times of a part.
    fn times(&self, course: &Course, part: &Part) -> Interval {
        let at = |theta: f64| self.t + theta.clamp(course.end, 1.0 - course.end) * course.h;
        Interval::new(at(part.begin), at(part.begin + part.length).max(at(part.begin).next_up()))
    }

    /// Encloses rows over the times of a part, with the unknowns as they are in its middle.
    fn enclose_in_time(&mut self, course: &Course, part: &Part, room: &mut Unseen) -> Option<()> {
        let mut middle = vec![0.0; self.system.unknowns];
        course.unknowns_at(part, 0.5, &mut middle);
        room.y.iter_mut().zip(&middle).for_each(|(y, middle)| *y = Interval::point(*middle));
        let times = self.times(course, part);
        self.system.problem().enclose(times, &room.y, &mut room.values).then_some(())
    }

    /// By how much, over a part, the mean of each row at fixed times may be beside that of the chords between points whose
    /// distances have squares of this sum, in parts of the part.
    fn unseen_in_space(&mut self, course: &Course, part: &Part, squares: f64, room: &mut Unseen) -> Option<Vec<f64>> {
        let mut unseen = vec![0.0; course.rows.len()];
        if course.still.is_some() {
            return Some(unseen);
        }
        part.ranges(&mut room.y);
        let times = self.times(course, part);
        let problem = self.system.problem();
        let is_smooth = !problem.may_jump(times, &room.y)
            && problem.enclose_derivatives(times, &room.y, &mut room.jacobian, &mut room.by_time);
        if is_smooth {
            for (j, slope) in room.slopes.iter_mut().enumerate() {
                *slope = part.rate(j).magnitudes().1;
            }
            // A function with slopes in `+-r` is beside its chord by `r/2` of the distance at most, by a half of it in the mean.
            for (unseen, row) in unseen.iter_mut().zip(&course.rows).filter(|(_, row)| row.has_feature) {
                *unseen = 0.25 * squares * self.radius_of_slope(row.at, room);
            }
            let is_open = |(unseen, row): &(&mut f64, &Row)| **unseen > row.allowed;
            if unseen.iter_mut().zip(&course.rows).any(|pair| is_open(&pair)) {
                self.differentiate_at_points(course, part, room);
                for (unseen, row) in unseen.iter_mut().zip(&course.rows).filter(is_open) {
                    if self.are_slopes_shown(row.at, room) {
                        *unseen = 0.0;
                    }
                }
            }
        } else {
            let featured = unseen.iter_mut().zip(&course.rows).filter(|(_, row)| row.has_feature);
            featured.for_each(|(unseen, _)| *unseen = f64::INFINITY);
        }
        let is_open = |(unseen, row): &(&mut f64, &Row)| **unseen > row.allowed;
        if !unseen.iter_mut().zip(&course.rows).any(|pair| is_open(&pair)) {
            return Some(unseen);
        }
        // Where rows hardly change, and at jumps, their own enclosure is the narrower one.
        if !self.system.problem().enclose(times, &room.y, &mut room.values) {
            return is_smooth.then_some(unseen);
        }
        for (unseen, row) in unseen.iter_mut().zip(&course.rows).filter(is_open) {
            let range = room.values[row.at];
            *unseen = if range.defined { unseen.min(range.hi - range.lo) } else { *unseen };
        }
        Some(unseen)
    }

    /// By how much the slope of a row along a part may be beside that which the middles of its derivatives make; infinite
    /// where they are not defined all over it.
    fn radius_of_slope(&self, row: usize, room: &Unseen) -> f64 {
        let radius = |(at, j): (usize, usize)| {
            let (_, radius) = room.jacobian[at].ball();
            match room.jacobian[at].defined {
                true if radius > 0.0 => radius * room.slopes[j],
                true => 0.0,
                false => f64::INFINITY,
            }
        };
        let sum: f64 = self.system.places_of_row(row).map(radius).sum();
        if sum.is_nan() { f64::INFINITY } else { sum }
    }

    /// The variation of derivatives between both ends and the middle of a part.
    fn differentiate_at_points(&mut self, course: &Course, part: &Part, room: &mut Unseen) {
        let unknowns = self.system.unknowns;
        room.points.resize(3 * unknowns, 0.0);
        let mut times = [0.0; 3];
        for ((u, time), y) in [0.0, 0.5, 1.0].into_iter().zip(&mut times).zip(room.points.chunks_exact_mut(unknowns)) {
            part.values(u, y);
            *time = self.t + (part.begin + u * part.length).clamp(course.end, 1.0 - course.end) * course.h;
        }
        self.system.problem().vary_derivatives(times, &room.points, &mut room.variations);
    }

    /// Whether the derivatives of a row at these points show what they do between.
    fn are_slopes_shown(&self, row: usize, room: &Unseen) -> bool {
        let (mut width, mut range, mut bent) = (0.0, 0.0, 0.0);
        for (at, j) in self.system.places_of_row(row) {
            let slope = room.slopes[j];
            width += 2.0 * room.jacobian[at].ball().1 * slope;
            range += room.variations[at].0 * slope;
            bent += room.variations[at].1 * slope;
        }
        is_shown(width, range, bent)
    }

    fn rows_at(&mut self, theta: f64, course: &Course, y: &[f64]) -> Vec<f64> {
        self.system.evaluate(self.t + theta.clamp(course.end, 1.0 - course.end) * course.h, y);
        self.system.values.clone()
    }

    /// The values of rows where the step begins and at its stages, and what they show beside what is linear.
    fn look_at_nodes(&mut self, course: &mut Course, whole: &Part) {
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
        for (shown, (low, high)) in course.shown.iter_mut().zip(lowest.iter().zip(&highest)) {
            *shown = SHOWN * (high[0] - low[0]).min(high[1] - low[1]);
        }
    }

    /// How far rows at `theta` are from the polynomial through their values at the nodes.
    fn off_at(&self, theta: f64, course: &Course, values: &[f64]) -> Vec<f64> {
        let mut weights = [0.0; MOST_STAGES];
        let weights = &mut weights[..self.tableau().stages()];
        self.tableau().increments_at(theta, weights);
        let off = |row: &Row| {
            let begin = course.at_nodes[0][row.at];
            let nodes = course.at_nodes[1..].iter().zip(&*weights);
            values[row.at] - begin - nodes.map(|(values, weight)| weight * (values[row.at] - begin)).sum::<f64>()
        };
        course.rows.iter().map(off).collect()
    }

    /// By how much, over a part, the mean of each row may be beside what its values at both ends and in the middle show.
    fn unseen_of(
        &mut self,
        course: &Course,
        part: &Part,
        values: &[Vec<f64>; 3],
        room: &mut Unseen,
    ) -> Option<Vec<f64>> {
        let mut unseen = self.unseen_in_space(course, part, 0.5, room)?;
        if !self.is_fast(course.h) {
            return Some(unseen);
        }
        let still = course.still.is_none().then(|| {
            let mut middle = vec![0.0; self.system.unknowns];
            part.values(0.5, &mut middle);
            [0.0, 1.0].map(|u| self.rows_at(part.begin + u * part.length, course, &middle))
        });
        let [first, last] = still.as_ref().map_or([&values[0], &values[2]], |[first, last]| [first, last]);
        self.enclose_in_time(course, part, room)?;
        for (unseen, row) in unseen.iter_mut().zip(&course.rows) {
            let range = room.values[row.at];
            if !is_seen(range, [first[row.at], values[1][row.at], last[row.at]], row.allowed) {
                *unseen += if range.defined { range.hi - range.lo } else { f64::INFINITY };
            }
        }
        Some(unseen)
    }

    /// The means over the step of what rows are beside the polynomial through their values at the nodes.
    fn missed_in_parts(&mut self, course: &Course, whole: Part, room: &mut Unseen) -> Option<Vec<f64>> {
        room.seen = 1.0;
        let mut missed = vec![0.0; self.system.unknowns];
        let mut y = vec![0.0; self.system.unknowns];
        let mut look = |radau: &mut Self, course: &Course, part: &Part, u: f64| {
            course.unknowns_at(part, u, &mut y);
            radau.rows_at(part.begin + u * part.length, course, &y)
        };
        let values = [0.0, 0.5, 1.0].map(|u| look(self, course, &whole, u));
        let unseen = self.unseen_of(course, &whole, &values, room)?;
        let (mut pieces, mut enclosed) = (vec![Piece { part: whole, values, unseen }], 1);
        // The piece of which most is unseen comes first: what rounding leaves of enclosures elsewhere does not bury a feature.
        let first = |pieces: &[Piece]| {
            (0..pieces.len()).max_by(|&i, &j| pieces[i].size(course).total_cmp(&pieces[j].size(course)))
        };
        while let Some(at) = first(&pieces) {
            let Piece { mut part, values, unseen } = pieces.swap_remove(at);
            let (length, times) = (part.length, self.times(course, &part));
            let offs: [Vec<f64>; 3] =
                std::array::from_fn(|i| self.off_at(part.begin + 0.5 * i as f64 * length, course, &values[i]));
            let is_open = |i: usize| {
                let largest = offs.iter().map(|off| off[i].abs()).fold(course.shown[i], |a, b| a.max(SHOWN * b));
                let allowed = course.rows[i].allowed;
                unseen[i] > allowed.max(largest) && unseen[i] * length > allowed
            };
            let can_halve = enclosed + 2 <= MOST_PARTS && times.hi - times.lo > self.rounding_of_time(course.h);
            if can_halve && (0..unseen.len()).any(is_open) {
                enclosed += 2;
                let mut second = Part::default();
                part.halve(&mut second);
                let (quarter, later) = (look(self, course, &part, 0.5), look(self, course, &second, 0.5));
                let [first, middle, last] = values;
                for (part, values) in [(part, [first, quarter, middle.clone()]), (second, [middle, later, last])] {
                    let unseen = self.unseen_of(course, &part, &values, room)?;
                    pieces.push(Piece { part, values, unseen });
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
