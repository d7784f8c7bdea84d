//! The variables that the inequality itself determines at given states. The rows of `G` that contain variables form the
//! nonlinear variational inequality
//!
//! ```text
//! z in K(t,x),    <G(t,x,z), z~ - z> >= 0  for all z~ in K(t,x)
//! ```
//!
//! at fixed `(t, x)`, solved by the Josephy-Newton method with a line search: at a start `z` is unknown, and if `G` is
//! far from affine in `z`, as `exp(z)` is, full steps from zero fail.
//!
//! The inequality is solved in parts, each of variables that depend on each other, in an order in which each part
//! depends on earlier parts alone: if `K` is a product, the parts together are equivalent to the inequality. A
//! product of variables of two parts, such as the position of a switch and the voltage across it, is linear in each
//! of them.

use crate::layout::Storage;
use crate::system::System;
use nalgebra::DMatrix;
use numerics::components;
use problem::ConvexSet;
use vi::{JosephyNewton, NonlinearVi, SolverKind};

/// The variational inequality for the variables at a fixed time and fixed states.
struct AtStates<'a, 'p> {
    system: &'a mut System<'p>,
    t: f64,
    y: Vec<f64>,
    /// The variables that the inequality is solved for.
    members: Vec<usize>,
    /// The set `K` restricted to the variables that the inequality is solved for.
    set: ConvexSet,
}

/// Solves the inequality for the variables in `y` at time `t`, starting from their values in `y`, if `G` is nonlinear
/// and the system is small. The result is the best approximation found; a part of the variables whose residual is not
/// reduced keeps its values.
pub fn solve(system: &mut System<'_>, t: f64, y: &mut [f64]) {
    if system.constant_jacobian() || matches!(system.layout.storage, Storage::Sparse { .. }) {
        return;
    }
    let members = determined(system);
    for part in parts(system, &members) {
        solve_part(system, t, y, part);
    }
}

/// Solves the inequality for the variables `members`, at the values of the other variables in `y`.
fn solve_part(system: &mut System<'_>, t: f64, y: &mut [f64], members: Vec<usize>) {
    if !system.evaluate(t, y) {
        return;
    }
    let n = system.states;
    let set = system.set.restricted(&members);
    let outside = system.outside;
    let mut z: Vec<f64> = members.iter().map(|&k| y[n + k]).collect();
    let start: Vec<f64> = members.iter().map(|&k| system.values[n + k]).collect();
    let before = set.natural_residual(&z, &start);
    let mut vi = AtStates { system, t, y: y.to_vec(), members, set };
    let report = JosephyNewton::new(z.len(), SolverKind::Auto).solve(&mut vi, 0.0, &mut z, outside);
    if report.residual < before {
        for (&k, z) in vi.members.iter().zip(z) {
            y[n + k] = z;
        }
    }
}

/// Returns the variables whose rows of `G` contain variables; of a block, all members or none.
fn determined(system: &System<'_>) -> Vec<usize> {
    let n = system.states;
    let is_direct = |k: usize| system.entries_of_variable(k).any(|(j, _)| j >= n);
    let is_taken = |k: usize| match system.set.block_of(k) {
        Some(block) => system.set.blocks()[block].members.iter().all(|&member| is_direct(member)),
        None => is_direct(k),
    };
    (0..system.unknowns - n).filter(|&k| is_taken(k)).collect()
}

/// Returns the strongly connected components of the dependences between the variables `members`, each component after
/// those that it depends on; the members of a block depend on each other.
fn parts(system: &System<'_>, members: &[usize]) -> Vec<Vec<usize>> {
    let n = system.states;
    let place_of = |k: usize| members.binary_search(&k).ok();
    let depends = members.iter().map(|&k| {
        let on = system.entries_of_variable(k).filter_map(|(j, _)| j.checked_sub(n));
        let block = system.set.block_of(k).map(|block| &*system.set.blocks()[block].members);
        on.chain(block.into_iter().flatten().copied()).filter_map(place_of).collect()
    });
    let depends: Vec<Vec<usize>> = depends.collect();
    let components = components(&depends);
    components.into_iter().map(|part| part.into_iter().map(|place| members[place]).collect()).collect()
}

impl AtStates<'_, '_> {
    fn place(&mut self, z: &[f64]) {
        let n = self.system.states;
        for (&k, z) in self.members.iter().zip(z) {
            self.y[n + k] = *z;
        }
    }
}

impl NonlinearVi for AtStates<'_, '_> {
    fn set(&self) -> &ConvexSet {
        &self.set
    }

    fn evaluate(&mut self, z: &[f64], f: &mut [f64]) {
        self.place(z);
        self.system.evaluate(self.t, &self.y);
        for (f, &k) in f.iter_mut().zip(&self.members) {
            *f = self.system.values[self.system.states + k];
        }
    }

    fn jacobian(&mut self, z: &[f64], derivative: &mut DMatrix<f64>) {
        self.place(z);
        self.system.differentiate(self.t, &self.y);
        let n = self.system.states;
        derivative.fill(0.0);
        for (row, &k) in self.members.iter().enumerate() {
            for (j, value) in self.system.entries_of_variable(k).filter(|(j, _)| *j >= n) {
                if let Ok(column) = self.members.binary_search(&(j - n)) {
                    derivative[(row, column)] += value;
                }
            }
        }
    }
}
