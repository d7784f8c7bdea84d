//! The compliance of an island with joints: the response of the velocities of its bodies to contact impulses.

use super::super::super::contact::Contact;
use super::super::super::linkage::Linked;
use super::super::super::midpoint::{apart, join};
use super::Home;
use nalgebra::{Matrix3, Vector3, Vector6};
use problem::Control;
use vi::coulomb::BlockMatrix;

/// Solves for the velocity changes of bodies with joints caused by contact impulses; the result is stored in the field
/// `x` of the linkages.
pub(super) fn respond(contacts: &[Contact], linked: &mut [Linked<'_>], homes: &[Home], impulses: &[Vector3<f64>]) {
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

/// The compliance (Delassus operator) `J A^-1 J^T` of the contacts of an island with joints, with the factorised
/// matrices `A` of the linkages, and its symmetric part. `A` is symmetric except for rotations within a step.
pub(super) struct Compliance {
    pub whole: BlockMatrix,
    pub symmetric: BlockMatrix,
}

impl Compliance {
    /// Assembles the compliance (Delassus operator) of the given contacts; `None` if `control` asks to stop.
    pub fn new(contacts: &[Contact], linked: &mut [Linked<'_>], homes: &[Home], control: &Control) -> Option<Self> {
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
                    block.set_column(axis, &contacts[*other].change(of));
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
