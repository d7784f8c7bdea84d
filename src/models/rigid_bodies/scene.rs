//! A scene: bodies as they are at the start, what holds where they touch, and joints between them.

use super::action::Action;
use super::collision::{BroadPhase, Collider, ContactPoint, contacts};
use super::joint::Joint;
use super::load::Load;
use super::prescribed::Prescription;
use super::signals::Signals;
use super::simulation::NEAR;
use contact::law::Cone;
use nalgebra::{Isometry3, Matrix3, Vector3};
use problem::{Control, Interrupted, Warning};
use std::collections::HashSet;

/// A body. SI units; the pose and the velocity are those of its centre of mass.
#[derive(Clone, Debug)]
pub struct Body {
    /// Its outputs begin with it.
    pub name: String,
    /// Its shape about the centre of mass, or the origin of its frame if it is fixed.
    pub collider: Collider,
    /// The place of its material in the laws.
    pub material: usize,
    /// Whether nothing moves it.
    pub fixed: bool,
    /// Whether the forces of its contacts are outputs.
    pub tells_contacts: bool,
    /// How a body that is `fixed` moves all the same.
    pub motion: Option<Prescription>,
    /// The place of its group among those that may not touch each other; bodies without one touch all.
    pub group: Option<u32>,
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
pub struct MultibodySystem {
    /// Metres a second squared.
    pub gravity: Vector3<f64>,
    /// All bodies, fixed ones too.
    pub bodies: Vec<Body>,
    /// What holds where they touch.
    pub laws: Laws,
    /// The set that friction is taken from.
    pub cone: Cone,
    /// Pairs of groups whose bodies do not touch each other, the lesser first.
    pub apart: HashSet<(u32, u32)>,
    /// What holds them together, and springs between them.
    pub joints: Vec<Joint>,
    /// Forces on them.
    pub actions: Vec<Action>,
    /// Functions of time that drive joints and bodies.
    pub signals: Signals,
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

impl MultibodySystem {
    /// Pairs that overlap at the start by more than `fraction` of the smaller body's size, in order: all of them, or as
    /// many as are asked for.
    ///
    /// # Errors
    /// `control` asks to stop.
    pub fn overlaps(&self, fraction: f64, most: usize, control: &Control) -> Result<Vec<Overlap>, Interrupted> {
        let mut overlaps = Vec::new();
        let margin = |a: usize, b: usize| fraction * self.reach(a).min(self.reach(b));
        self.touching(
            margin,
            |_| 0.0,
            control,
            |[a, b], points| {
                let depth = -points.iter().map(|point| point.gap).fold(f64::INFINITY, f64::min);
                if depth > margin(a, b) {
                    overlaps.push(Overlap { bodies: [a, b], depth });
                }
                if overlaps.len() < most { Ok(()) } else { Err(Ended::Enough) }
            },
        )?;
        overlaps.sort_by_key(|overlap| overlap.bodies);
        Ok(overlaps)
    }

    /// What its contacts at the start come to; no more are counted when that is `enough` bytes.
    ///
    /// # Errors
    /// `control` asks to stop.
    pub fn load(&self, enough: usize, control: &Control) -> Result<Load, Interrupted> {
        let mut load = Load::of(self);
        let moving = |body: usize| (!self.bodies[body].fixed).then_some(body);
        let near = |body: usize| moving(body).map_or(0.0, |body| NEAR * self.reach(body));
        self.touching(
            |a, b| near(a) + near(b),
            near,
            control,
            |[a, b], points| {
                load.pairs += 1;
                load.add([a, b].map(moving), points.len());
                if load.bytes() < enough { Ok(()) } else { Err(Ended::Enough) }
            },
        )?;
        Ok(load)
    }

    /// Hands the pairs of bodies that are near, and no joint holds together, to `found` with their points that are
    /// nearer than `margin`, until it has enough; `room` is that around the box of a body.
    fn touching(
        &self,
        margin: impl Fn(usize, usize) -> f64,
        room: impl Fn(usize) -> f64,
        control: &Control,
        mut found: impl FnMut([usize; 2], &[ContactPoint]) -> Result<(), Ended>,
    ) -> Result<(), Interrupted> {
        let joined = super::joint::joined(&self.joints);
        let passes = |a: u32, b: u32| joined.contains(&(a, b)) || self.is_apart(a, b);
        let bounds = |k: usize| {
            let (lower, upper) = self.bodies[k].collider.bounds(&self.bodies[k].pose);
            let room = Vector3::repeat(room(k));
            (lower - room, upper + room)
        };
        let mut points: Vec<ContactPoint> = Vec::new();
        let moves = |k: usize| !self.bodies[k].fixed;
        let swept = BroadPhase::default().sweep(self.bodies.len(), bounds, moves, control, |a, b| {
            if passes(a, b) {
                return Ok(());
            }
            control.go_on()?;
            let [a, b] = [a as usize, b as usize];
            let [first, second] = [a, b].map(|k| (&self.bodies[k].collider, &self.bodies[k].pose));
            points.clear();
            contacts(first, second, margin(a, b), &mut points);
            found([a, b], &points)
        });
        match swept {
            Err(Ended::Interrupted) => Err(Interrupted),
            Ok(()) | Err(Ended::Enough) => Ok(()),
        }
    }

    /// Whether two bodies are of groups that do not touch each other.
    pub fn is_apart(&self, a: u32, b: u32) -> bool {
        let [a, b] = [a, b].map(|body| self.bodies[body as usize].group);
        a.zip(b).is_some_and(|(a, b)| self.apart.contains(&(a.min(b), a.max(b))))
    }

    fn reach(&self, body: usize) -> f64 {
        self.bodies[body].collider.reach()
    }
}

/// Why pairs are looked for no longer.
enum Ended {
    Enough,
    Interrupted,
}

impl From<Interrupted> for Ended {
    fn from(_: Interrupted) -> Self {
        Self::Interrupted
    }
}
