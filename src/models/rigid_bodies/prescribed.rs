//! Bodies with prescribed motion: they act on other bodies, but are not acted upon.

use super::signals::{SignalStep, Signals};
use nalgebra::{Isometry3, UnitQuaternion, Vector3};

/// A prescribed motion; functions of time are given by their index among the signals of the multibody system.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Prescription {
    /// The motion of the origin of the body's frame; at rest if `None`.
    pub linear: Option<Linear>,
    /// The angular velocity in world axes; zero if `None`.
    pub angular: Option<[usize; 3]>,
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
        let turn = self.angular.map_or_else(Vector3::zeros, |of| at(&course.integrals, of));
        let rotation = UnitQuaternion::from_scaled_axis(turn) * from.rotation;
        Isometry3::from_parts(position.into(), UnitQuaternion::new_normalize(rotation.into_inner()))
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

    /// The mean velocity of the material point that is at `place` at the beginning of the step.
    pub fn velocity_at(&self, place: &Vector3<f64>) -> Vector3<f64> {
        self.velocity + self.omega.cross(&(place - self.pose.translation.vector))
    }
}
