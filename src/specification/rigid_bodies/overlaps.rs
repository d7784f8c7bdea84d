//! Bodies that overlap at the start, each pair by name.

use crate::error::{Errors, MOST, SpecificationError};
use crate::pointer::Pointer;
use models::rigid_bodies::MultibodySystem;
use problem::Control;

/// Tolerance for overlaps of bodies at the start, relative to the size of the smaller body.
const ROUNDING: f64 = 1e-6;

/// Reports rigid bodies that overlap at the start, until `control` asks to stop.
pub(super) fn refuse(scene: &MultibodySystem, bodies: &Pointer<'_>, control: &Control, errors: &mut Errors) {
    // Ask for one overlap more than can be listed, so that the list of errors is marked as cut.
    for overlap in scene.overlaps(ROUNDING, MOST + 1, control).unwrap_or_default() {
        let [a, b] = overlap.bodies.map(|k| scene.bodies[k].name.as_str());
        let detail = format!("`{a}` and `{b}` overlap by {:e} at the start", overlap.depth);
        let place = bodies.index(overlap.bodies[1]);
        let error = SpecificationError::new(place.key("position").to_string(), "interpenetration", detail);
        errors.push(error.expected("bodies apart, or `\"interpenetration\": \"resolve\"` beside `bodies`"));
    }
}
