//! A scene: bodies as they are at the start, what holds where they touch, and joints between them.

use super::collision::{BroadPhase, Collider, ContactPoint, contacts};
use super::joint::Joint;
use contact::law::Cone;
use nalgebra::{Isometry3, Matrix3, Vector3};
use problem::Warning;

/// A body. SI units; the pose and the velocity are those of its centre of mass.
#[derive(Clone, Debug)]
pub struct Body {
    /// Its outputs begin with it.
    pub name: String,
    /// Its shape about the centre of mass, or the origin of its frame if it is fixed.
    pub collider: Collider,
    /// The place of its material in the laws.
    pub material: usize,
    /// Whether it never moves.
    pub fixed: bool,
    /// Above zero if it moves.
    pub mass: f64,
    /// About the centre of mass, in its own frame.
    pub inertia: Matrix3<f64>,
    /// The centre of mass in the user's frame.
    pub centre: Vector3<f64>,
    /// From its own frame to the world.
    pub pose: Isometry3<f64>,
    /// Of the centre of mass.
    pub velocity: Vector3<f64>,
    /// In the world.
    pub omega: Vector3<f64>,
}

/// Coefficients of one pair of materials.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Law {
    /// Of Coulomb's law.
    pub friction: f64,
    /// Of Newton's law, from 0 to 1.
    pub restitution: f64,
}

/// The laws of all pairs of materials.
#[derive(Clone, Debug, PartialEq)]
pub struct Laws {
    materials: usize,
    laws: Vec<Law>,
}

impl Laws {
    /// Of two materials the geometric mean of the frictions, so that what is smooth stays smooth, and the lesser
    /// restitution, since the softer one yields.
    pub fn of_materials(single: &[Law]) -> Self {
        let mix = |a: &Law, b: &Law| Law {
            friction: if a == b { a.friction } else { (a.friction * b.friction).sqrt() },
            restitution: a.restitution.min(b.restitution),
        };
        let laws = single.iter().flat_map(|a| single.iter().map(move |b| mix(a, b))).collect();
        Self { materials: single.len(), laws }
    }

    /// The law of a pair.
    pub fn of(&self, a: usize, b: usize) -> Law {
        self.laws[a * self.materials + b]
    }

    /// Whether there is a pair with such a law.
    pub fn any(&self, such: impl Fn(&Law) -> bool) -> bool {
        self.laws.iter().any(such)
    }

    /// Gives a pair a law of its own.
    pub fn set(&mut self, a: usize, b: usize, law: Law) {
        self.laws[a * self.materials + b] = law;
        self.laws[b * self.materials + a] = law;
    }
}

/// Bodies, laws and joints.
#[derive(Clone, Debug)]
pub struct Scene {
    /// Metres a second squared.
    pub gravity: Vector3<f64>,
    /// All bodies, fixed ones too.
    pub bodies: Vec<Body>,
    /// What holds where they touch.
    pub laws: Laws,
    /// The set that friction is taken from.
    pub cone: Cone,
    /// What holds them together.
    pub joints: Vec<Joint>,
    /// Whether bodies that overlap at the start are moved apart, and velocities that tear a joint are changed.
    pub resolve: bool,
    /// What the user should know.
    pub warnings: Vec<Warning>,
}

/// Two bodies that overlap.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Overlap {
    /// Which.
    pub bodies: [usize; 2],
    /// By how much, in metres.
    pub depth: f64,
}

impl Scene {
    /// The pairs that overlap at the start by more than `fraction` of the smaller body's size.
    pub fn overlaps(&self, fraction: f64) -> Vec<Overlap> {
        let joined = super::joint::joined(&self.joints);
        let mut pairs = Vec::new();
        let bounds = |k: usize| self.bodies[k].collider.shape.bounds(&self.bodies[k].pose);
        BroadPhase::default().pairs(self.bodies.len(), bounds, |k| !self.bodies[k].fixed, &mut pairs);
        let mut points: Vec<ContactPoint> = Vec::new();
        let overlap = |&(a, b): &(u32, u32)| {
            let [first, second] = [a, b].map(|k| &self.bodies[k as usize]);
            let size = first.collider.shape.reach().min(second.collider.shape.reach());
            points.clear();
            contacts((&first.collider, &first.pose), (&second.collider, &second.pose), fraction * size, &mut points);
            let depth = -points.iter().map(|point| point.gap).fold(f64::INFINITY, f64::min);
            (depth > fraction * size).then_some(Overlap { bodies: [a as usize, b as usize], depth })
        };
        pairs.iter().filter(|pair| !joined.contains(pair)).filter_map(overlap).collect()
    }
}
