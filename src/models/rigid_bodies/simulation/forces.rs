//! Outputs of contact forces on bodies and of joint reactions.

use super::super::joint::Joint;
use super::MoreauStepping;

impl MoreauStepping<'_> {
    /// Writes the contact forces of bodies selected for output and the reactions of named joints, in the order of
    /// outputs.
    pub fn forces(&self, out: &mut Vec<f64>) {
        out.clear();
        for (force, torque) in &self.contact_forces {
            out.extend(force.iter().chain(torque));
        }
        for (place, joint) in self.scene.joints.iter().enumerate().filter(|(_, joint)| joint.name.is_some()) {
            let linkage = self.mechanism.of_joint[place] as usize;
            let found = self.mechanism.linkages[linkage].joints.binary_search(&(place as u32)).ok();
            let reaction = found.and_then(|k| self.carried[linkage].reactions.get(k)).copied();
            joint.outputs(&reaction.unwrap_or_default(), out);
        }
    }

    /// Returns, for each output of [`forces`](Self::forces), whether it is a coordinate of a hinge, slider or spring:
    /// coordinates vary within a step, whereas forces are averages over a step.
    pub fn coordinates(&self) -> Vec<bool> {
        let contacts = self.contact_forces.iter().flat_map(|_| [false; 6]);
        contacts.chain(self.scene.joints.iter().flat_map(Joint::are_coordinates)).collect()
    }

    /// Accumulates contact impulses on bodies with contact outputs, over the parts into which a step is divided.
    pub(super) fn add_contact_forces(&mut self) {
        let mut forces = std::mem::take(&mut self.contact_forces);
        let told = (0..self.scene.bodies.len()).filter(|&body| self.scene.bodies[body].tells_contacts);
        for (body, (force, torque)) in told.zip(&mut forces) {
            let centre = self.pose(body).translation.vector;
            for contact in self.contacts.iter().filter(|contact| !contact.is_stop()) {
                for (side, sign) in [(contact.key.0, -1.0), (contact.key.1, 1.0)] {
                    if side as usize == body {
                        let impulse = contact.frame.tr_mul(&contact.impulse) * sign;
                        if contact.is_torque() {
                            *torque += impulse;
                            continue;
                        }
                        *force += impulse;
                        *torque += (contact.position - centre).cross(&impulse);
                    }
                }
            }
        }
        self.contact_forces = forces;
    }
}
