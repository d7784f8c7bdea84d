//! Element values of a circuit that depend on parameters. The coefficients of the circuit's linear forms are rational
//! functions of the element values, which are not expanded symbolically: the coefficients are additional graph inputs
//! after the parameters, and the elimination is repeated to compute the coefficients whenever new parameter values
//! are bound.

use super::{Columns, Direction, Element, Equations, Fault, Form, NormalTree, Quantity};
use expression::{ExpressionError, Graph, Node, Tape};
use rustc_hash::FxHashMap;

/// The element values of a circuit that depend on parameters, as nodes of the expression graph, by
/// `(index of the element, quantity)`.
#[derive(Clone, Debug, Default)]
pub struct Terms(pub FxHashMap<(usize, Quantity), Node>);

/// The coefficients of a circuit's linear forms as functions of its parameters, recomputed for new parameter values.
#[derive(Clone, Debug)]
pub struct CircuitParameters {
    elements: Vec<Element>,
    tree: NormalTree,
    columns: Columns,
    /// The element values of the circuit that depend on parameters, as `(index of the element, quantity)`.
    quantities: Vec<(usize, Quantity)>,
    /// The compiled expressions of the element values that depend on parameters, in the order of `quantities`.
    numbers: Tape,
    /// The derivatives of the element values with respect to parameters: for each derivative the pair
    /// `(index into quantities, parameter)`, and the compiled expressions of all derivatives.
    slopes: (Vec<(usize, usize)>, Tape),
    parameters: usize,
    /// The circuit equations at the parameter values with which the problem was compiled.
    given: Equations,
    /// The coefficients of the circuit's linear forms that depend on parameters, as `(form, column)`, with forms
    /// numbered as in `Equations::forms`.
    places: Vec<(usize, usize)>,
}

/// Why a circuit cannot be evaluated for new parameter values.
#[derive(Clone, Debug, PartialEq)]
pub enum Refused {
    /// The value of an element, given by its index, is out of range for the new parameter values.
    Number(usize, f64),
    /// A coefficient of the circuit that was zero when the problem was compiled is nonzero for the new parameter
    /// values.
    Structure,
    /// The equations of the circuit cannot be solved for the new parameter values.
    Fault(Fault),
}

impl CircuitParameters {
    /// Replaces the coefficients of `equations` that depend on parameters by graph inputs numbered after the user's
    /// `parameters`; `None` if there are no such coefficients.
    ///
    /// # Errors
    /// If an element value cannot be differentiated.
    pub fn new(
        graph: &mut Graph,
        (elements, tree, columns): (&[Element], &NormalTree, &Columns),
        equations: &mut Equations,
        terms: &Terms,
        parameters: usize,
    ) -> Result<Option<Self>, ExpressionError> {
        let mut quantities: Vec<(usize, Quantity)> = terms.0.keys().copied().collect();
        quantities.retain(|(_, quantity)| *quantity != Quantity::Start);
        quantities.sort_unstable_by_key(|&(element, quantity)| (element, quantity as u8));
        if quantities.is_empty() {
            return Ok(None);
        }
        let nodes: Vec<Node> = quantities.iter().map(|place| terms.0[place]).collect();
        let (mut places, mut derivatives) = (Vec::new(), Vec::new());
        for (place, &node) in nodes.iter().enumerate() {
            for (parameter, derivative) in graph.gradient_by_parameters(node)? {
                places.push((place, parameter));
                derivatives.push(derivative);
            }
        }
        let mut found = Self {
            elements: elements.to_vec(),
            tree: tree.clone(),
            columns: columns.clone(),
            numbers: Tape::compile(graph, &nodes),
            slopes: (places, Tape::compile(graph, &derivatives)),
            quantities,
            parameters,
            given: equations.clone(),
            places: Vec::new(),
        };
        found.places = found.varying();
        for (slot, &(form, column)) in found.places.iter().enumerate() {
            if let Some(form) = equations.forms_mut().nth(form) {
                let node = graph.parameter(parameters + slot, form.coefficient(column));
                form.let_follow(column, node);
            }
        }
        Ok(Some(found))
    }

    /// Returns the coefficients of the circuit that depend on parameters: those with a nonzero derivative with respect
    /// to an element value in `quantities`.
    fn varying(&self) -> Vec<(usize, usize)> {
        let mut places = Vec::new();
        for &place in &self.quantities {
            let direction = Direction(FxHashMap::from_iter([(place, 1.0)]));
            let Ok(equations) = Equations::along(&self.elements, &self.tree, &self.columns, &direction) else {
                continue;
            };
            for (k, form) in equations.forms().enumerate() {
                let columns = form.terms().map(|(column, _)| column);
                places.extend(columns.filter(|&column| form.with_slope(column).slope != 0.0).map(|column| (k, column)));
            }
        }
        places.sort_unstable();
        places.dedup();
        places
    }

    /// Returns the circuit elements with their values at the given parameter values.
    fn elements(&self, parameters: &[f64]) -> Result<Vec<Element>, Refused> {
        let (mut elements, mut numbers) = (self.elements.clone(), self.numbers.clone());
        let mut values = vec![0.0; self.quantities.len()];
        numbers.bind(parameters);
        numbers.evaluate(0.0, &[], &mut values);
        for (&(k, quantity), &value) in self.quantities.iter().zip(&values) {
            let in_range = value > 0.0 || value == 0.0 && quantity == Quantity::Forward;
            if !in_range || !value.is_finite() {
                return Err(Refused::Number(k, value));
            }
            elements[k].set(quantity, value);
        }
        Ok(elements)
    }

    /// Returns the parameters, followed by the circuit coefficients that depend on them.
    ///
    /// # Errors
    /// If an element value is out of range, a coefficient changes that was constant at compilation, or the
    /// equations cannot be solved.
    pub fn extended(&self, parameters: &[f64]) -> Result<Vec<f64>, Refused> {
        let elements = self.elements(parameters)?;
        let equations = Equations::new(&elements, &self.tree, &self.columns).map_err(Refused::Fault)?;
        let all: Vec<&Form> = equations.forms().collect();
        for (k, (form, given)) in all.iter().zip(self.given.forms()).enumerate() {
            let size = form.terms().map(|(_, c)| c.abs()).fold(0.0, f64::max);
            let mut columns = form.terms().chain(given.terms()).map(|(column, _)| column);
            // Coefficients that do not depend on parameters may still change by rounding errors of the elimination,
            // relative to their size.
            const ROUNDING: f64 = 1e-12;
            let changes = |column: usize| {
                let off = (form.coefficient(column) - given.coefficient(column)).abs();
                off > ROUNDING * size && self.places.binary_search(&(k, column)).is_err()
            };
            if columns.any(changes) {
                return Err(Refused::Structure);
            }
        }
        let coefficients = self.places.iter().map(|&(form, column)| all[form].coefficient(column));
        Ok(parameters.iter().copied().chain(coefficients).collect())
    }

    /// Returns the derivatives of the circuit's coefficients that depend on parameters, at the given parameter values,
    /// one vector per parameter.
    pub fn slopes(&self, parameters: &[f64]) -> Vec<Vec<f64>> {
        let (places, mut tape) = (&self.slopes.0, self.slopes.1.clone());
        let mut values = vec![0.0; places.len()];
        tape.bind(parameters);
        tape.evaluate(0.0, &[], &mut values);
        let elements = self.elements(parameters).unwrap_or_else(|_| self.elements.clone());
        let by = |parameter: usize| {
            let of_numbers = places.iter().zip(&values).filter(|((_, by), _)| *by == parameter);
            let direction =
                Direction(of_numbers.map(|(&(place, _), &slope)| (self.quantities[place], slope)).collect());
            let Ok(equations) = Equations::along(&elements, &self.tree, &self.columns, &direction) else {
                return vec![f64::NAN; self.places.len()];
            };
            let all: Vec<&Form> = equations.forms().collect();
            self.places.iter().map(|&(form, column)| all[form].with_slope(column).slope).collect()
        };
        (0..self.parameters).map(by).collect()
    }

    /// Returns the number of coefficients of the circuit that depend on parameters.
    pub fn len(&self) -> usize {
        self.places.len()
    }

    /// Returns whether no coefficient of the circuit depends on parameters.
    pub fn is_empty(&self) -> bool {
        self.places.is_empty()
    }
}

impl Equations {
    /// Returns all linear forms of the circuit: rates, `G`, voltages, currents, node voltages.
    fn forms(&self) -> impl Iterator<Item = &Form> {
        let Self { rates, inequality, voltages, currents, nodes } = self;
        [rates, inequality, voltages, currents, nodes].into_iter().flatten()
    }

    fn forms_mut(&mut self) -> impl Iterator<Item = &mut Form> {
        let Self { rates, inequality, voltages, currents, nodes } = self;
        [rates, inequality, voltages, currents, nodes].into_iter().flatten()
    }
}
