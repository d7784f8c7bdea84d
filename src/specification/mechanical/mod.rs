//! A mechanical system in generalised coordinates:
//!
//! ```text
//! d/dt dT/dv - dT/dq = Q - dV/dq + contacts + joints,    T = v^T M(q) v / 2
//! ```
//!
//! `q_dot` is the velocity of the coordinate `q`.

mod contact;
mod start;

pub use contact::{ConeName, Contact, Friction, Joint};

use super::error::{Errors, SpecificationError};
use super::expression::Expression;
use super::kinks;
use super::lowering::{Lowering, Named, Start};
use super::matrix::Matrix;
use super::ordered::Ordered;
use super::pointer::Pointer;
use super::tables::TableOfPoints;
use super::written::{Lowered, Written};
use contact::LoweredContacts;
use expression::Node;
use models::{
    DifferentiationError, MechanicalModel, MechanicalRows, ParametricTerms, SymbolicMechanics, velocity_name,
};
use problem::Mass;
use serde::Deserialize;
use std::sync::Arc;
use utoipa::ToSchema;

/// A mechanical system in generalised coordinates, with contacts and joints.
#[derive(Clone, Debug, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct MechanicalProblem {
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
    /// The coordinates `q` by name, at least one. The velocity of `q` is named `q_dot`.
    #[schema(value_type = std::collections::BTreeMap<String, Coordinate>)]
    pub coordinates: Ordered<Coordinate>,
    /// The mass matrix `M`, as many rows and columns as coordinates, symmetric and positive definite; it may depend on
    /// the coordinates.
    pub mass: Matrix,
    /// The potential energy, in `t` and the coordinates. Default 0.
    pub potential: Option<Expression>,
    /// The generalised forces without a potential, by coordinate, as expressions in `t`, coordinates and velocities.
    #[serde(default)]
    #[schema(value_type = std::collections::BTreeMap<String, Expression>)]
    pub forces: Ordered<Expression>,
    /// The potential contacts, where bodies can touch.
    #[serde(default)]
    pub contacts: Vec<Contact>,
    /// The bilateral constraints of the system.
    #[serde(default)]
    pub joints: Vec<Joint>,
    /// What to do if a gap is negative or a joint is violated at the start. Default `refuse`.
    #[serde(default)]
    pub interpenetration: Interpenetration,
}

/// The initial value and velocity of a generalised coordinate.
#[derive(Clone, Debug, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct Coordinate {
    /// Initial value of the coordinate, an expression in the parameters.
    pub initial: Expression,
    /// Initial velocity of the coordinate. Default 0.
    pub velocity: Option<Expression>,
}

/// What to do if a gap is negative or a joint is violated at the start.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Deserialize, ToSchema)]
#[serde(rename_all = "snake_case")]
pub enum Interpenetration {
    /// Report an error with the amount of the violation.
    #[default]
    Refuse,
    /// Move the coordinates, and the velocities of joints, to the nearest admissible values in the metric of the mass
    /// matrix.
    Resolve,
}

/// Largest numbers of coordinates and constraints: all matrices are dense, and their derivatives are expressions.
const MOST_COORDINATES: usize = 200;
const MOST_CONSTRAINTS: usize = 400;

impl Written for MechanicalProblem {
    fn key(&self) -> &'static str {
        "mechanical"
    }

    fn named(&self) -> Named<'_> {
        let Self { parameters, tables, definitions, integrals, .. } = self;
        Named { parameters, tables, definitions, integrals }
    }

    fn unknowns(&self) -> usize {
        2 * self.coordinates.len()
    }

    fn lower<'c>(&self, place: &Pointer<'_>, start: Start<'c>) -> Lowered<'c> {
        let mut lowering = Lowering::with_inputs(start, self.named(), place);
        if self.interpenetration == Interpenetration::Resolve {
            // An initial state that was moved to resolve violations is not an expression in the parameters, so the
            // parameters cannot be bound to other values.
            lowering.keep_values();
        }
        let n = self.coordinates.len();
        if n == 0 {
            let pointer = place.key("coordinates").to_string();
            let error = SpecificationError::new(pointer, "empty_states", "there are no coordinates");
            lowering.errors.push(error.expected("at least one coordinate"));
        }
        let constraints = self.contacts.len() + self.joints.len();
        if n > MOST_COORDINATES || constraints > MOST_CONSTRAINTS {
            let detail = format!("{n} coordinates, {constraints} contacts and joints");
            let error = SpecificationError::new(place.to_string(), "too_many_unknowns", detail);
            let most = format!("at most {MOST_COORDINATES} coordinates, and {MOST_CONSTRAINTS} contacts and joints");
            lowering.errors.push(error.expected(most));
            return (lowering, None);
        }
        let coordinates: Vec<String> = self.coordinates.names().map(String::from).collect();
        let velocities: Vec<String> = coordinates.iter().map(|name| velocity_name(name)).collect();
        lowering.bind_unknowns(coordinates.iter().chain(&velocities).map(String::as_str), |i| {
            place.key("coordinates").key(self.coordinates.name(i % n.max(1))).to_string()
        });
        lowering.use_definitions(&self.definitions);
        let (initial, start_terms) = self.initial(place, &mut lowering);
        let mass = self.mass.nodes((n, n), &place.key("mass"), &mut lowering);
        let of_place = |what: &str, node: Node, pointer: &Pointer<'_>, lowering: &mut Lowering| {
            if lowering.graph.inputs(node).iter().any(|&input| input > n) {
                let error = SpecificationError::new(
                    pointer.to_string(),
                    "depends_on_velocity",
                    format!("{what} may not depend on velocities"),
                );
                lowering.errors.push(error.expected("an expression in `t` and the coordinates"));
            }
        };
        for (i, &entry) in mass.iter().enumerate() {
            of_place("the mass matrix", entry, &place.key("mass").index(i / n.max(1)), &mut lowering);
        }
        let zero = lowering.graph.constant(0.0);
        let potential = match &self.potential {
            Some(potential) => {
                let place = place.key("potential");
                let node = lowering.node(potential, &place).unwrap_or(zero);
                of_place("a potential", node, &place, &mut lowering);
                node
            }
            None => zero,
        };
        let forces = self.forces(&coordinates, place, &mut lowering);
        let states: Vec<String> = coordinates.iter().chain(&velocities).cloned().collect();
        let mut warnings = Vec::new();
        for (name, &force) in coordinates.iter().zip(&forces) {
            warnings.extend(kinks::warnings(&velocity_name(name), force, &states, &lowering.graph));
        }
        let LoweredContacts { names, gaps, slips, data, joints, terms, coefficients } =
            contact::lower(&self.contacts, &self.joints, n, place, &mut lowering);
        for (name, coefficient) in names.iter().zip(&coefficients) {
            warnings.extend(coefficient.and_then(|node| contact::kink(name, node, &states, &lowering.graph)));
        }
        let rows = MechanicalRows { mass, potential, forces, joints, gaps, slips, contacts: data, coefficients };
        let system = match SymbolicMechanics::new(&mut lowering.graph, &rows) {
            Ok(system) => system,
            Err(refusal) => {
                let (pointer, error) = match refusal {
                    DifferentiationError::Dynamics(error) => (place.to_string(), error),
                    DifferentiationError::Joint(k, error) => (place.key("joints").index(k).to_string(), error),
                    DifferentiationError::Gap(k, error) => {
                        (place.key("contacts").index(k).key("gap").to_string(), error)
                    }
                    DifferentiationError::Slip(_, error) => (place.key("contacts").to_string(), error),
                    DifferentiationError::Coefficient(k, error) => {
                        (place.key("contacts").index(k).key("friction").key("coefficient").to_string(), error)
                    }
                };
                lowering.errors.push(SpecificationError::new(pointer, error.code, error.message));
                return (lowering, None);
            }
        };
        let mut model = MechanicalModel::new(&coordinates, &names, initial, system, warnings);
        let written = [&rows.mass, &rows.forces, &rows.joints, &rows.gaps, &rows.slips].into_iter().flatten();
        let mut of_states = written.chain([&rows.potential]).flat_map(|&node| lowering.graph.kinks(node));
        model.has_kinks = of_states.any(|(_, inputs)| inputs.iter().any(|&input| input > 0));
        let (coefficients, contacts) = terms.into_iter().unzip();
        let rows = model.terms().to_vec();
        let terms = ParametricTerms { initial: start_terms, contacts, rows, ..ParametricTerms::default() };
        let parameters = lowering.parameters(terms, &Mass::Identity);
        model.parameters = parameters.map(|parameters| (parameters, coefficients));
        self.check_names(&model, place, &mut lowering);
        if let Some(t) = lowering.start.filter(|_| lowering.errors.is_empty()) {
            start::settle(&mut model, t, self.interpenetration, place, &mut lowering.errors);
        }
        (lowering, Some(Arc::new(model)))
    }
}

/// Reports errors of the initial state at time `t` after new parameter values have been bound; the initial state is
/// not moved.
pub(super) fn check_start(model: &MechanicalModel, t: f64, problem: &Pointer<'_>, errors: &mut Errors) {
    start::settle(&mut model.clone(), t, Interpenetration::Refuse, problem, errors);
}

impl MechanicalProblem {
    fn initial(&self, place: &Pointer<'_>, lowering: &mut Lowering) -> (Vec<f64>, Vec<Node>) {
        let place = place.key("coordinates");
        let zero = (0.0, lowering.graph.constant(0.0));
        let mut values = Vec::with_capacity(2 * self.coordinates.len());
        for (name, coordinate) in self.coordinates.iter() {
            values.push(lowering.initial(&coordinate.initial, &place.key(name).key("initial")));
        }
        for (name, coordinate) in self.coordinates.iter() {
            let velocity = coordinate.velocity.as_ref();
            let velocity = velocity.map(|velocity| lowering.initial(velocity, &place.key(name).key("velocity")));
            values.push(velocity.unwrap_or(zero));
        }
        values.into_iter().unzip()
    }

    fn forces(&self, coordinates: &[String], place: &Pointer<'_>, lowering: &mut Lowering) -> Vec<Node> {
        let place = place.key("forces");
        let mut forces = vec![lowering.graph.constant(0.0); coordinates.len()];
        for (name, force) in self.forces.iter() {
            let place = place.key(name);
            let node = lowering.node(force, &place);
            match coordinates.iter().position(|coordinate| coordinate == name) {
                Some(i) => forces[i] = node.unwrap_or(forces[i]),
                None => lowering.errors.push(contact::unknown_coordinate(name, coordinates, &place)),
            }
        }
        forces
    }

    /// Reports outputs of equal names: a coordinate may have the name of a contact's gap.
    fn check_names(&self, model: &MechanicalModel, place: &Pointer<'_>, lowering: &mut Lowering) {
        let mut names: Vec<&String> = model.output_names.iter().collect();
        names.sort_unstable();
        for pair in names.windows(2).filter(|pair| pair[0] == pair[1]) {
            let detail = format!("two outputs would be named `{}`", pair[0]);
            lowering.errors.report(place, "duplicate_name", detail);
        }
    }
}
