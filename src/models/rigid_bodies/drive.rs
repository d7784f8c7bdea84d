//! What acts along the one coordinate that a hinge or a slider leaves, or along the distance of two points: springs, dampers,
//! motors and servos, as one more equation between its impulse `L` and the change of the coordinate over a step.
//!
//! A motor that prescribes the coordinate asks for `c = 0` at the end of a step, as joints do, with `c` the deviation from what it
//! prescribes. Everything else is a law of force in the means of the step, with the coordinate `s` and its change `d`,
//!
//! ```text
//! F = effort + k (target - s - d/2) + b (rate - d/h),    L G h = h F d / c
//! ```
//!
//! where `c` is the change as the bilinear equation has it: `d` of a distance, `sin d` of an angle. So `F d` is the work of the
//! force exactly, what a spring holds is `k (s - rest)^2 / 2` to rounding, and a damper takes `b d^2 / h`, whatever the step.

use super::frame::Frame;
use super::joint::{Alpha, Beta, Equation};
use super::signals::SignalStep;
use nalgebra::Vector3;

/// The largest change of an angle within a step, in radians: the sine must tell it, and beyond a right angle it does not; nor
/// does a step with such a change resolve a motion.
const MOST_ANGLE: f64 = 1.0;

/// A coordinate between two bodies.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Coordinate {
    /// The angle by which a direction of the first body is turned from the first to the second of two directions of the second.
    Angle {
        /// In the first body.
        first: Vector3<f64>,
        /// In the second: a right angle apart.
        second: [Vector3<f64>; 2],
    },
    /// How far the anchor of the first body is along a direction of the second.
    Distance(Vector3<f64>),
    /// The distance of the anchors.
    Length,
}

/// What acts along a coordinate.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Drive {
    /// The coordinate.
    pub coordinate: Coordinate,
    /// How.
    pub law: DriveLaw,
    /// Where it ends.
    pub limits: Limits,
}

/// The ends of a coordinate: stops of a joint, which act as contacts without friction do.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Limits {
    /// The least value.
    pub lower: f64,
    /// The greatest.
    pub upper: f64,
    /// Of Newton's law, from 0 to 1.
    pub restitution: f64,
}

impl Limits {
    /// No ends.
    pub const NONE: Self = Self { lower: f64::NEG_INFINITY, upper: f64::INFINITY, restitution: 0.0 };
}

/// How a drive acts. Functions of time are places among those of the scene.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum DriveLaw {
    /// The coordinate is this function.
    Position(usize),
    /// Its rate is this function.
    Velocity(usize),
    /// A force by a law.
    Force(ForceLaw),
}

/// A law of force along a coordinate.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct ForceLaw {
    /// Newtons a metre, or newton metres a radian.
    pub stiffness: f64,
    /// Newton seconds a metre, or newton metre seconds a radian.
    pub damping: f64,
    /// The coordinate at which the spring has no force.
    pub rest: f64,
    /// What a servo moves it to instead, by stiffness and damping of its own and with no more force than this.
    pub servo: Option<Servo>,
    /// A force besides.
    pub effort: Option<usize>,
}

/// A force towards a target that moves.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Servo {
    /// The function that it follows.
    pub target: usize,
    /// As of a spring.
    pub stiffness: f64,
    /// Against the rate of the target.
    pub damping: f64,
    /// The largest force, infinite where there is no bound.
    pub most: f64,
}

/// A drive from step to step.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct DriveState {
    /// The coordinate, with all turns of an angle.
    pub coordinate: f64,
    /// What a motor with a given rate has come to.
    pub target: f64,
}

/// A drive within one step.
#[derive(Clone, Copy, Debug, Default)]
pub struct Driving {
    /// The coordinate at the start.
    pub start: f64,
    /// The coordinate that the equation is zero at: what a motor prescribes at the end of the step, else that of the start.
    pub reference: f64,
    /// What a motor prescribes of the rate at the end.
    pub rate: f64,
    /// Target and rate of a servo in the mean of the step, and an effort.
    servo: [f64; 2],
    effort: f64,
}

/// What a drive did over a step, in joules.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Done {
    /// The work of motors, servos and efforts.
    pub drives: f64,
    /// What dampers took.
    pub damped: f64,
}

/// A law of force at a change of its coordinate.
struct At {
    force: f64,
    /// The derivative of the force by the change.
    slope: f64,
    damper: f64,
    /// The part that is neither a spring nor a damper.
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
    /// Whether it prescribes the coordinate.
    pub fn prescribes(&self) -> bool {
        !matches!(self.law, DriveLaw::Force(_))
    }

    /// The equation for a reference; none of a distance of points, which is not bilinear.
    pub(super) fn equation(&self, reference: f64) -> Option<Equation> {
        match self.coordinate {
            Coordinate::Angle { first, second: [along, across] } => {
                let alpha = across * reference.cos() - along * reference.sin();
                Some(Equation { alpha: Alpha::Second(alpha), beta: Beta::First(first) })
            }
            Coordinate::Distance(axis) => Some(Equation { alpha: Alpha::Second(axis), beta: Beta::Apart }),
            Coordinate::Length => None,
        }
    }

    /// The part of the value of the equation that no bodies make: distances are less their reference, angles are turned by it.
    pub fn offset(&self, reference: f64) -> f64 {
        if matches!(self.coordinate, Coordinate::Distance(_)) { reference } else { 0.0 }
    }

    /// The coordinate in frames, an angle as near to `near` as turns make it; `apart` is the difference of the anchors.
    pub fn value(&self, [first_frame, second_frame]: [&Frame; 2], apart: &Vector3<f64>, near: f64) -> f64 {
        match self.coordinate {
            Coordinate::Angle { first, second: [along, across] } => {
                let of = first_frame.axes * first;
                let angle = (second_frame.axes * across).dot(&of).atan2((second_frame.axes * along).dot(&of));
                angle + std::f64::consts::TAU * ((near - angle) / std::f64::consts::TAU).round()
            }
            Coordinate::Distance(axis) => (second_frame.axes * axis).dot(apart),
            Coordinate::Length => apart.norm(),
        }
    }

    /// What it does over a step from this state, with the coordinate as it is at the start.
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
                driving.effort = law.effort.map_or(0.0, |signal| course.middle[signal]);
                if let Some(servo) = &law.servo {
                    let (from, to) = (course.start[servo.target], course.end[servo.target]);
                    driving.servo = [course.middle[servo.target], (to - from) / course.h];
                }
            }
        }
        driving
    }

    /// The change of the coordinate for a value of the equation, and its derivative; none for what the equation does not tell.
    fn change(&self, c: f64) -> Option<(f64, f64)> {
        if !matches!(self.coordinate, Coordinate::Angle { .. }) {
            return Some((c, 1.0));
        }
        (c.abs() < MOST_ANGLE.sin()).then(|| (c.asin(), 1.0 / (1.0 - c * c).sqrt()))
    }

    /// The law of force about a value of the equation and an impulse, as `slope dc/h + weight dL = -rest`; none if the step is
    /// too long for it.
    pub fn linearise(&self, driving: &Driving, c: f64, impulse: f64, h: f64) -> Option<[f64; 3]> {
        let DriveLaw::Force(law) = &self.law else { return Some([1.0, 0.0, c / h]) };
        let (change, by_c) = self.change(c)?;
        // sin d / d, and its derivative by c.
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

    /// The state at the end of a step, and what was done in it; `c` is the value of the equation there, and `work` that of the
    /// impulse over the step.
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

    /// What takes energy by the rate of the coordinate: dampers, and servos.
    pub fn damping(&self) -> f64 {
        match &self.law {
            DriveLaw::Force(law) => law.damping + law.servo.map_or(0.0, |servo| servo.damping),
            _ => 0.0,
        }
    }

    /// What the spring holds, in joules.
    pub fn potential(&self, coordinate: f64) -> f64 {
        match &self.law {
            DriveLaw::Force(law) => 0.5 * law.stiffness * (coordinate - law.rest).powi(2),
            _ => 0.0,
        }
    }

    /// The force along the coordinate that an impulse and the value of the equation at the end of a step make, in its mean.
    pub fn force(&self, c: f64, impulse: f64, h: f64) -> f64 {
        let ratio = self.change(c).filter(|(change, _)| *change != 0.0).map_or(1.0, |(change, _)| c / change);
        impulse * ratio / h
    }
}
