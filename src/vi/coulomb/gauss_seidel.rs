//! Block Gauss-Seidel over contacts (NSGS): each contact in turn is [solved exactly](super::solve_contact) with the
//! impulses of the others fixed (Jean 1999, *The non-smooth contact dynamics method*). A sweep is cheap and benefits
//! from a good start; but convergence is linear, and slow or absent where contacts outnumber degrees of freedom.

use super::local::Diagonal;
use super::patch::Role;
use super::{BlockMatrix, CoulombProblem, solve_patch};
use nalgebra::{Matrix3, Vector3};

/// The Delassus operator in a memory layout for sweeps: off-diagonal blocks one after the other, diagonal blocks
/// classified for the exact solution of single contacts.
#[derive(Clone, Debug, Default)]
pub(super) struct Sweeps {
    /// For each block row, the end of its off-diagonal blocks in `blocks`.
    ends: Vec<usize>,
    columns: Vec<u32>,
    blocks: Vec<Matrix3<f64>>,
    diagonal: Vec<Diagonal>,
}

impl Sweeps {
    /// Copies a Delassus operator into the memory layout of a sweep.
    pub fn fit(&mut self, matrix: &BlockMatrix) {
        self.ends.clear();
        self.columns.clear();
        self.blocks.clear();
        self.diagonal.clear();
        self.columns.reserve(matrix.stored());
        self.blocks.reserve(matrix.stored());
        for k in 0..matrix.len() {
            for (j, block) in matrix.row(k).filter(|&(j, _)| j != k) {
                self.columns.push(j as u32);
                self.blocks.push(*block);
            }
            self.ends.push(self.columns.len());
            self.diagonal.push(Diagonal::new(matrix.diagonal(k)));
        }
    }

    /// Makes one Gauss-Seidel sweep over all contacts of a problem, whose Delassus operator was copied before.
    pub fn sweep(&self, problem: &CoulombProblem, r: &mut [Vector3<f64>]) {
        if problem.has_patches() {
            self.sweep_with_patches(problem, r);
            return;
        }
        let mut start = 0;
        for (k, (&end, diagonal)) in self.ends.iter().zip(&self.diagonal).enumerate() {
            let mut q = problem.q()[k];
            for (block, &j) in self.blocks[start..end].iter().zip(&self.columns[start..end]) {
                q += block * r[j as usize];
            }
            start = end;
            if let Some(exact) = diagonal.solve(q, problem.mu()[k]) {
                r[k] = exact;
            }
        }
    }

    fn sweep_with_patches(&self, problem: &CoulombProblem, r: &mut [Vector3<f64>]) {
        let matrix = problem.matrix();
        for k in 0..r.len() {
            let mu = problem.mu()[k];
            match problem.role(k) {
                Role::Point => {
                    let q = problem.velocity(k, r) - matrix.diagonal(k) * r[k];
                    if let Some(exact) = self.diagonal[k].solve(q, mu) {
                        r[k] = exact;
                    }
                }
                Role::Force(reach) => {
                    let own = [r[k], r[k + 1]];
                    let without = |i: usize| {
                        let blocks = (0..2).filter_map(|j| Some(matrix.block(k + i, k + j)? * own[j]));
                        problem.velocity(k + i, r) - blocks.sum::<Vector3<f64>>()
                    };
                    let q = [without(0), without(1)];
                    [r[k], r[k + 1]] = solve_patch(matrix, k, &q, mu, reach, &own);
                }
                Role::Torque => {}
            }
        }
    }
}
