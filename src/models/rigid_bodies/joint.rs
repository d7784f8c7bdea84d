//! Joints: constraints `c(q) = 0` between two bodies, or between a body and the world, with anchors and axes fixed in
//! each.
//!
//! | joint | equations |
//! |---|---|
//! | ball | the anchors coincide |
//! | hinge | the anchors coincide, and the axes are parallel: `t_1 . a = t_2 . a = 0` |
//! | slider | no relative rotation, and the anchors differ along the axis only |
//! | fixed | no relative rotation, and the anchors coincide |
//!
//! In the equations of a hinge, `t_1` and `t_2` are normal to its axis in one body, and `a` is the axis in the other
//! body.
//!
//! Every equation is a product `alpha . beta` of two vectors: `alpha` is constant or fixed in the second body, `beta`
//! is the difference of the anchors or fixed in the first body. The time derivative of `c` is `G v`; each row of `G`
//! is a wrench on each body. Evaluated at the mean frames of a step, `G` is the discrete gradient of `c`.

use super::drive::{Coordinate, Drive, DriveLaw, Limits};
use super::frame::Frame;
use super::scene::Body;
use nalgebra::{Isometry3, Unit, UnitQuaternion, Vector3};
use std::collections::HashSet;

/// The kind of a joint, by its degrees of freedom.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum JointKind {
    /// A ball joint: the three rotations are free.
    Ball,
    /// A hinge: one rotation is free.
    Hinge,
    /// A slider: one translation is free.
    Slider,
    /// A rigid connection of two bodies without relative motion.
    Fixed,
}

/// A joint between a moving body and another body or the world.
#[derive(Clone, Debug)]
pub struct Joint {
    /// The indices of the joined bodies in the multibody system; `None` is the world.
    pub bodies: (usize, Option<usize>),
    /// The anchors of the joint, in the frames of its two bodies or of the world.
    pub(super) anchors: [Vector3<f64>; 2],
    /// The constraint equations of the joint without that of its drive; at most six together with it.
    pub(super) equations: Vec<Equation>,
    /// The drive along the free coordinate of the joint or between its anchors, which adds one equation; `None` without
    /// a drive.
    pub drive: Option<Drive>,
    /// Whether contacts between the two bodies of the joint are excluded.
    pub separates: bool,
    /// The prefix of the names of the joint's outputs; `None` if the joint has no outputs.
    pub name: Option<String>,
    /// For a spring or one direction of a bushing, the names of its coordinate and its force, which are its only
    /// outputs.
    pub labels: Option<[&'static str; 2]>,
}

/// The mean reaction of a joint on its first body over a step.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Reaction {
    /// The force of the joint on its first body, in world axes, in newtons.
    pub force: Vector3<f64>,
    /// The torque of the joint on its first body about the anchor, in newton metres.
    pub torque: Vector3<f64>,
    /// The free coordinate of a hinge or slider, or the length of a spring, at the end of the step.
    pub coordinate: f64,
    /// The force or torque of the joint's drive along its coordinate.
    pub effort: f64,
}

/// A bilinear constraint equation `alpha . beta = 0` of a joint.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Equation {
    pub alpha: Alpha,
    pub beta: Beta,
}

/// The first factor `alpha` of a joint's constraint equation: a direction fixed in the world or in the second body.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Alpha {
    /// The direction `alpha` is fixed in the world.
    World(Vector3<f64>),
    /// The direction `alpha` is fixed in the second body, given in the body's frame.
    Second(Vector3<f64>),
}

/// The second factor `beta` of a joint's constraint equation: the offset of the anchors, or a direction fixed in the
/// first body.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Beta {
    /// The position of the first body's anchor less that of the second body's anchor.
    Apart,
    /// The direction `beta` is fixed in the first body, given in the body's frame.
    First(Vector3<f64>),
}

/// The value of a joint's constraint equation, and its derivative with respect to the velocity and the angular velocity
/// of each body.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Row {
    /// The value `c` of the constraint equation, zero if it is satisfied.
    pub value: f64,
    /// The derivative of the rate `c'` of the constraint with respect to the velocity of the first body; that for the
    /// second body is its negative.
    pub force: Vector3<f64>,
    /// The derivatives of the rate `c'` of the constraint with respect to the angular velocities of both bodies.
    pub torques: [Vector3<f64>; 2],
}

impl Row {
    /// Returns the rate `c'` of the constraint for the given velocity and angular velocity of each body.
    pub fn velocity(&self, of: [(Vector3<f64>, Vector3<f64>); 2]) -> f64 {
        let [(v, w), (other_v, other_w)] = of;
        self.force.dot(&(v - other_v)) + self.torques[0].dot(&w) + self.torques[1].dot(&other_w)
    }
}

impl Joint {
    /// Creates a joint at a point and along an axis, both in world coordinates, for the initial poses of the bodies.
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
        Self { bodies, anchors, equations, drive: None, separates: true, name: None, labels: None }
    }

    /// Sets the drive of the joint, along its free coordinate.
    #[must_use]
    pub fn with_drive(self, drive: Option<Drive>) -> Self {
        Self { drive, ..self }
    }

    /// Sets the prefix of the joint's output names.
    #[must_use]
    pub fn with_name(self, name: Option<String>) -> Self {
        Self { name, ..self }
    }

    /// Returns the initial rate of the coordinate that the joint's drive prescribes; `None` for joints without a
    /// prescribed coordinate.
    pub fn rate(&self, all: &[Body]) -> Option<f64> {
        let world = (Frame::WORLD, (Vector3::zeros(), Vector3::zeros()));
        let start = |body: &Body| (Frame::of(&body.pose), (body.velocity, body.omega));
        let [first, second] = [start(&all[self.bodies.0]), self.bodies.1.map_or(world, |b| start(&all[b]))];
        Some(self.driven([&first.0, &second.0], 0.0)?.velocity([first.1, second.1]))
    }

    /// Creates a spring: a force along the line between two points, given in world coordinates for the initial poses of
    /// the bodies.
    pub fn spring(bodies: (usize, Option<usize>), all: &[Body], at: [Vector3<f64>; 2], law: DriveLaw) -> Self {
        let poses = [all[bodies.0].pose, bodies.1.map_or(Isometry3::identity(), |b| all[b].pose)];
        let anchors = [0, 1].map(|side| poses[side].inverse_transform_point(&at[side].into()).coords);
        let drive = Some(Drive { coordinate: Coordinate::Length, law, limits: Limits::NONE });
        let labels = Some(["length", "force"]);
        Self { bodies, anchors, equations: Vec::new(), drive, separates: false, name: None, labels }
    }

    /// Creates one direction of a bushing between two bodies: a spring and a damper along axis `k` of `axes` (0 to 2),
    /// or about axis `k - 3` (3 to 5), given at the initial poses of the bodies.
    pub fn bushing(
        bodies: (usize, Option<usize>),
        all: &[Body],
        at: Vector3<f64>,
        axes: &UnitQuaternion<f64>,
        (k, law): (usize, DriveLaw),
    ) -> Self {
        let poses = [all[bodies.0].pose, bodies.1.map_or(Isometry3::identity(), |b| all[b].pose)];
        let anchors = poses.map(|pose| pose.inverse_transform_point(&at.into()).coords);
        let axis = |side: usize, i: usize| poses[side].rotation.inverse() * (axes * Vector3::ith(i % 3, 1.0));
        // In a bushing, a rotation of the first body by a small angle about axis `i` moves its axis `i + 1` along axis
        // `i + 2` of the second body.
        let coordinate = match k {
            0..3 => Coordinate::Distance(axis(1, k)),
            _ => Coordinate::Product { first: axis(0, k + 1), second: axis(1, k + 2) },
        };
        let drive = Some(Drive { coordinate, law, limits: Limits::NONE });
        let labels = [["x", "fx"], ["y", "fy"], ["z", "fz"], ["rx", "tx"], ["ry", "ty"], ["rz", "tz"]];
        let labels = labels.get(k).copied();
        Self { bodies, anchors, equations: Vec::new(), drive, separates: false, name: None, labels }
    }

    /// Returns the free coordinate of a hinge or a slider, zero at the initial poses of the bodies; `None` for other
    /// joints.
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

    /// Returns the initial value of the drive's coordinate; zero without a drive.
    pub(super) fn coordinate_at_start(&self, all: &[Body]) -> f64 {
        let second = self.bodies.1.map_or(Frame::WORLD, |body| Frame::of(&all[body].pose));
        let frames = [&Frame::of(&all[self.bodies.0].pose), &second];
        let (_, apart) = self.arms(frames);
        self.drive.as_ref().map_or(0.0, |drive| drive.value(frames, &apart, 0.0))
    }

    /// Returns the names of the joint's outputs; empty for a joint without a name.
    pub fn output_names(&self) -> Vec<String> {
        let Some(name) = &self.name else { return Vec::new() };
        let keys: &[&str] = match (&self.labels, &self.drive) {
            (Some(labels), _) => labels,
            (None, Some(_)) => &["fx", "fy", "fz", "tx", "ty", "tz", "coordinate", "effort"],
            (None, None) => &["fx", "fy", "fz", "tx", "ty", "tz"],
        };
        keys.iter().map(|key| format!("{name}.{key}")).collect()
    }

    /// Returns, for each output of the joint, whether it is a coordinate or a length rather than a force.
    pub fn are_coordinates(&self) -> Vec<bool> {
        let of_joint = |name: &String| name.ends_with(".coordinate");
        let names = self.output_names();
        names.iter().enumerate().map(|(k, name)| if self.labels.is_some() { k == 0 } else { of_joint(name) }).collect()
    }

    /// Appends the outputs of the joint over a step to `out`, in the order of [`output_names`](Self::output_names).
    pub fn outputs(&self, reaction: &Reaction, out: &mut Vec<f64>) {
        if self.name.is_none() {
            return;
        }
        let ends = [reaction.coordinate, reaction.effort];
        if self.labels.is_none() {
            out.extend(reaction.force.iter().chain(&reaction.torque));
        }
        out.extend(if self.drive.is_some() { &ends[..] } else { &[] });
    }

    /// Returns the number of the joint's constraint equations, including the equation of its drive.
    pub(super) fn rank(&self) -> usize {
        self.equations.len() + usize::from(self.drive.is_some())
    }

    /// Returns the derivative of a drive's coordinate with respect to the motion of the bodies, at the value `value` of
    /// the coordinate; `apart` is the difference of the anchors. `None` for a distance between anchors that coincide.
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

    /// Returns the constraint equation of a drive that prescribes its coordinate, for given frames of the bodies;
    /// `None` for other joints.
    pub(super) fn driven(&self, frames: [&Frame; 2], reference: f64) -> Option<Row> {
        let drive = self.drive.as_ref().filter(|drive| drive.prescribes())?;
        let (arms, apart) = self.arms(frames);
        let row = drive.equation(reference)?.row(frames, arms, apart);
        Some(Row { value: row.value - drive.offset(reference), ..row })
    }

    /// Returns the constraint violation of the initial velocities: the velocity at which the anchors separate in
    /// metres per second, and the forbidden relative angular velocity in radians per second. `None` if all violations
    /// are below `fraction` of the velocities.
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

    /// Returns the length scale of the joint: the largest lever arm of its anchors or radius of its moving bodies.
    pub fn size(&self, bodies: &[Body]) -> f64 {
        let moving = |(body, anchor): (Option<usize>, &Vector3<f64>)| {
            let body = body.map(|body| &bodies[body]).filter(|body| !body.fixed)?;
            Some(anchor.norm().max(body.collider.reach()))
        };
        let both = [(Some(self.bodies.0), &self.anchors[0]), (self.bodies.1, &self.anchors[1])];
        both.into_iter().filter_map(moving).fold(f64::MIN_POSITIVE, f64::max)
    }

    /// Returns the indices of the joint's two bodies in another numbering, such as that of the moving bodies; `places`
    /// maps an index in the multibody system to the other index. `None` for the world, and for bodies without such an
    /// index.
    pub fn places(&self, places: &impl Fn(usize) -> Option<u32>) -> [Option<u32>; 2] {
        [places(self.bodies.0), self.bodies.1.and_then(places)]
    }

    /// Returns the lever arms from the centres of mass of the joint's bodies to the anchors, and the difference of the
    /// anchors.
    pub(super) fn arms(&self, [p, q]: [&Frame; 2]) -> ([Vector3<f64>; 2], Vector3<f64>) {
        let arms = [p.axes * self.anchors[0], q.axes * self.anchors[1]];
        (arms, p.at + arms[0] - q.at - arms[1])
    }

    /// Returns the constraint equations of the joint, without that of its drive, for given frames of its bodies.
    pub fn rows<'j>(&'j self, frames: [&'j Frame; 2]) -> impl Iterator<Item = Row> + 'j {
        let (arms, apart) = self.arms(frames);
        self.equations.iter().map(move |equation| equation.row(frames, arms, apart))
    }
}

impl Alpha {
    /// Returns the direction `alpha` in world axes, for a given frame of the second body.
    pub fn in_world(&self, second: &Frame) -> Vector3<f64> {
        match self {
            Self::World(e) => *e,
            Self::Second(e) => second.axes * e,
        }
    }

    /// Returns whether the direction `alpha` is fixed in the second body, so that it rotates.
    pub fn turns(&self) -> bool {
        matches!(self, Self::Second(_))
    }
}

impl Equation {
    /// Returns the value and the derivative of the constraint equation, for given frames of the bodies, lever arms and
    /// difference of the anchors.
    pub fn row(&self, [p, q]: [&Frame; 2], arms: [Vector3<f64>; 2], apart: Vector3<f64>) -> Row {
        let alpha = self.alpha.in_world(q);
        match self.beta {
            Beta::Apart => {
                let lever = if self.alpha.turns() { arms[1] + apart } else { arms[1] };
                Row { value: alpha.dot(&apart), force: alpha, torques: [arms[0].cross(&alpha), -lever.cross(&alpha)] }
            }
            Beta::First(b) => {
                // The rate of the product of the directions `alpha` and `b`, fixed in the two bodies, is
                // `d/dt (alpha . b) = (w_1 - w_2) . (b x alpha)`.
                let b = p.axes * b;
                let torque = b.cross(&alpha);
                Row { value: alpha.dot(&b), force: Vector3::zeros(), torques: [torque, -torque] }
            }
        }
    }
}

/// Returns the pairs of bodies, smaller index first, between which a joint excludes contacts.
pub fn joined(joints: &[Joint]) -> HashSet<(u32, u32)> {
    let pair = |joint: &Joint| joint.bodies.1.map(|b| (joint.bodies.0.min(b) as u32, joint.bodies.0.max(b) as u32));
    joints.iter().filter(|joint| joint.separates).filter_map(pair).collect()
}
