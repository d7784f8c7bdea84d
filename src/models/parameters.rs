//! Parameters of a problem. Compiled equations keep parameters as inputs. Constants that depend on parameters
//! (initial states, entries of the mass matrix, constant bounds, contact coefficients) are evaluated by a separate
//! short program. New values are bound without parsing, differentiation or compilation.
//!
//! The structure of the problem (sparsity, equal bounds, ..) is that of the parameter values at compilation. Values
//! that would change the structure are rejected: the problem must then be compiled anew.

use super::DviModel;
use super::circuit::{CircuitParameters, Refused};
use super::filippov::Departures;
use super::slopes::Slopes;
use super::unbindable::Unbindable;
use expression::{Assumption, Assumptions, Broken, ExpressionError, Graph, Node, Tape};
use problem::{ConvexSet, Mass, MovingBound, Side};
use std::sync::Arc;

/// The parts of a problem that may depend on its parameters, as nodes of the graph of its equations.
#[derive(Clone, Debug, Default)]
pub struct ParametricTerms {
    /// The names of the problem's parameters.
    pub names: Vec<String>,
    /// The parameter values with which the problem was compiled.
    pub values: Vec<f64>,
    /// The initial values of the states, as expressions.
    pub initial: Vec<Node>,
    /// The entries of the mass matrix that depend on parameters, as triplets
    /// `(row, column, node of the expression graph)`.
    pub mass: Vec<(usize, usize, Node)>,
    /// The constant bounds of the convex set `K` that depend on parameters.
    pub bounds: Vec<(MovingBound, Node)>,
    /// The rows of the problem: `F`, `G` and the moving bounds, or for a mechanical system the [force balance and
    /// constraint functions](super::SymbolicMechanics::terms).
    pub rows: Vec<Node>,
    /// The contact coefficients (friction, restitution) that depend on parameters.
    pub contacts: Vec<Node>,
    /// The coefficients of the equations of a circuit, which are graph inputs numbered after the user's parameters.
    pub circuit: Option<CircuitParameters>,
    /// Coefficients of unknowns in the rows `F` and `G` that depend on parameters and are not part of `rows`, as
    /// `(row, column, node of the expression graph)`.
    pub coefficients: Vec<(usize, usize, Node)>,
}

/// The parameters of a model, with the data needed to bind new parameter values.
#[derive(Clone, Debug)]
pub struct Parameters {
    values: Vec<f64>,
    /// The compiled expressions of initial states, entries of the mass matrix, bounds and contact coefficients that
    /// depend on parameters, in this order.
    constants: Tape,
    assumptions: Assumptions,
    departures: Option<Departures>,
    source: Arc<Source>,
}

/// Data of the parameters that all copies of a model share; the expressions that depend on parameters are
/// differentiated when [`DviModel::slopes`] is called.
#[derive(Debug)]
pub(super) struct Source {
    pub(super) graph: Graph,
    pub(super) terms: ParametricTerms,
    /// The positions of the entries that depend on parameters, in the list of entries of the mass matrix.
    mass: Vec<usize>,
}

impl Parameters {
    /// Collects the parameters of compiled equations. `graph` contains the assumptions about parameter values made
    /// during compilation; `mass` is the mass matrix of the equations, with sorted entries.
    pub fn new(graph: &Graph, terms: ParametricTerms, mass: &Mass) -> Self {
        let of_mass = terms.mass.iter().map(|&(.., node)| node);
        let of_bounds = terms.bounds.iter().map(|&(_, node)| node);
        let of_set = of_mass.chain(of_bounds);
        let constants: Vec<Node> = terms.initial.iter().copied().chain(of_set).chain(terms.contacts.clone()).collect();
        let places = |&(row, column, _): &(usize, usize, Node)| match mass {
            Mass::Identity => None,
            Mass::Constant(entries) => entries.binary_search_by_key(&(row, column), |&(i, j, _)| (i, j)).ok(),
        };
        let mass = terms.mass.iter().map(|entry| places(entry).unwrap_or(usize::MAX)).collect();
        let source = Source::new(graph, terms, mass);
        Self {
            values: source.terms.values.clone(),
            constants: Tape::compile(graph, &constants),
            assumptions: Assumptions::new(graph),
            departures: None,
            source: Arc::new(source),
        }
    }

    /// Adds the analysis of repulsive boundaries ([`Departures`]): whether a boundary of a Filippov system is
    /// repulsive at the initial states was decided at compilation, and new parameter values must not change it.
    #[must_use]
    pub fn with_departures(self, departures: Option<Departures>) -> Self {
        Self { departures, ..self }
    }

    /// Returns the names of the model's parameters.
    pub fn names(&self) -> &[String] {
        &self.source.terms.names
    }

    /// Returns the parameter values that are currently bound.
    pub fn values(&self) -> &[f64] {
        &self.values
    }

    /// Returns the compiled derivatives of the problem with respect to its parameters, bound to the current parameter
    /// values.
    pub(super) fn slopes(&self) -> Result<Slopes, ExpressionError> {
        let mut slopes = Slopes::new(&self.source)?;
        slopes.bind(&self.extended(&self.values).unwrap_or_else(|_| self.values.clone()));
        if let Some(circuit) = &self.source.terms.circuit {
            slopes.follow(&circuit.slopes(&self.values));
        }
        Ok(slopes)
    }

    /// Returns the parameter values, followed by the coefficients of a circuit that depend on them.
    fn extended(&self, values: &[f64]) -> Result<Vec<f64>, Unbindable> {
        let terms = &self.source.terms;
        let Some(circuit) = &terms.circuit else { return Ok(values.to_vec()) };
        let parameters = || self.told(values);
        circuit.extended(values).map_err(|refused| match refused {
            Refused::Structure => {
                let what = "a coefficient of the circuit that was zero becomes nonzero".to_owned();
                Unbindable::Structure { parameters: parameters(), what }
            }
            Refused::Number(element, value) => {
                let what = format!("the value of component number {} is {value}", element + 1);
                Unbindable::OutOfRange { parameters: parameters(), what }
            }
            Refused::Fault(_) => {
                let what = "the equations of the circuit are singular".to_owned();
                Unbindable::OutOfRange { parameters: parameters(), what }
            }
        })
    }

    /// Returns the model's parameters with the given values, as text for error messages.
    pub(super) fn told(&self, values: &[f64]) -> String {
        let all: Vec<usize> = (0..values.len()).collect();
        listed(&all, self.names(), values)
    }

    /// Replaces the current parameter values by new values that have been checked.
    pub(super) fn keep(&mut self, values: &[f64]) {
        self.values.copy_from_slice(values);
    }

    /// Checks new parameter values. Returns the values followed by the circuit coefficients that depend on them (see
    /// `extended`), and the values of the constants that depend on parameters.
    pub(super) fn checked(&self, values: &[f64]) -> Result<(Vec<f64>, Vec<f64>), Unbindable> {
        let terms = &self.source.terms;
        if values.len() != terms.names.len() {
            return Err(Unbindable::Count { expected: terms.names.len(), found: values.len() });
        }
        let named = |parameters: &[usize]| listed(parameters, &terms.names, values);
        if let Some(k) = values.iter().position(|value| !value.is_finite()) {
            let what = "a parameter".to_owned();
            return Err(Unbindable::NotFinite { parameters: named(&[k]), what, value: values[k] });
        }
        let all = self.extended(values)?;
        self.assumptions.clone().check(&all).map_err(|broken| Unbindable::Structure {
            parameters: named(&broken.parameters),
            what: changed(&broken),
        })?;
        let mut constants = self.constants.clone();
        constants.bind(&all);
        let mut found = vec![0.0; self.count()];
        constants.evaluate(0.0, &[], &mut found);
        match found.iter().position(|value| !value.is_finite()) {
            None => Ok((all, found)),
            Some(k) => Err(Unbindable::NotFinite {
                parameters: named(&self.node(k).map_or_else(Vec::new, |node| self.source.graph.parameters(node))),
                what: self.what(k),
                value: found[k],
            }),
        }
    }

    fn count(&self) -> usize {
        let terms = &self.source.terms;
        terms.initial.len() + terms.mass.len() + terms.bounds.len() + terms.contacts.len()
    }

    /// Returns the graph node of the `k`-th constant that depends on parameters: initial states, entries of the mass
    /// matrix, bounds, then contact coefficients; `None` if there are not as many constants.
    fn node(&self, k: usize) -> Option<Node> {
        let terms = &self.source.terms;
        let mass = terms.mass.iter().map(|&(.., node)| node);
        let bounds = terms.bounds.iter().map(|&(_, node)| node);
        let mut nodes = terms.initial.iter().copied().chain(mass).chain(bounds).chain(terms.contacts.iter().copied());
        nodes.nth(k)
    }

    fn what(&self, k: usize) -> String {
        let terms = &self.source.terms;
        match (k.checked_sub(terms.initial.len()), k.checked_sub(terms.initial.len() + terms.mass.len())) {
            (None, _) => format!("state number {} at the start", k + 1),
            (Some(_), None) => "an entry of the mass matrix".to_owned(),
            (_, Some(_)) => "a bound or a coefficient of a contact".to_owned(),
        }
    }
}

impl Source {
    fn new(graph: &Graph, mut terms: ParametricTerms, mass: Vec<usize>) -> Self {
        let ParametricTerms { initial, mass: entries, bounds, rows, coefficients, contacts, .. } = &mut terms;
        let mut places: Vec<&mut Node> = initial.iter_mut().chain(rows.iter_mut()).chain(contacts.iter_mut()).collect();
        places.extend(entries.iter_mut().chain(coefficients.iter_mut()).map(|(.., node)| node));
        places.extend(bounds.iter_mut().map(|(_, node)| node));
        let nodes: Vec<Node> = places.iter().map(|node| **node).collect();
        let (graph, nodes) = graph.below(&nodes);
        places.into_iter().zip(nodes).for_each(|(place, node)| *place = node);
        Self { graph, terms, mass }
    }
}

impl DviModel {
    /// Returns a copy of the model with new parameter values, in the order of [`Parameters::names`]. Compiled
    /// programs are shared: nothing is parsed, differentiated or compiled.
    ///
    /// # Errors
    /// For a wrong number of values, values that are not finite or out of range, and values that would
    /// change the structure of the problem, which must then be compiled anew.
    pub fn with_parameters(&self, values: &[f64]) -> Result<Self, Unbindable> {
        let mut bound = self.clone();
        bound.bind(values)?;
        Ok(bound)
    }

    /// Returns the derivatives of the problem with respect to its parameters; `None` if it has no parameters.
    ///
    /// # Errors
    /// If a derivative exceeds the size limits of the graph.
    pub fn slopes(&self) -> Result<Option<Slopes>, ExpressionError> {
        self.parameters.as_ref().map(Parameters::slopes).transpose()
    }

    /// Binds new parameter values to the model; on error the old values stay bound.
    fn bind(&mut self, values: &[f64]) -> Result<(), Unbindable> {
        let Some(parameters) = &mut self.parameters else { return Err(Unbindable::Folded) };
        let (all, constants) = parameters.checked(values)?;
        let source = parameters.source.clone();
        let terms = &source.terms;
        let (initial, rest) = constants.split_at(terms.initial.len());
        let (mass, bounds) = rest.split_at(terms.mass.len());
        let structure = self.equations.structure();
        let mut set = structure.set.clone();
        for (&(bound, _), &value) in terms.bounds.iter().zip(bounds) {
            bound.place(value, &mut set);
        }
        for (&(bound, _), &value) in terms.bounds.iter().zip(bounds) {
            let deciding = || {
                let of_variable = terms.bounds.iter().filter(|(other, _)| other.variable == bound.variable);
                let mut all: Vec<usize> = of_variable.flat_map(|&(_, node)| source.graph.parameters(node)).collect();
                all.sort_unstable();
                all.dedup();
                listed(&all, &terms.names, values)
            };
            let name = &self.variable_names[bound.variable];
            placed(bound, value, name, &structure.set, &set, deciding)?;
        }
        if let Some(departures) = &mut parameters.departures {
            let repelled = departures.repel(&self.initial);
            departures.bind(values);
            let repels = departures.repel(initial);
            if repels != repelled {
                departures.bind(&parameters.values);
                let what = "whether a border repels at the start".to_owned();
                return Err(Unbindable::Structure { parameters: parameters.told(values), what });
            }
        }
        parameters.keep(values);
        self.initial.copy_from_slice(initial);
        self.equations.bind(&all);
        self.outputs.bind(&all);
        let structure = self.equations.structure_mut();
        structure.set = set;
        if let Mass::Constant(entries) = &mut structure.mass {
            for (&place, &value) in source.mass.iter().zip(mass) {
                if let Some(entry) = entries.get_mut(place) {
                    entry.2 = value;
                }
            }
        }
        // The text that advises to reformulate kinks by a convex set contains the old parameter values: drop it.
        self.kinks.as_set = None;
        Ok(())
    }
}

/// Checks a bound that depends on parameters in the convex set for the new parameter values: the set must be nonempty,
/// and the two bounds of a variable must be equal exactly if they were equal in the old set.
fn placed(
    bound: MovingBound,
    value: f64,
    name: &str,
    old: &ConvexSet,
    new: &ConvexSet,
    deciding: impl Fn() -> String,
) -> Result<(), Unbindable> {
    let k = bound.variable;
    if bound.side == Side::Radius {
        return match value < 0.0 {
            true => Err(Unbindable::EmptySet {
                parameters: deciding(),
                what: format!("the radius of the ball of `{name}` is {value}"),
            }),
            false => Ok(()),
        };
    }
    if new.lower[k] > new.upper[k] {
        let what = format!("`{name}` is to lie between {} and {}", new.lower[k], new.upper[k]);
        return Err(Unbindable::EmptySet { parameters: deciding(), what });
    }
    if (new.lower[k] == new.upper[k]) != (old.lower[k] == old.upper[k]) {
        let what = format!("whether the bounds of `{name}` are equal");
        return Err(Unbindable::Structure { parameters: deciding(), what });
    }
    Ok(())
}

/// Describes, for an error message, the assumption made at compilation that new parameter values violate.
fn changed(broken: &Broken) -> String {
    let Broken { given, found, .. } = broken;
    match broken.assumption {
        Assumption::Vanishing if *given == 0.0 => format!("a coefficient that was zero is {found}"),
        Assumption::Vanishing => format!("a coefficient that was {given} vanishes"),
        Assumption::Finite => format!("a term that was {given} is {found}"),
        Assumption::Value => format!("an exponent or another number that was taken for {given} is {found}"),
    }
}

/// Lists the parameters with the given indices, with their values, for messages; lists all parameters if an index is
/// beyond them, as that of a circuit coefficient.
fn listed(parameters: &[usize], names: &[String], values: &[f64]) -> String {
    const SHOWN: usize = 4;
    let every: Vec<usize> = (0..names.len()).collect();
    let parameters = if parameters.iter().all(|&k| k < names.len()) { parameters } else { &every };
    let shown = parameters.iter().take(SHOWN).map(|&k| format!("`{}` = {}", names[k], values[k]));
    let mut list: Vec<String> = shown.collect();
    if parameters.len() > SHOWN {
        list.push("...".to_owned());
    }
    list.join(", ")
}
