//! Runs of a problem with memory by segments between located switches. Each run has a tenth of the tolerance of the
//! previous one and elements at most half as long, until two runs agree in the mean over time and in the number of
//! switches. The last run is then the answer; if no two runs agree, it is the run that differs least from its
//! predecessor, unless a uniform mesh is more accurate.

use super::failure;
use crate::run::{Plan, Run, Stepper, ending};
use crate::{
    CheckCode, Diagnostics, Event, EventKind, Failure, Refinement, Screening, Solution, Status, Steps, Warning,
};
use analysis::Analysis;
use convolution::{Activity, SegmentSettings, Segments};
use models::ConvolutionModel;
use problem::{Control, Dvi};

/// Largest number of runs by segments, each with a tenth of the tolerance of the previous one.
const RUNS: usize = 4;
/// The tolerance of the first run by segments relative to the requested one, and the factor of the tolerance from run
/// to run.
const FIRST: f64 = 0.1;
const NEXT: f64 = 0.1;

/// The reason why a uniform mesh is needed instead of segments, and the best run by segments, if there were at least
/// two to compare.
pub(super) struct Unsettled {
    pub why: String,
    pub best: Option<Solution>,
}

/// Integrates a problem with memory by segments between located switches; returns an error if no two runs agree.
pub(super) fn integrate(
    model: &ConvolutionModel,
    plan: &Plan,
    settings: &SegmentSettings,
    diagnostics: &Diagnostics,
    control: &Control,
) -> Result<Solution, Box<Unsettled>> {
    let mut problems: Vec<Box<dyn Dvi>> = (0..RUNS).map(|_| model.forcing.problem()).collect();
    let m = model.variables();
    let mut before: Option<(Segments<'_>, usize)> = None;
    let mut best: Option<(f64, Solution)> = None;
    let unsettled = |why: String, best: Option<(f64, Solution)>| {
        Box::new(Unsettled { why, best: best.map(|(_, solution)| solution) })
    };
    for (number, problem) in problems.iter_mut().enumerate() {
        let tolerance = FIRST * NEXT.powi(number as i32);
        let mesh = before.as_ref().map_or_else(Vec::new, |(last, _)| last.mesh());
        let settings = SegmentSettings { tolerance, before: mesh, ..settings.clone() };
        let mut run = Run::new(plan, control, diagnostics.clone());
        let started = (number as f64) / (RUNS as f64);
        let made = control.part(started..started + 1.0 / RUNS as f64, || {
            let segments = Segments::new(&mut **problem, &model.kernel, &settings, plan.start, plan.end, control);
            let segments = segments.map_err(|error| failure(&error, &plan.names[..m], plan.start, &plan.initial));
            let course = segments.and_then(|segments| SegmentedRun::new(model, segments, &plan.names[..m]));
            let mut course = course.map_err(|failure| ending(control, failure))?;
            let ended = run.drive(&mut course);
            course.finish(&mut run.diagnostics);
            ended.map(|()| (course.segments, course.switches))
        });
        let (segments, switches) = match made {
            Ok(made) => made,
            Err((Status::Stopped, failure)) if failure.code != "steps" => {
                return Ok(run.end(Err((Status::Stopped, failure))).solution);
            }
            Err((_, failure)) => return Err(unsettled(failure.message, best)),
        };
        if let Some((last, last_switches)) = &before {
            let distances = segments.mean_distance(last);
            let allowed = |k: usize| settings.atol[k] + settings.rtol * segments.sizes()[k];
            let scaled = distances.iter().enumerate().map(|(k, distance)| distance / allowed(k)).fold(0.0, f64::max);
            let agrees = scaled <= 1.0 && switches == *last_switches;
            let message = || format!("two runs differ by {scaled:.1e} tolerances in the mean over time");
            run.diagnostics.checks.record(CheckCode::LocalError, scaled, 1.0, message);
            if !agrees {
                run.diagnostics.warnings.push(Warning { code: "tolerance_not_reached", message: message() });
            }
            let mean_distance = plan.names.iter().cloned().zip(distances).collect();
            run.diagnostics.refinement =
                Some(Refinement { halvings: number as u32, mean_distance, scaled, order: None });
            if agrees || best.as_ref().is_none_or(|(least, _)| scaled < *least) {
                let solution = run.end(Ok(())).solution;
                if agrees {
                    return Ok(solution);
                }
                best = Some((scaled, solution));
            }
        }
        before = Some((segments, switches));
    }
    Err(unsettled(format!("{RUNS} runs, each with a tenth of the tolerance of the last, did not agree"), best))
}

/// Returns the diagnostics of a problem with memory known before a run by segments between located switches.
pub(super) fn describe(model: &ConvolutionModel, analysis: &Analysis) -> Diagnostics {
    let mut diagnostics = Diagnostics {
        method: "convolution",
        built: vec!["product integration", "located switches", "segments with functions as singular as the solution"],
        analysis: Some(analysis.clone()),
        ..Diagnostics::default()
    };
    let left_out = &mut diagnostics.left_out;
    left_out.push("convolution quadrature: it needs steps of one length".to_owned());
    left_out.push("variational inequality: between switches there are only equations".to_owned());
    if model.forcing.structure().moving.is_empty() {
        left_out.push("new bounds: they are constant".to_owned());
    } else {
        diagnostics.built.push("moving bounds");
    }
    diagnostics
}

/// A run of a problem with memory by segments between located switches, with named outputs.
struct SegmentedRun<'p> {
    segments: Segments<'p>,
    names: &'p [String],
    /// Number of elements that the run has reported as made. The first element is computed before it is reported,
    /// since `z` at the start comes from the basis functions of this element.
    told: usize,
    start: f64,
    ends: Vec<f64>,
    events: Vec<Event>,
    switches: usize,
    bounded: Vec<usize>,
    is_constant: bool,
    /// The order `a` of the kernel, which behaves like `t^(a-1)` at `t = 0`.
    order: f64,
    set: problem::ConvexSet,
    values: Vec<f64>,
}

impl<'p> SegmentedRun<'p> {
    fn new(model: &ConvolutionModel, segments: Segments<'p>, names: &'p [String]) -> Result<Self, Failure> {
        let structure = model.forcing.structure();
        let moves = |k: usize| structure.moving.iter().any(|bound| bound.variable == k);
        let m = names.len();
        let mut course = Self {
            start: segments.t(),
            segments,
            names,
            told: 0,
            ends: vec![0.0; m],
            events: Vec::new(),
            switches: 0,
            bounded: (0..m).filter(|&k| !structure.set.is_free(k) || moves(k)).collect(),
            is_constant: structure.moving.is_empty(),
            order: model.index,
            set: structure.set.clone(),
            values: vec![0.0; 3 * m],
        };
        course.advance()?;
        Ok(course)
    }

    fn advance(&mut self) -> Result<(), Failure> {
        let stepped = self.segments.step();
        stepped.map_err(|error| failure(&error, self.names, self.segments.t(), &self.ends))?;
        self.ends = self.segments.ends();
        for switch in self.segments.take_switches() {
            let kind = if switch.to == Activity::Inactive { EventKind::Activated } else { EventKind::Deactivated };
            self.events.push(Event { t: switch.t, kind, of: self.names[switch.variable].clone() });
            self.switches += 1;
        }
        Ok(())
    }
}

impl Stepper for SegmentedRun<'_> {
    fn t(&self) -> f64 {
        if self.told == 0 { self.start } else { self.segments.t() }
    }

    fn is_done(&self) -> bool {
        self.told > 0 && self.segments.is_done()
    }

    fn accepted(&self) -> u64 {
        self.told as u64
    }

    fn states(&self) -> &[f64] {
        &self.ends
    }

    fn step(&mut self) -> Result<(), Failure> {
        if self.told == self.segments.elements() {
            self.advance()?;
        }
        self.told += 1;
        Ok(())
    }

    fn values(&mut self, t: f64, out: &mut [f64]) {
        if self.segments.outputs(t, out).is_err() {
            // If a value between two nodes is not finite, the values at the last node are reported instead.
            out[..self.names.len()].copy_from_slice(&self.ends);
        }
    }

    fn take_events(&mut self, events: &mut Vec<Event>) {
        events.append(&mut self.events);
    }

    fn observe(&mut self, switched: bool, diagnostics: &mut Diagnostics) {
        let m = self.names.len();
        if self.bounded.is_empty() || self.segments.outputs(self.segments.t(), &mut self.values).is_err() {
            return;
        }
        let certificates = diagnostics.complementarity.get_or_insert_default();
        let (z, g) = (&self.values[..m], &self.values[2 * m..]);
        self.set.clone_from(self.segments.set());
        certificates.observe(&self.set, &self.bounded, z, g, self.is_constant && !switched);
    }

    fn finish(&mut self, diagnostics: &mut Diagnostics) {
        diagnostics.stages = self.segments.stages();
        let Segments { rejected, proven, open, .. } = self.segments;
        diagnostics.steps = Steps { accepted: self.told as u64, rejected, ..Steps::default() };
        diagnostics.screening = Some(Screening { proven, undecided: open, missed: 0 });
        // With a kernel of order above one, variables may have to be impulses after a switch, which is not examined.
        let doubted = if self.order > 1.0 { self.switches } else { 0 };
        diagnostics.checks.record(CheckCode::EventsUnproven, doubted as f64, 0.0, || {
            format!(
                "{doubted} switches of a kernel of order {} lead to faces that are not verified: above order one a \
                 variable at its bound may have to be an impulse; set a `step` to compare with a uniform mesh",
                self.order
            )
        });
        diagnostics.checks.record(CheckCode::EventsUnproven, open as f64, 0.0, || {
            format!(
                "{open} steps are not proven free of switches, and one that begins and ends within a step would not be \
                 seen; a smaller `max_step` may help"
            )
        });
    }
}
