//! Tests of the expression language as a whole: parsing, evaluation and derivatives.

mod enclosures;
mod gradients;
mod hostile;
mod messages;
mod parameters;
mod points;
mod tables;
mod values;
mod vectors;

use super::{ExpressionError, Graph, Node, Scope, Tape};

/// Returns a graph and a scope with `t` as input 0 and `x`, `y`, `z` as inputs 1, 2, 3.
fn space() -> (Graph, Scope) {
    let (mut graph, mut scope) = (Graph::new(), Scope::new());
    for (index, name) in ["t", "x", "y", "z"].into_iter().enumerate() {
        scope.bind(name, graph.input(index)).unwrap();
    }
    (graph, scope)
}

fn parse(text: &str) -> Result<(Graph, Node), ExpressionError> {
    let (mut graph, scope) = space();
    let node = graph.parse(text, &scope)?;
    Ok((graph, node))
}

fn evaluate(graph: &Graph, nodes: &[Node], inputs: [f64; 4]) -> Vec<f64> {
    let mut outputs = vec![0.0; nodes.len()];
    Tape::compile(graph, nodes).evaluate(inputs[0], &inputs[1..], &mut outputs);
    outputs
}

/// Returns the value of the expression `text` at the inputs `(t, x, y, z)`.
fn value(text: &str, inputs: [f64; 4]) -> f64 {
    let (graph, node) = parse(text).unwrap();
    evaluate(&graph, &[node], inputs)[0]
}

/// Returns the derivatives of the expression `text` with respect to `(t, x, y, z)`; `None` if the gradient has no
/// entry.
fn derivatives(text: &str, inputs: [f64; 4]) -> [Option<f64>; 4] {
    let (mut graph, node) = parse(text).unwrap();
    let gradient = graph.gradient(node).unwrap();
    let nodes: Vec<Node> = gradient.iter().map(|&(_, node)| node).collect();
    let mut derivatives = [None; 4];
    for ((input, _), value) in gradient.iter().zip(evaluate(&graph, &nodes, inputs)) {
        derivatives[*input] = Some(value);
    }
    derivatives
}
