//! One contact between two bodies: its frame `E` (normal `n` and tangents `t_1`, `t_2`), its lever arms `r`, and the
//! velocity of the second body relative to the first at the contact point,
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

/// The smallest identity number of a contact that is a joint stop; contact points of surfaces are numbered from zero.
pub const STOPS: u64 = 1 << 63;

/// The bit that distinguishes the identity number of the torque of a contact patch from that of the patch's force.
const TORQUES: u64 = 1 << 62;

/// A contact between two bodies within one time step.
#[derive(Clone, Copy, Debug)]
pub struct Contact {
    /// Indices of both bodies in contact among the moving bodies; `None` for a body that is fixed or has prescribed
    /// motion.
    pub bodies: [Option<u32>; 2],
    /// The contact frame `E`: the normal from the first body to the second, and two tangents, as rows. With
    /// anisotropic friction, the length of the second tangent is the ratio of the coefficients in both directions.
    pub frame: Matrix3<f64>,
    /// The position of the contact point, in world coordinates.
    pub position: Vector3<f64>,
    /// The lever arms from the bodies' centres of mass to the contact point.
    pub arms: [Vector3<f64>; 2],
    /// Whether the contact's impulses are angular: for the stop of a hinge, whose gap is an angle about the normal in
    /// radians, and for the torque of a contact patch.
    pub turns: bool,
    /// The role in the contact law: a contact at a point, or the force or the torque of a contact patch. The torque
    /// of a patch follows its force in the list of contacts; the rows of its frame are the axes of drilling and
    /// rolling, with the length of a radius of gyration.
    pub role: Role,
    /// The reference length for the contact's gap: the size of the smaller body, or one radian for angles.
    pub size: f64,
    /// The gap between the bodies' surfaces at the beginning of the step.
    pub gap: f64,
    /// The contact law of the pair of bodies: friction and restitution.
    pub law: Law,
    /// The contribution `b` of bodies with prescribed motion to the relative velocity `u` at the contact, averaged over
    /// the step.
    pub surface: Vector3<f64>,
    /// The identity of the contact: the indices of both bodies and the identity number of the contact point.
    pub key: (u32, u32, u64),
    /// The index of the smooth part (face, edge or vertex) of the surface that a sphere touches.
    pub feature: u32,
    /// The normal and tangential impulses of the contact; the initial guess is the impulse of the last step.
    pub impulse: Vector3<f64>,
    /// The relative velocity `u` at the contact at the end of the last step, before forces act.
    pub before: Vector3<f64>,
    /// A bias that is added to the contact's normal velocity without contact impulses.
    pub bias: f64,
    /// The tolerance below which the gap of the contact counts as closed.
    pub no_gap: f64,
    /// The gap of the contact at the end of the step, predicted from velocities.
    pub gap_at_end: f64,
    /// The work of the contact over the step by normal and tangential components, in joules.
    pub work: Vector3<f64>,
    /// The difference by which the normal velocity after an impact falls short of the velocity that Newton's impact
    /// law requires.
    pub lacks: f64,
}

impl Contact {
    /// Builds the contact between two bodies at a detected contact point, with the given contact frame.
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

    /// Returns the relative velocity `u` at the contact for given velocities and angular velocities `(v, w)` of the
    /// bodies.
    pub fn velocity(&self, of: impl Fn(u32) -> (Vector3<f64>, Vector3<f64>)) -> Vector3<f64> {
        self.surface + self.change(of)
    }

    /// Returns the change of the relative velocity `u` at the contact for given changes of the velocities and angular
    /// velocities `(v, w)` of the bodies.
    pub fn change(&self, of: impl Fn(u32) -> (Vector3<f64>, Vector3<f64>)) -> Vector3<f64> {
        let at = |side: usize| {
            self.bodies[side].map_or_else(Vector3::zeros, |body| {
                let (v, w) = of(body);
                if self.turns { w } else { v + w.cross(&self.arms[side]) }
            })
        };
        self.frame * (at(1) - at(0))
    }

    /// Returns the frictionless contact for position correction, in which velocities stand for displacements, and
    /// penetration becomes a bias.
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

    /// Returns the force and the torque of a contact on a patch; `turning` are the angular velocities of both bodies
    /// if they are prescribed, else zero. The rows of the torque have the length of a mean radius of gyration of both
    /// bodies, so that they weigh in the contact law as the rows of the force do, however small or large the patch
    /// is.
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

    /// Returns whether the contact is the torque of a contact patch.
    pub fn is_torque(&self) -> bool {
        self.role == Role::Torque
    }

    /// Adds the surface velocities of bodies with prescribed motion to the relative velocity at the contact.
    pub fn carried(self, surfaces: [Vector3<f64>; 2]) -> Self {
        let surface = self.frame * (surfaces[1] - surfaces[0]);
        Self { surface, before: self.before + surface, ..self }
    }

    /// Predicts the gap of the contact at the end of a step of size `h` with the given mean velocities of the bodies.
    pub fn foresee(&mut self, h: f64, of: impl Fn(u32) -> (Vector3<f64>, Vector3<f64>)) {
        // The torque of a contact patch has no gap of its own; the patch is closed if the contact with its force is
        // closed.
        self.gap_at_end = if self.is_torque() { f64::INFINITY } else { self.gap + h * self.velocity(of).x };
    }

    /// Returns the slip speed of the contact for a relative velocity `u` in the contact frame.
    pub fn slip_speed(&self, u: &Vector3<f64>) -> f64 {
        u.y.hypot(if self.law.grain.is_some() { u.z / self.frame.row(2).norm() } else { u.z })
    }

    /// Returns the components, in the contact frame, of an impulse given in world axes.
    pub fn components(&self, impulse: &Vector3<f64>) -> Vector3<f64> {
        let mut components = self.frame * impulse;
        if self.law.grain.is_some() || self.is_torque() {
            for (i, component) in components.iter_mut().enumerate() {
                *component /= self.frame.row(i).norm_squared();
            }
        }
        components
    }

    /// Returns whether the contact is a stop of a joint.
    pub fn is_stop(&self) -> bool {
        self.key.2 >= STOPS
    }

    /// Returns whether the contact is open at the beginning of the step and closes with an impulse within it.
    pub fn strikes(&self) -> bool {
        !self.is_torque() && self.impulse.x > 0.0 && self.gap > self.no_gap
    }

    /// Returns the time from the beginning of the step until the gap of the contact closes at the initial approach
    /// velocity; infinite without an approach.
    pub fn closes_after(&self) -> f64 {
        if self.before.x < 0.0 { self.gap / -self.before.x } else { f64::INFINITY }
    }

    /// Returns whether the contact is closed at the end of the step.
    pub fn stays_closed(&self) -> bool {
        self.gap_at_end <= self.no_gap
    }

    /// Returns the contribution to `J^T r` of one side of the contact, with the contact Jacobian `J`: the impulse and
    /// the angular impulse of the contact impulse `r` on the body.
    pub fn wrench(&self, side: usize, r: &Vector3<f64>) -> (Vector3<f64>, Vector3<f64>) {
        let impulse = self.frame.tr_mul(r) * if side == 0 { -1.0 } else { 1.0 };
        if self.turns {
            return (Vector3::zeros(), impulse);
        }
        (impulse, self.arms[side].cross(&impulse))
    }

    /// Returns the block `A` of the contact Jacobian `J` for the angular velocity of the body on one side:
    /// `u = +-(E v + A w)`, `A = -E [r]x`, with the contact frame `E` and the lever arm `r`.
    pub fn angular(&self, side: usize) -> Matrix3<f64> {
        if self.turns { self.frame } else { -self.frame * self.arms[side].cross_matrix() }
    }
}

/// Sets `marked` for the torque of each contact patch whose force is marked, where forces precede their torques.
pub(super) fn mark_torques(contacts: &[Contact], marked: &mut [bool]) {
    for k in 1..marked.len() {
        if contacts[k].is_torque() {
            marked[k] = marked[k - 1];
        }
    }
}

/// Returns the contact frame for a normal, with normal and tangents as rows. The first tangent is the projection of
/// the x axis onto the tangent plane (of the y axis if the normal is nearly the x axis), so that the frame varies
/// smoothly while a body rotates and is aligned with the user's axes.
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
