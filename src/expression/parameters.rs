//! Parameters: inputs that are constant during a solve. Terms in parameters have known values at the given parameter
//! values, which decide about structure: whether a coefficient vanishes, or whether an exponent is an integer. Each
//! such decision is recorded as an assumption, which is checked before new values are bound.

use super::graph::{Graph, Node, Term};
use super::tape::Tape;
use rustc_hash::FxHashMap;
use std::sync::Arc;

/// An assumption about the value of a term in parameters.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Assumption {
    /// The term is zero, or not zero, as at the given parameter values.
    Vanishing,
    /// The term is finite, or not finite, as at the given parameter values.
    Finite,
    /// The term has exactly the value that it has at the given parameter values.
    Value,
}

impl Graph {
    /// Returns the node of the parameter with this `index` among the values of [`Tape::bind`]; its given `value`
    /// decides about structure, such as whether a coefficient vanishes.
    pub fn parameter(&mut self, index: usize, value: f64) -> Node {
        let node = self.intern(Term::Parameter(index));
        self.known.insert(node, value);
        node
    }

    /// Declares that the value of a parameter is to vary. This must happen before terms with the parameter are built:
    /// its coefficients are part of the structure even if they are zero, and powers with it as exponent are not
    /// expanded.
    pub fn vary(&mut self, parameter: Node) {
        self.varied.insert(parameter);
    }

    /// Whether a term depends on a parameter that is to [vary](Self::vary).
    pub fn is_varied(&self, node: Node) -> bool {
        self.varied.contains(&node)
    }

    /// Returns the parameters that `node` depends on, sorted.
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

    /// Records an assumption about the value of a term in parameters; numbers need no assumptions.
    pub fn assume(&mut self, node: Node, assumption: Assumption) {
        if self.known.contains_key(&node) {
            self.assumptions.insert((node, assumption));
        }
    }

    /// Whether a term in parameters is zero at the given parameter values; the answer is recorded as an assumption.
    pub fn vanishes(&mut self, node: Node) -> bool {
        self.assume(node, Assumption::Vanishing);
        self.value(node) == Some(0.0)
    }

    /// Whether a coefficient does not belong to the structure of an expression: it is zero, and does not vary.
    pub fn is_absent(&mut self, coefficient: Node) -> bool {
        !self.is_varied(coefficient) && self.vanishes(coefficient)
    }

    /// Copies the terms below `nodes` to a new graph; returns the graph and the new nodes. Parameters keep their
    /// indices and values.
    pub fn below(&self, nodes: &[Node]) -> (Self, Vec<Node>) {
        self.below_with(nodes, |input| input)
    }

    /// Copies the terms below `nodes` to a new graph, as [`below`](Self::below) does, with inputs renumbered by
    /// `place`.
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
                Term::Parameter(index) => {
                    let parameter = graph.parameter(index, self.known[&old]);
                    if self.is_varied(old) {
                        graph.vary(parameter);
                    }
                    parameter
                }
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

/// The compiled assumptions of a graph, to be checked for new parameter values.
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

/// An assumption about the value of a term in parameters that new parameter values violate.
#[derive(Clone, Debug, PartialEq)]
pub struct Broken {
    /// The assumption that the new parameter values violate.
    pub assumption: Assumption,
    /// The value of the term at the parameter values for which the assumption was made.
    pub given: f64,
    /// The value of the term at the new parameter values.
    pub found: f64,
    /// The parameters on which the term depends, sorted.
    pub parameters: Vec<usize>,
}

impl Assumptions {
    /// Compiles the assumptions recorded so far in a graph.
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

    /// Checks the assumptions for new parameters.
    ///
    /// # Errors
    /// The first violated assumption.
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
