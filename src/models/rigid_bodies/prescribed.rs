//! Bodies with prescribed motion: they act on other bodies, but are not acted upon. A rotation vector `r(t)` turns a
//! body by `exp([r]x)`, with the angular velocity
//!
//! ```text
//! w = r' + (1 - cos a)/a^2 r x r' + (a - sin a)/a^3 r x (r x r'),    a = |r|
//! ```
//!
//! (Bullo and Murray 1995, *Proportional derivative control on the Euclidean group*).

use super::frame::Frame;
use super::signals::{SignalStep, Signals};
use nalgebra::{Isometry3, UnitQuaternion, Vector3};

/// The prescribed motion of a body; functions of time are given by their index among the signals of the multibody
/// system.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Prescription {
    /// The prescribed motion of the origin of the body frame; `None` if the origin is at rest.
    pub linear: Option<Linear>,
    /// The prescribed rotation of the body; `None` if it does not rotate.
    pub angular: Option<Angular>,
}

/// The prescribed rotation of a body.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Angular {
    /// The angular velocity of the body in world axes, as indices of signals (functions of time).
    Velocity([usize; 3]),
    /// The rotation vector of the body, as indices of signals, and the orientation from which it turns the body.
    Rotation([usize; 3], UnitQuaternion<f64>),
}

/// The prescribed motion of the origin of the body frame.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Linear {
    /// The position of the origin of the body frame, as indices of signals (functions of time).
    Position([usize; 3]),
    /// The velocity of the origin of the body frame, as indices of signals (functions of time).
    Velocity([usize; 3]),
}

/// The state of a body with prescribed motion within a time step.
#[derive(Clone, Copy, Debug)]
pub struct Prescribed {
    /// The index of the body in the multibody system.
    pub body: usize,
    /// The pose of the body at the beginning of the step, which is replaced by `end` after the step.
    pub pose: Isometry3<f64>,
    /// The pose of the body at the end of the step.
    pub end: Isometry3<f64>,
    /// The mean velocity of the body frame's origin over the step.
    pub velocity: Vector3<f64>,
    /// The mean angular velocity of the body over the step.
    pub omega: Vector3<f64>,
}

impl Prescription {
    /// Returns the prescribed pose at the end of a step. The rotation is the exponential of the integral of the angular
    /// velocity: exact for a constant axis, otherwise of second order.
    fn end(&self, from: &Isometry3<f64>, course: &SignalStep) -> Isometry3<f64> {
        let at = |values: &[f64], of: [usize; 3]| Vector3::from(of.map(|function| values[function]));
        let start = from.translation.vector;
        let position = match self.linear {
            None => start,
            Some(Linear::Position(of)) => at(&course.end, of),
            Some(Linear::Velocity(of)) => start + at(&course.integrals, of),
        };
        let turned = |by: Vector3<f64>, from: &UnitQuaternion<f64>| UnitQuaternion::from_scaled_axis(by) * from;
        let rotation = match &self.angular {
            None => from.rotation,
            Some(Angular::Velocity(of)) => turned(at(&course.integrals, *of), &from.rotation),
            Some(Angular::Rotation(of, base)) => turned(at(&course.end, *of), base),
        };
        Isometry3::from_parts(position.into(), UnitQuaternion::new_normalize(rotation.into_inner()))
    }
}

impl Prescription {
    /// Returns the prescribed velocity of the origin of the body frame and the angular velocity, from the values and
    /// the rates of all signals.
    pub fn velocities(&self, values: &[f64], rates: &[f64]) -> (Vector3<f64>, Vector3<f64>) {
        let at = |values: &[f64], of: &[usize; 3]| Vector3::from(of.map(|function| values[function]));
        let velocity = match &self.linear {
            None => Vector3::zeros(),
            Some(Linear::Position(of)) => at(rates, of),
            Some(Linear::Velocity(of)) => at(values, of),
        };
        let omega = match &self.angular {
            None => Vector3::zeros(),
            Some(Angular::Velocity(of)) => at(values, of),
            Some(Angular::Rotation(of, _)) => angular_velocity(&at(values, of), &at(rates, of)),
        };
        (velocity, omega)
    }
}

/// Length of the rotation vector, in radians, below which a Taylor series replaces the quotients of the angular
/// velocity that suffer from cancellation: the truncated terms are at rounding level.
const SMALL: f64 = 1e-2;

/// Returns the angular velocity of a body whose rotation vector is `r` with the time derivative `rate`.
fn angular_velocity(r: &Vector3<f64>, rate: &Vector3<f64>) -> Vector3<f64> {
    let a = r.norm();
    let [first, second] = if a < SMALL {
        let s = a * a;
        [0.5 - s / 24.0 * (1.0 - s / 30.0), 1.0 / 6.0 - s / 120.0 * (1.0 - s / 42.0)]
    } else {
        [(1.0 - a.cos()) / (a * a), (a - a.sin()) / (a * a * a)]
    };
    let across = r.cross(rate);
    rate + across * first + r.cross(&across) * second
}

/// A body with prescribed motion to which joints are attached, with its pose at the beginning of a step.
#[derive(Clone, Copy, Debug)]
pub struct Ground {
    /// The time at the beginning of the step, to which the pose belongs.
    pub t: f64,
    /// The pose of the body at the beginning of the step.
    pub pose: Isometry3<f64>,
    /// The prescribed motion of the body.
    pub by: Prescription,
}

/// The motion, over a part of a step, of the second body of a joint if that body has prescribed motion or is the
/// world.
#[derive(Clone, Copy, Debug)]
pub struct Grounding {
    /// The frame of the body at the beginning of the part of the step.
    pub start: Frame,
    /// The mean frame of the body over the part of the step.
    pub mean: Frame,
    /// The frame of the body at the end of the part of the step.
    pub end: Frame,
    /// The mean velocity and the mean angular velocity of the body over the part of the step.
    pub velocities: (Vector3<f64>, Vector3<f64>),
    /// The velocity and the angular velocity of the body at the end of the part of the step.
    pub at_end: (Vector3<f64>, Vector3<f64>),
}

impl Grounding {
    /// The motion of the world, which is at rest.
    pub const WORLD: Self = Self {
        start: Frame::WORLD,
        mean: Frame::WORLD,
        end: Frame::WORLD,
        velocities: (Vector3::new(0.0, 0.0, 0.0), Vector3::new(0.0, 0.0, 0.0)),
        at_end: (Vector3::new(0.0, 0.0, 0.0), Vector3::new(0.0, 0.0, 0.0)),
    };
}

impl Ground {
    /// Returns the prescribed motion of the body over a part of the step, of length `h` from the time `t`.
    pub fn over(&self, t: f64, h: f64, signals: &Signals) -> Grounding {
        let pose = |until: f64| {
            if until > self.t { self.by.end(&self.pose, &signals.over(self.t, until - self.t)) } else { self.pose }
        };
        let (from, to) = (pose(t), pose(t + h));
        let (values, rates) = signals.at(t + h);
        let (start, end) = (Frame::of(&from), Frame::of(&to));
        let at_end = self.by.velocities(&values, &rates);
        let velocities = if h > 0.0 {
            let turn = (to.rotation * from.rotation.inverse()).scaled_axis();
            ((to.translation.vector - from.translation.vector) / h, turn / h)
        } else {
            at_end
        };
        Grounding { start, mean: start.mean(&end), end, velocities, at_end }
    }
}

impl Prescribed {
    /// Returns the state of a body with prescribed motion at its initial pose, with zero velocities.
    pub fn new(body: usize, pose: Isometry3<f64>) -> Self {
        Self { body, pose, end: pose, velocity: Vector3::zeros(), omega: Vector3::zeros() }
    }

    /// Sets the end pose and the mean velocities of the body for a step of length `h` from time `t`.
    pub fn begin(&mut self, by: &Prescription, signals: &Signals, t: f64, h: f64) {
        self.end = by.end(&self.pose, &signals.over(t, h));
        self.velocity = (self.end.translation.vector - self.pose.translation.vector) / h;
        self.omega = (self.end.rotation * self.pose.rotation.inverse()).scaled_axis() / h;
    }

    /// Sets the pose and the velocities of the body at time `t + passed`, given the pose `from` at time `t`.
    pub fn at(&mut self, by: &Prescription, signals: &Signals, from: &Isometry3<f64>, [t, passed]: [f64; 2]) {
        self.pose = if passed > 0.0 { by.end(from, &signals.over(t, passed)) } else { *from };
        self.end = self.pose;
        let (values, rates) = signals.at(t + passed);
        (self.velocity, self.omega) = by.velocities(&values, &rates);
    }

    /// Returns the mean velocity over the step of the material point of the body that is at `place` at the beginning of
    /// the step.
    pub fn velocity_at(&self, place: &Vector3<f64>) -> Vector3<f64> {
        self.velocity + self.omega.cross(&(place - self.pose.translation.vector))
    }
}
