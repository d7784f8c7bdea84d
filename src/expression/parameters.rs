//! Parameters: inputs that stay as they are through a solve. Terms in them know their value where the parameters have the
//! values given, so that questions of structure have an answer: does a coefficient vanish, is an exponent a whole number?
//! What was decided by such a value is remembered as an assumption, to be asked about before other values are bound.

use super::graph::{Graph, Node, Term};
use super::tape::Tape;
use rustc_hash::FxHashMap;
use std::sync::Arc;

/// What was decided by the value of a term in parameters.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Assumption {
    /// Whether it is zero.
    Vanishing,
    /// Whether it is finite.
    Finite,
    /// All that its value says.
    Value,
}

impl Graph {
    /// The parameter at `index` of what [`Tape::bind`] is given, with the value that decides about structure.
    pub fn parameter(&mut self, index: usize, value: f64) -> Node {
        let node = self.intern(Term::Parameter(index));
        self.known.insert(node, value);
        node
    }

    /// The parameters that `node` depends on, sorted.
    pub fn parameters(&self, node: Node) -> Vec<usize> {
        let mut found = Vec::new();
        for node in self.all_below(&[node]) {
            if let Term::Parameter(index) = self.terms[node.place()] {
                found.push(index);
            }
        }
        found.sort_unstable();
        found
    }

    /// Remembers that something was decided by the value of a term; the value of a number is no matter of parameters.
    pub fn assume(&mut self, node: Node, assumption: Assumption) {
        if self.known.contains_key(&node) {
            self.assumptions.insert((node, assumption));
        }
    }

    /// Whether a term is zero at the values given, which is remembered.
    pub fn vanishes(&mut self, node: Node) -> bool {
        self.assume(node, Assumption::Vanishing);
        self.value(node) == Some(0.0)
    }

    /// The terms that nodes need, in a graph of their own, and the nodes there; parameters keep their places and values.
    pub fn below(&self, nodes: &[Node]) -> (Self, Vec<Node>) {
        self.below_with(nodes, |input| input)
    }

    /// The same with inputs in other places.
    pub fn below_with(&self, nodes: &[Node], place: impl Fn(usize) -> usize) -> (Self, Vec<Node>) {
        let mut graph = Self::new();
        graph.tables = self.tables.clone();
        let mut terms = self.all_below(nodes);
        terms.sort_unstable();
        let mut place_of = FxHashMap::default();
        for old in terms {
            let new = match self.terms[old.place()] {
                Term::Apply(operator, a, b) => {
                    graph.applied(operator, place_of[&a], place_of[&b], self.known.get(&old).copied())
                }
                Term::Parameter(index) => graph.parameter(index, self.known[&old]),
                Term::Input(index) => graph.input(place(index)),
                term => graph.intern(term),
            };
            if let Some((base, exponent)) = self.powers.get(&old)
                && let Some(&base) = place_of.get(base)
            {
                graph.powers.insert(new, (base, *exponent));
            }
            place_of.insert(old, new);
        }
        let nodes = nodes.iter().map(|node| place_of[node]).collect();
        (graph, nodes)
    }
}

/// What was decided by the values of parameters, to be asked whether it holds for others.
#[derive(Clone, Debug, Default)]
pub struct Assumptions {
    decisions: Arc<[Decision]>,
    tape: Tape,
    values: Vec<f64>,
}

#[derive(Clone, Debug)]
struct Decision {
    assumption: Assumption,
    given: f64,
    parameters: Vec<usize>,
}

/// An assumption that does not hold.
#[derive(Clone, Debug, PartialEq)]
pub struct Broken {
    /// What was assumed.
    pub assumption: Assumption,
    /// The value of the term by which it was decided.
    pub given: f64,
    /// Its value now.
    pub found: f64,
    /// The parameters that the term depends on, sorted.
    pub parameters: Vec<usize>,
}

impl Assumptions {
    /// Those of a graph, up to now.
    pub fn new(graph: &Graph) -> Self {
        let (nodes, decisions): (Vec<Node>, Vec<Decision>) = graph
            .assumptions
            .iter()
            .map(|&(node, assumption)| {
                (node, Decision { assumption, given: graph.known[&node], parameters: graph.parameters(node) })
            })
            .unzip();
        Self { tape: Tape::compile(graph, &nodes), values: vec![0.0; nodes.len()], decisions: decisions.into() }
    }

    /// The first that does not hold for these parameters.
    ///
    /// # Errors
    /// That one.
    pub fn check(&mut self, parameters: &[f64]) -> Result<(), Broken> {
        self.tape.bind(parameters);
        self.tape.evaluate(0.0, &[], &mut self.values);
        let broken = self.decisions.iter().zip(&self.values).find(|(decision, value)| !decision.holds(**value));
        broken.map_or(Ok(()), |(decision, &found)| {
            let Decision { assumption, given, ref parameters } = *decision;
            Err(Broken { assumption, given, found, parameters: parameters.clone() })
        })
    }
}

impl Decision {
    fn holds(&self, value: f64) -> bool {
        match self.assumption {
            Assumption::Vanishing => (value == 0.0) == (self.given == 0.0),
            Assumption::Finite => value.is_finite() == self.given.is_finite(),
            Assumption::Value => value == self.given,
        }
    }
}
