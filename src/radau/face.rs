//! The active face of `K`: which bound, if any, each variable rests on.
//!
//! On a face the variational inequality is the square system `G_k = 0` for variables inside their interval and
//! `z_k = l_k` or `z_k = u_k` for those on a bound. The face is the right one while its [`monitors`] are not negative.
//! What a block asks for on its boundary is no such system: there the variational inequality itself is solved.

use super::stages::NewtonControl;
use super::system::System;
use crate::problem::{ConvexSet, Face, Shape, Workspace};

/// Where one variable stands in its interval.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Place {
    /// `z = l`, and `G >= 0`.
    Lower,
    /// `z = u`, and `G <= 0`.
    Upper,
    /// `l <= z <= u`, and `G = 0`.
    Inside,
    /// `z` is given from outside the stage equations.
    Held,
    /// On the boundary of a block, where it may still move; positive, in a simplex.
    Boundary,
    /// At a vertex of a block, or zero in a simplex.
    Vertex,
}

impl Place {
    /// How free the variable is: 0 where it is given, 1 on a boundary, 2 inside.
    pub fn freedom(self) -> u8 {
        match self {
            Self::Lower | Self::Upper | Self::Held | Self::Vertex => 0,
            Self::Boundary => 1,
            Self::Inside => 2,
        }
    }
}

/// The place of a variable of which `z` solves `VI([l, u], G)` with value `g`.
pub fn place(set: &ConvexSet, k: usize, z: f64, g: f64) -> Place {
    if z - g <= set.lower[k] {
        Place::Lower
    } else if z - g >= set.upper[k] {
        Place::Upper
    } else {
        Place::Inside
    }
}

/// Writes the places of the members of blocks, of which `z` solves the VI with `x = z - g`.
pub fn place_on_blocks(set: &ConvexSet, x: &[f64], face: &mut [Place], workspace: &mut Workspace) {
    for (b, block) in set.blocks().iter().enumerate() {
        let (all, zeros): (Place, &[usize]) = match set.face(b, x, workspace) {
            Face::Interior => (Place::Inside, &[]),
            Face::Vertex => (Place::Vertex, &[]),
            Face::Edge(zeros) if block.shape == Shape::Simplex => (Place::Boundary, zeros),
            Face::Boundary | Face::Edge(_) => (Place::Boundary, &[]),
        };
        block.members.iter().for_each(|&k| face[k] = all);
        zeros.iter().for_each(|&j| face[block.members[j]] = Place::Vertex);
    }
}

/// What must not become negative for a variable to stay in its place.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Monitor {
    /// `G` on the lower bound, `-G` on the upper, the distance to a bound inside; the width of an interval.
    pub value: f64,
    /// The size below which `value` is noise: the tolerance of the VI, or what an error of `y` that Newton's method
    /// lets pass makes of it.
    pub noise: f64,
}

impl Monitor {
    /// Whether the variable has left its place.
    pub fn is_violated(&self) -> bool {
        self.value < -self.noise
    }
}

/// The monitors of bounded variable `k` at `y`, where `system` was evaluated last: on a bound that
/// of `G` and the width of the interval, inside the distances to its ends.
pub fn monitors(system: &System<'_>, control: &NewtonControl, k: usize, y: &[f64]) -> [Option<Monitor>; 2] {
    let z = y[system.states + k];
    let g = system.values[system.states + k];
    let on_bound = |value| Some(Monitor { value, noise: control.noise_of_g(system, k, y) });
    let inside = |distance: f64| {
        let weight = control.weight[system.states + k];
        let passed = if weight > 0.0 { control.kappa / weight } else { 0.0 };
        distance.is_finite().then(|| Monitor {
            value: distance,
            noise: (control.vi_tolerance * z.abs().max(control.size[system.states + k])).max(passed),
        })
    };
    let width = || {
        let value = system.set.upper[k] - system.set.lower[k];
        value.is_finite().then(|| Monitor { value, noise: control.noise_of_width(system, k, y) })
    };
    match system.face[k] {
        Place::Lower => [on_bound(g), width()],
        Place::Upper => [on_bound(-g), width()],
        Place::Inside => [inside(z - system.set.lower[k]), inside(system.set.upper[k] - z)],
        Place::Held | Place::Boundary | Place::Vertex => [None, None],
    }
}
