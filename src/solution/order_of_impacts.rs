//! Whether two runs with located impacts take the same impacts in the same order.
//!
//! A body that meets others with one corner and then with another goes elsewhere if the order is the other one: its motion is not
//! continuous there, and a run may be on the wrong side with all its digits. Two runs on the same wrong side agree. So
//! the order counts as known only where two impacts are further apart in time than by what their distance differs between the runs; else
//! the smaller of the two is an error of the velocity. Where one run has an impact that the other does not, that impact is one, unless
//! others make up for it, such as two corners one after the other for both at once.

use models::rigid_bodies::Impact;
use nalgebra::Vector3;
use std::collections::VecDeque;

/// The sequences of the impacts of each body in a run and in one with longer steps, as far as they are not compared yet.
#[derive(Debug)]
pub(super) struct OrderOfImpacts {
    bodies: Vec<Sequences>,
    /// The time before which impacts are not compared.
    since: f64,
}

#[derive(Debug, Default)]
struct Sequences {
    open: [VecDeque<Impact>; 2],
    last: Option<Met>,
    /// The difference of the changes of the velocities so far.
    apart: [Vector3<f64>; 2],
}

/// An impact that both runs have.
#[derive(Debug)]
struct Met {
    of: Impact,
    /// Its time in the other.
    there: f64,
}

/// An error of the velocities of a body from a time on.
#[derive(Debug)]
pub(super) struct Mistake {
    pub body: usize,
    pub t: f64,
    pub change: [Vector3<f64>; 2],
}

impl OrderOfImpacts {
    /// Prepares a comparison for a number of bodies.
    pub fn new(bodies: usize) -> Self {
        Self { bodies: (0..bodies).map(|_| Sequences::default()).collect(), since: f64::NEG_INFINITY }
    }

    /// Takes impacts of the run, or of that with longer steps.
    pub fn take(&mut self, is_longer: bool, impacts: impl Iterator<Item = Impact>) {
        for impact in impacts.filter(|impact| impact.t >= self.since) {
            self.bodies[impact.body].open[usize::from(is_longer)].push_back(impact);
        }
    }

    /// Forgets the impacts before a time: time stepping took a part of a step, and has none at times of their own.
    pub fn forget(&mut self, before: f64) {
        self.since = self.since.max(before);
        for of in &mut self.bodies {
            let rest = std::mem::take(of)
                .open
                .map(|mut open| open.split_off(open.partition_point(|impact| impact.t < before)));
            of.open = rest;
        }
    }

    /// Compares the sequences up to the time `t` to which both runs have come, with the longer steps of length `h`: the times of an
    /// impact that both have differ by less.
    pub fn mistakes(&mut self, t: f64, h: f64) -> Vec<Mistake> {
        let mut mistakes = Vec::new();
        self.bodies.iter_mut().for_each(|of| of.compare(t - h, h, &mut mistakes));
        mistakes
    }
}

impl Sequences {
    /// Compares impacts while both runs have one, or one has come before the time `due` and the other run has none.
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
                    // What comes may be in common yet.
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

    /// The numbers of impacts of each run before the next one that both have, within a time `h`; those with the least energy that there are.
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

    /// Takes the next impact, which both runs have.
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
