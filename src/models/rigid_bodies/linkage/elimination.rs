//! Gaussian elimination by blocks over the graph of a linkage: bodies and joints are its nodes, each with six unknowns,
//!
//! ```text
//! ( A   F ) ( dw )   ( body rows  )
//! ( C  -e ) ( nu ) = ( joint rows )
//! ```
//!
//! where `A` couples bodies that share a joint. A joint has no diagonal of its own: it comes after its bodies, or after one
//! that it is the last joint of. (After one of two bodies that others hold too it might have more equations than that body has
//! freedoms.) The order is else that of least degree, so that a tree takes linear time, from its leaves to its root: these are
//! the recursions of articulated bodies (Featherstone 1983), for any graph.

use nalgebra::{Matrix6, Vector6};
use std::collections::{BTreeMap, BTreeSet};

/// Iterations that take the diagonals of joints out of a solution again.
const REFINEMENTS: usize = 2;

/// The order of an elimination, and where its blocks are.
#[derive(Clone, Debug, Default)]
pub struct Plan {
    order: Vec<u32>,
    /// The nodes that are still there and coupled when one is eliminated, by its place in the order.
    later: Vec<Vec<u32>>,
    /// Where the blocks of each pair of them are, row by row.
    updates: Vec<Vec<u32>>,
    /// The blocks beside the diagonal: that of row `i` and column `j`.
    slots: BTreeMap<(u32, u32), u32>,
    /// `(row, column)` of the blocks of `later`, in their order: those right of the diagonal, and those below it.
    beside: Vec<Vec<[u32; 2]>>,
    nodes: usize,
}

impl Plan {
    /// The plan for bodies, and joints between one or two of them.
    pub fn new(bodies: usize, joints: &[[Option<u32>; 2]]) -> Self {
        let nodes = bodies + joints.len();
        let mut near: Vec<BTreeSet<u32>> = vec![BTreeSet::new(); nodes];
        let mut couple = |a: u32, b: u32| {
            near[a as usize].insert(b);
            near[b as usize].insert(a);
        };
        for (k, &[a, b]) in joints.iter().enumerate() {
            let joint = (bodies + k) as u32;
            [a, b].into_iter().flatten().for_each(|body| couple(body, joint));
            if let (Some(a), Some(b)) = (a, b) {
                couple(a, b);
            }
        }
        let mut plan = Self { nodes, ..Self::default() };
        let mut joints_of: Vec<BTreeSet<usize>> = vec![BTreeSet::new(); bodies];
        let mut missing: Vec<usize> = joints.iter().map(|pair| pair.iter().flatten().count()).collect();
        for (k, pair) in joints.iter().enumerate() {
            for body in pair.iter().flatten() {
                joints_of[*body as usize].insert(k);
            }
        }
        let mut ready: BTreeSet<(usize, u32)> = (0..bodies).map(|k| (near[k].len(), k as u32)).collect();
        let mut is_ready: Vec<bool> = (0..nodes).map(|k| k < bodies).collect();
        while let Some((_, node)) = ready.pop_first() {
            let later: Vec<u32> = std::mem::take(&mut near[node as usize]).into_iter().collect();
            for &a in &later {
                ready.remove(&(near[a as usize].len(), a));
                near[a as usize].remove(&node);
                near[a as usize].extend(later.iter().filter(|b| **b != a));
            }
            if let Some(joint) = (node as usize).checked_sub(bodies) {
                for body in joints[joint].iter().flatten() {
                    joints_of[*body as usize].remove(&joint);
                }
            } else {
                let of_body = &joints_of[node as usize];
                for &joint in of_body {
                    missing[joint] -= 1;
                    is_ready[bodies + joint] |= missing[joint] == 0 || of_body.len() == 1;
                }
            }
            ready.extend(later.iter().filter(|a| is_ready[**a as usize]).map(|a| (near[*a as usize].len(), *a)));
            plan.order.push(node);
            plan.later.push(later);
        }
        for (node, later) in plan.order.iter().zip(&plan.later) {
            for &other in later {
                for pair in [(*node, other), (other, *node)] {
                    let slot = (nodes + plan.slots.len()) as u32;
                    plan.slots.entry(pair).or_insert(slot);
                }
            }
        }
        for (node, later) in plan.order.iter().zip(&plan.later) {
            let pairs = later.iter().flat_map(|i| later.iter().map(|j| plan.slot(*i, *j)));
            plan.updates.push(pairs.collect());
            plan.beside.push(later.iter().map(|j| [plan.slot(*node, *j), plan.slot(*j, *node)]).collect());
        }
        plan
    }

    /// Where the block of this row and column is.
    pub fn slot(&self, row: u32, column: u32) -> u32 {
        if row == column { row } else { self.slots[&(row, column)] }
    }
}

/// The blocks of a matrix, and their factors.
#[derive(Clone, Debug, Default)]
pub struct Blocks {
    blocks: Vec<Matrix6<f64>>,
    /// The same before the elimination.
    whole: Vec<Matrix6<f64>>,
}

impl Blocks {
    /// Makes all blocks zero.
    pub fn clear(&mut self, plan: &Plan) {
        self.blocks.clear();
        self.blocks.resize(plan.nodes + plan.slots.len(), Matrix6::zeros());
    }

    /// The block at a place.
    pub fn at(&mut self, slot: u32) -> &mut Matrix6<f64> {
        &mut self.blocks[slot as usize]
    }

    /// Factorises in place; false where a pivot has no inverse.
    pub fn factorise(&mut self, plan: &Plan) -> bool {
        self.whole.clone_from(&self.blocks);
        for (k, node) in plan.order.iter().enumerate() {
            let Some(inverse) = self.blocks[*node as usize].try_inverse() else { return false };
            self.blocks[*node as usize] = inverse;
            let (beside, updates) = (&plan.beside[k], &plan.updates[k]);
            for (row, [_, below]) in updates.chunks_exact(beside.len().max(1)).zip(beside) {
                let scaled = self.blocks[*below as usize] * inverse;
                for (slot, [right, _]) in row.iter().zip(beside) {
                    let product = scaled * self.blocks[*right as usize];
                    self.blocks[*slot as usize] -= product;
                }
                self.blocks[*below as usize] = scaled;
            }
        }
        true
    }

    /// Solves with the factors, and takes out again what the diagonals of joints (all but `bodies`) changed: `x` comes to solve
    /// the equations without them, as far as these have a solution.
    pub fn solve_without_diagonals(&self, plan: &Plan, bodies: usize, x: &mut [Vector6<f64>]) {
        let right = x.to_vec();
        self.solve(plan, x);
        for _ in 0..REFINEMENTS {
            let mut rest = right.clone();
            for (node, rest) in rest.iter_mut().enumerate() {
                let mut block = self.whole[node];
                if node >= bodies {
                    // Rows that a joint does not have keep theirs.
                    block = block.map(|entry| if entry == 1.0 { 1.0 } else { 0.0 });
                }
                *rest -= block * x[node];
            }
            for (&(row, column), &slot) in &plan.slots {
                rest[row as usize] -= self.whole[slot as usize] * x[column as usize];
            }
            self.solve(plan, &mut rest);
            x.iter_mut().zip(&rest).for_each(|(x, rest)| *x += rest);
        }
    }

    /// Solves in place with the factors.
    pub fn solve(&self, plan: &Plan, x: &mut [Vector6<f64>]) {
        for (k, node) in plan.order.iter().enumerate() {
            let pivot = x[*node as usize];
            for (other, [_, below]) in plan.later[k].iter().zip(&plan.beside[k]) {
                x[*other as usize] -= self.blocks[*below as usize] * pivot;
            }
        }
        for (k, node) in plan.order.iter().enumerate().rev() {
            let mut rest = x[*node as usize];
            for (other, [right, _]) in plan.later[k].iter().zip(&plan.beside[k]) {
                rest -= self.blocks[*right as usize] * x[*other as usize];
            }
            x[*node as usize] = self.blocks[*node as usize] * rest;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Any matrix with the pattern of a graph, against the product with what came out. Joints have a diagonal: loops of six
    /// equations each have more equations than their bodies have freedoms.
    #[test]
    fn a_solution_times_the_matrix_is_the_right_hand_side_for_chains_stars_and_loops() {
        let chain = |n: u32| -> Vec<[Option<u32>; 2]> { (0..n).map(|k| [Some(k), k.checked_sub(1)]).collect() };
        let mut ring = chain(5);
        ring.push([Some(0), Some(4)]);
        let star: Vec<[Option<u32>; 2]> = (1..6).map(|k| [Some(k), Some(0)]).collect();
        for (bodies, joints) in [(7, chain(7)), (5, ring), (6, star)] {
            let plan = Plan::new(bodies, &joints);
            let mut seed = 1_u64;
            let mut random = || {
                seed = seed.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
                (seed >> 33) as f64 / (1_u64 << 31) as f64 - 0.5
            };
            let mut blocks = Blocks::default();
            blocks.clear(&plan);
            let mut entries = Vec::new();
            let mut put = |blocks: &mut Blocks, i: u32, j: u32, block: Matrix6<f64>| {
                *blocks.at(plan.slot(i, j)) += block;
                entries.push((i, j, block));
            };
            for body in 0..bodies as u32 {
                let block = Matrix6::from_diagonal_element(4.0) + Matrix6::from_fn(|_, _| random());
                put(&mut blocks, body, body, block);
            }
            for (k, pair) in joints.iter().enumerate() {
                let joint = (bodies + k) as u32;
                put(&mut blocks, joint, joint, Matrix6::from_diagonal_element(-1.0));
                for body in pair.iter().flatten() {
                    for (i, j) in [(*body, joint), (joint, *body)] {
                        put(&mut blocks, i, j, Matrix6::from_fn(|_, _| random()));
                    }
                }
            }
            let right: Vec<Vector6<f64>> =
                (0..bodies + joints.len()).map(|_| Vector6::from_fn(|_, _| random())).collect();
            let mut x = right.clone();
            assert!(blocks.factorise(&plan));
            blocks.solve(&plan, &mut x);
            let mut rest = right;
            for (i, j, block) in entries {
                rest[i as usize] -= block * x[j as usize];
            }
            assert!(rest.iter().all(|rest| rest.amax() < 1e-9), "{rest:?}");
        }
    }

    #[test]
    fn a_tree_takes_no_more_blocks_than_it_has_edges() {
        let n = 1000;
        let joints: Vec<[Option<u32>; 2]> = (0..n).map(|k: u32| [Some(k), k.checked_sub(1)]).collect();
        let plan = Plan::new(n as usize, &joints);
        assert!(plan.slots.len() <= 6 * n as usize, "{}", plan.slots.len());
    }
}
