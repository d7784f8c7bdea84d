//! The expression graph: equal terms are one node (hash consing), and operands come before the terms that use them.
//!
//! Rewriting is exact in IEEE arithmetic with rounding to nearest, up to the sign of zeros: neutral elements are
//! dropped, signs move outwards (`-a - b = -(a + b)`), and division by a power of two becomes multiplication.
//! `0 x -> 0` and `x - x -> 0` are not applied, because they would hide a NaN or an infinity in `x`.
//!
//! Terms in parameters and numbers alone have a known value, at the given parameter values ([`Graph::parameter`]),
//! and count as constants for the structure of a problem. Rules for signs use known values, because they hold for
//! either sign. Neutral elements and divisions by powers of two are rewritten only for numbers, not for parameters.
//! Evaluation is then bitwise equal to that with numbers instead of parameters, except for signs of zeros, for
//! exponents that are integers or halves in only one of both cases, and for derivatives in which terms are equal only
//! by their numbers (different order of sums).

use super::operator::Operator;
use super::parameters::Assumption;
use super::table::{Pieces, Table, Tables};
use rustc_hash::{FxHashMap, FxHashSet};
use std::collections::BTreeSet;
use std::sync::Arc;

/// A term of a [`Graph`] of expressions, by its index.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub struct Node(pub(super) u32);

impl Node {
    /// Returns the index of the node among the terms of its graph.
    pub(super) fn place(self) -> usize {
        self.0 as usize
    }
}

/// A term of an expression: a number, an input, a parameter, or an operator applied to two terms (twice the same term
/// if it is unary).
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub(super) enum Term {
    /// The bits of a floating-point number, so that the constant can be hashed.
    Constant(u64),
    Input(usize),
    Parameter(usize),
    Apply(Operator, Node, Node),
}

/// A directed acyclic graph of terms, shared by any number of expressions.
#[derive(Clone, Debug, Default)]
pub struct Graph {
    pub(super) terms: Vec<Term>,
    places: FxHashMap<Term, Node>,
    /// Powers `base^exponent` expanded to products, whose derivatives are shorter than those of the products.
    pub(super) powers: FxHashMap<Node, (Node, i32)>,
    /// The values of terms in parameters alone, at the given parameter values.
    pub(super) known: FxHashMap<Node, f64>,
    /// The terms that depend on a parameter whose value will be varied, such as by a sweep.
    pub(super) varied: FxHashSet<Node>,
    /// The assumptions about the structure of expressions (such as that a coefficient is not zero) that were decided
    /// by the values `known` of terms in parameters.
    pub(super) assumptions: BTreeSet<(Node, Assumption)>,
    /// The tables used by terms.
    pub(super) tables: Tables,
    /// The number of bytes of text that have been parsed more than once, for the terms of sums.
    pub(super) read_again: usize,
}

impl Graph {
    /// Creates a graph without terms.
    pub fn new() -> Self {
        Self::default()
    }

    /// Returns the number of terms of the graph.
    pub fn len(&self) -> usize {
        self.terms.len()
    }

    /// Whether the graph has no terms.
    pub fn is_empty(&self) -> bool {
        self.terms.is_empty()
    }

    /// Returns the node of a constant.
    pub fn constant(&mut self, value: f64) -> Node {
        self.intern(Term::Constant(value.to_bits()))
    }

    /// Returns the node of the input with this `index` among the inputs of [`Tape::evaluate`](super::Tape::evaluate).
    pub fn input(&mut self, index: usize) -> Node {
        self.intern(Term::Input(index))
    }

    /// Returns the value of a constant node, or of a node in parameters alone at the given parameter values.
    pub fn value(&self, node: Node) -> Option<f64> {
        match self.terms[node.place()] {
            Term::Constant(bits) => Some(f64::from_bits(bits)),
            Term::Input(_) => None,
            Term::Parameter(_) | Term::Apply(..) => self.known.get(&node).copied(),
        }
    }

    /// Returns the value of a node that is a number, independent of parameters.
    pub fn number(&self, node: Node) -> Option<f64> {
        match self.terms[node.place()] {
            Term::Constant(bits) => Some(f64::from_bits(bits)),
            _ => None,
        }
    }

    /// Returns the operator and the operands of a term that is not constant.
    pub(super) fn operation(&self, node: Node) -> Option<(Operator, Node, Node)> {
        match self.terms[node.place()] {
            Term::Apply(operator, a, b) if !self.known.contains_key(&node) => Some((operator, a, b)),
            _ => None,
        }
    }

    /// Returns the node of `-a`.
    pub fn negate(&mut self, a: Node) -> Node {
        match self.terms[a.place()] {
            Term::Apply(Operator::Negate, inner, _) => inner,
            _ => self.unary(Operator::Negate, a),
        }
    }

    /// Returns the node of `a + b`.
    pub fn add(&mut self, a: Node, b: Node) -> Node {
        if self.number(a) == Some(0.0) {
            return b;
        }
        if self.number(b) == Some(0.0) {
            return a;
        }
        match (self.negated(a), self.negated(b)) {
            (Some(a), Some(b)) => {
                let sum = self.binary(Operator::Add, a, b);
                self.negate(sum)
            }
            (Some(a), None) => self.binary(Operator::Subtract, b, a),
            (None, Some(b)) => self.binary(Operator::Subtract, a, b),
            (None, None) => self.binary(Operator::Add, a, b),
        }
    }

    /// Returns the node of `a - b`.
    pub fn subtract(&mut self, a: Node, b: Node) -> Node {
        if self.number(b) == Some(0.0) {
            return a;
        }
        let minus_b = self.negate(b);
        if self.number(a) == Some(0.0) {
            return minus_b;
        }
        match self.negated(a) {
            Some(_) => self.add(a, minus_b),
            None if self.negated(b).is_some() => self.binary(Operator::Add, a, minus_b),
            None => self.binary(Operator::Subtract, a, b),
        }
    }

    /// Returns the node of `a b`.
    pub fn multiply(&mut self, a: Node, b: Node) -> Node {
        if self.number(a) == Some(1.0) {
            return b;
        }
        if self.number(b) == Some(1.0) {
            return a;
        }
        self.signed(Operator::Multiply, a, b)
    }

    /// Returns the node of `a / b`.
    pub fn divide(&mut self, a: Node, b: Node) -> Node {
        match self.number(b) {
            Some(1.0) => a,
            Some(divisor) if is_power_of_two(divisor) => {
                let reciprocal = self.constant(1.0 / divisor);
                self.multiply(a, reciprocal)
            }
            _ => self.signed(Operator::Divide, a, b),
        }
    }

    /// Returns the node that is 1 if `a >= 0`, else 0.
    pub fn heaviside(&mut self, a: Node) -> Node {
        self.unary(Operator::Heaviside, a)
    }

    /// Returns the node of the value of a table at `a`.
    pub fn lookup(&mut self, table: &Table, a: Node) -> Node {
        self.of_table(Operator::Lookup, &table.0, a)
    }

    /// Returns the node of a table operator applied at `a`.
    pub(super) fn of_table(&mut self, operator: Operator, table: &Arc<Pieces>, a: Node) -> Node {
        let place = self.tables.place(table);
        let place = self.constant(place as f64);
        self.binary(operator, a, place)
    }

    /// Returns the table that a table operator evaluates, given the second operand of the operator.
    pub(super) fn table_of(&self, operator: Operator, place: Node) -> Option<&Arc<Pieces>> {
        self.tables.get(self.number(place).filter(|_| operator.takes_table())?)
    }

    /// Returns the node of a product or a quotient with the sign moved outwards, so that `-k x` and `k x` share a
    /// term.
    fn signed(&mut self, operator: Operator, a: Node, b: Node) -> Node {
        let (minus_a, a) = self.without_sign(a);
        let (minus_b, b) = self.without_sign(b);
        let magnitude = self.binary(operator, a, b);
        if minus_a == minus_b { magnitude } else { self.negate(magnitude) }
    }

    /// Splits off a negative sign of a term: returns whether there is one, and the term without it.
    fn without_sign(&mut self, a: Node) -> (bool, Node) {
        match (self.value(a), self.negated(a)) {
            (Some(value), _) if value < 0.0 => (true, self.negate(a)),
            (_, Some(inner)) => (true, inner),
            _ => (false, a),
        }
    }

    /// Returns `b` if `a` is the term `-b`; `None` for negative constants.
    fn negated(&self, a: Node) -> Option<Node> {
        match self.operation(a) {
            Some((Operator::Negate, inner, _)) => Some(inner),
            _ => None,
        }
    }

    /// Returns the node of a unary operator applied to `a`; folded to a constant if `a` is a number.
    pub(super) fn unary(&mut self, operator: Operator, a: Node) -> Node {
        match self.number(a) {
            Some(a) => self.constant(operator.apply(a, a)),
            None => {
                let value = self.value(a).map(|a| operator.apply(a, a));
                self.applied(operator, a, a, value)
            }
        }
    }

    /// Returns the node of a binary operator applied to `(a, b)`; folded to a constant if both are numbers.
    pub(super) fn binary(&mut self, operator: Operator, a: Node, b: Node) -> Node {
        if let (Some(a), Some(b)) = (self.number(a), self.number(b)) {
            let value = self.tables.apply(operator, a, b);
            return self.constant(value);
        }
        let value = self.value(a).zip(self.value(b)).map(|(a, b)| self.tables.apply(operator, a, b));
        let (a, b) = if operator.commutes() && b < a { (b, a) } else { (a, b) };
        self.applied(operator, a, b, value)
    }

    /// Returns the node of an operator applied to two terms, with its value at the given parameter values, if known.
    pub(super) fn applied(&mut self, operator: Operator, a: Node, b: Node, value: Option<f64>) -> Node {
        let node = self.intern(Term::Apply(operator, a, b));
        if let Some(value) = value {
            self.known.insert(node, value);
            if self.varied.contains(&a) || self.varied.contains(&b) {
                self.varied.insert(node);
            }
        }
        node
    }

    pub(super) fn intern(&mut self, term: Term) -> Node {
        *self.places.entry(term).or_insert_with(|| {
            let place = u32::try_from(self.terms.len()).expect("a graph has fewer than 2^32 terms");
            self.terms.push(term);
            Node(place)
        })
    }
}

/// Whether `1 / divisor` is exact: the mantissa is zero, and neither number is subnormal.
pub(super) fn is_power_of_two(divisor: f64) -> bool {
    const MANTISSA: u64 = (1 << 52) - 1;
    divisor.to_bits() & MANTISSA == 0 && divisor.is_normal() && (1.0 / divisor).is_normal()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn equal_terms_are_one_node_whatever_the_order_and_the_sign() {
        let mut graph = Graph::new();
        let (x, y, k) = (graph.input(1), graph.input(2), graph.constant(-3.0));
        let product = graph.multiply(x, y);
        assert_eq!(product, graph.multiply(y, x));
        let minus_x = graph.negate(x);
        let minus_product = graph.multiply(minus_x, y);
        assert_eq!(product, graph.negate(minus_product));
        let left = graph.multiply(k, x);
        let three = graph.constant(3.0);
        let right = graph.multiply(three, x);
        assert_eq!(left, graph.negate(right));
    }

    #[test]
    fn neutral_elements_vanish_but_zero_times_x_stays() {
        let mut graph = Graph::new();
        let (x, zero, one) = (graph.input(1), graph.constant(0.0), graph.constant(1.0));
        assert_eq!(graph.add(x, zero), x);
        assert_eq!(graph.subtract(x, zero), x);
        assert_eq!(graph.multiply(one, x), x);
        assert_eq!(graph.divide(x, one), x);
        let product = graph.multiply(zero, x);
        let difference = graph.subtract(x, x);
        assert_eq!((graph.value(product), graph.value(difference)), (None, None));
    }

    #[test]
    fn constants_fold_to_what_they_evaluate_to_even_if_that_is_not_finite() {
        let mut graph = Graph::new();
        let (zero, one) = (graph.constant(0.0), graph.constant(1.0));
        let infinite = graph.divide(one, zero);
        assert_eq!(graph.value(infinite), Some(f64::INFINITY));
        let undefined = graph.multiply(zero, infinite);
        assert!(graph.value(undefined).is_some_and(f64::is_nan));
    }

    #[test]
    fn only_exact_reciprocals_replace_a_division() {
        assert!(is_power_of_two(8.0) && is_power_of_two(-0.25));
        assert!(!is_power_of_two(3.0) && !is_power_of_two(0.0) && !is_power_of_two(f64::INFINITY));
        assert!(!is_power_of_two(2f64.powi(1023)), "its reciprocal is subnormal");
    }
}
