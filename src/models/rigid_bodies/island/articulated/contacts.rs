//! Time steps of an island with joints and closed contacts.

use super::super::super::contact::{Contact, mark_torques};
use super::super::super::linkage::Linked;
use super::super::super::midpoint::{CONVERGED, apart};
use super::super::{Island, Mechanism};
use super::compliance::{Compliance, respond};
use super::restoration::restore;
use super::{
    Ended, Guess, Home, ITERATIONS, Kept, LOSS, LOSS_IN_IMPACTS, ROOM, STAGNANT, STIFF, end, iterate, stiffness,
};
use contact::law::{Delassus, Law};
use nalgebra::{Vector3, Vector6};
use problem::Control;
use vi::Outcome;
use vi::coulomb::BlockMatrix;

impl Island {
    /// Makes a step of the island with the contacts marked in `closing`; repeats it with further contacts that close.
    /// Returns whether the step was solved.
    #[expect(clippy::too_many_arguments, reason = "the parts of an island")]
    pub(super) fn step_with_contacts(
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
        let kept = Kept::of(self, linked);
        let is_solved = loop {
            // If the attempt fails, a step of this length is not tried again with contacts.
            self.parts.pushed = 0.5 * h;
            self.contacts =
                all.iter().zip(&closing).filter(|(_, closes)| **closes).map(|(contact, _)| *contact).collect();
            if !self.advance(linked, homes, h, mechanism, law, control) || control.go_on().is_err() {
                break false;
            }
            let mut solved = std::mem::take(&mut self.contacts).into_iter();
            let of = |body: u32| apart(&(kept.moving[body as usize].way_to(&self.moving[body as usize]) / h));
            let mut is_closed = true;
            for (contact, closes) in all.iter_mut().zip(&mut closing) {
                if *closes {
                    solved.next().into_iter().for_each(|solved| *contact = solved);
                } else {
                    contact.foresee(h, of);
                    (contact.impulse, contact.work) = Default::default();
                    *closes = contact.stays_closed();
                    is_closed &= !*closes;
                }
            }
            mark_torques(&all, &mut closing);
            if is_closed {
                break true;
            }
            kept.restore(self, linked);
        };
        self.contacts = all;
        is_solved
    }

    /// Makes a step of the island with all contacts in `self.contacts`; returns false if the step is too long.
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
        let course = mechanism.signals.over(self.t, h);
        let t = self.t;
        let ground = |k: u32| mechanism.grounding(k, t, h);
        linked.iter_mut().for_each(|linked| linked.begin(&midpoint.starts, &course, ground));
        if let Some(guess) = self.guess.take() {
            midpoint.mean = guess.mean;
            midpoint.arrive();
            linked.iter_mut().zip(&guess.impulses).for_each(|(linked, impulses)| linked.guess(impulses));
        }
        let gaps: Vec<f64> = self.contacts.iter().map(|contact| contact.gap).collect();
        let mut p: Vec<Vector3<f64>> = self.contacts.iter().map(|contact| contact.impulse).collect();
        let mut last = f64::INFINITY;
        for iteration in 0.. {
            let mut is_solved = false;
            self.newton += 1;
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
        let Some(Ended { mut velocities, lost: of_linkages, driven }) = end(&midpoint, linked) else { return false };
        let lost: f64 = of_linkages.iter().sum();
        let energy = 0.5 * midpoint.weigh(&midpoint.end_velocities());
        // The torque of a contact patch is nonzero only if the force of the patch is.
        let is_pushed = p.iter().zip(&self.contacts).any(|(p, contact)| !contact.is_torque() && p.x > 0.0);
        let most = if is_pushed { LOSS_IN_IMPACTS } else { LOSS };
        let largest = self.largest_energy.max(energy).max(0.5 * midpoint.size());
        let is_judged = mechanism.exceeded.is_none();
        if is_judged && (lost > most * largest || stiffness(&midpoint, linked, &velocities) > STIFF * largest) {
            return false;
        }
        self.parts.pushed = if lost * ROOM <= most * largest { 2.0 * h } else { h };
        if is_pushed {
            let moved = midpoint.moved_bodies();
            for (linked, lost) in linked.iter().zip(&of_linkages) {
                restore(linked, &moved, &mut velocities, *lost);
            }
        }
        self.judge_positions(&midpoint.mean, h);
        let positions = self.report;
        let are_replaced = self.replace_impulses(linked, homes, &midpoint.mean, &mut velocities, &p, h, law, control);
        self.report = self.report.zip(positions).map(|(velocities, positions)| velocities.beside(&positions));
        if are_replaced {
            self.done.drives += driven + linked.iter_mut().map(Linked::correct).sum::<f64>();
            self.arrive(&midpoint, linked, &velocities, energy, mechanism);
            if is_pushed {
                // Contact impulses have made the velocities jump, so that accelerations over the step are no guess for
                // the next step.
                self.accelerations.fill(None);
            }
            self.guess = Some(Guess::of(midpoint, linked));
        }
        are_replaced
    }

    /// Solves the contact law for a nonsymmetric compliance, starting from the impulses `p`, which have led to
    /// `velocities`. The contact law is solved with the symmetric part of the compliance; the skew part is treated by
    /// fixed-point iteration.
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
            let impulses = self.impulses(
                Delassus::Blocks(&compliance.symmetric),
                free,
                gaps,
                false,
                h,
                next.clone(),
                law,
                control,
            );
            if self.report.is_some_and(|report| report.outcome != Outcome::Solved) {
                return None;
            }
            // Test convergence by velocity changes instead of impulses, since the impulses of redundant contacts are
            // not unique.
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

    /// Returns the relative velocities at the contacts without the effect of the given contact impulses.
    pub(super) fn free_velocities(
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

    /// Replaces the contact impulses `p` of the position stage by those of the impact law, for contacts that are closed
    /// at the end of the step or have an impulse. Returns false on interruption.
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
        // Leave out of the impact law the contacts that are open and have no impulse.
        let all = std::mem::take(&mut self.contacts);
        let (mut kept, mut places): (Vec<Contact>, Vec<usize>) = (Vec::new(), Vec::new());
        for (place, contact) in all.iter().enumerate() {
            let is_kept = if contact.is_torque() {
                places.last() == Some(&(place - 1))
            } else {
                contact.stays_closed() || p[place].x > 0.0
            };
            if is_kept {
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
            // The contacts in the impact law are closed at the end of the step, so that their gaps are zero.
            let gaps = vec![0.0; p.len()];
            r = self.impulses(Delassus::Blocks(matrix), free, &gaps, true, h, p.clone(), law, control);
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
}
