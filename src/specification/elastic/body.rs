//! Shapes and materials of elastic bodies.

use super::{ElasticProblem, MOST_DISPLACEMENTS};
use crate::directions::DIRECTIONS;
use crate::error::SpecificationError;
use crate::expression::Expression;
use crate::lowering::Lowering;
use crate::pointer::Pointer;
use crate::range::{in_range, positive};
use models::elastic::Lame;
use models::finite_elements::{Axis, Grid};
use serde::Deserialize;
use utoipa::ToSchema;

/// The shape of an elastic body.
#[derive(Clone, Debug, Deserialize, ToSchema)]
#[serde(rename_all = "snake_case")]
pub enum ElasticBody {
    /// A string under tension, with transverse displacements.
    String(StringBody),
    /// A bar, with axial displacements.
    Bar(BarBody),
    /// A rectangle with displacements in its plane, in plane strain or plane stress.
    Rectangle(RectangleBody),
    /// A box, with displacements in three directions.
    Box(BoxBody),
}

/// An elastic string under tension, along `x`.
#[derive(Clone, Debug, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct StringBody {
    /// Coordinates of the two ends of the string.
    #[schema(value_type = [Expression; 2])]
    pub x: [Expression; 2],
}

/// An elastic bar along `x`.
#[derive(Clone, Debug, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct BarBody {
    /// Coordinates of the two ends of the bar.
    #[schema(value_type = [Expression; 2])]
    pub x: [Expression; 2],
}

/// An elastic rectangle in the plane of `x` and `y`.
#[derive(Clone, Debug, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct RectangleBody {
    /// Start and end coordinate of the rectangle along `x`.
    #[schema(value_type = [Expression; 2])]
    pub x: [Expression; 2],
    /// Start and end coordinate of the rectangle along `y`.
    #[schema(value_type = [Expression; 2])]
    pub y: [Expression; 2],
    /// Assumption on strain and stress across the plane of the rectangle.
    pub plane: PlaneLaw,
}

/// Assumption on strain and stress across the plane of a rectangle.
#[derive(Clone, Copy, Debug, Deserialize, ToSchema)]
#[serde(rename_all = "snake_case")]
pub enum PlaneLaw {
    /// Plane strain: no strain across the plane.
    Strain,
    /// Plane stress: no stress across the plane.
    Stress,
}

/// An elastic box with sides along `x`, `y` and `z`.
#[derive(Clone, Debug, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct BoxBody {
    /// Start and end coordinate of the box along `x`.
    #[schema(value_type = [Expression; 2])]
    pub x: [Expression; 2],
    /// Start and end coordinate of the box along `y`.
    #[schema(value_type = [Expression; 2])]
    pub y: [Expression; 2],
    /// Start and end coordinate of the box along `z`.
    #[schema(value_type = [Expression; 2])]
    pub z: [Expression; 2],
}

/// The grid of an elastic body, and its number of displacement components per node.
pub(super) struct Geometry {
    pub grid: Grid,
    /// Number of displacement components per node of the grid.
    pub components: usize,
    pub is_string: bool,
}

/// Material parameters of an elastic body: density, moduli, and relaxation time of the viscous stress.
pub(super) struct Law {
    pub density: f64,
    pub lame: Lame,
    pub relaxation: f64,
}

impl ElasticBody {
    /// Number of space dimensions of the elastic body.
    pub(super) fn dimension(&self) -> usize {
        self.extents().1.len()
    }

    fn extents(&self) -> (&'static str, Vec<&[Expression; 2]>) {
        match self {
            Self::String(body) => ("string", vec![&body.x]),
            Self::Bar(body) => ("bar", vec![&body.x]),
            Self::Rectangle(body) => ("rectangle", vec![&body.x, &body.y]),
            Self::Box(body) => ("box", vec![&body.x, &body.y, &body.z]),
        }
    }
}

impl ElasticProblem {
    /// Builds the finite element grid of the body, if its description is valid.
    pub(super) fn geometry(&self, place: &Pointer<'_>, lowering: &mut Lowering) -> Option<Geometry> {
        let (shape, extents) = self.body.extents();
        let at = place.key("elements");
        let counts = self.elements.counts(extents.len(), (1, "body"), &at, lowering);
        let displacements = self.displacements();
        if displacements > MOST_DISPLACEMENTS {
            let detail = format!("the nodes of these elements have {displacements} displacements");
            let error = SpecificationError::new(at.to_string(), "too_many_unknowns", detail);
            lowering.errors.push(error.expected(format!("at most {MOST_DISPLACEMENTS}")));
            return None;
        }
        let body = place.key("body");
        let body = body.key(shape);
        let mut axes = Vec::with_capacity(extents.len());
        for ((&extent, name), elements) in extents.iter().zip(DIRECTIONS).zip(counts) {
            let place = body.key(name);
            let [lower, upper] = [0, 1].map(|k| lowering.constant(&extent[k], &place.index(k)));
            let (Some(lower), Some(upper)) = (lower, upper) else { continue };
            if upper <= lower || !(upper - lower).is_finite() {
                let detail = format!("the body ends at {upper}, which is not above its beginning at {lower}");
                let error = SpecificationError::new(place.to_string(), "empty_interval", detail);
                lowering.errors.push(error.expected("an end above the beginning"));
            }
            axes.extend(elements.map(|elements| Axis { lower, upper, elements }));
        }
        if axes.len() < extents.len() {
            return None;
        }
        let is_string = matches!(self.body, ElasticBody::String(_));
        Some(Geometry { components: axes.len(), grid: Grid::new(axes), is_string })
    }

    /// Reads the material parameters of the elastic body, if they are valid.
    pub(super) fn law(&self, geometry: &Geometry, place: &Pointer<'_>, lowering: &mut Lowering) -> Option<Law> {
        let density = positive(&self.density, "density", &place.key("density"), lowering);
        let dimension = geometry.grid.dimension();
        let (key, modulus, other) = match geometry.is_string {
            true => ("tension", &self.tension, ("young", &self.young)),
            false => ("young", &self.young, ("tension", &self.tension)),
        };
        let refused = [other, ("poisson", if dimension == 1 { &self.poisson } else { &None })];
        for (key, _) in refused.iter().filter(|(_, given)| given.is_some()) {
            let detail = format!("a {} has no `{key}`", self.body.extents().0);
            lowering.errors.push(
                SpecificationError::new(place.key(key).to_string(), "conflict", detail).expected("to be left out"),
            );
        }
        let mut optional = |given: &Option<Expression>, what, key, range: (fn(f64) -> bool, &str)| {
            given.as_ref().and_then(|value| in_range(value, what, range, &place.key(key), lowering)).unwrap_or(0.0)
        };
        let below_half = "from 0 up to but not including 0.5";
        let poisson =
            optional(&self.poisson, "Poisson's ratio", "poisson", (|value| (0.0..0.5).contains(&value), below_half));
        let viscosity = optional(&self.viscosity, "viscosity", "viscosity", (|value| value >= 0.0, "of 0 or more"));
        let Some(modulus) = modulus else {
            let detail = format!("a {} needs a `{key}`", self.body.extents().0);
            lowering.errors.report(place, "missing_key", detail);
            return None;
        };
        let modulus = positive(modulus, key, &place.key(key), lowering);
        let lame = match &self.body {
            ElasticBody::String(_) | ElasticBody::Bar(_) => Lame::axial(modulus),
            ElasticBody::Rectangle(RectangleBody { plane: PlaneLaw::Stress, .. }) => {
                Lame::plane_stress(modulus, poisson)
            }
            ElasticBody::Rectangle(_) | ElasticBody::Box(_) => Lame::solid(modulus, poisson),
        };
        Some(Law { density, lame, relaxation: viscosity / modulus })
    }
}
