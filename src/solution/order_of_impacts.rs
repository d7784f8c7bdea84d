//! Compares whether two runs with located impacts have the same impacts in the same order.
//!
//! A body that touches others with one corner and then with another takes a different path if the order is reversed:
//! its motion depends discontinuously on the data, and an accurate run may still be on the wrong branch, and both
//! runs may be on the same wrong branch. So the order of two impacts counts as known only if their distance in time
//! exceeds the difference of this distance between the runs; otherwise the velocity change of the smaller impact is
//! an error of the velocity. An impact that only one run has is an error too, unless other impacts make up for it,
//! such as two corners that hit one after the other instead of together.

use models::rigid_bodies::Impact;
use nalgebra::Vector3;
use std::collections::VecDeque;

/// For each body, the sequences of impacts in a run and in the run with longer steps, as far as they have not been
/// compared.
#[derive(Debug)]
pub(super) struct OrderOfImpacts {
    bodies: Vec<Sequences>,
    /// Impacts of both runs before this time are not compared.
    since: f64,
}

#[derive(Debug, Default)]
struct Sequences {
    open: [VecDeque<Impact>; 2],
    last: Option<Met>,
    /// The difference of the changes of the body's velocities by all impacts so far, between the two runs.
    apart: [Vector3<f64>; 2],
}

/// An impact that the run and the run with longer steps have in common.
#[derive(Debug)]
struct Met {
    of: Impact,
    /// The time of the impact in the run with longer steps.
    there: f64,
}

/// An error of the linear and angular velocity of a body, from the time `t` on.
#[derive(Debug)]
pub(super) struct Mistake {
    pub body: usize,
    pub t: f64,
    pub change: [Vector3<f64>; 2],
}

impl OrderOfImpacts {
    /// Creates a comparison of the order of impacts for the given number of bodies.
    pub fn new(bodies: usize) -> Self {
        Self { bodies: (0..bodies).map(|_| Sequences::default()).collect(), since: f64::NEG_INFINITY }
    }

    /// Adds impacts of the compared run, or of the run with longer steps if `is_longer` is set.
    pub fn take(&mut self, is_longer: bool, impacts: impl Iterator<Item = Impact>) {
        for impact in impacts.filter(|impact| impact.t >= self.since) {
            self.bodies[impact.body].open[usize::from(is_longer)].push_back(impact);
        }
    }

    /// Discards the impacts before a time: a part of the step was made by time stepping, which does not locate impacts
    /// in time.
    pub fn forget(&mut self, before: f64) {
        self.since = self.since.max(before);
        for of in &mut self.bodies {
            let rest = std::mem::take(of)
                .open
                .map(|mut open| open.split_off(open.partition_point(|impact| impact.t < before)));
            of.open = rest;
        }
    }

    /// Compares the sequences of impacts up to the time `t`, which both runs have reached, and returns the errors
    /// found. `h` is the size of the longer steps, below which the times of a common impact differ.
    pub fn mistakes(&mut self, t: f64, h: f64) -> Vec<Mistake> {
        let mut mistakes = Vec::new();
        self.bodies.iter_mut().for_each(|of| of.compare(t - h, h, &mut mistakes));
        mistakes
    }
}

impl Sequences {
    /// Compares the next impacts of a body in both runs as long as both have one, or one run has an impact before the
    /// time `due` that the other run lacks.
    fn compare(&mut self, due: f64, h: f64, mistakes: &mut Vec<Mistake>) {
        loop {
            let is_extra = |impact: &Impact| impact.t < due;
            let extra = match self.open.each_ref().map(VecDeque::front) {
                [Some(own), Some(other)] if (own.t - other.t).abs() < h => match self.next_in_common(h) {
                    Some([0, 0]) => {
                        self.meet(mistakes);
                        continue;
                    }
                    Some(extra) => extra,
                    // An impact after `due` may still have its counterpart among impacts that the other run has not
                    // reached yet.
                    None if !is_extra(own) || !is_extra(other) => return,
                    None => [1, 1],
                },
                [Some(own), Some(other)] if own.t < other.t => [1, 0],
                [Some(_), Some(_)] => [0, 1],
                [Some(impact), None] if is_extra(impact) => [1, 0],
                [None, Some(impact)] if is_extra(impact) => [0, 1],
                _ => return,
            };
            for (run, extra) in extra.into_iter().enumerate() {
                let sign = if run == 0 { 1.0 } else { -1.0 };
                for impact in self.open[run].drain(..extra) {
                    self.apart = [0, 1].map(|k| self.apart[k] + sign * impact.change[k]);
                    let is_made_up = impact.energy_of(self.apart) < impact.energy;
                    let change = if is_made_up { self.apart } else { impact.change };
                    mistakes.push(Mistake { body: impact.body, t: impact.t, change });
                }
            }
        }
    }

    /// Returns, for both runs, the number of impacts before the next common impact. Two impacts may be common if
    /// their times differ by less than `h`; of several such pairs, the one is taken for which the impacts before it
    /// have the least energy.
    fn next_in_common(&self, h: f64) -> Option<[usize; 2]> {
        let within = |open: &VecDeque<Impact>| open.partition_point(|impact| impact.t < open[0].t + h);
        let [own, other] = &self.open;
        let (mut best, mut least) = (None, f64::INFINITY);
        let mut before = 0.0;
        for (i, impact) in own.iter().take(within(own)).enumerate() {
            let mut skipped = before;
            for (j, there) in other.iter().take(within(other)).enumerate() {
                if skipped >= least {
                    break;
                }
                if impact.is_like(there) && (impact.t - there.t).abs() < h {
                    (best, least) = (Some([i, j]), skipped);
                }
                skipped += there.energy;
            }
            before += impact.energy;
        }
        best
    }

    /// Removes the next impact of the body from each run, which both have in common, and compares its distance in time
    /// from the last common impact between the runs.
    fn meet(&mut self, mistakes: &mut Vec<Mistake>) {
        let [Some(of), Some(other)] = self.open.each_mut().map(VecDeque::pop_front) else { return };
        self.apart = [0, 1].map(|k| self.apart[k] + of.change[k] - other.change[k]);
        if let Some(Met { of: last, there }) = &self.last
            && last.contacts != of.contacts
        {
            let apart = [of.t - last.t, other.t - there];
            if apart[0] <= (apart[0] - apart[1]).abs() {
                let smaller = if of.energy < last.energy { &of } else { last };
                mistakes.push(Mistake { body: of.body, t: of.t, change: smaller.change });
            }
        }
        self.last = Some(Met { of, there: other.t });
    }
}
