//! Memory estimate for the contacts of a multibody system, updated while contacts are detected and before matrices
//! are assembled. All contacts on the same body are coupled, and so are all contacts of an island on bodies with
//! joints: the matrix size grows as the square of the number of block rows of contacts on a body; a contact on a
//! patch has two block rows. If an island without joints and patches has so many contacts that the matrix is stored
//! in factors, memory grows linearly with their number.
//!
//! Islands are disjoint sets of bodies, merged as contacts are found (union-find, Tarjan 1975). Islands are solved in
//! parallel, one per thread; the estimate assumes that the largest islands are solved at the same time.

use super::contact::Contact;
use super::joint::Joint;
use super::linkage::Linkage;
use super::motion::Motion;
use super::scene::{Law, MultibodySystem};
use contact::islands::threads;
use contact::law::{Cone, Size};
use nalgebra::{Matrix3, Vector6};

/// Memory in bytes per block row of a contact besides that of the contact law: in the list of all contacts, in the
/// island of the contact, and in stored impulses.
const OF_ROW: usize = 4 * size_of::<Contact>();
/// Memory in bytes per pair of bodies whose bounding boxes overlap.
const OF_PAIR: usize = size_of::<(u32, u32)>();
/// Memory in bytes per body with joints besides that of matrices: motions at the beginning and the end of a step, and
/// copies for rejected steps.
const OF_HELD_BODY: usize = 8 * size_of::<Motion>();
/// Memory in bytes per joint besides that of matrices.
const OF_JOINT: usize = 24 * size_of::<Vector6<f64>>();
/// Memory in bytes per pair of contacts coupled through joints, besides that of the contact law: the assembled
/// compliance matrix and its symmetric part.
const OF_COUPLING: usize = 2 * size_of::<(usize, Matrix3<f64>)>();

/// The memory estimate of a time step with the contacts that have been found so far.
#[derive(Clone, Debug, Default)]
pub struct Load {
    /// The number of pairs of bodies whose bounding boxes overlap in the step.
    pub pairs: usize,
    /// The number of contacts found so far in the step.
    pub contacts: usize,
    /// The number of block rows of the contacts found so far: two for a contact on a patch, otherwise one.
    rows: usize,
    friction: Option<Cone>,
    bodies: Vec<Touched>,
    /// The largest islands as `(root, bytes)`, where `root` identifies the island; at most as many as are solved in
    /// parallel (`at_a_time`).
    largest: Vec<(u32, usize)>,
    /// The number of islands that are solved in parallel, so that their matrices are in memory at once.
    at_a_time: usize,
    /// For each linkage, the index of one of its bodies and the memory of its equations in bytes.
    linkages: Vec<(usize, usize)>,
}

/// A body as a node of the union-find forest of islands; the field `island` is valid for roots.
#[derive(Clone, Copy, Debug)]
struct Touched {
    parent: u32,
    /// The number of contacts found so far on the body.
    contacts: u32,
    /// The number of block rows of the contacts found so far on the body.
    rows: u32,
    has_joints: bool,
    island: Island,
}

#[derive(Clone, Copy, Debug, Default)]
struct Island {
    rows: usize,
    blocks: usize,
    /// The number of block rows of the island's contacts on bodies with joints.
    joined: usize,
    /// Whether the island has a contact on a patch.
    has_patches: bool,
    /// The memory of the equations of the island's linkages, in bytes.
    linkages: usize,
}

impl Load {
    /// Returns the memory estimate for a multibody system without contacts.
    pub fn of(scene: &MultibodySystem) -> Self {
        let moving: Vec<usize> = (0..scene.bodies.len()).filter(|&body| !scene.bodies[body].fixed).collect();
        let place = |body: usize| moving.binary_search(&body).ok().map(|place| place as u32);
        let places: Vec<Option<u32>> = (0..scene.bodies.len()).map(place).collect();
        let of = |linkage: &Linkage| {
            let others = OF_HELD_BODY * linkage.bodies.len() + OF_JOINT * linkage.joints.len();
            Some((moving[*linkage.bodies.first()? as usize], linkage.bytes() + others))
        };
        let given = vec![None; scene.bodies.len()];
        let linkages = Linkage::all(&scene.joints, &places, &given, moving.len()).iter().filter_map(of).collect();
        let mut load = Self { at_a_time: threads(), linkages, ..Self::default() };
        load.begin(scene);
        load
    }

    /// Resets the memory estimate to that of a multibody system without contacts, keeping allocations.
    pub fn begin(&mut self, scene: &MultibodySystem) {
        (self.pairs, self.contacts, self.rows) = (0, 0, 0);
        self.friction = scene.laws.any(Law::is_rough).then_some(scene.cone);
        self.largest.clear();
        self.bodies.clear();
        let alone = |parent| Touched { parent, contacts: 0, rows: 0, has_joints: false, island: Island::default() };
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

    /// Adds to the memory estimate `contacts` contacts with one contact law between two bodies; `None` is a body that
    /// does not move.
    pub fn add(&mut self, [a, b]: [Option<usize>; 2], contacts: usize, law: Law) {
        if contacts == 0 {
            return;
        }
        let Some(root) = self.join(a, b) else { return };
        let rows = contacts * law.rows();
        self.contacts += contacts;
        self.rows += rows;
        let mut joined = false;
        let mut blocks = 0;
        for body in [a, b].into_iter().flatten() {
            let body = &mut self.bodies[body];
            joined |= body.has_joints;
            let before = body.rows as usize;
            body.contacts += contacts as u32;
            body.rows += rows as u32;
            blocks += rows * (2 * before + rows);
        }
        let island = &mut self.bodies[root].island;
        island.rows += rows;
        island.blocks += blocks;
        island.has_patches |= law.patch.is_some();
        island.joined += if joined { rows } else { 0 };
        self.weigh(root);
    }

    /// Returns the estimated memory of a step with the contacts found so far, in bytes.
    pub fn bytes(&self) -> usize {
        let islands = self.largest.iter().map(|(_, bytes)| *bytes).fold(0, usize::saturating_add);
        islands.saturating_add(self.pairs * OF_PAIR).saturating_add(self.rows * OF_ROW)
    }

    /// Returns the index of the body with the most contacts, and the number of its contacts.
    pub fn most_touched(&self) -> Option<(usize, u32)> {
        let touched = self.bodies.iter().map(|body| body.contacts).enumerate();
        touched.max_by_key(|(body, contacts)| (*contacts, std::cmp::Reverse(*body)))
    }

    /// Merges the islands of two bodies; returns the root of the merged island.
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

    /// Updates the list of the largest islands by memory with the island of the body `root`.
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
        self.rows += other.rows;
        self.blocks += other.blocks;
        self.joined += other.joined;
        self.has_patches |= other.has_patches;
        self.linkages += other.linkages;
    }

    fn bytes(&self, friction: Option<Cone>) -> usize {
        // Add the blocks of contacts coupled through joints to those of contacts on the same body.
        let coupled = self.joined.saturating_mul(self.joined);
        let blocks = self.blocks.saturating_add(coupled);
        let has_factors = self.joined == 0 && !self.has_patches;
        let size = Size { contacts: self.rows, blocks, has_factors, friction };
        size.bytes().saturating_add(coupled.saturating_mul(OF_COUPLING)).saturating_add(self.linkages)
    }
}
