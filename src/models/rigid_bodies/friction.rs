//! Friction between two materials beyond a constant isotropic coefficient: coefficients that vary, and anisotropy.
//!
//! The coefficient `mu` of a contact is evaluated at the end of the step, at the position of the contact at the
//! beginning of the step. With a direction `a` in the contact plane and a ratio `c` of the coefficient across `a` to
//! that along `a`, friction forces are in an ellipse,
//!
//! ```text
//! (r_1/mu)^2 + (r_2/(c mu))^2 <= r_n^2,    r_1 along a,    r_2 across
//! ```
//!
//! In coordinates `r_2/c`, with the velocity `c u_2`, the ellipse is the disk of Coulomb's law, with the same power
//! of the force; the second tangent of the contact frame is therefore multiplied by `c`.

use super::contact::frame;
use contact::law::admissible;
use expression::{IntervalWorkspace, Tape};
use nalgebra::{Isometry3, Matrix3, Vector3};
use numerics::Interval;

/// The number of inputs of a varying coefficient of friction besides time: the position of the contact, and the slip
/// speed.
pub const INPUTS: usize = 4;

/// A coefficient of friction that varies in time, with the position of the contact, or with the slip speed.
#[derive(Clone, Debug)]
pub struct Coefficient {
    /// The compiled expression of the coefficient of friction, with the inputs `t`, the position of the contact in
    /// world coordinates, and the slip speed. It has one output, or two outputs whose geometric mean is the
    /// coefficient.
    pub program: Tape,
    /// Whether the compiled expression of the coefficient of friction has two outputs.
    pub is_mean: bool,
}

impl Coefficient {
    /// Evaluates the coefficient of a contact.
    ///
    /// # Errors
    /// The value of the coefficient if it is negative or not finite.
    pub fn at(&mut self, t: f64, place: &Vector3<f64>, slip_speed: f64) -> Result<f64, f64> {
        let inputs: [f64; INPUTS] = [place.x, place.y, place.z, slip_speed];
        let mut out = [0.0; 2];
        let outputs = if self.is_mean { 2 } else { 1 };
        self.program.evaluate(t, &inputs, &mut out[..outputs]);
        let of = |mu: f64| admissible(mu).ok_or(mu);
        let first = of(out[0])?;
        if self.is_mean { Ok((first * of(out[1])?).sqrt()) } else { Ok(first) }
    }

    /// Encloses the coefficient of friction over an interval of time and a box of contact positions, at one slip speed.
    pub fn enclose(&self, t: Interval, place: &[Interval], slip_speed: f64, boxes: &mut IntervalWorkspace) -> Interval {
        let inputs = [place[0], place[1], place[2], Interval::point(slip_speed)];
        let mut out = [Interval::LINE; 2];
        let outputs = if self.is_mean { 2 } else { 1 };
        self.program.enclose(t, &inputs, boxes, &mut out[..outputs]);
        if self.is_mean { (out[0] * out[1]).sqrt() } else { out[0] }
    }
}

/// The axes in which the direction of anisotropic friction is fixed.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum AxesOfGrain {
    /// The direction of anisotropic friction is fixed in the axes of the world.
    World,
    /// The direction is fixed in the axes of the body with this material; if both bodies have it, of the body that
    /// comes first in the system.
    Material(usize),
    /// The direction is fixed in the axes of the body of the pair that comes first in the system.
    First,
}

/// The law of anisotropic friction, whose coefficient depends on the slip direction.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Grain {
    /// The direction to which the given coefficient of friction belongs, before projection onto the contact plane.
    pub along: Vector3<f64>,
    /// The axes in which the direction `along` of anisotropic friction is given.
    pub axes: AxesOfGrain,
    /// The coefficient of friction across the direction `along`, divided by that along it.
    pub ratio: f64,
}

/// The sine of the angle between the direction of anisotropic friction and the contact normal below which the
/// projection of the direction onto the contact plane is treated as zero.
const UPRIGHT: f64 = 1e-6;

impl Grain {
    /// Returns the frame of a contact with anisotropic friction: the normal and the first tangent have unit length, the
    /// second tangent has the length `ratio`.
    pub fn frame(&self, normal: &Vector3<f64>, materials: [usize; 2], poses: [&Isometry3<f64>; 2]) -> Matrix3<f64> {
        let along = match self.axes {
            AxesOfGrain::World => self.along,
            AxesOfGrain::Material(material) => poses[usize::from(materials[0] != material)].rotation * self.along,
            AxesOfGrain::First => poses[0].rotation * self.along,
        };
        let projected = along - normal * normal.dot(&along);
        let mut frame = match projected.try_normalize(UPRIGHT) {
            Some(first) => {
                Matrix3::from_rows(&[normal.transpose(), first.transpose(), normal.cross(&first).transpose()])
            }
            None => frame(normal),
        };
        frame.row_mut(2).scale_mut(self.ratio);
        frame
    }
}
