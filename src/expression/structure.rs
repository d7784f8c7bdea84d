//! The structure of a term: its inputs, its nonsmooth functions, and its summands.

use super::graph::{Graph, Node, Term};
use super::operator::Operator;
use rustc_hash::FxHashSet;
use std::collections::BTreeMap;

impl Graph {
    /// Returns the inputs that `node` depends on, sorted.
    pub fn inputs(&self, node: Node) -> Vec<usize> {
        self.inputs_of(&[node])
    }

    /// Returns the functions in `node` that are not smooth (`abs`, `sign`, `heaviside`, `min`, `max`, ..), each with
    /// the sorted inputs its arguments depend on, without repetition. A `min` of several arguments counts once.
    pub fn kinks(&self, node: Node) -> Vec<(&'static str, Vec<usize>)> {
        let mut absorbed = FxHashSet::default();
        let mut kinks = Vec::new();
        let mut terms = self.terms_below(&[node]);
        terms.sort_unstable_by(|a, b| b.cmp(a));
        for y in terms {
            let Some((operator, a, b)) = self.operation(y) else { continue };
            let of_table = self.table_of(operator, b).and_then(|table| table.kink());
            let Some(name) = operator.kink().or(of_table) else { continue };
            if matches!(operator, Operator::Min | Operator::Max) {
                absorbed.extend([a, b].into_iter().filter(|&operand| self.is_apply(operator, operand)));
            }
            if !absorbed.contains(&y) {
                kinks.push((name, self.inputs_of(&[a, b])));
            }
        }
        kinks.sort_unstable();
        kinks.dedup();
        kinks
    }

    /// Splits a node into a linear combination of terms, as pairs `(term, factor)`. Factors are numbers or depend on
    /// parameters alone. Terms are distinct and are neither sums nor multiples themselves; constant summands become a
    /// multiple of the node 1.
    pub fn terms_of_sum(&mut self, node: Node) -> Vec<(Node, Node)> {
        let one = self.constant(1.0);
        let mut by_itself = self.constant(0.0);
        // Operands come before the terms that use them: the factor that multiplies the last term is complete.
        let mut open = BTreeMap::from([(node, one)]);
        let mut terms = Vec::new();
        while let Some((term, factor)) = open.pop_last() {
            let minus = self.negate(factor);
            let parts = match self.terms[term.place()] {
                _ if self.value(term).is_some() => {
                    let value = self.multiply(factor, term);
                    by_itself = self.add(by_itself, value);
                    continue;
                }
                Term::Apply(Operator::Negate, a, _) => [Some((a, minus)), None],
                Term::Apply(Operator::Add, a, b) => [Some((a, factor)), Some((b, factor))],
                Term::Apply(Operator::Subtract, a, b) => [Some((a, factor)), Some((b, minus))],
                Term::Apply(Operator::Multiply, a, b) if self.value(a).is_some() => {
                    [Some((b, self.multiply(factor, a))), None]
                }
                Term::Apply(Operator::Multiply, a, b) if self.value(b).is_some() => {
                    [Some((a, self.multiply(factor, b))), None]
                }
                Term::Apply(Operator::Divide, a, b) if self.value(b).is_some_and(|value| value != 0.0) => {
                    [Some((a, self.divide(factor, b))), None]
                }
                _ => {
                    terms.push((term, factor));
                    continue;
                }
            };
            for (part, factor) in parts.into_iter().flatten() {
                let sum = match open.get(&part) {
                    Some(&other) => self.add(other, factor),
                    None => factor,
                };
                open.insert(part, sum);
            }
        }
        terms.push((one, by_itself));
        terms.retain(|(_, factor)| self.number(*factor) != Some(0.0));
        terms
    }

    fn is_apply(&self, operator: Operator, node: Node) -> bool {
        matches!(self.operation(node), Some((found, ..)) if found == operator)
    }

    /// Whether a node is an input whose index satisfies the condition `holds`.
    pub(super) fn is_input(&self, node: Node, holds: impl Fn(usize) -> bool) -> bool {
        matches!(self.terms[node.place()], Term::Input(index) if holds(index))
    }

    pub(super) fn inputs_of(&self, nodes: &[Node]) -> Vec<usize> {
        let terms = self.terms_below(nodes);
        let mut inputs: Vec<usize> = terms
            .into_iter()
            .filter_map(|node| match self.terms[node.place()] {
                Term::Input(index) => Some(index),
                _ => None,
            })
            .collect();
        inputs.sort_unstable();
        inputs
    }

    /// Returns the nodes and all terms below them, each once; terms below constants (including terms of parameters)
    /// are omitted.
    pub(super) fn terms_below(&self, nodes: &[Node]) -> Vec<Node> {
        self.reached(nodes, |node| {
            self.operation(node).map(|(operator, a, b)| (a, (!operator.is_unary()).then_some(b)))
        })
    }

    /// Returns the nodes and all terms needed to compute their values, each once, including terms below constants.
    pub(super) fn computed_below(&self, nodes: &[Node]) -> Vec<Node> {
        self.reached(nodes, |node| match self.terms[node.place()] {
            Term::Apply(operator, a, b) => Some((a, (!operator.is_unary()).then_some(b))),
            _ => None,
        })
    }

    /// Returns the nodes and all terms below them, each once, including terms below constants.
    pub(super) fn all_below(&self, nodes: &[Node]) -> Vec<Node> {
        self.reached(nodes, |node| match self.terms[node.place()] {
            Term::Apply(_, a, b) => Some((a, Some(b))),
            _ => None,
        })
    }

    /// Returns the nodes and all terms reachable from them through `operands`, each once.
    fn reached(&self, nodes: &[Node], operands: impl Fn(Node) -> Option<(Node, Option<Node>)>) -> Vec<Node> {
        let mut seen = FxHashSet::default();
        let mut open = nodes.to_vec();
        let mut terms = Vec::new();
        while let Some(node) = open.pop() {
            if seen.insert(node) {
                terms.push(node);
                if let Some((a, b)) = operands(node) {
                    open.push(a);
                    open.extend(b);
                }
            }
        }
        terms
    }
}

#[cfg(test)]
mod tests {
    use super::super::Scope;
    use super::*;

    fn parsed(text: &str) -> (Graph, Node) {
        let (mut graph, mut scope) = (Graph::new(), Scope::new());
        for (index, name) in ["t", "x", "y", "z"].into_iter().enumerate() {
            scope.bind(name, graph.input(index)).unwrap();
        }
        let node = graph.parse(text, &scope).unwrap();
        (graph, node)
    }

    #[test]
    fn inputs_are_those_that_occur() {
        let (graph, node) = parsed("z*sin(t) + z^2 - 0*y");
        assert_eq!(graph.inputs(node), [0, 2, 3]);
    }

    #[test]
    fn kinks_are_named_with_the_inputs_of_their_arguments() {
        let (graph, node) = parsed("exp(abs(x - t)) + min(x, y, z, 1) + sign(y) + 2*abs(x - t) + abs(t - x*1)");
        assert_eq!(graph.kinks(node), [("abs", vec![0, 1]), ("min", vec![1, 2, 3]), ("sign", vec![2])]);
    }

    #[test]
    fn a_smooth_expression_has_no_kinks() {
        let (graph, node) = parsed("x^2 + sqrt(y)/tanh(z) + abs(-3)");
        assert_eq!(graph.kinks(node), []);
    }
}
