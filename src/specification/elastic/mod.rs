//! Elastic and viscoelastic bodies in dynamic contact. The equations are those of
//! [`models::elastic`](models::elastic).

mod body;
mod contact;
mod field;
mod loads;
mod outputs;
mod sides;

pub use body::{BarBody, BoxBody, ElasticBody, PlaneLaw, RectangleBody, StringBody};
pub use contact::ElasticContact;
pub use loads::ElasticStart;

use super::directions::DIRECTIONS;
use super::elements::Elements;
use super::error::SpecificationError;
use super::expression::Expression;
use super::lowering::{Lowering, Named, Start};
use super::ordered::Ordered;
use super::pointer::Pointer;
use super::start;
use super::tables::TableOfPoints;
use super::written::{Lowered, Written};
use body::Geometry;
use models::elastic::{Continuum, semidiscretise};
use models::{DviModel, Equations, KinkAdvice, Linear};
use serde::Deserialize;
use solution::Warning;
use std::sync::Arc;
use utoipa::ToSchema;

/// A string, a bar, a rectangle or a box with small displacements, bounded by obstacles: `rho u_tt = div s + f` with `s
/// = A e(u) + B e(u_t)`, and `pressure >= 0`, `n.u <= gap`, at least one with equality, where contact is possible.
///
/// Outputs are named by the indices of nodes along the axes, from 0: displacement `u(3)` and velocity `v(3)` of a
/// string or a bar; `ux(3,0)`, `uy(3,0)`, `vx(3,0)`, .. of a rectangle or a box. By default, only the probes, the force
/// on the body at each side with contact, `force_SIDE`, `kinetic_energy` and `potential_energy` are kept;
/// `output.fields` selects others.
#[derive(Clone, Debug, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct ElasticProblem {
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
    /// The shape of the elastic body.
    pub body: ElasticBody,
    /// The number of equal elements in each direction: one number for all directions, or `{"x": .., "y": ..}`.
    pub elements: Elements,
    /// Mass per volume, or per length for a string. A bar has cross-section 1, a rectangle thickness 1. Above 0.
    pub density: Expression,
    /// Young's modulus, above 0; for all bodies except strings.
    pub young: Option<Expression>,
    /// Poisson's ratio, from 0 up to but not including 0.5; for rectangles and boxes. Default 0.
    pub poisson: Option<Expression>,
    /// Tension of the string, above 0; for strings only.
    pub tension: Option<Expression>,
    /// Modulus of the viscous stress, in the unit of `young` or `tension` times that of time: the stress of a bar is
    /// `young*e + viscosity*e_t`. In more dimensions the viscous stress has the same Poisson's ratio as the elastic
    /// stress. Default 0, elastic.
    pub viscosity: Option<Expression>,
    /// Body force per volume, as expressions in `t` and the coordinates, one component per direction; for a string, the
    /// transverse force per length.
    pub force: Option<Vec<Expression>>,
    /// Traction, the force per area on a side, by the name of the side, as expressions in `t` and the coordinates, one
    /// component per direction.
    #[serde(default)]
    #[schema(value_type = std::collections::BTreeMap<String, Vec<Expression>>)]
    pub traction: Ordered<Vec<Expression>>,
    /// The sides that keep their initial displacement: `x_min`, `x_max`, `y_min`, ...
    #[serde(default)]
    pub clamped: Vec<String>,
    /// The obstacles, by the side that they face; for a string, by `below` and `above`.
    #[serde(default)]
    #[schema(value_type = std::collections::BTreeMap<String, ElasticContact>)]
    pub contact: Ordered<ElasticContact>,
    /// Displacement and velocity at the start. Default 0.
    #[serde(default)]
    pub initial: ElasticStart,
    /// Points by name, whose displacement is an output: under the name itself, or with the suffix `_x`, `_y`, `_z` if
    /// there are several components.
    #[serde(default)]
    #[schema(value_type = std::collections::BTreeMap<String, Vec<Expression>>)]
    pub probes: Ordered<Vec<Expression>>,
}

/// Largest number of nodal displacements of an elastic body.
const MOST_DISPLACEMENTS: usize = 100_000;

impl ElasticProblem {
    /// Number of nodal displacements of the body, as far as `elements` determines it.
    fn displacements(&self) -> usize {
        let dimension = self.body.dimension();
        self.elements.nodes(dimension).saturating_mul(dimension)
    }
}

/// Measured time to check the specification of an elastic body, in nanoseconds per nodal displacement.
const A_DISPLACEMENT: usize = 20_000;

impl Written for ElasticProblem {
    fn key(&self) -> &'static str {
        "elastic"
    }

    fn named(&self) -> Named<'_> {
        let Self { parameters, tables, definitions, integrals, .. } = self;
        Named { parameters, tables, definitions, integrals }
    }

    fn unknowns(&self) -> usize {
        self.displacements().saturating_mul(2)
    }

    fn time_to_check(&self) -> usize {
        self.unknowns().saturating_mul(A_DISPLACEMENT)
    }

    fn lower<'c>(&self, place: &Pointer<'_>, start: Start<'c>) -> Lowered<'c> {
        let mut lowering = Lowering::new(start, self.named(), place);
        let Some(geometry) = self.geometry(place, &mut lowering) else { return (lowering, None) };
        let names = DIRECTIONS.into_iter().take(geometry.grid.dimension());
        lowering.bind_coordinates(names, |_| place.to_string());
        let clamped = self.clamped(&geometry, place, &mut lowering);
        let loads = self.loads(&geometry, place, &mut lowering);
        let (displacement, velocity) = self.initial.lower(&geometry, &place.key("initial"), &mut lowering);
        let (contacts, sides) = self.contacts(&geometry, &clamped, &displacement, place, &mut lowering);
        let law = self.law(&geometry, place, &mut lowering);
        let probes = self.probes(&geometry, place, &mut lowering);
        let (Some(law), true) = (law, lowering.errors.is_empty()) else { return (lowering, None) };
        let continuum = Continuum {
            components: geometry.components,
            density: law.density,
            lame: law.lame,
            relaxation: law.relaxation,
            loads,
            clamped,
            contacts,
            grid: geometry.grid.clone(),
        };
        let lowered = semidiscretise(&mut lowering.graph, &continuum, &displacement, &velocity, start.control);
        let Ok(lowered) = lowered else {
            lowering.errors.push(SpecificationError::interrupted());
            return (lowering, None);
        };
        if lowered.unknowns.inner == 0 {
            let detail = "no node of the body moves";
            lowering.errors.report(&place.key("clamped"), "nothing_moves", detail);
            return (lowering, None);
        }
        let names = outputs::names(&geometry, &continuum, &lowered, &sides);
        let outputs = outputs::lower(&probes, &continuum, &lowered, &sides, &mut lowering);
        let equations = match Linear::new(&mut lowering.graph, lowered.rows) {
            Ok(equations) => Equations::Linear(Box::new(equations)),
            Err((_, error)) => {
                let place = place.key("contact");
                lowering.errors.push(SpecificationError::new(place.to_string(), error.code, error.message));
                return (lowering, None);
            }
        };
        let model = DviModel {
            state_names: names.states,
            variable_names: names.variables,
            outputs,
            initial: lowered.initial,
            equations,
            warnings: open_questions(&geometry, &continuum),
            kinks: KinkAdvice::default(),
            parameters: None,
        };
        if let Some(t) = lowering.start {
            start::check(&model, t, |_| place.to_string(), &mut lowering.errors);
        }
        (lowering, Some(Arc::new(model)))
    }
}

/// Warns of open questions of existence and uniqueness for the continuum that the elements approximate.
fn open_questions(geometry: &Geometry, continuum: &Continuum) -> Vec<Warning> {
    let elastic = continuum.relaxation == 0.0 && !continuum.contacts.is_empty();
    if !elastic || geometry.grid.dimension() == 1 {
        return Vec::new();
    }
    let message = "without viscosity, existence and uniqueness are open for the continuum, even if the \
                   discretised problem has a unique solution; with `viscosity` above 0 solutions exist"
        .to_owned();
    vec![Warning { code: "uniqueness_open", message }]
}
