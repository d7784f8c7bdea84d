//! The parabolic obstacle problem: domain, coefficients, obstacles, sides. The equations are those of
//! [`models::obstacle`](models::obstacle).

mod directions;
mod domain;
mod sides;

pub use directions::{Directions, PerDirection};
pub use domain::Domain;
pub use sides::{Boundary, BoundaryCondition};

use super::choices::choices;
use super::directions::DIRECTIONS;
use super::elements::Elements;
use super::error::SpecificationError;
use super::expression::Expression;
use super::lowering::{Lowering, Named, Start};
use super::ordered::Ordered;
use super::pointer::Pointer;
use super::tables::TableOfPoints;
use super::written::{Lowered, Written};
use ::expression::{Breaks, Node};
use models::finite_elements::{Grid, Quadrature};
use models::obstacle::{Condition, Field, Obstacle, ObstacleError, Probe, largest_peclet};
use serde::Deserialize;
use solution::Warning;
use std::sync::Arc;
use utoipa::ToSchema;

/// A parabolic equation between obstacles: `u_t - div(a grad u) + b . grad u + c u = f` where `u` touches none. Outputs
/// beside the probes are `total`, the integral of `u`; with an obstacle also `pressure`, its total force, and
/// `contact`, the length, area or volume of the contact set; on an interval also `contact_from` and `contact_to`, the
/// free boundary, interpolated between nodes.
#[derive(Clone, Debug, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct ObstacleProblem {
    /// Constants by name; each may be an expression in the others, without circular references.
    #[serde(default)]
    #[schema(value_type = std::collections::BTreeMap<String, Expression>)]
    pub parameters: Ordered<Expression>,
    /// Tables by name: functions of one argument, called as `load(t)`.
    #[serde(default)]
    #[schema(value_type = std::collections::BTreeMap<String, TableOfPoints>)]
    pub tables: Ordered<TableOfPoints>,
    /// Expressions by name, in states, variables, parameters, `t` and each other, without circular references. Each can be
    /// reported as a column, and used by its name in other expressions.
    #[serde(default)]
    #[schema(value_type = std::collections::BTreeMap<String, Expression>)]
    pub definitions: Ordered<Expression>,
    /// Integrals over time of expressions by name, from zero at the start: further columns.
    #[serde(default)]
    #[schema(value_type = std::collections::BTreeMap<String, Expression>)]
    pub integrals: Ordered<Expression>,
    /// The domain of the solution `u`: an interval, a rectangle or a box.
    pub domain: Domain,
    /// The number of equal elements in each direction: one number for all directions, or `{"x": .., "y": ..}`.
    pub elements: Elements,
    /// The diffusion `a`, not negative: an expression in `t` and the coordinates, or one for each direction.
    pub diffusion: PerDirection,
    /// The advection `b`: an expression on an interval, one for each direction elsewhere. Default: none.
    pub advection: Option<PerDirection>,
    /// The reaction coefficient `c`. Default: none.
    pub reaction: Option<Expression>,
    /// The source term `f`. Default: none.
    pub source: Option<Expression>,
    /// The lower obstacle `phi`. Default: none.
    pub obstacle: Option<Expression>,
    /// The upper obstacle `psi`. Default: none.
    pub upper_obstacle: Option<Expression>,
    /// The initial values of the solution `u`, between the obstacles.
    pub initial: Expression,
    /// The boundary conditions by side. Default: no flux.
    #[serde(default)]
    pub boundary: Boundary,
    /// The quadrature of mass, advection and reaction terms. Default `lumped`.
    #[serde(default)]
    pub mass: MassName,
    /// Points by name, each a list of its coordinates, at which `u` is an output.
    #[serde(default)]
    #[schema(value_type = std::collections::BTreeMap<String, Vec<Expression>>)]
    pub probes: Ordered<Vec<Expression>>,
}

choices! {
    /// The quadrature of mass, advection and reaction terms over an element.
    MassName {
        "lumped" Lumped: "Trapezoidal rule: a diagonal mass matrix, and an M-matrix at every stage on any grid."
        "consistent" Consistent: "Exact integration."
    }
}

impl ObstacleProblem {
    /// Number of nodes of the finite element grid, as far as `elements` determines it.
    pub(super) fn nodes(&self) -> usize {
        self.elements.nodes(self.domain.dimension())
    }
}

/// Measured time to check the specification of an obstacle problem, in nanoseconds per node of the grid.
const A_NODE: usize = 1_000;

impl Written for ObstacleProblem {
    fn key(&self) -> &'static str {
        "obstacle"
    }

    fn named(&self) -> Named<'_> {
        let Self { parameters, tables, definitions, integrals, .. } = self;
        Named { parameters, tables, definitions, integrals }
    }

    fn unknowns(&self) -> usize {
        self.nodes()
    }

    fn time_to_check(&self) -> usize {
        self.nodes().saturating_mul(A_NODE)
    }

    fn lower<'c>(&self, place: &Pointer<'_>, start: Start<'c>) -> Lowered<'c> {
        let mut lowering = Lowering::new(start, self.named(), place);
        let dimension = self.domain.dimension();
        let place_of_domain = place.key("domain");
        let coordinates = &DIRECTIONS[..dimension];
        lowering.bind_coordinates(coordinates.iter().copied(), |k| place_of_domain.key(DIRECTIONS[k]).to_string());
        let grid = self.domain.grid(&self.elements, place, &mut lowering);
        let diffusion = self.diffusion.lower(dimension, true, &place.key("diffusion"), &mut lowering);
        let advection = self.advection.as_ref().map_or_else(Vec::new, |advection| {
            advection.lower(dimension, false, &place.key("advection"), &mut lowering)
        });
        let mut optional = |expression: &Option<Expression>, key: &str| {
            expression.as_ref().map(|expression| field(expression, &place.key(key), &mut lowering))
        };
        let (reaction, source) = (optional(&self.reaction, "reaction"), optional(&self.source, "source"));
        let (lower, upper) = (optional(&self.obstacle, "obstacle"), optional(&self.upper_obstacle, "upper_obstacle"));
        let initial = field(&self.initial, &place.key("initial"), &mut lowering);
        let conditions = self.boundary.lower(dimension, &place.key("boundary"), &mut lowering);
        let probes = self.probes(grid.as_ref(), &place.key("probes"), &mut lowering);
        let (Some(grid), true) = (grid, lowering.errors.is_empty()) else { return (lowering, None) };
        let optional = [&reaction, &source, &lower, &upper].into_iter().flatten();
        let fields = diffusion.iter().chain(&advection).chain(optional).chain(conditions.iter().map(Condition::field));
        let nodes: Vec<Node> = fields.map(Field::node).collect();
        let breaks = Breaks::new(&mut lowering.graph, &nodes);
        let mut problem = Obstacle {
            breaks,
            grid,
            quadrature: match self.mass {
                MassName::Lumped => Quadrature::Nodal,
                MassName::Consistent => Quadrature::Exact,
            },
            diffusion,
            advection,
            reaction,
            source,
            lower,
            upper,
            initial,
            conditions,
            probes,
            warnings: Vec::new(),
        };
        if let Some(t) = lowering.start {
            let checked = problem.check(t, lowering.control);
            match checked.and_then(|()| largest_peclet(&mut problem, t, lowering.control)) {
                Ok(peclet) => problem.warnings.extend((peclet > 1.0).then(|| unresolved(peclet))),
                Err(ObstacleError::ObstacleDataError(offence)) => {
                    let pointer = format!("{place}/{}", offence.key());
                    let error = SpecificationError::new(pointer, offence.code(), offence.to_string());
                    lowering.errors.push(error.expected(offence.expected()));
                    return (lowering, None);
                }
                Err(_) => {
                    lowering.errors.push(SpecificationError::interrupted());
                    return (lowering, None);
                }
            }
        }
        (lowering, Some(Arc::new(problem)))
    }
}

impl ObstacleProblem {
    fn probes(&self, grid: Option<&Grid>, place: &Pointer<'_>, lowering: &mut Lowering) -> Vec<Probe> {
        let dimension = self.domain.dimension();
        let mut probes = Vec::with_capacity(self.probes.len());
        for (name, point) in self.probes.iter() {
            let place = place.key(name);
            if self.output_names().contains(&name) {
                let detail = format!("`{name}` is the name of an output already");
                lowering.errors.report(&place, "duplicate_name", detail);
            }
            if point.len() != dimension {
                let detail = format!("{} coordinates in {dimension} dimensions", point.len());
                let error = SpecificationError::new(place.to_string(), "wrong_shape", detail);
                lowering.errors.push(error.expected(format!("{dimension} coordinates")));
                continue;
            }
            let mut at = [0.0; 3];
            for (k, coordinate) in point.iter().enumerate() {
                let place = place.index(k);
                let Some(value) = lowering.constant(coordinate, &place) else { continue };
                at[k] = value;
                let Some(axis) = grid.map(|grid| grid.axes()[k]) else { continue };
                if !(axis.lower..=axis.upper).contains(&value) {
                    let detail = format!("{value} is outside the domain");
                    let error = SpecificationError::new(place.to_string(), "outside_domain", detail);
                    lowering.errors.push(error.expected(format!("from {} to {}", axis.lower, axis.upper)));
                }
            }
            probes.push(Probe { name: name.to_owned(), at });
        }
        probes
    }

    /// Names of the outputs of an obstacle problem other than probes.
    fn output_names(&self) -> &'static [&'static str] {
        Obstacle::scalar_names(self.obstacle.is_some() || self.upper_obstacle.is_some(), self.domain.dimension())
    }
}

/// Translates an expression of an obstacle problem to a function of time and space; a faulty expression becomes zero.
fn field(expression: &Expression, place: &Pointer<'_>, lowering: &mut Lowering) -> Field {
    let node = lowering.node_or_zero(expression, place);
    Field::new(&mut lowering.graph, node)
}

/// Returns the warning about a grid that is too coarse for the layers of the solution.
fn unresolved(peclet: f64) -> Warning {
    let message = format!(
        "the Peclet number of the grid, of advection to diffusion over half an element, is {peclet:.3e}: \
         diffusion was added where it is above 1, which smears layers over an element; more elements resolve them"
    );
    Warning { code: "unresolved_layers", message }
}
