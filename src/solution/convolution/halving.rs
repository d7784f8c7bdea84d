//! Runs with successively halved steps: the distance of each run from the previous one, and the choice of the answer.

use crate::run::{Plan, Run};
use crate::{CheckCode, Refinement, Warning};
use convolution::Convolution;

/// The run on a uniform mesh with the least estimated error so far. Beyond some number of steps, rounding errors, which
/// grow as an inverse power of the step given by the order of the kernel, outweigh the gain of a smaller step.
pub(super) struct Best<'a> {
    run: Run<'a>,
    /// The distance of this run from the previous run with twice the step; `None` for the first run.
    refinement: Option<Refinement>,
    steps: usize,
}

impl<'a> Best<'a> {
    pub fn new(run: Run<'a>, refinement: Option<Refinement>, steps: usize) -> Self {
        Self { run, refinement, steps }
    }

    /// Returns the estimated error of this run in units of the tolerance.
    fn scaled(&self) -> f64 {
        self.refinement.as_ref().map_or(f64::INFINITY, |refinement| refinement.scaled)
    }

    /// Returns the estimated error of this run, for comparison with other runs. It is infinite if it is based on a
    /// single distance between runs, which may be small by chance.
    pub fn rank(&self) -> f64 {
        let estimated = self.refinement.as_ref().filter(|refinement| refinement.halvings > 1);
        estimated.map_or(f64::INFINITY, |refinement| refinement.scaled)
    }

    /// Returns the run with the error estimate added to its evidence; `last` is the number of steps of the last run.
    pub fn judged(mut self, agrees: bool, last: usize) -> Run<'a> {
        let (scaled, steps) = (self.scaled(), self.steps);
        let diagnostics = &mut self.run.diagnostics;
        let message = || match &self.refinement {
            None => format!("the run with {steps} steps is the only one: there was none to compare it with"),
            Some(_) if steps < last => format!(
                "the run with {steps} steps differs least from the one with half as many, by {scaled:.1e} tolerances \
                 in the mean over time; with more steps, up to {last}, rounding errors grow: choose a larger `rtol`"
            ),
            Some(_) => format!(
                "the run with {steps} steps is the last one; it still differs from the one with half as many by \
                 {scaled:.1e} tolerances in the mean over time"
            ),
        };
        diagnostics.checks.record(CheckCode::LocalError, scaled, 1.0, message);
        if !agrees {
            diagnostics.warnings.push(Warning { code: "tolerance_not_reached", message: message() });
        }
        diagnostics.refinement = self.refinement;
        self.run
    }
}

/// The values of a run, for comparison with a run with half the step.
pub(super) struct Coarse {
    /// The values of each variable at the ends of the steps of the run.
    ends: Vec<Vec<f64>>,
    /// The distance of each variable from its values in the previous run with twice the step.
    distances: Option<Vec<f64>>,
    /// Number of consecutive runs in which the largest distance of a variable from the previous run has grown.
    growths: u32,
}

/// Number of consecutive halvings of the step with growing distances between runs after which rounding errors are
/// assumed to dominate: a single increase may be due to a feature of the solution that only the last run resolves.
const GROWTHS: u32 = 2;

impl Coarse {
    pub fn of(convolution: &Convolution<'_>) -> Self {
        let ends = (0..convolution.variables()).map(|k| convolution.ends(k).to_vec()).collect();
        Self { ends, distances: None, growths: 0 }
    }

    /// Returns this run as the successor of `before`, with the distances of its variables from `before`.
    pub fn after(self, before: Option<Self>, distances: Option<Vec<f64>>) -> Self {
        let grown = |before: &Self| Some(largest(distances.as_ref()?) > largest(before.distances.as_ref()?));
        let growths = before.filter(|before| grown(before) == Some(true)).map_or(0, |before| before.growths + 1);
        Self { distances, growths, ..self }
    }

    /// Whether the distances between runs with successively halved steps have grown so often that smaller steps
    /// increase the error.
    pub fn diverges(&self) -> bool {
        self.growths >= GROWTHS
    }

    /// Returns the evidence of the refinement from this run to the run `fine`, which has twice as many steps, and the
    /// distance of each variable between the two runs.
    pub fn refined(&self, fine: &Self, plan: &Plan, rtol: f64, atol: &[f64], halvings: i32) -> (Refinement, Vec<f64>) {
        let mean = |coarse: &[f64], fine: &[f64]| {
            let pairs = coarse.iter().zip(fine.iter().skip(1).step_by(2));
            pairs.map(|(a, b)| (a - b).abs()).sum::<f64>() / coarse.len() as f64
        };
        let distances: Vec<f64> = self.ends.iter().zip(&fine.ends).map(|(a, b)| mean(a, b)).collect();
        let half_the_last = |k: usize| self.distances.as_ref().map_or(0.0, |last| 0.5 * last[k]);
        let size = |values: &[f64]| values.iter().fold(0.0_f64, |most, z| most.max(z.abs()));
        let estimates = || (0..distances.len()).map(|k| distances[k].max(half_the_last(k)));
        let scaled = estimates().enumerate().map(|(k, estimate)| estimate / (atol[k] + rtol * size(&fine.ends[k])));
        let order = self.distances.as_ref().map(|last| (largest(last) / largest(&distances)).log2());
        let refinement = Refinement {
            halvings: halvings as u32,
            mean_distance: plan.names.iter().cloned().zip(estimates()).collect(),
            scaled: scaled.fold(0.0, f64::max),
            order: order.filter(|order| order.is_finite()),
        };
        (refinement, distances)
    }
}

fn largest(distances: &[f64]) -> f64 {
    distances.iter().copied().fold(0.0, f64::max)
}
