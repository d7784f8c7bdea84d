//! Switches: the quantities that change their sign where a term has a kink or a jump, and nowhere else. Of a function that
//! jumps at whole numbers it is the parity of such a number, 1 or -1: it changes at each of them, at the very double at which
//! the function jumps, and an interval of arguments without one between its ends leaves it a single value. Of a table it is that
//! of the number of pieces that have begun.

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
            Operator::Lookup => return self.switch_of_table(a, b),
            _ => a,
        };
        operator.kink().map(|function| (function, quantity))
    }

    /// Of time a table switches from piece to piece, whatever they are: no step passes over what it does. Of a state it has
    /// kinks between straight lines alone.
    fn switch_of_table(&mut self, a: Node, place: Node) -> Option<(&'static str, Node)> {
        let table = self.table_of(Operator::Lookup, place)?.clone();
        if self.inputs(a) == [0] {
            let piece = self.of_table(Operator::Piece, &table, a);
            return Some(("table", self.unary(Operator::Parity, piece)));
        }
        table.has_kinks().then(|| ("table", self.of_table(Operator::Lookup, table.zigzag(), a)))
    }
}
