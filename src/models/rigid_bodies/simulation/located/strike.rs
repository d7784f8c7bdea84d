//! Impacts at one instant: the impact law for all closed contacts together, with velocities that jump.

use super::super::super::contact::Contact;
use super::super::super::scene::Law;
use super::super::super::touches::Touched;
use super::super::{MoreauStepping, StepFailure};
use super::Located;
use nalgebra::Vector3;
use problem::{Control, EventKind};

impl MoreauStepping<'_> {
    /// Applies the impact law at the current time if an open contact closes, and determines the sustained contacts of
    /// the next smooth arc.
    pub(super) fn strike(&mut self, located: &mut Located, control: &Control) -> Result<(), StepFailure> {
        self.ground_at(located, self.t);
        self.detect(0.0, control)?;
        self.retain_closed(located);
        let (mut striking, mut fastest) = (Vec::new(), 0.0_f64);
        let mut noise = Vec::with_capacity(self.contacts.len());
        let mut told = Vec::new();
        for k in 0..self.contacts.len() {
            let contact = &self.contacts[k];
            let (approach, is_known) = (-contact.before.x, located.lasting.contains(&contact.key));
            let least = self.least_approach(located, contact);
            noise.push(self.rounding(located, contact));
            let contact = &mut self.contacts[k];
            contact.gap = 0.0;
            if is_known || approach <= noise[k] {
                // The approach velocity of a sustained contact is an integration error of the last smooth arc: set it
                // to zero.
                contact.before.x = contact.before.x.max(0.0);
                continue;
            }
            fastest = fastest.max(noise[k]);
            striking.push(contact.key);
            if approach <= least {
                contact.law.restitution = 0.0;
            } else {
                told.push(k);
            }
        }
        let before: Vec<Vector3<f64>> = self.contacts.iter().map(|contact| self.velocity_of(contact)).collect();
        let strikes = !striking.is_empty();
        if strikes {
            let moving = located.impacts.is_some().then(|| self.moving.clone());
            self.hit(located, &told, control)?;
            if let (Some(impacts), Some(moving)) = (&mut located.impacts, moving) {
                self.record_struck(&striking, &moving, impacts);
            }
            let struck = self.contacts.iter().filter(|contact| contact.impulse.x > 0.0);
            struck.flat_map(|contact| contact.bodies).flatten().for_each(|body| located.touched[body as usize] = true);
            // A sustained contact whose relative velocity the impact has changed is not known to stick.
            for (contact, before) in self.contacts.iter().zip(&before) {
                if (self.velocity_of(contact) - before).norm() > self.rounding(located, contact) {
                    located.sticking.remove(&contact.key);
                }
            }
        }
        let lasts = |contact: &Contact, noise: f64| {
            if !strikes && (located.lasting.contains(&contact.key) || located.leaving.contains(&contact.key)) {
                return !located.leaving.contains(&contact.key);
            }
            self.velocity_of(contact).x <= noise.max(fastest)
        };
        let mut lasting: Vec<Contact> = self.contacts.clone();
        let mut noise = noise.into_iter();
        lasting.retain(|contact| noise.next().is_some_and(|noise| lasts(contact, noise)));
        located.leaving.clear();
        located.lasting.clear();
        located.lasting.extend(lasting.iter().map(|contact| contact.key));
        self.tell(located, lasting);
        Ok(())
    }

    /// Keeps the contacts that are closed: sustained contacts, and contacts with zero gap. If a contact with zero gap
    /// strikes, other gaps that are not larger than their error are treated as zero, too. The gaps of closed contacts
    /// are errors of the last smooth arc, and the gap of the last foot of a face is a combination of the gaps of its
    /// other feet: the error of a gap is the sum of the gaps of the closed contacts on a body. All feet of a face
    /// that lands from one of its edges therefore strike at once, in whatever order their errors bring them.
    fn retain_closed(&mut self, located: &Located) {
        let lasts = |contact: &Contact| located.lasting.contains(&contact.key);
        let strikes = |contact: &Contact| !lasts(contact) && -contact.before.x > self.rounding(located, contact);
        let of_moving = |contact: &Contact| contact.bodies.into_iter().flatten().map(|body| body as usize);
        let mut closed: Vec<bool> =
            self.contacts.iter().map(|contact| lasts(contact) || contact.gap <= contact.no_gap).collect();
        let mut is_struck = self.contacts.iter().zip(&closed).any(|(contact, closed)| *closed && strikes(contact));
        let mut errors = vec![0.0; self.moving.len()];
        while is_struck {
            errors.fill(0.0);
            for (contact, _) in self.contacts.iter().zip(&closed).filter(|(_, closed)| **closed) {
                of_moving(contact).for_each(|body| errors[body] += contact.gap.abs());
            }
            is_struck = false;
            for (contact, closed) in self.contacts.iter().zip(&mut closed).filter(|(_, closed)| !**closed) {
                *closed = contact.gap <= contact.no_gap + of_moving(contact).map(|body| errors[body]).sum::<f64>();
                is_struck |= *closed;
            }
        }
        let mut closed = closed.into_iter();
        self.contacts.retain(|_| closed.next().unwrap_or(false));
    }

    /// Solves the impact law for the closed contacts, and changes the velocities of the bodies; `told` are the indices
    /// of the contacts whose impacts are reported as events.
    fn hit(&mut self, located: &Located, told: &[usize], control: &Control) -> Result<(), StepFailure> {
        self.group();
        let (t, h) = (self.t, located.step);
        // The contact law evaluates coefficients of friction at the end of its step: shift the time so that this step
        // ends at the time of the impact.
        self.t -= h;
        self.partition_into_islands();
        self.t = t;
        let solved = self.solve_each(|island, mechanism, law| island.solve(h, mechanism, law, control));
        control.go_on()?;
        solved?;
        self.check_law()?;
        let mut struck = self.contacts.iter().filter(|contact| contact.impulse.x > 0.0).peekable();
        if !self.report.is_limited && struck.peek().is_some() {
            let (mut is_elastic, mut work) = (true, 0.0);
            for contact in struck {
                is_elastic &= contact.law.restitution == 1.0;
                work += contact.work.x;
            }
            self.report.elastic_work += if is_elastic { work } else { 0.0 };
        }
        for contact in told.iter().map(|&k| &self.contacts[k]).filter(|contact| contact.impulse.x > 0.0) {
            let event = (EventKind::Impact, [contact.key.0 as usize, contact.key.1 as usize], Some(self.t));
            if !self.new_events.contains(&event) {
                self.new_events.push(event);
            }
        }
        self.book();
        Ok(())
    }

    /// Reports the events of sustained contacts: that they begin to slip, stick, or open.
    fn tell(&mut self, located: &Located, mut lasting: Vec<Contact>) {
        for contact in &mut lasting {
            // The detection of events requires a positive normal impulse of a closed contact; its size does not matter.
            contact.impulse = Vector3::x();
            if located.sticking.contains(&contact.key) {
                contact.law = Law { friction: 0.0, varying: None, ..contact.law };
            }
        }
        let (mut touches, mut events) = (std::mem::take(&mut self.touches), Vec::new());
        let touched = |contact| Touched { contact, was_struck: true, is_closed: true };
        let fall = located.step * self.scene.gravity.norm();
        touches.follow(lasting.iter().map(touched), &self.moving, fall, &mut events);
        self.touches = touches;
        let (before, opened) = &located.opened;
        let has_opened = |[a, b]: [usize; 2]| opened.contains(&(a as u32, b as u32));
        self.new_events.extend(events.into_iter().map(|(kind, pair, _)| {
            let t = if kind == EventKind::LiftOff && has_opened(pair) { *before } else { self.t };
            (kind, pair, Some(t))
        }));
    }

    /// Adds the impulses of the contacts in an impact, and their work, to the report of the step and to the contact
    /// forces.
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
