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

use super::super::contact::Contact;
use super::super::frame::Frame;
use super::super::linkage::Linked;
use super::super::midpoint::{Midpoint, apart, join, twist};
use super::super::motion::Motion;
use super::{Island, Mechanism, Unsolved};
use contact::law::Law;
use nalgebra::{Matrix3, Vector3, Vector6};
use problem::Control;
use vi::Outcome;
use vi::coulomb::BlockMatrix;

/// The part of the largest kinetic energy, or of that which forces give in a step, that the projection of velocities may take. A larger one lets a long run
/// of a whipping chain lose what is seen; a smaller one costs steps.
const LOSS: f64 = 1e-7;

/// The same in a step with impacts, which is of first order.
const LOSS_IN_IMPACTS: f64 = 1e-4;

/// Newton's iterations: it converges in three to six, or the step is too long.
const ITERATIONS: usize = 12;

/// The change of velocities, in the norm of the masses, after which the next one is rounding.
const CONVERGED: f64 = 1e-9;

/// The change below which iterations that no longer gain are at what the tolerance of the contact law leaves.
const STAGNANT: f64 = 1e-6;

/// Halvings of a step: shorter ones resolve nothing that longer ones do not.
const HALVINGS: u32 = 20;

/// Places of a body: its linkage in the island, and its place there.
type Home = (usize, usize);

impl Island {
    fn linked<'m>(&self, mechanism: &'m Mechanism<'_>) -> (Vec<Linked<'m>>, Vec<Home>) {
        let place = |body: &u32| self.bodies.binary_search(body).ok().map(|place| place as u32);
        let mut linked = Vec::with_capacity(self.linkages.len());
        let mut homes = vec![None; self.bodies.len()];
        for (&k, tensions) in self.linkages.iter().zip(&self.tensions) {
            let linkage = &mechanism.linkages[k as usize];
            let bodies: Vec<u32> = linkage.bodies.iter().filter_map(place).collect();
            for (place, &body) in bodies.iter().enumerate() {
                homes[body as usize] = Some((linked.len(), place));
            }
            linked.push(Linked::new(linkage, mechanism.joints, bodies, tensions.clone()));
        }
        let mut home = |(body, home): (usize, &Option<Home>)| {
            home.unwrap_or_else(|| {
                linked.push(Linked::new(&mechanism.alone, &[], vec![body as u32], Vec::new()));
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
        for (tensions, linked) in self.tensions.iter_mut().zip(linked) {
            *tensions = linked.forces;
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
        let start = self.moving.clone();
        if self.contacts.iter().any(carries) {
            let mean: Vec<Vector6<f64>> = self.midpoint(h, mechanism).mean;
            self.judge_positions(&mean, h);
        } else {
            let tensions: Vec<_> = linked.iter().map(|linked| linked.forces.clone()).collect();
            let is_solved = self.advance_in_parts(linked, h, mechanism, HALVINGS, control);
            if self.contacts.is_empty() || control.go_on().is_err() {
                return Ok(is_solved);
            }
            let mean: Vec<Vector6<f64>> =
                start.iter().zip(&self.moving).map(|(from, to)| from.way_to(to) / h).collect();
            self.judge_positions(&mean, h);
            if is_solved && !self.contacts.iter().any(Contact::stays_closed) {
                return Ok(true);
            }
            (self.moving, self.steps) = (start, 0);
            linked.iter_mut().zip(tensions).for_each(|(linked, forces)| linked.forces = forces);
        }
        Err(self.contacts.iter().map(|contact| carries(contact) || contact.stays_closed()).collect())
    }

    /// A step with these contacts, and with others that turn out to close.
    #[expect(clippy::too_many_arguments, reason = "the parts of an island")]
    fn step_with_contacts(
        &mut self,
        mut closing: Vec<bool>,
        linked: &mut [Linked<'_>],
        homes: &[Home],
        h: f64,
        mechanism: &Mechanism<'_>,
        law: &mut Law,
        control: &Control,
    ) -> bool {
        let mut all = std::mem::take(&mut self.contacts);
        let start = self.moving.clone();
        let tensions: Vec<_> = linked.iter().map(|linked| linked.forces.clone()).collect();
        let is_solved = loop {
            self.contacts =
                all.iter().zip(&closing).filter(|(_, closes)| **closes).map(|(contact, _)| *contact).collect();
            if !self.advance(linked, homes, h, mechanism, law, control) || control.go_on().is_err() {
                break false;
            }
            let mut solved = std::mem::take(&mut self.contacts).into_iter();
            let of = |body: u32| apart(&(start[body as usize].way_to(&self.moving[body as usize]) / h));
            let mut is_closed = true;
            for (contact, closes) in all.iter_mut().zip(&mut closing) {
                if *closes {
                    solved.next().into_iter().for_each(|solved| *contact = solved);
                } else {
                    contact.gap_at_end = contact.gap + h * contact.velocity(of).x;
                    (contact.impulse, contact.work) = Default::default();
                    *closes = contact.stays_closed();
                    is_closed &= !*closes;
                }
            }
            if is_closed {
                break true;
            }
            (self.moving, self.steps) = (start.clone(), 0);
            linked.iter_mut().zip(&tensions).for_each(|(linked, forces)| linked.forces.clone_from(forces));
        };
        self.contacts = all;
        is_solved
    }

    /// A step without contacts, or halves of it.
    fn advance_in_parts(
        &mut self,
        linked: &mut [Linked<'_>],
        h: f64,
        mechanism: &Mechanism<'_>,
        halvings: u32,
        control: &Control,
    ) -> bool {
        let start = self.moving.clone();
        let tensions: Vec<_> = linked.iter().map(|linked| linked.forces.clone()).collect();
        if control.go_on().is_err() || self.advance_freely(linked, h, mechanism) {
            return true;
        }
        self.moving = start;
        linked.iter_mut().zip(tensions).for_each(|(linked, forces)| linked.forces = forces);
        halvings > 0
            && self.advance_in_parts(linked, 0.5 * h, mechanism, halvings - 1, control)
            && self.advance_in_parts(linked, 0.5 * h, mechanism, halvings - 1, control)
    }

    fn midpoint(&self, h: f64, mechanism: &Mechanism<'_>) -> Midpoint {
        let weight = |motion: &Motion| join(&(mechanism.gravity * (motion.mass * h)), &Vector3::zeros());
        // Bodies without joints may come with velocities of the middle of their last step.
        let start = self.moving.iter().map(|motion| motion.kicked(&(mechanism.gravity * motion.lag)));
        Midpoint::new(start.collect(), self.moving.iter().map(weight).collect(), h)
    }

    fn advance_freely(&mut self, linked: &mut [Linked<'_>], h: f64, mechanism: &Mechanism<'_>) -> bool {
        let mut midpoint = self.midpoint(h, mechanism);
        linked.iter_mut().for_each(|linked| linked.begin(h));
        let (mut iterations, mut last) = (0, f64::INFINITY);
        while !iterate(&mut midpoint, linked, &mut last, |_, _| true) {
            iterations += 1;
            if iterations == ITERATIONS || linked.iter().any(|linked| !linked.is_solved) {
                return false;
            }
        }
        let Some((velocities, lost)) = end(&midpoint, linked) else { return false };
        let energy = 0.5 * midpoint.weigh(&midpoint.end_velocities());
        if lost > LOSS * self.largest_energy.max(energy).max(0.5 * midpoint.size()) {
            return false;
        }
        self.arrive(&midpoint, linked, &velocities, h, energy);
        true
    }

    /// Takes over where the bodies have come to.
    fn arrive(
        &mut self,
        midpoint: &Midpoint,
        linked: &mut [Linked<'_>],
        velocities: &[Vector6<f64>],
        h: f64,
        energy: f64,
    ) {
        for ((motion, moved), velocities) in self.moving.iter_mut().zip(&midpoint.moved).zip(velocities) {
            let (velocity, omega) = apart(velocities);
            motion.arrive(&moved.pose, &velocity, &omega);
        }
        linked.iter_mut().for_each(|linked| linked.end(h));
        self.largest_energy = self.largest_energy.max(energy);
        self.steps += 1;
    }

    /// A step with contacts.
    fn advance(
        &mut self,
        linked: &mut [Linked<'_>],
        homes: &[Home],
        h: f64,
        mechanism: &Mechanism<'_>,
        law: &mut Law,
        control: &Control,
    ) -> bool {
        let mut midpoint = self.midpoint(h, mechanism);
        linked.iter_mut().for_each(|linked| linked.begin(h));
        let gaps: Vec<f64> = self.contacts.iter().map(|contact| contact.gap).collect();
        let mut p: Vec<Vector3<f64>> = self.contacts.iter().map(|contact| contact.impulse).collect();
        let mut last = f64::INFINITY;
        for iteration in 0.. {
            let mut is_solved = false;
            midpoint.push(&self.contacts, &p);
            let is_over = iterate(&mut midpoint, linked, &mut last, |midpoint, linked| {
                let kept: Vec<Vec<Vector6<f64>>> = linked.iter().map(|linked| linked.x.clone()).collect();
                let mut changed = midpoint.mean.clone();
                linked.iter().for_each(|linked| linked.add(&mut changed));
                let Some(compliance) = Compliance::new(&self.contacts, linked, homes, control) else {
                    return false;
                };
                let Some(next) = self.position_impulses(&compliance, &changed, &gaps, &p, h, law, control) else {
                    return false;
                };
                let changes: Vec<Vector3<f64>> = next.iter().zip(&p).map(|(next, p)| next - p).collect();
                respond(&self.contacts, linked, homes, &changes);
                for (linked, kept) in linked.iter_mut().zip(kept) {
                    linked.x.iter_mut().zip(kept).for_each(|(x, kept)| *x += kept);
                }
                p = next;
                is_solved = true;
                true
            });
            if control.go_on().is_err() {
                return true;
            }
            if !is_solved || iteration + 1 == ITERATIONS && !is_over {
                return false;
            }
            if is_over {
                break;
            }
        }
        let Some((mut velocities, lost)) = end(&midpoint, linked) else { return false };
        let energy = 0.5 * midpoint.weigh(&midpoint.end_velocities());
        let most = if p.iter().any(|p| p.x > 0.0) { LOSS_IN_IMPACTS } else { LOSS };
        if lost > most * self.largest_energy.max(energy).max(0.5 * midpoint.size()) {
            return false;
        }
        self.judge_positions(&midpoint.mean, h);
        let positions = self.report;
        let are_replaced = self.replace_impulses(linked, homes, &midpoint.mean, &mut velocities, &p, h, law, control);
        self.report = self.report.zip(positions).map(|(velocities, positions)| velocities.beside(&positions));
        if are_replaced {
            self.arrive(&midpoint, linked, &velocities, h, energy);
        }
        are_replaced
    }

    /// The impulses of the law, with velocities that change with them by a compliance which is not symmetric, from those of
    /// the impulses `p`: its symmetric part takes the law, and the rest is found by iteration.
    #[expect(clippy::too_many_arguments, reason = "the terms of the law")]
    fn position_impulses(
        &mut self,
        compliance: &Compliance,
        velocities: &[Vector6<f64>],
        gaps: &[f64],
        p: &[Vector3<f64>],
        h: f64,
        law: &mut Law,
        control: &Control,
    ) -> Option<Vec<Vector3<f64>>> {
        let start = self.free_velocities(velocities, &compliance.whole, p);
        let size = start.iter().map(Vector3::norm).fold(0.0, f64::max);
        let (mut next, mut last) = (p.to_vec(), f64::INFINITY);
        for _ in 0..ITERATIONS {
            let of = |k: usize| {
                start[k] + compliance.whole.row_product(k, &next) - compliance.symmetric.row_product(k, &next)
            };
            let free: Vec<Vector3<f64>> = (0..p.len()).map(of).collect();
            let impulses = self.impulses(&compliance.symmetric, free, gaps, false, h, next.clone(), law, control);
            if self.report.is_some_and(|report| report.outcome != Outcome::Solved) {
                return None;
            }
            // Redundant contacts have impulses that are not unique: what they do to velocities is.
            let changes: Vec<Vector3<f64>> = impulses.iter().zip(&next).map(|(a, b)| a - b).collect();
            let change = (0..p.len()).map(|k| compliance.whole.row_product(k, &changes).norm()).fold(0.0, f64::max);
            next = impulses;
            if change <= CONVERGED * size || change >= 0.5 * last && change <= STAGNANT * size {
                return Some(next);
            }
            if change >= last {
                return None;
            }
            last = change;
        }
        Some(next)
    }

    /// Velocities at the contacts but for the impulses.
    fn free_velocities(
        &self,
        velocities: &[Vector6<f64>],
        matrix: &BlockMatrix,
        impulses: &[Vector3<f64>],
    ) -> Vec<Vector3<f64>> {
        let of = |body: u32| apart(&velocities[body as usize]);
        let free = |(k, contact): (usize, &Contact)| {
            contact.velocity(of) - matrix.row_product(k, impulses) + Vector3::x() * contact.bias
        };
        self.contacts.iter().enumerate().map(free).collect()
    }

    /// The gaps at the end of the step.
    fn judge_positions(&mut self, mean: &[Vector6<f64>], h: f64) {
        for contact in &mut self.contacts {
            contact.gap_at_end = contact.gap + h * contact.velocity(|body| apart(&mean[body as usize])).x;
        }
    }

    /// Replaces the impulses `p` by those of the law of impact; contacts that are open at the end keep theirs.
    #[expect(clippy::too_many_arguments, reason = "both stages meet here")]
    fn replace_impulses(
        &mut self,
        linked: &mut [Linked<'_>],
        homes: &[Home],
        mean: &[Vector6<f64>],
        velocities: &mut [Vector6<f64>],
        p: &[Vector3<f64>],
        h: f64,
        law: &mut Law,
        control: &Control,
    ) -> bool {
        // A contact that neither pushed nor is closed has nothing to say.
        let all = std::mem::take(&mut self.contacts);
        let (mut kept, mut places) = (Vec::new(), Vec::new());
        for (place, contact) in all.iter().enumerate() {
            if contact.stays_closed() || p[place].x > 0.0 {
                kept.push(*contact);
                places.push(place);
            }
        }
        self.contacts = kept;
        let p: Vec<Vector3<f64>> = places.iter().map(|&place| p[place]).collect();
        let compliance = Compliance::new(&self.contacts, linked, homes, control);
        let matrix = compliance.map(|compliance| compliance.symmetric);
        let mut r = p.clone();
        if let Some(matrix) = &matrix {
            let free = self.free_velocities(velocities, matrix, &p);
            // Closed at the end of the step: no gap is left.
            let gaps = vec![0.0; p.len()];
            r = self.impulses(matrix, free, &gaps, true, h, p.clone(), law, control);
        }
        let work =
            |contact: &Contact, velocities: &[Vector6<f64>]| contact.velocity(|body| apart(&velocities[body as usize]));
        let before: Vec<Vector3<f64>> = self.contacts.iter().map(|contact| work(contact, velocities)).collect();
        let changes: Vec<Vector3<f64>> = r.iter().zip(&p).map(|(r, p)| r - p).collect();
        respond(&self.contacts, linked, homes, &changes);
        linked.iter().for_each(|linked| linked.add(velocities));
        let mut contacts = all;
        contacts.iter_mut().for_each(|contact| contact.impulse = Vector3::zeros());
        for (k, &place) in places.iter().enumerate() {
            let contact = &mut contacts[place];
            contact.impulse = r[k];
            let mean = contact.velocity(|body| apart(&mean[body as usize]));
            let ends = 0.5 * (before[k] + work(contact, velocities));
            contact.work = p[k].component_mul(&mean) + changes[k].component_mul(&ends);
        }
        self.contacts = contacts;
        matrix.is_some()
    }

    /// The displacements that part overlapping bodies and close the joints, by the least change in the norm of the masses:
    /// velocities over a unit of time.
    pub fn displace(&mut self, mechanism: &Mechanism<'_>, law: &mut Law, control: &Control) {
        if !self.has_joints() {
            self.solve(1.0, mechanism, law, control);
            return;
        }
        let (mut linked, homes) = self.linked(mechanism);
        let Some(mut velocities) = self.obeying(&mut linked, true) else { return };
        if !self.contacts.is_empty() {
            let Some(compliance) = Compliance::new(&self.contacts, &mut linked, &homes, control) else {
                return;
            };
            let matrix = compliance.symmetric;
            let none = vec![Vector3::zeros(); self.contacts.len()];
            let free = self.free_velocities(&velocities, &matrix, &none);
            let gaps: Vec<f64> = self.contacts.iter().map(|contact| contact.gap).collect();
            let impulses = self.impulses(&matrix, free, &gaps, false, 1.0, none, law, control);
            respond(&self.contacts, &mut linked, &homes, &impulses);
            linked.iter().for_each(|linked| linked.add(&mut velocities));
        }
        self.take(&velocities);
    }

    /// Takes out of the velocities what the joints do not let be, by impulses of theirs alone.
    pub fn obey_joints(&mut self, mechanism: &Mechanism<'_>) {
        let (mut linked, _) = self.linked(mechanism);
        if let Some(velocities) = self.obeying(&mut linked, false) {
            self.take(&velocities);
        }
    }

    fn take(&mut self, velocities: &[Vector6<f64>]) {
        for (motion, velocities) in self.moving.iter_mut().zip(velocities) {
            (motion.velocity, motion.omega) = apart(velocities);
        }
    }

    fn obeying(&mut self, linked: &mut [Linked<'_>], closes: bool) -> Option<Vec<Vector6<f64>>> {
        let frames: Vec<Frame> = self.moving.iter().map(|motion| Frame::of(&motion.pose)).collect();
        let mut velocities: Vec<Vector6<f64>> = self.moving.iter().map(twist).collect();
        for linked in linked {
            if !linked.hold(&frames, &self.moving) {
                self.unsolved = Some(Unsolved::Joints);
                return None;
            }
            linked.project(&frames, &mut velocities, closes);
        }
        Some(velocities)
    }
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
    let is_over = change <= CONVERGED || change >= 0.5 * *last && change <= STAGNANT;
    *last = change;
    is_over
}

/// The velocities at the end as joints let them be, and the energy that this takes; the linkages hold their bodies there.
fn end(midpoint: &Midpoint, linked: &mut [Linked<'_>]) -> Option<(Vec<Vector6<f64>>, f64)> {
    let moved = midpoint.moved_bodies();
    let mut velocities = midpoint.end_velocities();
    let energy = midpoint.kinetic_energy_at_end(&velocities);
    for linked in linked {
        if !linked.hold(&midpoint.ends, &moved) {
            return None;
        }
        linked.project(&midpoint.ends, &mut velocities, false);
    }
    let lost = energy - midpoint.kinetic_energy_at_end(&velocities);
    Some((velocities, lost))
}

/// Solves for the changes of velocities by these impulses of contacts.
fn respond(contacts: &[Contact], linked: &mut [Linked<'_>], homes: &[Home], impulses: &[Vector3<f64>]) {
    linked.iter_mut().for_each(|linked| linked.x.fill(Vector6::zeros()));
    for (contact, impulse) in contacts.iter().zip(impulses) {
        for side in [0, 1] {
            let Some(body) = contact.bodies[side] else { continue };
            let (home, place) = homes[body as usize];
            let (impulse, angular) = contact.wrench(side, impulse);
            linked[home].x[place] += join(&impulse, &angular);
        }
    }
    linked.iter_mut().for_each(Linked::respond);
}

/// `J A^-1 J^T` with the factors that the linkages have, and its symmetric part: `A` is symmetric but for rotations within a
/// step.
struct Compliance {
    whole: BlockMatrix,
    symmetric: BlockMatrix,
}

impl Compliance {
    /// That of these contacts; nothing if `control` asks to stop.
    fn new(contacts: &[Contact], linked: &mut [Linked<'_>], homes: &[Home], control: &Control) -> Option<Self> {
        let mut touching = vec![Vec::new(); linked.len()];
        for (k, contact) in contacts.iter().enumerate() {
            for body in contact.bodies.iter().flatten() {
                let of: &mut Vec<usize> = &mut touching[homes[*body as usize].0];
                if of.last() != Some(&k) {
                    of.push(k);
                }
            }
        }
        let mut blocks = Vec::new();
        for (k, contact) in contacts.iter().enumerate() {
            control.go_on().ok()?;
            let mut near: Vec<usize> = contact.bodies.iter().flatten().map(|body| homes[*body as usize].0).collect();
            near.dedup();
            let mut others: Vec<usize> = near.iter().flat_map(|&home| touching[home].iter().copied()).collect();
            others.sort_unstable();
            others.dedup();
            let mut columns = vec![Matrix3::zeros(); others.len()];
            for axis in 0..3 {
                near.iter().for_each(|&home| linked[home].x.fill(Vector6::zeros()));
                for side in [0, 1] {
                    let Some(body) = contact.bodies[side] else { continue };
                    let (home, place) = homes[body as usize];
                    let (impulse, angular) = contact.wrench(side, &Vector3::ith(axis, 1.0));
                    linked[home].x[place] += join(&impulse, &angular);
                }
                near.iter().for_each(|&home| linked[home].respond());
                for (other, block) in others.iter().zip(&mut columns) {
                    let of = |body: u32| {
                        let (home, place) = homes[body as usize];
                        if near.contains(&home) { apart(&linked[home].x[place]) } else { Default::default() }
                    };
                    block.set_column(axis, &contacts[*other].velocity(of));
                }
            }
            for (&other, block) in others.iter().zip(columns) {
                blocks.push((other, k, block));
            }
        }
        let whole = BlockMatrix::from_blocks(contacts.len(), blocks.iter().copied())?;
        let both = blocks.iter().flat_map(|(i, j, block)| [(*i, *j, block * 0.5), (*j, *i, block.transpose() * 0.5)]);
        Some(Self { whole, symmetric: BlockMatrix::from_blocks(contacts.len(), both)? })
    }
}
