//! Integration of a mechanical system with contacts: named outputs, energies and failures.

use super::given_steps::{GIVEN_STEPS, GivenSteps};
use super::longer_run::{LongerRun, TimeStepped};
use super::longer_steps::{KNOWN_ENERGY, Kind};
use super::mechanical_checks::{Accuracy, check_energy, check_grazed, check_passed, check_screening, check_violations};
use super::misdirection::Misdirection;
use super::run::{Ended, Plan, Run, Stepper, run_to_end};
use super::sensitivities::{self, FollowedMotion};
use super::unseen_forces::UnseenForces;
use super::unseen_gaps::UnseenGaps;
use super::{
    CheckCode, Diagnostics, Evaluations, Event, Failure, Screening, Solution, Status, Steps, ViCounts, Warning,
};
use analysis::Analysis;
use contact::energy::Energy;
use contact::law::UNSOLVED;
use contact::{
    ContactError, ContactEvent, Elapsed, EventDriven, Grazed, ModeEvaluators, Passed, Settings, SmoothPhase, State,
    TimeStepping, VelocityStep,
};
use models::{ENERGIES, MechanicalModel};
use nalgebra::{DMatrix, DVector, Vector3};
use numerics::Interval;
use problem::{Constraints, Control, Mechanical};

/// Fraction of the displacement of a coordinate that counts as a rounding error after contacts and joints have removed
/// the components that they do not allow.
const HELD: f64 = 1e-9;

/// The plan for the integration of a mechanical system.
#[derive(Clone, Debug)]
pub struct ContactPlan {
    /// The settings of the contact method: step size of time stepping, and contact laws.
    pub settings: Settings,
    /// Settings of Radau IIA for smooth motion between impacts, if impacts are located in time; `None` for time
    /// stepping.
    pub located: Option<radau::Settings>,
}

/// Integrates a mechanical system with impacts, by time stepping or with located impacts, with all checks of accuracy.
pub fn integrate_contact(
    model: &MechanicalModel,
    plan: &Plan,
    contact: &ContactPlan,
    analysis: &Analysis,
    control: &Control,
) -> Solution {
    let mut ended = integrate_contact_once(model, plan, contact, analysis, control);
    if let Some(radau) = contact.located.as_ref().filter(|_| ended.solution.status == Status::Completed) {
        sensitivities::check_motion(model, plan, (contact, radau), analysis, control, &mut ended);
    }
    ended.solution
}

/// Runs a mechanical system once, without checking its sensitivities against other runs.
pub(super) fn integrate_contact_once(
    model: &MechanicalModel,
    plan: &Plan,
    contact: &ContactPlan,
    analysis: &Analysis,
    control: &Control,
) -> Ended {
    let mut problem = model.problem();
    let (q, v) = plan.initial.split_at(problem.structure().coordinates);
    let mut state = State { t: plan.start, q: q.to_vec(), v: v.to_vec() };
    let diagnostics = describe_contact(model, contact, analysis);
    let mut outputs = Outputs::new(model, control, plan);
    let ContactPlan { settings, located: Some(radau) } = contact else {
        let mut same = model.problem();
        return run_to_end(plan, control, diagnostics, || {
            let mut longer = TimeStepping::new(&mut *same, contact.settings, state.clone(), plan.end);
            longer.step.is_beside = true;
            let longer = TimeSteppingRun {
                stepper: longer,
                longer: None,
                outputs: Outputs::new(model, control, plan),
                unseen: UnseenForces::default(),
                gaps: UnseenGaps::default(),
                misdirection: Misdirection::default(),
            };
            let longer = LongerRun::new(longer, plan, contact.settings.default_step);
            let stepper = TimeStepping::new(&mut *problem, contact.settings, state, plan.end);
            Ok(TimeSteppingRun {
                stepper,
                longer: Some(Box::new(longer)),
                outputs,
                unseen: UnseenForces::default(),
                gaps: UnseenGaps::default(),
                misdirection: Misdirection::default(),
            })
        });
    };
    let mut run = Run::new(plan, control, diagnostics);
    let clock = Clock { start: plan.start, end: plan.end };
    let mut problem = Elapsed::new(problem, clock.start);
    state.t = 0.0;
    let mut located = match EventDriven::new(&mut problem, settings, radau.clone(), state, clock.length(), control) {
        Ok(located) => located,
        Err(error) => {
            let failure = outputs.failure(error.ahead(clock.start), plan.start);
            return run.end(Err((Status::Failed, failure)));
        }
    };
    let followed = plan
        .sensitivities
        .as_ref()
        .map(|asked| FollowedMotion::new(model, plan, asked, &mut located, (radau.rtol, &radau.atol)));
    let mut followed = match followed.transpose() {
        Ok(followed) => followed,
        Err(why) => {
            let failure = sensitivities::failure(&why, plan.start, &plan.initial);
            return run.end(Err((Status::Failed, failure)));
        }
    };
    let mut gradient = None;
    let mut evaluators = ModeEvaluators::new(|| Box::new(Elapsed::new(model.problem(), clock.start)));
    let mut given = GivenSteps::default();
    let ended = loop {
        let mut phase = SmoothPhase::new(&mut located, &mut evaluators, control);
        if let Some(followed) = &mut followed {
            followed.begin(&mut phase);
        }
        let followed = followed.as_mut();
        let given = &mut given;
        let driven = run.drive(&mut EventDrivenRun { phase, clock, outputs: &mut outputs, given, followed });
        if driven.is_err() || located.is_done() || run.is_ended() {
            break driven;
        }
    };
    let steps = Steps { accepted: located.accepted, ..Steps::default() };
    tell(&located.step, model, (clock.start, steps), &mut run.diagnostics);
    judge_located(&mut located, model, (clock.start, radau), &mut run.diagnostics);
    given.judge(Vec::new, &mut run.diagnostics.checks);
    if located.accumulations > 0 {
        let message = format!(
            "impacts accumulated ({} times); the run continued after each accumulation with an impact without \
             restitution",
            located.accumulations
        );
        run.diagnostics.warnings.push(Warning { code: "impacts_accumulate", message });
    }
    if located.passes > 0 {
        let message = format!(
            "in {} steps smooth motion could not be continued (a slip in space that ends, a paradox of friction, or \
             events that are too close); time stepping was used there, at first order",
            located.passes
        );
        run.diagnostics.warnings.push(Warning { code: "time_stepping_went_on", message });
    }
    let mut ended = ended;
    if let Some(followed) = followed.as_mut().filter(|_| ended.is_ok()) {
        match followed.gradient(&located) {
            Some(Ok(found)) => gradient = Some(found),
            Some(Err(why)) => {
                let State { t, q, v } = &located.state;
                let states = [q.as_slice(), v].concat();
                ended = Err((Status::Failed, sensitivities::failure(&why, clock.start + t, &states)));
            }
            None => {}
        }
    }
    let mut ended = run.end(ended);
    if let Some(gradient) = gradient {
        gradient.put(plan, &mut ended);
    }
    if let Some(followed) = followed {
        if followed.left_out > 0 {
            let message = format!(
                "the times of {} more events have derivatives that are left out: ask for them over a shorter time",
                followed.left_out
            );
            ended.solution.diagnostics.checks.caveat("event_slopes_left_out", message);
        }
        ended.solution.event_slopes = followed.events;
    }
    ended
}

/// Records the checks of a run with located impacts.
fn judge_located(
    located: &mut EventDriven<'_>,
    model: &MechanicalModel,
    (start, radau): (f64, &radau::Settings),
    diagnostics: &mut Diagnostics,
) {
    let State { t, q, v } = &located.state;
    let (of_q, of_v) = radau.atol.split_at(q.len());
    let problem = &mut *located.step.problem;
    let atol = problem.energies(*t, q, of_v).kinetic;
    let mut forces = vec![0.0; q.len()];
    problem.forces(*t, q, v, &mut forces);
    let work = forces.iter().zip(of_q).map(|(force, atol)| (force * atol).abs()).sum();
    let accuracy = Accuracy::Tolerance { rtol: radau.rtol, atol, work, steps: located.accepted };
    let checks = &mut diagnostics.checks;
    check_energy(&located.energy, accuracy, checks);
    check_violations(&located.violations.clone().ahead(start), &model.contacts, accuracy, checks);
    check_screening(located.screening, checks);
    let contact::Screening { proven, undecided, missed } = located.screening;
    let screening = Screening { proven, undecided, missed };
    diagnostics.screening = (proven + undecided + missed > 0).then_some(screening);
    let checks = &mut diagnostics.checks;
    if let Some(grazed) = located.grazed.map(|grazed| Grazed { t: start + grazed.t, ..grazed }) {
        check_grazed(&grazed, &model.contacts[grazed.contact], checks);
    }
    if let Some(passed) = located.passed.map(|passed| Passed { t: start + passed.t, ..passed }) {
        check_passed(&passed, &model.contacts[passed.contact], &located.energy, radau.rtol, checks);
    }
}

/// Converts an error of a contact method to a failure with the names of the model.
pub(super) fn failure_of(model: &MechanicalModel, error: ContactError, time: f64, states: &[f64]) -> Failure {
    let message = match error {
        ContactError::Force { component, t } => format!(
            "the force on `{}` is not finite at t = {t:?}: a division by zero, a function outside its domain, or a \
             number too large",
            model.coordinates[component]
        ),
        ContactError::Gradient { contact, t } => format!(
            "the gap of `{}` has no gradient where it closes, at t = {t:?}, so that its impulse has no direction: \
             write it as a distance, or set `impacts` to `time_stepping`",
            model.contacts[contact]
        ),
        ContactError::Friction { contact, mu, t } => format!(
            "the coefficient of friction of `{}` is {mu} at t = {t:?}: write an expression that stays at 0 or more, such as \
             max(0, ..)",
            model.contacts[contact]
        ),
        _ => error.to_string(),
    };
    Failure { code: error.code().into(), message, time, state: states.to_vec() }
}

/// The named outputs of a mechanical system, computed for time stepping and for located impacts.
struct Outputs<'p> {
    model: &'p MechanicalModel,
    control: &'p Control,
    problem: Box<dyn Mechanical>,
    constraints: Constraints,
    /// The coordinates `q` and velocities `v` of the system at the current time.
    states: Vec<f64>,
}

impl<'p> Outputs<'p> {
    fn new(model: &'p MechanicalModel, control: &'p Control, plan: &Plan) -> Self {
        let constraints = Constraints::new(model.structure());
        Self { model, control, problem: model.problem(), constraints, states: plan.initial.clone() }
    }

    fn reach(&mut self, state: &State) {
        let (q, v) = self.states.split_at_mut(state.q.len());
        q.copy_from_slice(&state.q);
        v.copy_from_slice(&state.v);
    }

    fn failure(&self, error: ContactError, time: f64) -> Failure {
        failure_of(self.model, error, time, &self.states)
    }

    /// Writes gaps, impulses and energies to the outputs `out`, which already begin with `q` and `v`.
    fn write(&mut self, t: f64, impulses: &[Vector3<f64>], energy: &Energy, out: &mut [f64]) {
        let structure = self.model.structure();
        let n = structure.coordinates;
        self.problem.constraints(t, &out[..n], &mut self.constraints);
        let mut place = 2 * n;
        for (k, contact) in structure.contacts.iter().enumerate() {
            out[place] = self.constraints.values[structure.joints + k];
            let friction = &impulses[k].component_mul(&Vector3::new(1.0, 1.0, contact.ratio));
            out[place + 1..=place + 1 + contact.slips].copy_from_slice(&friction.as_slice()[..=contact.slips]);
            place += 2 + contact.slips;
        }
        let energies = self.problem.energies(t, &out[..n], &out[n..2 * n]);
        out[place..place + ENERGIES.len()].copy_from_slice(&[
            energies.kinetic,
            energies.potential,
            energy.work_of_forces,
            energy.work_of_drives,
            energy.dissipated_by_friction,
            energy.lost_in_impacts,
        ]);
    }

    /// Converts events of contacts to the user's time, by adding `start`, and to the names of the contacts.
    fn events(&self, start: f64, new_events: &mut Vec<ContactEvent>, events: &mut Vec<Event>) {
        let name = |k: usize| self.model.contacts[k].clone();
        events.extend(new_events.drain(..).map(|ContactEvent { t, kind, contact }| Event {
            t: start + t,
            kind,
            of: name(contact),
        }));
    }
}

/// A run of a mechanical system by time stepping, with named outputs and estimates of its errors.
struct TimeSteppingRun<'p> {
    stepper: TimeStepping<'p>,
    longer: Option<Box<LongerRun<Self>>>,
    outputs: Outputs<'p>,
    unseen: UnseenForces,
    gaps: UnseenGaps,
    misdirection: Misdirection,
}

impl TimeSteppingRun<'_> {
    /// Returns the speed at the end of the last step, of length `h`, in the norm of the mass matrix, and the errors
    /// of the velocities that arise because time stepping takes the normal and the approach velocity of each impact
    /// at the beginning of the step, and not where the gap closes.
    fn misdirected(&mut self, h: f64) -> Option<(f64, Vec<f64>)> {
        let TimeStepping { state, last, impulses, .. } = &self.stepper;
        let structure = self.outputs.model.structure();
        let n = structure.coordinates;
        let problem = &mut *self.outputs.problem;
        let mut at_start = Constraints::new(structure);
        let mut there = Constraints::new(structure);
        let mut impulse = DVector::zeros(n);
        let is_struck = impulses.iter().any(|r| r.x > 0.0);
        if is_struck {
            problem.constraints(last.t, &last.q, &mut at_start);
        }
        for (k, r) in impulses.iter().enumerate().filter(|(_, r)| r.x > 0.0) {
            let normal = structure.normal(k);
            let approach = -at_start.velocity(normal, &last.v);
            let until = at_start.values[normal] / approach;
            if !(approach > 0.0 && until > 0.0 && until < h) {
                continue;
            }
            let q: Vec<f64> = last.q.iter().zip(&last.v).map(|(q, v)| q + until * v).collect();
            problem.constraints(last.t + until, &q, &mut there);
            let larger = (-there.velocity(normal, &last.v) / approach).max(0.0);
            for (row, r) in std::iter::once(normal).chain(structure.tangents(k)).zip(r.iter()) {
                for (impulse, (here, there)) in impulse.iter_mut().zip(at_start.row(row).iter().zip(there.row(row))) {
                    *impulse += r * (larger * there - here);
                }
            }
        }
        let mut mass = DMatrix::zeros(n, n);
        problem.mass(last.t, &last.q, &mut mass);
        let v = DVector::from_column_slice(&state.v);
        let speed = v.dot(&(&mass * &v)).max(0.0).sqrt();
        let error = if is_struck { mass.cholesky()?.solve(&impulse) } else { impulse };
        Some((speed, error.as_slice().to_vec()))
    }

    /// Writes all outputs at the end of the last step with the coordinates displaced by `by`.
    fn write_displaced(&mut self, by: impl Fn(usize) -> f64, out: &mut [f64]) {
        let TimeStepping { state, impulses, energy, .. } = &self.stepper;
        let n = state.q.len();
        for i in 0..n {
            (out[i], out[n + i]) = (state.q[i] + by(i), state.v[i]);
        }
        self.outputs.write(state.t, impulses, energy, out);
    }
}

impl TimeStepped for TimeSteppingRun<'_> {
    fn begin(&self) -> f64 {
        self.stepper.last.t
    }

    fn step_to(&mut self, end: f64) -> Result<(), Failure> {
        let made = self.stepper.advance_to(end, self.outputs.control);
        self.outputs.reach(&self.stepper.state);
        made.map_err(|error| self.outputs.failure(error, self.stepper.state.t))
    }

    fn kinds(&self) -> Vec<Kind> {
        use Kind::{Continuous, Jumping};
        let structure = self.outputs.model.structure();
        let n = structure.coordinates;
        let mut kinds = vec![Continuous; n];
        kinds.resize(2 * n, Jumping);
        for contact in &structure.contacts {
            kinds.push(Continuous);
            kinds.resize(kinds.len() + 1 + contact.slips, Jumping);
        }
        // Behaviour in time of kinetic and potential energy, work of forces, work of drives, friction losses and
        // impact losses.
        kinds.extend([Jumping, Continuous, Continuous, Jumping, Jumping, Jumping]);
        kinds
    }

    fn resolve(&mut self, out: &mut [f64]) {
        let h = self.stepper.state.t - self.stepper.last.t;
        let kicks = self.stepper.step.kicks.clone();
        let mut at = vec![0.0; out.len()];
        self.write_displaced(|_| 0.0, &mut at);
        self.write_displaced(|i| h * kicks[i], out);
        out.iter_mut().zip(&at).for_each(|(out, at)| *out = (*out - at).abs());
        let n = kicks.len();
        out[n..2 * n].iter_mut().zip(&kicks).for_each(|(out, kick)| *out = kick.abs());
        // Twice the kinetic energy that the forces of one step give to the system at rest: the least scale of the
        // errors of all energies.
        let State { t, q, .. } = &self.stepper.state;
        let energy = 2.0 * self.outputs.problem.energies(*t, q, &kicks).kinetic;
        let first = out.len() - ENERGIES.len();
        let known = KNOWN_ENERGY * self.stepper.energy.size();
        out[first..].iter_mut().for_each(|out| *out = out.max(energy).max(known));
    }

    fn strike(&mut self, out: &mut [f64]) -> bool {
        let TimeStepping { state, last, step, .. } = &self.stepper;
        // The impulse of contacts that are closed throughout the step is at most that of the forces, and has no error
        // of timing; any further change of the velocity is due to impacts.
        let displaced: Vec<f64> = (0..state.q.len())
            .map(|k| {
                let (change, kick) = (state.v[k] - last.v[k] - step.kicks[k], step.kicks[k].abs());
                step.early * (change.abs() - kick).max(0.0).copysign(change)
            })
            .collect();
        if displaced.iter().all(|by| *by == 0.0) {
            return false;
        }
        let mut at = vec![0.0; out.len()];
        self.write_displaced(|_| 0.0, &mut at);
        self.write_displaced(|i| displaced[i], out);
        out.iter_mut().zip(&at).for_each(|(out, at)| *out -= at);
        true
    }

    fn hold(&mut self, out: &mut [f64]) {
        let structure = self.outputs.model.structure();
        let n = structure.coordinates;
        for k in 0..n {
            let mut by = vec![0.0; n];
            by[k] = 1.0;
            self.stepper.hold_back(&mut by, false);
            // A displacement of the coordinate below `HELD` is a rounding error: contacts and joints hold the
            // coordinate fixed.
            out[k] = if by[k].abs() <= HELD { 1.0 } else { 0.0 };
        }
        let mut place = 2 * n;
        for (k, contact) in structure.contacts.iter().enumerate() {
            out[place] = if self.stepper.stays_closed(k) { 1.0 } else { 0.0 };
            place += 2 + contact.slips;
        }
    }

    fn mislead(&mut self, out: &mut [f64]) -> bool {
        let structure = self.outputs.model.structure();
        if structure.affine_constraints || structure.contacts.is_empty() {
            return false;
        }
        let (n, h) = (structure.coordinates, self.stepper.state.t - self.stepper.last.t);
        let Some((speed, error)) = self.misdirected(h) else { return false };
        self.misdirection.step(h, speed, [0.0; 2], &error);
        let by: Vec<f64> = self.misdirection.of_place().collect();
        let mut now = vec![0.0; out.len()];
        self.write_displaced(|_| 0.0, &mut now);
        self.write_displaced(|i| by[i], out);
        out.iter_mut().zip(&now).for_each(|(out, now)| *out -= now);
        out[n..2 * n].iter_mut().zip(self.misdirection.of_velocity(speed)).for_each(|(out, by)| *out = by);
        true
    }

    fn miss(&mut self, out: &mut [f64]) -> bool {
        let n = self.stepper.state.q.len();
        let Some([by, of_velocities]) = self.unseen.step(&mut self.stepper, &mut *self.outputs.problem) else {
            return false;
        };
        let mut now = vec![0.0; out.len()];
        self.write_displaced(|_| 0.0, &mut now);
        self.write_displaced(|i| by[i], out);
        out.iter_mut().zip(&now).for_each(|(out, now)| *out -= now);
        out[n..2 * n].copy_from_slice(&of_velocities);
        true
    }

    fn events(&self) -> Vec<Event> {
        let mut events = Vec::new();
        self.outputs.events(0.0, &mut self.stepper.new_events.clone(), &mut events);
        events
    }
}

impl Stepper for TimeSteppingRun<'_> {
    fn t(&self) -> f64 {
        self.stepper.state.t
    }

    fn is_done(&self) -> bool {
        self.stepper.is_done()
    }

    fn accepted(&self) -> u64 {
        self.stepper.accepted
    }

    fn states(&self) -> &[f64] {
        &self.outputs.states
    }

    fn step(&mut self) -> Result<(), Failure> {
        let made = self.stepper.advance(self.outputs.control);
        self.outputs.reach(&self.stepper.state);
        made.map_err(|error| self.outputs.failure(error, self.stepper.state.t))?;
        if let Some(mut longer) = self.longer.take() {
            longer.follow(self);
            self.longer = Some(longer);
        }
        self.gaps.step(&self.stepper, &mut *self.outputs.problem);
        Ok(())
    }

    /// Writes the outputs of time stepping within a step; velocities are constant and equal those at the end, as in the
    /// scheme `q+ = q + h v+`.
    fn values(&mut self, t: f64, out: &mut [f64]) {
        let TimeStepping { state, last, impulses, impulses_before, energy, energy_before, .. } = &self.stepper;
        let h = state.t - last.t;
        let part = if h > 0.0 { (t - last.t) / h } else { 1.0 };
        let n = state.q.len();
        for i in 0..n {
            out[i] = if part == 1.0 { state.q[i] } else { last.q[i] + part * (state.q[i] - last.q[i]) };
            out[n + i] = state.v[i];
        }
        let given: Vec<_> = impulses_before.iter().zip(impulses).map(|(a, b)| a + (b - a) * part).collect();
        self.outputs.write(t, &given, &energy_before.towards(energy, part), out);
    }

    fn take_events(&mut self, events: &mut Vec<Event>) {
        self.outputs.events(0.0, &mut self.stepper.new_events, events);
    }

    fn observe(&mut self, _: bool, diagnostics: &mut Diagnostics) {
        diagnostics.energy = Some(self.stepper.energy);
    }

    fn finish(&mut self, diagnostics: &mut Diagnostics) {
        let steps = Steps { accepted: self.stepper.accepted, ..Steps::default() };
        tell(&self.stepper.step, self.outputs.model, (0.0, steps), diagnostics);
        if let Some(mut longer) = self.longer.take() {
            longer.finish(self);
            // Coordinates whose difference is a gap have one unit, and share the scale of their errors.
            let n = self.stepper.state.q.len();
            let groups = self.stepper.step.alike();
            let of_v: Vec<Vec<usize>> = groups.iter().map(|group| group.iter().map(|k| n + k).collect()).collect();
            longer.comparison.share_units(&[groups, of_v].concat());
            longer.judge(GIVEN_STEPS, &mut diagnostics.checks);
        }
        let checks = &mut diagnostics.checks;
        self.gaps.judge(&self.outputs.model.contacts, checks);
        check_energy(&self.stepper.energy, Accuracy::Fixed, checks);
        check_violations(&self.stepper.violations, &self.outputs.model.contacts, Accuracy::Fixed, checks);
    }
}

/// The user's time at the start and the end of a run; a motion with located impacts counts time from zero.
#[derive(Clone, Copy, Debug)]
struct Clock {
    start: f64,
    end: f64,
}

impl Clock {
    fn length(self) -> f64 {
        self.end - self.start
    }

    /// Returns the user's time for the time elapsed since the start of the run.
    fn shows(self, elapsed: f64) -> f64 {
        if elapsed >= self.length() { self.end } else { (self.start + elapsed).min(self.end) }
    }

    /// Returns the time elapsed since the start of the run at the user's time `t`.
    fn elapsed(self, t: f64) -> f64 {
        t - self.start
    }
}

/// A run of smooth motion in one contact mode between located impacts, with named outputs.
struct EventDrivenRun<'l, 'p, 'o> {
    phase: SmoothPhase<'l, 'p>,
    clock: Clock,
    outputs: &'o mut Outputs<'p>,
    given: &'o mut GivenSteps,
    followed: Option<&'o mut FollowedMotion<'p>>,
}

impl Stepper for EventDrivenRun<'_, '_, '_> {
    fn t(&self) -> f64 {
        self.clock.shows(self.phase.located.state.t)
    }

    fn is_done(&self) -> bool {
        self.phase.is_over()
    }

    fn accepted(&self) -> u64 {
        self.phase.located.accepted
    }

    fn states(&self) -> &[f64] {
        &self.outputs.states
    }

    fn step(&mut self) -> Result<(), Failure> {
        let made = self.phase.advance();
        self.outputs.reach(&self.phase.located.state);
        made.map_err(|error| self.outputs.failure(error.ahead(self.clock.start), self.t()))?;
        if let Some(method) = self.phase.method() {
            self.given.add(method);
        }
        let Some(followed) = &mut self.followed else { return Ok(()) };
        let passed = followed.step(&mut self.phase);
        passed.map_err(|why| sensitivities::failure(&why.to_string(), self.t(), &self.outputs.states))
    }

    fn derivatives(&mut self, t: f64, out: &mut [f64]) {
        if let Some(followed) = &mut self.followed {
            followed.write(&mut self.phase, t, out);
        }
    }

    fn outputs(&mut self, t: f64, out: &mut [f64]) {
        if t < self.t()
            && let Some(method) = self.phase.method()
        {
            self.given.use_within(method.given_step());
        }
        self.values(t, out);
    }

    fn values(&mut self, t: f64, out: &mut [f64]) {
        let n = self.phase.located.state.q.len();
        let (q, v) = out[..2 * n].split_at_mut(n);
        // A time that is before the start of the step due to rounding counts as the start.
        let elapsed = self.clock.elapsed(t).max(self.phase.located.last.t);
        let (impulses, energy) = self.phase.outputs(elapsed, q, v);
        self.outputs.write(t, &impulses, &energy, out);
    }

    fn enclose(&mut self, from: f64, to: f64, out: &mut [Interval]) -> bool {
        let [from, to] = [from, to].map(|t| self.clock.elapsed(t));
        let ranges = self.phase.ranges_with_rounding(from, to);
        out.iter_mut().zip(&ranges).for_each(|(out, range)| *out = *range);
        !ranges.is_empty()
    }

    fn tolerances(&self) -> Option<(f64, &[f64])> {
        self.phase.located.tolerances()
    }

    fn take_events(&mut self, events: &mut Vec<Event>) {
        self.outputs.events(self.clock.start, &mut self.phase.located.new_events, events);
    }

    fn observe(&mut self, _: bool, diagnostics: &mut Diagnostics) {
        diagnostics.energy = Some(self.phase.located.energy);
    }

    fn finish(&mut self, _: &mut Diagnostics) {}
}

/// Copies the counters of a run of a mechanical system to the diagnostics, and adds warnings; `ahead` is added to the
/// times in the warnings to obtain the user's time.
fn tell(step: &VelocityStep<'_>, model: &MechanicalModel, (ahead, steps): (f64, Steps), diagnostics: &mut Diagnostics) {
    let work = &step.work;
    diagnostics.steps = steps;
    if work.solves > 0 {
        diagnostics.checks.record(CheckCode::LawResidual, work.residual, UNSOLVED, || {
            format!(
                "the law of contact was solved to a relative residual of {:.1e} at worst: choose a smaller `step`",
                work.residual
            )
        });
    }
    diagnostics.evaluations =
        Evaluations { rates: work.forces, jacobians: work.jacobians, factorisations: step.factorisations() };
    if let Some(counts) = &mut diagnostics.vi {
        *counts = ViCounts {
            solver: work.solver,
            solves: work.solves,
            pivots: work.iterations,
            largest_residual: work.residual,
            largest_proximal_residual: None,
            tried: Vec::new(),
        };
    }
    if let Some((t, contact)) = work.painleve {
        diagnostics.warnings.push(Warning {
            code: "painleve",
            message: format!(
                "at t = {:?} friction presses `{}` into the surface that it slides on (the paradox of Painleve): \
                 forces alone have no solution there, or several; the run continued with impulses, which have one",
                ahead + t,
                model.contacts[contact]
            ),
        });
    }
    if work.limited > 0 {
        diagnostics.warnings.push(Warning {
            code: "restitution_limited",
            message: format!(
                "in {} steps the full restitution would have added energy; it was reduced to add none",
                work.limited
            ),
        });
    }
}

/// Returns the diagnostics of a mechanical system known before the run: structural analysis, components built, and
/// components left out with reasons.
pub fn describe_contact(model: &MechanicalModel, contact: &ContactPlan, analysis: &Analysis) -> Diagnostics {
    let ContactPlan { settings, located } = contact;
    let structure = model.structure();
    let contacts = &structure.contacts;
    let mut diagnostics = Diagnostics {
        method: "contact",
        built: if located.is_some() { vec!["radau", "location of impacts"] } else { vec!["time stepping"] },
        analysis: Some(analysis.clone()),
        ..Diagnostics::default()
    };
    let mut leave = |what: &str| diagnostics.left_out.push(what.to_owned());
    if contacts.is_empty() {
        leave("variational inequality: there are no contacts");
    } else if structure.slips() == 0 {
        leave("friction: no contact has a coefficient");
    }
    if !contacts.is_empty() && contacts.iter().all(|contact| contact.restitution == 0.0) {
        leave("restitution: every coefficient is zero");
    }
    if structure.joints == 0 {
        leave("joints: there are none");
    }
    if structure.constant_mass && structure.constant_forces {
        leave("new factorisations: mass and forces are constant");
    }
    if !contacts.is_empty() {
        diagnostics.vi = Some(ViCounts::default());
        diagnostics.built.push("law of impact");
    }
    if contacts.iter().any(|contact| contact.slips > 0) {
        diagnostics.built.push("friction");
    }
    if contacts.iter().any(|contact| contact.restitution > 0.0) {
        diagnostics.built.push("restitution");
    }
    if structure.joints > 0 {
        diagnostics.built.push("joints");
    }
    if settings.default_step && located.is_none() {
        let message = format!("no `step` was given: time stepping makes {} steps of {} each", 10_000, settings.step);
        diagnostics.warnings.push(Warning { code: "default_step", message });
    }
    diagnostics
}
