//! The memory that the contacts of a scene take, told while they are found and before anything of them is assembled. Two
//! contacts on one body are coupled, and so are all in an island that touch bodies with joints: a body that much else
//! touches makes a matrix of the square of that.
//!
//! Islands are sets of bodies that grow together as contacts are found (Tarjan 1975); they are solved one after the other,
//! the largest side by side.

use super::contact::Contact;
use super::joint::Joint;
use super::linkage::Linkage;
use super::motion::Motion;
use super::scene::MultibodySystem;
use contact::islands::threads;
use contact::law::{Cone, Size};
use nalgebra::{Matrix3, Vector6};

/// Bytes of a contact beside those that the law takes: among all, in its island, and in what is remembered of it.
const OF_CONTACT: usize = 4 * size_of::<Contact>();
/// Bytes of a pair of bodies that are near.
const OF_PAIR: usize = size_of::<(u32, u32)>();
/// Bytes of a body that joints hold, and of a joint, beside the matrix: where they were, are and come to be, and what is
/// kept to come back to.
const OF_HELD_BODY: usize = 8 * size_of::<Motion>();
const OF_JOINT: usize = 24 * size_of::<Vector6<f64>>();
/// Bytes of what couples two contacts on bodies that joints bring together, beside what the law takes: the compliance as it is
/// assembled, whole and symmetric, with both halves of that.
const OF_COUPLING: usize = 2 * size_of::<(usize, Matrix3<f64>)>();

/// What is known of the contacts so far.
#[derive(Clone, Debug, Default)]
pub struct Load {
    /// Pairs of bodies that are near.
    pub pairs: usize,
    /// Contacts between them.
    pub contacts: usize,
    friction: Option<Cone>,
    bodies: Vec<Touched>,
    /// The bytes of the largest islands, by their roots: of as many as are solved at a time.
    largest: Vec<(u32, usize)>,
    at_a_time: usize,
    /// A body of each linkage, and the bytes that its equations take.
    linkages: Vec<(usize, usize)>,
}

/// A body, and if it is the root of its island that as well.
#[derive(Clone, Copy, Debug)]
struct Touched {
    parent: u32,
    /// Its contacts.
    contacts: u32,
    has_joints: bool,
    island: Island,
}

#[derive(Clone, Copy, Debug, Default)]
struct Island {
    contacts: usize,
    blocks: usize,
    /// Contacts on bodies with joints.
    joined: usize,
    /// The bytes of linkages.
    linkages: usize,
}

impl Load {
    /// Nothing touches yet.
    pub fn of(scene: &MultibodySystem) -> Self {
        let moving: Vec<usize> = (0..scene.bodies.len()).filter(|&body| !scene.bodies[body].fixed).collect();
        let place = |body: usize| moving.binary_search(&body).ok().map(|place| place as u32);
        let places: Vec<Option<u32>> = (0..scene.bodies.len()).map(place).collect();
        let of = |linkage: &Linkage| {
            let others = OF_HELD_BODY * linkage.bodies.len() + OF_JOINT * linkage.joints.len();
            Some((moving[*linkage.bodies.first()? as usize], linkage.bytes() + others))
        };
        let linkages = Linkage::all(&scene.joints, &places, moving.len()).iter().filter_map(of).collect();
        let mut load = Self { at_a_time: threads(), linkages, ..Self::default() };
        load.begin(scene);
        load
    }

    /// The same, in the memory of what was there before.
    pub fn begin(&mut self, scene: &MultibodySystem) {
        (self.pairs, self.contacts) = (0, 0);
        self.friction = scene.laws.any(|law| law.friction > 0.0).then_some(scene.cone);
        self.largest.clear();
        self.bodies.clear();
        let alone = |parent| Touched { parent, contacts: 0, has_joints: false, island: Island::default() };
        self.bodies.extend((0..scene.bodies.len() as u32).map(alone));
        for Joint { bodies: (a, b), .. } in &scene.joints {
            let moves = |body: &usize| !scene.bodies[*body].fixed;
            let (a, b) = (Some(*a).filter(moves), b.filter(moves));
            self.join(a, b);
            for body in [a, b].into_iter().flatten() {
                self.bodies[body].has_joints = true;
            }
        }
        for k in 0..self.linkages.len() {
            let (body, bytes) = self.linkages[k];
            let root = self.root(body);
            self.bodies[root].island.linkages += bytes;
            self.weigh(root);
        }
    }

    /// Takes in so many contacts between two bodies, of which those are given that move.
    pub fn add(&mut self, [a, b]: [Option<usize>; 2], contacts: usize) {
        if contacts == 0 {
            return;
        }
        let Some(root) = self.join(a, b) else { return };
        self.contacts += contacts;
        let mut joined = false;
        let mut blocks = 0;
        for body in [a, b].into_iter().flatten() {
            let body = &mut self.bodies[body];
            joined |= body.has_joints;
            let before = body.contacts as usize;
            body.contacts += contacts as u32;
            blocks += contacts * (2 * before + contacts);
        }
        let island = &mut self.bodies[root].island;
        island.contacts += contacts;
        island.blocks += blocks;
        island.joined += if joined { contacts } else { 0 };
        self.weigh(root);
    }

    /// The bytes that a step with these contacts takes.
    pub fn bytes(&self) -> usize {
        let islands = self.largest.iter().map(|(_, bytes)| *bytes).fold(0, usize::saturating_add);
        islands.saturating_add(self.pairs * OF_PAIR).saturating_add(self.contacts * OF_CONTACT)
    }

    /// The body with the most contacts, as its place in the scene, and how many it has.
    pub fn most_touched(&self) -> Option<(usize, u32)> {
        let touched = self.bodies.iter().map(|body| body.contacts).enumerate();
        touched.max_by_key(|(body, contacts)| (*contacts, std::cmp::Reverse(*body)))
    }

    /// Makes one island of those of two bodies, and gives its root.
    fn join(&mut self, a: Option<usize>, b: Option<usize>) -> Option<usize> {
        let root = self.root(a.or(b)?);
        let other = self.root(b.or(a)?);
        let (root, other) = (root.min(other), root.max(other));
        if root != other {
            let island = self.bodies[other].island;
            self.bodies[other].parent = root as u32;
            self.bodies[root].island.take(&island);
            self.largest.retain(|(known, _)| *known != other as u32);
        }
        Some(root)
    }

    fn root(&mut self, mut body: usize) -> usize {
        while self.bodies[body].parent as usize != body {
            let above = self.bodies[body].parent as usize;
            self.bodies[body].parent = self.bodies[above].parent;
            body = above;
        }
        body
    }

    /// Keeps the largest islands up to date.
    fn weigh(&mut self, root: usize) {
        let bytes = self.bodies[root].island.bytes(self.friction);
        let island = (root as u32, bytes);
        if let Some(known) = self.largest.iter_mut().find(|(known, _)| *known == island.0) {
            *known = island;
        } else if self.largest.len() < self.at_a_time {
            self.largest.push(island);
        } else if let Some(least) = self.largest.iter_mut().min_by_key(|(_, bytes)| *bytes)
            && least.1 < bytes
        {
            *least = island;
        }
    }
}

impl Island {
    fn take(&mut self, other: &Self) {
        self.contacts += other.contacts;
        self.blocks += other.blocks;
        self.joined += other.joined;
        self.linkages += other.linkages;
    }

    fn bytes(&self, friction: Option<Cone>) -> usize {
        // Beside the blocks of bodies those of all contacts that joints bring together.
        let coupled = self.joined.saturating_mul(self.joined);
        let size = Size { contacts: self.contacts, blocks: self.blocks.saturating_add(coupled), friction };
        size.bytes().saturating_add(coupled.saturating_mul(OF_COUPLING)).saturating_add(self.linkages)
    }
}
