//! Drives: springs, dampers, motors and servos along the free coordinate of a hinge or a slider, or along the
//! distance between two points. A drive adds one equation between its impulse `L` and the change of the coordinate
//! over a step.
//!
//! A motor that prescribes the coordinate requires `c = 0` at the end of a step, as joints do, where `c` is the
//! deviation from the prescribed value. All other drives are force laws, averaged over the step, with the coordinate
//! `s` and its change `d`,
//!
//! ```text
//! F = effort + k (target - s - d/2) + b (rate - d/h),    L G h = h F d / c
//! ```
//!
//! where `c` is the value of the bilinear equation: `d` for a distance, `sin d` for an angle. For any step size, `F d`
//! is exactly the work of the force, the energy of a spring is `k (s - rest)^2 / 2` up to rounding, and the dissipation
//! of a damper is `b d^2 / h`.

use super::frame::Frame;
use super::joint::{Alpha, Beta, Equation};
use super::signals::SignalStep;
use nalgebra::Vector3;

/// Maximum change of a drive's angle within a step, in radians. The change is computed from its sine, which is not
/// unique beyond a right angle; a step with a larger change does not resolve the motion either.
const MOST_ANGLE: f64 = 1.0;

/// The scalar coordinate of a joint or spring along which a drive acts: an angle or a distance between two bodies.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Coordinate {
    /// The angle of a direction fixed in the first body, measured in the plane of two orthogonal directions of the
    /// second body, from the first of the two towards the second.
    Angle {
        /// The direction fixed in the first body, in its frame.
        first: Vector3<f64>,
        /// The two orthogonal directions fixed in the second body, in its frame.
        second: [Vector3<f64>; 2],
    },
    /// The displacement of the first body's anchor from the second body's anchor, along a direction of the second body.
    Distance(Vector3<f64>),
    /// The distance between the anchors of the joint on both bodies, as for a spring.
    Length,
    /// The scalar product of a direction of the first body and a direction of the second, which are orthogonal
    /// without relative rotation: the sine of a small rotation about the third direction.
    Product {
        /// The direction fixed in the first body, in its frame.
        first: Vector3<f64>,
        /// The direction fixed in the second body, in its frame.
        second: Vector3<f64>,
    },
}

/// A drive (motor, servo, spring or damper) along a coordinate between two bodies.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Drive {
    /// The coordinate between two bodies along which the drive acts.
    pub coordinate: Coordinate,
    /// The law of the drive: a prescribed motion or a force law.
    pub law: DriveLaw,
    /// The limits of the coordinate of the drive, given by stops.
    pub limits: Limits,
}

/// The limits of the coordinate of a joint: stops, which act as frictionless contacts.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Limits {
    /// The smallest value of the joint coordinate that the stops admit.
    pub lower: f64,
    /// The largest value of the joint coordinate that the stops admit.
    pub upper: f64,
    /// The coefficient of restitution of the stops in Newton's impact law, from 0 to 1.
    pub restitution: f64,
}

impl Limits {
    /// The limits of a joint coordinate without stops, which are infinite.
    pub const NONE: Self = Self { lower: f64::NEG_INFINITY, upper: f64::INFINITY, restitution: 0.0 };
}

/// The law of a drive: prescribed motion or force. Functions of time are given by their index among the signals of the
/// multibody system.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum DriveLaw {
    /// The drive's coordinate is a prescribed function of time, the signal with this index.
    Position(usize),
    /// The rate of the drive's coordinate is a prescribed function of time, the signal with this index.
    Velocity(usize),
    /// The force along the drive's coordinate follows a force law.
    Force(ForceLaw),
}

/// The force law of a drive along its coordinate: spring, damper, servo and an additional force.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct ForceLaw {
    /// The stiffness of the drive's spring, in newtons per metre or newton metres per radian.
    pub stiffness: f64,
    /// The coefficient of the drive's damper, in newton seconds per metre or newton metre seconds per radian.
    pub damping: f64,
    /// The value of the drive's coordinate at which the spring has no force.
    pub rest: f64,
    /// The servo of the drive, with its own stiffness and damping and a bound on its force; `None` without a servo.
    pub servo: Option<Servo>,
    /// The additional force of the drive, as the index of a signal; `None` without one.
    pub effort: Option<usize>,
}

/// A servo: a force towards a moving target value of the drive's coordinate.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Servo {
    /// The target value of the servo, as the index of a signal.
    pub target: usize,
    /// The stiffness of the servo, in newtons per metre or newton metres per radian.
    pub stiffness: f64,
    /// The damping coefficient of the servo, for the rate of the drive's coordinate relative to that of the target.
    pub damping: f64,
    /// The bound on the magnitude of the servo's force; infinite if unbounded.
    pub most: f64,
}

/// The state of a drive that is carried from step to step.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct DriveState {
    /// The value of the drive's coordinate; angles include full revolutions.
    pub coordinate: f64,
    /// The integral of the rate that a motor prescribes: the target value of the coordinate.
    pub target: f64,
}

/// The data of a drive that are fixed within one step.
#[derive(Clone, Copy, Debug, Default)]
pub struct Driving {
    /// The value of the drive's coordinate at the beginning of the step.
    pub start: f64,
    /// The value of the drive's coordinate at which the equation of the drive is zero: the value prescribed by a motor
    /// at the end of the step, otherwise the value at the beginning.
    pub reference: f64,
    /// The rate of the drive's coordinate prescribed by a motor at the end of the step.
    pub rate: f64,
    /// The mean target of a servo, and the mean rate of the target, over the step.
    servo: [f64; 2],
    /// The mean of the additional force of the drive over the step.
    effort: f64,
}

/// The energy exchanged by a drive over a step, in joules.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Done {
    /// The work of motors, servos and additional forces of the drive over the step.
    pub drives: f64,
    /// The energy dissipated by the dampers of the drive over the step.
    pub damped: f64,
}

/// The forces of a drive for a given change of the drive's coordinate over a step.
struct At {
    force: f64,
    /// The derivative of the drive's total force with respect to the change of the coordinate.
    slope: f64,
    damper: f64,
    /// The force of servo and additional force of the drive, without spring and damper.
    active: f64,
}

impl ForceLaw {
    fn at(&self, driving: &Driving, change: f64, h: f64) -> At {
        let damper = -self.damping * change / h;
        let spring = self.stiffness * (self.rest - driving.start - 0.5 * change);
        let (mut active, mut slope) = (driving.effort, -0.5 * self.stiffness - self.damping / h);
        if let Some(servo) = &self.servo {
            let [target, rate] = driving.servo;
            let force = servo.stiffness * (target - driving.start - 0.5 * change) + servo.damping * (rate - change / h);
            if force.abs() <= servo.most {
                slope -= 0.5 * servo.stiffness + servo.damping / h;
            }
            active += force.clamp(-servo.most, servo.most);
        }
        At { force: spring + damper + active, slope, damper, active }
    }
}

impl Drive {
    /// Returns whether the drive is a motor that prescribes the motion of its coordinate.
    pub fn prescribes(&self) -> bool {
        !matches!(self.law, DriveLaw::Force(_))
    }

    /// Returns the bilinear constraint equation of the drive for a reference value of its coordinate; `None` for the
    /// distance between two points, which is not bilinear.
    pub(super) fn equation(&self, reference: f64) -> Option<Equation> {
        match self.coordinate {
            Coordinate::Angle { first, second: [along, across] } => {
                let alpha = across * reference.cos() - along * reference.sin();
                Some(Equation { alpha: Alpha::Second(alpha), beta: Beta::First(first) })
            }
            Coordinate::Distance(axis) => Some(Equation { alpha: Alpha::Second(axis), beta: Beta::Apart }),
            Coordinate::Length => None,
            Coordinate::Product { first, second } => {
                Some(Equation { alpha: Alpha::Second(second), beta: Beta::First(first) })
            }
        }
    }

    /// Returns the constant to subtract from the bilinear form of the drive: the reference value of a distance or a
    /// product; zero for an angle, whose reference value is part of the form.
    pub fn offset(&self, reference: f64) -> f64 {
        if matches!(self.coordinate, Coordinate::Distance(_) | Coordinate::Product { .. }) { reference } else { 0.0 }
    }

    /// Returns the drive's coordinate for given frames of both bodies and the difference `apart` of the anchors; of the
    /// angles that differ by full revolutions, the one nearest to `near`.
    pub fn value(&self, [first_frame, second_frame]: [&Frame; 2], apart: &Vector3<f64>, near: f64) -> f64 {
        match self.coordinate {
            Coordinate::Angle { first, second: [along, across] } => {
                let of = first_frame.axes * first;
                let angle = (second_frame.axes * across).dot(&of).atan2((second_frame.axes * along).dot(&of));
                angle + std::f64::consts::TAU * ((near - angle) / std::f64::consts::TAU).round()
            }
            Coordinate::Distance(axis) => (second_frame.axes * axis).dot(apart),
            Coordinate::Length => apart.norm(),
            Coordinate::Product { first, second } => (second_frame.axes * second).dot(&(first_frame.axes * first)),
        }
    }

    /// Prepares the drive for a step that begins at the value `start` of its coordinate.
    pub fn begin(&self, start: f64, state: &DriveState, course: &SignalStep) -> Driving {
        let mut driving = Driving { start, reference: start, ..Driving::default() };
        match self.law {
            DriveLaw::Position(signal) => {
                (driving.reference, driving.rate) = (course.end[signal], course.rates[signal]);
            }
            DriveLaw::Velocity(signal) => {
                driving.reference = state.target + course.integrals[signal];
                driving.rate = course.end[signal];
            }
            DriveLaw::Force(law) => {
                driving.effort = law.effort.map_or(0.0, |signal| course.means[signal]);
                if let Some(servo) = &law.servo {
                    let (from, to) = (course.start[servo.target], course.end[servo.target]);
                    driving.servo = [course.means[servo.target], (to - from) / course.h];
                }
            }
        }
        driving
    }

    /// Returns the change of the drive's coordinate for a value `c` of the bilinear equation, and the derivative of the
    /// change; `None` if the change exceeds `MOST_ANGLE`.
    fn change(&self, c: f64) -> Option<(f64, f64)> {
        if !matches!(self.coordinate, Coordinate::Angle { .. }) {
            return Some((c, 1.0));
        }
        (c.abs() < MOST_ANGLE.sin()).then(|| (c.asin(), 1.0 / (1.0 - c * c).sqrt()))
    }

    /// Linearises the force law of the drive at a value `c` of the bilinear equation and an impulse `L`, as
    /// `slope dc/h + weight dL = -rest`; returns `[slope, weight, rest]`, or `None` if the step is too long.
    pub fn linearise(&self, driving: &Driving, c: f64, impulse: f64, h: f64) -> Option<[f64; 3]> {
        let DriveLaw::Force(law) = &self.law else { return Some([1.0, 0.0, c / h]) };
        let (change, by_c) = self.change(c)?;
        // The ratio `sin d / d` for the change `d` of the angle over the step, and its derivative with respect to
        // `c = sin d`.
        let (ratio, of_ratio) = if c == change {
            (1.0, 0.0)
        } else if change.abs() < 1e-4 {
            (1.0 - change * change / 6.0, -change / 3.0 * by_c)
        } else {
            (c / change, (1.0 - c / change * by_c) / change)
        };
        let at = law.at(driving, change, h);
        let slope = impulse * of_ratio - h * at.slope * by_c;
        Some([slope * h, ratio, impulse * ratio - h * at.force])
    }

    /// Returns the state of the drive at the end of a step and the energy exchanged in the step; `c` is the value of
    /// the bilinear equation at the end, and `work` is the work of the impulse over the step.
    pub fn end(&self, driving: &Driving, c: f64, work: f64, h: f64) -> (DriveState, Done) {
        let DriveLaw::Force(law) = &self.law else {
            let state = DriveState { coordinate: driving.reference, target: driving.reference };
            return (state, Done { drives: work, damped: 0.0 });
        };
        let change = self.change(c).map_or(0.0, |(change, _)| change);
        let at = law.at(driving, change, h);
        let coordinate = driving.start + change;
        let done = Done { drives: at.active * change, damped: -at.damper * change };
        (DriveState { coordinate, target: coordinate }, done)
    }

    /// Returns the total damping coefficient of the drive's damper and servo.
    pub fn damping(&self) -> f64 {
        match &self.law {
            DriveLaw::Force(law) => law.damping + law.servo.map_or(0.0, |servo| servo.damping),
            _ => 0.0,
        }
    }

    /// Returns the potential energy of the drive's spring at a coordinate, in joules.
    pub fn potential(&self, coordinate: f64) -> f64 {
        match &self.law {
            DriveLaw::Force(law) => 0.5 * law.stiffness * (coordinate - law.rest).powi(2),
            _ => 0.0,
        }
    }

    /// Returns the mean force of the drive along its coordinate over a step, from the impulse and the value `c` of the
    /// bilinear equation at the end of the step.
    pub fn force(&self, c: f64, impulse: f64, h: f64) -> f64 {
        let ratio = self.change(c).filter(|(change, _)| *change != 0.0).map_or(1.0, |(change, _)| c / change);
        impulse * ratio / h
    }
}
