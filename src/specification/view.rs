//! `view`, the picture of a planar system: points `p_i(t, x, z)` as expressions, and segments between them. It does not
//! affect the answer: the page draws it, and its expressions are checked like those of the problem.

use super::error::{Errors, SpecificationError};
use super::expression::Expression;
use super::lowering::Lowering;
use super::ordered::Ordered;
use super::pointer::Pointer;
use super::wording::listed;
use expression::nearest;
use serde::Deserialize;
use std::collections::HashSet;
use utoipa::ToSchema;

/// Largest number of points, and largest number of segments, of a view.
const MOST: usize = 1000;

/// The picture of a planar system on the page: moving points, and segments between them. It does not affect the answer.
#[derive(Clone, Debug, Default, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct View {
    /// Points by name, each `[x, y]` or, drawn as a disk, `[x, y, radius]`: expressions in `t`, parameters, outputs and
    /// definitions. At most 1000.
    #[schema(value_type = std::collections::BTreeMap<String, Vec<Expression>>)]
    pub points: Ordered<Vec<Expression>>,
    /// Polylines through points, each as a list of two or more names. At most 1000. Default: none.
    #[serde(default)]
    pub segments: Vec<Vec<String>>,
}

impl View {
    /// Reports errors in the view. Its expressions may use the names that monitors (event functions) may use.
    pub(super) fn check(&self, lowering: &mut Lowering<'_>) {
        let place = Pointer::Root.key("view");
        for (key, count) in [("points", self.points.len()), ("segments", self.segments.len())] {
            if count > MOST {
                let error =
                    SpecificationError::new(place.key(key).to_string(), "out_of_range", format!("{count} {key}"));
                lowering.errors.push(error.expected(format!("at most {MOST}")));
                return;
            }
        }
        let of_points = place.key("points");
        for (name, coordinates) in self.points.iter() {
            let place = of_points.key(name);
            if !(2..=3).contains(&coordinates.len()) {
                let detail = format!("found {} entries", coordinates.len());
                let error = SpecificationError::new(place.to_string(), "wrong_count", detail);
                lowering.errors.push(error.expected("`[x, y]` or `[x, y, radius]`"));
            }
            for (i, coordinate) in coordinates.iter().enumerate() {
                lowering.node_or_zero(coordinate, &place.index(i));
            }
        }
        self.check_segments(&place.key("segments"), &mut lowering.errors);
    }

    fn check_segments(&self, place: &Pointer<'_>, errors: &mut Errors) {
        let known: HashSet<&str> = self.points.names().collect();
        for (i, segment) in self.segments.iter().enumerate() {
            let place = place.index(i);
            if segment.len() < 2 {
                let error = SpecificationError::new(
                    place.to_string(),
                    "wrong_count",
                    format!("found {} entries", segment.len()),
                );
                errors.push(error.expected("two or more names of points"));
            }
            for (j, name) in segment.iter().enumerate().filter(|(_, name)| !known.contains(name.as_str())) {
                let detail = format!("`{name}` is not a point of this view");
                let error = SpecificationError::new(place.index(j).to_string(), "unknown_name", detail);
                let error = error.expected(listed(self.points.names()));
                errors.push(error.did_you_mean(nearest(name, self.points.names())));
            }
        }
    }
}
