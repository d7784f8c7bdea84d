//! TR-BDF2 as a one-step method: dense output by parabolas, repetition of the last step, and restoration of saved
//! states.

use super::{Attempt, GAMMA, TrBdf2};
use crate::obstacle::ObstacleError;
use crate::obstacle::resting::Moment;
use hybrid::{Breaks, OneStep};
use numerics::Interval;

/// A saved state of the TR-BDF2 stepper, from which a run can be continued.
#[derive(Clone)]
pub struct Saved {
    t: f64,
    u: Vec<f64>,
    force: Vec<f64>,
    last: (f64, Vec<f64>, Vec<f64>),
    h: f64,
    slopes: [Vec<f64>; 3],
    moments: [Moment; 3],
    was_rejected: bool,
    gap: f64,
    breaks: Breaks,
    restarts: bool,
}

impl OneStep for TrBdf2<'_> {
    type Error = ObstacleError;
    type Saved = Saved;

    fn order(&self) -> usize {
        2
    }

    fn t(&self) -> f64 {
        self.t
    }

    fn y(&self) -> &[f64] {
        &self.u
    }

    fn is_done(&self) -> bool {
        self.t >= self.end
    }

    fn next_step(&self) -> f64 {
        self.h
    }

    fn step(&mut self) -> Result<(), ObstacleError> {
        hybrid::advance(self)
    }

    fn begin(&self) -> f64 {
        self.last.0
    }

    fn at(&mut self, t: f64, out: &mut [f64]) {
        let part = self.part(t);
        out.iter_mut().enumerate().for_each(|(node, out)| *out = self.within(node, part));
    }

    fn slopes_at(&self, t: f64) -> Vec<f64> {
        let (part, h) = (self.part(t), self.t - self.last.0);
        let slope = |node: usize| {
            let [change, curvature] = self.path(node);
            let value = self.on_path(node, part);
            if self.project(node, value) == value { (change + 2.0 * part * curvature) / h } else { 0.0 }
        };
        (0..self.u.len()).map(slope).collect()
    }

    fn ranges(&self, from: f64, to: f64) -> Vec<Interval> {
        let (from, to) = (self.part(from), self.part(to));
        let range = |node: usize| {
            let [change, curvature] = self.path(node);
            let vertex = if curvature == 0.0 { from } else { (-0.5 * change / curvature).clamp(from, to) };
            let values = [from, vertex, to].map(|part| self.project(node, self.on_path(node, part)));
            let [least, most] = [f64::min, f64::max].map(|of| values.into_iter().fold(values[0], of));
            Interval::new(least, most)
        };
        (0..self.u.len()).map(range).collect()
    }

    /// Repeats the last step so that it ends at time `end`. The variational inequalities of the stages are solved to
    /// their own tolerance, whatever `tighter` is.
    fn cut_at(&mut self, end: f64, _tighter: f64) -> bool {
        let saved = self.save();
        let h = end - self.last.0;
        // Restore the values at the beginning of the last step, which `append` has swapped with those at its end.
        self.t = self.last.0;
        std::mem::swap(&mut self.last.1, &mut self.u);
        let [first, _, third] = &mut self.slopes;
        std::mem::swap(first, third);
        self.moments.swap(0, 2);
        let is_made = matches!(self.attempt(h, end), Ok(Attempt::Made(_)));
        if is_made {
            self.append(h, end);
            self.gap = self.least_gap(&self.u);
        } else {
            self.restore(&saved);
        }
        is_made
    }

    fn save(&mut self) -> Saved {
        Saved {
            t: self.t,
            u: self.u.clone(),
            force: self.force.clone(),
            last: self.last.clone(),
            h: self.h,
            slopes: self.slopes.clone(),
            moments: self.moments.clone(),
            was_rejected: self.was_rejected,
            gap: self.gap,
            breaks: self.breaks.clone(),
            restarts: self.restarts,
        }
    }

    fn restore(&mut self, saved: &Saved) {
        let Saved { t, u, force, last, h, slopes, moments, was_rejected, gap, breaks, restarts } = saved.clone();
        (self.t, self.u, self.force, self.last) = (t, u, force, last);
        (self.h, self.slopes, self.moments, self.was_rejected) = (h, slopes, moments, was_rejected);
        (self.gap, self.breaks, self.restarts) = (gap, breaks, restarts);
    }
}

impl TrBdf2<'_> {
    /// Returns the fraction of the last step that has passed at time `t`.
    fn part(&self, t: f64) -> f64 {
        let h = self.t - self.last.0;
        if h > 0.0 { (t - self.last.0) / h } else { 1.0 }
    }

    /// Interpolates the value of a node within the last step, at the fraction `part` of the step. With obstacles at
    /// rest, the value is projected onto `K`.
    pub fn within(&self, node: usize, part: f64) -> f64 {
        self.project(node, self.on_path(node, part))
    }

    fn on_path(&self, node: usize, part: f64) -> f64 {
        let [change, curvature] = self.path(node);
        self.last.1[node] + part * (change + part * curvature)
    }

    /// Projects the value of a node onto its interval of `K`, unless the obstacles move: then the interval is known at
    /// the end of the step only.
    fn project(&self, node: usize, value: f64) -> f64 {
        if self.system.set_varies() { value } else { self.system.set.project(node, value) }
    }

    /// Returns the displacement of a node over the last step, as the coefficients of `part` and `part^2`, where
    /// `part` is the fraction of the step: those of the parabola through both ends and the stage. With obstacles at
    /// rest, a node that came into contact within the step follows the parabola through its stage value (if still
    /// free there) with its initial slope, or the line with its initial slope, until it reaches the obstacle.
    fn path(&self, node: usize) -> [f64; 2] {
        let (_, before, middle) = &self.last;
        let approach = if self.system.set_varies() { None } else { self.approach(node) };
        approach.unwrap_or_else(|| {
            let of_middle = (middle[node] - before[node]) / (GAMMA * (1.0 - GAMMA));
            let of_end = (self.u[node] - before[node]) / (1.0 - GAMMA);
            [of_middle - GAMMA * of_end, of_end - of_middle]
        })
    }
}
