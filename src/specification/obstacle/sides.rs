//! What is given on the sides of the domain.

use super::field;
use crate::expression::Expression;
use crate::lowering::Lowering;
use crate::pointer::Pointer;
use models::finite_elements::Side;
use models::obstacle::{Condition, Field};
use serde::Deserialize;
use utoipa::ToSchema;

/// What is given on each side; where nothing is, no flux.
#[derive(Clone, Debug, Default, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct Boundary {
    /// Where `x` begins.
    pub x_min: Option<BoundaryCondition>,
    /// Where `x` ends.
    pub x_max: Option<BoundaryCondition>,
    /// Where `y` begins.
    pub y_min: Option<BoundaryCondition>,
    /// Where `y` ends.
    pub y_max: Option<BoundaryCondition>,
    /// Where `z` begins.
    pub z_min: Option<BoundaryCondition>,
    /// Where `z` ends.
    pub z_max: Option<BoundaryCondition>,
}

/// What is given on a side, an expression in `t` and the coordinates.
#[derive(Clone, Debug, Deserialize, ToSchema)]
#[serde(rename_all = "snake_case")]
pub enum BoundaryCondition {
    /// `u`, between the obstacles. It holds on the edges of the side too; of two sides on which it is given, the later in
    /// the order `x_min`, `x_max`, `y_min`, ..
    Dirichlet(Expression),
    /// The flux `a du/dn`, outwards: what flows in.
    Neumann(Expression),
}

impl Boundary {
    /// The conditions on all sides of a domain of so many directions.
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
            Condition::Neumann(Field::new(&lowering.graph, zero))
        }
        Some(BoundaryCondition::Dirichlet(value)) => {
            Condition::Dirichlet(field(value, &place.key("dirichlet"), lowering))
        }
        Some(BoundaryCondition::Neumann(flux)) => Condition::Neumann(field(flux, &place.key("neumann"), lowering)),
    }
}
