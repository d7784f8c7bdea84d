//! What nodes do between the stages of a step at which they rest.
//!
//! The error of a node on an obstacle is zero whatever the step, so that steps grow while all nodes rest; a source that
//! wakes them for a moment, or takes them from one obstacle to the other and back, is then between the stages. So
//!
//! - a node that is on one obstacle at one of the beginning, the stage and the end, and on the other at another, counts with
//!   the way between them;
//! - data that depend on time are enclosed over the whole step, in interval arithmetic. Where they leave what they are at
//!   the stages they are evaluated: a node that rests at all stages, and whose obstacle would have to pull there, counts
//!   with the way that the pull stands for, and so does one that an obstacle passes.

use super::{Cause, Condition, Field, Semidiscrete};
use numerics::Interval;
use problem::Control;

/// Parts of a step that are enclosed for each of the data.
const PARTS: usize = 48;

/// What data may leave their range at the stages by, as a part of it: a smooth extremum between them.
const BEYOND: f64 = 0.25;

/// Room for the data at a time between the stages.
pub struct Hidden {
    domain: [Interval; 3],
    kept: Kept,
}

/// The vectors of the end of a step.
#[derive(Default)]
struct Kept {
    load: Vec<f64>,
    lower: Vec<f64>,
    upper: Vec<f64>,
}

impl Hidden {
    /// Room for a system.
    pub fn new(system: &Semidiscrete) -> Self {
        let mut domain = [Interval::point(0.0); 3];
        for (side, axis) in domain.iter_mut().zip(system.problem.grid.axes()) {
            *side = Interval::new(axis.lower, axis.upper);
        }
        Self { domain, kept: Kept::default() }
    }

    /// The mean square, over the domain, of how far nodes may have moved unseen in a step with these times, obstacles that
    /// hold nodes (1 from below, -1 from above) and values at its beginning, stage and end, and the forces of the obstacles
    /// at the end. The system is at the end, and is so afterwards.
    ///
    /// # Errors
    /// Data between the stages that are not finite or contradict each other; or `control` asks to stop.
    pub fn error(
        &mut self,
        system: &mut Semidiscrete,
        times: [f64; 3],
        held: [&[i8]; 3],
        force: &[f64],
        values: [&Vec<f64>; 3],
        control: &Control,
    ) -> Result<f64, Cause> {
        let nodes = system.weights.len();
        let mut moved = vec![0.0; nodes];
        for i in (0..nodes).filter(|&i| !system.is_given[i]) {
            let on = |side: i8| held.iter().any(|held| held[i] == side);
            if on(1) && on(-1) {
                let most = values.iter().fold(f64::NEG_INFINITY, |most, u| most.max(u[i]));
                let least = values.iter().fold(f64::INFINITY, |least, u| least.min(u[i]));
                moved[i] = most - least;
            }
        }
        for t in self.suspects(system, times) {
            self.look(system, t, times[2] - times[0], (held, force, values), &mut moved, control)?;
        }
        let weighted = moved.iter().zip(&system.weights).map(|(moved, weight)| weight * moved * moved);
        Ok(weighted.sum::<f64>() / system.weights.iter().sum::<f64>())
    }

    /// A time for each of the data that leave their range at the stages: that at which they are farthest from it.
    fn suspects(&self, system: &mut Semidiscrete, times: [f64; 3]) -> Vec<f64> {
        let problem = &mut system.problem;
        let given = problem.conditions.iter_mut().map(|condition| match condition {
            Condition::Dirichlet(field) | Condition::Neumann(field) => field,
        });
        let fields = problem.source.iter_mut().chain(&mut problem.lower).chain(&mut problem.upper).chain(given);
        fields.filter(|field| field.varies_in_time()).filter_map(|field| self.suspect(field, times)).collect()
    }

    fn suspect(&self, field: &mut Field, times: [f64; 3]) -> Option<f64> {
        let mut at = |t: f64| field.over(Interval::point(t), &self.domain);
        let seen = times.into_iter().map(&mut at).reduce(Interval::hull)?;
        let room = BEYOND * (seen.hi - seen.lo) + f64::EPSILON * seen.lo.abs().max(seen.hi.abs());
        let excess = |range: Interval| (range.hi - seen.hi).max(seen.lo - range.lo) - room;
        let mut parts = vec![(times[0], times[1]), (times[1], times[2])];
        let mut ranked: Vec<(f64, f64, f64)> = Vec::with_capacity(PARTS);
        let (mut farthest, mut suspect) = (0.0, None);
        for _ in 0..PARTS {
            for (a, b) in parts.drain(..) {
                let by = excess(field.over(Interval::new(a, b), &self.domain));
                if by > farthest {
                    ranked.push((by, a, b));
                }
            }
            let best = (0..ranked.len()).max_by(|&i, &j| ranked[i].0.total_cmp(&ranked[j].0));
            let Some(best) = best else { break };
            let (_, a, b) = ranked.swap_remove(best);
            let middle = 0.5 * (a + b);
            if middle <= a || middle >= b {
                continue;
            }
            let by = excess(field.over(Interval::point(middle), &self.domain));
            if by > farthest {
                (farthest, suspect) = (by, Some(middle));
                ranked.retain(|part| part.0 > farthest);
            }
            parts.extend([(a, middle), (middle, b)]);
        }
        suspect
    }

    /// How far nodes would move by the data at `t` while they are taken to rest.
    fn look(
        &mut self,
        system: &mut Semidiscrete,
        t: f64,
        h: f64,
        (held, force, values): ([&[i8]; 3], &[f64], [&Vec<f64>; 3]),
        moved: &mut [f64],
        control: &Control,
    ) -> Result<(), Cause> {
        let Kept { load, lower, upper } = &mut self.kept;
        load.clone_from(&system.load);
        lower.clone_from(&system.set.lower);
        upper.clone_from(&system.set.upper);
        let found = system.vectors_at(t, control);
        for (i, moved) in moved.iter_mut().enumerate() {
            if found.is_err() || system.is_given[i] {
                continue;
            }
            let rests = held.iter().all(|at| at[i] == held[0][i]);
            // What the obstacle pushes with if the node goes on resting.
            let force = force[i] + load[i] - system.load[i];
            if rests && f64::from(held[0][i]) * force < 0.0 {
                *moved = f64::max(*moved, h * force.abs() / system.weights[i]);
            }
            let (most, least) = values
                .iter()
                .fold((f64::NEG_INFINITY, f64::INFINITY), |(most, least), u| (most.max(u[i]), least.min(u[i])));
            let passed = (system.set.lower[i] - most).max(least - system.set.upper[i]);
            *moved = f64::max(*moved, passed);
        }
        system.load.copy_from_slice(load);
        system.set.lower.copy_from_slice(lower);
        system.set.upper.copy_from_slice(upper);
        found
    }
}
