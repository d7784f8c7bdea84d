//! Bodies that overlap at the start: refused, each pair by name, or moved apart before the first step.

use crate::models::rigid_bodies::Scene;
use crate::specification::error::{Errors, SpecificationError};
use crate::specification::place::Place;
use serde::Deserialize;
use utoipa::ToSchema;

/// What becomes of bodies that overlap at the start by more than a millionth of their size.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Deserialize, ToSchema)]
#[serde(rename_all = "snake_case")]
pub enum Interpenetration {
    /// An error that names them.
    #[default]
    Refuse,
    /// They are moved apart, no more than is needed, before the first step.
    Resolve,
}

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
