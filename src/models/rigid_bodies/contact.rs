//! One contact between two bodies: its frame, its lever arms, and the velocity of the second body relative to the first
//! at the contact point,
//!
//! ```text
//! u = E (v_2 + w_2 x r_2 - v_1 - w_1 x r_1) + b,    E = [n t_1 t_2]^T
//! ```
//!
//! with the contribution `b` of bodies with prescribed motion.

use super::collision::ContactPoint;
use super::motion::Motion;
use super::scene::{Law, Patch};
use nalgebra::{Matrix3, Vector3};
use vi::coulomb::{Reach, Role};

/// The smallest identity of a joint stop; contact points of surfaces are numbered from zero.
pub const STOPS: u64 = 1 << 63;

/// The bit of the identity of a torque, beside that of its contact point.
const TORQUES: u64 = 1 << 62;

/// A contact within one step.
#[derive(Clone, Copy, Debug)]
pub struct Contact {
    /// Indices of both bodies among the moving bodies; `None` for a body that is fixed or has prescribed motion.
    pub bodies: [Option<u32>; 2],
    /// `E`: the normal from the first body to the second, and two tangents; with directions of friction, the second tangent
    /// has the length of their ratio.
    pub frame: Matrix3<f64>,
    /// The contact point, in world coordinates.
    pub position: Vector3<f64>,
    /// The lever arms from the centres of mass to the contact point.
    pub arms: [Vector3<f64>; 2],
    /// Whether impulses are angular: of the stop of a hinge, with a gap about the normal in radians, or of a torque.
    pub turns: bool,
    /// The role in the law: a contact at a point, or the force or the torque of a patch. The torque of a patch follows its
    /// force; its frame has the axes of drilling and rolling, with the length of a radius of gyration.
    pub role: Role,
    /// The reference size for gaps: that of the smaller body, or one radian for angles.
    pub size: f64,
    /// The gap between the surfaces at the beginning of the step.
    pub gap: f64,
    /// Friction and restitution.
    pub law: Law,
    /// The contribution `b` of bodies with prescribed motion to `u`, averaged over the step.
    pub surface: Vector3<f64>,
    /// The identity of the contact: both bodies and the contact point.
    pub key: (u32, u32, u64),
    /// The smooth part of the surface that a sphere touches.
    pub feature: u32,
    /// The normal and tangential impulse; the initial guess is the impulse of the last step.
    pub impulse: Vector3<f64>,
    /// `u` at the end of the last step, before forces act.
    pub before: Vector3<f64>,
    /// A bias added to the free normal velocity.
    pub bias: f64,
    /// The tolerance below which a gap counts as closed.
    pub no_gap: f64,
    /// The gap at the end of the step.
    pub gap_at_end: f64,
    /// The work of the contact over the step by normal and tangential components, in joules.
    pub work: Vector3<f64>,
    /// What the normal velocity after an impact lacks of what Newton's law gives it.
    pub lacks: f64,
}

impl Contact {
    /// Builds the contact at a detected contact point, with its frame.
    pub fn new(
        point: &ContactPoint,
        frame: Matrix3<f64>,
        bodies: [Option<u32>; 2],
        moving: &[Motion],
        law: Law,
        pair: (u32, u32),
    ) -> Self {
        let arm = |body: Option<u32>| {
            body.map_or_else(Vector3::zeros, |body| point.position - moving[body as usize].pose.translation.vector)
        };
        let mut contact = Self {
            bodies,
            frame,
            position: point.position,
            arms: bodies.map(arm),
            turns: false,
            role: Role::Point,
            size: 0.0,
            surface: Vector3::zeros(),
            gap: point.gap,
            law,
            key: (pair.0, pair.1, point.id),
            feature: point.feature,
            impulse: Vector3::zeros(),
            before: Vector3::zeros(),
            bias: 0.0,
            no_gap: 0.0,
            gap_at_end: point.gap,
            work: Vector3::zeros(),
            lacks: 0.0,
        };
        contact.before = contact.velocity(|body| (moving[body as usize].velocity, moving[body as usize].omega));
        contact
    }

    /// `u`, for given velocities `(v, w)` of the bodies.
    pub fn velocity(&self, of: impl Fn(u32) -> (Vector3<f64>, Vector3<f64>)) -> Vector3<f64> {
        self.surface + self.change(of)
    }

    /// The change of `u`, for given changes of the velocities `(v, w)` of the bodies.
    pub fn change(&self, of: impl Fn(u32) -> (Vector3<f64>, Vector3<f64>)) -> Vector3<f64> {
        let at = |side: usize| {
            self.bodies[side].map_or_else(Vector3::zeros, |body| {
                let (v, w) = of(body);
                if self.turns { w } else { v + w.cross(&self.arms[side]) }
            })
        };
        self.frame * (at(1) - at(0))
    }

    /// The frictionless contact for position correction: velocities stand for displacements, and penetration becomes a
    /// bias.
    pub fn of_displacements(self) -> Self {
        Self {
            gap: self.gap.max(0.0),
            bias: self.gap.min(0.0),
            law: Law::default(),
            before: Vector3::zeros(),
            surface: Vector3::zeros(),
            role: Role::Point,
            ..self
        }
    }

    /// The force and the torque of a contact on a patch; `turning` are the angular velocities of both bodies where these are
    /// prescribed. The rows of the torque have the length of a mean radius of gyration of both bodies, so that they weigh
    /// in the law as those of the force do, however small or large the patch is.
    pub fn on(self, patch: &Patch, moving: &[Motion], turning: [Vector3<f64>; 2]) -> [Self; 2] {
        let bodies = || self.bodies.iter().flatten().map(|&body| &moving[body as usize]);
        let linear: f64 = bodies().map(|motion| motion.mass.recip()).sum();
        let angular: f64 = bodies().map(|motion| motion.mobility.trace() / 3.0).sum();
        let length = (linear / angular).sqrt();
        let mut frame = self.frame;
        for i in 0..3 {
            let size = frame.row(i).norm();
            frame.row_mut(i).scale_mut(length / size);
        }
        let (a, b, id) = self.key;
        let mut torque = Self {
            frame,
            turns: true,
            role: Role::Torque,
            size: 1.0,
            gap: 0.0,
            law: Law::default(),
            key: (a, b, id | TORQUES),
            surface: Vector3::zeros(),
            gap_at_end: 0.0,
            ..self
        };
        torque.before = torque.velocity(|body| (moving[body as usize].velocity, moving[body as usize].omega));
        let reach = Reach { drill: patch.radius / length, roll: patch.rolling / length };
        [Self { role: Role::Force(reach), ..self }, torque.carried(turning)]
    }

    /// Whether this is the torque of a patch.
    pub fn is_torque(&self) -> bool {
        self.role == Role::Torque
    }

    /// Adds the surface velocities of bodies with prescribed motion.
    pub fn carried(self, surfaces: [Vector3<f64>; 2]) -> Self {
        let surface = self.frame * (surfaces[1] - surfaces[0]);
        Self { surface, before: self.before + surface, ..self }
    }

    /// Predicts the gap at the end of a step `h` with the given mean velocities.
    pub fn foresee(&mut self, h: f64, of: impl Fn(u32) -> (Vector3<f64>, Vector3<f64>)) {
        // A torque closes with its force.
        self.gap_at_end = if self.is_torque() { f64::INFINITY } else { self.gap + h * self.velocity(of).x };
    }

    /// The speed of the slip of `u`.
    pub fn slip_speed(&self, u: &Vector3<f64>) -> f64 {
        u.y.hypot(if self.law.grain.is_some() { u.z / self.frame.row(2).norm() } else { u.z })
    }

    /// The components of an impulse in world axes.
    pub fn components(&self, impulse: &Vector3<f64>) -> Vector3<f64> {
        let mut components = self.frame * impulse;
        if self.law.grain.is_some() || self.is_torque() {
            for (i, component) in components.iter_mut().enumerate() {
                *component /= self.frame.row(i).norm_squared();
            }
        }
        components
    }

    /// Whether the contact is a stop of a joint.
    pub fn is_stop(&self) -> bool {
        self.key.2 >= STOPS
    }

    /// Whether surfaces that were apart at the beginning of the step strike in it.
    pub fn strikes(&self) -> bool {
        !self.is_torque() && self.impulse.x > 0.0 && self.gap > self.no_gap
    }

    /// The time from the beginning of the step to that at which the approach there closes the gap; infinite without an approach.
    pub fn closes_after(&self) -> f64 {
        if self.before.x < 0.0 { self.gap / -self.before.x } else { f64::INFINITY }
    }

    /// Whether the contact is closed at the end of the step.
    pub fn stays_closed(&self) -> bool {
        self.gap_at_end <= self.no_gap
    }

    /// `J^T r` for one side: impulse and angular impulse on the body.
    pub fn wrench(&self, side: usize, r: &Vector3<f64>) -> (Vector3<f64>, Vector3<f64>) {
        let impulse = self.frame.tr_mul(r) * if side == 0 { -1.0 } else { 1.0 };
        if self.turns {
            return (Vector3::zeros(), impulse);
        }
        (impulse, self.arms[side].cross(&impulse))
    }

    /// The block `A` of `J` for the angular velocity of one side: `u = +-(E v + A w)`, `A = -E [r]x`.
    pub fn angular(&self, side: usize) -> Matrix3<f64> {
        if self.turns { self.frame } else { -self.frame * self.arms[side].cross_matrix() }
    }
}

/// Marks the torques of patches where their forces are marked.
pub(super) fn mark_torques(contacts: &[Contact], marked: &mut [bool]) {
    for k in 1..marked.len() {
        if contacts[k].is_torque() {
            marked[k] = marked[k - 1];
        }
    }
}

/// The contact frame, with normal and tangents as rows. The first tangent is the projection of the x axis onto the
/// tangent plane (of the y axis if the normal is nearly the x axis), so that the frame varies smoothly while a body
/// rotates and is aligned with the user's axes.
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
