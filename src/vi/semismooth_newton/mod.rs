//! Semismooth Newton on the natural map `z - P_K(z - S w) = 0`, `w = A z + q`, with `S` diagonal: over intervals
//! globalised by a Fischer-Burmeister merit function, over other sets by the D-gap function.

mod blocks;
mod intervals;

pub(super) use blocks::BlockNewton;

use super::{AffineVi, Report, ViSolver};
use intervals::IntervalNewton;
use problem::Control;

/// Semismooth Newton for affine variational inequalities over every set.
#[derive(Debug)]
pub struct SemismoothNewton {
    size: usize,
    intervals: Option<IntervalNewton>,
    blocks: Option<BlockNewton>,
}

impl SemismoothNewton {
    /// Creates a solver for problems of up to `m` variables; grows for a larger one. The variant for intervals and the
    /// variant for blocks are each built by the first problem that needs it.
    pub fn new(m: usize) -> Self {
        Self { size: m, intervals: None, blocks: None }
    }
}

impl ViSolver for SemismoothNewton {
    fn name(&self) -> &'static str {
        "semismooth_newton"
    }

    fn solve(&mut self, vi: &AffineVi<'_>, z: &mut [f64], control: &Control) -> Report {
        if vi.set.has_blocks() {
            self.blocks.get_or_insert_with(BlockNewton::default).solve(vi, z, control)
        } else {
            self.intervals.get_or_insert_with(|| IntervalNewton::new(self.size)).solve(vi, z, control)
        }
    }
}
