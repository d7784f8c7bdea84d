//! One step of an island with joints, in two stages.
//!
//! **Positions.** With the mean velocities `w` over the step, and `G` and the rotations in their means ([`Linked`]),
//!
//! ```text
//! 2 M (w - v) = h f + J^T p + G^T lambda,    c(q (+) h w) = 0,    (p, J w) in the law of contact
//! ```
//!
//! The energy at `v* = 2 w - v` is that of the start and the work `p . J w` of the contacts, which is not above zero: joints
//! do none, whatever the step.
//!
//! **Velocities.** `v+` is `v*`, projected on the velocities that joints let be at `q+`, with the impulses `p` of closed
//! contacts replaced by those of Moreau's law for the whole step: friction, restitution, and the end of an approach,
//!
//! ```text
//! v+ = P (v* - M^-1 J^T p) + P M^-1 J^T r,    (r, J v+) in the law of impact
//! ```
//!
//! What `P` takes is of fifth order in a motion that the step resolves. Where it takes more than [`LOSS`], or Newton's method
//! does not find `w`, the step is halved.

mod compliance;
mod contacts;
mod displacement;

use super::super::contact::Contact;
use super::super::drive::DriveState;
use super::super::linkage::Linked;
use super::super::midpoint::{CONVERGED, Midpoint, apart, join};
use super::super::motion::Motion;
use super::{Carried, Island, Mechanism, Unsolved, Work};
use contact::law::Law;
use nalgebra::{Vector3, Vector6};
use problem::Control;

/// The part of the largest kinetic energy, or of that which forces give in a step, that the projection of velocities may take.
/// Ten thousand steps with more would lose the thousandth that the verdict allows; with a tenth of it, as the loss is of fifth
/// order, a motion would take 1.6 times the steps.
const LOSS: f64 = 1e-7;

/// The same in a step in which contacts push. An impact between joints is of first order, and what the projection takes after it
/// does not vanish by the fifth: a smaller bound halves steps down to the end. Ten impacts with more would lose the thousandth.
const LOSS_IN_IMPACTS: f64 = 1e-4;

/// The part of the largest kinetic energy that changes of forces by velocities may come to within a step. A midpoint turns a
/// velocity that a force takes within less than a step around, and does not take it: with a drag `c` and `z = h c / m` the
/// velocity that is left so is a tenth over `z`, and its energy at most a thousandth where `z > 3`, which is what the verdict
/// allows. A smaller part makes steps shorter that resolve the motion.
const STIFF: f64 = 1e-2;

/// Newton's iterations: it converges in three to six, or the step is too long.
const ITERATIONS: usize = 12;

/// The change of velocities below which iterations of the contact law that no longer gain are over: what its tolerance leaves, a
/// ten thousandth part of it for contacts of masses as far apart. A larger one is drift of joints that would be seen.
const STAGNANT: f64 = 1e-6;

/// Halvings of a step: shorter ones resolve nothing that longer ones do not.
const HALVINGS: u32 = 20;

/// How far a step stays below what the projection may take before one of twice the length is tried, which takes so many times as
/// much by its order. A lesser one is refused in most cases; a greater one leaves steps halved that need not be.
const ROOM: f64 = 32.0;

/// Places of a body: its linkage in the island, and its place there.
type Home = (usize, usize);

/// An island at the start of a step, to come back to.
struct Kept {
    moving: Vec<Motion>,
    joints: Vec<(Vec<Vector6<f64>>, Vec<DriveState>)>,
    t: f64,
    done: Work,
    steps: u64,
}

impl Kept {
    fn of(island: &Island, linked: &[Linked<'_>]) -> Self {
        let joints = linked.iter().map(|linked| (linked.forces.clone(), linked.states.clone())).collect();
        Self { moving: island.moving.clone(), joints, t: island.t, done: island.done, steps: island.steps }
    }

    fn restore(&self, island: &mut Island, linked: &mut [Linked<'_>]) {
        island.moving.clone_from(&self.moving);
        (island.t, island.done, island.steps) = (self.t, self.done, self.steps);
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

    /// Makes a step of the island: without its contacts, in parts where it is too long, as long as none of them closes; else
    /// with those that do.
    pub(super) fn solve_joined(&mut self, h: f64, mechanism: &Mechanism<'_>, law: &mut Law, control: &Control) {
        let (mut linked, homes) = self.linked(mechanism);
        let is_solved = self.step_without_contacts(&mut linked, h, mechanism, control).unwrap_or_else(|closing| {
            self.step_with_contacts(closing, &mut linked, &homes, h, mechanism, law, control)
        });
        if !is_solved {
            self.unsolved = Some(Unsolved::TooLong);
        }
        for (carried, linked) in self.carried.iter_mut().zip(linked) {
            (carried.tensions, carried.states, carried.reactions) = (linked.forces, linked.states, linked.reactions);
            (carried.largest_energy, carried.halvings) = (self.largest_energy, self.halvings);
        }
    }

    /// Whether there is a step without contacts; or, by contact, which of them close in it, and nothing has moved.
    fn step_without_contacts(
        &mut self,
        linked: &mut [Linked<'_>],
        h: f64,
        mechanism: &Mechanism<'_>,
        control: &Control,
    ) -> Result<bool, Vec<bool>> {
        let carries = |contact: &Contact| contact.impulse != Vector3::zeros();
        if self.contacts.iter().any(carries) {
            let mean: Vec<Vector6<f64>> = self.midpoint(h, mechanism).mean;
            self.judge_positions(&mean, h);
        } else {
            let kept = Kept::of(self, linked);
            let is_solved = self.advance_in_parts(linked, h, mechanism, 0, control);
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
        Err(self.contacts.iter().map(|contact| carries(contact) || contact.stays_closed()).collect())
    }

    /// A step without contacts, or halves of it: as many as held before, and fewer once these leave room.
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
        if halvings >= self.halvings {
            if let Some(room) = self.advance_freely(linked, h, mechanism) {
                self.halvings = if room > ROOM { halvings.saturating_sub(1) } else { halvings };
                return true;
            }
            self.halvings = (halvings + 1).min(HALVINGS);
        }
        halvings < HALVINGS
            && self.advance_in_parts(linked, 0.5 * h, mechanism, halvings + 1, control)
            && self.advance_in_parts(linked, 0.5 * h, mechanism, halvings + 1, control)
    }

    /// The gaps at the end of the step.
    fn judge_positions(&mut self, mean: &[Vector6<f64>], h: f64) {
        for contact in &mut self.contacts {
            contact.foresee(h, |body| apart(&mean[body as usize]));
        }
    }

    fn midpoint(&self, h: f64, mechanism: &Mechanism<'_>) -> Midpoint {
        let weight = |motion: &Motion| join(&(mechanism.gravity * (motion.mass * h)), &Vector3::zeros());
        // Bodies without joints may come with velocities of the middle of their last step.
        let start = self.moving.iter().map(|motion| motion.kicked(&(mechanism.gravity * motion.lag)));
        Midpoint::new(start.collect(), self.moving.iter().map(weight).collect(), self.actions.clone(), [self.t, h])
    }

    /// A step without contacts; how far it stays below what the projection may take.
    fn advance_freely(&mut self, linked: &mut [Linked<'_>], h: f64, mechanism: &Mechanism<'_>) -> Option<f64> {
        let mut midpoint = self.midpoint(h, mechanism);
        let course = mechanism.signals.over(self.t, h);
        linked.iter_mut().for_each(|linked| linked.begin(&midpoint.starts, &course));
        let (mut iterations, mut last) = (0, f64::INFINITY);
        while !iterate(&mut midpoint, linked, &mut last, |_, _| true) {
            iterations += 1;
            self.newton += 1;
            if iterations == ITERATIONS || linked.iter().any(|linked| !linked.is_solved) {
                return None;
            }
        }
        let (velocities, lost, driven) = end(&midpoint, linked)?;
        let energy = 0.5 * midpoint.weigh(&midpoint.end_velocities());
        let largest = self.largest_energy.max(energy).max(0.5 * midpoint.size());
        let most = LOSS * largest;
        if lost > most || stiffness(&midpoint, linked, &velocities) > STIFF * largest {
            return None;
        }
        self.arrive(&midpoint, linked, &velocities, energy);
        self.done.drives += driven;
        Some(if lost > 0.0 { most / lost } else { f64::INFINITY })
    }

    /// Takes over where the bodies have come to.
    fn arrive(&mut self, midpoint: &Midpoint, linked: &mut [Linked<'_>], velocities: &[Vector6<f64>], energy: f64) {
        for ((motion, moved), velocities) in self.moving.iter_mut().zip(&midpoint.moved).zip(velocities) {
            let (velocity, omega) = apart(velocities);
            motion.arrive(&moved.pose, &velocity, &omega);
        }
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

/// The energy of what forces and dampers change by from their means to the end of the step.
fn stiffness(midpoint: &Midpoint, linked: &[Linked<'_>], velocities: &[Vector6<f64>]) -> f64 {
    let of_dampers: f64 = linked.iter().map(|linked| linked.stiffness_of_dampers(midpoint, velocities)).sum();
    of_dampers + midpoint.stiffness_of_actions(velocities)
}

/// Newton's step for the mean velocities, which `contacts` may change; whether it was the last. `last` is the change of the one
/// before, in parts of the velocities.
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
    // Bodies that nothing moves have no velocities to compare with.
    let is_over = change <= CONVERGED || midpoint.weigh(&changes) == 0.0 || change >= 0.5 * *last && change <= STAGNANT;
    *last = change;
    is_over
}

/// The velocities at the end as joints let them be, the energy that this takes, and the work of drives in it; the linkages hold
/// their bodies there.
fn end(midpoint: &Midpoint, linked: &mut [Linked<'_>]) -> Option<(Vec<Vector6<f64>>, f64, f64)> {
    let moved = midpoint.moved_bodies();
    let mut velocities = midpoint.end_velocities();
    let energy = midpoint.kinetic_energy_at_end(&velocities);
    let mut driven = 0.0;
    for linked in linked {
        if !linked.hold(&midpoint.ends, &moved) {
            return None;
        }
        driven += linked.project(&midpoint.ends, &mut velocities, false);
    }
    let lost = energy + driven - midpoint.kinetic_energy_at_end(&velocities);
    Some((velocities, lost, driven))
}
