//! Nodes that rest at the beginning, the stage and the end of a step: do they rest in between?
//!
//! An obstacle holds a node while what its neighbours push it with, less `f`, does not pull it away. The push is known at the
//! three times, and taken for a parabola between them; `f` is enclosed over parts of the step, in interval arithmetic. A part
//! in which the obstacle might have to pull is halved, the worst first, until what all of them could move the nodes by is
//! negligible: then they are proven to rest. What is left when a bound on the work is met counts with the way that the
//! pull stands for, and the step is cut.

use super::load::load_over;
use super::{ObstacleError, Semidiscrete};
use numerics::Interval;
use problem::Control;

/// Parts of a step that are enclosed.
const PARTS: usize = 64;

/// Rounding of the forces of a node, in parts of their terms.
const ROUNDING: f64 = 16.0 * f64::EPSILON;

/// The forces at a time of a step, with the obstacles that hold the nodes there.
#[derive(Clone, Default)]
pub struct Moment {
    /// 1 from below, -1 from above, 0 none.
    pub held: Vec<i8>,
    /// What the obstacles push with.
    pub force: Vec<f64>,
    /// How far an obstacle keeps each node from where it would be without it, its neighbours as they are.
    pub kept: Vec<f64>,
    /// `f`
    pub load: Vec<f64>,
}

impl Moment {
    /// Room for so many nodes.
    pub fn new(nodes: usize) -> Self {
        Self { held: vec![0; nodes], force: vec![0.0; nodes], kept: vec![0.0; nodes], load: vec![0.0; nodes] }
    }

    /// What the neighbours of a node push it with.
    fn push(&self, node: usize) -> f64 {
        self.force[node] + self.load[node]
    }
}

/// A part of a step in which obstacles might have to pull.
struct Part {
    from: f64,
    to: f64,
    /// How far nodes would move in it.
    moved: Vec<(usize, f64)>,
    /// The mean square of that over the domain, as a root.
    size: f64,
}

/// Room for the proof.
pub struct Resting {
    wanted: Vec<bool>,
    load: Vec<Interval>,
}

impl Resting {
    /// Room for so many nodes.
    pub fn new(nodes: usize) -> Self {
        Self { wanted: vec![false; nodes], load: vec![Interval::point(0.0); nodes] }
    }

    /// Adds to `moved` how far nodes that rest at these times may have moved between them, if that is more than `negligible`
    /// in the mean square over the domain.
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

    /// What nodes that rest at all times of a step may do in a part of it, if anything.
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
            // A parabola is below its chord by no more than this.
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
