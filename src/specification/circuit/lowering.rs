//! From components with names to the elements of a circuit.

use super::components::*;
use super::dependent::{Compared, Drive};
use super::faults::Names;
use super::{CircuitProblem, MOST_COMPONENTS, model, netlist};
use crate::error::SpecificationError;
use crate::expression::Expression;
use crate::lowering::{Constant, Lowering, Named, Start};
use crate::model::Model;
use crate::ordered::Ordered;
use crate::place::Place;
use crate::wording::abridged;
use crate::written::{Lowered, Written};
use expression::Node;
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
                let circuit = Circuit::new(components, place.key("components"), None);
                circuit.model(&self.definitions, &mut lowering)
            }
            (None, Some(text)) => {
                let place = place.key("netlist");
                match netlist::read(text) {
                    Ok(netlist::Netlist { components, lines }) => {
                        Circuit::new(&components, place, Some(&lines)).model(&self.definitions, &mut lowering)
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
pub(super) struct Circuit<'a> {
    components: &'a [Component],
    /// The component of each element.
    owners: Vec<usize>,
    place: Place<'a>,
    /// The line of each in a netlist.
    lines: Option<&'a [usize]>,
}

impl<'a> Circuit<'a> {
    fn new(components: &'a [Component], place: Place<'a>, lines: Option<&'a [usize]>) -> Self {
        let owners =
            components.iter().enumerate().flat_map(|(k, component)| vec![k; component.nodes().len()]).collect();
        Self { components, owners, place, lines }
    }

    fn model(&self, definitions: &Ordered<Expression>, lowering: &mut Lowering) -> Option<Arc<dyn Model>> {
        let count = self.components.len();
        if count == 0 || count > MOST_COMPONENTS {
            let detail = format!("{count} components");
            let error = SpecificationError::new(self.place.to_string(), "number_of_components", detail);
            lowering.errors.push(error.expected(format!("1 to {MOST_COMPONENTS} components")));
            return None;
        }
        let nodes = self.nodes(lowering);
        let (mut terms, mut elements, mut drives) = (Terms::default(), Vec::new(), Vec::new());
        for k in 0..count {
            self.elements(k, &nodes, &mut terms, (&mut elements, &mut drives), lowering);
        }
        if !lowering.errors.is_empty() {
            return None;
        }
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
            pointer: &|k| self.at(k),
            whole: self.place.to_string(),
        };
        match model::model(self, (&elements, &terms, &drives), (&names, definitions), lowering) {
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
            let of_nodes = component.nodes().into_iter().chain(component.inputs());
            for name in of_nodes.flat_map(|(a, b)| [a.as_str(), b]).chain([component.name()]) {
                if !is_name(name) {
                    let expected = format!("letters, digits and any of `_ + - .`, at most {LONGEST_NAME}");
                    let detail = format!("`{}` is no name of a component or a node", abridged(name));
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
                self.report(k, "duplicate_name", &detail, "a name of its own", lowering);
            } else if nodes.contains_key(name) {
                let detail = format!("`{}` is a node as well, and `v({0})` would be both", abridged(name));
                self.report(k, "duplicate_name", &detail, "a name that no node has", lowering);
            }
        }
        nodes
    }

    /// The elements of a component, with what they follow if that is not time alone.
    fn elements(
        &self,
        component: usize,
        nodes: &HashMap<&str, usize>,
        terms: &mut Terms,
        (elements, drives): (&mut Vec<Element>, &mut Vec<(usize, Drive<'a>)>),
        lowering: &mut Lowering,
    ) {
        let k = elements.len();
        // A node that is not there was reported.
        let of = |(a, b): &(String, String)| [a, b].map(|name| nodes.get(name.as_str()).copied().unwrap_or(0)).into();
        let place = |law: Law, at: &(String, String)| Element { nodes: of(at), law };
        let (above, any) = (Some((0.0, false)), None);
        let not_below = Some((0.0, true));
        let mut value = |key, expression: &Expression, least| {
            let Constant { value, node } = self.value(k, key, expression, least, lowering);
            terms.0.extend(node.map(|node| ((k, quantity(key)), node)));
            value
        };
        let component: &'a Component = &self.components[component];
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
            Component::Switch(switch) if lowering.is_readable(&switch.closed) => {
                self.timed_switch(k, switch, terms, lowering)
            }
            Component::Switch(switch) => {
                if switch.withstand_volts.is_some() {
                    let detail = "a switch that voltages and currents decide holds any voltage while it is open";
                    self.report(
                        k,
                        "conflict",
                        detail,
                        "no `withstand_volts`, and a way for the current of an inductor, such as a diode",
                        lowering,
                    );
                }
                let limits = [0.0, 1.0].map(|value| lowering.graph.constant(value));
                let hysteresis = self.hysteresis(k, switch.hysteresis.as_ref(), lowering);
                let of = Compared::Closed(&switch.closed);
                drives.push((k, Drive::Comparison { of, hysteresis, begins: switch.initially, limits }));
                Law::DependentSwitch
            }
            Component::VoltageSource(VoltageSource { volts, limits: None, .. }) if lowering.is_readable(volts) => {
                Law::VoltageSource(self.node(k, "volts", volts, lowering))
            }
            Component::CurrentSource(CurrentSource { amperes, limits: None, .. }) if lowering.is_readable(amperes) => {
                Law::CurrentSource(self.node(k, "amperes", amperes, lowering))
            }
            Component::VoltageSource(VoltageSource { volts, limits, .. }) => {
                let bounds = self.limits(k, limits.as_ref(), lowering);
                drives.push((k, Drive::Expression { key: "volts", expression: volts, bounds }));
                Law::DependentVoltage
            }
            Component::CurrentSource(CurrentSource { amperes, limits, .. }) => {
                let bounds = self.limits(k, limits.as_ref(), lowering);
                drives.push((k, Drive::Expression { key: "amperes", expression: amperes, bounds }));
                Law::DependentCurrent
            }
            Component::OpAmp(OpAmp { inputs, limits, .. }) => {
                let bounds = self.limits(k, limits.as_ref(), lowering);
                drives.push((k, Drive::Zero { between: of(inputs), bounds }));
                Law::DependentVoltage
            }
            Component::Comparator(comparator) => {
                let Comparator { inputs, low, high, hysteresis, initially, .. } = comparator;
                let low = self.constant(k, "low", low.as_ref(), 0.0, lowering);
                let high = self.constant(k, "high", high.as_ref(), 1.0, lowering);
                self.check_order(k, [low, high], lowering);
                let hysteresis = self.hysteresis(k, hysteresis.as_ref(), lowering);
                let of = Compared::Between(of(inputs));
                drives.push((k, Drive::Comparison { of, hysteresis, begins: *initially, limits: [low, high] }));
                Law::DependentVoltage
            }
            Component::Transformer(Transformer { primary, ratio, .. }) => {
                let ratio = self.constant(k, "ratio", Some(ratio), 1.0, lowering);
                if lowering.graph.vanishes(ratio) {
                    self.report(
                        k,
                        "out_of_range",
                        "the ratio of a transformer is 0",
                        "turns over turns, not 0",
                        lowering,
                    );
                }
                drives.push((k, Drive::Primary { secondary: k + 1, ratio }));
                drives.push((k + 1, Drive::Secondary { primary: of(primary), ratio }));
                elements.push(place(Law::DependentCurrent, primary));
                Law::DependentVoltage
            }
        };
        elements.extend(component.nodes().last().map(|nodes| place(law, nodes)));
    }

    fn timed_switch(&self, k: usize, switch: &Switch, terms: &mut Terms, lowering: &mut Lowering) -> Law {
        let closed = self.node(k, "closed", &switch.closed, lowering);
        if switch.hysteresis.is_some() {
            let detail = "`closed` of this switch depends on time alone";
            self.report(k, "conflict", detail, "no `hysteresis`, or voltages and currents in `closed`", lowering);
        }
        let Some(withstand) = &switch.withstand_volts else {
            self.report(
                k,
                "missing_key",
                "`withstand_volts` is missing",
                "what the switch holds while it is open, in volts",
                lowering,
            );
            return Law::DependentSwitch;
        };
        let Constant { value, node } = self.value(k, "withstand_volts", withstand, Some((0.0, false)), lowering);
        terms.0.extend(node.map(|node| ((k, Quantity::Withstand), node)));
        Law::Switch { closed, withstand: value }
    }

    /// A constant as a term.
    fn constant(
        &self,
        k: usize,
        key: &str,
        given: Option<&Expression>,
        otherwise: f64,
        lowering: &mut Lowering,
    ) -> Node {
        let constant = match given {
            Some(expression) => self.value(k, key, expression, None, lowering),
            None => Constant { value: otherwise, node: None },
        };
        constant.node.unwrap_or_else(|| lowering.graph.constant(constant.value))
    }

    fn hysteresis(&self, k: usize, given: Option<&Expression>, lowering: &mut Lowering) -> Option<Node> {
        let Constant { value, node } = self.value(k, "hysteresis", given?, Some((0.0, true)), lowering);
        Some(node.unwrap_or_else(|| lowering.graph.constant(value)))
    }

    /// The least and the largest value of a source.
    fn limits(&self, k: usize, given: Option<&(Expression, Expression)>, lowering: &mut Lowering) -> [Option<Node>; 2] {
        let Some((low, high)) = given else { return [None; 2] };
        let limits = [low, high].map(|limit| self.constant(k, "limits", Some(limit), 0.0, lowering));
        self.check_order(k, limits, lowering);
        limits.map(Some)
    }

    fn check_order(&self, k: usize, limits: [Node; 2], lowering: &mut Lowering) {
        let [low, high] = limits.map(|node| lowering.graph.value(node).unwrap_or(0.0));
        if low >= high {
            let detail = format!("the lower limit {low} is not below the upper limit {high}");
            self.report(k, "out_of_range", &detail, "the lower limit first", lowering);
        }
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
        let component = self.owner(k);
        let constant = self.within(k, key, |place| lowering.parametric(expression, place));
        let constant = constant.unwrap_or(Constant { value: 1.0, node: None });
        let value = constant.value;
        if let Some((least, with)) = least
            && !(value > least || with && value == least)
        {
            let expected = if with { format!("{least} or more") } else { format!("above {least}") };
            let mut detail = format!("the {} of `{}` are {value}", key.replace('_', " "), abridged(component.name()));
            if let Some(lines) = self.lines {
                detail = format!("line {}: {detail}", lines[self.owners[k]]);
            }
            self.within(k, key, |place| {
                let error = SpecificationError::new(place.to_string(), "out_of_range", &*detail);
                lowering.errors.push(error.expected(&*expected));
            });
        }
        constant
    }

    pub(super) fn node(&self, k: usize, key: &str, expression: &Expression, lowering: &mut Lowering) -> Node {
        self.within(k, key, |place| lowering.node_or_zero(expression, place))
    }

    /// Calls back with the place of a component's member; of a netlist all have one place.
    fn within<T>(&self, k: usize, key: &str, call: impl FnOnce(&Place<'_>) -> T) -> T {
        match self.lines {
            Some(_) => call(&self.place),
            None => call(&self.place.index(self.owners[k]).key(self.owner(k).key()).key(key)),
        }
    }

    /// The component of an element.
    fn owner(&self, k: usize) -> &Component {
        &self.components[self.owners[k]]
    }

    fn at(&self, k: usize) -> String {
        match self.lines {
            Some(_) => self.place.to_string(),
            None => self.place.index(self.owners[k]).key(self.owner(k).key()).to_string(),
        }
    }

    fn report(&self, k: usize, code: &'static str, detail: &str, expected: &str, lowering: &mut Lowering) {
        let detail = match self.lines {
            Some(lines) => format!("line {}: {detail}", lines[self.owners[k]]),
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
