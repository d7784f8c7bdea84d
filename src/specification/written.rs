//! What a type of problem says of itself as it is written, before it is checked.

use super::expression::Expression;
use super::lowering::{Givens, Lowering, Start};
use super::model::Model;
use super::ordered::Ordered;
use super::place::Place;
use super::tables::TableOfPoints;
use std::sync::Arc;

/// A problem in the course of being lowered, and its model, which is of use only if no error was found.
pub(super) type Lowered<'c> = (Lowering<'c>, Option<Arc<dyn Model>>);

/// A problem as it is written.
pub(super) trait Written {
    /// The key of its type.
    fn key(&self) -> &'static str;

    /// Its parameters.
    fn parameters(&self) -> &Ordered<Expression>;

    /// Its tables.
    fn tables(&self) -> &Ordered<TableOfPoints>;

    /// What all its expressions may use.
    fn givens(&self) -> Givens<'_> {
        Givens { parameters: self.parameters(), tables: self.tables() }
    }

    /// Its definitions.
    fn definitions(&self) -> &Ordered<Expression>;

    /// Its integrals.
    fn integrals(&self) -> &Ordered<Expression>;

    /// The states and variables that it declares, about.
    fn unknowns(&self) -> usize;

    /// What checking it takes beyond what the length of the text tells, in nanoseconds: of the size that was measured.
    fn time_to_check(&self) -> usize {
        0
    }

    /// Lowers the problem as far as it can be.
    fn lower<'c>(&self, place: &Place<'_>, start: Start<'c>) -> Lowered<'c>;
}
