//! Evidence of the error of time stepping over impacts: a second run with steps twice as long, made beside the first at half
//! its cost.
//!
//! For a method of first order the difference of the two runs is the error of the first, on the average: an impact happens at
//! any point of its step, and where both runs move it to the same time, they do not differ. So an impact also counts by
//! what it may be off, a whole step. Impacts add up like independent errors; what they have in common, the runs show.
//!
//! Positions are continuous and are compared at every common time. Velocities and energies jump, at times that differ from
//! run to run by up to a step, and are compared in the mean over time. Each quantity is relative to its largest value over the run;
//! one that is never larger than what the forces of a single step would make of it is relative to that, since no step
//! resolves less.

use super::given_steps::{GIVEN_STEPS, is_worse, rounding_of};
use super::run::Plan;
use super::{CheckCode, Checks};
use std::ops::Range;

/// The number of moving bodies up to which rigid bodies are compared. What many bodies that collide with each other do one by
/// one is not reproducible: each collision multiplies a difference several times, so that some tens of collisions in a
/// row make one of rounding as large as a body. Such runs are also the long ones.
pub const MOST_COMPARED: usize = 100;

/// The kind of a quantity: positions are continuous in time, velocities and energies jump.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Kind {
    Position,
    Velocity,
    Energy,
}

/// A quantity of a run, and its distance from that of the run with longer steps.
#[derive(Clone, Debug)]
struct Quantity {
    name: String,
    kind: Kind,
    /// Whether the answer contains it.
    is_kept: bool,
    /// Its largest value so far.
    size: f64,
    /// Largest distance of a position; integral over time of that of a velocity or an energy.
    distance: f64,
    /// Sum of the squares of what impacts, each off by a step, change of a position.
    impacts: f64,
}

/// The comparison of a run with one whose steps are twice as long.
#[derive(Clone, Debug)]
pub(super) struct Comparison {
    quantities: Vec<Quantity>,
    /// Whether the steps have the default size.
    is_default: bool,
    /// The time over which velocities were compared.
    compared: f64,
    /// Why the other run came to an end.
    failed: Option<String>,
}

impl Comparison {
    /// Prepares a comparison of quantities, each with its name and its fields. If the answer contains some of them only, these
    /// are judged: what nobody asks for, such as the spin of a light link, may be far less accurate.
    pub fn new(
        quantities: impl IntoIterator<Item = (String, Kind, Range<usize>)>,
        plan: &Plan,
        is_default: bool,
    ) -> Self {
        let Plan { fields, observables, reducers, .. } = plan;
        let has_others = !observables.names.is_empty() || !observables.monitors.is_empty() || reducers.is_some();
        let quantity = |(name, kind, of): (String, Kind, Range<usize>)| {
            let is_kept = !has_others && fields.iter().any(|field| of.contains(field));
            Quantity { name, kind, is_kept, size: 0.0, distance: 0.0, impacts: 0.0 }
        };
        let mut quantities: Vec<Quantity> = quantities.into_iter().map(quantity).collect();
        if quantities.iter().all(|quantity| !quantity.is_kept) {
            quantities.iter_mut().for_each(|quantity| quantity.is_kept = true);
        }
        Self { quantities, is_default, compared: 0.0, failed: None }
    }

    /// Notes a value of quantity `k` that the run had, or that a step could have made.
    pub fn meet(&mut self, k: usize, size: f64) {
        let known = &mut self.quantities[k].size;
        *known = known.max(size);
    }

    /// Lets quantities be measured in one unit, as the coordinates of two bodies along the line on which they meet: none of them
    /// counts as smaller than the others.
    pub fn share_units(&mut self, groups: &[Vec<usize>]) {
        // A size passes through one group a round.
        for _ in groups {
            for group in groups {
                let largest = group.iter().map(|&k| self.quantities[k].size).fold(0.0, f64::max);
                group.iter().for_each(|&k| self.meet(k, largest));
            }
        }
    }

    /// Notes that velocities are compared over a further time `h`.
    pub fn pass(&mut self, h: f64) {
        self.compared += h;
    }

    /// Notes the distance of quantity `k`; that of a velocity is its mean over a time `h`.
    pub fn differ(&mut self, k: usize, distance: f64, h: f64) {
        let Quantity { kind, distance: known, .. } = &mut self.quantities[k];
        *known = match kind {
            Kind::Position if is_worse(distance, *known) => distance,
            Kind::Position => *known,
            Kind::Velocity | Kind::Energy => *known + distance * h,
        };
    }

    /// Notes that contacts change the velocity of position `k` in a step of length `h`, at some point of it, where forces would
    /// change it by `kick`. What contacts carry throughout the step is no larger than these, and is not displaced in time.
    pub fn strike(&mut self, k: usize, change: f64, kick: f64, h: f64) {
        self.quantities[k].impacts += (h * (change.abs() - kick.abs()).max(0.0)).powi(2);
    }

    /// Notes that the run with longer steps failed.
    pub fn fail(&mut self, why: String) {
        self.failed = Some(why);
    }

    /// Whether the run with longer steps goes on.
    pub fn goes_on(&self) -> bool {
        self.failed.is_none()
    }

    /// Records the largest error relative to the size of its quantity, beside the permitted error `allowed`. A permitted error
    /// that leaves less than three digits is a caveat.
    pub fn judge(&self, allowed: f64, checks: &mut Checks) {
        let size = match self.is_default {
            true => "the steps have the default size",
            false => "the steps have the size that `method` gives",
        };
        if let Some(why) = &self.failed {
            checks.record(CheckCode::LocalError, f64::INFINITY, allowed, || {
                format!("{size}, and a run with steps twice as long, which would show what they are worth, failed: {why}; give a smaller `step`")
            });
            return;
        }
        let Some((error, message)) = self.worst() else { return };
        let message = format!("{size}, {message}; give a smaller `step`");
        if error > GIVEN_STEPS && error <= allowed {
            checks.caveat("coarse_steps", message.clone());
        }
        checks.record(CheckCode::LocalError, error, allowed, || message);
    }

    /// The largest error relative to the size of its quantity, and what it is an error of.
    fn worst(&self) -> Option<(f64, String)> {
        let rounding = [Kind::Position, Kind::Velocity, Kind::Energy].map(|kind| {
            let of_kind = self.quantities.iter().filter(|quantity| quantity.kind == kind);
            rounding_of(&of_kind.map(|quantity| quantity.size).collect::<Vec<f64>>())
        });
        let mut worst: Option<(f64, String)> = None;
        let is_new =
            |error: f64, worst: &Option<(f64, String)>| worst.as_ref().is_none_or(|(most, _)| is_worse(error, *most));
        for Quantity { name, kind, size: own, distance, impacts, .. } in self.quantities.iter().filter(|of| of.is_kept)
        {
            let (over, when) = match kind {
                Kind::Position => (1.0, "by up to"),
                Kind::Velocity | Kind::Energy => (self.compared, "in the mean over time by"),
            };
            let own = own.max(rounding[*kind as usize]);
            if own == 0.0 || over == 0.0 {
                continue;
            }
            let by_impacts = impacts.sqrt() / own;
            if is_new(by_impacts, &worst) {
                let what = format!(
                    "and impacts, each off by up to a step, move {name} by {by_impacts:.1e} of its largest value"
                );
                worst = Some((by_impacts, what));
            }
            let relative = distance / over / own;
            if is_new(relative, &worst) {
                let what = format!(
                    "and {name} is estimated to be off {when} {relative:.1e} of its largest value, by which it differs with \
                     steps twice as long"
                );
                worst = Some((relative, what));
            }
        }
        worst
    }
}

/// Says that steps over impacts were not compared with longer ones, and why.
pub(super) fn not_compared(checks: &mut Checks, why: &str) {
    checks.caveat("error_not_estimated", format!("what the steps are worth was not estimated: {why}"));
}
