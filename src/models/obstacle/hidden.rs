//! Hidden motion: bounds on the motion of nodes between the stages of a TR-BDF2 step, which the error estimate does
//! not detect.
//!
//! The error estimate of a node on an obstacle is zero for any step size, and all estimates are small in a steady
//! state, so that steps grow. A short pulse of the source may then lie between the stages. To detect such motion,
//! three contributions are added to the error, from the solution at three times (beginning, stage and end of the
//! step):
//!
//! - A node in contact with different obstacles at two of the three times, or out of contact at the stage alone,
//!   contributes its displacement range.
//! - Nodes in contact at all three times are proven to stay in contact in between, or contribute a bound on their
//!   possible displacement: [`Resting`].
//! - Nodes contribute their displacements by variations of the data that the three times miss: [`Unseen`].
//!
//! An obstacle that moves may meet the parabola through the values of a node at the three times: where obstacles
//! depend on time, every free node contributes the penetration of its parabola at [points in between](BETWEEN).

use super::resting::{Moment, Resting};
use super::unseen::Unseen;
use super::{GAMMA, ObstacleError, Semidiscrete};
use problem::Control;

/// Fractions of a TR-BDF2 step at which moving obstacles are compared with the parabolas through nodal values: quarters
/// of the time from the beginning to the stage, and the middle of the time from the stage to the end.
const BETWEEN: [f64; 4] = [0.25 * GAMMA, 0.5 * GAMMA, 0.75 * GAMMA, 0.5 * (1.0 + GAMMA)];

/// Workspace for bounds on the motion of nodes between the stages of a TR-BDF2 step.
pub struct Hidden {
    kept: Kept,
    resting: Resting,
    /// The search for variations of the problem's data between the beginning, the stage and the end of a step.
    pub unseen: Unseen,
}

/// Copies of the obstacles' values at the nodes at the end of a step.
#[derive(Default)]
struct Kept {
    lower: Vec<f64>,
    upper: Vec<f64>,
}

/// The solution of an obstacle problem at the beginning, the stage and the end of a step.
pub struct Seen<'a> {
    /// The times of the beginning, the stage and the end of the TR-BDF2 step.
    pub times: [f64; 3],
    /// The nodal values at the beginning, the stage and the end of the step.
    pub values: [&'a [f64]; 3],
    /// The contact forces and contact states of the nodes at the beginning, the stage and the end of the step.
    pub moments: &'a [Moment; 3],
}

impl Seen<'_> {
    /// Returns the smallest and the largest of a node's values at the beginning, the stage and the end of the step.
    fn range(&self, node: usize) -> (f64, f64) {
        let of = self.values.iter().map(|values| values[node]);
        of.fold((f64::INFINITY, f64::NEG_INFINITY), |(least, most), u| (least.min(u), most.max(u)))
    }

    /// Returns the value at time `t` of the parabola through the values `a`, `b`, `c` at the beginning, the stage and
    /// the end of the step.
    pub fn parabola(&self, t: f64, [a, b, c]: [f64; 3]) -> f64 {
        let part = (t - self.times[0]) / (self.times[2] - self.times[0]);
        let of_middle = part * (1.0 - part) / (GAMMA * (1.0 - GAMMA));
        let of_end = part * (part - GAMMA) / (1.0 - GAMMA);
        a + of_middle * (b - a) + of_end * (c - a)
    }
}

impl Hidden {
    /// Allocates the workspace for the nodes of a semidiscrete obstacle problem.
    pub fn new(system: &Semidiscrete) -> Self {
        let resting = Resting::new(system.weights.len());
        Self { kept: Kept::default(), resting, unseen: Unseen::new(&system.problem) }
    }

    /// Returns the root mean square over the domain of the hidden motion of nodes in a step. Bounds on resting nodes
    /// are not refined below `negligible`. The vectors of `system` must be those of the end of the step, and are
    /// restored.
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
        self.unseen.bound(system, seen, negligible, &mut moved, control)?;
        if system.set_varies() {
            self.look_at_obstacles(system, seen, &mut moved, control)?;
        }
        let weighted = moved.iter().zip(&system.weights).map(|(moved, weight)| weight * moved * moved);
        Ok((weighted.sum::<f64>() / system.weights.iter().sum::<f64>()).sqrt())
    }

    /// Raises the displacement bounds `moved` to the depths to which the parabolas through nodal values penetrate
    /// obstacles at times between the stages.
    fn look_at_obstacles(
        &mut self,
        system: &mut Semidiscrete,
        seen: &Seen<'_>,
        moved: &mut [f64],
        control: &Control,
    ) -> Result<(), ObstacleError> {
        let Kept { lower, upper } = &mut self.kept;
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
}
