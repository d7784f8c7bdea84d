//! Boundary conditions on the sides of the domain.

use super::field;
use crate::expression::Expression;
use crate::lowering::Lowering;
use crate::pointer::Pointer;
use models::finite_elements::Side;
use models::obstacle::{Condition, Field};
use serde::Deserialize;
use utoipa::ToSchema;

/// The boundary condition on each side of the domain. Default: no flux.
#[derive(Clone, Debug, Default, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct Boundary {
    /// Condition on the side at the smallest `x`.
    pub x_min: Option<BoundaryCondition>,
    /// Condition on the side at the largest `x`.
    pub x_max: Option<BoundaryCondition>,
    /// Condition on the side at the smallest `y`.
    pub y_min: Option<BoundaryCondition>,
    /// Condition on the side at the largest `y`.
    pub y_max: Option<BoundaryCondition>,
    /// Condition on the side at the smallest `z`.
    pub z_min: Option<BoundaryCondition>,
    /// Condition on the side at the largest `z`.
    pub z_max: Option<BoundaryCondition>,
}

/// A boundary condition, as an expression in `t` and the coordinates.
#[derive(Clone, Debug, Deserialize, ToSchema)]
#[serde(rename_all = "snake_case")]
pub enum BoundaryCondition {
    /// The value of `u`, between the obstacles. It also applies on the edges of the side; where two sides with
    /// prescribed values meet, the later in the order `x_min`, `x_max`, `y_min`, .. takes precedence.
    Dirichlet(Expression),
    /// The flux `a du/dn` into the domain, with the derivative along the outward normal.
    Neumann(Expression),
}

impl Boundary {
    /// Reads the boundary conditions on all sides of a domain in `dimension` directions.
    pub(super) fn lower(&self, dimension: usize, place: &Pointer<'_>, lowering: &mut Lowering) -> Vec<Condition> {
        let given = [&self.x_min, &self.x_max, &self.y_min, &self.y_max, &self.z_min, &self.z_max];
        for (side, condition) in Side::all(3).zip(given) {
            if side.direction >= dimension && condition.is_some() {
                let detail = format!("the domain has no side `{}`", side.name());
                lowering.errors.report(&place.key(side.name()), "no_such_direction", detail);
            }
        }
        let sides = Side::all(dimension).zip(given);
        sides.map(|(side, condition)| lower(condition.as_ref(), &place.key(side.name()), lowering)).collect()
    }
}

fn lower(condition: Option<&BoundaryCondition>, place: &Pointer<'_>, lowering: &mut Lowering) -> Condition {
    match condition {
        None => {
            let zero = lowering.graph.constant(0.0);
            Condition::Neumann(Field::new(&mut lowering.graph, zero))
        }
        Some(BoundaryCondition::Dirichlet(value)) => {
            Condition::Dirichlet(field(value, &place.key("dirichlet"), lowering))
        }
        Some(BoundaryCondition::Neumann(flux)) => Condition::Neumann(field(flux, &place.key("neumann"), lowering)),
    }
}
