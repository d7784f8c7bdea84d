//! The convex set `K`, a product of intervals `[l_i, u_i]`, possibly unbounded, and of blocks that couple several
//! components of `z`. Components in blocks have `l = -inf`, `u = inf`.
//!
//! `P_K` denotes the projection onto `K`, and `z - P_K(z - G)` the natural map, which is zero exactly at a solution
//! of the variational inequality (Facchinei and Pang 2003, section 1.5).

mod active_rows;
mod ball;
mod block;
mod derivative;
mod enclosure;
mod face;
mod polyhedron;
mod second_order_cone;
mod simplex;
#[cfg(test)]
mod tests;

pub use block::{Block, BlockWorkspace, Shape};
pub use derivative::Derivative;
pub use enclosure::{FlatMonitor, MonitorRange};
pub use face::{Face, FaceEquations, Monitor};
pub use polyhedron::Polyhedron;

/// The convex set `K = [l_1, u_1] x .. x [l_m, u_m]` with `-inf <= l_i <= u_i <= inf`, where a block (a convex set that
/// couples several components) replaces the intervals of its members.
#[derive(Clone, Debug, PartialEq)]
pub struct ConvexSet {
    /// The lower ends `l` of the `m` intervals of `K`.
    pub lower: Vec<f64>,
    /// The upper ends `u` of the `m` intervals of `K`.
    pub upper: Vec<f64>,
    blocks: Vec<Block>,
    /// For each component, the index of the block that contains it; empty if `K` has no blocks.
    home: Vec<Option<usize>>,
}

/// Workspace for projections onto `K`; it grows to the size of the largest block that has used it.
#[derive(Clone, Debug, Default)]
pub struct Workspace {
    x: Vec<f64>,
    p: Vec<f64>,
    block: BlockWorkspace,
}

impl ConvexSet {
    /// Returns the unconstrained set `K`, the whole space of `m` dimensions.
    pub fn free(m: usize) -> Self {
        Self::intervals(vec![f64::NEG_INFINITY; m], vec![f64::INFINITY; m])
    }

    /// Returns the nonnegative orthant of `m` dimensions as the set `K`.
    pub fn nonnegative(m: usize) -> Self {
        Self::intervals(vec![0.0; m], vec![f64::INFINITY; m])
    }

    /// Returns the set `K` that is the product of `m` intervals with the given ends.
    pub fn intervals(lower: Vec<f64>, upper: Vec<f64>) -> Self {
        Self { lower, upper, blocks: Vec::new(), home: Vec::new() }
    }

    /// Adds to `K` a block of the components `members`, replacing their intervals; the components must not be in
    /// another block.
    pub fn bind(&mut self, members: Vec<usize>, shape: Shape) {
        self.home.resize(self.dimension(), None);
        for &i in &members {
            (self.lower[i], self.upper[i]) = (f64::NEG_INFINITY, f64::INFINITY);
            self.home[i] = Some(self.blocks.len());
        }
        self.blocks.push(Block { members, shape });
    }

    /// Returns the blocks of `K`, in the order in which they were added.
    pub fn blocks(&self) -> &[Block] {
        &self.blocks
    }

    /// Returns whether `K` has blocks, so that it is not a product of intervals.
    pub fn has_blocks(&self) -> bool {
        !self.blocks.is_empty()
    }

    /// Returns the index of the block of `K` that contains component `i`, if any.
    pub fn block_of(&self, i: usize) -> Option<usize> {
        self.home.get(i).copied().flatten()
    }

    /// Sets the radius of a block that is a ball; has no effect on blocks of other shapes.
    pub fn set_radius(&mut self, block: usize, value: f64) {
        if let Shape::Ball { radius } = &mut self.blocks[block].shape {
            *radius = value;
        }
    }

    /// Returns the Cartesian product of `copies` copies of `K`.
    pub fn power(&self, copies: usize) -> Self {
        let mut power = Self::intervals(self.lower.repeat(copies), self.upper.repeat(copies));
        for copy in 0..copies {
            for Block { members, shape } in &self.blocks {
                power.bind(members.iter().map(|i| copy * self.dimension() + i).collect(), shape.clone());
            }
        }
        power
    }

    /// Returns the factor of `K` for the components `kept`, in their order; the members of a block must all be kept or
    /// all be left out.
    pub fn restricted(&self, kept: &[usize]) -> Self {
        let end = |ends: &[f64]| kept.iter().map(|&i| ends[i]).collect();
        let mut factor = Self::intervals(end(&self.lower), end(&self.upper));
        for Block { members, shape } in &self.blocks {
            let places: Vec<usize> = members.iter().filter_map(|i| kept.iter().position(|k| k == i)).collect();
            if places.len() == members.len() {
                factor.bind(places, shape.clone());
            }
        }
        factor
    }

    /// Returns the dimension `m` of the space of `K`.
    pub fn dimension(&self) -> usize {
        self.lower.len()
    }

    /// Returns whether component `i` is unconstrained in `K`.
    pub fn is_free(&self, i: usize) -> bool {
        self.lower[i] == f64::NEG_INFINITY && self.upper[i] == f64::INFINITY && self.block_of(i).is_none()
    }

    /// Returns whether `K` is nonempty; false if an end of one of its intervals is NaN.
    pub fn is_nonempty(&self) -> bool {
        let nonempty =
            |(&lower, &upper): (&f64, &f64)| lower <= upper && lower < f64::INFINITY && upper > -f64::INFINITY;
        self.lower.iter().zip(&self.upper).all(nonempty)
            && self.blocks.iter().all(|block| block.shape.is_nonempty(block.members.len()))
    }

    /// Returns the projection of `z` onto the interval of `K` of component `i`, which must not be in a block. NaN is
    /// returned as NaN.
    pub fn project(&self, i: usize, z: f64) -> f64 {
        if z < self.lower[i] {
            self.lower[i]
        } else if z > self.upper[i] {
            self.upper[i]
        } else {
            z
        }
    }

    /// Projects the vector `z` onto `K` in place; allocates only in the first call with a given `work`. NaN in a
    /// component of a block makes the block's components NaN, and affects no others.
    pub fn project_all(&self, z: &mut [f64], work: &mut Workspace) {
        for (i, z) in z.iter_mut().enumerate() {
            *z = self.project(i, *z);
        }
        for block in &self.blocks {
            work.gather(block, z);
            let Workspace { x, p, block: inner } = work;
            block.shape.project(x, p, inner);
            block.scatter(p, z);
        }
    }

    /// Returns the Euclidean distance of `z` from `K`.
    pub fn distance(&self, z: &[f64], work: &mut Workspace) -> f64 {
        let mut p = z.to_vec();
        self.project_all(&mut p, work);
        p.iter_mut().zip(z).for_each(|(p, z)| *p -= z);
        ball::norm(&p)
    }

    /// Returns the support function `sup <d, z>` of `K`; infinite if `K` is unbounded in direction `d`.
    pub fn support(&self, d: &[f64], work: &mut Workspace) -> f64 {
        let interval = |i: usize| match d[i] {
            0.0 => 0.0,
            d if d > 0.0 => d * self.upper[i],
            d => d * self.lower[i],
        };
        let mut sum: f64 = (0..d.len()).filter(|&i| self.block_of(i).is_none()).map(interval).sum();
        for block in &self.blocks {
            work.gather(block, d);
            sum += block.shape.support(&work.x, &mut work.block);
        }
        sum
    }

    /// Returns whether `d` is in the recession cone of `K`: whether `z + s d` stays in `K` for all `s >= 0`.
    pub fn recedes(&self, d: &[f64], work: &mut Workspace) -> bool {
        let interval = |i: usize| {
            self.block_of(i).is_some()
                || d[i] == 0.0
                || if d[i] > 0.0 { self.upper[i] == f64::INFINITY } else { self.lower[i] == f64::NEG_INFINITY }
        };
        (0..d.len()).all(interval)
            && self.blocks.iter().all(|block| {
                work.gather(block, d);
                block.shape.recedes(&work.x)
            })
    }

    /// Returns whether `K` is bounded.
    pub fn is_bounded(&self, work: &mut Workspace) -> bool {
        let finite = |i: usize| self.block_of(i).is_some() || (self.lower[i].is_finite() && self.upper[i].is_finite());
        (0..self.dimension()).all(finite) && self.blocks.iter().all(|block| block.shape.is_bounded(&mut work.block))
    }

    /// Returns the face of a block of `K` that contains the projection of the block's components of `z`.
    pub fn face(&self, block: usize, z: &[f64], work: &mut Workspace) -> Face {
        let block = &self.blocks[block];
        work.gather(block, z);
        let Workspace { x, p, block: inner } = work;
        block.shape.face(x, p, inner)
    }

    /// Returns the residual `max |z - P(z - scale G)|` of the natural map over the members of one block of `K`, with
    /// the projection `P` onto the block.
    pub fn defect(&self, block: usize, z: &[f64], g: &[f64], scale: f64, work: &mut Workspace) -> f64 {
        let Block { members, shape } = &self.blocks[block];
        work.x.clear();
        work.x.extend(members.iter().map(|&i| z[i] - scale * g[i]));
        work.p.resize(members.len(), 0.0);
        shape.project(&work.x, &mut work.p, &mut work.block);
        members.iter().zip(&work.p).fold(0.0, |worst, (&i, p)| {
            let r = (z[i] - p).abs();
            if r > worst || r.is_nan() { r } else { worst }
        })
    }

    /// Returns the natural-map residual `max_i |z_i - P_K(z - G)_i|`; NaN if any entry is NaN. Allocates if `K` has
    /// blocks.
    pub fn natural_residual(&self, z: &[f64], g: &[f64]) -> f64 {
        let mut residual = 0.0_f64;
        let mut keep = |r: f64| residual = if r.is_nan() || residual.is_nan() { f64::NAN } else { residual.max(r) };
        for (i, (&z, &g)) in z.iter().zip(g).enumerate().filter(|&(i, _)| self.block_of(i).is_none()) {
            keep((z - self.project(i, z - g)).abs());
        }
        let mut work = Workspace::default();
        (0..self.blocks.len()).for_each(|block| keep(self.defect(block, z, g, 1.0, &mut work)));
        residual
    }
}

impl Workspace {
    fn gather(&mut self, block: &Block, z: &[f64]) {
        self.x.clear();
        self.x.extend(block.members.iter().map(|&i| z[i]));
        self.p.resize(self.x.len(), 0.0);
    }
}

impl Block {
    fn scatter(&self, p: &[f64], z: &mut [f64]) {
        for (&i, p) in self.members.iter().zip(p) {
            z[i] = *p;
        }
    }
}
