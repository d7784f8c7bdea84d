//! One contact between two bodies: its frame, its levers, and the velocity of the second body against the first there,
//!
//! ```text
//! u = E (v_2 + w_2 x r_2 - v_1 - w_1 x r_1) + b,    E = [n t_1 t_2]^T
//! ```
//!
//! with the velocity `b` of bodies whose motion is given.

use super::collision::ContactPoint;
use super::motion::Motion;
use super::scene::Law;
use nalgebra::{Matrix3, Vector3};

/// The least identity of a stop of a joint; points of surfaces are numbered from zero.
pub const STOPS: u64 = 1 << 63;

/// A contact as a step sees it.
#[derive(Clone, Copy, Debug)]
pub struct Contact {
    /// Places among the moving bodies; none for a body that does not move.
    pub bodies: [Option<u32>; 2],
    /// `E`: the normal from the first body to the second, and two tangents.
    pub frame: Matrix3<f64>,
    /// The point, in the world.
    pub position: Vector3<f64>,
    /// From the centres of mass to the point.
    pub arms: [Vector3<f64>; 2],
    /// Whether it is a stop of a hinge: what meets is the angle about the normal, in radians, and impulses are those of torques.
    pub turns: bool,
    /// The size of the smaller body, with which gaps compare; one radian for an angle.
    pub size: f64,
    /// The distance of the surfaces.
    pub gap: f64,
    /// Friction and restitution.
    pub law: Law,
    /// What bodies whose motion is given add to `u`, in the mean of the step.
    pub surface: Vector3<f64>,
    /// Which point of which bodies this is.
    pub key: (u32, u32, u64),
    /// The impulse, normal and tangents: at first that of the last step.
    pub impulse: Vector3<f64>,
    /// `u` at the end of the last step, before forces.
    pub before: Vector3<f64>,
    /// Added to the normal velocity without impulses.
    pub bias: f64,
    /// A gap that is none.
    pub no_gap: f64,
    /// The gap at the end of the step.
    pub gap_at_end: f64,
    /// What it did over the step, by normal and tangents, in joules.
    pub work: Vector3<f64>,
}

impl Contact {
    /// The contact at a point.
    pub fn new(point: &ContactPoint, bodies: [Option<u32>; 2], moving: &[Motion], law: Law, pair: (u32, u32)) -> Self {
        let arm = |body: Option<u32>| {
            body.map_or_else(Vector3::zeros, |body| point.position - moving[body as usize].pose.translation.vector)
        };
        let mut contact = Self {
            bodies,
            frame: frame(&point.normal),
            position: point.position,
            arms: bodies.map(arm),
            turns: false,
            size: 0.0,
            surface: Vector3::zeros(),
            gap: point.gap,
            law,
            key: (pair.0, pair.1, point.id),
            impulse: Vector3::zeros(),
            before: Vector3::zeros(),
            bias: 0.0,
            no_gap: 0.0,
            gap_at_end: point.gap,
            work: Vector3::zeros(),
        };
        contact.before = contact.velocity(|body| (moving[body as usize].velocity, moving[body as usize].omega));
        contact
    }

    /// `u`, for velocities `(v, w)` by body.
    pub fn velocity(&self, of: impl Fn(u32) -> (Vector3<f64>, Vector3<f64>)) -> Vector3<f64> {
        self.surface + self.change(of)
    }

    /// The same for changes of velocities.
    pub fn change(&self, of: impl Fn(u32) -> (Vector3<f64>, Vector3<f64>)) -> Vector3<f64> {
        let at = |side: usize| {
            self.bodies[side].map_or_else(Vector3::zeros, |body| {
                let (v, w) = of(body);
                if self.turns { w } else { v + w.cross(&self.arms[side]) }
            })
        };
        self.frame * (at(1) - at(0))
    }

    /// The frictionless contact at which velocities are displacements, and an overlap is a velocity that closes it.
    pub fn of_displacements(self) -> Self {
        Self {
            gap: self.gap.max(0.0),
            bias: self.gap.min(0.0),
            law: Law::default(),
            before: Vector3::zeros(),
            surface: Vector3::zeros(),
            ..self
        }
    }

    /// The same between bodies whose motion is given.
    pub fn carried(self, surfaces: [Vector3<f64>; 2]) -> Self {
        let surface = self.frame * (surfaces[1] - surfaces[0]);
        Self { surface, before: self.before + surface, ..self }
    }

    /// Notes the gap at the end of a step `h` with these mean velocities.
    pub fn foresee(&mut self, h: f64, of: impl Fn(u32) -> (Vector3<f64>, Vector3<f64>)) {
        self.gap_at_end = self.gap + h * self.velocity(of).x;
    }

    /// Whether it is a stop of a joint.
    pub fn is_stop(&self) -> bool {
        self.key.2 >= STOPS
    }

    /// Whether its bodies touch at the end of the step.
    pub fn stays_closed(&self) -> bool {
        self.gap_at_end <= self.no_gap
    }

    /// `J^T r` for one side: impulse and angular impulse on that body.
    pub fn wrench(&self, side: usize, r: &Vector3<f64>) -> (Vector3<f64>, Vector3<f64>) {
        let impulse = self.frame.tr_mul(r) * if side == 0 { -1.0 } else { 1.0 };
        if self.turns {
            return (Vector3::zeros(), impulse);
        }
        (impulse, self.arms[side].cross(&impulse))
    }

    /// `J` for the angular velocity of one side: `u = +-(E v + A w)`, `A = -E [r]x`.
    pub fn angular(&self, side: usize) -> Matrix3<f64> {
        -self.frame * self.arms[side].cross_matrix()
    }
}

/// Normal and tangents as rows. The first tangent is the x axis as seen along the normal, or the y axis where that is
/// nearly the normal, so that the frame changes smoothly while a body turns and means something to who chose the axes.
pub(super) fn frame(normal: &Vector3<f64>) -> Matrix3<f64> {
    let along = if normal.x.abs() < 0.9 { Vector3::x() } else { Vector3::y() };
    let first = (along - normal * normal.dot(&along)).normalize();
    let second = normal.cross(&first);
    Matrix3::from_rows(&[normal.transpose(), first.transpose(), second.transpose()])
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_frame_is_a_rotation_whose_first_tangent_follows_the_x_axis() {
        for normal in [Vector3::z(), -Vector3::z(), Vector3::x(), Vector3::new(0.6, 0.0, 0.8)] {
            let e = frame(&normal);
            assert!((e * e.transpose() - Matrix3::identity()).amax() < 1e-15);
            assert!((e.determinant() - 1.0).abs() < 1e-15);
        }
        assert_eq!(frame(&Vector3::z()).row(1).transpose(), Vector3::x());
    }
}
