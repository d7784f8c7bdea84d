//! Impacts at one time: the law of impact for all closed contacts together, with velocities that jump.

use super::super::super::contact::Contact;
use super::super::super::touches::rounding;
use super::super::{MoreauStepping, StepFailure};
use super::Located;
use nalgebra::Vector3;
use problem::{Control, EventKind};

impl MoreauStepping<'_> {
    /// Applies the law of impact at the current time if a contact closes, and finds the contacts that last from here on.
    pub(super) fn strike(&mut self, located: &mut Located, control: &Control) -> Result<(), StepFailure> {
        self.ground_at(located, self.t);
        self.detect(0.0, control)?;
        self.contacts.retain(|contact| located.lasting.contains(&contact.key) || contact.gap <= contact.no_gap);
        let mut strikes = false;
        for k in 0..self.contacts.len() {
            let contact = &self.contacts[k];
            let approach = -contact.before.x;
            let lasts = located.lasting.contains(&contact.key);
            let is_at_rest = approach <= rounding(contact, &self.moving);
            let accumulates = contact.law.restitution < 1.0 && approach <= self.fall(located, contact);
            let contact = &mut self.contacts[k];
            contact.gap = 0.0;
            if lasts || is_at_rest {
                // A contact that lasts has no velocity but by errors of the last arc.
                contact.before.x = contact.before.x.max(0.0);
                continue;
            }
            strikes = true;
            if accumulates {
                contact.law.restitution = 0.0;
            }
        }
        if strikes {
            self.hit(located, control)?;
        }
        let after = |contact: &Contact| {
            contact.velocity(|body| (self.moving[body as usize].velocity, self.moving[body as usize].omega)).x
        };
        let lasts = |contact: &&Contact| after(contact) <= rounding(contact, &self.moving);
        let lasting: Vec<_> = self.contacts.iter().filter(lasts).map(|contact| contact.key).collect();
        located.lasting.clear();
        located.lasting.extend(lasting);
        Ok(())
    }

    /// Solves the law of impact for the contacts, and changes the velocities.
    fn hit(&mut self, located: &Located, control: &Control) -> Result<(), StepFailure> {
        self.group();
        let (t, h) = (self.t, located.step);
        // The law takes coefficients at the end of its step, which has no length here.
        self.t -= h;
        self.partition_into_islands();
        self.t = t;
        let solved = self.solve_each(|island, mechanism, law| island.solve(h, mechanism, law, control));
        control.go_on()?;
        solved?;
        self.check_law()?;
        let mut is_elastic = !self.report.is_limited;
        let mut work = 0.0;
        for k in 0..self.contacts.len() {
            let contact = &self.contacts[k];
            if contact.impulse.x <= 0.0 {
                continue;
            }
            is_elastic &= contact.law.restitution == 1.0;
            work += contact.work.x;
            let approach = -contact.before.x;
            if approach > self.fall(located, contact) || contact.law.restitution == 1.0 && approach > 0.0 {
                let pair = [contact.key.0 as usize, contact.key.1 as usize];
                let told = (EventKind::Impact, pair, Some(self.t));
                if !self.new_events.contains(&told) {
                    self.new_events.push(told);
                }
            }
        }
        if is_elastic {
            self.report.elastic_work += work;
        }
        self.book();
        self.contacts.iter_mut().for_each(|contact| contact.impulse = Vector3::zeros());
        Ok(())
    }

    /// Adds the impulses of the contacts, and their work, to the report and to the contact forces.
    pub(super) fn book(&mut self) {
        let report = &mut self.report;
        for contact in self.contacts.iter().filter(|contact| contact.impulse.x > 0.0) {
            report.normal_impulse += contact.impulse.x;
            report.work[0] += contact.work.x;
            report.work[1] += contact.work.y + contact.work.z;
            report.done.drives -= contact.impulse.dot(&contact.surface);
        }
        self.add_contact_forces();
    }
}
