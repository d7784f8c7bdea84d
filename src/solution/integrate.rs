//! Integration of a differential variational inequality by Radau IIA, with named failures, switches and evidence.

use super::audit::{Audit, SMALL, states_above_zero};
use super::energy_balance::EnergyBalance;
use super::impulse::{Impulse, SAME_IMPULSE};
use super::other_solutions::OrientationWatch;
use super::run::{Ended, Plan, Stepper, run_to_end};
use super::sensitivities::{Followed, Gradient};
use super::uniqueness::{FaceWatch, LipschitzWatch, analysis_of_face, uniqueness_caveat};
use super::{
    CheckCode, Contraction, Diagnostics, Evaluations, Event, EventKind, Face, Failure, Solution, Status, Steps, Tried,
    ViCounts, Warning, global_error, runaway, sensitivities,
};
use analysis::Analysis;
use hybrid::OneStep;
use models::{DviModel, KinkAdvice, Outputs};
use numerics::Interval;
use problem::{Control, Mass, Structure};
use radau::{Activity, Jump, Radau, RejectionCause, Settings, StageChoice, StepError, Switch, Switches, Variables};
use vi::Attempt;

/// Largest number of active faces analysed in one run.
const MOST_FACES: usize = 16;

/// Integrates a differential variational inequality by Radau IIA.
pub fn integrate(
    model: &DviModel,
    plan: &Plan,
    settings: &Settings,
    analysis: &Analysis,
    control: &Control,
) -> Solution {
    let share = if plan.global_error { global_error::SHARE } else { 1.0 };
    let mut ended = control.part(0.0..share, || integrate_once(model, plan, settings, analysis, control));
    if ended.solution.status == Status::Completed {
        sensitivities::check(model, plan, settings, analysis, control, &mut ended);
    }
    if plan.global_error && ended.solution.status == Status::Completed {
        global_error::estimate(model, plan, settings, analysis, control, &mut ended);
    }
    ended.solution
}

/// Integrates a differential variational inequality once, without the further runs that check sensitivities and
/// estimate the global error.
pub(super) fn integrate_once(
    model: &DviModel,
    plan: &Plan,
    settings: &Settings,
    analysis: &Analysis,
    control: &Control,
) -> Ended {
    let mut diagnostics = describe(model.structure(), settings, analysis);
    if let Some(Warning { code, message }) = uniqueness_caveat(analysis) {
        diagnostics.checks.caveat(code, message);
    }
    if model.is_opaque() {
        let message = "the equations are functions whose values alone are known: what they do between the points examined, such as \
                       a feature much narrower than a step, is not seen; a smaller `max_step` may help";
        diagnostics.checks.caveat("rates_not_proven", message.to_owned());
    }
    let mut problem = model.problem();
    run_to_end(plan, control, diagnostics, || {
        let failed = |error| failure(plan, &model.kinks, &error, plan.start, &plan.initial);
        let mut radau = Radau::new(&mut *problem, settings.clone(), plan.start, &plan.initial, plan.end, control)
            .map_err(failed)?;
        // The active set at the start of the run is not a switch, and integrals begin after a jump at the start.
        radau.take_switches();
        radau.take_jumps();
        let balance = model.outputs.energy().map(|form| EnergyBalance::new(form.clone(), &radau));
        let audit = Audit::new(plan, model.has_kinks());
        let tolerances = (settings.rtol, settings.atol.as_slice());
        let lipschitz = LipschitzWatch::new(model, analysis, tolerances, (radau.t(), radau.y()));
        let rtol = settings.step.is_none().then_some(settings.rtol);
        let faces = FaceWatch::new(model.structure(), analysis);
        let orientations =
            OrientationWatch::new(model.structure(), analysis, (rtol.unwrap_or(0.0), settings.atol.as_slice()));
        let (kinks, outputs) = (&model.kinks, model.outputs.clone());
        let followed =
            plan.sensitivities.as_ref().map(|asked| Followed::new(model, plan, asked, tolerances)).transpose();
        let followed = followed.map_err(|why| sensitivities::failure(&why, plan.start, &plan.initial))?;
        Ok(RadauRun {
            followed,
            radau,
            jumps: Vec::new(),
            switches: Vec::new(),
            has_switched: false,
            plan,
            kinks,
            atol: &settings.atol,
            rtol,
            audit,
            outputs,
            balance,
            lipschitz,
            faces,
            orientations,
        })
    })
}

/// A run of a differential variational inequality by Radau IIA, with named outputs.
struct RadauRun<'p> {
    radau: Radau<'p>,
    /// The jumps of the states at the end of the last step.
    jumps: Vec<Jump>,
    /// The switches at the current time, which the next step may revoke (`switches`), and whether the last step has
    /// any switch (`has_switched`).
    switches: Vec<Switch>,
    has_switched: bool,
    followed: Option<Followed>,
    plan: &'p Plan,
    kinks: &'p KinkAdvice,
    atol: &'p [f64],
    /// The relative tolerance of the run; `None` for a fixed step size.
    rtol: Option<f64>,
    audit: Audit<'p>,
    outputs: Outputs,
    balance: Option<EnergyBalance>,
    lipschitz: Option<LipschitzWatch<'p>>,
    faces: Option<FaceWatch>,
    orientations: Option<OrientationWatch<'p>>,
}

impl RadauRun<'_> {
    /// Returns the time of a jump at the end of the last step, and the index of a state on whose rate the impulse
    /// acts differently at the states before and after the jump; `None` if there is no such jump.
    fn ambiguous_jump(&mut self) -> Option<(f64, usize)> {
        let Self { radau, jumps, plan, .. } = self;
        let n = plan.initial.len();
        jumps.iter().find_map(|jump| {
            let after = radau.y().to_vec();
            let problem = radau.problem();
            let mut values = vec![0.0; problem.structure().rows()];
            let mut rates = |states: &[f64], share: f64| {
                problem.evaluate(jump.behind, &jump.unknowns(&states[..n], share), &mut values);
                values[..n].to_vec()
            };
            let [before, behind] =
                [jump.before.as_slice(), &after].map(|states| [rates(states, 0.0), rates(states, 1.0)]);
            (0..n).find_map(|i| {
                let [before, behind] =
                    [&before, &behind].map(|[rest, moved]| (moved[i] - rest[i], moved[i].abs() + rest[i].abs()));
                let size = before.1.max(behind.1);
                ((before.0 - behind.0).abs() > SAME_IMPULSE * size).then_some((jump.t, i))
            })
        })
    }
}

/// Converts a switch of a variable to an event: the event is an activation if fewer equations fix the variable after
/// the switch than before it.
fn event(plan: &Plan, &Switch { t, variable, from, to }: &Switch) -> Event {
    let kind = if to.equations() < from.equations() { EventKind::Activated } else { EventKind::Deactivated };
    Event { t, kind, of: plan.names[plan.initial.len() + variable].clone() }
}

impl Stepper for RadauRun<'_> {
    fn t(&self) -> f64 {
        self.radau.t()
    }

    fn is_done(&self) -> bool {
        self.radau.is_done()
    }

    fn accepted(&self) -> u64 {
        self.radau.counts.accepted
    }

    fn states(&self) -> &[f64] {
        &self.radau.y()[..self.plan.initial.len()]
    }

    fn step(&mut self) -> Result<(), Failure> {
        let stepped = match &mut self.followed {
            Some(followed) => followed.step(&mut self.radau),
            None => self.radau.step().map(Ok),
        };
        self.jumps = self.radau.take_jumps();
        let followed = stepped.map_err(|error| {
            let mut failure = failure(self.plan, self.kinks, &error, self.t(), self.states());
            if let StepError::StepTooSmall { .. } | StepError::NewtonFailed { .. } | StepError::Unresolved { .. } =
                error
            {
                failure.message += &self.atol_below_rounding();
            }
            failure
        })?;
        followed.map_err(|why| sensitivities::failure(&why.to_string(), self.t(), self.states()))
    }

    fn derivatives(&mut self, t: f64, out: &mut [f64]) {
        if let Some(followed) = &mut self.followed {
            followed.write(&mut self.radau, t, out);
        }
    }

    fn gradient(&mut self) -> Option<Result<Gradient, Failure>> {
        let Self { followed: Some(followed), radau, plan, .. } = self else { return None };
        let gradient = followed.gradient(radau)?;
        let states = &radau.y()[..plan.initial.len()];
        Some(gradient.map_err(|why| sensitivities::failure(&why, radau.t(), states)))
    }

    fn values(&mut self, t: f64, out: &mut [f64]) {
        let unknowns = out.len() - self.outputs.names.len();
        self.radau.at(t, &mut out[..unknowns]);
        self.outputs.append(t, out);
    }

    fn outputs(&mut self, t: f64, out: &mut [f64]) {
        self.values(t, out);
        let unknowns = out.len() - self.outputs.names.len();
        self.audit.output(&mut self.radau, t, &out[..unknowns]);
    }

    fn enclose(&mut self, from: f64, to: f64, out: &mut [Interval]) -> bool {
        let ranges = self.radau.ranges_with_rounding(from, to);
        out.iter_mut().zip(ranges).for_each(|(out, range)| *out = range);
        true
    }

    fn tolerances(&self) -> Option<(f64, &[f64])> {
        Some((self.rtol?, self.atol))
    }

    fn impulses(&mut self) -> Vec<Impulse> {
        let Self { radau, jumps, outputs, plan, .. } = self;
        let n = plan.initial.len();
        let after = radau.y();
        let of = |jump: &Jump| {
            let mut at = |states: &[f64], share: f64| {
                let mut out = jump.unknowns(&states[..n], share);
                out.resize(plan.names.len(), 0.0);
                outputs.append(jump.behind, &mut out);
                out
            };
            let before = [0.0, 1.0].map(|share| at(&jump.before, share));
            Impulse { at: jump.t, t: jump.behind, before, after: [0.0, 1.0, 2.0].map(|share| at(after, share)) }
        };
        jumps.iter().map(of).collect()
    }

    fn mode(&mut self) -> Option<String> {
        let names = &self.plan.names[self.plan.initial.len()..];
        let mut mode = String::new();
        for (place, name) in self.radau.face().places.iter().zip(names) {
            let bound = match place {
                Activity::AtLower => ".lower",
                Activity::AtUpper => ".upper",
                Activity::Boundary(_) => ".boundary",
                Activity::Vertex => ".vertex",
                Activity::Inactive | Activity::Fixed => continue,
            };
            if !mode.is_empty() {
                mode.push(',');
            }
            mode.push_str(name);
            mode.push_str(bound);
        }
        Some(if mode.is_empty() { "free".to_owned() } else { mode })
    }

    fn take_events(&mut self, events: &mut Vec<Event>) {
        let (plan, n) = (self.plan, self.plan.initial.len());
        self.has_switched = !self.jumps.is_empty();
        for switch in self.radau.take_switches() {
            self.has_switched = true;
            // If a switch is reversed at the time at which it occurs, the active face between both was chosen by
            // rounding errors: both switches are removed.
            let is_undone = |last: &Switch| {
                last.t == switch.t
                    && last.variable == switch.variable
                    && last.from == switch.to
                    && last.to == switch.from
            };
            match self.switches.iter().rposition(is_undone) {
                Some(last) => _ = self.switches.remove(last),
                None => self.switches.push(switch),
            }
        }
        let (now, is_last) = (self.radau.t(), self.radau.is_done());
        events.extend(
            self.switches.extract_if(.., |switch| is_last || switch.t < now).map(|switch| event(plan, &switch)),
        );
        let states = self.radau.y();
        for jump in &self.jumps {
            let moved = (0..n).filter(|&i| self.radau.is_beyond_tolerance(i, states[i] - jump.before[i]));
            events.extend(moved.map(|i| Event { t: jump.t, kind: EventKind::Jumped, of: plan.names[i].clone() }));
        }
    }

    fn last_events(&mut self, events: &mut Vec<Event>) {
        let plan = self.plan;
        events.extend(self.switches.drain(..).map(|switch| event(plan, &switch)));
    }

    fn observe(&mut self, _: bool, diagnostics: &mut Diagnostics) {
        let switched = self.has_switched;
        if let Some((t, state)) = self.ambiguous_jump() {
            let name = &self.plan.names[state];
            diagnostics.checks.record(CheckCode::LocalError, f64::INFINITY, 1.0, || {
                format!(
                    "states jump at t = {t:?} by an impulse whose effect on `{name}` depends on states that jump with it: how far \
                     depends on how the bound moves meanwhile; let it move fast and not at once, as `max(0, min(1, (t - 1)*1e4))` for \
                     `heaviside(t - 1)`"
                )
            });
        }
        self.audit.step(&mut self.radau);
        judge(&mut self.radau, self.plan, switched, diagnostics);
        if let Some(balance) = &mut self.balance {
            balance.step(&mut self.radau);
        }
        if let Some(watch) = &mut self.lipschitz {
            watch.observe(self.radau.t(), self.radau.y());
        }
        if let Some(watch) = &mut self.orientations {
            watch.observe(&mut self.radau, switched);
        }
        if let Some(watch) = &mut self.faces {
            let met = diagnostics.faces.last().filter(|face| face.t == self.radau.t());
            watch.observe(&mut self.radau, switched, met.map(|face| &face.analysis));
        }
    }

    fn finish(&mut self, diagnostics: &mut Diagnostics) {
        count(&mut self.radau, self.plan, diagnostics);
        warn_of_small_states(self.plan, self.atol, &self.radau, diagnostics);
        if let Some(rtol) = self.rtol.filter(|_| self.radau.is_done()) {
            let accepted = diagnostics.steps.accepted;
            runaway::check(&self.radau, self.plan, (rtol, self.atol), accepted, &mut diagnostics.checks);
        }
        diagnostics.screening = self.audit.finish(&self.radau, self.atol, &mut diagnostics.checks);
        if let Some(balance) = &self.balance {
            diagnostics.energy = Some(balance.energy);
            balance.judge(&self.radau, self.rtol, self.atol, &mut diagnostics.checks);
        }
        if let Some(watch) = &self.lipschitz {
            watch.finish(diagnostics);
        }
        if let Some(watch) = &self.faces {
            watch.finish(diagnostics);
        }
        if let Some(watch) = &self.orientations {
            watch.finish(diagnostics);
        }
    }
}

impl RadauRun<'_> {
    /// Returns advice about a state whose absolute tolerance is below the rounding errors of its values; empty if
    /// there is none.
    fn atol_below_rounding(&self) -> String {
        let states = self.plan.names.iter().zip(self.atol).zip(self.radau.largest());
        let excess = |((_, atol), largest): &((&String, &f64), &f64)| f64::EPSILON * **largest / **atol;
        let worst = states.max_by(|a, b| excess(a).total_cmp(&excess(b)));
        match worst.filter(|worst| excess(worst) > 1.0) {
            Some(((name, atol), largest)) => format!(
                "; the absolute tolerance {atol:e} of `{name}` is below the rounding of its values, which reached \
                 {largest:e}: give an `atol` of `rtol` times the values of interest"
            ),
            None => String::new(),
        }
    }
}

/// Adds the values at the end of a step to the diagnostics as evidence; after a switch, also the analysis of the new
/// active face.
fn judge(radau: &mut Radau<'_>, plan: &Plan, switched: bool, diagnostics: &mut Diagnostics) {
    let smooth = radau.kept_face() && !switched && radau.problem().structure().moving.is_empty();
    if let Some(Variables { set, bounded, z, g }) = radau.variables() {
        let certificates = diagnostics.complementarity.get_or_insert_default();
        certificates.observe(set, bounded, z, g, smooth);
        if let Some(vi) = &mut diagnostics.vi {
            vi.largest_residual = certificates.natural_map;
        }
    }
    // Sweeps do not report the active faces of their members, so that only `FaceWatch` analyses faces, for the check
    // of uniqueness.
    if switched && diagnostics.faces.len() < MOST_FACES && plan.reducers.is_none() {
        let n = plan.initial.len();
        let (t, face) = (radau.t(), radau.face().clone());
        let names = |kind: fn(Activity) -> bool| -> Vec<String> {
            let places = face.places.iter().enumerate().filter(|(_, place)| kind(**place));
            places.map(|(k, _)| plan.names[n + k].clone()).collect()
        };
        let inside = names(|place| place == Activity::Inactive);
        let on_boundary = names(|place| matches!(place, Activity::Boundary(_)));
        if diagnostics.faces.iter().all(|known| (&known.inside, &known.on_boundary) != (&inside, &on_boundary)) {
            diagnostics.faces.push(Face { t, inside, on_boundary, analysis: analysis_of_face(radau) });
        }
    }
}

pub(super) fn failure(plan: &Plan, kinks: &KinkAdvice, error: &StepError, time: f64, state: &[f64]) -> Failure {
    let message = match *error {
        StepError::NotFinite { what, component, t } => {
            let n = plan.initial.len();
            let name = match what {
                "rate" | "derivative of the rate" => plan.names.get(component),
                "inequality" | "derivative of the inequality" => plan.names.get(n + component),
                _ => None,
            };
            match name {
                Some(name) => format!(
                    "the {what} of `{name}` is not finite at t = {t:?}: a division by zero, a function outside its \
                     domain, or a number too large"
                ),
                None => error.to_string(),
            }
        }
        StepError::EmptySet { variable, side, t } => {
            let (set, why) = side.emptiness();
            let name = plan.names.get(plan.initial.len() + variable).map_or("?", String::as_str);
            format!("the {set} of `{name}` is empty from t = {t:?} on: {why}")
        }
        StepError::NoSolution { variable, t, linear } => {
            let name = plan.names.get(plan.initial.len() + variable).map_or("?", String::as_str);
            if linear {
                format!(
                    "the variational inequality has no solution at t = {t:?}: the inequality of `{name}` is violated \
                     for all values of the variables. `G` must increase with `{name}` (D or CB positive definite): \
                     check its sign, and whether the initial values satisfy it"
                )
            } else {
                format!(
                    "no solution of the variational inequality was found at t = {t:?}: the linearised inequality of \
                     `{name}` is violated for all values of the variables. Either there is none (check the sign of the \
                     inequality, and whether the states satisfy it), or Newton's method started too far from it: write \
                     the inequality so that it is closer to linear in `{name}`"
                )
            }
        }
        StepError::Unresolved { t, variable } => format!(
            "`{}` switches repeatedly from t = {t:?} on, while the values that decide it stay below the resolution of \
             the tolerances: an accumulation of switches that could not be stepped over. Choose another `stages`, or \
             an `rtol` and `atol` for which the states that decide the switch and those that it drives are resolved \
             equally well",
            plan.names.get(plan.initial.len() + variable).map_or("?", String::as_str)
        ),
        StepError::Chattering { t, kink } => {
            let name = kinks.names.get(kink).map_or("a function with a kink", String::as_str);
            let instead = match &kinks.as_set {
                Some(problem) => {
                    format!("this `problem` has the same solution, and can be integrated along the jump: {problem}")
                }
                None => {
                    "write the function as a variable in a set, or the rates on either side as a `filippov` problem"
                        .into()
                }
            };
            format!(
                "{name} makes the rates jump where its argument changes sign; from t = {t:?} on the solution slides \
                 along the jump, and the steps chatter across it: {instead}"
            )
        }
        StepError::InconsistentStart { state, jump } => format!(
            "the start is inconsistent: the constraints require a jump of `{}` by {jump:e}",
            plan.names.get(state).map_or("?", String::as_str)
        ),
        _ => error.to_string(),
    };
    Failure { code: error.code().into(), message, time, state: state.to_vec() }
}

/// Returns the diagnostics of a differential variational inequality known before the run: structural analysis,
/// components built, and components left out with reasons.
pub fn describe(structure: &Structure, settings: &Settings, analysis: &Analysis) -> Diagnostics {
    let bounded = (0..structure.variables).any(|k| !structure.set.is_free(k)) || !structure.moving.is_empty();
    let mut diagnostics = Diagnostics {
        method: "radau",
        built: vec!["radau"],
        analysis: Some(analysis.clone()),
        ..Diagnostics::default()
    };
    if structure.has_impulses() && analysis.unbounded_index == Some(2.0) && !structure.constant_jacobian {
        let message = "the index at the start is 2 (CB = 0): a state may cross a bound, but where it reaches one and \
                       stays on it, other states jump; only implicit Euler handles that (`\"stages\": 1` with a fixed \
                       `step`)";
        diagnostics.warnings.push(Warning { code: "index_two", message: message.to_owned() });
    }
    let mut leave = |what: &str| diagnostics.left_out.push(what.to_owned());
    if structure.variables == 0 {
        leave("variational inequality: there are no variables");
    } else if !bounded {
        leave("variational inequality: every variable is free, so G = 0");
        leave("switch detection: K is the whole space");
    }
    if structure.mass == Mass::Identity {
        leave("mass matrix: it is the identity");
    }
    if structure.constant_jacobian {
        leave("new Jacobians: the problem is linear");
    }
    if settings.step.is_some() {
        leave("error estimate: the step is fixed");
    }
    if bounded {
        diagnostics.built.push("variational inequality");
        diagnostics.vi = Some(ViCounts::default());
        match settings.switches {
            Switches::Locate => diagnostics.built.push("switch detection"),
            Switches::StepOver => {
                diagnostics.left_out.push("switch detection: `switches` is `step_over`".to_owned());
            }
        }
    }
    if settings.stages == StageChoice::Auto {
        diagnostics.built.push("order selection");
    }
    diagnostics
}

/// Adds a warning about states that hardly exceed their absolute tolerance.
fn warn_of_small_states(plan: &Plan, atol: &[f64], radau: &Radau<'_>, diagnostics: &mut Diagnostics) {
    let largest = radau.largest();
    let states =
        states_above_zero(radau, atol).into_iter().map(|state| (&plan.names[state], atol[state], largest[state]));
    let small = states.filter(|(_, atol, largest)| *largest < SMALL * atol);
    if let Some((name, atol, largest)) = small.min_by(|a, b| (a.2 / a.1).total_cmp(&(b.2 / b.1))) {
        diagnostics.warnings.push(Warning {
            code: "below_tolerance",
            message: format!(
                "`{name}` was never larger than {largest:e}, with an absolute tolerance of {atol:e}: give an `atol` \
                 far below the values of interest"
            ),
        });
    }
}

/// Copies the counters of a run of Radau IIA to the diagnostics.
fn count(radau: &mut Radau<'_>, plan: &Plan, diagnostics: &mut Diagnostics) {
    let (counts, work) = (radau.counts, radau.work());
    diagnostics.stages = radau.stages();
    diagnostics.steps = Steps {
        accepted: counts.accepted,
        rejected: RejectionCause::ALL.into_iter().map(|cause| counts.rejected(cause)).sum(),
        rejected_for: RejectionCause::ALL
            .into_iter()
            .map(|cause| (cause.name(), counts.rejected(cause)))
            .filter(|(_, times)| *times > 0)
            .collect(),
    };
    diagnostics.evaluations =
        Evaluations { rates: work.rates, jacobians: work.jacobians, factorisations: work.factorisations };
    diagnostics.newton_iterations = work.newton;
    diagnostics.newton_contraction = work.contraction.summary().map(|(mean, largest)| Contraction { mean, largest });
    if let (Some(counts), Some(work)) = (&mut diagnostics.vi, radau.vi_work()) {
        (counts.solver, counts.solves, counts.pivots) = work;
        let tried = |(attempt, times): (Attempt, u64)| Tried {
            solver: attempt.solver.name(),
            outcome: attempt.outcome.name(),
            times,
        };
        counts.tried = radau.vi_failures().map(tried).collect();
    }
    if let Some(t) = radau.jumped() {
        diagnostics.warnings.push(Warning {
            code: if t == plan.start { "initial_jump" } else { "jump" },
            message: format!(
                "the state at t = {t:?} violates the inequalities; it jumped there, by the impulse x+ = x + B p \
                 with p in K complementary to G(x+)"
            ),
        });
    }
    if radau.accumulations() > 0 {
        diagnostics.warnings.push(Warning {
            code: "switches_accumulate",
            message: format!(
                "switches accumulated ({} times); the run stepped over each accumulation with the variational \
                 inequality at every stage and without locating them",
                radau.accumulations()
            ),
        });
    }
}
