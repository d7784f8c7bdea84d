//! What a type of problem says of itself as it is written, before it is checked.

use super::lowering::{Lowering, Named, Start};
use super::model::Model;
use super::pointer::Pointer;
use std::sync::Arc;

/// A problem in the course of being lowered, and its model, which is of use only if no error was found.
pub(super) type Lowered<'c> = (Lowering<'c>, Option<Arc<dyn Model>>);

/// A problem as it is written.
pub(super) trait Written {
    /// The key of its type.
    fn key(&self) -> &'static str;

    /// What its expressions may use, and what is told beside its outputs.
    fn named(&self) -> Named<'_>;

    /// The states and variables that it declares, about.
    fn unknowns(&self) -> usize;

    /// What checking it takes beyond what the length of the text tells, in nanoseconds: of the size that was measured.
    fn time_to_check(&self) -> usize {
        0
    }

    /// Whether it has no time.
    fn is_static(&self) -> bool {
        false
    }

    /// Lowers the problem as far as it can be.
    fn lower<'c>(&self, place: &Pointer<'_>, start: Start<'c>) -> Lowered<'c>;
}
