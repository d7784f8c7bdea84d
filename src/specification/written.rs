//! The interface of problem types as users write them, before they are checked.

use super::lowering::{Lowering, Named, Start};
use super::model::Model;
use super::pointer::Pointer;
use std::sync::Arc;

/// A problem translated from the user's notation: the context with its names, expressions and errors, and its model,
/// which is meaningful only if there are no errors.
pub(super) type Lowered<'c> = (Lowering<'c>, Option<Arc<dyn Model>>);

/// A problem as the user writes it.
pub(super) trait Written {
    /// The key of the problem type in a document, such as `dvi`.
    fn key(&self) -> &'static str;

    /// The named quantities: parameters and tables for expressions, definitions and integrals as further columns.
    fn named(&self) -> Named<'_>;

    /// Approximate number of states and variables that the problem declares.
    fn unknowns(&self) -> usize;

    /// Estimated time to check the problem, beyond what the length of the text accounts for, in nanoseconds as
    /// measured on one machine.
    fn time_to_check(&self) -> usize {
        0
    }

    /// Whether the problem is a static variational inequality, without time.
    fn is_static(&self) -> bool {
        false
    }

    /// Translates the problem from the user's notation to a model, as far as possible; errors are collected in the
    /// context.
    fn lower<'c>(&self, place: &Pointer<'_>, start: Start<'c>) -> Lowered<'c>;
}
