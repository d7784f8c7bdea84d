//! The context in which a problem of any type is lowered, that is, translated from the user's notation to expression
//! graphs and a model: names, expressions, and the errors found so far.
//!
//! Inputs are numbered `t = 0`, states `1..=n`, variables `n+1..=n+m`. An expression that cannot be read is reported
//! and yields `None`; the caller substitutes a harmless value and continues, so that the rest of the document is
//! checked as well.
//!
//! Parameters are either constants, or inputs that can be bound to other values later. In the second case, parameters
//! defined as expressions in others are graph nodes and are recomputed from them.

use super::error::{Errors, SpecificationError};
use super::expression::Expression;
use super::ordered::Ordered;
use super::parameters;
use super::pointer::Pointer;
use super::tables::TableOfPoints;
use super::wording::abridged;
use expression::{Assumption, Graph, NameError, Node, Scope};
use models::{Parameters, ParametricTerms};
use problem::{Control, Mass};
use std::collections::HashMap;

/// Largest number of states and variables of a specification.
pub(super) const MOST_UNKNOWNS: usize = 2_000_000;

/// Start time of a problem, parameters with a special role, and the control that may stop the check.
#[derive(Clone, Copy, Debug)]
pub(super) struct Start<'c> {
    /// The start time of the problem; `None` if initial values are not to be evaluated.
    pub time: Option<f64>,
    pub control: &'c Control,
    /// Parameters used as sizes of vectors; they cannot be bound to other values.
    pub sizes: &'c [String],
    /// Parameters that an analysis varies: sensitivities, a fit or a continuation.
    pub varied: &'c [String],
}

/// The named quantities of a problem besides its states and variables.
#[derive(Clone, Copy, Debug)]
pub(super) struct Named<'a> {
    pub parameters: &'a Ordered<Expression>,
    pub tables: &'a Ordered<TableOfPoints>,
    pub definitions: &'a Ordered<Expression>,
    pub integrals: &'a Ordered<Expression>,
}

/// The state while one problem is lowered (translated to graph nodes and a model): expression graph, names in scope,
/// and errors found so far.
#[derive(Debug)]
pub(super) struct Lowering<'c> {
    pub graph: Graph,
    pub errors: Errors,
    /// The start time, if the initial values are valid and are to be evaluated.
    pub start: Option<f64>,
    pub control: &'c Control,
    /// Parameters that are bindable inputs of the expression graph, with their values.
    inputs: Vec<(String, f64)>,
    constants: Scope,
    names: Scope,
    misnamed: bool,
    /// Names of definitions that jump (are discontinuous) in a state or a variable: allowed as output columns, not in
    /// equations.
    jumping: Vec<String>,
    /// Names of parameters or definitions with circular references, direct or indirect.
    circular: Vec<String>,
}

/// The value of a constant expression, with its graph node if it depends on parameters that are inputs of the graph.
#[derive(Clone, Copy, Debug)]
pub(super) struct Constant {
    pub value: f64,
    pub node: Option<Node>,
}

/// Error code of an expression that jumps (is discontinuous) in a state or a variable.
const JUMP: &str = "jump_of_unknown";

/// Nodes or rows lowered between two polls of [`Control`]: less than a millisecond of work for short expressions.
const BETWEEN_POLLS: usize = 256;

impl<'c> Lowering<'c> {
    /// Begins to lower a problem: binds `t` and the names of its tables and parameters. The parameters are constants
    /// of the graph, which cannot be bound to other values.
    pub(super) fn new(start: Start<'c>, named: Named<'_>, problem: &Pointer<'_>) -> Self {
        Self::begin(start, named, problem, false)
    }

    /// Begins to lower a problem: binds `t` and the names of its tables and parameters. The parameters are inputs of
    /// the graph, which can be bound to other values.
    pub(super) fn with_inputs(start: Start<'c>, named: Named<'_>, problem: &Pointer<'_>) -> Self {
        Self::begin(start, named, problem, true)
    }

    fn begin(start: Start<'c>, named: Named<'_>, problem: &Pointer<'_>, are_inputs: bool) -> Self {
        let mut lowering = Self {
            graph: Graph::default(),
            errors: Errors::default(),
            start: start.time,
            control: start.control,
            inputs: Vec::new(),
            constants: Scope::default(),
            names: Scope::default(),
            misnamed: false,
            jumping: Vec::new(),
            circular: Vec::new(),
        };
        let t = lowering.graph.input(0);
        lowering.bind("t", t, problem);
        lowering.bind_tables(named.tables, &problem.key("tables"));
        let place = problem.key("parameters");
        for (name, value) in lowering.in_order(named.parameters, true) {
            let place = place.key(name);
            let value = lowering.parametric(value, &place);
            let node = match value {
                Some(Constant { node: Some(node), .. }) => {
                    lowering.graph.assume(node, Assumption::Finite);
                    node
                }
                Some(Constant { value, .. }) if are_inputs => {
                    lowering.inputs.push((name.to_owned(), value));
                    let node = lowering.graph.parameter(lowering.inputs.len() - 1, value);
                    if start.varied.iter().any(|varied| varied == name) {
                        lowering.graph.vary(node);
                    }
                    if start.sizes.iter().any(|size| size == name) {
                        lowering.graph.assume(node, Assumption::Value);
                    }
                    node
                }
                value => lowering.graph.constant(value.map_or(1.0, |constant| constant.value)),
            };
            if lowering.bind(name, node, &place) {
                // The name of a parameter is valid and new in `names`, so binding it in the smaller scope `constants`
                // cannot fail.
                let _ = lowering.constants.bind(name, node);
            }
            if value.is_none() {
                lowering.start = None;
            }
        }
        lowering
    }

    /// Sorts parameters or definitions so that each follows those that it depends on; records those with circular
    /// references.
    fn in_order<'a>(&mut self, entries: &'a Ordered<Expression>, constant: bool) -> Vec<(&'a str, &'a Expression)> {
        let scope = if constant { &self.constants } else { &self.names };
        let (entries, ordered) = parameters::in_order(entries, scope, &self.graph);
        self.circular = entries[ordered..].iter().map(|(name, _)| (*name).to_owned()).collect();
        entries
    }

    /// Binds the names of the tables. A faulty table is left out, and expressions that call it are not checked further.
    fn bind_tables(&mut self, tables: &Ordered<TableOfPoints>, place: &Pointer<'_>) {
        for (name, points) in tables.iter() {
            let place = place.key(name);
            let Some(table) = points.table(&place, &mut self.errors) else {
                self.misnamed = true;
                continue;
            };
            match self.names.bind_table(name, table.clone()) {
                // The name of a table is valid and new in `names`, so binding it in the smaller scope `constants`
                // cannot fail.
                Ok(()) => drop(self.constants.bind_table(name, table)),
                Err(error) => self.report_name(error, place.to_string()),
            }
        }
    }

    /// Polls the control every `BETWEEN_POLLS` items of a long list; after a request to stop, reports the interruption
    /// and returns false.
    pub(super) fn goes_on(&mut self, item: usize) -> bool {
        let goes_on = !item.is_multiple_of(BETWEEN_POLLS) || self.control.poll().is_none();
        if !goes_on {
            self.errors.push(SpecificationError::interrupted());
        }
        goes_on
    }

    /// Binds the names of the states and then the variables, in order. Afterwards, functions that jump reject
    /// arguments that depend on states or variables.
    pub(super) fn bind_unknowns<'a>(
        &mut self,
        names: impl Iterator<Item = &'a str>,
        pointer: impl Fn(usize) -> String,
    ) {
        self.names.solve_for(1);
        self.bind_coordinates(names, pointer);
    }

    /// Binds the names of the coordinates in space of an obstacle or elastic problem, in order.
    pub(super) fn bind_coordinates<'a>(
        &mut self,
        names: impl Iterator<Item = &'a str>,
        pointer: impl Fn(usize) -> String,
    ) {
        for (i, name) in names.enumerate() {
            let node = self.graph.input(i + 1);
            self.bind_at(name, node, || pointer(i));
        }
    }

    /// Binds the names of a problem's outputs in place of states and variables.
    pub(super) fn bind_outputs(&mut self, names: &[&str]) {
        for (i, name) in names.iter().enumerate() {
            let node = self.graph.input(i + 1);
            let _ = self.names.bind_output(name, node);
        }
    }

    /// Binds names to nodes that depend on unknowns. Afterwards, functions that jump reject arguments that depend on
    /// these names.
    pub(super) fn bind_quantities(&mut self, quantities: &[(String, Node)]) {
        self.names.solve_for(1);
        for (name, node) in quantities {
            // A name that is bound already denotes this quantity.
            let _ = self.names.bind_output(name, *node);
        }
    }

    /// Whether all names and functions of an expression are known. Other errors are reported when the expression is
    /// parsed to a graph node.
    pub(super) fn is_readable(&mut self, expression: &Expression) -> bool {
        let Expression::Text(text) = expression else { return true };
        let unknown = |code: &str| matches!(code, "unknown_name" | "unknown_function");
        self.graph.parse(text, &self.names).map_or_else(|error| !unknown(error.code), |_| true)
    }

    /// Binds the definitions whose names are all known, for use in expressions. Errors in definitions are reported by
    /// `define`.
    pub(super) fn use_definitions(&mut self, definitions: &Ordered<Expression>) {
        for (name, expression) in self.in_order(definitions, false) {
            let node = match expression {
                Expression::Number(value) => Ok(self.graph.constant(*value)),
                Expression::Text(text) => self.graph.parse(text, &self.names),
            };
            match node {
                Ok(node) => drop(self.names.bind(name, node)),
                Err(error) if error.code == JUMP => self.jumping.push(name.to_owned()),
                Err(_) => {}
            }
        }
    }

    /// Binds all definitions and returns their nodes in the order of the document.
    pub(super) fn define(&mut self, definitions: &Ordered<Expression>, problem: &Pointer<'_>) -> Vec<Node> {
        let place = problem.key("definitions");
        let mut nodes = HashMap::with_capacity(definitions.len());
        for (name, expression) in self.in_order(definitions, false) {
            let place = place.key(name);
            let node = self.node_or_zero(expression, &place);
            self.bind(name, node, &place);
            nodes.insert(name, node);
        }
        definitions.names().filter_map(|name| nodes.get(name).copied()).collect()
    }

    /// Parses an expression, in which all bound names may occur, to a graph node; a faulty expression becomes zero.
    pub(super) fn node_or_zero(&mut self, expression: &Expression, place: &Pointer<'_>) -> Node {
        self.node(expression, place).unwrap_or_else(|| self.graph.constant(0.0))
    }

    /// Reserves a name, such as that of an integral, that expressions must not refer to.
    pub(super) fn keep_name(&mut self, name: &str, place: &Pointer<'_>) {
        let nothing = self.graph.constant(0.0);
        self.bind(name, nothing, place);
    }

    fn bind(&mut self, name: &str, node: Node, place: &Pointer<'_>) -> bool {
        self.bind_at(name, node, || place.to_string())
    }

    fn bind_at(&mut self, name: &str, node: Node, pointer: impl FnOnce() -> String) -> bool {
        let Err(error) = self.names.bind(name, node) else { return true };
        self.report_name(error, pointer());
        false
    }

    fn report_name(&mut self, error: NameError, pointer: String) {
        let code = match error {
            NameError::Malformed { .. } => "malformed_name",
            NameError::Reserved { .. } => "reserved_name",
            NameError::Bound { .. } => "duplicate_name",
        };
        self.misnamed |= !matches!(error, NameError::Bound { .. });
        let expected = "a unique name: letters, digits and _, not beginning with a digit, and not a reserved word";
        let detail = match &error {
            NameError::Bound { name } if name == "t" => "`t` is the time".to_owned(),
            _ => error.to_string(),
        };
        self.errors.push(SpecificationError::new(pointer, code, detail).expected(expected));
    }

    /// Parses an expression in `t`, the parameters, the states and the variables to a graph node.
    pub(super) fn node(&mut self, expression: &Expression, place: &Pointer<'_>) -> Option<Node> {
        match expression {
            Expression::Number(value) => Some(self.graph.constant(*value)),
            Expression::Text(text) => self.parse(text, place, false),
        }
    }

    /// Parses an expression to a graph node. All bound names may occur in it, and the names `further`, each of which
    /// yields to a bound name equal to it.
    pub(super) fn node_with(
        &mut self,
        further: &[(&str, Node)],
        expression: &Expression,
        place: &Pointer<'_>,
    ) -> Option<Node> {
        let names = self.names.clone();
        // A further name that the user has bound already keeps the user's meaning.
        for &(name, node) in further {
            let _ = self.names.bind(name, node);
        }
        let lowered = self.node(expression, place);
        self.names = names;
        lowered
    }

    /// Evaluates an expression in the parameters alone, which must be finite, and fixes its value: parameters that it
    /// depends on cannot be bound to other values.
    pub(super) fn constant(&mut self, expression: &Expression, place: &Pointer<'_>) -> Option<f64> {
        let Constant { value, node } = self.parametric(expression, place)?;
        if let Some(node) = node {
            self.graph.assume(node, Assumption::Value);
        }
        Some(value)
    }

    /// Evaluates an expression in the parameters alone, which must be finite; it stays a function of the parameters
    /// that can be bound to other values.
    pub(super) fn parametric(&mut self, expression: &Expression, place: &Pointer<'_>) -> Option<Constant> {
        let (value, node) = match expression {
            Expression::Number(value) => (Some(*value), None),
            Expression::Text(text) => {
                let node = self.parse(text, place, true)?;
                (self.graph.value(node), self.graph.number(node).is_none().then_some(node))
            }
        };
        let finite = value.filter(|value| value.is_finite());
        if finite.is_none() {
            let detail = match (expression, value) {
                (Expression::Text(text), Some(value)) => format!("`{}` is {value}", abridged(text)),
                _ => "this has no finite value".into(),
            };
            self.errors
                .push(SpecificationError::new(place.to_string(), "not_finite", detail).expected("a finite constant"));
        }
        finite.map(|value| Constant { value, node })
    }

    /// Reads an initial value of a state; returns the value (zero for a faulty expression) and its graph node.
    pub(super) fn initial(&mut self, given: &Expression, place: &Pointer<'_>) -> (f64, Node) {
        let constant = self.parametric(given, place).unwrap_or(Constant { value: 0.0, node: None });
        let node = constant.node.unwrap_or_else(|| self.graph.constant(constant.value));
        (constant.value, node)
    }

    /// Returns the sum of two constants of a problem, with a graph node if either depends on parameters.
    pub(super) fn sum(&mut self, a: Constant, b: Constant) -> Constant {
        let value = a.value + b.value;
        if a.node.or(b.node).is_none() {
            return Constant { value, node: None };
        }
        let [a, b] = [a, b].map(|constant| constant.node.unwrap_or_else(|| self.graph.constant(constant.value)));
        Constant { value, node: Some(self.graph.add(a, b)) }
    }

    /// Fixes the values of all parameters, so that no parameter can be bound to another value.
    pub(super) fn keep_values(&mut self) {
        for (index, &(_, value)) in self.inputs.iter().enumerate() {
            let node = self.graph.parameter(index, value);
            self.graph.assume(node, Assumption::Value);
        }
    }

    /// Number of parameters that are bindable inputs of the expression graph.
    pub(super) fn inputs(&self) -> usize {
        self.inputs.len()
    }

    /// Returns the bindable parameters of the equations compiled from this graph, with the given mass matrix; `None`
    /// if there are none, or after errors.
    pub(super) fn parameters(&self, terms: ParametricTerms, mass: &Mass) -> Option<Parameters> {
        if self.inputs.is_empty() || !self.errors.is_empty() {
            return None;
        }
        let (names, values) = self.inputs.iter().cloned().unzip();
        Some(Parameters::new(&self.graph, ParametricTerms { names, values, ..terms }, mass))
    }

    fn parse(&mut self, text: &str, place: &Pointer<'_>, constant: bool) -> Option<Node> {
        // After a faulty name or a full list of errors, parsing expressions would only add misleading errors.
        if self.misnamed || !self.errors.has_room() {
            return None;
        }
        let scope = if constant { &self.constants } else { &self.names };
        let mut error = match self.graph.parse(text, scope) {
            Ok(node) => return Some(node),
            Err(error) => error,
        };
        let goes_on = |c: char| c.is_ascii_alphanumeric() || c == '_';
        let word = text[error.offset..].split(|c| !goes_on(c)).next().filter(|_| error.code == "unknown_name");
        let is_name = |name: &&String| word == Some(name.as_str());
        if let Some(name) = self.jumping.iter().find(is_name) {
            error.message = format!(
                "`{}` jumps with a state or a variable: it can be an output column, but not part of an equation",
                abridged(name)
            );
            error.code = JUMP;
            error.expected =
                Some("a variable in a set, whose switches are located, in place of the function that jumps".to_owned());
        }
        if word.is_some_and(|word| self.circular.iter().any(|name| name == word)) {
            error.message = parameters::circular(&self.circular);
            error.expected = Some("expressions without circular references: one of them a number".to_owned());
            error.did_you_mean = None;
        }
        let detail = format!("{}\n{}", error.message, error.caret(text));
        let mut report =
            SpecificationError::new(place.to_string(), error.code, detail).did_you_mean(error.did_you_mean);
        report.expected = error.expected;
        if constant && error.code == "unknown_name" {
            report = report.expected(if self.graph.parse(text, &self.names).is_ok() {
                "a constant: a parameter cannot depend on `t`; put it under `definitions`"
            } else {
                "a number, or an expression in other parameters"
            });
        }
        self.errors.push(report);
        None
    }
}
