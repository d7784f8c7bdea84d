//! From components with names to the elements of a circuit.

use super::components::*;
use super::faults::Names;
use super::{CircuitProblem, MOST_COMPONENTS, model, netlist};
use crate::error::SpecificationError;
use crate::expression::Expression;
use crate::lowering::{Constant, Lowering, Named, Start};
use crate::model::Model;
use crate::place::Place;
use crate::wording::abridged;
use crate::written::{Lowered, Written};
use models::circuit::{Element, Law, Quantity, Terms};
use std::collections::HashMap;
use std::sync::Arc;

/// The name of ground.
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

    fn lower<'c>(&self, place: &Place<'_>, start: Start<'c>) -> Lowered<'c> {
        let mut lowering = Lowering::with_inputs(start, self.named(), place);
        lowering.use_definitions(&self.definitions);
        let model = match (&self.components, &self.netlist) {
            (Some(components), None) => {
                let circuit = Circuit { components, place: place.key("components"), lines: None };
                circuit.model(&mut lowering)
            }
            (None, Some(text)) => {
                let place = place.key("netlist");
                match netlist::read(text) {
                    Ok(netlist::Netlist { components, lines }) => {
                        Circuit { components: &components, place, lines: Some(&lines) }.model(&mut lowering)
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

/// Components, with where they stand.
#[derive(Clone, Copy)]
struct Circuit<'a> {
    components: &'a [Component],
    place: Place<'a>,
    /// The line of each in a netlist.
    lines: Option<&'a [usize]>,
}

impl Circuit<'_> {
    fn model(&self, lowering: &mut Lowering) -> Option<Arc<dyn Model>> {
        let count = self.components.len();
        if count == 0 || count > MOST_COMPONENTS {
            let detail = format!("{count} components");
            let error = SpecificationError::new(self.place.to_string(), "number_of_components", detail);
            lowering.errors.push(error.expected(format!("1 to {MOST_COMPONENTS} components")));
            return None;
        }
        let nodes = self.nodes(lowering);
        let mut terms = Terms::default();
        let elements = (0..count).map(|k| self.element(k, &nodes, &mut terms, lowering)).collect::<Vec<_>>();
        if !lowering.errors.is_empty() {
            return None;
        }
        let mut names = vec![GROUND; nodes.len()];
        nodes.iter().for_each(|(name, &node)| names[node] = name);
        let names = Names {
            components: self.components.iter().map(Component::name).collect(),
            nodes: names,
            pointer: &|k| self.at(k),
            whole: self.place.to_string(),
        };
        match model::model(&elements, &terms, &names, lowering) {
            Ok(model) => Some(model),
            Err(errors) => {
                errors.into_iter().for_each(|error| lowering.errors.push(error));
                None
            }
        }
    }

    /// The nodes by name, ground first; what is wrong with names is reported.
    fn nodes(&self, lowering: &mut Lowering) -> HashMap<&str, usize> {
        let mut nodes = HashMap::from([(GROUND, 0)]);
        for (k, component) in self.components.iter().enumerate() {
            let (a, b) = component.nodes();
            for name in [component.name(), a, b] {
                if !is_name(name) {
                    let expected = format!("letters, digits and any of `_ + - .`, at most {LONGEST_NAME}");
                    let detail = format!("`{}` is no name of a component or a node", abridged(name));
                    self.report(k, "malformed_name", &detail, &expected, lowering);
                }
            }
            for name in [a, b] {
                let next = nodes.len();
                nodes.entry(name.as_str()).or_insert(next);
            }
            if a == b {
                let detail = format!("both ends of `{}` are at the node `{}`", abridged(component.name()), abridged(a));
                self.report(k, "shorted_component", &detail, "two nodes", lowering);
            }
        }
        let mut seen = HashMap::new();
        for (k, component) in self.components.iter().enumerate() {
            let name = component.name();
            if let Some(first) = seen.insert(name, k) {
                let detail = format!("`{}` is a component already, at {}", abridged(name), self.at(first));
                self.report(k, "duplicate_name", &detail, "a name of its own", lowering);
            } else if nodes.contains_key(name) {
                let detail = format!("`{}` is a node as well, and `v({0})` would be both", abridged(name));
                self.report(k, "duplicate_name", &detail, "a name that no node has", lowering);
            }
        }
        nodes
    }

    fn element(&self, k: usize, nodes: &HashMap<&str, usize>, terms: &mut Terms, lowering: &mut Lowering) -> Element {
        let component = &self.components[k];
        let (a, b) = component.nodes();
        let (above, any) = (Some((0.0, false)), None);
        let not_below = Some((0.0, true));
        let mut value = |key, expression: &Expression, least| {
            let Constant { value, node } = self.value(k, key, expression, least, lowering);
            terms.0.extend(node.map(|node| ((k, quantity(key)), node)));
            value
        };
        let law = match component {
            Component::Resistor(resistor) => Law::Resistor(value("ohms", &resistor.ohms, above)),
            Component::Capacitor(Capacitor { farads, volts, .. }) => {
                let volts = volts.as_ref().map(|volts| value("volts", volts, any));
                Law::Capacitor(value("farads", farads, above), volts)
            }
            Component::Inductor(Inductor { henries, amperes, .. }) => {
                let amperes = amperes.as_ref().map(|amperes| value("amperes", amperes, any));
                Law::Inductor(value("henries", henries, above), amperes)
            }
            Component::Diode(Diode { forward_volts, .. }) => {
                let forward = forward_volts.as_ref().map_or(0.0, |volts| value("forward_volts", volts, not_below));
                Law::Diode { forward }
            }
            Component::Zener(Zener { forward_volts, breakdown_volts, .. }) => {
                let forward = forward_volts.as_ref().map_or(0.0, |volts| value("forward_volts", volts, not_below));
                Law::Zener { forward, breakdown: value("breakdown_volts", breakdown_volts, above) }
            }
            Component::Switch(Switch { closed, withstand_volts, .. }) => {
                let withstand = value("withstand_volts", withstand_volts, above);
                Law::Switch { closed: self.node(k, "closed", closed, lowering), withstand }
            }
            Component::VoltageSource(source) => Law::VoltageSource(self.node(k, "volts", &source.volts, lowering)),
            Component::CurrentSource(source) => Law::CurrentSource(self.node(k, "amperes", &source.amperes, lowering)),
        };
        Element { nodes: (nodes[a.as_str()], nodes[b.as_str()]), law }
    }

    /// A constant, above a least value or, if told so, equal to it.
    fn value(
        &self,
        k: usize,
        key: &str,
        expression: &Expression,
        least: Option<(f64, bool)>,
        lowering: &mut Lowering,
    ) -> Constant {
        let component = &self.components[k];
        let constant = self.within(k, key, |place| lowering.parametric(expression, place));
        let constant = constant.unwrap_or(Constant { value: 1.0, node: None });
        let value = constant.value;
        if let Some((least, with)) = least
            && !(value > least || with && value == least)
        {
            let expected = if with { format!("{least} or more") } else { format!("above {least}") };
            let mut detail = format!("the {} of `{}` are {value}", key.replace('_', " "), abridged(component.name()));
            if let Some(lines) = self.lines {
                detail = format!("line {}: {detail}", lines[k]);
            }
            self.within(k, key, |place| {
                let error = SpecificationError::new(place.to_string(), "out_of_range", &*detail);
                lowering.errors.push(error.expected(&*expected));
            });
        }
        constant
    }

    fn node(&self, k: usize, key: &str, expression: &Expression, lowering: &mut Lowering) -> expression::Node {
        self.within(k, key, |place| lowering.node_or_zero(expression, place))
    }

    /// Calls back with the place of a component's member; of a netlist all have one place.
    fn within<T>(&self, k: usize, key: &str, call: impl FnOnce(&Place<'_>) -> T) -> T {
        match self.lines {
            Some(_) => call(&self.place),
            None => call(&self.place.index(k).key(self.components[k].key()).key(key)),
        }
    }

    fn at(&self, k: usize) -> String {
        match self.lines {
            Some(_) => self.place.to_string(),
            None => self.place.index(k).key(self.components[k].key()).to_string(),
        }
    }

    fn report(&self, k: usize, code: &'static str, detail: &str, expected: &str, lowering: &mut Lowering) {
        let detail = match self.lines {
            Some(lines) => format!("line {}: {detail}", lines[k]),
            None => detail.to_owned(),
        };
        lowering.errors.push(SpecificationError::new(self.at(k), code, detail).expected(expected));
    }
}

/// What a member of a component says of it.
fn quantity(key: &str) -> Quantity {
    match key {
        "volts" | "amperes" => Quantity::Start,
        "forward_volts" => Quantity::Forward,
        "breakdown_volts" => Quantity::Breakdown,
        "withstand_volts" => Quantity::Withstand,
        _ => Quantity::Size,
    }
}

/// The longest name, in characters.
const LONGEST_NAME: usize = 60;

fn is_name(text: &str) -> bool {
    let allowed = |c: char| c.is_ascii_alphanumeric() || "_+-.".contains(c);
    !text.is_empty() && text.len() <= LONGEST_NAME && text.chars().all(allowed)
}
