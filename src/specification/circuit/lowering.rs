//! Translation of named components to the numbered nodes and elements of a circuit.

use super::components::{Component, Transformer};
use super::dependent;
use super::faults::Names;
use super::{CircuitProblem, MOST_COMPONENTS, model, netlist};
use crate::error::SpecificationError;
use crate::expression::Expression;
use crate::lowering::{Lowering, Named, Start};
use crate::model::Model;
use crate::ordered::Ordered;
use crate::pointer::Pointer;
use crate::wording::abridged;
use crate::written::{Lowered, Written};
use expression::Node;
use models::circuit::Terms;
use std::collections::HashMap;
use std::sync::Arc;

/// The name of the ground node of a circuit.
pub(super) const GROUND: &str = "0";

impl Written for CircuitProblem {
    fn key(&self) -> &'static str {
        "circuit"
    }

    fn named(&self) -> Named<'_> {
        let Self { parameters, tables, definitions, integrals, .. } = self;
        Named { parameters, tables, definitions, integrals }
    }

    fn unknowns(&self) -> usize {
        self.components.as_ref().map_or(0, Vec::len)
    }

    fn lower<'c>(&self, place: &Pointer<'_>, start: Start<'c>) -> Lowered<'c> {
        let mut lowering = Lowering::with_inputs(start, self.named(), place);
        lowering.use_definitions(&self.definitions);
        let model = match (&self.components, &self.netlist) {
            (Some(components), None) => {
                let circuit = Circuit::new(components, place.key("components"), None);
                circuit.model((&self.definitions, &[]), &mut lowering)
            }
            (None, Some(text)) => {
                let place = place.key("netlist");
                match netlist::read(text) {
                    Ok(netlist::Netlist { components, lines, remarks, .. }) => {
                        let circuit = Circuit::new(&components, place, Some(&lines));
                        circuit.model((&self.definitions, &remarks), &mut lowering)
                    }
                    Err(errors) => {
                        errors.into_iter().for_each(|error| lowering.errors.push(error.at(&place)));
                        None
                    }
                }
            }
            _ => {
                let detail = "a circuit is given either by its `components` or by a `netlist`";
                let error = SpecificationError::new(place.to_string(), "components_or_netlist", detail);
                lowering.errors.push(error.expected("one of `components`, `netlist`"));
                None
            }
        };
        (lowering, model)
    }
}

/// The components of a circuit, with their places in the document.
pub(super) struct Circuit<'a> {
    pub(super) components: &'a [Component],
    /// For each circuit element, the index of the component that it belongs to.
    pub(super) owners: Vec<usize>,
    place: Pointer<'a>,
    /// The line of each component in the netlist, if the circuit is given as a netlist.
    pub(super) lines: Option<&'a [usize]>,
}

impl<'a> Circuit<'a> {
    fn new(components: &'a [Component], place: Pointer<'a>, lines: Option<&'a [usize]>) -> Self {
        let owners =
            components.iter().enumerate().flat_map(|(k, component)| vec![k; component.nodes().len()]).collect();
        Self { components, owners, place, lines }
    }

    /// Builds the model of the circuit; `remarks` are warnings about how the netlist was read.
    fn model(
        &self,
        (definitions, remarks): (&Ordered<Expression>, &[String]),
        lowering: &mut Lowering,
    ) -> Option<Arc<dyn Model>> {
        let count = self.components.len();
        if count == 0 || count > MOST_COMPONENTS {
            let detail = format!("{count} components");
            let error = SpecificationError::new(self.place.to_string(), "number_of_components", detail);
            lowering.errors.push(error.expected(format!("1 to {MOST_COMPONENTS} components")));
            return None;
        }
        let nodes = self.nodes(lowering);
        let mut names = vec![GROUND; nodes.len()];
        nodes.iter().for_each(|(name, &node)| names[node] = name);
        let windings = |component: &Component| match component {
            Component::Transformer(Transformer { name, .. }) => {
                vec![format!("{name}.primary"), format!("{name}.secondary")]
            }
            component => vec![component.name().to_owned()],
        };
        let names = Names {
            components: self.components.iter().flat_map(windings).collect(),
            nodes: names,
            pointer: &|k| self.member(self.owners[k]),
            whole: self.place.to_string(),
        };
        // Either winding of a transformer may act as the voltage source, depending on the loops of the circuit. Start
        // with one choice, and swap the transformers at which the equations fail.
        let mut swapped = vec![false; count];
        let mut first = None;
        loop {
            let (mut terms, mut elements, mut drives) = (Terms::default(), Vec::new(), Vec::new());
            for (k, &swapped) in swapped.iter().enumerate() {
                self.elements((k, swapped), &nodes, &mut terms, (&mut elements, &mut drives), lowering);
            }
            if !lowering.errors.is_empty() {
                return None;
            }
            let errors =
                match model::model(self, (&elements, &terms, &drives), (&names, definitions, remarks), lowering) {
                    Ok(model) => return Some(model),
                    Err(errors) => errors,
                };
            let is_named = |k: usize| errors.iter().any(|error| error.pointer == self.member(k));
            let is_transformer = |k: &usize| matches!(self.components[*k], Component::Transformer(_));
            let left: Vec<usize> = (0..count).filter(is_transformer).filter(|&k| !swapped[k]).collect();
            // The transformers whose other winding is to act as the voltage source: those that the errors name, or else
            // all that have not been swapped yet.
            let named: Vec<usize> = left.iter().copied().filter(|&k| is_named(k)).collect();
            let turned = if named.is_empty() { left } else { named };
            let errors = first.get_or_insert(errors);
            if turned.is_empty() {
                // An unknown name in an expression may be the cause of the fault of the circuit, so report it first.
                dependent::check_names(self, &drives, (&names, definitions), lowering);
                errors.drain(..).for_each(|error| lowering.errors.push(self.placed(error)));
                return None;
            }
            turned.into_iter().for_each(|k| swapped[k] = true);
        }
    }

    fn at_component(&self, k: usize) -> String {
        match self.lines {
            Some(_) => self.place.to_string(),
            None => self.member(k),
        }
    }

    /// Returns the JSON pointer of component `k` in a list of components, by which errors name the component; errors of
    /// a netlist have such pointers until [`Self::placed`] replaces them.
    fn member(&self, k: usize) -> String {
        self.place.index(k).key(self.components[k].key()).to_string()
    }

    /// Returns an error of a component, moved to the line of the component if the circuit is given as a netlist.
    fn placed(&self, error: SpecificationError) -> SpecificationError {
        let Some(lines) = self.lines else { return error };
        match (0..self.components.len()).find(|&k| error.pointer == self.member(k)) {
            Some(k) => SpecificationError {
                pointer: self.place.to_string(),
                detail: format!("line {}: {}", lines[k], error.detail),
                ..error
            },
            None => error,
        }
    }

    /// Numbers the nodes of the circuit by name, ground first, and reports faulty names.
    fn nodes(&self, lowering: &mut Lowering) -> HashMap<&str, usize> {
        let mut nodes = HashMap::from([(GROUND, 0)]);
        for (k, component) in self.components.iter().enumerate() {
            let of_nodes = component.nodes().into_iter().chain(component.inputs());
            for name in of_nodes.flat_map(|(a, b)| [a.as_str(), b]).chain([component.name()]) {
                if !is_name(name) {
                    let expected = format!("letters, digits and any of `_ + - .`, at most {LONGEST_NAME}");
                    let detail = format!("`{}` is not the name of a component or a node", abridged(name));
                    self.report(k, "malformed_name", &detail, &expected, lowering);
                }
            }
            for (a, b) in component.nodes() {
                for name in [a, b] {
                    let next = nodes.len();
                    nodes.entry(name.as_str()).or_insert(next);
                }
                if a == b {
                    let detail =
                        format!("both ends of `{}` are at the node `{}`", abridged(component.name()), abridged(a));
                    self.report(k, "shorted_component", &detail, "two nodes", lowering);
                }
            }
        }
        for (k, component) in self.components.iter().enumerate() {
            for name in component.inputs().into_iter().flat_map(|(a, b)| [a, b]) {
                if !nodes.contains_key(name.as_str()) {
                    let detail = format!(
                        "no component is at the node `{}`, an input of `{}`",
                        abridged(name),
                        abridged(component.name())
                    );
                    self.report(k, "unknown_name", &detail, "a node of another component", lowering);
                }
            }
        }
        let mut seen = HashMap::new();
        for (k, component) in self.components.iter().enumerate() {
            let name = component.name();
            if let Some(first) = seen.insert(name, k) {
                let detail = format!("`{}` is a component already, at {}", abridged(name), self.at(first));
                self.report(k, "duplicate_name", &detail, "a unique name", lowering);
            } else if nodes.contains_key(name) {
                let detail = format!("`{}` is a node as well, and `v({0})` would be both", abridged(name));
                self.report(k, "duplicate_name", &detail, "a name that no node has", lowering);
            }
        }
        nodes
    }

    pub(super) fn node(&self, k: usize, key: &str, expression: &Expression, lowering: &mut Lowering) -> Node {
        let known = lowering.errors.count();
        let node = self.within(k, key, |place| lowering.node_or_zero(expression, place));
        if let Some(lines) = self.lines {
            lowering.errors.at_line(known, lines[self.owners[k]]);
        }
        node
    }

    /// Calls `call` with the JSON pointer to the member `key` of the component of element `k`. All components of a
    /// netlist share one pointer.
    pub(super) fn within<T>(&self, k: usize, key: &str, call: impl FnOnce(&Pointer<'_>) -> T) -> T {
        match self.lines {
            Some(_) => call(&self.place),
            None => call(&self.place.index(self.owners[k]).key(self.owner(k).key()).key(key)),
        }
    }

    /// Returns the component that circuit element `k` belongs to.
    pub(super) fn owner(&self, k: usize) -> &Component {
        &self.components[self.owners[k]]
    }

    fn at(&self, k: usize) -> String {
        self.at_component(self.owners[k])
    }

    pub(super) fn report(&self, k: usize, code: &'static str, detail: &str, expected: &str, lowering: &mut Lowering) {
        let detail = match self.lines {
            Some(lines) => format!("line {}: {detail}", lines[self.owners[k]]),
            None => detail.to_owned(),
        };
        lowering.errors.push(SpecificationError::new(self.at(k), code, detail).expected(expected));
    }
}

/// Largest length of the name of a component or a node, in characters.
const LONGEST_NAME: usize = 60;

fn is_name(text: &str) -> bool {
    let allowed = |c: char| c.is_ascii_alphanumeric() || "_+-.".contains(c);
    !text.is_empty() && text.len() <= LONGEST_NAME && text.chars().all(allowed)
}
