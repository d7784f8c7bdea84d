//! Integration of rigid bodies by time stepping, with outputs by name.

use super::longer_steps::{Comparison, Kind, MOST_COMPARED, not_compared};
use super::mechanical_checks::{Accuracy, LARGEST_PART, check_energy};
use super::run::{Plan, Stepper, run};
use super::{CheckCode, Checks, Diagnostics, Event, Failure, Solution, ViCounts, Warning};
use analysis::Analysis;
use contact::Settings;
use contact::energy::Energy;
use contact::law::worse_of;
use models::rigid_bodies::{Body, Law, MoreauStepping, Motion, MultibodySystem, StepFailure, between};
use problem::Control;

/// Largest permitted error of a body's motion, relative to its largest value: two digits. Bodies in space are stepped at
/// first order, so that each further digit costs ten times as many steps, and there is no method to fall back on.
const TWO_DIGITS: f64 = 1e-2;

/// Steps the bodies through the plan.
pub fn step_rigid_bodies(
    scene: &MultibodySystem,
    plan: &Plan,
    settings: &Settings,
    analysis: &Analysis,
    control: &Control,
) -> Solution {
    let diagnostics = describe_rigid_bodies(scene, settings, analysis);
    run(plan, control, diagnostics, || RigidBodyRun::new(scene, plan, settings, control))
}

/// The diagnostics known before the run.
pub fn describe_rigid_bodies(scene: &MultibodySystem, settings: &Settings, analysis: &Analysis) -> Diagnostics {
    let mut diagnostics = Diagnostics {
        method: "contact",
        built: vec!["time stepping", "collisions", "law of impact", "islands"],
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
    if settings.default_step {
        let message = format!("no `step` was given: time stepping takes steps of {}", settings.step);
        diagnostics.warnings.push(Warning { code: "default_step", message });
    }
    diagnostics
}

/// A run with the names of its columns.
struct RigidBodyRun<'a> {
    scene: &'a MultibodySystem,
    simulation: MoreauStepping<'a>,
    plan: &'a Plan,
    control: &'a Control,
    h: f64,
    steps: u64,
    /// The current time, and that of the previous step.
    t: f64,
    before: f64,
    /// The motions at the previous time, and whether contacts were acting then.
    starts: Vec<Motion>,
    pushed: Vec<bool>,
    states: Vec<f64>,
    /// Outputs of joints at the ends of the last two steps, and which of them are coordinates (the others are forces).
    forces: [Vec<f64>; 2],
    coordinates: Vec<bool>,
    energy: Energy,
    work: ViCounts,
    /// Number of steps in which a restitution was reduced.
    limited: u64,
    /// Number of steps that were too long for the joints, and were subdivided.
    halved: u64,
    /// Number of Newton iterations.
    newton: u64,
    /// Number of events so far.
    events: usize,
    checks: Checks,
    longer: Option<LongerSteps<'a>>,
}

/// A run with steps twice as long.
struct LongerSteps<'a> {
    simulation: MoreauStepping<'a>,
    /// The number of its steps, the time that it has reached, and the length of its last step.
    steps: u64,
    t: f64,
    last: f64,
    /// For each moving body its position, orientation, velocity and angular velocity; then the energies.
    comparison: Comparison,
}

impl<'a> LongerSteps<'a> {
    fn new(scene: &MultibodySystem, plan: &Plan, simulation: MoreauStepping<'a>, is_default: bool) -> Self {
        let moving = scene.bodies.iter().filter(|body| !body.fixed);
        let quantities = moving.enumerate().flat_map(|(i, body)| {
            let (name, first) = (&body.name, 13 * i);
            [
                (format!("the position of `{name}`"), Kind::Position, first..first + 3),
                (format!("the orientation of `{name}`"), Kind::Position, first + 3..first + 7),
                (format!("the velocity of `{name}`"), Kind::Velocity, first + 7..first + 10),
                (format!("the angular velocity of `{name}`"), Kind::Velocity, first + 10..first + 13),
            ]
        });
        let energies = ["kinetic_energy", "potential_energy"].map(|energy| {
            let field = plan.names.iter().position(|name| name == energy).unwrap_or(plan.names.len());
            (format!("`{energy}`"), Kind::Energy, field..field + 1)
        });
        let comparison = Comparison::new(quantities.chain(energies), plan, is_default);
        Self { simulation, steps: 0, t: plan.start, last: 0.0, comparison }
    }

    /// Compares the end of the last step of a run, of length `length`, with this one.
    fn follow(&mut self, (starts, run): (&[Motion], &MoreauStepping<'_>), t: f64, length: f64, course: &Course<'_>) {
        let Course { scene, plan, h, energy, control } = course;
        let gravity = scene.gravity.norm();
        let kick = length * gravity;
        // Where the potential is zero is a convention; energies are no smaller than positions and velocities make them.
        let exchanged = energy.kinetic_at_end.max((energy.potential_at_end - energy.potential_at_start).abs());
        let mut least = [0.0, 0.0];
        let reaches = scene.bodies.iter().filter(|body| !body.fixed).map(|body| body.collider.reach());
        for (i, ((motion, before), reach)) in run.ends.iter().zip(starts).zip(reaches).enumerate() {
            self.comparison.meet(4 * i, motion.pose.translation.vector.norm().max(reach));
            // Quaternions are of length one, and differ by half the angle.
            self.comparison.meet(4 * i + 1, 1.0);
            self.comparison.meet(4 * i + 2, motion.velocity.norm().max(kick));
            self.comparison.meet(4 * i + 3, motion.omega.norm().max(kick / reach));
            least[0] += 0.5 * motion.mass * kick * kick;
            least[1] += motion.mass * gravity * reach;
            if run.pushed[i] {
                let change = motion.velocity - before.velocity - length * scene.gravity;
                self.comparison.strike(4 * i, change.norm(), kick, length);
                self.comparison.strike(
                    4 * i + 1,
                    0.5 * (motion.omega - before.omega).norm(),
                    0.5 * kick / reach,
                    length,
                );
            }
        }
        let first = 4 * run.ends.len();
        least.into_iter().enumerate().for_each(|(k, least)| self.comparison.meet(first + k, exchanged.max(least)));
        while self.comparison.goes_on() && self.t < t {
            let next = end_of_step(plan, *h, 2 * (self.steps + 1));
            let step = next - self.t;
            if let Err(cause) = self.simulation.step(self.t, step, control) {
                self.comparison.fail(failure(&cause, scene, plan, next, &[]).message);
                return;
            }
            (self.steps, self.t, self.last) = (self.steps + 1, next, step);
        }
        if self.t == t && self.comparison.goes_on() {
            self.compare(run, energy);
        }
    }

    fn compare(&mut self, run: &MoreauStepping<'_>, energy: &Energy) {
        self.comparison.pass(self.last);
        for (i, (a, b)) in run.ends.iter().zip(&self.simulation.ends).enumerate() {
            let distances = [
                (a.pose.translation.vector - b.pose.translation.vector).norm(),
                0.5 * a.pose.rotation.angle_to(&b.pose.rotation),
                (a.velocity - b.velocity).norm(),
                (a.omega - b.omega).norm(),
            ];
            for (k, distance) in distances.into_iter().enumerate() {
                self.comparison.differ(4 * i + k, distance, self.last);
            }
        }
        let first = 4 * run.ends.len();
        let of_run = [energy.kinetic_at_end, energy.potential_at_end];
        for (k, (a, b)) in of_run.into_iter().zip(self.simulation.energies()).enumerate() {
            self.comparison.differ(first + k, (a - b).abs(), self.last);
        }
    }
}

/// What a run and its comparison share.
struct Course<'a> {
    scene: &'a MultibodySystem,
    plan: &'a Plan,
    h: f64,
    energy: &'a Energy,
    control: &'a Control,
}

/// The time after a number of steps of size `h`, without a last step that would be zero up to rounding.
fn end_of_step(plan: &Plan, h: f64, steps: u64) -> f64 {
    let end = plan.start + steps as f64 * h;
    if end >= plan.end - 1e-9 * h { plan.end } else { end }
}

impl<'a> RigidBodyRun<'a> {
    fn new(
        scene: &'a MultibodySystem,
        plan: &'a Plan,
        settings: &Settings,
        control: &'a Control,
    ) -> Result<Self, Failure> {
        let begin = || {
            let mut simulation = MoreauStepping::new(scene, plan.start, settings);
            simulation.most_memory = plan.most_memory;
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
        let longer = if simulation.ends.len() <= MOST_COMPARED {
            Some(LongerSteps::new(scene, plan, begin()?, settings.default_step))
        } else {
            None
        };
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
            work: ViCounts::default(),
            limited: 0,
            halved: 0,
            newton: 0,
            events: 0,
            checks: Checks::default(),
            longer,
        };
        course.forces.iter_mut().for_each(|forces| course.simulation.forces(forces));
        let [kinetic, potential] = course.simulation.energies();
        course.energy = Energy::new(kinetic, potential);
        // Energy scale for bodies at rest: their weights times their sizes.
        let weight = |body: &Body| body.mass * scene.gravity.norm() * body.collider.reach();
        course.energy.meet(scene.bodies.iter().filter(|body| !body.fixed).map(weight).sum());
        course.write_states(plan.start);
        Ok(course)
    }

    /// Adds the last step to the energy balance and the counters.
    fn book(&mut self) {
        let report = &self.simulation.report;
        let [kinetic, potential] = self.simulation.energies();
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
        self.halved += u64::from(report.parts > 1);
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

    /// Records how far the last step violates the laws of contact and the joints.
    fn judge(&mut self) {
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

    /// Writes the states at a time within the last step.
    fn write_states(&mut self, t: f64) {
        let h = self.t - self.before;
        let fraction = if h > 0.0 { (t - self.before) / h } else { 1.0 };
        let moving = self.scene.bodies.iter().filter(|body| !body.fixed);
        let motions = self.starts.iter().zip(&self.simulation.ends).zip(&self.simulation.pushed);
        for ((body, ((from, to), pushed)), out) in moving.zip(motions).zip(self.states.chunks_exact_mut(13)) {
            out.copy_from_slice(&between(body, [from, to], *pushed, h, fraction));
        }
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
        self.starts.clone_from(&self.simulation.ends);
        self.pushed.clone_from(&self.simulation.pushed);
        let stepped = self.simulation.step(self.t, next - self.t, self.control);
        if let Err(cause @ (StepFailure::TooMuchMemory { .. } | StepFailure::Interrupted)) = &stepped {
            // The step was not made: the previous one remains valid.
            return Err(failure(cause, self.scene, self.plan, self.t, &self.states));
        }
        (self.before, self.t) = (self.t, next);
        self.forces.swap(0, 1);
        self.simulation.forces(&mut self.forces[1]);
        self.steps += 1;
        self.write_states(next);
        self.book();
        self.explain();
        self.judge();
        stepped.map_err(|cause| failure(&cause, self.scene, self.plan, next, &self.states))?;
        if let Some(longer) = &mut self.longer {
            let Self { scene, plan, h, energy, control, .. } = self;
            let course = Course { scene, plan, h: *h, energy, control };
            longer.follow((&self.starts, &self.simulation), self.t, self.t - self.before, &course);
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
        let [kinetic, potential] = self.simulation.energies();
        let report = &self.simulation.report;
        let Energy { dissipated_by_friction, lost_in_impacts, .. } = self.energy;
        let values = [
            kinetic,
            potential,
            dissipated_by_friction,
            lost_in_impacts,
            report.closed as f64,
            report.penetration,
            report.normal_impulse,
        ];
        let (of_scene, forces) = of_scene.split_at_mut(values.len());
        of_scene.copy_from_slice(&values);
        let h = self.t - self.before;
        let fraction = if h > 0.0 { ((t - self.before) / h).clamp(0.0, 1.0) } else { 1.0 };
        let [before, after] = &self.forces;
        for (k, force) in forces.iter_mut().enumerate() {
            *force = if self.coordinates[k] { before[k] + fraction * (after[k] - before[k]) } else { after[k] };
        }
    }

    fn take_events(&mut self, events: &mut Vec<Event>) {
        let new_events = &self.simulation.new_events;
        let room = MOST_EVENTS - self.events.min(MOST_EVENTS);
        self.events += new_events.len();
        events.extend(new_events.iter().take(room).map(|(kind, pair)| {
            let [first, second] = pair.map(|body| &self.scene.bodies[body].name);
            // A stop between a body and the world.
            let of = if pair[0] == pair[1] { first.clone() } else { format!("{first} and {second}") };
            Event { t: self.t, kind: *kind, of }
        }));
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
        match &self.longer {
            Some(longer) => longer.comparison.judge(TWO_DIGITS, &mut diagnostics.checks),
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

/// The failure at time `t`, with names.
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

/// The message if no step satisfies the joints, or the forces that depend on the motion of bodies.
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

/// The message about contacts that need too much memory; counting stopped at `contacts`.
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

/// Most reported events: a collapsing heap has more than anyone reads.
const MOST_EVENTS: usize = 10_000;

/// A residual above this value is reported as a warning.
const UNSATISFACTORY: f64 = 1e-6;
