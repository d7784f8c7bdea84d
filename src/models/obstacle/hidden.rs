//! Hidden motion: bounds on the motion of nodes between the stages of a step, which the error estimate does not detect.
//!
//! The error estimate of a node on an obstacle is zero for any step size, and all estimates are small in a steady
//! state, so that steps grow. A short pulse of the source may then lie between the stages. To detect it, three
//! contributions are added to the error:
//!
//! - A node in contact with different obstacles at two of the three times (beginning, stage, end), or out of contact at
//!   the stage alone, contributes its displacement range.
//! - Nodes in contact at all three times are proven to stay in contact in between, or contribute a bound on their
//!   possible displacement: [`Resting`].
//! - Time-dependent data are enclosed over the whole step in interval arithmetic. Where they leave their range at the
//!   three times, they are evaluated. A node that is in contact at none of the three times contributes the displacement
//!   caused by the deviation of its load from the parabola through the three times; a node with a given value, the
//!   deviation of that value from its parabola; a node overtaken by an obstacle, its penetration.
//!
//! The parabola of a node may enter an obstacle that moves within its range at the three times: where obstacles depend on
//! time, every free node contributes its penetration at [points in between](BETWEEN).

use super::resting::{Moment, Resting};
use super::{Condition, Field, GAMMA, ObstacleError, Semidiscrete};
use numerics::Interval;
use problem::Control;

/// Limit on the number of subdivisions of a step, per field.
const PARTS: usize = 48;

/// Admissible excess of a field over its range at the three times, relative to the range: allows a smooth extremum in
/// between.
const BEYOND: f64 = 0.25;

/// Parts of a step at which moving obstacles are compared with the parabolas of nodes: quarters of the time to the stage, and
/// the middle of the time behind it.
const BETWEEN: [f64; 4] = [0.25 * GAMMA, 0.5 * GAMMA, 0.75 * GAMMA, 0.5 * (1.0 + GAMMA)];

/// Workspace for data at times between the stages.
pub struct Hidden {
    domain: [Interval; 3],
    kept: Kept,
    resting: Resting,
}

/// Copies of the vectors at the end of a step.
#[derive(Default)]
struct Kept {
    load: Vec<f64>,
    lower: Vec<f64>,
    upper: Vec<f64>,
}

/// The solution at the beginning, the stage and the end of a step.
pub struct Seen<'a> {
    /// The three times.
    pub times: [f64; 3],
    /// The nodal values at the three times.
    pub values: [&'a [f64]; 3],
    /// The forces and contact states at the three times.
    pub moments: &'a [Moment; 3],
}

impl Seen<'_> {
    /// The smallest and the largest value of a node at the three times.
    fn range(&self, node: usize) -> (f64, f64) {
        let of = self.values.iter().map(|values| values[node]);
        of.fold((f64::INFINITY, f64::NEG_INFINITY), |(least, most), u| (least.min(u), most.max(u)))
    }

    /// The value at `t` of the parabola through values at the three times.
    fn parabola(&self, t: f64, [a, b, c]: [f64; 3]) -> f64 {
        let part = (t - self.times[0]) / (self.times[2] - self.times[0]);
        let of_middle = part * (1.0 - part) / (GAMMA * (1.0 - GAMMA));
        let of_end = part * (part - GAMMA) / (1.0 - GAMMA);
        a + of_middle * (b - a) + of_end * (c - a)
    }
}

impl Hidden {
    /// Allocates the workspace for a system.
    pub fn new(system: &Semidiscrete) -> Self {
        let mut domain = [Interval::point(0.0); 3];
        for (side, axis) in domain.iter_mut().zip(system.problem.grid.axes()) {
            *side = Interval::new(axis.lower, axis.upper);
        }
        Self { domain, kept: Kept::default(), resting: Resting::new(system.weights.len()) }
    }

    /// The root mean square over the domain of the hidden motion of nodes in a step. Bounds on resting nodes are not
    /// refined below `negligible`. The vectors of `system` must be those of the end of the step, and are restored.
    ///
    /// # Errors
    /// If data between the stages are not finite or contradict each other, or if `control` asks to stop.
    pub fn error(
        &mut self,
        system: &mut Semidiscrete,
        seen: &Seen<'_>,
        negligible: f64,
        control: &Control,
    ) -> Result<f64, ObstacleError> {
        let nodes = system.weights.len();
        let mut moved = vec![0.0; nodes];
        self.resting.bound(system, (seen.times, seen.moments), negligible, &mut moved, control)?;
        for i in (0..nodes).filter(|&i| !system.is_given[i]) {
            let held = seen.moments.each_ref().map(|moment| moment.held[i]);
            let changes_over = held.contains(&1) && held.contains(&-1);
            if changes_over || held[0] != 0 && held[1] == 0 && held[2] != 0 {
                let (least, most) = seen.range(i);
                moved[i] = most - least;
            }
        }
        for t in self.suspects(system, seen.times) {
            self.look(system, t, seen, &mut moved, control)?;
        }
        if system.set_varies() {
            self.look_at_obstacles(system, seen, &mut moved, control)?;
        }
        let weighted = moved.iter().zip(&system.weights).map(|(moved, weight)| weight * moved * moved);
        Ok((weighted.sum::<f64>() / system.weights.iter().sum::<f64>()).sqrt())
    }

    /// For each field that leaves its range at the three times, the time of the largest excess found.
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
        let room = BEYOND * seen.width() + f64::EPSILON * seen.lo.abs().max(seen.hi.abs());
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

    /// Raises `moved` to the penetrations of the parabolas of nodes into obstacles between the stages.
    fn look_at_obstacles(
        &mut self,
        system: &mut Semidiscrete,
        seen: &Seen<'_>,
        moved: &mut [f64],
        control: &Control,
    ) -> Result<(), ObstacleError> {
        let Kept { lower, upper, .. } = &mut self.kept;
        lower.clone_from(&system.set.lower);
        upper.clone_from(&system.set.upper);
        let [begin, _, end] = seen.times;
        let mut found = Ok(());
        for t in BETWEEN.map(|part| begin + part * (end - begin)) {
            found = found.and_then(|()| system.bounds_at(t, control));
            for (i, moved) in moved.iter_mut().enumerate().filter(|(i, _)| found.is_ok() && !system.is_given[*i]) {
                let u = seen.parabola(t, seen.values.map(|values| values[i]));
                *moved = moved.max(system.set.lower[i] - u).max(u - system.set.upper[i]);
            }
        }
        system.set.lower.copy_from_slice(lower);
        system.set.upper.copy_from_slice(upper);
        found
    }

    /// Raises `moved` to the displacements that the data at time `t` would cause.
    fn look(
        &mut self,
        system: &mut Semidiscrete,
        t: f64,
        seen: &Seen<'_>,
        moved: &mut [f64],
        control: &Control,
    ) -> Result<(), ObstacleError> {
        let Kept { load, lower, upper } = &mut self.kept;
        load.clone_from(&system.load);
        lower.clone_from(&system.set.lower);
        upper.clone_from(&system.set.upper);
        let found = system.vectors_at(t, control);
        let h = seen.times[2] - seen.times[0];
        for (i, moved) in moved.iter_mut().enumerate().filter(|_| found.is_ok()) {
            let by = if system.is_given[i] {
                (system.set.lower[i] - seen.parabola(t, seen.values.map(|values| values[i]))).abs()
            } else {
                let (least, most) = seen.range(i);
                let passed = (system.set.lower[i] - most).max(least - system.set.upper[i]);
                let is_free = seen.moments.iter().all(|moment| moment.held[i] == 0);
                let known = || seen.parabola(t, seen.moments.each_ref().map(|moment| moment.load[i]));
                let beyond = if is_free { (system.load[i] - known()).abs() } else { 0.0 };
                passed.max(h * beyond / system.weights[i])
            };
            *moved = moved.max(by);
        }
        system.load.copy_from_slice(load);
        system.set.lower.copy_from_slice(lower);
        system.set.upper.copy_from_slice(upper);
        found
    }
}
