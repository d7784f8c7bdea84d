//! Infix expressions, compiled to programs with exact derivatives.
//!
//! [`Graph::parse`] parses text into a directed acyclic graph in which equal terms are one node. [`Graph::gradient`]
//! sweeps the graph in reverse (Griewank and Walther 2008, *Evaluating Derivatives*, chapter 3) and adds the
//! derivatives as nodes, so that values and derivatives share common terms and can be differentiated again.
//! [`Tape::compile`] compiles selected nodes to a straight-line program, which is evaluated at a point
//! ([`Tape::evaluate`]), at several points at once ([`Tape::evaluate_points`]), or over boxes in interval arithmetic
//! ([`Tape::enclose`]).
//!
//! Precedence, lowest first: `or`, `and`, `not`, `< <= > >= == !=`, `+ -`, `* /`, sign, `^` (also written `**`), which
//! is right-associative: `-x^2` is `-(x^2)`, `2^3^2` is `2^9`, `2^-1` is one half. A condition is 1 if it holds, else
//! 0.
//!
//! Conventions at kinks: `abs'(0) = 1`, `sign(0) = 0`, `heaviside(0) = 1`, and for equal arguments of `min` or `max`
//! the derivative is that of one of them. NaN propagates through every function.

mod breaks;
mod calls;
mod caret;
mod conditions;
mod cube_root;
mod derivative;
mod discontinuous;
mod enclosure;
mod error;
mod features;
mod function;
mod grammar;
mod graph;
mod kinks;
mod lanes;
mod lipschitz;
mod operator;
mod pace;
mod parameters;
mod points;
mod power;
mod remedies;
mod scope;
mod sight;
mod structure;
mod substitution;
mod switches;
mod table;
mod tape;
#[cfg(test)]
mod tests;
mod vectors;

pub use breaks::Breaks;
pub use cube_root::cube_root;
pub use enclosure::IntervalWorkspace;
pub use error::ExpressionError;
pub use features::{Jumps, Knots};
pub use graph::{Graph, Node};
pub use kinks::{Kink, Kinks};
pub use lipschitz::{Irregularities, Irregularity};
pub use pace::Pace;
pub use parameters::{Assumption, Assumptions, Broken};
pub use points::MOST_LANES;
pub use scope::nearest;
pub use scope::{NameError, Scope};
pub use sight::Sight;
pub use table::{Interpolation, Table, TableError};
pub use tape::Tape;
