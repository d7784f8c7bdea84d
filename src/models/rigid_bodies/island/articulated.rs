//! One time step of an island with joints, in two stages.
//!
//! **Positions.** With mean velocities `w` over the step, impulses `p` of contacts and `lambda` of joints, and `G`
//! and rotations at mean frames ([`Linked`]),
//!
//! ```text
//! 2 M (w - v) = h f + J^T p + G^T lambda,    c(q (+) h w) = 0,    (p, J w) in the law of contact
//! ```
//!
//! The energy at the velocities `v* = 2 w - v` is the initial energy plus the work `p . J w <= 0` of contacts. Joints
//! do no work, for any step size.
//!
//! **Velocities.** `v+` is the projection `P` of `v*` onto the velocities admitted by the joints at `q+`, with the
//! impulses `p` of closed contacts replaced by those of Moreau's law for the whole step (friction, restitution, end of
//! approach),
//!
//! ```text
//! v+ = P (v* - M^-1 J^T p) + P M^-1 J^T r,    (r, J v+) in the law of impact
//! ```
//!
//! The energy loss by the projection `P` is of fifth order in the step size if the step resolves the motion. If the
//! loss exceeds [`LOSS`], or if Newton's method does not converge, the step is halved.

mod compliance;
mod contacts;
mod displacement;
mod restoration;

use super::super::contact::{Contact, mark_torques};
use super::super::drive::DriveState;
use super::super::linkage::Linked;
use super::super::made_parts::{is_twice, may_try};
use super::super::midpoint::{CONVERGED, Midpoint, apart, join, twist};
use super::super::motion::Motion;
use super::{Carried, Guess, Island, Mechanism, Unsolved, Work};
use contact::law::Law;
use nalgebra::{Vector3, Vector6};
use problem::Control;

/// Admissible energy loss by the velocity projection, relative to the largest kinetic energy or to the energy
/// supplied by forces in a step. Ten thousand steps with this loss would lose 1e-3 of the energy, above which a
/// solution is reported as inaccurate; a tenth of it would take 1.6 times the steps, because the loss is of fifth
/// order.
const LOSS: f64 = 1e-7;

/// Admissible energy loss by the velocity projection in a step with contact impulses, relative to the largest kinetic
/// energy. Impacts in linkages are of first order, and the loss does not decrease with the fifth order: a smaller
/// bound would halve steps to the limit. Ten impacts with this loss would lose 1e-3 of the energy, above which a
/// solution is reported as inaccurate.
const LOSS_IN_IMPACTS: f64 = 1e-4;

/// Admissible energy of the change of velocity-dependent forces within a step, relative to the largest kinetic
/// energy. The midpoint rule reverses a velocity that should decay within less than a step. With a drag coefficient
/// `c` and `z = h c / m`, this bound limits the remaining velocity to `0.1 / z`, and its energy to 1e-3, above which
/// a solution is reported as inaccurate, if `z > 3`. A smaller bound would also reduce steps that resolve the motion.
const STIFF: f64 = 1e-2;

/// Maximum number of Newton iterations for the mean velocities of an island's bodies: three to six suffice unless the
/// step is too long.
const ITERATIONS: usize = 12;

/// Bound on the estimated error of a Newton iterate, relative to the tolerance for the last change, below which the
/// iteration stops early. The margin of ten allows for the error of the estimate, which extrapolates the ratio of two
/// changes.
const AHEAD: f64 = 0.1;

/// Factor by which one step size may exceed another and still count as equal: step sizes are products with powers of
/// two, up to rounding.
const WITHIN: f64 = 1.0 + 1e-9;

/// The relative change of velocities below which a stagnating iteration with contacts counts as converged: the
/// accuracy that the tolerance of the contact law, 1e-4 of this value, leaves for mass ratios of 1e4. A larger value
/// would cause visible joint drift.
const STAGNANT: f64 = 1e-6;

/// Maximum number of halvings of a step of an island without contacts: shorter steps would not resolve more.
const HALVINGS: u32 = 20;

/// The ratio of admissible to actual energy loss by the projection above which the step size is doubled: since the
/// loss is of fifth order, that of a step of twice the length is 32 times as large. With a smaller ratio most doubled
/// steps would be rejected, with a larger ratio steps would stay halved needlessly.
const ROOM: f64 = 32.0;

/// The position of a body in an island: the index of its linkage in the island, and its index in the linkage.
type Home = (usize, usize);

/// A copy of the state of an island at the beginning of a step, to restore it after rejection.
struct Kept {
    moving: Vec<Motion>,
    joints: Vec<(Vec<Vector6<f64>>, Vec<DriveState>)>,
    accelerations: Vec<Option<Vector6<f64>>>,
    t: f64,
    done: Work,
    steps: u64,
    parts: usize,
    repeated: f64,
}

impl Kept {
    fn of(island: &Island, linked: &[Linked<'_>]) -> Self {
        let joints = linked.iter().map(|linked| (linked.forces.clone(), linked.states.clone())).collect();
        let (moving, accelerations) = (island.moving.clone(), island.accelerations.clone());
        let Island { t, done, steps, repeated, .. } = *island;
        Self { moving, joints, accelerations, t, done, steps, parts: island.made.len(), repeated }
    }

    fn restore(&self, island: &mut Island, linked: &mut [Linked<'_>]) {
        island.moving.clone_from(&self.moving);
        island.accelerations.clone_from(&self.accelerations);
        (island.t, island.done, island.steps, island.repeated) = (self.t, self.done, self.steps, self.repeated);
        island.made.truncate(self.parts);
        for (linked, (forces, states)) in linked.iter_mut().zip(&self.joints) {
            linked.forces.clone_from(forces);
            linked.states.clone_from(states);
        }
    }
}

impl Island {
    fn linked<'m>(&self, mechanism: &'m Mechanism<'_>) -> (Vec<Linked<'m>>, Vec<Home>) {
        let place = |body: &u32| self.bodies.binary_search(body).ok().map(|place| place as u32);
        let mut linked = Vec::with_capacity(self.linkages.len());
        let mut homes = vec![None; self.bodies.len()];
        for (&k, carried) in self.linkages.iter().zip(&self.carried) {
            let linkage = &mechanism.linkages[k as usize];
            let bodies: Vec<u32> = linkage.bodies.iter().filter_map(place).collect();
            for (place, &body) in bodies.iter().enumerate() {
                homes[body as usize] = Some((linked.len(), place));
            }
            let Carried { tensions, states, .. } = carried.clone();
            linked.push(Linked::new(linkage, mechanism.joints, bodies, tensions, states));
        }
        let mut home = |(body, home): (usize, &Option<Home>)| {
            home.unwrap_or_else(|| {
                linked.push(Linked::new(&mechanism.alone, &[], vec![body as u32], Vec::new(), Vec::new()));
                (linked.len() - 1, 0)
            })
        };
        let homes = homes.iter().enumerate().map(&mut home).collect();
        (linked, homes)
    }

    /// Makes a step of an island with joints: first without contacts, divided into parts if the step is too long; if a
    /// contact closes, the step is repeated with the closing contacts.
    pub(super) fn solve_joined(&mut self, h: f64, mechanism: &Mechanism<'_>, law: &mut Law, control: &Control) {
        let (mut linked, homes) = self.linked(mechanism);
        self.accelerations.clear();
        self.accelerations.resize(self.bodies.len(), None);
        for (linked, carried) in linked.iter().zip(&self.carried) {
            for (&body, acceleration) in linked.bodies.iter().zip(&carried.accelerations) {
                self.accelerations[body as usize] = Some(*acceleration);
            }
        }
        let is_solved = self.step_without_contacts(&mut linked, h, mechanism, control).unwrap_or_else(|closing| {
            // Do not try a step with contacts that is too long according to the last steps.
            (h <= self.parts.pushed * WITHIN || self.is_shortest || mechanism.exceeded.is_some())
                && self.step_with_contacts(closing, &mut linked, &homes, h, mechanism, law, control)
        });
        if !is_solved && self.unsolved.is_none() {
            self.unsolved = Some(Unsolved::TooLong);
        }
        for (carried, linked) in self.carried.iter_mut().zip(linked) {
            let of_bodies = linked.bodies.iter().map(|&body| self.accelerations[body as usize]);
            carried.accelerations = of_bodies.collect::<Option<_>>().unwrap_or_default();
            (carried.tensions, carried.states, carried.reactions) = (linked.forces, linked.states, linked.reactions);
            (carried.largest_energy, carried.parts) = (self.largest_energy, self.parts);
        }
    }

    /// Tries a step without contacts; returns whether it was solved.
    ///
    /// # Errors
    /// For each contact, whether it closes in the step, if any does; the island is then restored to the
    /// beginning of the step.
    fn step_without_contacts(
        &mut self,
        linked: &mut [Linked<'_>],
        h: f64,
        mechanism: &Mechanism<'_>,
        control: &Control,
    ) -> Result<bool, Vec<bool>> {
        let carries = |contact: &Contact| !contact.is_torque() && contact.impulse != Vector3::zeros();
        if self.contacts.iter().any(carries) {
            let mean: Vec<Vector6<f64>> = self.midpoint(h, mechanism).mean;
            self.judge_positions(&mean, h);
        } else {
            let kept = Kept::of(self, linked);
            let is_solved = self.advance_in_parts(linked, h, mechanism, 0, control);
            // If the step was made in several parts, the result of the last part is no initial guess for the whole
            // step.
            self.guess = self.guess.take().filter(|_| self.steps == kept.steps + 1);
            if self.contacts.is_empty() || control.go_on().is_err() {
                return Ok(is_solved);
            }
            let mean: Vec<Vector6<f64>> =
                kept.moving.iter().zip(&self.moving).map(|(from, to)| from.way_to(to) / h).collect();
            self.judge_positions(&mean, h);
            if is_solved && !self.contacts.iter().any(Contact::stays_closed) {
                return Ok(true);
            }
            kept.restore(self, linked);
        }
        let mut closing: Vec<bool> =
            self.contacts.iter().map(|contact| carries(contact) || contact.stays_closed()).collect();
        mark_torques(&self.contacts, &mut closing);
        Err(closing)
    }

    /// Makes a step of the island without contacts, in parts as long as in the last step, and longer if the energy loss
    /// by the projection onto the joint constraints permits.
    fn advance_in_parts(
        &mut self,
        linked: &mut [Linked<'_>],
        h: f64,
        mechanism: &Mechanism<'_>,
        halvings: u32,
        control: &Control,
    ) -> bool {
        if control.go_on().is_err() {
            return true;
        }
        let longest = self.longest_exceeded(h, mechanism);
        let is_tried = longest.map_or(h <= self.parts.free * WITHIN, |longest| may_try(h, longest));
        if is_tried || halvings == HALVINGS {
            if let Some(room) = self.advance_freely(linked, h, mechanism) {
                self.parts.free = if room > ROOM { 2.0 * h } else { h };
                return true;
            }
            self.parts.free = 0.5 * h;
        }
        halvings < HALVINGS
            && self.advance_in_parts(linked, 0.5 * h, mechanism, halvings + 1, control)
            && self.advance_in_parts(linked, 0.5 * h, mechanism, halvings + 1, control)
    }

    /// In a comparison run with longer steps, returns the length of the longest part into which the first run divided
    /// its steps within the next time `h`; otherwise `None`.
    fn longest_exceeded(&self, h: f64, mechanism: &Mechanism<'_>) -> Option<f64> {
        mechanism.exceeded.as_ref().map(|parts| parts.longest_of(&self.bodies, [self.t, self.t + h]))
    }

    /// Predicts the gaps of all contacts of the island at the end of a step of size `h` from mean velocities.
    fn judge_positions(&mut self, mean: &[Vector6<f64>], h: f64) {
        for contact in &mut self.contacts {
            contact.foresee(h, |body| apart(&mean[body as usize]));
        }
    }

    fn midpoint(&self, h: f64, mechanism: &Mechanism<'_>) -> Midpoint {
        let weight = |motion: &Motion| join(&(mechanism.gravity * (motion.mass * h)), &Vector3::zeros());
        // Bodies that were in an island without joints in the last step may have the velocities at its midpoint: add
        // the rest of the velocity change by gravity.
        let start = self.moving.iter().map(|motion| motion.kicked(&(mechanism.gravity * motion.lag)));
        let forces = self.moving.iter().map(weight).collect();
        let mut midpoint = Midpoint::new(start.collect(), forces, self.actions.clone(), [self.t, h]);
        midpoint.extrapolate(&self.accelerations);
        midpoint
    }

    /// Makes a single step of the island without contacts; returns the ratio of admissible to actual energy loss by the
    /// projection onto the joint constraints, or `None` if the step is too long.
    fn advance_freely(&mut self, linked: &mut [Linked<'_>], h: f64, mechanism: &Mechanism<'_>) -> Option<f64> {
        let mut midpoint = self.midpoint(h, mechanism);
        let course = mechanism.signals.over(self.t, h);
        let t = self.t;
        let ground = |k: u32| mechanism.grounding(k, t, h);
        linked.iter_mut().for_each(|linked| linked.begin(&midpoint.starts, &course, ground));
        let (mut iterations, mut last) = (0, f64::INFINITY);
        while !iterate(&mut midpoint, linked, &mut last, |_, _| true) {
            iterations += 1;
            self.newton += 1;
            if iterations == ITERATIONS || linked.iter().any(|linked| !linked.is_solved) {
                return None;
            }
        }
        let Ended { velocities, lost, driven } = end(&midpoint, linked)?;
        let lost: f64 = lost.iter().sum();
        let energy = 0.5 * midpoint.weigh(&midpoint.end_velocities());
        let largest = self.largest_energy.max(energy).max(0.5 * midpoint.size());
        let most = LOSS * largest;
        let is_judged = mechanism.exceeded.is_none();
        if is_judged && (lost > most || stiffness(&midpoint, linked, &velocities) > STIFF * largest) {
            return None;
        }
        self.arrive(&midpoint, linked, &velocities, energy, mechanism);
        self.done.drives += driven;
        self.guess = Some(Guess::of(midpoint, linked));
        Some(if lost > 0.0 { most / lost } else { f64::INFINITY })
    }

    /// Accepts the step of the island: sets the bodies to the end of the step and updates work, time and statistics.
    fn arrive(
        &mut self,
        midpoint: &Midpoint,
        linked: &mut [Linked<'_>],
        velocities: &[Vector6<f64>],
        energy: f64,
        mechanism: &Mechanism<'_>,
    ) {
        let is_repeated =
            self.longest_exceeded(midpoint.h, mechanism).is_some_and(|longest| !is_twice(midpoint.h, longest));
        self.repeated += if is_repeated { midpoint.h } else { 0.0 };
        self.made.push([self.t, self.t + midpoint.h]);
        for ((motion, moved), velocities) in self.moving.iter_mut().zip(&midpoint.moved).zip(velocities) {
            let (velocity, omega) = apart(velocities);
            motion.arrive(&moved.pose, &velocity, &omega);
        }
        let changes = velocities.iter().zip(&midpoint.start).map(|(end, start)| (end - twist(start)) / midpoint.h);
        self.accelerations.clear();
        self.accelerations.extend(changes.map(Some));
        for linked in linked {
            linked.end(midpoint);
            self.done.drives += linked.done.drives;
            self.done.damped += linked.done.damped;
        }
        self.done.forces += midpoint.work_of_actions();
        self.t += midpoint.h;
        self.largest_energy = self.largest_energy.max(energy);
        self.steps += 1;
    }
}

/// Returns the energy of the change of velocity-dependent forces (motion-dependent forces and dampers) between their
/// means over the step and their values at its end.
fn stiffness(midpoint: &Midpoint, linked: &[Linked<'_>], velocities: &[Vector6<f64>]) -> f64 {
    let of_dampers: f64 = linked.iter().map(|linked| linked.stiffness_of_dampers(midpoint, velocities)).sum();
    of_dampers + midpoint.stiffness_of_actions(velocities)
}

/// Makes a Newton step for the mean velocities of the bodies, corrected by the function `contacts`; returns whether the
/// iteration has converged. `last` is the relative change by the previous Newton step, and is updated.
fn iterate(
    midpoint: &mut Midpoint,
    linked: &mut [Linked<'_>],
    last: &mut f64,
    mut contacts: impl FnMut(&Midpoint, &mut [Linked<'_>]) -> bool,
) -> bool {
    if !linked.iter_mut().all(|linked| linked.linearise(midpoint)) || !contacts(midpoint, linked) {
        return false;
    }
    let mut changes = vec![Vector6::zeros(); midpoint.mean.len()];
    linked.iter().for_each(|linked| linked.add(&mut changes));
    let size = midpoint.size();
    for linked in linked.iter_mut() {
        linked.add(&mut midpoint.mean);
        linked.add_impulses();
    }
    midpoint.arrive();
    let change = (midpoint.weigh(&changes) / size).sqrt();
    // If the changes by Newton steps decrease superlinearly, the remaining error is below the last change times its
    // ratio to the change before.
    let left = if last.is_finite() && change < *last { change * (change / *last) } else { f64::INFINITY };
    // If all velocities are zero, the velocity scale is zero and the relative `change` is NaN.
    let is_over = change <= CONVERGED
        || left <= AHEAD * CONVERGED
        || midpoint.weigh(&changes) == 0.0
        || change >= 0.5 * *last && change <= STAGNANT;
    *last = change;
    is_over
}

impl Guess {
    fn of(midpoint: Midpoint, linked: &[Linked<'_>]) -> Self {
        Self { mean: midpoint.mean, impulses: linked.iter().map(|linked| linked.impulses().to_vec()).collect() }
    }
}

/// The velocities at the end of a step after the projection onto the joint constraints, and the energy balance of the
/// projection.
struct Ended {
    /// The velocities of all bodies, projected onto the joint constraints.
    velocities: Vec<Vector6<f64>>,
    /// The energy loss by the projection onto the joint constraints, one entry per linkage.
    lost: Vec<f64>,
    /// The work of drives in the projection of the velocities onto the joint constraints.
    driven: f64,
}

/// Projects the velocities at the end of the step onto the joint constraints; `None` if the constraint equations are
/// singular. The factorised matrices of the linkages are then those at the end of the step.
fn end(midpoint: &Midpoint, linked: &mut [Linked<'_>]) -> Option<Ended> {
    let moved = midpoint.moved_bodies();
    let mut ended =
        Ended { velocities: midpoint.end_velocities(), lost: Vec::with_capacity(linked.len()), driven: 0.0 };
    for linked in linked {
        if !linked.hold(&midpoint.ends, &moved) {
            return None;
        }
        let before = midpoint.kinetic_energy_at_end(&linked.bodies, &ended.velocities);
        let driven = linked.project(&midpoint.ends, &mut ended.velocities, false);
        ended.lost.push(before + driven - midpoint.kinetic_energy_at_end(&linked.bodies, &ended.velocities));
        ended.driven += driven;
    }
    Some(ended)
}
