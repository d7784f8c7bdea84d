//! The active face of `K`: the bound, if any, on which each variable rests, and the face of each block.
//!
//! On a face the variational inequality is a square system: `G_k = 0` for variables inside their interval, `z_k = l_k`
//! or `z_k = u_k` for variables on a bound, and [`FaceEquations`](problem::FaceEquations) for a block. The face is the
//! right one while its [`monitors`] are nonnegative.

use super::newton_control::NewtonControl;
use super::system::System;
use problem::{self, ConvexSet, Face, Shape};

/// Position of one variable in its interval, or in the set of its block.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Activity {
    /// The variable is on its lower bound: `z = l`, and `G >= 0`.
    AtLower,
    /// The variable is on its upper bound: `z = u`, and `G <= 0`.
    AtUpper,
    /// The variable is inside its interval: `l <= z <= u`, and `G = 0`.
    Inactive,
    /// The value of the variable is prescribed, and not an unknown of the stage equations.
    Fixed,
    /// The variable is on the boundary of the set of its block, but free to move: on this number of rows of a
    /// polyhedron, or positive in a simplex.
    Boundary(usize),
    /// The variable is at a vertex of the set of its block, or zero in a simplex.
    Vertex,
}

impl Activity {
    /// Returns the number of equations of the active face of `K` that restrict the variable; the largest `usize` if its
    /// value is given.
    pub fn equations(self) -> usize {
        match self {
            Self::AtLower | Self::AtUpper | Self::Fixed | Self::Vertex => usize::MAX,
            Self::Boundary(count) => count,
            Self::Inactive => 0,
        }
    }
}

/// The active face of `K`: for every factor of `K`, an interval or the set of a block, the face on which its variables
/// are.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct ActiveFace {
    /// The activity of each variable: at a bound, inactive, fixed, or its position in its block.
    pub places: Vec<Activity>,
    /// The active face of the set of each block of variables.
    pub blocks: Vec<Face>,
}

impl ActiveFace {
    /// Sets the active face of block `b` of the set `K`, and the activities of its members.
    pub fn set_block(&mut self, set: &ConvexSet, b: usize, face: Face) {
        let block = &set.blocks()[b];
        for (i, &k) in block.members.iter().enumerate() {
            self.places[k] = match (&face, &block.shape) {
                (Face::Interior, _) => Activity::Inactive,
                (Face::Vertex, _) => Activity::Vertex,
                (Face::Boundary(_), _) => Activity::Boundary(1),
                (Face::Edge(zeros), Shape::Simplex) if zeros.contains(&i) => Activity::Vertex,
                (Face::Edge(rows), Shape::Polyhedron(polyhedron)) => {
                    match rows.iter().filter(|&&row| polyhedron.normal(row)[i] != 0.0).count() {
                        0 => Activity::Inactive,
                        count => Activity::Boundary(count),
                    }
                }
                (Face::Edge(_), _) => Activity::Boundary(1),
            };
        }
        self.blocks[b] = face;
    }

    /// Whether, on the face `other`, `variable` is on a row of its polyhedron (one of the linear inequalities that
    /// define it) that is not active on the face `self`.
    pub fn exchanges(&self, other: &Self, set: &ConvexSet, variable: usize) -> bool {
        let Some(b) = set.block_of(variable) else { return false };
        let block = &set.blocks()[b];
        match (&block.shape, &self.blocks[b], &other.blocks[b]) {
            (Shape::Polyhedron(polyhedron), Face::Edge(from), Face::Edge(to)) => {
                let at = block.members.iter().position(|member| *member == variable).unwrap_or(0);
                to.iter().any(|row| !from.contains(row) && polyhedron.normal(*row)[at] != 0.0)
            }
            _ => false,
        }
    }

    /// Whether two active faces of `K` are the same, regardless of the form in which their equations are solved.
    pub fn is_same(&self, other: &Self) -> bool {
        let same = |pair: (&Face, &Face)| match pair {
            (Face::Boundary(_), Face::Boundary(_)) => true,
            (face, other) => face == other,
        };
        self.places == other.places && self.blocks.iter().zip(&other.blocks).all(same)
    }

    /// Whether the members of a block of variables have values prescribed from outside the stage equations.
    pub fn holds(&self, members: &[usize]) -> bool {
        members.first().is_some_and(|&k| self.places[k] == Activity::Fixed)
    }
}

/// Returns the activity of variable `k` whose value `z` solves `VI([l, u], G)`, where `G` has the value `g`.
pub fn place(set: &ConvexSet, k: usize, z: f64, g: f64) -> Activity {
    if z - g <= set.lower[k] {
        Activity::AtLower
    } else if z - g >= set.upper[k] {
        Activity::AtUpper
    } else {
        Activity::Inactive
    }
}

/// A monitor (event function): a quantity that must stay nonnegative while a variable or a block keeps its face of `K`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Monitor {
    /// Value of the monitor: `G` on the lower bound, `-G` on the upper bound, the distance to a bound inside an
    /// interval, or the width of an interval; for a block, a monitor of its face.
    pub value: f64,
    /// Magnitude below which `value` is noise: the tolerance of the VI, or the effect of an error of `y` that Newton's
    /// method accepts.
    pub noise: f64,
}

impl Monitor {
    /// Whether the monitor is negative beyond noise: the variable or block has left its face of `K`.
    pub fn is_violated(&self) -> bool {
        self.value < -self.noise
    }
}

/// Returns, for each variable, whether the variable or its block is at a switch (change of its face of `K`) at `y` to
/// within noise; `system` must have been evaluated at `y` last.
pub fn undecided(system: &mut System<'_>, control: &NewtonControl, y: &[f64]) -> Vec<bool> {
    let mut undecided = vec![false; system.unknowns - system.states];
    for &k in &system.intervals {
        undecided[k] = of_place(system, control, k, y).any(|Monitor { value, noise }| value <= noise);
    }
    for b in 0..system.face.blocks.len() {
        let mut monitors = Vec::new();
        monitors_of_block(system, control, b, y, &mut monitors);
        if monitors.iter().any(|Monitor { value, noise }| value <= noise) {
            system.set.blocks()[b].members.iter().for_each(|&k| undecided[k] = true);
        }
    }
    undecided
}

/// Appends the monitors (event functions) of the face of block `b` at `y` to `out`.
fn monitors_of_block(system: &mut System<'_>, control: &NewtonControl, b: usize, y: &[f64], out: &mut Vec<Monitor>) {
    let noise = control.noise_of_block(system, b, y);
    let equations = system.equations_of(b, y);
    out.extend(equations.monitors.iter().map(|monitor| match *monitor {
        problem::Monitor::Distance(value) => Monitor { value, noise: noise.z },
        problem::Monitor::Multiplier(value) => Monitor { value, noise: noise.g },
    }));
}

/// Returns the monitors (event functions) of variable `k`, which lies in an interval, at `y`, except that of the width
/// of the interval.
fn of_place(system: &System<'_>, control: &NewtonControl, k: usize, y: &[f64]) -> impl Iterator<Item = Monitor> {
    let (z, g) = (y[system.states + k], system.values[system.states + k]);
    let finite = |distance: f64| Some(distance).filter(|distance| distance.is_finite());
    let (values, noise) = match system.face.places[k] {
        Activity::AtLower => ([Some(g), None], control.noise_of_g(system, k, y)),
        Activity::AtUpper => ([Some(-g), None], control.noise_of_g(system, k, y)),
        Activity::Inactive => {
            ([finite(z - system.set.lower[k]), finite(system.set.upper[k] - z)], control.noise_of_z(system, k, y))
        }
        Activity::Fixed | Activity::Boundary(_) | Activity::Vertex => ([None; 2], 0.0),
    };
    values.into_iter().flatten().map(move |value| Monitor { value, noise })
}

/// Writes the monitors (event functions) of the active face of `K` at `y`, where `system` was evaluated last, to `out`,
/// in an order that depends on the face alone.
pub fn monitors(system: &mut System<'_>, control: &NewtonControl, y: &[f64], out: &mut Vec<Monitor>) {
    out.clear();
    for &k in &system.intervals {
        out.extend(of_place(system, control, k, y));
        let width = system.set.upper[k] - system.set.lower[k];
        if width.is_finite() && matches!(system.face.places[k], Activity::AtLower | Activity::AtUpper) {
            out.push(Monitor { value: width, noise: control.noise_of_width(system, k, y) });
        }
    }
    for b in 0..system.face.blocks.len() {
        monitors_of_block(system, control, b, y, out);
    }
}
