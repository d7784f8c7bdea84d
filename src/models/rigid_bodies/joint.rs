//! Joints: equations `c(q) = 0` between two bodies or one and the world, with anchors and axes fixed in each.
//!
//! | joint | equations |
//! |---|---|
//! | ball | the anchors coincide |
//! | hinge | and the axes are parallel: `t_1 . a = t_2 . a = 0` with `t_1, t_2` across the axis in one body, `a` the axis in the other |
//! | slider | there is no relative rotation, and the anchors differ along the axis only |
//! | fixed | there is neither rotation nor difference of anchors |
//!
//! Every equation is a product `alpha . beta` of two vectors: `alpha` is constant or turns with the second body, `beta` is
//! the difference of the anchors or turns with the first. The derivative of `c` along a motion is `G v`, row by row a
//! wrench on each body; in the mean frames of a step it is the discrete gradient of `c`.

use super::drive::{Coordinate, Drive, DriveLaw, Limits};
use super::frame::Frame;
use super::scene::Body;
use nalgebra::{Isometry3, Unit, Vector3};
use std::collections::HashSet;

/// What a joint leaves free.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum JointKind {
    /// Three rotations.
    Ball,
    /// One rotation.
    Hinge,
    /// One translation.
    Slider,
    /// Nothing.
    Fixed,
}

/// A joint between a moving body and another or the world.
#[derive(Clone, Debug)]
pub struct Joint {
    /// The bodies; none is the world.
    pub bodies: (usize, Option<usize>),
    /// The anchor, in the frames of the bodies or the world.
    pub(super) anchors: [Vector3<f64>; 2],
    /// What it asks for; no more than six, with that of the drive.
    pub(super) equations: Vec<Equation>,
    /// What acts along the coordinate that it leaves, or between its points: an equation more.
    pub drive: Option<Drive>,
    /// Whether its bodies do not touch each other.
    pub separates: bool,
    /// What its outputs begin with; none for one that has none.
    pub name: Option<String>,
}

/// What a joint does to its first body, in the mean of a step.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Reaction {
    /// In the world, in newtons.
    pub force: Vector3<f64>,
    /// About the point of the joint, in newton metres.
    pub torque: Vector3<f64>,
    /// The coordinate that a hinge or slider leaves, or the length of a spring.
    pub coordinate: f64,
    /// The force or torque along it.
    pub effort: f64,
}

/// One equation, `alpha . beta = 0`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Equation {
    pub alpha: Alpha,
    pub beta: Beta,
}

/// The first factor of an equation.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Alpha {
    /// A direction of the world.
    World(Vector3<f64>),
    /// A direction in the frame of the second body.
    Second(Vector3<f64>),
}

/// The second factor of an equation.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Beta {
    /// The anchor of the first body less that of the second.
    Apart,
    /// A direction in the frame of the first body.
    First(Vector3<f64>),
}

/// One equation: its value, and the derivative by the velocity and the angular velocity of each body.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Row {
    /// `c`.
    pub value: f64,
    /// By the velocity of the first body; by that of the second it is the opposite.
    pub force: Vector3<f64>,
    /// By the angular velocities.
    pub torques: [Vector3<f64>; 2],
}

impl Row {
    /// How fast the equation is left, with the velocity and the angular velocity of each body.
    pub fn velocity(&self, of: [(Vector3<f64>, Vector3<f64>); 2]) -> f64 {
        let [(v, w), (other_v, other_w)] = of;
        self.force.dot(&(v - other_v)) + self.torques[0].dot(&w) + self.torques[1].dot(&other_w)
    }
}

impl Joint {
    /// A joint at a point and along an axis of the world, as the bodies are at the start.
    pub fn new(
        kind: JointKind,
        bodies: (usize, Option<usize>),
        all: &[Body],
        at: Vector3<f64>,
        axis: Unit<Vector3<f64>>,
    ) -> Self {
        let poses = [all[bodies.0].pose, bodies.1.map_or(Isometry3::identity(), |b| all[b].pose)];
        let anchors = poses.map(|pose| pose.rotation.inverse() * (at - pose.translation.vector));
        let [first, second] = poses.map(|pose| move |e: Vector3<f64>| pose.rotation.inverse() * e);
        let least = Vector3::ith(axis.iamin(), 1.0);
        let t = axis.cross(&least).normalize();
        let across = [t, axis.cross(&t)];
        let [x, y, z] = [Vector3::x(), Vector3::y(), Vector3::z()];
        let point = [x, y, z].map(|e| Equation { alpha: Alpha::World(e), beta: Beta::Apart });
        let sliding = across.map(|e| Equation { alpha: Alpha::Second(second(e)), beta: Beta::Apart });
        let parallel = |e, f| Equation { alpha: Alpha::Second(second(e)), beta: Beta::First(first(f)) };
        let along = across.map(|t| parallel(t, axis.into_inner()));
        let aligned = [parallel(y, x), parallel(z, y), parallel(x, z)];
        let equations = match kind {
            JointKind::Ball => point.to_vec(),
            JointKind::Hinge => [&point[..], &along].concat(),
            JointKind::Slider => [&sliding[..], &aligned].concat(),
            JointKind::Fixed => [point, aligned].concat(),
        };
        Self { bodies, anchors, equations, drive: None, separates: true, name: None }
    }

    /// The same with a drive along the coordinate that it leaves.
    #[must_use]
    pub fn with_drive(self, drive: Option<Drive>) -> Self {
        Self { drive, ..self }
    }

    /// The same with a name for its outputs.
    #[must_use]
    pub fn with_name(self, name: Option<String>) -> Self {
        Self { name, ..self }
    }

    /// The rate of the coordinate of its drive, as all bodies are at the start.
    pub fn rate(&self, all: &[Body]) -> Option<f64> {
        let world = (Frame::WORLD, (Vector3::zeros(), Vector3::zeros()));
        let start = |body: &Body| (Frame::of(&body.pose), (body.velocity, body.omega));
        let [first, second] = [start(&all[self.bodies.0]), self.bodies.1.map_or(world, |b| start(&all[b]))];
        Some(self.driven([&first.0, &second.0], 0.0)?.velocity([first.1, second.1]))
    }

    /// A force along the distance of two points of the world, as the bodies are at the start.
    pub fn spring(bodies: (usize, Option<usize>), all: &[Body], at: [Vector3<f64>; 2], law: DriveLaw) -> Self {
        let poses = [all[bodies.0].pose, bodies.1.map_or(Isometry3::identity(), |b| all[b].pose)];
        let anchors = [0, 1].map(|side| poses[side].inverse_transform_point(&at[side].into()).coords);
        let drive = Some(Drive { coordinate: Coordinate::Length, law, limits: Limits::NONE });
        Self { bodies, anchors, equations: Vec::new(), drive, separates: false, name: None }
    }

    /// The coordinate that a hinge or a slider leaves, zero as the bodies are at the start.
    pub fn coordinate(
        kind: JointKind,
        bodies: (usize, Option<usize>),
        all: &[Body],
        axis: Unit<Vector3<f64>>,
    ) -> Option<Coordinate> {
        let second = bodies.1.map_or(Isometry3::identity(), |b| all[b].pose).rotation.inverse();
        let along = axis.cross(&Vector3::ith(axis.iamin(), 1.0)).normalize();
        match kind {
            JointKind::Hinge => Some(Coordinate::Angle {
                first: all[bodies.0].pose.rotation.inverse() * along,
                second: [second * along, second * axis.cross(&along)],
            }),
            JointKind::Slider => Some(Coordinate::Distance(second * axis.into_inner())),
            JointKind::Ball | JointKind::Fixed => None,
        }
    }

    /// Its coordinate as the bodies are at the start.
    pub(super) fn coordinate_at_start(&self, all: &[Body]) -> f64 {
        let second = self.bodies.1.map_or(Frame::WORLD, |body| Frame::of(&all[body].pose));
        let frames = [&Frame::of(&all[self.bodies.0].pose), &second];
        let (_, apart) = self.arms(frames);
        self.drive.as_ref().map_or(0.0, |drive| drive.value(frames, &apart, 0.0))
    }

    /// Names of its outputs.
    pub fn output_names(&self) -> Vec<String> {
        let Some(name) = &self.name else { return Vec::new() };
        let keys: &[&str] = match &self.drive {
            Some(Drive { coordinate: Coordinate::Length, .. }) => &["length", "force"],
            Some(_) => &["fx", "fy", "fz", "tx", "ty", "tz", "coordinate", "effort"],
            None => &["fx", "fy", "fz", "tx", "ty", "tz"],
        };
        keys.iter().map(|key| format!("{name}.{key}")).collect()
    }

    /// Which of its outputs is its coordinate.
    pub fn are_coordinates(&self) -> Vec<bool> {
        self.output_names().iter().map(|name| name.ends_with(".coordinate") || name.ends_with(".length")).collect()
    }

    /// Its outputs, in their order.
    pub fn outputs(&self, reaction: &Reaction, out: &mut Vec<f64>) {
        if self.name.is_none() {
            return;
        }
        let ends = [reaction.coordinate, reaction.effort];
        let is_spring = self.drive.is_some_and(|drive| drive.coordinate == Coordinate::Length);
        if !is_spring {
            out.extend(reaction.force.iter().chain(&reaction.torque));
        }
        out.extend(if self.drive.is_some() { &ends[..] } else { &[] });
    }

    /// The number of its equations.
    pub(super) fn rank(&self) -> usize {
        self.equations.len() + usize::from(self.drive.is_some())
    }

    /// The derivative of the coordinate of a drive, which is at this value; `apart` is the difference of the anchors.
    pub(super) fn along(&self, drive: &Drive, frames: [&Frame; 2], value: f64, apart: &Vector3<f64>) -> Option<Row> {
        let (arms, _) = self.arms(frames);
        match drive.equation(value) {
            Some(equation) => Some(equation.row(frames, arms, *apart)),
            None => {
                let along = apart.try_normalize(0.0)?;
                Some(Row { value, force: along, torques: [arms[0].cross(&along), -arms[1].cross(&along)] })
            }
        }
    }

    /// The equation of a drive that prescribes its coordinate, in these frames.
    pub(super) fn driven(&self, frames: [&Frame; 2], reference: f64) -> Option<Row> {
        let drive = self.drive.as_ref().filter(|drive| drive.prescribes())?;
        let (arms, apart) = self.arms(frames);
        let row = drive.equation(reference)?.row(frames, arms, apart);
        Some(Row { value: row.value - drive.offset(reference), ..row })
    }

    /// How fast its points part, in metres a second, and how fast its bodies turn as it does not let them, in radians a
    /// second, as they all are at the start; `None` if that is less than `fraction` of their velocities.
    pub fn torn(&self, all: &[Body], fraction: f64) -> Option<[f64; 2]> {
        let world = (Frame::WORLD, (Vector3::zeros(), Vector3::zeros()));
        let start = |body: &Body| (Frame::of(&body.pose), (body.velocity, body.omega));
        let [first, second] = [start(&all[self.bodies.0]), self.bodies.1.map_or(world, |b| start(&all[b]))];
        let of = [first.1, second.1];
        let (mut speeds, mut torn) = ([0.0_f64; 2], false);
        for row in self.rows([&first.0, &second.0]) {
            let speed = row.velocity(of).abs();
            let size: f64 =
                (0..2).map(|k| row.force.norm() * of[k].0.norm() + row.torques[k].norm() * of[k].1.norm()).sum();
            let turns = usize::from(row.force == Vector3::zeros());
            speeds[turns] = speeds[turns].hypot(speed);
            torn |= speed > fraction * size;
        }
        torn.then_some(speeds)
    }

    /// The size of its bodies: the distance of an anchor from the centre of one that moves, or how far that reaches.
    pub fn size(&self, bodies: &[Body]) -> f64 {
        let moving = |(body, anchor): (Option<usize>, &Vector3<f64>)| {
            let body = body.map(|body| &bodies[body]).filter(|body| !body.fixed)?;
            Some(anchor.norm().max(body.collider.reach()))
        };
        let both = [(Some(self.bodies.0), &self.anchors[0]), (self.bodies.1, &self.anchors[1])];
        both.into_iter().filter_map(moving).fold(f64::MIN_POSITIVE, f64::max)
    }

    /// The places of its bodies, as `places` gives them; none for the world.
    pub fn places(&self, places: &impl Fn(usize) -> Option<u32>) -> [Option<u32>; 2] {
        [places(self.bodies.0), self.bodies.1.and_then(places)]
    }

    /// The anchors as seen from the centres of mass, and their difference.
    pub(super) fn arms(&self, [p, q]: [&Frame; 2]) -> ([Vector3<f64>; 2], Vector3<f64>) {
        let arms = [p.axes * self.anchors[0], q.axes * self.anchors[1]];
        (arms, p.at + arms[0] - q.at - arms[1])
    }

    /// The equations in these frames.
    pub fn rows<'j>(&'j self, frames: [&'j Frame; 2]) -> impl Iterator<Item = Row> + 'j {
        let (arms, apart) = self.arms(frames);
        self.equations.iter().map(move |equation| equation.row(frames, arms, apart))
    }
}

impl Alpha {
    /// The direction in the world, with the frame of the second body.
    pub fn in_world(&self, second: &Frame) -> Vector3<f64> {
        match self {
            Self::World(e) => *e,
            Self::Second(e) => second.axes * e,
        }
    }

    /// Whether it turns with the second body.
    pub fn turns(&self) -> bool {
        matches!(self, Self::Second(_))
    }
}

impl Equation {
    /// Its value and derivative in these frames.
    pub fn row(&self, [p, q]: [&Frame; 2], arms: [Vector3<f64>; 2], apart: Vector3<f64>) -> Row {
        let alpha = self.alpha.in_world(q);
        match self.beta {
            Beta::Apart => {
                let lever = if self.alpha.turns() { arms[1] + apart } else { arms[1] };
                Row { value: alpha.dot(&apart), force: alpha, torques: [arms[0].cross(&alpha), -lever.cross(&alpha)] }
            }
            Beta::First(b) => {
                // d/dt (alpha . b) = (w_1 - w_2) . (b x alpha).
                let b = p.axes * b;
                let torque = b.cross(&alpha);
                Row { value: alpha.dot(&b), force: Vector3::zeros(), torques: [torque, -torque] }
            }
        }
    }
}

/// The pairs of bodies that a joint holds together, the lesser first.
pub fn joined(joints: &[Joint]) -> HashSet<(u32, u32)> {
    let pair = |joint: &Joint| joint.bodies.1.map(|b| (joint.bodies.0.min(b) as u32, joint.bodies.0.max(b) as u32));
    joints.iter().filter(|joint| joint.separates).filter_map(pair).collect()
}
