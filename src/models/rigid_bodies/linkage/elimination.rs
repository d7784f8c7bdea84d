//! Block Gaussian elimination over the graph of a linkage. The nodes of the graph are bodies, with six unknowns `dw`
//! each, and joints, with one unknown `nu` per equation,
//!
//! ```text
//! ( A   F ) ( dw )   ( body rows  )
//! ( C  -e ) ( nu ) = ( joint rows )
//! ```
//!
//! where `A` couples bodies that share a joint. A rigid joint has a zero diagonal block: it is eliminated after both of
//! its bodies, or after a body whose last remaining joint it is. (Eliminated after a body that has other joints, it
//! could have more equations than the body has degrees of freedom.) Otherwise the order is that of minimum degree, so
//! that a tree takes linear time, from leaves to root: a generalisation of the articulated-body recursions
//! (Featherstone 1983) to any graph.

use super::dense;
use nalgebra::{Matrix6, Vector6};
use std::collections::{BTreeMap, BTreeSet};

/// Number of steps of iterative refinement that remove the effect of the regularising diagonals of redundant joints
/// from a solution.
const REFINEMENTS: usize = 2;

/// The symbolic factorisation of the matrix of a linkage: the elimination order, and the blocks of the matrix with
/// their positions in memory. A block is identified by its slot, an index into the list of blocks.
#[derive(Clone, Debug, Default)]
pub struct Plan {
    order: Vec<u32>,
    /// For each node (body or joint) in elimination order, the nodes eliminated later that are coupled to it at that
    /// stage.
    later: Vec<Vec<u32>>,
    /// For each node (body or joint) in elimination order, the slots of the blocks of all pairs of its `later` nodes,
    /// by rows.
    updates: Vec<Vec<u32>>,
    /// The slots of off-diagonal matrix blocks, by the nodes `(row, column)` of the block.
    slots: BTreeMap<(u32, u32), u32>,
    /// For each node in elimination order and each of its `later` nodes, the slots of the matrix block right of the
    /// diagonal block and of the block below it.
    beside: Vec<Vec<[u32; 2]>>,
    nodes: usize,
    /// The position and size of each matrix block, by slot; diagonal blocks come first.
    blocks: Vec<Block>,
    /// The number of entries of all matrix blocks together.
    entries: usize,
}

/// The slots (indices into the list of blocks) of the matrix blocks to which a joint contributes, for its first and
/// its second body; zero for a body that is not part of the linkage.
#[derive(Clone, Copy, Debug, Default)]
pub struct JointSlots {
    /// The slots of the blocks with the rows of the joint and the columns of each body.
    pub rows: [u32; 2],
    /// The slots of the blocks with the rows of each body and the columns of the joint.
    pub columns: [u32; 2],
    /// The slots of the blocks with the rows of one body and the columns of one body.
    pub bodies: [[u32; 2]; 2],
}

/// The position and size of a column-major matrix block in the list of entries.
#[derive(Clone, Copy, Debug)]
struct Block {
    at: usize,
    rows: usize,
    columns: usize,
}

impl Block {
    fn range(&self) -> std::ops::Range<usize> {
        self.at..self.at + self.rows * self.columns
    }

    /// Subtracts the product of the matrix block with the vector `x` from `from`; `entries` are the entries of all
    /// blocks.
    fn subtract(&self, entries: &[f64], x: &Vector6<f64>, from: &mut Vector6<f64>) {
        let columns = entries[self.range()].chunks_exact(self.rows);
        let from = &mut from.as_mut_slice()[..self.rows];
        for (column, x) in columns.zip(x.as_slice()) {
            from.iter_mut().zip(column).for_each(|(from, entry)| *from -= entry * x);
        }
    }
}

impl Plan {
    /// Plans the elimination of a linkage with a number of bodies; `joints` are the bodies of each joint, `equations`
    /// the number of equations of each joint.
    pub fn new(bodies: usize, joints: &[[Option<u32>; 2]], equations: &[usize]) -> Self {
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
        let size = |node: u32| (node as usize).checked_sub(bodies).map_or(6, |joint| equations[joint]);
        let mut pairs: Vec<(u32, u32)> = (0..nodes as u32).map(|node| (node, node)).collect();
        pairs.resize(nodes + plan.slots.len(), (0, 0));
        plan.slots.iter().for_each(|(pair, slot)| pairs[*slot as usize] = *pair);
        for (row, column) in pairs {
            let (rows, columns) = (size(row), size(column));
            plan.blocks.push(Block { at: plan.entries, rows, columns });
            plan.entries += rows * columns;
        }
        plan
    }

    /// Returns the memory in bytes of the matrix of a linkage with its factors, and of the symbolic factorisation.
    pub fn bytes(&self) -> usize {
        let lists = self.later.iter().map(|later| size_of_val(&later[..])).sum::<usize>();
        let pairs = self.updates.iter().map(|pairs| size_of_val(&pairs[..])).sum::<usize>();
        let headers = self.nodes * 3 * size_of::<Vec<u32>>();
        let blocks = self.blocks.len() * (size_of::<Block>() + size_of::<((u32, u32), u32)>());
        2 * self.entries * size_of::<f64>() + 3 * lists + pairs + headers + blocks
    }

    /// Returns the slots of the matrix blocks to which the joint with node number `joint`, between a pair of bodies,
    /// contributes.
    pub fn slots_of_joint(&self, joint: u32, pair: [Option<u32>; 2]) -> JointSlots {
        let of = |body: Option<u32>, slot: &dyn Fn(u32) -> u32| body.map_or(0, slot);
        JointSlots {
            rows: pair.map(|body| of(body, &|body| self.slot(joint, body))),
            columns: pair.map(|body| of(body, &|body| self.slot(body, joint))),
            bodies: pair
                .map(|body| pair.map(|other| of(body.and(other), &|other| self.slot(body.unwrap_or(other), other)))),
        }
    }

    /// Returns the slot of the matrix block with the given row and column nodes.
    pub fn slot(&self, row: u32, column: u32) -> u32 {
        if row == column { row } else { self.slots[&(row, column)] }
    }
}

/// The blocks of the matrix of a linkage, which factorisation replaces by those of its factors. A block has six rows
/// (columns) for a body, and one per equation for a joint.
#[derive(Clone, Debug, Default)]
pub struct Blocks {
    blocks: Vec<f64>,
    /// The entries of the matrix before elimination, without the regularising diagonals of redundant joints.
    whole: Vec<f64>,
}

impl Blocks {
    /// Sets all blocks of the matrix of a linkage to zero.
    pub fn clear(&mut self, plan: &Plan) {
        self.blocks.clear();
        self.blocks.resize(plan.entries, 0.0);
    }

    /// Adds the leading rows and columns of `block` to the matrix block at a slot.
    pub fn add(&mut self, plan: &Plan, slot: u32, block: &Matrix6<f64>) {
        let Block { at, rows, columns } = plan.blocks[slot as usize];
        for (column, into) in self.blocks[at..at + rows * columns].chunks_exact_mut(rows).enumerate() {
            into.iter_mut().zip(block.column(column).iter()).for_each(|(into, entry)| *into += entry);
        }
    }

    /// Factorises the matrix in place, with `diagonals` added to the joint blocks; returns false if a pivot is
    /// singular. If solutions are to be refined (`is_refined`), keeps the matrix for
    /// [`solve_without_diagonals`](Self::solve_without_diagonals).
    pub fn factorise(&mut self, plan: &Plan, diagonals: &[Vector6<f64>], is_refined: bool) -> bool {
        if is_refined {
            self.whole.clone_from(&self.blocks);
        }
        let bodies = plan.nodes - diagonals.len();
        for (block, diagonal) in plan.blocks[bodies..plan.nodes].iter().zip(diagonals) {
            (0..block.rows).for_each(|i| self.blocks[block.at + i * (block.rows + 1)] += diagonal[i]);
        }
        let mut scaled = [0.0; 36];
        for (k, node) in plan.order.iter().enumerate() {
            let pivot = &plan.blocks[*node as usize];
            let n = pivot.rows;
            let mut inverse = [0.0; 36];
            inverse[..n * n].copy_from_slice(&self.blocks[pivot.range()]);
            if !dense::invert(n, &mut inverse[..n * n]) {
                return false;
            }
            self.blocks[pivot.range()].copy_from_slice(&inverse[..n * n]);
            let (beside, updates) = (&plan.beside[k], &plan.updates[k]);
            for (row, [_, below]) in updates.chunks_exact(beside.len().max(1)).zip(beside) {
                let below = &plan.blocks[*below as usize];
                let scaled = &mut scaled[..below.rows * n];
                scaled.fill(0.0);
                dense::subtract_product([below.rows, n, n], scaled, &self.blocks[below.range()], &inverse[..n * n]);
                scaled.iter_mut().for_each(|entry| *entry = -*entry);
                for (slot, [right, _]) in row.iter().zip(beside) {
                    let (right, block) = (&plan.blocks[*right as usize], &plan.blocks[*slot as usize]);
                    let mut factor = [0.0; 36];
                    let factor = &mut factor[..n * right.columns];
                    factor.copy_from_slice(&self.blocks[right.range()]);
                    let sizes = [block.rows, n, block.columns];
                    dense::subtract_product(sizes, &mut self.blocks[block.range()], scaled, factor);
                }
                self.blocks[below.range()].copy_from_slice(scaled);
            }
        }
        true
    }

    /// Solves the linear system in place, with iterative refinement against the matrix without the regularising
    /// diagonals: `x` solves the unregularised equations if they are consistent.
    pub fn solve_without_diagonals(&self, plan: &Plan, x: &mut [Vector6<f64>]) {
        let right = x.to_vec();
        self.solve(plan, x);
        for _ in 0..REFINEMENTS {
            let mut rest = right.clone();
            for (node, rest) in rest.iter_mut().enumerate() {
                plan.blocks[node].subtract(&self.whole, &x[node], rest);
            }
            for (&(row, column), &slot) in &plan.slots {
                plan.blocks[slot as usize].subtract(&self.whole, &x[column as usize], &mut rest[row as usize]);
            }
            self.solve(plan, &mut rest);
            x.iter_mut().zip(&rest).for_each(|(x, rest)| *x += rest);
        }
    }

    /// Solves the linear system of the linkage in place, with the factors of its matrix.
    pub fn solve(&self, plan: &Plan, x: &mut [Vector6<f64>]) {
        for (k, node) in plan.order.iter().enumerate() {
            let pivot = x[*node as usize];
            for (other, [_, below]) in plan.later[k].iter().zip(&plan.beside[k]) {
                plan.blocks[*below as usize].subtract(&self.blocks, &pivot, &mut x[*other as usize]);
            }
        }
        for (k, node) in plan.order.iter().enumerate().rev() {
            let mut rest = x[*node as usize];
            for (other, [right, _]) in plan.later[k].iter().zip(&plan.beside[k]) {
                plan.blocks[*right as usize].subtract(&self.blocks, &x[*other as usize], &mut rest);
            }
            let mut solved = Vector6::zeros();
            plan.blocks[*node as usize].subtract(&self.blocks, &rest, &mut solved);
            x[*node as usize] = -solved;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Tests random matrices with the pattern of a graph: the product with the solution must be the right-hand side.
    /// Joints have a nonzero diagonal, because loops of joints with six equations have more equations than degrees of
    /// freedom.
    #[test]
    fn a_solution_times_the_matrix_is_the_right_hand_side_for_chains_stars_and_loops() {
        let chain = |n: u32| -> Vec<[Option<u32>; 2]> { (0..n).map(|k| [Some(k), k.checked_sub(1)]).collect() };
        let mut ring = chain(5);
        ring.push([Some(0), Some(4)]);
        let star: Vec<[Option<u32>; 2]> = (1..6).map(|k| [Some(k), Some(0)]).collect();
        for (bodies, joints) in [(7, chain(7)), (5, ring), (6, star)] {
            let equations: Vec<usize> = (0..joints.len()).map(|k| [3, 6, 5, 1][k % 4]).collect();
            let plan = Plan::new(bodies, &joints, &equations);
            let mut seed = 1_u64;
            let mut random = || {
                seed = seed.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
                (seed >> 33) as f64 / (1_u64 << 31) as f64 - 0.5
            };
            let mut blocks = Blocks::default();
            blocks.clear(&plan);
            let mut entries = Vec::new();
            let mut put = |blocks: &mut Blocks, i: u32, j: u32, block: Matrix6<f64>| {
                blocks.add(&plan, plan.slot(i, j), &block);
                let size = |node: u32| (node as usize).checked_sub(bodies).map_or(6, |joint| equations[joint]);
                let kept = Matrix6::from_fn(
                    |row, column| {
                        if row < size(i) && column < size(j) { block[(row, column)] } else { 0.0 }
                    },
                );
                entries.push((i, j, kept));
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
            let size = |node: usize| node.checked_sub(bodies).map_or(6, |joint| equations[joint]);
            let right: Vec<Vector6<f64>> = (0..bodies + joints.len())
                .map(|node| Vector6::from_fn(|i, _| if i < size(node) { random() } else { 0.0 }))
                .collect();
            let mut x = right.clone();
            assert!(blocks.factorise(&plan, &vec![Vector6::zeros(); joints.len()], false));
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
        let plan = Plan::new(n as usize, &joints, &vec![3; n as usize]);
        assert!(plan.slots.len() <= 6 * n as usize, "{}", plan.slots.len());
    }
}
