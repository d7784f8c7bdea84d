//! The equations of the blocks of `K` on their faces, as rows of a [`System`]. A block is a factor of `K` that
//! couples several variables, such as a second-order cone or a ball.

use super::face::Activity;
use super::newton_control::NewtonControl;
use super::system::System;
use problem::{Face, FaceEquations, Shape};

impl System<'_> {
    /// Evaluates the equations of the active face of the set of block `b` at the unknowns `y`, the point of the last
    /// evaluation of the system.
    pub fn equations_of(&mut self, b: usize, y: &[f64]) -> &FaceEquations {
        let block = &self.set.blocks()[b];
        let (z, g) = &mut self.members;
        z.clear();
        z.extend(block.members.iter().map(|&k| y[self.states + k]));
        g.clear();
        g.extend(block.members.iter().map(|&k| self.values[self.states + k]));
        self.equations[b].set(&block.shape, &self.face.blocks[b], z, g);
        &self.equations[b]
    }

    /// Returns the equations of the active faces of the sets of all blocks at `y`, the point of the last evaluation of
    /// the system, each in its primal form, which is solved for `z`.
    pub fn equations_for_z(&mut self, y: &[f64]) -> Vec<FaceEquations> {
        let mut all = Vec::with_capacity(self.face.blocks.len());
        for b in 0..self.face.blocks.len() {
            self.equations_of(b, y);
            let (z, g) = &mut self.members;
            let shape = &self.set.blocks()[b].shape;
            if let (Shape::SecondOrderCone, Face::Boundary(_)) = (shape, &self.face.blocks[b]) {
                // Put `z` exactly onto the boundary of the cone, which has no curvature along its rays.
                z[0] = z[1..].iter().map(|v| v * v).sum::<f64>().sqrt();
            }
            let mut equations = FaceEquations::default();
            equations.set(shape, &for_z(shape, &self.face.blocks[b]), z, g);
            all.push(equations);
        }
        all
    }

    /// Swaps the form of the equations of each second-order cone on whose boundary the variables are, between the
    /// primal form (solved for `z`) and the dual form (solved for `G`); returns whether there is such a cone.
    pub fn swap_primal_dual_form(&mut self) -> bool {
        let mut turned = false;
        for (block, face) in self.set.blocks().iter().zip(&mut self.face.blocks) {
            if let (Shape::SecondOrderCone, Face::Boundary(form)) = (&block.shape, face) {
                *form = 1 - *form;
                turned = true;
            }
        }
        turned
    }

    /// Linearises the equations of the active faces of the sets of all blocks at `y`, the point of the last evaluation
    /// of the system. A block whose `G` is below the noise level of `control` is linearised with `G = 0`.
    pub fn linearise_blocks(&mut self, y: &[f64], control: Option<&NewtonControl>) {
        for b in 0..self.face.blocks.len() {
            self.equations_of(b, y);
            if let Some(control) = control {
                let noise = control.noise_of_block(self, b, y).g;
                let (z, g) = &mut self.members;
                if g.iter().all(|g| g.abs() <= noise) {
                    g.fill(0.0);
                    let shape = &self.set.blocks()[b].shape;
                    self.equations[b].set(shape, &for_z(shape, &self.face.blocks[b]), z, g);
                }
            }
            std::mem::swap(&mut self.equations[b], &mut self.linearised[b]);
        }
    }

    /// Changes, for each ball on whose boundary the solution lies, the member (the pivot) for which the equation of
    /// the sphere is solved, if the value of the present pivot at `y` is less than half of that of the largest
    /// member; returns whether a pivot changed.
    pub fn repivot_spheres(&mut self, y: &[f64]) -> bool {
        let mut turned = false;
        for (block, face) in self.set.blocks().iter().zip(&mut self.face.blocks) {
            if let (Shape::Ball { .. }, Face::Boundary(pivot)) = (&block.shape, face) {
                let size = |i: &usize| y[self.states + block.members[*i]].abs();
                let largest = (0..block.members.len()).max_by(|i, j| size(i).total_cmp(&size(j))).unwrap_or(0);
                if size(pivot) < 0.5 * size(&largest) {
                    *pivot = largest;
                    turned = true;
                }
            }
        }
        turned
    }

    /// Linearises the equations of the active faces of all blocks, which must be flat (linear): their linearisation is
    /// the same at every point.
    pub fn linearise_flat_blocks(&mut self) {
        let anywhere = vec![0.0; self.unknowns];
        self.linearise_blocks(&anywhere, None);
    }

    /// Whether the active face of `K` has an equation for variable `k` other than that of an active bound or a
    /// prescribed value.
    pub fn has_equation(&self, k: usize) -> bool {
        match self.face.places[k] {
            Activity::Inactive => true,
            Activity::Fixed => false,
            _ => self.set.block_of(k).is_some(),
        }
    }

    /// Whether the equation of variable `k` on the active face of `K` involves `z` alone, and not `G`, as of the last
    /// linearisation of its block.
    pub fn is_constraint(&self, k: usize) -> bool {
        self.place_in_block(k).is_some_and(|(b, at)| self.linearised[b].is_of_z[at])
    }

    /// Returns the rows of `G` in the equation of the active face of `K` for variable `k`, as pairs of a variable and
    /// its factor by the last linearisation of its block; none if the equation involves `z` alone.
    pub fn rows_of_equation(&self, k: usize) -> impl Iterator<Item = (usize, f64)> {
        let own = self.place_in_block(k).is_none().then_some((k, 1.0));
        let of_block = self.place_in_block(k).into_iter().flat_map(|(b, at)| {
            let factors = self.linearised[b].combination_of(at).iter().copied();
            self.set.blocks()[b].members.iter().copied().zip(factors).filter(|(_, factor)| *factor != 0.0)
        });
        own.into_iter().chain(of_block)
    }

    /// Returns the block (factor of `K` that couples variables) of variable `k`, and the index of the variable among
    /// the members of the block.
    fn place_in_block(&self, k: usize) -> Option<(usize, usize)> {
        let b = self.set.block_of(k)?;
        let at = self.set.blocks()[b].members.iter().position(|member| *member == k)?;
        Some((b, at))
    }

    /// Replaces the partial derivatives `drift` of `G` with respect to time by those of the equations of the active
    /// face of `K` (the rows of `Phi`), in place; the derivatives of equations in `z` alone are unknown and set to
    /// zero.
    pub fn combine_drift(&mut self, drift: &mut [f64]) {
        let (_, g) = &mut self.members;
        for (block, equations) in self.set.blocks().iter().zip(&self.linearised) {
            g.clear();
            g.extend(block.members.iter().map(|&k| drift[k]));
            for (i, &k) in block.members.iter().enumerate() {
                drift[k] = equations.combination_of(i).iter().zip(g.iter()).map(|(r, g)| r * g).sum();
            }
        }
    }
}

/// Returns the active face of the set of a block of variables; for the boundary of a second-order cone, with its
/// equations in the primal form, which is solved for `z` (the dual form is solved for `G`).
fn for_z(shape: &Shape, face: &Face) -> Face {
    match (shape, face) {
        (Shape::SecondOrderCone, Face::Boundary(_)) => Face::Boundary(0),
        _ => face.clone(),
    }
}
