//! Partition of a multibody system into islands: the data of each island are copied from the system, solved
//! independently, and copied back.

use super::super::contact::Contact;
use super::super::island::{Island, Mechanism, Unsolved};
use super::super::joint::Joint;
use super::MoreauStepping;
use contact::islands::solve_apart;
use contact::law::Law;

/// The number of contacts outside the largest island from which on islands are solved in several threads.
const WORTH_A_THREAD: usize = 200;

impl MoreauStepping<'_> {
    /// Calls `solve` on every island, with a solver of the contact law, and copies the results back to the multibody
    /// system.
    pub(super) fn solve_each(
        &mut self,
        solve: impl Fn(&mut Island, &Mechanism<'_>, &mut Law) + Sync,
    ) -> Result<(), Unsolved> {
        let (mechanism, tasks) = (&self.mechanism, &mut self.tasks[..self.islands.len()]);
        let weight = |island: &Island| island.contacts.len() + 2 * island.joints.len();
        solve_apart(tasks, &mut self.laws, weight, WORTH_A_THREAD, |island, law| solve(island, mechanism, law));
        self.report.islands = tasks.len();
        if let Some(unsolved) = tasks.iter().find_map(|island| island.unsolved) {
            return Err(unsolved);
        }
        for island in tasks {
            if let Some(law) = &island.report {
                self.report.take(law);
            }
            for (&body, motion) in island.bodies.iter().zip(&island.moving) {
                self.moving[body as usize] = *motion;
            }
            for (&source, contact) in island.sources.iter().zip(&island.contacts) {
                self.contacts[source as usize] = Contact { bodies: self.contacts[source as usize].bodies, ..*contact };
            }
            for (&linkage, carried) in island.linkages.iter().zip(&mut island.carried) {
                self.carried[linkage as usize] = std::mem::take(carried);
            }
            self.report.done += island.done;
            self.report.newton += island.newton;
        }
        self.keep_rubbing();
        Ok(())
    }

    /// Groups contacts, joints and motion-dependent forces into islands of coupled bodies, and marks the bodies of
    /// implicit islands in `jointed`.
    pub(super) fn group(&mut self) {
        let (contacts, joints, places) = (&self.contacts, &self.scene.joints, &self.places);
        let of_contact = |contact: &Contact| match contact.bodies {
            [Some(a), b] => (a as usize, b.map(|b| b as usize)),
            [None, b] => (b.unwrap_or(0) as usize, None),
        };
        let of_joint = |joint: &Joint| {
            let [a, b] = joint.places(&|body| places[body]);
            (a.unwrap_or(0) as usize, b.map(|b| b as usize))
        };
        let of_action = |&(a, b, _): &(u32, Option<u32>, u32)| (a as usize, b.map(|b| b as usize));
        let links = contacts.iter().map(of_contact).chain(joints.iter().map(of_joint));
        let links = links.chain(self.acting.iter().map(of_action));
        self.islands.group(self.moving.len(), links);
        self.jointed.fill(false);
        for island in (0..self.islands.len()).map(|k| self.islands.links(k)) {
            // The indices in the list of an island are sorted: contacts, then joints, then motion-dependent forces.
            if island.last().is_some_and(|&link| link as usize >= contacts.len()) {
                for &link in island {
                    let link = link as usize;
                    let (a, b) = match (contacts.get(link), joints.get(link.wrapping_sub(contacts.len()))) {
                        (Some(contact), _) => of_contact(contact),
                        (None, Some(joint)) => of_joint(joint),
                        (None, None) => of_action(&self.acting[link - contacts.len() - joints.len()]),
                    };
                    self.jointed[a] = true;
                    b.into_iter().for_each(|b| self.jointed[b] = true);
                }
            }
        }
    }

    /// Copies bodies, contacts, joints and motion-dependent forces of the system to the islands to which they belong.
    pub(super) fn partition_into_islands(&mut self) {
        let (contacts, joints, places) = (&self.contacts, &self.scene.joints, &self.places);
        let (laws, cone, impact_law) = (&self.scene.laws, self.scene.cone, self.impact_law);
        self.tasks.resize_with(self.tasks.len().max(self.islands.len()), || {
            Island::new(cone, impact_law, &laws.coefficients)
        });
        for (k, island) in self.tasks.iter_mut().take(self.islands.len()).enumerate() {
            island.clear();
            island.t = self.t;
            island.is_shortest = self.is_shortest;
            let mut actions = Vec::new();
            for &link in self.islands.links(k) {
                let link = link as usize;
                let bodies = if let Some(contact) = contacts.get(link) {
                    island.contacts.push(*contact);
                    island.sources.push(link as u32);
                    contact.bodies
                } else if let Some(joint) = joints.get(link - contacts.len()) {
                    let place = link - contacts.len();
                    island.joints.push(place as u32);
                    island.linkages.push(self.mechanism.of_joint[place]);
                    joint.places(&|body| places[body])
                } else {
                    let (a, b, action) = self.acting[link - contacts.len() - joints.len()];
                    actions.push(action);
                    [Some(a), b]
                };
                island.bodies.extend(bodies.into_iter().flatten());
            }
            island.linkages.sort_unstable();
            island.linkages.dedup();
            for &linkage in &island.linkages {
                let carried = &self.carried[linkage as usize];
                island.largest_energy = island.largest_energy.max(carried.largest_energy);
                island.parts = island.parts.shortest(carried.parts);
                island.carried.push(carried.clone());
            }
            island.bodies.sort_unstable();
            island.bodies.dedup();
            actions.dedup();
            for action in actions {
                let action = &self.scene.actions[action as usize];
                let place =
                    |&(body, _): &(usize, _)| places[body].and_then(|body| island.bodies.binary_search(&body).ok());
                let of = action.bodies.iter().filter_map(place).map(|place| place as u32).collect();
                island.actions.push((action.clone(), of));
            }
            island.moving.extend(island.bodies.iter().map(|&body| self.moving[body as usize]));
            for contact in &mut island.contacts {
                contact.bodies = contact.bodies.map(|body| {
                    body.and_then(|body| island.bodies.binary_search(&body).ok()).map(|place| place as u32)
                });
            }
        }
    }
}
