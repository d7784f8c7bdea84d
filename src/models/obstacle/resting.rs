//! Proof that nodes in contact at the beginning, the stage and the end of a TR-BDF2 step stay in contact in between.
//!
//! A node stays in contact while the contact force, the force from its neighbours less the load `f`, is not adhesive.
//! The force from the neighbours is known at the three times and interpolated by a parabola; `f` is enclosed over
//! subintervals of the step, in interval arithmetic. Subintervals in which the contact force may be adhesive are
//! bisected, the worst first, until the displacement of the nodes caused by all of them is negligible: contact is
//! then proven. If the limit on subintervals is reached, the remaining displacement is added to the error of the
//! step.

use super::load::load_over;
use super::{ObstacleError, Semidiscrete};
use numerics::Interval;
use problem::Control;

/// Maximum number of bisections of a step in the proof that nodes stay in contact with an obstacle.
const PARTS: usize = 64;

/// Rounding error of the forces on a node (load, and force from its neighbours), relative to the magnitude of their
/// terms.
const ROUNDING: f64 = 16.0 * f64::EPSILON;

/// Contact states and contact forces of all nodes at one time of a step.
#[derive(Clone, Default)]
pub struct Moment {
    /// The contact state of each node: 1 on the lower obstacle, -1 on the upper obstacle, 0 free.
    pub held: Vec<i8>,
    /// The contact force of the obstacles on each node, upwards.
    pub force: Vec<f64>,
    /// The displacement of each node that its contact force causes, with neighbouring nodes fixed.
    pub kept: Vec<f64>,
    /// The load vector `f` at the nodes of the grid.
    pub load: Vec<f64>,
}

impl Moment {
    /// Allocates contact states, contact forces, displacements and loads for the given number of nodes.
    pub fn new(nodes: usize) -> Self {
        Self { held: vec![0; nodes], force: vec![0.0; nodes], kept: vec![0.0; nodes], load: vec![0.0; nodes] }
    }

    /// Returns the force on a node from its neighbours, which is the sum of its contact force and load.
    fn push(&self, node: usize) -> f64 {
        self.force[node] + self.load[node]
    }
}

/// A subinterval of a step in which contact forces may be adhesive, so that nodes may leave the obstacle.
struct Part {
    from: f64,
    to: f64,
    /// The nodes whose contact force may be adhesive in the subinterval, with bounds on their displacements.
    moved: Vec<(usize, f64)>,
    /// The root mean square over the domain of the bounds on the nodes' displacements.
    size: f64,
}

/// Workspace of the proof that nodes stay in contact with an obstacle within a step.
pub struct Resting {
    wanted: Vec<bool>,
    load: Vec<Interval>,
}

impl Resting {
    /// Allocates the workspace of the proof of contact for the given number of nodes.
    pub fn new(nodes: usize) -> Self {
        Self { wanted: vec![false; nodes], load: vec![Interval::point(0.0); nodes] }
    }

    /// Adds to `moved` bounds on the displacement, between the beginning, the stage and the end of a step, of nodes
    /// in contact at all three times. Adds nothing if the root mean square of the bounds is below `negligible`.
    ///
    /// # Errors
    /// If `control` asks to stop.
    pub fn bound(
        &mut self,
        system: &mut Semidiscrete,
        (times, moments): ([f64; 3], &[Moment; 3]),
        negligible: f64,
        moved: &mut [f64],
        control: &Control,
    ) -> Result<(), ObstacleError> {
        if !system.load_varies() {
            return Ok(());
        }
        let [first, second, third] = moments;
        let rests = |&i: &usize| {
            let held = first.held[i];
            held != 0 && held == second.held[i] && held == third.held[i] && !system.is_given[i]
        };
        let resting: Vec<usize> = (0..moved.len()).filter(rests).collect();
        if resting.is_empty() {
            return Ok(());
        }
        let mut parts = Vec::new();
        for (from, to) in [(times[0], times[1]), (times[1], times[2])] {
            parts.extend(self.part(system, (times, moments), (from, to), resting.iter().copied(), control)?);
        }
        for _ in 0..PARTS {
            let all: f64 = parts.iter().map(|part| part.size).sum();
            let worst = (0..parts.len()).max_by(|&i, &j| parts[i].size.total_cmp(&parts[j].size));
            let Some(worst) = worst.filter(|_| all > negligible) else { return Ok(()) };
            let middle = 0.5 * (parts[worst].from + parts[worst].to);
            if middle <= parts[worst].from || middle >= parts[worst].to {
                break;
            }
            let Part { from, to, moved, .. } = parts.swap_remove(worst);
            for half in [(from, middle), (middle, to)] {
                let nodes = moved.iter().map(|(node, _)| *node);
                parts.extend(self.part(system, (times, moments), half, nodes, control)?);
            }
        }
        for (node, by) in parts.iter().flat_map(|part| &part.moved) {
            moved[*node] += by;
        }
        Ok(())
    }

    /// Bounds the displacement, in a subinterval of a step, of nodes in contact at the beginning, the stage and the end
    /// of the step; `None` if contact is proven in the subinterval.
    fn part(
        &mut self,
        system: &mut Semidiscrete,
        (times, moments): ([f64; 3], &[Moment; 3]),
        (from, to): (f64, f64),
        nodes: impl Iterator<Item = usize> + Clone,
        control: &Control,
    ) -> Result<Option<Part>, ObstacleError> {
        let [middle, end] = [times[1] - times[0], times[2] - times[0]];
        nodes.clone().for_each(|node| self.wanted[node] = true);
        let enclosed = load_over(&mut system.problem, &self.wanted, &mut self.load, Interval::new(from, to), control);
        nodes.clone().for_each(|node| self.wanted[node] = false);
        enclosed?;
        let (mut moved, mut square) = (Vec::new(), 0.0);
        for node in nodes {
            let side = f64::from(moments[0].held[node]);
            let [a, b, c] = moments.each_ref().map(|moment| side * moment.push(node));
            let (first, whole) = ((b - a) / middle, (c - a) / end);
            let bend = (whole - first) / (end - middle);
            let push = [from, to].map(|t| a + (t - times[0]) * (first + bend * (t - times[1])));
            // Lower bound on the subinterval of the parabola of the force from neighbours: its chord less
            // `bend (to - from)^2 / 4`, with the second divided difference `bend`.
            let least = push[0].min(push[1]) - 0.25 * bend.max(0.0) * (to - from).powi(2);
            let load = self.load[node];
            let most = if side > 0.0 { load.hi } else { -load.lo };
            let terms = a.abs().max(b.abs()).max(c.abs()) + load.lo.abs().max(load.hi.abs());
            let pull = most - least;
            if pull > ROUNDING * terms || pull.is_nan() {
                let by = (to - from) * if pull.is_nan() { f64::INFINITY } else { pull } / system.weights[node];
                square += system.weights[node] * by * by;
                moved.push((node, by));
            }
        }
        let size = (square / system.weights.iter().sum::<f64>()).sqrt();
        Ok((!moved.is_empty()).then_some(Part { from, to, moved, size }))
    }
}
