//! Switches: event functions that change sign exactly where a term has a kink or a jump. The switch of a function with
//! jumps at integers is the parity (1 or -1) of the current integer: it changes at the same double as the function, and
//! is constant on intervals of arguments without a jump. The switch of a table is the parity of the number of pieces
//! that have begun.

use super::graph::{Graph, Node};
use super::operator::Operator;

impl Graph {
    /// Returns the name of the nonsmooth function of a term, and its switch: the event function at whose sign changes
    /// the term has a kink or a jump.
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

    /// Returns the switch of a table, the event function at whose sign changes it is not smooth. A table of time
    /// switches at every piece, so that no step passes over a piece; a table of states switches only at the kinks of
    /// linear interpolation.
    fn switch_of_table(&mut self, a: Node, place: Node) -> Option<(&'static str, Node)> {
        let table = self.table_of(Operator::Lookup, place)?.clone();
        if self.inputs(a) == [0] {
            let piece = self.of_table(Operator::Piece, &table, a);
            return Some(("table", self.unary(Operator::Parity, piece)));
        }
        table.has_kinks().then(|| ("table", self.of_table(Operator::Lookup, table.zigzag(), a)))
    }
}
