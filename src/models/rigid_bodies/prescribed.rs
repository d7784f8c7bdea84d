//! Bodies whose motion is given: they push others, and nothing pushes them.

use super::signals::{SignalStep, Signals};
use nalgebra::{Isometry3, UnitQuaternion, Vector3};

/// A motion as functions of time, by their places among those of the scene.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Prescription {
    /// How the origin of its frame moves.
    pub linear: Option<Linear>,
    /// The angular velocity in the world.
    pub angular: Option<[usize; 3]>,
}

/// How a point moves.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Linear {
    /// By its place.
    Position([usize; 3]),
    /// By its velocity.
    Velocity([usize; 3]),
}

/// A prescribed body within a step: where it is, where it comes to, and its mean velocities.
#[derive(Clone, Copy, Debug)]
pub struct Prescribed {
    /// Its place in the scene.
    pub body: usize,
    /// The pose at the start of the step, then at its end.
    pub pose: Isometry3<f64>,
    /// The pose at the end.
    pub end: Isometry3<f64>,
    /// In the mean of the step.
    pub velocity: Vector3<f64>,
    /// Likewise.
    pub omega: Vector3<f64>,
}

impl Prescription {
    /// The pose at the end of a step: a turn is the exponential of the integral of the angular velocity, which is exact about an
    /// axis that stays and of second order else.
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
    /// A body at rest at its start.
    pub fn new(body: usize, pose: Isometry3<f64>) -> Self {
        Self { body, pose, end: pose, velocity: Vector3::zeros(), omega: Vector3::zeros() }
    }

    /// Begins a step of length `h` at a time.
    pub fn begin(&mut self, by: &Prescription, signals: &Signals, t: f64, h: f64) {
        self.end = by.end(&self.pose, &signals.over(t, h));
        self.velocity = (self.end.translation.vector - self.pose.translation.vector) / h;
        self.omega = (self.end.rotation * self.pose.rotation.inverse()).scaled_axis() / h;
    }

    /// The mean velocity of its point at a place at the start of the step.
    pub fn velocity_at(&self, place: &Vector3<f64>) -> Vector3<f64> {
        self.velocity + self.omega.cross(&(place - self.pose.translation.vector))
    }
}
