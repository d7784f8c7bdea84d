//! Switches: the quantities that change their sign where a term has a kink or a jump, and nowhere else. Of a function that
//! jumps at whole numbers it is the parity of such a number, 1 or -1: it changes at each of them, at the very double at which
//! the function jumps, and an interval of arguments without one between its ends leaves it a single value.

use super::graph::{Graph, Node};
use super::operator::Operator;

impl Graph {
    /// The function that is not smooth, as the language calls it, and its switch.
    pub(super) fn switch(&mut self, node: Node) -> Option<(&'static str, Node)> {
        let (operator, a, b) = self.operation(node)?;
        let quantity = match operator {
            Operator::Min | Operator::Max => self.subtract(a, b),
            Operator::Floor | Operator::Round => self.unary(Operator::Parity, node),
            Operator::Modulo => {
                let quotient = self.divide(a, b);
                let whole = self.unary(Operator::Floor, quotient);
                self.unary(Operator::Parity, whole)
            }
            _ => a,
        };
        operator.kink().map(|function| (function, quantity))
    }
}
