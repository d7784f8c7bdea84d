//! Frictional contacts whose coefficient of friction varies: their positions in a step, and the effect of their
//! friction on the bodies.

use super::super::collision::contacts;
use super::super::contact::Contact;
use super::MoreauStepping;
use super::detection::NEAR;
use nalgebra::Vector3;
use std::f64::consts::FRAC_1_SQRT_2;
use vi::coulomb::{Role, mean_speed};

/// Slip velocity of a contact, relative to the velocities in a step, below which the contact counts as sticking.
const STICKS: f64 = 1e-6;

/// The length of the last stage of a smooth arc in event-driven steps, as a fraction of the arc. Contacts store the
/// impulses of the last stage; the first stage has the same length, and the remaining weight.
const LAST_STAGE: f64 = 1.0 - FRAC_1_SQRT_2;

/// A closed contact whose coefficient of friction depends on time, on its position or on the slip speed.
#[derive(Clone, Debug)]
pub struct Rubbing {
    /// The index of the contact's coefficient of friction among those that vary.
    pub coefficient: usize,
    /// The fraction of the step at which the contact closes; it is closed from then on.
    pub begin: f64,
    /// Whether an impact may have closed the contact at the fraction `begin` of the step.
    pub is_struck: bool,
    /// The positions of the contact when it closes and at the end of the step.
    pub places: [Vector3<f64>; 2],
    /// The slip speed of the contact at the end of the step.
    pub slip_speed: f64,
    /// The friction impulse of the contact relative to its normal impulse; for a sticking contact, the mean over the
    /// sticking contacts of its pair of bodies, since the distribution of friction among them is not unique.
    pub used: f64,
    /// Whether the contact sticks at the end of the step.
    pub is_stuck: bool,
    /// The fractions of the step at which an event-driven step evaluates the contact's coefficient of friction, with
    /// their weights; `None` for time stepping.
    pub stages: Option<[(f64, f64); 2]>,
    /// For each moving body of the contact, its index and the derivatives of its velocity and angular velocity with
    /// respect to the coefficient of friction.
    pub pushes: Vec<(usize, Vector3<f64>, Vector3<f64>)>,
}

impl MoreauStepping<'_> {
    /// Stores a copy of the contacts that have an impulse in the last solve of the contact law, and of the torques of
    /// contact patches, if coefficients of friction vary.
    pub(super) fn keep_rubbing(&mut self) {
        if !self.scene.laws.coefficients.is_empty() {
            self.rubbing.clear();
            self.rubbing.extend(self.contacts.iter().filter(|contact| contact.impulse.x > 0.0 || contact.is_torque()));
        }
    }

    /// Returns the contacts with varying coefficients of friction in the last step, of length `h`; if the step was made
    /// in parts or in smooth arcs, the contacts of the last part or arc, as if it were the whole step.
    pub fn rubbing(&self, h: f64) -> Vec<Rubbing> {
        let is_located = self.located.is_some() && !self.is_passed();
        let of_pair = |contact: &Contact| {
            let is_same = |other: &&Contact| {
                (other.key.0, other.key.1) == (contact.key.0, contact.key.1)
                    && !other.is_torque()
                    && self.sticks(other, h)
            };
            let sums = self.rubbing.iter().filter(is_same).map(|other| (friction(other), other.impulse.x));
            let (tangential, normal) = sums.fold((0.0, 0.0), |(a, b), (r, n)| (a + r, b + n));
            tangential / normal
        };
        let rubs = |k: usize| {
            let contact = &self.rubbing[k];
            let coefficient = contact.law.varying.filter(|_| !contact.is_torque())? as usize;
            let u = self.slip(contact);
            let mut slip_speed = contact.slip_speed(&u);
            let torque = self.rubbing.get(k + 1).filter(|next| next.is_torque());
            if let (Role::Force(reach), Some(torque)) = (contact.role, torque) {
                slip_speed = mean_speed(slip_speed, reach.drill * self.slip(torque).x);
            }
            let is_struck = !is_located && contact.strikes();
            let until = if is_struck { contact.closes_after().min(h) } else { 0.0 };
            let velocity = contact.bodies.iter().flatten().map(|&body| self.moving[body as usize].velocity).next();
            let way = velocity.unwrap_or_default() * h;
            let [from, to] = match is_located {
                true => [contact.position - way, contact.position],
                false => [contact.position, self.place_at_end(contact).unwrap_or(contact.position + way)],
            };
            let (slip, own) = (u.y.hypot(u.z), friction(contact) / contact.impulse.x);
            let of_unit = if own > 0.0 {
                Vector3::new(0.0, contact.impulse.y, contact.impulse.z) / own
            } else if slip > 0.0 {
                Vector3::new(0.0, -u.y, -u.z) * (contact.impulse.x / slip)
            } else {
                return None;
            };
            let part = if is_located { LAST_STAGE } else { 1.0 };
            let push = |(side, body): (usize, &Option<u32>)| {
                let body = (*body)? as usize;
                let (mut impulse, mut angular) = contact.wrench(side, &of_unit);
                if let Some(torque) = torque.filter(|_| own > 0.0) {
                    let (other, turns) = torque.wrench(side, &(torque.impulse / own));
                    (impulse, angular) = (impulse + other, angular + turns);
                }
                let motion = &self.moving[body];
                Some((body, impulse / (part * motion.mass), motion.mobility * angular / part))
            };
            let is_stuck = self.sticks(contact, h);
            Some(Rubbing {
                coefficient,
                begin: until / h,
                is_struck,
                places: [from + (to - from) * (until / h), to],
                slip_speed,
                used: if is_stuck { of_pair(contact) } else { own },
                is_stuck,
                stages: is_located.then_some([(LAST_STAGE, 1.0 - LAST_STAGE), (1.0, LAST_STAGE)]),
                pushes: contact.bodies.iter().enumerate().filter_map(push).collect(),
            })
        };
        (0..self.rubbing.len()).filter_map(rubs).collect()
    }

    /// Returns whether a contact sticks at the end of a step of length `h`.
    fn sticks(&self, contact: &Contact, h: f64) -> bool {
        let [before, after] = [contact.before, self.slip(contact)].map(|u| u.y.hypot(u.z));
        after <= STICKS * (before + h * self.scene.gravity.norm())
    }

    /// Returns the relative velocity at a contact at the end of the step.
    fn slip(&self, contact: &Contact) -> Vector3<f64> {
        contact.velocity(|body| (self.ends[body as usize].velocity, self.ends[body as usize].omega))
    }

    /// Returns the position of a contact at the end of the step; `None` if the surfaces have no contact point of its
    /// identity at that time.
    fn place_at_end(&self, contact: &Contact) -> Option<Vector3<f64>> {
        let pair = [contact.key.0 as usize, contact.key.1 as usize];
        let [first, second] = pair.map(|body| (&self.scene.bodies[body].collider, self.pose(body)));
        let mut points = Vec::new();
        contacts(first, second, contact.gap_at_end.abs() + NEAR * contact.size, &mut points);
        points.iter().find(|point| point.id == contact.key.2).map(|point| point.position)
    }

    /// Projects changes of the positions of the moving bodies, or of their velocities, onto those that keep closed
    /// contacts closed: changes along contact normals are removed, and for velocities also the slip of sticking
    /// contacts.
    pub fn restrain(&self, h: f64, is_of_velocities: bool, by: &mut [(Vector3<f64>, Vector3<f64>)]) {
        let rows = |contact: &Contact| if is_of_velocities && self.sticks(contact, h) { 3 } else { 1 };
        let stays = |contact: &&Contact| contact.impulse.x > 0.0 && contact.stays_closed();
        let held = self.rubbing.iter().filter(stays);
        self.hold_back(held.flat_map(|contact| (0..rows(contact)).map(move |axis| (contact, axis, 0.0))), by);
    }
}

/// Returns the magnitude of the friction impulse of a contact.
fn friction(contact: &Contact) -> f64 {
    contact.impulse.y.hypot(contact.impulse.z)
}
