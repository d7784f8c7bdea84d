//! Laws of elements controlled by voltages and currents: controlled sources, amplifiers, comparators, transformers
//! and switches. Their equations are written once all voltages and currents of the circuit are known as expressions
//! in its states and variables.

use super::faults::Names;
use super::lowering::Circuit;
use crate::expression::Expression;
use crate::lowering::Lowering;
use crate::ordered::Ordered;
use expression::Node;
use models::circuit::{Dependent, DependentLaw, Element, Equations, Law, System};

/// The controlling quantity of a controlled circuit element, as the user writes it.
#[derive(Clone, Debug)]
pub(super) enum Drive<'a> {
    /// An expression that gives the voltage or current of the element, under the key `key` of the component.
    Expression { key: &'static str, expression: &'a Expression, bounds: [Option<Node>; 2] },
    /// The sign of a voltage or an expression, for a switch or a comparator.
    Comparison { of: Compared<'a>, hysteresis: Option<Node>, begins: bool, limits: [Node; 2] },
    /// The voltage between two nodes, which the element drives to zero (operational amplifier).
    Zero { between: (usize, usize), bounds: [Option<Node>; 2] },
    /// The voltage of a transformer winding, `factor` times the voltage between the nodes of the other winding.
    WindingVoltage { other: (usize, usize), factor: Node },
    /// The current of a transformer winding, `-factor` times the current of the other winding's element.
    WindingCurrent { other: usize, factor: Node },
}

/// The quantity whose sign controls a switch or the output of a comparator.
#[derive(Clone, Copy, Debug)]
pub(super) enum Compared<'a> {
    /// The expression `closed` of a switch, whose sign decides whether the switch is closed.
    Closed(&'a Expression),
    /// The voltage between the two inputs of a comparator.
    Between((usize, usize)),
}

/// Writes the equations of all controlled circuit elements; `drives` are their controlling quantities, each with the
/// index of its element.
pub(super) fn laws(
    circuit: &Circuit<'_>,
    drives: &[(usize, Drive<'_>)],
    (elements, forms, system): (&[Element], &Equations, &System<'_>),
    (names, definitions): (&Names<'_>, &Ordered<Expression>),
    lowering: &mut Lowering,
) -> Vec<Dependent> {
    let mut quantities = vec![("v(0)".to_owned(), lowering.graph.constant(0.0))];
    for (form, name) in forms.nodes.iter().zip(&names.nodes).skip(1) {
        quantities.push((format!("v({name})"), system.output(&mut lowering.graph, form)));
    }
    for (k, name) in names.components.iter().enumerate() {
        quantities.push((format!("v({name})"), system.output(&mut lowering.graph, &forms.voltages[k])));
        quantities.push((format!("i({name})"), system.output(&mut lowering.graph, &forms.currents[k])));
    }
    lowering.bind_quantities(&quantities);
    lowering.use_definitions(definitions);
    let scale = scale(elements);
    let start = lowering.start.unwrap_or(0.0);
    let node_of = |node: usize, lowering: &mut Lowering| system.output(&mut lowering.graph, &forms.nodes[node]);
    let between = |(a, b): (usize, usize), lowering: &mut Lowering| {
        let [a, b] = [a, b].map(|node| node_of(node, lowering));
        lowering.graph.subtract(a, b)
    };
    let mut laws = Vec::with_capacity(drives.len());
    for (element, drive) in drives {
        let element = *element;
        let source = |law, bounds| Dependent::Source { element, law, bounds };
        laws.push(match drive {
            Drive::Expression { key, expression, bounds } => {
                source(DependentLaw::Follows(circuit.node(element, key, expression, lowering)), *bounds)
            }
            Drive::Zero { between: nodes, bounds } => {
                source(DependentLaw::Amplifies(between(*nodes, lowering)), *bounds)
            }
            Drive::WindingVoltage { other, factor } => {
                let volts = between(*other, lowering);
                source(DependentLaw::Follows(lowering.graph.multiply(volts, *factor)), [None; 2])
            }
            Drive::WindingCurrent { other, factor } => {
                let amperes = system.output(&mut lowering.graph, &forms.currents[*other]);
                let amperes = lowering.graph.negate(amperes);
                source(DependentLaw::Follows(lowering.graph.multiply(amperes, *factor)), [None; 2])
            }
            Drive::Comparison { of, hysteresis, begins, limits } => {
                let u = match of {
                    Compared::Closed(expression) => circuit.node(element, "closed", expression, lowering),
                    Compared::Between(nodes) => between(*nodes, lowering),
                };
                let begin = if *begins { 1.0 } else { -1.0 };
                let law = match *hysteresis {
                    Some(h) => DependentLaw::Remembers { u, h, begin, start, limits: *limits },
                    None => DependentLaw::Amplifies(u),
                };
                match elements[element].law {
                    Law::DependentSwitch => Dependent::Switch { element, law, scale },
                    _ => source(law, limits.map(Some)),
                }
            }
        });
    }
    laws
}

/// Reports names in the expressions of components that do not exist in the circuit.
pub(super) fn check_names(
    circuit: &Circuit<'_>,
    drives: &[(usize, Drive<'_>)],
    (names, definitions): (&Names<'_>, &Ordered<Expression>),
    lowering: &mut Lowering,
) {
    let any = lowering.graph.input(1);
    let of_nodes = names.nodes.iter().map(|name| format!("v({name})"));
    let of_elements = names.components.iter().flat_map(|name| [format!("v({name})"), format!("i({name})")]);
    let quantities: Vec<(String, Node)> = of_nodes.chain(of_elements).map(|name| (name, any)).collect();
    lowering.bind_quantities(&quantities);
    lowering.use_definitions(definitions);
    for (element, drive) in drives {
        match drive {
            Drive::Expression { key, expression, .. } => drop(circuit.node(*element, key, expression, lowering)),
            Drive::Comparison { of: Compared::Closed(expression), .. } => {
                circuit.node(*element, "closed", expression, lowering);
            }
            _ => {}
        }
    }
}

/// Returns a resistance scale for the circuit: the mean of its resistors; without resistors, `sqrt(L/C)` of its mean
/// inductance and capacitance; without those, 1 ohm.
fn scale(elements: &[Element]) -> f64 {
    let mean = |size: &dyn Fn(&Law) -> Option<f64>| {
        let sizes: Vec<f64> = elements.iter().filter_map(|element| size(&element.law)).collect();
        (!sizes.is_empty()).then(|| sizes.iter().sum::<f64>() / sizes.len() as f64)
    };
    let ohms = mean(&|law| if let Law::Resistor(ohms) = law { Some(*ohms) } else { None });
    let henries = mean(&|law| if let Law::Inductor(henries, _) = law { Some(*henries) } else { None });
    let farads = mean(&|law| if let Law::Capacitor(farads, _) = law { Some(*farads) } else { None });
    ohms.or_else(|| Some((henries? / farads?).sqrt())).unwrap_or(1.0)
}
