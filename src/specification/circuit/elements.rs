//! From a component of a circuit to its elements, and to the controlling quantities of those elements that are not
//! controlled by time alone.

use super::components::*;
use super::dependent::{Compared, Drive};
use super::lowering::Circuit;
use crate::error::SpecificationError;
use crate::expression::Expression;
use crate::lowering::{Constant, Lowering};
use crate::wording::abridged;
use expression::Node;
use models::circuit::{Element, Law, Quantity, Terms};
use std::collections::HashMap;

impl<'a> Circuit<'a> {
    /// Appends the circuit elements of a component, and the controlling quantities (`drives`) of those elements that
    /// are not controlled by time alone.
    pub(super) fn elements(
        &self,
        (component, swapped): (usize, bool),
        nodes: &HashMap<&str, usize>,
        terms: &mut Terms,
        (elements, drives): (&mut Vec<Element>, &mut Vec<(usize, Drive<'a>)>),
        lowering: &mut Lowering,
    ) {
        let k = elements.len();
        // A node with an unknown name has been reported already, and is replaced by ground.
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
                    let detail = "a switch controlled by voltages and currents withstands any voltage while it is open";
                    self.report(
                        k,
                        "conflict",
                        detail,
                        "no `withstand_volts`, and a path for the current of each inductor, such as a diode",
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
            Component::Transformer(Transformer { primary, secondary, ratio, .. }) => {
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
                let (primary_law, secondary_law) = match swapped {
                    // A transformer with the ratio n has the laws v_1 = n v_2 and i_2 = -n i_1 if `swapped`, else v_2
                    // = v_1/n and i_1 = -i_2/n, for its primary winding 1 and its secondary winding 2.
                    true => {
                        drives.push((k, Drive::WindingVoltage { other: of(secondary), factor: ratio }));
                        drives.push((k + 1, Drive::WindingCurrent { other: k, factor: ratio }));
                        (Law::DependentVoltage, Law::DependentCurrent)
                    }
                    false => {
                        let one = lowering.graph.constant(1.0);
                        let factor = lowering.graph.divide(one, ratio);
                        drives.push((k, Drive::WindingCurrent { other: k + 1, factor }));
                        drives.push((k + 1, Drive::WindingVoltage { other: of(primary), factor }));
                        (Law::DependentCurrent, Law::DependentVoltage)
                    }
                };
                elements.push(place(primary_law, primary));
                secondary_law
            }
        };
        elements.extend(component.nodes().last().map(|nodes| place(law, nodes)));
    }

    fn timed_switch(&self, k: usize, switch: &Switch, terms: &mut Terms, lowering: &mut Lowering) -> Law {
        let closed = self.node(k, "closed", &switch.closed, lowering);
        if switch.hysteresis.is_some() {
            let detail = "`closed` of this switch depends only on time";
            self.report(k, "conflict", detail, "no `hysteresis`, or voltages and currents in `closed`", lowering);
        }
        let Some(withstand) = &switch.withstand_volts else {
            self.report(
                k,
                "missing_key",
                "`withstand_volts` is missing",
                "the voltage that the open switch withstands, in volts",
                lowering,
            );
            return Law::DependentSwitch;
        };
        let Constant { value, node } = self.value(k, "withstand_volts", withstand, Some((0.0, false)), lowering);
        terms.0.extend(node.map(|node| ((k, Quantity::Withstand), node)));
        Law::Switch { closed, withstand: value }
    }

    /// Returns a constant of circuit element `k` as a node of the expression graph; `otherwise` is the default of the
    /// constant.
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

    /// Returns the lower and the upper limit of a controlled source as nodes of the expression graph.
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

    /// Returns a constant of a component, which must be above the lower bound `least.0`, or may equal it if `least.1`
    /// is true.
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
            let verb = if key == "hysteresis" { "is" } else { "are" };
            let mut detail =
                format!("the {} of `{}` {verb} {value}", key.replace('_', " "), abridged(component.name()));
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
}

/// Returns which quantity of a circuit element a key of the component sets: `volts` sets the initial value of a
/// capacitor, for example.
fn quantity(key: &str) -> Quantity {
    match key {
        "volts" | "amperes" => Quantity::Start,
        "forward_volts" => Quantity::Forward,
        "breakdown_volts" => Quantity::Breakdown,
        "withstand_volts" => Quantity::Withstand,
        _ => Quantity::Size,
    }
}
