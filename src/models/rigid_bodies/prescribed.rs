//! Bodies with prescribed motion: they act on other bodies, but are not acted upon. A rotation vector `r(t)` turns a body
//! by `exp([r]x)`, with the angular velocity
//!
//! ```text
//! w = r' + (1 - cos a)/a^2 r x r' + (a - sin a)/a^3 r x (r x r'),    a = |r|
//! ```
//!
//! (Bullo and Murray 1995, *Proportional derivative control on the Euclidean group*).

use super::frame::Frame;
use super::signals::{SignalStep, Signals};
use nalgebra::{Isometry3, UnitQuaternion, Vector3};

/// A prescribed motion; functions of time are given by their index among the signals of the multibody system.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Prescription {
    /// The motion of the origin of the body's frame; at rest if `None`.
    pub linear: Option<Linear>,
    /// The rotation; none if `None`.
    pub angular: Option<Angular>,
}

/// A prescribed rotation.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Angular {
    /// The angular velocity in world axes is given.
    Velocity([usize; 3]),
    /// The rotation vector is given, which turns the body from an orientation.
    Rotation([usize; 3], UnitQuaternion<f64>),
}

/// The prescribed motion of a point.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Linear {
    /// The position is given.
    Position([usize; 3]),
    /// The velocity is given.
    Velocity([usize; 3]),
}

/// A body with prescribed motion within a step.
#[derive(Clone, Copy, Debug)]
pub struct Prescribed {
    /// The index of the body.
    pub body: usize,
    /// The pose at the beginning of the step; set to `end` after the step.
    pub pose: Isometry3<f64>,
    /// The pose at the end of the step.
    pub end: Isometry3<f64>,
    /// The mean velocity of the step.
    pub velocity: Vector3<f64>,
    /// The mean angular velocity of the step.
    pub omega: Vector3<f64>,
}

impl Prescription {
    /// The pose at the end of a step. The rotation is the exponential of the integral of the angular velocity: exact
    /// for a constant axis, otherwise of second order.
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
    /// The velocity of the origin of the frame and the angular velocity, from the values and the rates of all signals.
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

/// The rotation vector below which the series replaces quotients that cancel, in radians: its next terms are of the size
/// of rounding.
const SMALL: f64 = 1e-2;

/// The angular velocity of a rotation vector `r` with the rate `rate`.
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

/// A body with prescribed motion, from the beginning of a step on: what joints hold on to.
#[derive(Clone, Copy, Debug)]
pub struct Ground {
    /// The time at the beginning of the step.
    pub t: f64,
    /// The pose at the beginning of the step.
    pub pose: Isometry3<f64>,
    /// The prescribed motion.
    pub by: Prescription,
}

/// The second body of a joint that does not move by its mass, over a part of a step.
#[derive(Clone, Copy, Debug)]
pub struct Grounding {
    /// The frame at the beginning of the part.
    pub start: Frame,
    /// The mean frame.
    pub mean: Frame,
    /// The frame at the end.
    pub end: Frame,
    /// The velocity and the angular velocity in the mean of the part.
    pub velocities: (Vector3<f64>, Vector3<f64>),
    /// The velocity and the angular velocity at the end.
    pub at_end: (Vector3<f64>, Vector3<f64>),
}

impl Grounding {
    /// The world.
    pub const WORLD: Self = Self {
        start: Frame::WORLD,
        mean: Frame::WORLD,
        end: Frame::WORLD,
        velocities: (Vector3::new(0.0, 0.0, 0.0), Vector3::new(0.0, 0.0, 0.0)),
        at_end: (Vector3::new(0.0, 0.0, 0.0), Vector3::new(0.0, 0.0, 0.0)),
    };
}

impl Ground {
    /// The motion over a part of the step, of length `h` from the time `t`.
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
    /// The body at its initial pose, with zero velocities.
    pub fn new(body: usize, pose: Isometry3<f64>) -> Self {
        Self { body, pose, end: pose, velocity: Vector3::zeros(), omega: Vector3::zeros() }
    }

    /// Sets end pose and mean velocities for a step of length `h` from time `t`.
    pub fn begin(&mut self, by: &Prescription, signals: &Signals, t: f64, h: f64) {
        self.end = by.end(&self.pose, &signals.over(t, h));
        self.velocity = (self.end.translation.vector - self.pose.translation.vector) / h;
        self.omega = (self.end.rotation * self.pose.rotation.inverse()).scaled_axis() / h;
    }

    /// Sets the pose and the velocities of a time `passed` after `t`, when the pose was `from`.
    pub fn at(&mut self, by: &Prescription, signals: &Signals, from: &Isometry3<f64>, [t, passed]: [f64; 2]) {
        self.pose = if passed > 0.0 { by.end(from, &signals.over(t, passed)) } else { *from };
        self.end = self.pose;
        let (values, rates) = signals.at(t + passed);
        (self.velocity, self.omega) = by.velocities(&values, &rates);
    }

    /// The mean velocity of the material point that is at `place` at the beginning of the step.
    pub fn velocity_at(&self, place: &Vector3<f64>) -> Vector3<f64> {
        self.velocity + self.omega.cross(&(place - self.pose.translation.vector))
    }
}
