//! Bodies that overlap at the start, each pair by name.

use crate::error::{Errors, SpecificationError};
use crate::place::Place;
use models::rigid_bodies::Scene;

/// Overlaps in parts of the size of the smaller body that are rounding.
const ROUNDING: f64 = 1e-6;

/// Reports what overlaps.
pub(super) fn refuse(scene: &Scene, bodies: &Place<'_>, errors: &mut Errors) {
    for overlap in scene.overlaps(ROUNDING) {
        let [a, b] = overlap.bodies.map(|k| scene.bodies[k].name.as_str());
        let detail = format!("`{a}` and `{b}` overlap by {:e} at the start", overlap.depth);
        let place = bodies.index(overlap.bodies[1]);
        let error = SpecificationError::new(place.key("position").to_string(), "interpenetration", detail);
        errors.push(error.expected("bodies apart, or `\"interpenetration\": \"resolve\"` beside `bodies`"));
    }
}
