//! Friction between two materials beyond a constant coefficient: coefficients that vary, and directions.
//!
//! The coefficient of a contact is that at the end of the step, at the place of the contact at its beginning. With a
//! direction `a` in the contact plane and a ratio `c`, friction forces form an ellipse,
//!
//! ```text
//! (r_1/mu)^2 + (r_2/(c mu))^2 <= r_n^2,    r_1 along a,    r_2 across
//! ```
//!
//! In coordinates `r_2/c`, with the velocity `c u_2`, it is the disk of Coulomb's law, with the same power; the second
//! tangent of the contact frame is therefore multiplied by `c`.

use super::contact::frame;
use contact::law::admissible;
use expression::{IntervalWorkspace, Tape};
use nalgebra::{Isometry3, Matrix3, Vector3};
use numerics::Interval;

/// The number of inputs of a coefficient that varies, after the time: the place of the contact, and the speed of the slip.
pub const INPUTS: usize = 4;

/// A coefficient of friction that varies.
#[derive(Clone, Debug)]
pub struct Coefficient {
    /// The program, with the inputs `t`, the place of the contact in world coordinates, and the speed of the slip. It has
    /// one output, or two whose geometric mean is the coefficient.
    pub program: Tape,
    /// Whether there are two outputs.
    pub is_mean: bool,
}

impl Coefficient {
    /// The coefficient of a contact.
    ///
    /// # Errors
    /// Its value, if that is negative or not finite.
    pub fn at(&mut self, t: f64, place: &Vector3<f64>, slip_speed: f64) -> Result<f64, f64> {
        let inputs: [f64; INPUTS] = [place.x, place.y, place.z, slip_speed];
        let mut out = [0.0; 2];
        let outputs = if self.is_mean { 2 } else { 1 };
        self.program.evaluate(t, &inputs, &mut out[..outputs]);
        let of = |mu: f64| admissible(mu).ok_or(mu);
        let first = of(out[0])?;
        if self.is_mean { Ok((first * of(out[1])?).sqrt()) } else { Ok(first) }
    }

    /// Encloses the coefficient over an interval of time and a box of places.
    pub fn enclose(&self, t: Interval, place: &[Interval], slip_speed: f64, boxes: &mut IntervalWorkspace) -> Interval {
        let inputs = [place[0], place[1], place[2], Interval::point(slip_speed)];
        let mut out = [Interval::LINE; 2];
        let outputs = if self.is_mean { 2 } else { 1 };
        self.program.enclose(t, &inputs, boxes, &mut out[..outputs]);
        if self.is_mean { (out[0] * out[1]).sqrt() } else { out[0] }
    }
}

/// The axes of a direction of friction.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum AxesOfGrain {
    /// Those of the world.
    World,
    /// Those of the body with this material; of both bodies with it, of that which stands first in the scene.
    Material(usize),
    /// Those of the body that stands first in the scene.
    First,
}

/// Friction whose coefficient depends on the direction.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Grain {
    /// The direction of the given coefficient, projected onto the contact plane.
    pub along: Vector3<f64>,
    /// The axes of `along`.
    pub axes: AxesOfGrain,
    /// The coefficient across `along`, divided by that along it.
    pub ratio: f64,
}

/// The sine of the angle to the normal below which a direction has no projection on the contact plane.
const UPRIGHT: f64 = 1e-6;

impl Grain {
    /// The frame of a contact: the normal and the first tangent have unit length, the second the length `ratio`.
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
