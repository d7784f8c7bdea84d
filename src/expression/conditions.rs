//! Comparisons and conditions. A condition is 1 if it holds and 0 otherwise; its breaks are those of `heaviside`. The
//! difference of two doubles has the correct sign, so that rounding does not affect comparisons.

use super::graph::{Graph, Node};
use super::operator::Operator;

/// Remedy for a comparison of states, as text for messages.
pub(super) const AS_SET: &str = "a variable in a set, or a `filippov` problem: `a > b` = z with z in the box [0, 1] and \
     the inequality b - a, and `if(a > b, p, q)` = q + (p - q)*z";

/// A comparison operator of the expression language.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Comparison {
    Less,
    LessOrEqual,
    Greater,
    GreaterOrEqual,
    Equal,
    Unequal,
}

impl Comparison {
    /// Builds the condition `a ~ b` for the comparison `~`: 1 if it holds, else 0; NaN propagates.
    pub(super) fn apply(self, graph: &mut Graph, a: Node, b: Node) -> Node {
        match self {
            Self::Less => graph.at_least(a, b, true),
            Self::LessOrEqual => graph.at_least(b, a, false),
            Self::Greater => graph.at_least(b, a, true),
            Self::GreaterOrEqual => graph.at_least(a, b, false),
            Self::Equal => graph.equal(a, b),
            Self::Unequal => {
                let equal = graph.equal(a, b);
                graph.not(equal)
            }
        }
    }
}

impl Graph {
    /// Builds the condition `a >= b`, or its negation if `negated`.
    pub(super) fn at_least(&mut self, a: Node, b: Node, negated: bool) -> Node {
        let difference = self.subtract(a, b);
        let holds = self.heaviside(difference);
        if negated { self.not(holds) } else { holds }
    }

    pub(super) fn equal(&mut self, a: Node, b: Node) -> Node {
        let (below, above) = (self.at_least(b, a, false), self.at_least(a, b, false));
        self.multiply(below, above)
    }

    pub(super) fn not(&mut self, condition: Node) -> Node {
        let one = self.constant(1.0);
        self.subtract(one, condition)
    }

    pub(super) fn or(&mut self, a: Node, b: Node) -> Node {
        let (neither_a, neither_b) = (self.not(a), self.not(b));
        let neither = self.multiply(neither_a, neither_b);
        self.not(neither)
    }

    /// Builds the term that is `a` if a condition holds, else `b`; the operand that is not chosen may be undefined.
    pub(super) fn choice(&mut self, condition: Node, a: Node, b: Node) -> Node {
        match self.number(condition) {
            Some(1.0) => return a,
            Some(0.0) => return b,
            _ => {}
        }
        let otherwise = self.not(condition);
        let (a, b) = (self.chosen(condition, a), self.chosen(otherwise, b));
        self.add(a, b)
    }

    /// Builds the term that is `a` if a condition holds, else 0; `a` may be undefined where the condition does not
    /// hold.
    fn chosen(&mut self, condition: Node, a: Node) -> Node {
        match self.number(a) {
            Some(number) if number.is_finite() => self.multiply(condition, a),
            _ => self.binary(Operator::Choose, condition, a),
        }
    }
}
