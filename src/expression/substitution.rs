//! Substitution of numbers for the inputs of a term.

use super::derivative::MAXIMUM_TERMS;
use super::error::ExpressionError;
use super::graph::{Graph, Node, Term};
use super::operator::Operator;
use rustc_hash::FxHashMap;

/// The result of substituting numbers for inputs in a term; numbers are added to the graph only if a term needs them.
#[derive(Clone, Copy)]
enum Replaced {
    Number(f64),
    Term(Node),
}

impl Graph {
    /// Substitutes numbers for inputs of `node`; subterms without remaining inputs are folded to numbers.
    ///
    /// # Errors
    /// `too_many_nodes` if the graph exceeds two million terms.
    pub fn substitute(&mut self, node: Node, numbers: &[(usize, f64)]) -> Result<Node, ExpressionError> {
        let mut terms = self.terms_below(&[node]);
        // Sort by position: operands come before the terms that use them.
        terms.sort_unstable();
        let mut replaced: FxHashMap<Node, Replaced> = FxHashMap::default();
        for old in terms {
            let new = match self.terms[old.place()] {
                Term::Constant(bits) => Replaced::Number(f64::from_bits(bits)),
                Term::Input(index) => match numbers.iter().find(|(input, _)| *input == index) {
                    Some(&(_, number)) => Replaced::Number(number),
                    None => Replaced::Term(old),
                },
                Term::Parameter(_) => Replaced::Term(old),
                Term::Apply(..) if self.value(old).is_some() => Replaced::Term(old),
                // The value of an expanded power is that of its product, which is the first operand.
                Term::Apply(Operator::Expanded, a, _) => replaced[&a],
                Term::Apply(operator, a, b) => match (replaced[&a], replaced[&b]) {
                    (Replaced::Number(a), Replaced::Number(b)) => Replaced::Number(self.tables.apply(operator, a, b)),
                    (a, b) => {
                        let (a, b) = (self.node_of(a), self.node_of(b));
                        Replaced::Term(if operator.is_unary() {
                            self.unary(operator, a)
                        } else {
                            self.binary(operator, a, b)
                        })
                    }
                },
            };
            replaced.insert(old, new);
        }
        if self.len() > MAXIMUM_TERMS {
            return Err(ExpressionError::too_many_nodes(0));
        }
        Ok(self.node_of(replaced[&node]))
    }

    fn node_of(&mut self, replaced: Replaced) -> Node {
        match replaced {
            Replaced::Number(number) => self.constant(number),
            Replaced::Term(node) => node,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::super::{Graph, Scope};

    #[test]
    fn what_has_all_its_inputs_becomes_the_number_it_would_evaluate_to() {
        let (mut graph, mut scope) = (Graph::new(), Scope::new());
        for (index, name) in ["t", "x", "y"].into_iter().enumerate() {
            let input = graph.input(index);
            scope.bind(name, input).expect("a new name");
        }
        let node = graph.parse("sin(x*y)^3 - max(x, 2)/y", &scope).expect("an expression");
        let number = graph.substitute(node, &[(1, 0.7), (2, -1.3)]).expect("few terms");
        let expected = f64::sin(0.7 * -1.3).powi(3) - 2.0 / -1.3;
        assert!((graph.value(number).expect("a number") - expected).abs() < 1e-15);

        let mixed = graph.parse("exp(-t)*x + t*t", &scope).expect("an expression");
        let of_time = graph.substitute(mixed, &[(1, 3.0)]).expect("few terms");
        let expected = graph.parse("exp(-t)*3 + t*t", &scope).expect("an expression");
        assert_eq!(of_time, expected);
    }
}
