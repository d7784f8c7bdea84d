//! Integration of a problem with memory (a convolution): named outputs, switches and failures, and the choice of the
//! step size.
//!
//! Without a step given, and with variables in intervals, switches are located, and each segment between them has its
//! own mesh ([`segments`]). All other cases have a uniform mesh, since the weights of convolution quadrature belong
//! to one step size: a given `step` or `min_step`, variables in balls, cones and other blocks, more variables than
//! dense matrices allow, a start that needs an impulse, and problems for which no two runs by segments agree. Without
//! a step given, the run is repeated with half the step until three runs agree in the mean over time: where a
//! variable leaves a bound, `z` behaves like `(t - t_s)^(1-a)`, so that no uniform mesh is accurate at every time.
//! The run with the least estimated error is returned, which need not be the last: kernels of high order amplify
//! rounding errors as the step decreases.

mod halving;
mod segments;

use super::given_steps::GIVEN_STEPS;
use super::run::{Plan, Run, Stepper, ending};
use super::uniqueness::uniqueness_caveat;
use super::{CheckCode, Diagnostics, Event, EventKind, Failure, Solution, Status, Steps, ViCounts, Warning};
use analysis::Analysis;
use convolution::{Convolution, SegmentSettings, Settings, StepError};
use halving::{Best, Coarse};
use models::ConvolutionModel;
use problem::{Control, ConvexSet, Dvi};
use std::time::Instant;

/// The division of the time horizon of a problem with memory into steps.
#[derive(Clone, Debug)]
pub enum Mesh {
    /// A uniform mesh with a given number of steps.
    Fixed(usize),
    /// A uniform mesh whose steps are halved until three runs agree.
    Halved {
        /// Number of steps of the first run, whose steps are then halved.
        first: usize,
        /// Largest number of steps that a run with halved steps may have.
        most: usize,
        /// Relative tolerance of the mean distance between two successive runs.
        rtol: f64,
        /// Absolute tolerance of each variable in the comparison of two successive runs.
        atol: Vec<f64>,
    },
}

/// The plan for the integration of a problem with memory.
#[derive(Clone, Debug)]
pub struct ConvolutionPlan {
    /// Settings of the time steps on a uniform mesh, such as the number of stages.
    pub settings: Settings,
    /// The uniform mesh: with a given number of steps, or with steps that are halved until the runs agree.
    pub mesh: Mesh,
    /// Settings for segments between located switches, if these are tried before a uniform mesh.
    pub segments: Option<SegmentSettings>,
    /// Largest number of steps of a run whose history fits into memory.
    pub most: usize,
}

/// Integrates a problem with memory (a convolution).
pub fn integrate_convolution(
    model: &ConvolutionModel,
    plan: &Plan,
    convolution: &ConvolutionPlan,
    analysis: &Analysis,
    control: &Control,
) -> Solution {
    let began = Instant::now();
    let mut diagnostics = describe_convolution(model, convolution, analysis);
    if let Some(Warning { code, message }) = uniqueness_caveat(analysis) {
        diagnostics.checks.caveat(code, message);
    }
    let mut by_segments = None;
    if let Some(settings) = &convolution.segments {
        match segments::integrate(model, plan, settings, &diagnostics, control) {
            Ok(mut solution) => {
                solution.diagnostics.wall_seconds = began.elapsed().as_secs_f64();
                return solution;
            }
            Err(unsettled) => {
                let segments::Unsettled { why, best } = *unsettled;
                by_segments = best;
                let uniform = ConvolutionPlan { segments: None, ..convolution.clone() };
                let described = describe_convolution(model, &uniform, analysis);
                (diagnostics.built, diagnostics.left_out) = (described.built, described.left_out);
                diagnostics.vi = described.vi;
                diagnostics.checks.record(CheckCode::EventsUnproven, 1.0, 0.0, || {
                    format!("switches could not be located, and a uniform mesh may miss some: {why}")
                });
                diagnostics.left_out.push(format!("located switches: {why}"));
            }
        }
    }
    let mut problem = model.forcing.problem();
    let (first, most) = match convolution.mesh {
        Mesh::Fixed(steps) => (steps, steps),
        Mesh::Halved { first, most, .. } => {
            let allowed = usize::try_from(plan.most_steps).unwrap_or(most).min(convolution.most);
            (first, most.min(allowed))
        }
    };
    let mut steps = first;
    let mut halvings = 0;
    let mut before: Option<Coarse> = None;
    let mut best: Option<Best<'_>> = None;
    let mut before_halvings = 0.0;
    if let Mesh::Fixed(steps) = convolution.mesh
        && steps % 2 == 0
        && steps <= convolution.most
    {
        // A run with half as many steps, at a fraction of the work, serves as the estimate of the error.
        before_halvings = HALF_AS_MANY;
        before = control.part(0.0..HALF_AS_MANY, || {
            let mut run = Run::new(plan, control, diagnostics.clone());
            let settings = &convolution.settings;
            let mut course = ConvolutionRun::new(model, &mut *problem, plan, settings, steps / 2, control).ok()?;
            run.drive(&mut course).is_ok().then(|| Coarse::of(&course.convolution))
        });
    }
    loop {
        // The number of runs is unknown in advance: each run accounts for half of the progress that remains to be
        // reported to the user.
        let share = if steps * 2 > most { 1.0 } else { 0.5 };
        let done = before_halvings.max(1.0 - 0.5_f64.powi(halvings));
        let mut run = Run::new(plan, control, diagnostics.clone());
        if steps > convolution.most {
            let message = format!(
                "{steps} steps, all kept as history, take more memory than a run may have: {} are possible",
                convolution.most
            );
            let failure =
                Failure { code: "too_many_steps".into(), message, time: plan.start, state: plan.initial.clone() };
            return run.end(Err((Status::Failed, failure))).solution;
        }
        let made = control.part(done..done + (1.0 - done) * share, || {
            let mut course = ConvolutionRun::new(model, &mut *problem, plan, &convolution.settings, steps, control)
                .map_err(|failure| ending(control, failure))?;
            let ended = run.drive(&mut course);
            course.finish(&mut run.diagnostics);
            ended.map(|()| Coarse::of(&course.convolution))
        });
        let ended = match (made, &convolution.mesh) {
            (Ok(coarse), Mesh::Halved { rtol, atol, .. }) => {
                let found = before.as_ref().map(|before| before.refined(&coarse, plan, *rtol, atol, halvings));
                let scaled = found.as_ref().map_or(f64::INFINITY, |(refinement, _)| refinement.scaled);
                // The position of a switch within its step varies from run to run, and with it the error, so that a
                // single distance between runs may be small by chance.
                let agrees = halvings > 1 && scaled <= 1.0;
                let (refinement, distances) = found.unzip();
                let coarse = coarse.after(before.take(), distances);
                let made = Best::new(run, refinement, steps);
                let kept = match best.take() {
                    Some(best) if !agrees && best.rank() < made.rank() => best,
                    _ => made,
                };
                if !agrees && !coarse.diverges() && steps * 2 <= most {
                    (before, best) = (Some(coarse), Some(kept));
                    (steps, halvings) = (steps * 2, halvings + 1);
                    continue;
                }
                run = kept.judged(agrees, steps);
                Ok(())
            }
            (Ok(fine), Mesh::Fixed(_)) => {
                judge_given_steps(before.as_ref(), &fine, plan, &mut run.diagnostics);
                Ok(())
            }
            (Err((status, mut failure)), _) => {
                if status == Status::Stopped && halvings > 0 {
                    failure.message.push_str("; the run with twice the step was completed: a fixed `step` returns it");
                }
                Err((status, failure))
            }
        };
        let mut solution = run.end(ended).solution;
        let error =
            |solution: &Solution| solution.diagnostics.refinement.as_ref().map_or(f64::INFINITY, |found| found.scaled);
        if !solution.verdict.trusted
            && let Some(other) = by_segments.filter(|other| error(other) < error(&solution))
        {
            solution = other;
        }
        solution.diagnostics.wall_seconds = began.elapsed().as_secs_f64();
        return solution;
    }
}

/// Fraction of the progress reported to the user that the run with half as many steps as given accounts for: a
/// quarter of the work of the run itself, since each step sums over all earlier ones.
const HALF_AS_MANY: f64 = 0.2;

/// Records the check of the difference between `fine`, a run with steps of a given size, and `before`, a run with half
/// as many steps.
fn judge_given_steps(before: Option<&Coarse>, fine: &Coarse, plan: &Plan, diagnostics: &mut Diagnostics) {
    let Some(before) = before else {
        diagnostics.checks.caveat(
            "error_not_estimated",
            "the steps have the size that `method` gives, and there was no run with half as many to compare with; an \
             even number of steps has one"
                .into(),
        );
        return;
    };
    let none = vec![0.0; plan.names.len()];
    let (refinement, _) = before.refined(fine, plan, 1.0, &none, 0);
    let found = refinement.scaled;
    diagnostics.checks.record(CheckCode::LocalError, found, GIVEN_STEPS, || {
        format!(
            "the steps have the size that `method` gives; with half as many the variables differ by {found:.1e} of their \
             largest values in the mean over time; give a smaller `step`, or none, so that the tolerances choose it"
        )
    });
}

/// A run of a problem with memory (a convolution) on a uniform mesh, with named outputs.
struct ConvolutionRun<'p> {
    convolution: Convolution<'p>,
    names: &'p [String],
    control: &'p Control,
    set: ConvexSet,
    bounded: Vec<usize>,
    is_constant: bool,
    /// Number of steps that the run has reported as made. The first step is computed before it is reported, since `z`
    /// at the start comes from the polynomial of this step.
    told: usize,
    total: usize,
    end: f64,
    /// Last position of each variable in its interval: -1 at the lower bound, 0 inside, 1 at the upper bound.
    places: Vec<Option<i8>>,
    /// Largest absolute value of a variable so far, the scale of rounding errors in distances from bounds.
    largest: f64,
    events: Vec<Event>,
    values: Vec<f64>,
    /// Permitted residual of the natural map of the variational inequality in a step of the run.
    tolerance: f64,
}

/// A variable whose distance from a bound is below this fraction of the largest absolute value so far counts as being
/// at the bound.
const AT_BOUND: f64 = 1e-12;

impl<'p> ConvolutionRun<'p> {
    fn new(
        model: &'p ConvolutionModel,
        problem: &'p mut dyn Dvi,
        plan: &'p Plan,
        settings: &Settings,
        steps: usize,
        control: &'p Control,
    ) -> Result<Self, Failure> {
        let structure = model.forcing.structure();
        let (set, m) = (structure.set.clone(), model.variables());
        let is_constant = structure.moving.is_empty();
        let moves = |k: usize| structure.moving.iter().any(|bound| bound.variable == k);
        let bounded = (0..m).filter(|&k| !set.is_free(k) || moves(k)).collect();
        let names = &plan.names[..m];
        let failed = |error: &StepError| failure(error, names, plan.start, &plan.initial);
        let mut convolution = Convolution::new(problem, &model.kernel, settings, plan.start, plan.end, steps, control)
            .map_err(|error| failed(&error))?;
        convolution.step(control).map_err(|error| failed(&error))?;
        let mut course = Self {
            convolution,
            names,
            control,
            set,
            bounded,
            is_constant,
            told: 0,
            total: steps,
            end: plan.end,
            places: vec![None; m],
            largest: 0.0,
            events: Vec::new(),
            values: vec![0.0; 3 * m],
            tolerance: settings.vi_tolerance,
        };
        course.find_switches();
        Ok(course)
    }

    /// Records the switches of variables (changes of their position in the interval) between the stages of the last
    /// step.
    fn find_switches(&mut self) {
        let convolution = &self.convolution;
        let m = self.names.len();
        self.largest = convolution.z.iter().fold(self.largest, |most, z| most.max(z.abs()));
        let rounding = AT_BOUND * self.largest;
        for (i, c) in convolution.tableau.c.iter().enumerate() {
            for &k in self.bounded.iter().filter(|&&k| self.set.block_of(k).is_none()) {
                let (lower, upper) = convolution.interval(i, k);
                let z = convolution.z[i * m + k];
                let place = i8::from(upper - z <= rounding) - i8::from(z - lower <= rounding);
                let last = self.places[k].replace(place);
                if last.is_some_and(|last| last != place) {
                    let t = convolution.time(convolution.steps() - 1) + c * convolution.h;
                    let kind = if place == 0 { EventKind::Activated } else { EventKind::Deactivated };
                    self.events.push(Event { t, kind, of: self.names[k].clone() });
                }
            }
        }
    }

    fn ends(&self) -> &[f64] {
        let m = self.names.len();
        &self.convolution.z[self.convolution.z.len() - m..]
    }
}

impl Stepper for ConvolutionRun<'_> {
    fn t(&self) -> f64 {
        if self.told == self.total { self.end } else { self.convolution.time(self.told) }
    }

    fn is_done(&self) -> bool {
        self.told == self.total
    }

    fn accepted(&self) -> u64 {
        self.told as u64
    }

    fn states(&self) -> &[f64] {
        self.ends()
    }

    fn step(&mut self) -> Result<(), Failure> {
        if self.told == self.convolution.steps() {
            let stepped = self.convolution.step(self.control);
            stepped.map_err(|error| failure(&error, self.names, self.t(), self.ends()))?;
            self.find_switches();
        }
        self.told += 1;
        Ok(())
    }

    fn values(&mut self, t: f64, out: &mut [f64]) {
        let last = self.convolution.steps();
        let theta = if t == self.t() && self.told == last {
            1.0
        } else {
            ((t - self.convolution.time(last - 1)) / self.convolution.h).clamp(0.0, 1.0)
        };
        if self.convolution.interpolate(theta, &mut self.set, out).is_err() {
            // If a lower bound exceeds its upper bound between two stages only, the interpolation fails; the values
            // at the last stage are reported instead.
            let m = self.names.len();
            out[..m].copy_from_slice(self.ends());
        }
    }

    fn take_events(&mut self, events: &mut Vec<Event>) {
        events.append(&mut self.events);
    }

    fn observe(&mut self, switched: bool, diagnostics: &mut Diagnostics) {
        if self.bounded.is_empty() || self.convolution.interpolate(1.0, &mut self.set, &mut self.values).is_err() {
            return;
        }
        let m = self.names.len();
        let certificates = diagnostics.complementarity.get_or_insert_default();
        let (z, g) = (&self.values[..m], &self.values[2 * m..]);
        certificates.observe(&self.set, &self.bounded, z, g, self.is_constant && !switched);
        if let Some(vi) = &mut diagnostics.vi {
            vi.largest_residual = certificates.natural_map;
        }
    }

    fn finish(&mut self, diagnostics: &mut Diagnostics) {
        diagnostics.stages = self.convolution.tableau.stages();
        diagnostics.steps = Steps { accepted: self.told as u64, ..Steps::default() };
        if let Some(vi) = &mut diagnostics.vi {
            (vi.solver, vi.solves) = (self.convolution.solver(), self.convolution.steps() as u64);
            vi.pivots = self.convolution.iterations;
        }
        let (residual, t) = self.convolution.residual;
        diagnostics.checks.record(CheckCode::LawResidual, residual, self.tolerance, || {
            format!(
                "the inequalities of the step to t = {t:?} were solved to {residual:.1e} of their terms: give another \
                 `vi_solver`, or a smaller `step`"
            )
        });
    }
}

fn failure(error: &StepError, names: &[String], time: f64, state: &[f64]) -> Failure {
    let name = |k: usize| names.get(k).map_or("?", String::as_str);
    let message = match *error {
        StepError::NotFinite { row, t } => {
            let what = if row < names.len() { format!("`q` of `{}`", name(row)) } else { "a bound".to_owned() };
            format!(
                "{what} is not finite at t = {t:?}: a division by zero, a function outside its domain, or a number too large"
            )
        }
        StepError::EmptySet { variable, side, t } => {
            let (set, why) = side.emptiness();
            format!("the {set} of `{}` is empty at t = {t:?}: {why}", name(variable))
        }
        _ => error.to_string(),
    };
    Failure { code: error.code().into(), message, time, state: state.to_vec() }
}

/// Returns the diagnostics of a problem with memory known before the run: structural analysis, components built, and
/// components left out with reasons.
pub fn describe_convolution(model: &ConvolutionModel, plan: &ConvolutionPlan, analysis: &Analysis) -> Diagnostics {
    if plan.segments.is_some() {
        return segments::describe(model, analysis);
    }
    let is_power = model.kernel.terms.iter().all(|term| term.function.factor.is_none());
    let quadrature = if is_power { "convolution quadrature" } else { "product integration" };
    let mut diagnostics = Diagnostics {
        method: "convolution",
        built: vec![quadrature, "history by blocks", "variational inequality"],
        analysis: Some(analysis.clone()),
        vi: Some(ViCounts::default()),
        ..Diagnostics::default()
    };
    let other = if is_power {
        "product integration: the kernel is a power of time"
    } else {
        "convolution quadrature: the kernel is not a power of time"
    };
    diagnostics.left_out.push(other.to_owned());
    if model.forcing.structure().moving.is_empty() {
        diagnostics.left_out.push("new bounds: they are constant".to_owned());
    } else {
        diagnostics.built.push("moving bounds");
    }
    match plan.mesh {
        Mesh::Fixed(_) => diagnostics.left_out.push("error estimate: the step is fixed".to_owned()),
        Mesh::Halved { .. } => diagnostics.built.push("halved steps"),
    }
    diagnostics
}
