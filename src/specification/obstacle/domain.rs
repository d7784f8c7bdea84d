//! The domain of an obstacle problem, and its division into finite elements.

use crate::directions::DIRECTIONS;
use crate::elements::Elements;
use crate::error::SpecificationError;
use crate::expression::Expression;
use crate::lowering::Lowering;
use crate::pointer::Pointer;
use models::finite_elements::{Axis, Grid};
use serde::Deserialize;
use utoipa::ToSchema;

/// An interval, a rectangle or a box, with constants `[from, to]` along each direction.
#[derive(Clone, Debug, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct Domain {
    /// Extent of the domain along `x`.
    pub x: [Expression; 2],
    /// Extent of the domain along `y`, for a rectangle or a box.
    pub y: Option<[Expression; 2]>,
    /// Extent of the domain along `z`, for a box.
    pub z: Option<[Expression; 2]>,
}

/// Smallest number of elements in a direction: with `u` given on two opposite sides, an inner node remains.
const FEWEST: u64 = 2;

impl Domain {
    /// Number of directions of the domain; `grid` reports a `z` without a `y`.
    pub(super) fn dimension(&self) -> usize {
        match (&self.y, &self.z) {
            (None, _) => 1,
            (Some(_), None) => 2,
            (Some(_), Some(_)) => 3,
        }
    }

    /// Builds the finite element grid of the domain, if its description is valid.
    pub(super) fn grid(&self, given: &Elements, problem: &Pointer<'_>, lowering: &mut Lowering) -> Option<Grid> {
        let (place, place_of_elements) = (problem.key("domain"), problem.key("elements"));
        let dimension = self.dimension();
        if self.z.is_some() && dimension == 1 {
            let error = SpecificationError::new(place.to_string(), "missing_key", "there is a `z` and no `y`");
            lowering.errors.push(error.expected("`x`, then `y`, then `z`"));
        }
        let ends = [Some(&self.x), self.y.as_ref(), self.z.as_ref()];
        let counts = given.counts(dimension, (FEWEST, "domain"), &place_of_elements, lowering);
        let mut axes = Vec::with_capacity(dimension);
        for ((ends, elements), key) in ends.into_iter().flatten().zip(counts).zip(DIRECTIONS) {
            let interval = interval(ends, &place.key(key), lowering);
            if let (Some((lower, upper)), Some(elements)) = (interval, elements) {
                axes.push(Axis { lower, upper, elements });
            }
        }
        (axes.len() == dimension).then(|| Grid::new(axes))
    }
}

fn interval(ends: &[Expression; 2], place: &Pointer<'_>, lowering: &mut Lowering) -> Option<(f64, f64)> {
    let [lower, upper] = [0, 1].map(|end| lowering.constant(&ends[end], &place.index(end)));
    let (lower, upper) = (lower?, upper?);
    if upper - lower > 1e-12 * lower.abs().max(upper.abs()) && (upper - lower).is_finite() {
        return Some((lower, upper));
    }
    let detail = format!("the interval [{lower}, {upper}] has no length");
    let error = SpecificationError::new(place.to_string(), "empty_interval", detail);
    lowering.errors.push(error.expected("two numbers, the first below the second"));
    None
}
