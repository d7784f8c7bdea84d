//! Bounds on the deviation of the mean of a row over a part of a step from the mean that its values at a few points
//! show.
//!
//! The derivatives with respect to `y` are enclosed over the ranges of the polynomial `p`. Without the midpoints of
//! these enclosures, a linear part, the slope of a row is bounded by their radii times the slopes of `p`, and so is the
//! deviation of the row from its chord between two points. Time is enclosed with `y` fixed at the midpoint of the part:
//! points show the dependence on time if the enclosure is not much wider than the range of the values at both ends and
//! at the midpoint, and these lie nearly on a line. Where rows jump, their own enclosure is the only bound.

use super::{Row, StepSamples, Unseen};
use crate::screening::part::Part;
use crate::stepper::Radau;
use numerics::{Interval, is_seen, is_shown};

impl Radau<'_> {
    /// Bounds, over a part of a step, the deviation of the mean of each row from the mean that its values at both
    /// ends and at the midpoint show.
    pub(super) fn unseen_of(
        &mut self,
        samples: &StepSamples,
        part: &Part,
        values: &[Vec<f64>; 3],
        room: &mut Unseen,
    ) -> Option<Vec<f64>> {
        let mut unseen = self.unseen_in_space(samples, part, 0.5, room)?;
        if !self.is_fast(samples.h) {
            return Some(unseen);
        }
        let still = samples.still.is_none().then(|| {
            let mut middle = vec![0.0; self.system.unknowns];
            part.values(0.5, &mut middle);
            [0.0, 1.0].map(|u| self.rows_at(part.begin + u * part.length, samples, &middle))
        });
        let [first, last] = still.as_ref().map_or([&values[0], &values[2]], |[first, last]| [first, last]);
        self.enclose_in_time(samples, part, room)?;
        for (unseen, row) in unseen.iter_mut().zip(&samples.rows) {
            let range = room.values[row.at];
            if !is_seen(range, [first[row.at], values[1][row.at], last[row.at]], row.allowed) {
                *unseen += if range.defined { range.width() } else { f64::INFINITY };
            }
        }
        Some(unseen)
    }

    /// Bounds, over a part of a step, the deviation of the mean of each row at fixed times from the mean of the
    /// chords between points; `squares` is the sum of the squared distances between the points, relative to the part.
    pub(super) fn unseen_in_space(
        &mut self,
        samples: &StepSamples,
        part: &Part,
        squares: f64,
        room: &mut Unseen,
    ) -> Option<Vec<f64>> {
        let mut unseen = vec![0.0; samples.rows.len()];
        if samples.still.is_some() {
            return Some(unseen);
        }
        part.ranges(&mut room.y);
        let times = self.times(samples, part);
        let problem = self.system.problem();
        let is_smooth = !problem.may_jump(times, &room.y)
            && problem.enclose_derivatives(times, &room.y, &mut room.jacobian, &mut room.by_time);
        if is_smooth {
            for (j, slope) in room.slopes.iter_mut().enumerate() {
                *slope = part.rate(j).magnitudes().1;
            }
            // A function with slopes in `+-r` along the part deviates from its chord by `r/2` times the distance at
            // most, and by half of that in the mean.
            for (unseen, row) in unseen.iter_mut().zip(&samples.rows).filter(|(_, row)| row.has_feature) {
                *unseen = 0.25 * squares * self.radius_of_slope(row.at, room);
            }
            let is_open = |(unseen, row): &(&mut f64, &Row)| **unseen > row.allowed;
            if unseen.iter_mut().zip(&samples.rows).any(|pair| is_open(&pair)) {
                self.differentiate_at_points(samples, part, room);
                for (unseen, row) in unseen.iter_mut().zip(&samples.rows).filter(is_open) {
                    if self.are_slopes_shown(row.at, room) {
                        *unseen = 0.0;
                    }
                }
            }
        } else {
            let featured = unseen.iter_mut().zip(&samples.rows).filter(|(_, row)| row.has_feature);
            featured.for_each(|(unseen, _)| *unseen = f64::INFINITY);
        }
        let is_open = |(unseen, row): &(&mut f64, &Row)| **unseen > row.allowed;
        if !unseen.iter_mut().zip(&samples.rows).any(|pair| is_open(&pair)) {
            return Some(unseen);
        }
        // If rows hardly change, and at jumps, the enclosure of the rows themselves is narrower.
        if !self.system.problem().enclose(times, &room.y, &mut room.values) {
            return is_smooth.then_some(unseen);
        }
        for (unseen, row) in unseen.iter_mut().zip(&samples.rows).filter(is_open) {
            let range = room.values[row.at];
            *unseen = if range.defined { unseen.min(range.width()) } else { *unseen };
        }
        Some(unseen)
    }

    /// Bounds the deviation of the slope of a row along a part of a step from the slope by the midpoints of its
    /// derivatives; infinite if the derivatives are not defined on the whole part.
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

    /// Computes the variation of derivatives between both ends and the midpoint of a part of a step.
    fn differentiate_at_points(&mut self, samples: &StepSamples, part: &Part, room: &mut Unseen) {
        let unknowns = self.system.unknowns;
        room.points.resize(3 * unknowns, 0.0);
        let mut times = [0.0; 3];
        for ((u, time), y) in [0.0, 0.5, 1.0].into_iter().zip(&mut times).zip(room.points.chunks_exact_mut(unknowns)) {
            part.values(u, y);
            *time = self.clock.t + (part.begin + u * part.length).clamp(samples.end, 1.0 - samples.end) * samples.h;
        }
        self.system.problem().vary_derivatives(times, &room.points, &mut room.variations);
    }

    /// Whether the derivatives of a row at both ends and at the midpoint of a part of a step show how they vary in
    /// between.
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

    /// Whether the rows vary with time by less than their admissible error over the whole step.
    pub(super) fn is_narrow_in_time(&mut self, samples: &StepSamples, part: &Part, room: &mut Unseen) -> Option<bool> {
        self.enclose_in_time(samples, part, room)?;
        Some(samples.rows.iter().all(|row| {
            let range = room.values[row.at];
            range.defined && range.width() <= row.allowed
        }))
    }

    /// Encloses the rows over the times of a part of a step, with the unknowns fixed at the midpoint of the part.
    fn enclose_in_time(&mut self, samples: &StepSamples, part: &Part, room: &mut Unseen) -> Option<()> {
        let mut middle = vec![0.0; self.system.unknowns];
        samples.unknowns_at(part, 0.5, &mut middle);
        room.y.iter_mut().zip(&middle).for_each(|(y, middle)| *y = Interval::point(*middle));
        let times = self.times(samples, part);
        self.system.problem().enclose(times, &room.y, &mut room.values).then_some(())
    }

    /// Returns the interval of time that a part of a step takes.
    pub(super) fn times(&self, samples: &StepSamples, part: &Part) -> Interval {
        let at = |theta: f64| self.clock.t + theta.clamp(samples.end, 1.0 - samples.end) * samples.h;
        Interval::new(at(part.begin), at(part.begin + part.length).max(at(part.begin).next_up()))
    }
}
