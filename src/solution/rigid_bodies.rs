//! Integration of rigid bodies by time stepping or with located impacts, with named outputs.

use super::astray::Astray;
use super::longer_run::{LongerRun, TimeStepped};
use super::longer_steps::{KNOWN_ENERGY, Kind, MOST_COMPARED, not_compared};
use super::mechanical_checks::{Accuracy, LARGEST_PART, check_energy};
use super::run::{Plan, Stepper, run};
use super::unseen_actions::UnseenAction;
use super::unseen_friction::UnseenFriction;
use super::unseen_motion::UnseenMotion;
use super::unseen_signals::UnseenSignals;
use super::{CheckCode, Checks, Diagnostics, Event, Failure, Solution, ViCounts, Warning};
use analysis::Analysis;
use contact::Settings;
use contact::energy::Energy;
use contact::law::worse_of;
use models::rigid_bodies::{
    Action, Arc, Body, Law, MoreauStepping, Motion, MultibodySystem, NewEvent, OF_BODY, OF_SCENE, StepFailure, between,
    state_of,
};
use nalgebra::{Quaternion, Vector3};
use problem::Control;

/// Largest permitted error of a body's motion, relative to its largest value: two digits. Rigid bodies in space are
/// stepped at first order, so that each further digit costs ten times as many steps, and no other method is
/// available.
const TWO_DIGITS: f64 = 1e-2;

/// Relative rounding error of the positions and velocities of a body, relative to its distance from the origin and
/// its speed.
const ROUNDING_OF_BODIES: f64 = 1e-12;

/// How the steps of rigid bodies treat impacts: located in time, or passed over by time stepping.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Impacts {
    /// Whether impacts are located in time; otherwise steps pass over them (time stepping).
    pub are_located: bool,
    /// Whether time stepping replaces location where impacts are many.
    pub unless_many: bool,
    /// Whether the problem permits the location of impacts.
    pub can_be_located: bool,
    /// The reason for the choice between location and time stepping.
    pub because: &'static str,
}

/// Integrates the rigid bodies of a scene according to the plan.
pub fn step_rigid_bodies(
    scene: &MultibodySystem,
    plan: &Plan,
    (settings, impacts): (&Settings, Impacts),
    analysis: &Analysis,
    control: &Control,
) -> Solution {
    let diagnostics = describe_rigid_bodies(scene, (settings, impacts), analysis);
    run(plan, control, diagnostics, || RigidBodyRun::new(scene, plan, (settings, impacts), control))
}

/// Returns the diagnostics of rigid bodies known before the run: components built, and components left out with
/// reasons.
pub fn describe_rigid_bodies(
    scene: &MultibodySystem,
    (settings, impacts): (&Settings, Impacts),
    analysis: &Analysis,
) -> Diagnostics {
    let stepping = if impacts.are_located { "location of impacts" } else { "time stepping" };
    let mut diagnostics = Diagnostics {
        method: "contact",
        built: vec![stepping, "collisions", "law of impact", "islands"],
        analysis: Some(analysis.clone()),
        vi: Some(ViCounts::default()),
        ..Diagnostics::default()
    };
    let parts = [
        ("friction", scene.laws.any(Law::is_rough), "no pair of materials has a coefficient"),
        ("restitution", scene.laws.any(|law| law.restitution > 0.0), "every coefficient is zero"),
        ("joints", !scene.joints.is_empty(), "there are none"),
        ("midpoint rule", !scene.joints.is_empty(), "there are no joints"),
        ("resolution of overlaps at the start", scene.resolve, "`interpenetration` is `refuse`"),
    ];
    for (part, needed, reason) in parts {
        if needed {
            diagnostics.built.push(part);
        } else {
            diagnostics.left_out.push(format!("{part}: {reason}"));
        }
    }
    let left_out = if impacts.are_located { "time stepping" } else { "location of impacts" };
    diagnostics.left_out.push(format!("{left_out}: {}", impacts.because));
    if settings.default_step {
        let message = format!("no `step` was given: {stepping} takes steps of {}", settings.step);
        diagnostics.warnings.push(Warning { code: "default_step", message });
    }
    diagnostics
}

/// A run of rigid bodies with named outputs.
struct RigidBodyRun<'a> {
    scene: &'a MultibodySystem,
    simulation: MoreauStepping<'a>,
    plan: &'a Plan,
    control: &'a Control,
    h: f64,
    steps: u64,
    /// The current time, and the time at the beginning of the last step.
    t: f64,
    before: f64,
    /// The motions of moving bodies when the last step began, and whether contact forces acted on each body in
    /// the step before.
    starts: Vec<Motion>,
    pushed: Vec<bool>,
    states: Vec<f64>,
    /// Outputs of joints at the ends of the last two steps, and whether each output is a coordinate or a force.
    forces: [Vec<f64>; 2],
    coordinates: Vec<bool>,
    energy: Energy,
    /// The energy balance at the beginning of the last step.
    energy_before: Energy,
    work: ViCounts,
    /// Number of steps in which a coefficient of restitution was reduced.
    limited: u64,
    /// Number of steps that were subdivided because they were too long for the joints.
    halved: u64,
    /// Number of Newton iterations in implicit steps, such as those of bodies with joints.
    newton: u64,
    /// Number of steps with located impacts in time of which the last part was made by time stepping, without location.
    passed: u64,
    /// Number of contact events of the run so far.
    events: usize,
    checks: Checks,
    longer: Option<Box<LongerRun<Self>>>,
    /// Estimates of the variations of time-dependent forces between the midpoints of steps.
    unseen: Vec<UnseenAction>,
    /// Estimate of the motion of bodies with a prescribed motion between the ends of steps.
    unseen_motion: Option<UnseenMotion>,
    /// Estimate of the integrals of motors and prescribed velocities that steps miss.
    unseen_signals: Option<UnseenSignals>,
    /// Estimate of the variations of friction coefficients between the ends of steps.
    unseen_friction: Option<UnseenFriction>,
    /// The errors of the motions due to impacts, if the run is compared with a run with longer steps.
    astray: Option<Astray>,
    /// Outputs of the joints at the end of the step before the last one.
    forces_before: Vec<f64>,
    /// Whether the run is compared with another run with longer steps.
    is_compared: bool,
    /// Beginnings and ends of the smooth arcs between located impacts, as far as they have not been compared with
    /// those of the other run.
    arcs: Vec<[f64; 2]>,
}

/// Returns the user's time after a number of steps of size `h`, avoiding a last step that would be zero up to rounding.
fn end_of_step(plan: &Plan, h: f64, steps: u64) -> f64 {
    let end = plan.start + steps as f64 * h;
    if end >= plan.end - 1e-9 * h { plan.end } else { end }
}

impl<'a> RigidBodyRun<'a> {
    fn new(
        scene: &'a MultibodySystem,
        plan: &'a Plan,
        (settings, impacts): (&Settings, Impacts),
        control: &'a Control,
    ) -> Result<Self, Failure> {
        let begin = || {
            let mut simulation = MoreauStepping::new(scene, plan.start, settings);
            simulation.most_memory = plan.most_memory;
            if impacts.are_located {
                simulation.locate_impacts(impacts.unless_many.then_some(settings.step));
            }
            let failed = |cause| failure(&cause, scene, plan, plan.start, &plan.initial);
            if scene.resolve && !simulation.resolve(control).map_err(failed)? {
                let message = "the bodies overlap at the start, and could not be moved apart".to_owned();
                return Err(Failure {
                    code: "interpenetration".into(),
                    message,
                    time: plan.start,
                    state: plan.initial.clone(),
                });
            }
            Ok(simulation)
        };
        let simulation = begin()?;
        let is_compared = simulation.ends.len() <= MOST_COMPARED;
        let mut course = Self::of(scene, plan, settings, control, simulation);
        course.unseen_signals = UnseenSignals::of(scene);
        if is_compared {
            let mut longer = Self::of(scene, plan, settings, control, begin()?);
            (course.is_compared, longer.is_compared) = (true, true);
            if impacts.are_located {
                course.simulation.record_impacts();
                longer.simulation.record_impacts();
            } else {
                course.simulation.record_parts();
            }
            course.unseen = UnseenAction::all(scene);
            course.unseen_motion = UnseenMotion::of(scene);
            course.unseen_friction = UnseenFriction::of(scene);
            course.astray = Some(Astray::new(course.starts.len(), impacts.are_located));
            let mut longer = LongerRun::new(longer, plan, settings.default_step);
            if impacts.can_be_located && !impacts.are_located {
                longer.comparison.remedy =
                    "give a smaller `step`, or set `impacts` to `locate`, which is of second order";
            }
            course.longer = Some(Box::new(longer));
        }
        Ok(course)
    }

    /// Creates a run of rigid bodies from a prepared simulation, without a comparison with longer steps.
    fn of(
        scene: &'a MultibodySystem,
        plan: &'a Plan,
        settings: &Settings,
        control: &'a Control,
        simulation: MoreauStepping<'a>,
    ) -> Self {
        let coordinates = simulation.coordinates();
        let mut course = Self {
            scene,
            starts: simulation.ends.clone(),
            pushed: simulation.pushed.clone(),
            simulation,
            plan,
            control,
            h: settings.step,
            steps: 0,
            t: plan.start,
            before: plan.start,
            states: vec![0.0; plan.initial.len()],
            forces: Default::default(),
            coordinates,
            energy: Energy::default(),
            energy_before: Energy::default(),
            work: ViCounts::default(),
            limited: 0,
            halved: 0,
            newton: 0,
            passed: 0,
            events: 0,
            checks: Checks::default(),
            longer: None,
            forces_before: Vec::new(),
            unseen: Vec::new(),
            unseen_motion: None,
            unseen_signals: None,
            unseen_friction: None,
            astray: None,
            is_compared: false,
            arcs: Vec::new(),
        };
        course.forces.iter_mut().for_each(|forces| course.simulation.forces(forces));
        let [kinetic, potential] = course.simulation.energies();
        course.energy = Energy::new(kinetic, potential);
        course.energy_before = course.energy;
        // Energy scale for bodies at rest: their weights times their sizes.
        let weight = |body: &Body| body.mass * scene.gravity.norm() * body.collider.reach();
        course.energy.meet(scene.bodies.iter().filter(|body| !body.fixed).map(weight).sum());
        course.write_states(plan.start);
        course
    }

    /// Adds the last step of the run to the energy balance and the counters.
    fn book(&mut self) {
        let report = &self.simulation.report;
        let [kinetic, potential] = self.simulation.energies();
        self.energy_before = self.energy;
        let before = self.energy.kinetic_at_end.max(report.kinetic);
        self.energy.dissipate(-report.work[1], -report.work[0], before);
        self.energy.lost_beyond_restitution -= report.elastic_work;
        self.energy.work(report.done.forces, report.done.drives);
        self.energy.dissipate_by_viscosity(report.done.damped);
        self.energy.close(kinetic, potential);
        self.work.solves += report.solves;
        self.work.pivots += report.iterations;
        self.work.largest_residual = self.work.largest_residual.max(report.residual);
        self.work.largest_proximal_residual = worse_of(self.work.largest_proximal_residual, report.proximal_residual);
        if report.solves > 0 {
            self.work.solver = report.solver;
        }
        self.newton += report.newton;
        self.limited += u64::from(report.is_limited);
        self.halved += u64::from(report.parts > 1 && self.simulation.arcs().is_empty());
        self.passed += u64::from(self.simulation.is_passed());
    }

    /// Estimates the energy error that the last step may explain: bodies under contact forces move at first order, and
    /// the work of their weight has the error `h/2 <m g, dv>`, since the scheme uses the velocity at one end of the
    /// step.
    fn explain(&mut self) {
        let (h, gravity) = (self.t - self.before, self.scene.gravity);
        let (mut error, mut exchanged) = (0.0, 0.0);
        let pushed = self.pushed.iter().zip(&self.simulation.pushed).map(|(before, now)| *before || *now);
        for ((from, to), pushed) in self.starts.iter().zip(&self.simulation.ends).zip(pushed) {
            let weight = h * from.mass * gravity;
            exchanged += weight.norm() * from.velocity.norm().max(to.velocity.norm());
            if pushed {
                error += 0.5 * weight.dot(&(to.velocity - from.velocity)).abs();
            }
        }
        self.energy.explain(error, exchanged);
    }

    /// Records checks of how far the last step violates the contact laws and the joints, and of what steps miss of the
    /// signals that drive joints and bodies.
    fn judge(&mut self) {
        if let Some(signals) = &mut self.unseen_signals {
            let (t, missed) = (self.t, signals.step([self.before, self.t], &self.scene.signals));
            self.checks.record(CheckCode::LocalError, missed, TWO_DIGITS, || {
                format!(
                    "up to t = {t:?} steps miss up to {missed:.1e} of the integral of a motor or of a prescribed \
                     velocity, which varies within a step; choose a smaller `step`"
                )
            });
        }
        let (report, t) = (&self.simulation.report, self.t);
        let remedy = "choose a smaller `step`";
        self.checks.record(CheckCode::LawResidual, report.residual, LARGEST_PART, || {
            format!(
                "the law of contact and friction was solved to a relative residual of {:.1e} at t = {t:?}: velocities \
                 are off by about as much; {remedy}",
                report.residual
            )
        });
        self.checks.record(CheckCode::ConstraintResidual, report.overlap, LARGEST_PART, || {
            format!(
                "bodies overlap by {:.1e} of the size of the smaller at t = {:?}: {remedy}",
                report.overlap, self.before
            )
        });
        if let Some(joint) = self.scene.joints.get(report.drifted) {
            self.checks.record(CheckCode::JointDrift, report.drift, LARGEST_PART, || {
                let name = |body: usize| self.scene.bodies[body].name.as_str();
                let other = joint.bodies.1.map_or("the world", name);
                format!(
                    "the joint of `{}` and `{other}` is violated by {:.1e} of their size, or radians, at t = {t:?}: \
                     {remedy}",
                    name(joint.bodies.0),
                    report.drift
                )
            });
        }
    }

    /// Converts an event of the last step to named bodies.
    fn event(&self, (kind, pair, t): &NewEvent) -> Event {
        let [first, second] = pair.map(|body| &self.scene.bodies[body].name);
        // The event belongs to the stop of a joint between a body and the world.
        let of = if pair[0] == pair[1] { first.clone() } else { format!("{first} and {second}") };
        Event { t: t.unwrap_or(self.t), kind: *kind, of }
    }

    /// Returns, for each moving body, the change of its velocities by impacts in the last step, times the step size.
    fn kinks(&self) -> Vec<(Vector3<f64>, Vector3<f64>)> {
        let (h, gravity) = (self.t - self.before, self.scene.gravity);
        let fall = h * gravity.norm();
        // The impulse of contacts that are closed throughout the step is at most that of the forces, and has no error
        // of timing; any further change of the velocity is due to impacts.
        let beyond = |change: Vector3<f64>, least: f64| {
            change.map(|change| h * (change.abs() - least).max(0.0).copysign(change))
        };
        let moving = self.scene.bodies.iter().filter(|body| !body.fixed);
        let motions = self.starts.iter().zip(&self.simulation.ends).zip(&self.simulation.pushed);
        let kink = |(body, ((before, after), pushed)): (&Body, ((&Motion, &Motion), &bool))| {
            if !pushed {
                return Default::default();
            }
            let by = beyond(after.velocity - before.velocity - h * gravity, fall);
            (by, beyond(after.omega - before.omega, fall / body.collider.reach()))
        };
        moving.zip(motions).map(kink).collect()
    }

    /// Writes the changes of the outputs by small displacements of the moving bodies, given as translations and
    /// rotations of their centres.
    fn displace(&self, by: &[(Vector3<f64>, Vector3<f64>)], out: &mut [f64]) {
        let moving = self.scene.bodies.iter().filter(|body| !body.fixed);
        let (of_bodies, others) = out.split_at_mut(self.states.len());
        let motions = self.simulation.ends.iter().zip(by);
        for ((body, (motion, (by, turn))), out) in moving.zip(motions).zip(of_bodies.chunks_exact_mut(13)) {
            let rotation = motion.pose.rotation;
            let turned = Quaternion::from_parts(0.0, 0.5 * turn) * rotation.into_inner();
            let place = by - turn.cross(&(rotation * body.centre));
            let turned = [turned.w, turned.i, turned.j, turned.k];
            out[..7].iter_mut().zip(place.iter().chain(&turned)).for_each(|(out, by)| *out = *by);
            others[1] -= motion.mass * self.scene.gravity.dot(by);
        }
        if by.iter().all(|(place, turn)| *place == Vector3::zeros() && *turn == Vector3::zeros()) {
            return;
        }
        let [before, now] = &self.forces;
        let joints = others.iter_mut().skip(OF_SCENE.len()).zip(&self.coordinates);
        for (k, (out, _)) in joints.enumerate().filter(|(_, (_, is_coordinate))| **is_coordinate) {
            // The second difference of the joint coordinate over the last two steps.
            *out = now[k] - 2.0 * before[k] + self.forces_before.get(k).copied().unwrap_or(before[k]);
        }
    }

    /// Returns the motions at a time within the last step, after the impacts at that time, and the work of contacts
    /// in the rest of the step, by normal and tangential components; `None` if the impacts of the step were not
    /// located.
    fn within(&self, t: f64) -> Option<(Vec<Motion>, [f64; 2])> {
        let passed = t - self.before;
        let of_arc = self.simulation.arcs().iter().rev().find(|arc| arc.times[0] <= passed);
        let (arc, all) = (of_arc.filter(|_| t < self.t)?, self.simulation.report.work);
        let done = arc.work_at(passed);
        Some((arc.at(passed, &self.scene.gravity), [0, 1].map(|k| all[k] - done[k])))
    }

    /// Returns the times at which a smooth arc of the last step, between two located impacts, begins and ends.
    fn ends_of(&self, arc: &Arc) -> [f64; 2] {
        arc.times.map(|passed| self.before + passed)
    }

    /// Writes the states of all moving bodies at a time within the last step.
    fn write_states(&mut self, t: f64) {
        let h = self.t - self.before;
        let fraction = if h > 0.0 { (t - self.before) / h } else { 1.0 };
        let moving = self.scene.bodies.iter().filter(|body| !body.fixed);
        if let Some((motions, _)) = self.within(t) {
            for ((body, motion), out) in moving.zip(motions).zip(self.states.chunks_exact_mut(13)) {
                out.copy_from_slice(&state_of(body, &motion));
            }
            return;
        }
        let motions = self.starts.iter().zip(&self.simulation.ends).zip(&self.simulation.pushed);
        for ((body, ((from, to), pushed)), out) in moving.zip(motions).zip(self.states.chunks_exact_mut(13)) {
            out.copy_from_slice(&between(body, [from, to], *pushed, h, fraction));
        }
    }
}

impl TimeStepped for RigidBodyRun<'_> {
    fn begin(&self) -> f64 {
        self.before
    }

    fn step_to(&mut self, next: f64) -> Result<(), Failure> {
        self.starts.clone_from(&self.simulation.ends);
        self.pushed.clone_from(&self.simulation.pushed);
        let stepped = self.simulation.step(self.t, next - self.t, self.control);
        if let Err(cause @ (StepFailure::TooMuchMemory { .. } | StepFailure::Interrupted)) = &stepped {
            // The step failed before it began: the state of the previous step remains valid.
            return Err(failure(cause, self.scene, self.plan, self.t, &self.states));
        }
        (self.before, self.t) = (self.t, next);
        if self.is_compared {
            self.arcs.extend(self.simulation.arcs().iter().map(|arc| arc.times.map(|passed| self.before + passed)));
        }
        self.forces_before.clone_from(&self.forces[0]);
        self.forces.swap(0, 1);
        self.simulation.forces(&mut self.forces[1]);
        self.steps += 1;
        self.write_states(next);
        self.book();
        self.explain();
        self.judge();
        stepped.map_err(|cause| failure(&cause, self.scene, self.plan, next, &self.states))
    }

    fn known_within(&self) -> usize {
        // The leading outputs, which are accurate within a step with located impacts, are the states and four energies.
        if self.simulation.arcs().is_empty() || self.simulation.is_passed() { 0 } else { self.states.len() + 4 }
    }

    fn kinds(&self) -> Vec<Kind> {
        use Kind::{Continuous, Jumping, OfStep, Residual};
        let of_body = |_| [[Continuous; 7].as_slice(), &[Jumping; 6]].concat();
        let mut kinds: Vec<Kind> = self.starts.iter().flat_map(of_body).collect();
        // Behaviour in time of kinetic and potential energy, friction losses, impact losses, number of contacts,
        // penetration and impulses.
        kinds.extend([Jumping, Continuous, Jumping, Jumping, Jumping, Residual, OfStep]);
        kinds.extend(self.coordinates.iter().map(|is_coordinate| if *is_coordinate { Continuous } else { Jumping }));
        kinds
    }

    fn vectors(&self) -> Vec<Vec<usize>> {
        let bodies = (0..self.starts.len()).map(|body| OF_BODY.len() * body);
        let of_body =
            |first: usize| [(0, 3), (3, 7), (7, 10), (10, 13)].map(|(from, to)| (first + from..first + to).collect());
        bodies.flat_map(of_body).collect()
    }

    fn resolve(&mut self, out: &mut [f64]) {
        let h = self.t - self.before;
        let kick = h * self.scene.gravity;
        let fall = kick.norm();
        let (of_bodies, others) = out.split_at_mut(self.states.len());
        let (mut energy, mut weight) = (0.0, 0.0);
        let moving = self.scene.bodies.iter().filter(|body| !body.fixed);
        let motions = self.simulation.ends.iter().zip(self.simulation.touched());
        for ((body, (motion, is_touched)), out) in moving.zip(motions).zip(of_bodies.chunks_exact_mut(13)) {
            let reach = body.collider.reach();
            // A body without contacts is moved by its forces alone, and its motion is resolved whatever its size.
            let fall = if *is_touched { fall } else { 0.0 };
            let spin = motion.omega.norm() * reach;
            let rounding = ROUNDING_OF_BODIES * (motion.pose.translation.vector.norm() + reach);
            // The origin of a body is a convention: if the origin rests while the body turns, the rotation times the
            // body's size is the scale.
            let turned = reach * body.pose.rotation.angle_to(&motion.pose.rotation);
            out[..3].fill((h * fall).max(rounding).max(turned));
            out[3..7].fill((0.5 * h * fall / reach).max(ROUNDING_OF_BODIES));
            out[7..10].fill(fall.max(ROUNDING_OF_BODIES * (motion.velocity.norm() + spin)));
            out[10..13].fill(fall.max(ROUNDING_OF_BODIES * (motion.velocity.norm() + spin)) / reach);
            energy += 0.5 * motion.mass * fall * fall;
            weight += motion.mass * self.scene.gravity.norm();
        }
        // Least scales of the errors of kinetic and potential energy, friction losses, impact losses, number of
        // contacts, penetration and impulses.
        let known = KNOWN_ENERGY * self.energy.size();
        let [lost, weighed] = [energy.max(known), (weight * h * fall).max(known)];
        let of_scene = [lost, weighed, lost, lost, 1.0, 0.0, weight];
        let (scene, joints) = others.split_at_mut(of_scene.len());
        scene.copy_from_slice(&of_scene);
        joints.fill(0.0);
    }

    fn strike(&mut self, out: &mut [f64]) -> bool {
        if !self.simulation.pushed.contains(&true) {
            return false;
        }
        let (h, mut by) = (self.t - self.before, self.kinks());
        for ((place, turn), misplaced) in by.iter_mut().zip(self.simulation.misplaced(h)) {
            *place *= misplaced / h;
            *turn *= misplaced / h;
        }
        self.simulation.confine(h, &mut by);
        self.displace(&by, out);
        true
    }

    fn hold(&mut self, out: &mut [f64]) {
        for (held, out) in self.simulation.held::<3>().iter().zip(out.chunks_exact_mut(OF_BODY.len())) {
            out.iter_mut().zip(held).for_each(|(out, held)| *out = if *held { 1.0 } else { 0.0 });
        }
    }

    fn mislead(&mut self, out: &mut [f64]) -> bool {
        let times = [self.t - self.before, self.t];
        let Some(astray) = &mut self.astray else { return false };
        astray.step(self.scene, &self.simulation, &self.starts, times);
        astray.displace(&self.simulation.ends, out)
    }

    fn reorder(&mut self, longer: &mut Self, out: &mut [f64]) -> bool {
        let Some(astray) = &mut self.astray else { return false };
        let ends = &self.simulation.ends;
        astray.compare(&longer.simulation, [longer.before, longer.t], (ends, self.t)) && astray.displace(ends, out)
    }

    fn bend(&mut self, out: &mut [f64]) -> bool {
        let by = self.kinks();
        self.displace(&by, out);
        by.iter().any(|by| *by != Default::default())
    }

    fn miss(&mut self, out: &mut [f64]) -> bool {
        let step = [self.before, self.t];
        let moves = |action: &&Action| action.bodies.first().is_some_and(|(body, _)| !self.scene.bodies[*body].fixed);
        let held = if self.unseen.is_empty() { Vec::new() } else { self.simulation.held::<6>() };
        for (unseen, action) in self.unseen.iter_mut().zip(self.scene.actions.iter().filter(moves)) {
            unseen.read(action, self.scene, &self.states);
            let motion = &self.simulation.ends[unseen.own];
            unseen.step(step, motion, (action.is_local, &action.at), &held[unseen.own]);
            unseen.displace(motion, &mut out[OF_BODY.len() * unseen.own..][..OF_BODY.len()]);
        }
        if let Some(motion) = &mut self.unseen_motion {
            motion.step([self.before, self.t], self.scene, &self.simulation);
            for ([place, velocity], out) in motion.displaced.iter().zip(out.chunks_exact_mut(OF_BODY.len())) {
                out[..3].iter_mut().for_each(|out| *out += place);
                out[7..10].iter_mut().for_each(|out| *out += velocity);
            }
        }
        if let Some(friction) = &mut self.unseen_friction {
            friction.step(step, &self.simulation);
            let bodies = self.simulation.ends.iter().enumerate();
            for ((body, motion), out) in bodies.zip(out.chunks_exact_mut(OF_BODY.len())) {
                friction.displace(body, motion, out);
            }
        }
        !self.unseen.is_empty() || self.unseen_motion.is_some() || self.unseen_friction.is_some()
    }

    fn events(&self) -> Vec<Event> {
        self.simulation.new_events.iter().map(|event| self.event(event)).collect()
    }

    fn exceed(&mut self, run: &mut Self, end: f64) {
        if let Some(made) = &mut run.simulation.made {
            made.hand_over(end, self.simulation.exceeded());
        }
    }

    fn repeats(&mut self, shorter: &mut Self) -> f64 {
        let over = shorter.arcs.partition_point(|[begin, _]| *begin < self.t);
        let others: Vec<[f64; 2]> = shorter.arcs.drain(..over).collect();
        self.arcs.clear();
        let of_arc = |arc: &Arc| {
            let [from, to] = self.ends_of(arc);
            let cubes = others.iter().map(|[begin, end]| (end.min(to) - begin.max(from)).max(0.0).powi(3));
            // Errors of second order grow with the third power of the length of an arc. The difference of two runs
            // bounds the error of one of them if the error of the other is at least twice as large.
            let is_repeated = !arc.is_exact && (to - from).powi(3) < 2.0 * cubes.sum::<f64>();
            if is_repeated { to - from } else { 0.0 }
        };
        self.simulation.report.repeated + self.simulation.arcs().iter().map(of_arc).sum::<f64>()
    }
}

impl Stepper for RigidBodyRun<'_> {
    fn t(&self) -> f64 {
        self.t
    }

    fn is_done(&self) -> bool {
        self.t >= self.plan.end
    }

    fn accepted(&self) -> u64 {
        self.steps
    }

    fn states(&self) -> &[f64] {
        &self.states
    }

    fn step(&mut self) -> Result<(), Failure> {
        let next = end_of_step(self.plan, self.h, self.steps + 1);
        self.step_to(next)?;
        if let Some(mut longer) = self.longer.take() {
            longer.follow(self);
            self.longer = Some(longer);
        }
        Ok(())
    }

    fn values(&mut self, t: f64, out: &mut [f64]) {
        let end = self.t;
        if t < end {
            self.write_states(t);
        }
        let (states, of_scene) = out.split_at_mut(self.states.len());
        states.copy_from_slice(&self.states);
        if t < end {
            self.write_states(end);
        }
        let report = &self.simulation.report;
        let h = self.t - self.before;
        let fraction = if h > 0.0 { ((t - self.before) / h).clamp(0.0, 1.0) } else { 1.0 };
        let within = |of: fn(&Energy) -> f64| {
            let [from, to] = [of(&self.energy_before), of(&self.energy)];
            if fraction == 1.0 { to } else { from + fraction * (to - from) }
        };
        let energies = match self.within(t) {
            Some((motions, [normal, tangential])) => {
                let [kinetic, potential] = self.simulation.energies_of(&motions);
                let Energy { dissipated_by_friction, lost_in_impacts, .. } = self.energy;
                [kinetic, potential, dissipated_by_friction + tangential, lost_in_impacts + normal]
            }
            None => [
                within(|energy| energy.kinetic_at_end),
                within(|energy| energy.potential_at_end),
                within(|energy| energy.dissipated_by_friction),
                within(|energy| energy.lost_in_impacts),
            ],
        };
        let [kinetic, potential, dissipated, lost] = energies;
        let values =
            [kinetic, potential, dissipated, lost, report.closed as f64, report.penetration, report.normal_impulse];
        let (of_scene, forces) = of_scene.split_at_mut(values.len());
        of_scene.copy_from_slice(&values);
        let [before, after] = &self.forces;
        for (k, force) in forces.iter_mut().enumerate() {
            *force = if self.coordinates[k] { before[k] + fraction * (after[k] - before[k]) } else { after[k] };
        }
    }

    fn take_events(&mut self, events: &mut Vec<Event>) {
        let new_events = &self.simulation.new_events;
        let room = MOST_EVENTS - self.events.min(MOST_EVENTS);
        self.events += new_events.len();
        events.extend(new_events.iter().take(room).map(|event| self.event(event)));
    }

    fn observe(&mut self, _switched: bool, diagnostics: &mut Diagnostics) {
        diagnostics.energy = Some(self.energy);
    }

    fn finish(&mut self, diagnostics: &mut Diagnostics) {
        diagnostics.steps.accepted = self.steps;
        diagnostics.newton_iterations = self.newton;
        if self.halved > 0 {
            diagnostics.steps.rejected = self.halved;
            diagnostics.steps.rejected_for.insert("joints", self.halved);
        }
        if self.work.largest_residual > UNSATISFACTORY {
            let message = format!(
                "the law of contact and friction was solved to a relative residual of {:e} at worst",
                self.work.largest_residual
            );
            diagnostics.warnings.push(Warning { code: "contact_residual", message });
        }
        if self.passed > 0 {
            let message = format!(
                "in {} of {} steps impacts followed each other so fast that time stepping, of first order, took the rest of the \
                 step; a smaller `step` may help",
                self.passed, self.steps
            );
            diagnostics.warnings.push(Warning { code: "impacts_passed", message });
        }
        if self.limited > 0 {
            let message = format!(
                "in {} steps the full restitution would have added energy; it was reduced to add none",
                self.limited
            );
            diagnostics.warnings.push(Warning { code: "restitution_limited", message });
        }
        if self.events > MOST_EVENTS {
            let message = format!(
                "there were {} events between bodies; the first {MOST_EVENTS} of them are reported",
                self.events
            );
            diagnostics.warnings.push(Warning { code: "events_left_out", message });
        }
        diagnostics.vi = Some(self.work.clone());
        diagnostics.checks = self.checks.clone();
        match self.longer.take() {
            Some(mut longer) => {
                longer.finish(self);
                longer.judge(TWO_DIGITS, &mut diagnostics.checks);
            }
            None => not_compared(
                &mut diagnostics.checks,
                &format!(
                    "more than {MOST_COMPARED} bodies move, and are not compared one by one with a run with longer steps"
                ),
            ),
        }
        check_energy(&self.energy, Accuracy::Fixed, &mut diagnostics.checks);
    }
}

/// Converts a failure of a step of rigid bodies at time `t` to a message with the user's names.
fn failure(cause: &StepFailure, scene: &MultibodySystem, plan: &Plan, t: f64, state: &[f64]) -> Failure {
    let (code, message) = match *cause {
        StepFailure::NotFinite { body } => {
            let name = &scene.bodies[body].name;
            ("not_finite", format!("the motion of `{name}` is not finite at t = {t}"))
        }
        StepFailure::Unsolved { residual } => (
            "contact_unsolved",
            format!(
                "the law of contact and friction was not solved at t = {t} (residual {residual:e}): a smaller step may help"
            ),
        ),
        StepFailure::Friction { bodies, mu, place: [x, y, z] } => {
            let [first, second] = bodies.map(|body| &scene.bodies[body].name);
            let message = format!(
                "the coefficient of friction of `{first}` and `{second}` is {mu} at t = {t:?}, where they touch at [{x:.4}, \
                 {y:.4}, {z:.4}]: write an expression that stays at 0 or more, such as max(0, ..)"
            );
            ("friction_negative", message)
        }
        StepFailure::Joints => ("joints", blocked(scene, t)),
        StepFailure::TooMuchMemory { contacts, most_touched, bytes } => {
            ("too_much_memory", too_much_memory(scene, plan, t, (contacts, most_touched, bytes)))
        }
        StepFailure::Interrupted => ("interrupted", format!("stopped at t = {t}")),
    };
    Failure { code: code.into(), message, time: t, state: state.to_vec() }
}

/// Returns the message for a step on which the joints, or the forces that depend on the motion of bodies, have no
/// solution.
fn blocked(scene: &MultibodySystem, t: f64) -> String {
    let drives = scene.joints.iter().any(|joint| joint.drive.is_some());
    let causes = [
        (drives, "a motor jumps, is not finite, or acts against an immovable constraint"),
        (!scene.actions.is_empty(), "a force is not finite, or grows too fast for any step"),
    ];
    let causes: Vec<&str> = causes.iter().filter(|(applies, _)| *applies).map(|(_, cause)| *cause).collect();
    if causes.is_empty() {
        return format!("the joints cannot all be satisfied at t = {t}");
    }
    format!(
        "no step to t = {t} was found, however short: the joints cannot all be satisfied, or {}",
        causes.join(", or ")
    )
}

/// Returns the message that contacts of bodies need too much memory; contacts were counted up to `contacts`.
fn too_much_memory(
    scene: &MultibodySystem,
    plan: &Plan,
    t: f64,
    (contacts, most_touched, bytes): (usize, Option<(usize, u32)>, usize),
) -> String {
    let bodies = scene.bodies.len();
    let most = plan.most_memory >> 20;
    let of_one = most_touched.map_or_else(String::new, |(body, contacts)| {
        let name = &scene.bodies[body].name;
        format!(", {contacts} of them on `{name}`: memory grows with the square of the contacts of one body")
    });
    format!(
        "the step from t = {t} needs at least {} MiB, and {most} MiB are allowed: there are at least {contacts} \
         contacts between {bodies} bodies{of_one}. Use fewer bodies, or more memory; contacts with a `fixed` body do \
         not couple other bodies",
        bytes.div_ceil(1 << 20)
    )
}

/// Largest number of reported events: a collapsing heap of bodies has more than a user reads.
const MOST_EVENTS: usize = 10_000;

/// A relative residual of the contact law above this value is reported as a warning.
const UNSATISFACTORY: f64 = 1e-6;
