//! Integration of a parabolic obstacle problem, with named outputs.

use super::given_steps::record_given_steps;
use super::run::{Plan, Stepper, run};
use super::{CheckCode, Diagnostics, Evaluations, Event, EventKind, Failure, Solution, Steps, ViCounts};
use analysis::Analysis;
use hybrid::OneStep;
use models::obstacle::{Contact, ContactChange, Obstacle, ObstacleError, Settings, TrBdf2};
use problem::Control;

/// Integrates a parabolic obstacle problem by TR-BDF2.
pub fn integrate_obstacle(
    problem: &Obstacle,
    plan: &Plan,
    settings: &Settings,
    analysis: &Analysis,
    control: &Control,
) -> Solution {
    run(plan, control, describe_obstacle(problem, settings, analysis), || {
        ObstacleRun::new(problem, plan, settings, control)
            .map_err(|cause| failure(&cause, plan.start, plan.initial.clone()))
    })
}

/// Returns the diagnostics of an obstacle problem known before the run: components built, and components left out with
/// reasons.
pub fn describe_obstacle(problem: &Obstacle, settings: &Settings, analysis: &Analysis) -> Diagnostics {
    let mut diagnostics = Diagnostics {
        method: "tr_bdf2",
        stages: 2,
        built: vec!["finite elements", "trapezoidal rule with backward differences", "active set"],
        analysis: Some(analysis.clone()),
        vi: problem.has_obstacle().then(ViCounts::default),
        ..Diagnostics::default()
    };
    let mut leave = |what: &str| diagnostics.left_out.push(what.to_owned());
    if !problem.has_obstacle() {
        leave("variational inequality: there is no obstacle");
    }
    if problem.has_constant_operator() {
        leave("new matrices for new times: the coefficients are constant in time");
    }
    if settings.step.is_some() {
        leave("error control: the step is fixed");
    }
    diagnostics
}

/// A run of an obstacle problem, with named outputs.
struct ObstacleRun<'a> {
    stepper: TrBdf2<'a>,
    /// The outputs of the problem at the beginning and at the end of the last step.
    told: [Vec<f64>; 2],
    contact: Contact,
    events: Vec<Event>,
    /// For each probe (a point at which `u` is reported), the nodes of its interpolation with their weights.
    probes: Vec<Vec<(usize, f64)>>,
    /// The largest `|u|` of the obstacle problem at the current time, which failures report as the state.
    states: Vec<f64>,
    vi_tolerance: f64,
}

impl<'a> ObstacleRun<'a> {
    fn new(
        problem: &Obstacle,
        plan: &'a Plan,
        settings: &Settings,
        control: &'a Control,
    ) -> Result<Self, ObstacleError> {
        let stepper = TrBdf2::new(problem.clone(), (plan.start, plan.end), *settings, control)?;
        let probes = problem.probes.iter().map(|probe| problem.grid.interpolation(probe.at)).collect();
        let room = || vec![0.0; plan.names.len()];
        let mut course = Self {
            stepper,
            told: [room(), room()],
            contact: Contact::default(),
            events: Vec::new(),
            probes,
            states: plan.initial.clone(),
            vi_tolerance: settings.vi_tolerance,
        };
        course.tell();
        course.told[0] = course.told[1].clone();
        Ok(course)
    }

    /// Updates the outputs of the obstacle problem to those at the current time.
    fn tell(&mut self) {
        let Self { stepper: TrBdf2 { system, u, force, .. }, told, probes, .. } = self;
        self.contact = Contact::of(system, u, force);
        let [before, now] = told;
        std::mem::swap(before, now);
        let scalars = probes.len();
        for (told, probe) in now.iter_mut().zip(probes.iter()) {
            *told = probe.iter().map(|&(node, weight)| weight * u[node]).sum();
        }
        now[scalars] = u.iter().zip(&system.weights).map(|(u, weight)| u * weight).sum();
        let Contact { measure, from, to, pressure, .. } = self.contact;
        let values = [pressure, measure, from, to];
        for (told, value) in now[scalars + 1..].iter_mut().zip(values) {
            *told = value;
        }
        self.states[0] = u.iter().fold(0.0_f64, |largest, u| largest.max(u.abs()));
    }
}

impl Stepper for ObstacleRun<'_> {
    fn t(&self) -> f64 {
        self.stepper.t
    }

    fn is_done(&self) -> bool {
        self.stepper.is_done()
    }

    fn accepted(&self) -> u64 {
        self.stepper.counts.accepted
    }

    fn states(&self) -> &[f64] {
        &self.states
    }

    fn step(&mut self) -> Result<(), Failure> {
        self.stepper.step().map_err(|cause| failure(&cause, self.stepper.t, self.states.clone()))?;
        self.tell();
        for (t, change) in self.stepper.changes.drain(..) {
            let kind = match change {
                ContactChange::Begins => EventKind::Activated,
                ContactChange::Ends => EventKind::Deactivated,
            };
            self.events.push(Event { t, kind, of: "contact".to_owned() });
        }
        Ok(())
    }

    /// Writes the outputs of the obstacle problem within a step: values of `u` by the interpolant of the method, and
    /// linearly interpolated values of the contact set, whose rates jump.
    fn values(&mut self, t: f64, out: &mut [f64]) {
        let Self { stepper, told: [before, now], probes, .. } = self;
        let (start, end) = (stepper.begin(), stepper.t);
        let part = if end > start { (t - start) / (end - start) } else { 1.0 };
        if part == 1.0 {
            out.copy_from_slice(now);
            return;
        }
        let scalars = probes.len();
        for (out, probe) in out.iter_mut().zip(probes.iter()) {
            *out = probe.iter().map(|&(node, weight)| weight * stepper.within(node, part)).sum();
        }
        let weights = stepper.system.weights.iter().enumerate();
        out[scalars] = weights.map(|(node, weight)| weight * stepper.within(node, part)).sum();
        for ((out, before), now) in out.iter_mut().zip(before.iter()).zip(now.iter()).skip(scalars + 1) {
            *out = before + part * (now - before);
        }
    }

    fn take_events(&mut self, events: &mut Vec<Event>) {
        events.append(&mut self.events);
    }

    fn observe(&mut self, _switched: bool, _diagnostics: &mut Diagnostics) {}

    fn finish(&mut self, diagnostics: &mut Diagnostics) {
        let counts = &self.stepper.counts;
        if diagnostics.vi.is_some() {
            diagnostics.checks.record(CheckCode::LawResidual, counts.residual, self.vi_tolerance, || {
                format!(
                    "the inequality of a stage was solved to {:.1e} of the largest value: lower `step`",
                    counts.residual
                )
            });
        }
        if diagnostics.vi.is_some() || counts.unproven > 0 {
            diagnostics.checks.record(CheckCode::EventsUnproven, counts.unproven as f64, 0.0, || {
                format!(
                    "in {} steps the data may vary, or lift nodes in contact, between the stages: choose a smaller \
                     `step`, or none",
                    counts.unproven
                )
            });
        }
        if counts.given_steps != 0.0 {
            record_given_steps(counts.given_steps, &mut diagnostics.checks);
        }
        let reasons = [("error", counts.inaccurate), ("inequality", counts.unsolved)];
        diagnostics.steps = Steps {
            accepted: counts.accepted,
            rejected: counts.inaccurate + counts.unsolved,
            rejected_for: reasons.into_iter().filter(|(_, count)| *count > 0).collect(),
        };
        diagnostics.evaluations =
            Evaluations { rates: counts.vectors, jacobians: counts.operators, factorisations: counts.matrices };
        let counted = ViCounts {
            solver: "active_set",
            solves: counts.solves,
            pivots: counts.passes,
            largest_residual: counts.residual,
            largest_proximal_residual: None,
            tried: Vec::new(),
        };
        diagnostics.vi = diagnostics.vi.take().map(|_| counted);
    }
}

fn failure(cause: &ObstacleError, time: f64, state: Vec<f64>) -> Failure {
    Failure { code: cause.code().into(), message: cause.to_string(), time, state }
}
