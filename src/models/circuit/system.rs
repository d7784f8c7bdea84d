//! Conversion of the linear forms of a circuit to a linear complementarity system and to outputs.

use super::dependent::Dependent;
use super::{Column, Columns, Element, Equations, Fault, Form, Law, Port, Quantity, Terms};
use crate::{LinearRows, ParametricTerms, Rows};
use expression::{ExpressionError, Graph, Node, Tape};
use problem::{ConvexSet, Mass, MovingBound, Side};
use std::collections::BTreeSet;

/// Converts linear forms of a circuit to nodes of an expression graph with inputs `t`, `x`, `z`.
pub struct System<'a> {
    elements: &'a [Element],
    columns: &'a Columns,
    terms: &'a Terms,
    /// For each circuit element, the time derivative of its source if a linear form contains it.
    derivatives: Vec<Option<Node>>,
}

impl<'a> System<'a> {
    /// Differentiates the sources whose time derivatives occur in the equations.
    ///
    /// # Errors
    /// The element whose source cannot be differentiated within the size limits of `graph`.
    pub fn new(
        graph: &mut Graph,
        elements: &'a [Element],
        columns: &'a Columns,
        terms: &'a Terms,
        equations: &Equations,
    ) -> Result<Self, (usize, ExpressionError)> {
        let mut derivatives = vec![None; elements.len()];
        let forms = equations.rates.iter().chain(&equations.voltages).chain(&equations.currents);
        for (column, _) in forms.flat_map(Form::terms) {
            let Column::Derivative(k) = columns.at(column) else { continue };
            let (None, Some(source)) = (derivatives[k], source(&elements[k])) else { continue };
            let gradient = graph.gradient(source).map_err(|error| (k, error))?;
            let zero = graph.constant(0.0);
            derivatives[k] = Some(gradient.first().map_or(zero, |&(_, derivative)| derivative));
        }
        Ok(Self { elements, columns, terms, derivatives })
    }

    /// Finds impulses (derivatives of discontinuous sources) and derivatives of dependent sources in the equations of a
    /// circuit, which are reported as errors.
    pub fn impulses(&self, graph: &Graph, equations: &Equations) -> Vec<Fault> {
        let jumps: Vec<bool> = self.elements.iter().map(|element| has_jump(graph, element)).collect();
        let forms = equations.rates.iter().chain(&equations.voltages).chain(&equations.currents);
        let is_dependent = |k: usize| {
            matches!(self.elements[k].law, Law::DependentVoltage | Law::DependentCurrent | Law::DependentSwitch)
        };
        let differentiated = forms.flat_map(Form::terms).filter_map(|(column, _)| match self.columns.at(column) {
            Column::Derivative(source) if is_dependent(source) => Some(source),
            _ => None,
        });
        let differentiated: BTreeSet<usize> = differentiated.collect();
        let mut faults: Vec<Fault> = differentiated.into_iter().map(Fault::Derivative).collect();
        for (element, (v, i)) in equations.voltages.iter().zip(&equations.currents).enumerate() {
            let form = match self.elements[element].law {
                Law::Capacitor(..) => i,
                Law::Inductor(..) => v,
                _ => continue,
            };
            faults.extend(form.terms().filter_map(|(column, _)| match self.columns.at(column) {
                Column::Derivative(source) if jumps[source] => Some(Fault::Impulse { source, element }),
                _ => None,
            }));
        }
        faults
    }

    /// Returns the equations of the circuit as a linear complementarity system, with the terms that depend on
    /// parameters.
    pub fn rows(&self, graph: &mut Graph, equations: &Equations) -> (LinearRows, ParametricTerms) {
        let (mut matrix, mut parametric, mut vanished) = (Vec::new(), Vec::new(), Vec::new());
        let mut bounds = Vec::new();
        for (row, form) in equations.rates.iter().chain(&equations.inequality).enumerate() {
            for (place, c) in form.terms() {
                let Column::Unknown(column) = self.columns.at(place) else { continue };
                let node = form.node(place);
                let vanishes = node.is_some_and(|node| graph.vanishes(node));
                let terms = if vanishes { &mut vanished } else { &mut parametric };
                terms.extend(node.map(|node| (row, column, node)));
                matrix.extend((!vanishes).then_some((row, column, c)));
            }
        }
        let mut forcing = |forms: &[Form]| forms.iter().map(|form| self.node(graph, form, false)).collect();
        let (state_forcing, inequality_forcing) = (forcing(&equations.rates), forcing(&equations.inequality));
        let mut set = ConvexSet::free(self.columns.ports.len());
        let mut moving = Vec::new();
        for (variable, &port) in self.columns.ports.iter().enumerate() {
            match (port, &self.elements[port.element()].law) {
                (Port::Voltage(k), &Law::Zener { forward, breakdown }) => {
                    (set.lower[variable], set.upper[variable]) = (-breakdown, forward);
                    if let Some(&node) = self.terms.0.get(&(k, Quantity::Breakdown)) {
                        bounds.push((MovingBound { variable, side: Side::Lower }, graph.negate(node)));
                    }
                    if let Some(&node) = self.terms.0.get(&(k, Quantity::Forward)) {
                        bounds.push((MovingBound { variable, side: Side::Upper }, node));
                    }
                }
                (Port::Voltage(k), &Law::Switch { closed, withstand }) => {
                    let given = self.terms.0.get(&(k, Quantity::Withstand)).copied();
                    let withstand = given.unwrap_or_else(|| graph.constant(withstand));
                    let upper = open_voltage(graph, closed, withstand);
                    let lower = graph.negate(upper);
                    for (side, node) in [(Side::Lower, lower), (Side::Upper, upper)] {
                        let bound = MovingBound { variable, side };
                        match graph.value(node) {
                            Some(value) => {
                                bound.place(value, &mut set);
                                bounds.extend(graph.number(node).is_none().then_some((bound, node)));
                            }
                            None => moving.push((bound, node)),
                        }
                    }
                }
                (Port::Source(_), _) | (Port::Voltage(_), Law::DependentSwitch) => {}
                _ => set.lower[variable] = 0.0,
            }
        }
        let mass = Mass::Identity;
        let rows = LinearRows { mass, matrix, parametric, state_forcing, inequality_forcing, set, moving };
        let mut terms = ParametricTerms { bounds, ..rows.terms() };
        terms.coefficients.extend(vanished);
        (rows, terms)
    }

    /// Returns the equations of the circuit with the laws of dependent sources and switches. The variables `s` of
    /// dependent switches come after the variables of the circuit's ports.
    pub fn dependent_rows(
        &self,
        graph: &mut Graph,
        equations: &Equations,
        dependent: &[Dependent],
    ) -> (Rows, ParametricTerms) {
        let (LinearRows { mut set, mut moving, .. }, ParametricTerms { bounds, .. }) = self.rows(graph, equations);
        let mut row = |form: &Form| self.output(graph, form);
        let rates: Vec<Node> = equations.rates.iter().map(&mut row).collect();
        let mut inequality: Vec<Node> = equations.inequality.iter().map(&mut row).collect();
        let closed = dependent.iter().filter(|law| matches!(law, Dependent::Switch { .. })).count();
        let own = inequality.len();
        let grown = ConvexSet::free(own + closed);
        let (lower, upper) = (std::mem::take(&mut set.lower), std::mem::take(&mut set.upper));
        set = grown;
        set.lower[..own].copy_from_slice(&lower);
        set.upper[..own].copy_from_slice(&upper);
        let mut parametric = bounds;
        let port = |k: usize| self.columns.ports.iter().position(|port| port.element() == k).unwrap_or_default();
        let first = 1 + self.columns.states.len() + self.columns.integrals.len();
        for law in dependent {
            match *law {
                Dependent::Source { element, law, ref bounds } => {
                    let variable = port(element);
                    let z = graph.input(first + variable);
                    inequality[variable] = law.inequality(graph, z);
                    for (side, node) in [(Side::Lower, bounds[0]), (Side::Upper, bounds[1])] {
                        let Some(node) = node else { continue };
                        let bound = MovingBound { variable, side };
                        match graph.value(node) {
                            Some(value) => {
                                bound.place(value, &mut set);
                                parametric.extend(graph.number(node).is_none().then_some((bound, node)));
                            }
                            None => moving.push((bound, node)),
                        }
                    }
                }
                Dependent::Switch { element, law, scale } => {
                    let (variable, state) = (port(element), inequality.len());
                    let s = graph.input(first + state);
                    let v = graph.input(first + variable);
                    let i = self.output(graph, &equations.currents[element]);
                    let conducts = graph.multiply(s, v);
                    let one = graph.constant(1.0);
                    let open = graph.subtract(one, s);
                    let ohms = graph.constant(scale);
                    let volts = graph.multiply(ohms, i);
                    let blocks = graph.multiply(open, volts);
                    inequality[variable] = graph.subtract(conducts, blocks);
                    inequality.push(law.inequality(graph, s));
                    (set.lower[state], set.upper[state]) = (0.0, 1.0);
                }
            }
        }
        let rows = Rows { mass: Mass::Identity, rates, inequality, set, moving };
        let terms = ParametricTerms { bounds: parametric, ..rows.terms() };
        (rows, terms)
    }

    /// Returns a linear form of a circuit as a function of `(t, x, z)`.
    pub fn output(&self, graph: &mut Graph, form: &Form) -> Node {
        self.node(graph, form, true)
    }

    /// Returns a linear form of a circuit as a node of the expression graph, with or without its terms in the unknowns
    /// `(x, z)`.
    fn node(&self, graph: &mut Graph, form: &Form, with_unknowns: bool) -> Node {
        let mut sum = graph.constant(0.0);
        for (column, c) in form.terms() {
            let factor = match self.columns.at(column) {
                Column::Unknown(place) => with_unknowns.then(|| graph.input(1 + place)),
                Column::One => Some(graph.constant(1.0)),
                Column::Source(k) => source(&self.elements[k]),
                Column::Derivative(k) => self.derivatives[k],
            };
            if let Some(factor) = factor {
                let c = form.node(column).unwrap_or_else(|| graph.constant(c));
                let term = graph.multiply(factor, c);
                sum = graph.add(sum, term);
            }
        }
        sum
    }

    /// Returns an error for each initial voltage or current given by the user that contradicts the value implied by the
    /// initial states `x` at time `t`.
    pub fn contradictions(&self, graph: &mut Graph, equations: &Equations, t: f64, x: &[f64]) -> Vec<Fault> {
        let given: Vec<(usize, f64)> = (0..self.elements.len())
            .filter_map(|k| match self.elements[k].law {
                Law::Capacitor(_, given) | Law::Inductor(_, given) => given.map(|given| (k, given)),
                _ => None,
            })
            .collect();
        let mut implied = |k: usize| match self.elements[k].law {
            Law::Capacitor(..) => self.output(graph, &equations.voltages[k]),
            _ => self.output(graph, &equations.currents[k]),
        };
        let nodes: Vec<Node> = given.iter().map(|&(k, _)| implied(k)).collect();
        let mut values = vec![0.0; nodes.len()];
        Tape::compile(graph, &nodes).evaluate(t, x, &mut values);
        // Relative tolerance for the consistency of initial voltages and currents, which users may have rounded.
        const ROUNDING: f64 = 1e-9;
        let pairs = given.into_iter().zip(values);
        pairs
            .filter(|((_, given), implied)| (given - implied).abs() > ROUNDING * given.abs().max(implied.abs()))
            .map(|((element, given), implied)| Fault::InconsistentStart { element, given, implied })
            .collect()
    }
}

/// Returns the value of an independent source as a node of the expression graph; `None` for other circuit elements.
fn source(element: &Element) -> Option<Node> {
    match element.law {
        Law::VoltageSource(node) | Law::CurrentSource(node) => Some(node),
        _ => None,
    }
}

fn has_jump(graph: &Graph, element: &Element) -> bool {
    let kinks = source(element).map(|node| graph.kinks(node)).unwrap_or_default();
    kinks.iter().any(|(function, _)| matches!(*function, "heaviside" | "sign" | "floor" | "round" | "mod" | "previous"))
}

/// Returns the largest voltage that a switch controlled by time admits: zero if the switch is closed, `withstand` if it
/// is open.
fn open_voltage(graph: &mut Graph, closed: Node, withstand: Node) -> Node {
    let is_closed = graph.heaviside(closed);
    let one = graph.constant(1.0);
    let is_open = graph.subtract(one, is_closed);
    graph.multiply(is_open, withstand)
}
