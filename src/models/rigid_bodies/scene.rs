//! The multibody system described by the user: bodies with initial states, contact laws, joints and forces.

use super::action::Action;
use super::collision::{BroadPhase, Collider, ContactPoint, contacts};
use super::friction::{Coefficient, Grain};
use super::joint::Joint;
use super::load::Load;
use super::prescribed::Prescription;
use super::signals::Signals;
use super::simulation::NEAR;
use contact::law::Cone;
use nalgebra::{Isometry3, Matrix3, Vector3};
use problem::{Control, Interrupted, Warning};
use std::collections::HashSet;

/// A body of a multibody system in SI units; pose and velocity are those of the centre of mass.
#[derive(Clone, Debug)]
pub struct Body {
    /// The name of the body, the prefix of its output names.
    pub name: String,
    /// The shape of the body relative to its centre of mass, or to the origin of the user's frame if the body is fixed.
    pub collider: Collider,
    /// The index of the body's material, which selects the contact law of a pair of bodies.
    pub material: usize,
    /// Whether the body is fixed or has prescribed motion, so that forces and impulses do not move it.
    pub fixed: bool,
    /// Whether the solution contains the contact forces on the body as outputs.
    pub tells_contacts: bool,
    /// The prescribed motion of a `fixed` body; `None` if the body is at rest.
    pub motion: Option<Prescription>,
    /// The collision group of the body, for the pairs in [`MultibodySystem::apart`]; a body without a group collides
    /// with all bodies.
    pub group: Option<u32>,
    /// The mass of the body in kilograms, positive if the body moves.
    pub mass: f64,
    /// The inertia of the body about its centre of mass, in the body frame.
    pub inertia: Matrix3<f64>,
    /// The centre of mass of the body in the user's frame.
    pub centre: Vector3<f64>,
    /// The initial pose of the body, which maps the body frame to the world.
    pub pose: Isometry3<f64>,
    /// The initial velocity of the body's centre of mass.
    pub velocity: Vector3<f64>,
    /// The initial angular velocity of the body in world axes.
    pub omega: Vector3<f64>,
}

/// The contact law of a pair of materials: friction and restitution.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Law {
    /// The coefficient of friction in Coulomb's law; for a coefficient that varies, the value at its last evaluation.
    pub friction: f64,
    /// The index of the coefficient of friction in [`Laws::coefficients`], if it varies.
    pub varying: Option<u32>,
    /// The index of the anisotropic friction in [`Laws::grains`], if friction is anisotropic.
    pub grain: Option<u32>,
    /// The index of the contact patch in [`Laws::patches`], if there is drilling or rolling friction.
    pub patch: Option<u32>,
    /// The coefficient of restitution in Newton's impact law, from 0 to 1.
    pub restitution: f64,
}

/// The contact patch on which two bodies touch, for drilling and rolling friction.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Patch {
    /// The radius of the patch, a disc with uniform pressure, in metres: friction resists drilling, coupled with
    /// sliding.
    pub radius: f64,
    /// The coefficient of rolling friction of the patch, in metres: the largest rolling torque divided by the normal
    /// force.
    pub rolling: f64,
}

impl Law {
    /// Returns the number of block rows of a contact with this law: two for the force and the torque on a patch,
    /// otherwise one.
    pub fn rows(&self) -> usize {
        if self.patch.is_some() { 2 } else { 1 }
    }

    /// Returns whether the contact law allows friction.
    pub fn is_rough(&self) -> bool {
        self.friction > 0.0 || self.varying.is_some() || self.patch.is_some()
    }
}

/// The contact laws of all pairs of materials.
#[derive(Clone, Debug)]
pub struct Laws {
    materials: usize,
    laws: Vec<Law>,
    /// The coefficients of friction that vary, to which [`Law::varying`] refers.
    pub coefficients: Vec<Coefficient>,
    /// The directions and ratios of anisotropic friction, to which [`Law::grain`] refers.
    pub grains: Vec<Grain>,
    /// The contact patches of drilling and rolling friction, to which [`Law::patch`] refers.
    pub patches: Vec<Patch>,
}

impl Laws {
    /// Collects the contact laws of all pairs of a number of materials; `laws` are in row order.
    pub fn new(materials: usize, laws: Vec<Law>) -> Self {
        Self { materials, laws, coefficients: Vec::new(), grains: Vec::new(), patches: Vec::new() }
    }

    /// Returns the contact law of a pair of materials.
    pub fn of(&self, a: usize, b: usize) -> Law {
        self.laws[a * self.materials + b]
    }

    /// Returns whether the contact law of any pair of materials satisfies a predicate.
    pub fn any(&self, such: impl Fn(&Law) -> bool) -> bool {
        self.laws.iter().any(such)
    }

    /// Returns the largest coefficient of restitution of any pair of materials.
    pub fn largest_restitution(&self) -> f64 {
        self.laws.iter().map(|law| law.restitution).fold(0.0, f64::max)
    }
}

/// A multibody system: bodies, contact laws, joints and forces.
#[derive(Clone, Debug)]
pub struct MultibodySystem {
    /// The gravitational acceleration of the system, in metres per second squared.
    pub gravity: Vector3<f64>,
    /// All bodies of the system, including fixed ones.
    pub bodies: Vec<Body>,
    /// The contact laws of all pairs of the bodies' materials.
    pub laws: Laws,
    /// The friction cone of the contact law, or its polyhedral approximation.
    pub cone: Cone,
    /// Pairs of collision groups, smaller index first, whose bodies do not collide with each other.
    pub apart: HashSet<(u32, u32)>,
    /// The joints of the system, and springs between points.
    pub joints: Vec<Joint>,
    /// The user-defined forces on bodies that depend on time and motion.
    pub actions: Vec<Action>,
    /// The signals of the system: functions of time that drive joints and bodies.
    pub signals: Signals,
    /// Whether initial overlaps of bodies are resolved, and initial velocities are projected onto the joint
    /// constraints.
    pub resolve: bool,
    /// Warnings to the user about the multibody system, known before the problem is solved.
    pub warnings: Vec<Warning>,
}

/// A pair of bodies that overlap initially.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Overlap {
    /// The indices of the two overlapping bodies in the system.
    pub bodies: [usize; 2],
    /// The penetration depth of the two bodies, in metres.
    pub depth: f64,
}

impl MultibodySystem {
    /// Returns the pairs of bodies that initially overlap by more than `fraction` of the smaller body's size, sorted;
    /// at most `most`.
    ///
    /// # Errors
    /// If `control` asks to stop.
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

    /// Returns the memory estimate for the initial contacts; counting stops when the estimate reaches `enough` bytes.
    ///
    /// # Errors
    /// If `control` asks to stop.
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
                let law = self.laws.of(self.bodies[a].material, self.bodies[b].material);
                load.add([a, b].map(moving), points.len(), law);
                if load.bytes() < enough { Ok(()) } else { Err(Ended::Enough) }
            },
        )?;
        Ok(load)
    }

    /// Passes all pairs of nearby bodies that may collide to `found`, with their contact points closer than `margin`,
    /// until `found` returns an error; `room` is the margin around the bounding box of a body.
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

    /// Returns whether two bodies belong to collision groups that do not collide with each other.
    pub fn is_apart(&self, a: u32, b: u32) -> bool {
        let [a, b] = [a, b].map(|body| self.bodies[body as usize].group);
        a.zip(b).is_some_and(|(a, b)| self.apart.contains(&(a.min(b), a.max(b))))
    }

    fn reach(&self, body: usize) -> f64 {
        self.bodies[body].collider.reach()
    }
}

/// Why the search for pairs of nearby bodies ended early.
enum Ended {
    Enough,
    Interrupted,
}

impl From<Interrupted> for Ended {
    fn from(_: Interrupted) -> Self {
        Self::Interrupted
    }
}
