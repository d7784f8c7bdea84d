//! The model built from the equations of a circuit, with its names and outputs.

use super::dependent::{self, Drive};
use super::faults::Names;
use super::lowering::Circuit;
use crate::dvi;
use crate::error::SpecificationError;
use crate::expression::Expression;
use crate::lowering::Lowering;
use crate::model::Model;
use crate::ordered::Ordered;
use crate::start;
use expression::{ExpressionError, Node};
use models::circuit::{
    CircuitParameters, Columns, Element, Equations as Forms, Fault, Law, NormalTree, Port, Quantity, System, Terms,
};
use models::{DviModel, Equations, KinkAdvice, Linear, LoweringError, Outputs, ParametricTerms};
use problem::{Mass, Warning};
use std::sync::Arc;

/// Builds the model of a circuit whose components are each valid by themselves.
///
/// # Errors
/// Faults of the circuit as a whole.
pub(super) fn model(
    circuit: &Circuit<'_>,
    (elements, terms, drives): (&[Element], &Terms, &[(usize, Drive<'_>)]),
    (names, definitions, remarks): (&Names<'_>, &Ordered<Expression>, &[String]),
    lowering: &mut Lowering,
) -> Result<Arc<dyn Model>, Vec<SpecificationError>> {
    let told = |faults: Vec<Fault>| -> Vec<SpecificationError> { faults.iter().map(|f| names.error(f)).collect() };
    let tree = NormalTree::new(elements, names.nodes.len()).map_err(told)?;
    let columns = Columns::new(elements, &tree);
    if columns.states.is_empty() && columns.integrals.is_empty() {
        return Err(told(vec![Fault::Dead]));
    }
    let mut forms = Forms::new(elements, &tree, &columns).map_err(|fault| told(vec![fault]))?;
    let inputs = lowering.inputs();
    let graph = &mut lowering.graph;
    let whole = |error: ExpressionError| vec![SpecificationError::new(names.whole.clone(), error.code, error.message)];
    let of_parameters =
        CircuitParameters::new(graph, (elements, &tree, &columns), &mut forms, terms, inputs).map_err(whole)?;
    let system = System::new(graph, elements, &columns, terms, &forms)
        .map_err(|(k, error)| vec![SpecificationError::new((names.pointer)(k), error.code, error.message)])?;
    let impulses = system.impulses(graph, &forms);
    if !impulses.is_empty() {
        return Err(told(impulses));
    }
    let initial: Vec<f64> = columns
        .states
        .iter()
        .map(|&k| match elements[k].law {
            Law::Capacitor(_, given) | Law::Inductor(_, given) => given.unwrap_or(0.0),
            _ => 0.0,
        })
        .chain(columns.integrals.iter().map(|_| 0.0))
        .collect();
    // Initial values of components that are not states follow from those of the states. Other parameter values might
    // contradict them, so the parameters keep their values.
    let mut elsewhere = (0..elements.len()).filter(|k| !columns.states.contains(k));
    if elsewhere.any(|k| elements[k].quantity(Quantity::Start).is_some()) {
        lowering.keep_values();
    }
    let graph = &mut lowering.graph;
    if let Some(t) = lowering.start {
        let contradictions = system.contradictions(graph, &forms, t, &initial);
        if !contradictions.is_empty() {
            return Err(told(contradictions));
        }
    }
    let states = columns.states.iter().chain(&columns.integrals);
    let state_names: Vec<String> = states.map(|&k| names.of_state(&elements[k], k)).collect();
    let ports = columns.ports.iter().map(|&port| names.of_port(elements, port));
    let switches = drives.iter().filter(|(k, _)| matches!(elements[*k].law, Law::DependentSwitch));
    let variable_names: Vec<String> =
        ports.chain(switches.map(|&(k, _)| format!("closed({})", names.components[k]))).collect();
    let outputs = outputs(elements, &forms, &system, names, lowering, &[&state_names, &variable_names]);
    let (equations, parametric) = if drives.is_empty() {
        let (rows, parametric) = system.rows(&mut lowering.graph, &forms);
        let linear = Linear::new(&mut lowering.graph, rows).map_err(|(_, error)| whole(error))?;
        (Equations::Linear(Box::new(linear)), parametric)
    } else {
        let laws = dependent::laws(circuit, drives, (elements, &forms, &system), (names, definitions), lowering);
        let (rows, parametric) = system.dependent_rows(&mut lowering.graph, &forms, &laws);
        let pointer = |_: usize| names.whole.clone();
        let refused = |refusals: Vec<LoweringError>| {
            refusals
                .into_iter()
                .map(|refusal| dvi::refused(refusal, &state_names, &variable_names, pointer))
                .collect::<Vec<_>>()
        };
        (Equations::new(&mut lowering.graph, rows).map_err(refused)?, parametric)
    };
    let starts = columns.states.iter().map(|&k| terms.0.get(&(k, Quantity::Start)).copied());
    let starts = starts.chain(columns.integrals.iter().map(|_| None)).zip(&initial);
    let graph = &mut lowering.graph;
    let starts = starts.map(|(node, &value)| node.unwrap_or_else(|| graph.constant(value))).collect();
    let parameters =
        lowering.parameters(ParametricTerms { initial: starts, circuit: of_parameters, ..parametric }, &Mass::Identity);
    let model = DviModel {
        state_names,
        variable_names,
        outputs,
        initial,
        equations,
        warnings: remarks.iter().map(|remark| Warning { code: "netlist", message: remark.clone() }).collect(),
        kinks: KinkAdvice::default(),
        parameters,
    };
    if let Some(t) = lowering.start {
        start::check(&model, t, |_| names.whole.clone(), &mut lowering.errors);
    }
    Ok(Arc::new(model))
}

/// Returns the outputs of a circuit: node voltages, currents, and the voltages of diodes and switches, except those
/// that are states or variables already.
fn outputs(
    elements: &[Element],
    forms: &Forms,
    system: &System<'_>,
    names: &Names<'_>,
    lowering: &mut Lowering,
    taken: &[&[String]; 2],
) -> Outputs {
    let graph = &mut lowering.graph;
    let mut named: Vec<(String, Node)> = Vec::new();
    for (voltage, name) in forms.nodes.iter().zip(&names.nodes).skip(1) {
        named.push((format!("v({name})"), system.output(graph, voltage)));
    }
    for (k, name) in names.components.iter().enumerate() {
        if matches!(elements[k].law, Law::Diode { .. } | Law::Zener { .. } | Law::Switch { .. } | Law::DependentSwitch)
        {
            named.push((format!("v({name})"), system.output(graph, &forms.voltages[k])));
        }
        named.push((format!("i({name})"), system.output(graph, &forms.currents[k])));
    }
    let taken: std::collections::HashSet<&String> = taken.iter().copied().flatten().collect();
    named.retain(|(name, _)| !taken.contains(name));
    let (output_names, nodes): (Vec<String>, Vec<Node>) = named.into_iter().unzip();
    Outputs::new(graph, output_names, &nodes, taken.len())
}

impl Names<'_> {
    fn of_state(&self, element: &Element, k: usize) -> String {
        let quantity = match element.law {
            Law::Inductor(..) => "i",
            Law::VoltageSource(_) | Law::DependentVoltage => "flux",
            Law::CurrentSource(_) | Law::DependentCurrent => "charge",
            _ => "v",
        };
        format!("{quantity}({})", self.components[k])
    }

    fn of_port(&self, elements: &[Element], port: Port) -> String {
        let quantity = match (port, &elements[port.element()].law) {
            (Port::Blocking(_), _) => "v_blocked",
            (Port::Conducting(_), Law::Zener { .. }) => "i_forward",
            (Port::Conducting(_), _) => "i",
            (Port::BreakingDown(_), _) => "i_backward",
            (Port::Source(_), Law::DependentCurrent) => "i",
            (Port::Voltage(_) | Port::Source(_), _) => "v",
        };
        format!("{quantity}({})", self.components[port.element()])
    }
}
