//! Joints: equations `c(q) = 0` between two bodies or one and the world, with anchors and axes fixed in each.
//!
//! | joint | equations |
//! |---|---|
//! | ball | the anchors coincide |
//! | hinge | and the axes are parallel: `t_1 . a = t_2 . a = 0` with `t_1, t_2` across the axis in one body, `a` the axis in the other |
//! | slider | the relative rotation is none, and the anchors differ along the axis only |
//! | fixed | neither rotation nor difference of anchors |
//!
//! The derivative of `c` along a motion is `G v`, row by row a wrench on each body.

use super::scene::Body;
use nalgebra::{Isometry3, Unit, UnitQuaternion, Vector3};
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
    kind: JointKind,
    /// The bodies; none is the world.
    pub bodies: (usize, Option<usize>),
    /// The anchor, in the frames of the bodies or the world.
    anchors: [Vector3<f64>; 2],
    /// The axis likewise.
    axes: [Vector3<f64>; 2],
    /// Two directions across the axis, in the frame of the second.
    across: [Vector3<f64>; 2],
    /// The orientation of the first in the frame of the second.
    turn: UnitQuaternion<f64>,
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
        let axes = poses.map(|pose| pose.rotation.inverse() * axis.into_inner());
        let least = Vector3::ith(axes[1].iamin(), 1.0);
        let t = axes[1].cross(&least).normalize();
        let turn = poses[1].rotation.inverse() * poses[0].rotation;
        Self { kind, bodies, anchors, axes, across: [t, axes[1].cross(&t)], turn }
    }

    /// How fast its points part, in metres a second, and how fast its bodies turn as it does not let them, in radians a
    /// second, as they all are at the start; `None` if that is less than `fraction` of their velocities.
    pub fn torn(&self, all: &[Body], fraction: f64) -> Option<[f64; 2]> {
        let world = (Isometry3::identity(), (Vector3::zeros(), Vector3::zeros()));
        let start = |body: &Body| (body.pose, (body.velocity, body.omega));
        let [first, second] = [start(&all[self.bodies.0]), self.bodies.1.map_or(world, |b| start(&all[b]))];
        let mut rows = Vec::new();
        self.rows([&first.0, &second.0], &mut rows);
        let of = [first.1, second.1];
        let (mut speeds, mut torn) = ([0.0_f64; 2], false);
        for row in &rows {
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
            Some(anchor.norm().max(body.collider.shape.reach()))
        };
        let both = [(Some(self.bodies.0), &self.anchors[0]), (self.bodies.1, &self.anchors[1])];
        both.into_iter().filter_map(moving).fold(f64::MIN_POSITIVE, f64::max)
    }

    /// The places of its bodies, as `places` gives them; none for the world.
    pub fn places(&self, places: &impl Fn(usize) -> Option<u32>) -> [Option<u32>; 2] {
        [places(self.bodies.0), self.bodies.1.and_then(places)]
    }

    /// The equations at these poses.
    pub fn rows(&self, poses: [&Isometry3<f64>; 2], rows: &mut Vec<Row>) {
        let [p, q] = poses;
        let arms = [p.rotation * self.anchors[0], q.rotation * self.anchors[1]];
        let apart = p.translation.vector + arms[0] - q.translation.vector - arms[1];
        // d/dt (e . apart) for a direction e that turns with the second body.
        let mut point = |e: Vector3<f64>, turns: bool| {
            let lever = if turns { arms[1] + apart } else { arms[1] };
            rows.push(Row { value: e.dot(&apart), force: e, torques: [arms[0].cross(&e), -lever.cross(&e)] });
        };
        match self.kind {
            JointKind::Ball | JointKind::Hinge | JointKind::Fixed => {
                for e in [Vector3::x(), Vector3::y(), Vector3::z()] {
                    point(e, false);
                }
            }
            JointKind::Slider => {
                for e in self.across {
                    point(q.rotation * e, true);
                }
            }
        }
        match self.kind {
            JointKind::Ball => {}
            JointKind::Hinge => {
                let axis = p.rotation * self.axes[0];
                for t in self.across {
                    let t = q.rotation * t;
                    // d/dt (t . a) = (w_1 - w_2) . (a x t).
                    let torque = axis.cross(&t);
                    rows.push(Row { value: t.dot(&axis), force: Vector3::zeros(), torques: [torque, -torque] });
                }
            }
            JointKind::Slider | JointKind::Fixed => {
                // The rotation vector of what the first has turned more than the second, in the world.
                let excess = (p.rotation * (q.rotation * self.turn).inverse()).scaled_axis();
                for e in [Vector3::x(), Vector3::y(), Vector3::z()] {
                    rows.push(Row { value: e.dot(&excess), force: Vector3::zeros(), torques: [e, -e] });
                }
            }
        }
    }
}

/// The pairs of bodies that a joint holds together, the lesser first.
pub fn joined(joints: &[Joint]) -> HashSet<(u32, u32)> {
    let pair = |joint: &Joint| joint.bodies.1.map(|b| (joint.bodies.0.min(b) as u32, joint.bodies.0.max(b) as u32));
    joints.iter().filter_map(pair).collect()
}
