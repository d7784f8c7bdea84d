//! The contact set of an obstacle problem: where the solution `u` touches an obstacle, and the contact force.
//!
//! Near the contact set, the gap `g = u - phi` of an exact solution to the obstacle `phi` grows as the square of the
//! distance from the free boundary. The nodal gaps have an additional linear term: at `m` nodes beyond the last node
//! `c` in contact, whose pressure is reduced, `g_m = kappa h^2 (m (m - 1) / 2 + theta m)` with the grid spacing `h`
//! and `0 <= theta <= 1`. The slope of the gap is linear in position and vanishes at `c + (1/2 - theta) h`, the
//! position of the free boundary between nodes.

use super::Semidiscrete;
use crate::finite_elements::Axis;

/// The contact set of an obstacle problem at one time: where the solution `u` touches an obstacle.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Contact {
    /// The length, area or volume of the contact set.
    pub measure: f64,
    /// The smallest coordinate `x` in the contact set; the upper end of the domain if the set is empty.
    pub from: f64,
    /// The largest `x` in the contact set; the lower end of the domain if the set is empty.
    pub to: f64,
    /// The total force of the obstacles on the solution, upwards.
    pub pressure: f64,
    /// The number of grid nodes in the contact set.
    pub nodes: usize,
}

impl Contact {
    /// Measures the contact set of nodal values `u`, with the bounds of `K` that the system has evaluated last; `force`
    /// is the contact force on each grid node.
    pub fn of(system: &Semidiscrete, u: &[f64], force: &[f64]) -> Self {
        let axes = system.problem.grid.axes();
        let (along, across) = (axes[0], &axes[1..]);
        let mut contact = Self { from: along.upper, to: along.lower, ..Self::default() };
        let mut line = Line { axis: along, gaps: vec![0.0; along.nodes()], touches: vec![false; along.nodes()] };
        for (k, first) in (0..u.len()).step_by(along.nodes()).enumerate() {
            let touching = line.read(system, u, first);
            if touching == 0 {
                continue;
            }
            contact.nodes += touching;
            let nodes = first..first + along.nodes();
            contact.pressure +=
                nodes.zip(&line.touches).filter(|(_, touches)| **touches).map(|(i, _)| force[i]).sum::<f64>();
            let width = width(across, k);
            line.runs(|from, to| {
                contact.measure += width * (to - from);
                contact.from = contact.from.min(from);
                contact.to = contact.to.max(to);
            });
        }
        contact
    }
}

/// Returns the length or area across the `x` direction that the `k`-th grid line along `x` represents.
fn width(across: &[Axis], mut k: usize) -> f64 {
    let mut width = 1.0;
    for axis in across {
        let is_end = [0, axis.elements].contains(&(k % axis.nodes()));
        width *= if is_end { 0.5 } else { 1.0 } * axis.spacing();
        k /= axis.nodes();
    }
    width
}

/// A grid line along `x`, with the contact states of its nodes.
struct Line {
    axis: Axis,
    /// For each node of the grid line, the distance of its value from the nearer obstacle.
    gaps: Vec<f64>,
    touches: Vec<bool>,
}

impl Line {
    /// Reads the grid line that begins at node `first`; returns the number of its nodes in contact with an obstacle.
    fn read(&mut self, system: &Semidiscrete, u: &[f64], first: usize) -> usize {
        let n = self.gaps.len();
        for (i, (gap, touches)) in self.gaps.iter_mut().zip(&mut self.touches).enumerate() {
            let node = first + i;
            let (lower, upper) = (system.set.lower[node], system.set.upper[node]);
            *gap = (u[node] - lower).min(upper - u[node]);
            *touches = *gap == 0.0 && !system.is_given[node];
        }
        let touching = self.touches.iter().filter(|touches| **touches).count();
        // Nodes with Dirichlet values are not in contact. At the end of a grid line, such a node extends an adjacent
        // contact interval.
        for (end, next) in [(0, 1), (n - 1, n - 2)] {
            self.touches[end] |= system.is_given[first + end] && self.touches[next];
        }
        touching
    }

    /// Calls `visit` with both end coordinates of each contact interval of the grid line.
    fn runs(&self, mut visit: impl FnMut(f64, f64)) {
        let n = self.touches.len();
        let mut start = 0;
        while let Some(from) = (start..n).find(|&i| self.touches[i]) {
            let to = (from..n).find(|&i| !self.touches[i]).unwrap_or(n) - 1;
            let h = self.axis.spacing();
            let before = if from == 0 { 0.0 } else { self.beyond(|m| from.checked_sub(m)) };
            let after = if to == n - 1 { 0.0 } else { self.beyond(|m| Some(to + m).filter(|&i| i < n)) };
            visit(self.axis.node(from) - h * before, self.axis.node(to) + h * after);
            start = to + 1;
        }
    }

    /// Returns `1/2 - theta`, the distance of the free boundary from the last node in contact, in units of the grid
    /// spacing `h`; `at(m)` is the `m`-th node beyond the last node in contact.
    fn beyond(&self, at: impl Fn(usize) -> Option<usize>) -> f64 {
        let gap = |m| at(m).filter(|&i| !self.touches[i]).map(|i| self.gaps[i]);
        let (Some(first), Some(second)) = (gap(1), gap(2)) else { return 0.0 };
        let curvature = second - 2.0 * first;
        if curvature > 0.0 { (0.5 - first / curvature).max(-0.5) } else { 0.0 }
    }
}
