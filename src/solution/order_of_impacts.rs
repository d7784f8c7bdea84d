//! Whether two runs with located impacts take the same impacts in the same order.
//!
//! A body that meets others with one corner and then with another goes elsewhere if the order is the other one: its motion is not
//! continuous there, and a run may be on the wrong side with all its digits. Two runs on the same wrong side agree. So
//! the order counts as known only where impacts are further apart than what the two runs differ by in their times; else the smaller of
//! the two impacts is an error of the velocity. Where one run has an impact that the other does not, that impact is one.

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
}

/// An impact that both runs have.
#[derive(Debug)]
struct Met {
    of: Impact,
    /// The difference of its times.
    late: f64,
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
        self.bodies.iter_mut().for_each(|of| *of = Sequences::default());
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
            let [own, other] = self.open.each_ref().map(VecDeque::front);
            let is_extra = |impact: &Impact| impact.t < due;
            let only = match (own, other) {
                (Some(own), Some(other)) if own.contacts == other.contacts && (own.t - other.t).abs() < h => {
                    let late = (own.t - other.t).abs();
                    self.meet(late, mistakes);
                    continue;
                }
                (Some(own), Some(other)) if (own.t - other.t).abs() < h => usize::from(other.energy < own.energy),
                (Some(own), Some(other)) => usize::from(other.t < own.t),
                (Some(impact), None) if is_extra(impact) => 0,
                (None, Some(impact)) if is_extra(impact) => 1,
                _ => return,
            };
            if let Some(Impact { t, body, change, .. }) = self.open[only].pop_front() {
                mistakes.push(Mistake { body, t, change });
            }
        }
    }

    /// Takes the next impact, which both runs have, at times that differ by `late`.
    fn meet(&mut self, late: f64, mistakes: &mut Vec<Mistake>) {
        let [Some(of), Some(_)] = self.open.each_mut().map(VecDeque::pop_front) else { return };
        if let Some(last) = &self.last
            && last.of.contacts != of.contacts
            && of.t - last.of.t <= last.late + late
        {
            let smaller = if of.energy < last.of.energy { &of } else { &last.of };
            mistakes.push(Mistake { body: of.body, t: of.t, change: smaller.change });
        }
        self.last = Some(Met { of, late });
    }
}
