//! Bounds on how far the mean of a row over a part of a step may be from what its values at a few points of the part show.
//!
//! Derivatives by `y` are enclosed over the ranges of the polynomial `p`. With their middles subtracted, as a linear part, a row
//! has slopes within their radii times those of `p`, and between two points is beside its chord by no more than that allows.
//! Time is enclosed with `y` as it is in the middle: points show its course where the enclosure is not much wider than the
//! range of the values at both ends and in the middle, and these are nearly straight. Where rows jump, their own enclosure is
//! the only bound.

use super::{Row, StepSamples, Unseen};
use crate::screening::part::Part;
use crate::stepper::Radau;
use numerics::{Interval, is_seen, is_shown};

impl Radau<'_> {
    /// By how much, over a part, the mean of each row may be beside what its values at both ends and in the middle show.
    pub(super) fn unseen_of(
        &mut self,
        course: &StepSamples,
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
                *unseen += if range.defined { range.width() } else { f64::INFINITY };
            }
        }
        Some(unseen)
    }

    /// By how much, over a part, the mean of each row at fixed times may be beside that of the chords between points whose
    /// distances have squares of this sum, in parts of the part.
    pub(super) fn unseen_in_space(
        &mut self,
        course: &StepSamples,
        part: &Part,
        squares: f64,
        room: &mut Unseen,
    ) -> Option<Vec<f64>> {
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
            *unseen = if range.defined { unseen.min(range.width()) } else { *unseen };
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
    fn differentiate_at_points(&mut self, course: &StepSamples, part: &Part, room: &mut Unseen) {
        let unknowns = self.system.unknowns;
        room.points.resize(3 * unknowns, 0.0);
        let mut times = [0.0; 3];
        for ((u, time), y) in [0.0, 0.5, 1.0].into_iter().zip(&mut times).zip(room.points.chunks_exact_mut(unknowns)) {
            part.values(u, y);
            *time = self.clock.t + (part.begin + u * part.length).clamp(course.end, 1.0 - course.end) * course.h;
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

    /// Whether rows vary with time by less than is allowed, all over a step.
    pub(super) fn is_narrow_in_time(&mut self, course: &StepSamples, part: &Part, room: &mut Unseen) -> Option<bool> {
        self.enclose_in_time(course, part, room)?;
        Some(course.rows.iter().all(|row| {
            let range = room.values[row.at];
            range.defined && range.width() <= row.allowed
        }))
    }

    /// Encloses rows over the times of a part, with the unknowns as they are in its middle.
    fn enclose_in_time(&mut self, course: &StepSamples, part: &Part, room: &mut Unseen) -> Option<()> {
        let mut middle = vec![0.0; self.system.unknowns];
        course.unknowns_at(part, 0.5, &mut middle);
        room.y.iter_mut().zip(&middle).for_each(|(y, middle)| *y = Interval::point(*middle));
        let times = self.times(course, part);
        self.system.problem().enclose(times, &room.y, &mut room.values).then_some(())
    }

    /// The times of a part.
    pub(super) fn times(&self, course: &StepSamples, part: &Part) -> Interval {
        let at = |theta: f64| self.clock.t + theta.clamp(course.end, 1.0 - course.end) * course.h;
        Interval::new(at(part.begin), at(part.begin + part.length).max(at(part.begin).next_up()))
    }
}
