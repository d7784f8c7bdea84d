//! Rigid bodies from start to end by time stepping, their outputs by name.

use super::run::{Plan, Stepper, run};
use super::{Diagnostics, Event, Failure, Solution, ViCounts};
use crate::analysis::Analysis;
use crate::models::rigid_bodies::{Scene, Simulation, StepFailure, between};
use crate::problem::Control;
use nalgebra::Isometry3;

/// Steps a scene through the plan with a fixed step `h`, in seconds.
pub fn step_rigid_bodies(scene: &Scene, plan: &Plan, h: f64, analysis: &Analysis, control: &Control) -> Solution {
    let diagnostics = describe_rigid_bodies(scene, analysis);
    run(plan, control, diagnostics, || Course::new(scene, plan, h, control))
}

/// What is known before the run.
pub fn describe_rigid_bodies(scene: &Scene, analysis: &Analysis) -> Diagnostics {
    let mut diagnostics = Diagnostics {
        method: "time_stepping",
        built: vec!["time_stepping", "contact law", "islands"],
        analysis: Some(analysis.clone()),
        vi: Some(ViCounts { solver: "coulomb", ..ViCounts::default() }),
        ..Diagnostics::default()
    };
    if scene.joints.is_empty() {
        diagnostics.left_out.push("joints: there are none".to_owned());
    } else {
        diagnostics.built.push("joints");
    }
    diagnostics
}

/// A run with the names that its columns go by.
struct Course<'a> {
    scene: &'a Scene,
    simulation: Simulation<'a>,
    plan: &'a Plan,
    control: &'a Control,
    h: f64,
    steps: u64,
    /// The time reached, and that of the step before.
    t: f64,
    before: f64,
    /// Where the bodies were then.
    poses: Vec<Isometry3<f64>>,
    states: Vec<f64>,
    /// Energy taken by normals and by tangents.
    lost: [f64; 2],
}

impl<'a> Course<'a> {
    fn new(scene: &'a Scene, plan: &'a Plan, h: f64, control: &'a Control) -> Result<Self, Failure> {
        let mut simulation = Simulation::new(scene);
        if scene.resolve && !simulation.resolve(control) {
            let message = "the bodies overlap at the start, and there is no way found to move them apart".to_owned();
            return Err(Failure { code: "interpenetration", message, time: plan.start, state: plan.initial.clone() });
        }
        let mut course = Self {
            scene,
            poses: simulation.moving.iter().map(|motion| motion.pose).collect(),
            simulation,
            plan,
            control,
            h,
            steps: 0,
            t: plan.start,
            before: plan.start,
            states: vec![0.0; plan.initial.len()],
            lost: [0.0; 2],
        };
        course.write_states(plan.start);
        Ok(course)
    }

    /// Writes the states at a time within the last step.
    fn write_states(&mut self, t: f64) {
        let fraction = if self.t > self.before { (t - self.before) / (self.t - self.before) } else { 1.0 };
        let moving = self.scene.bodies.iter().filter(|body| !body.fixed);
        let parts = moving.zip(&self.poses).zip(&self.simulation.moving).zip(self.states.chunks_exact_mut(13));
        for (((body, from), to), out) in parts {
            out.copy_from_slice(&between(body, from, to, fraction));
        }
    }
}

impl Stepper for Course<'_> {
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
        // A last step within rounding of the end is none.
        let next = self.plan.start + (self.steps + 1) as f64 * self.h;
        let next = if next >= self.plan.end - 1e-9 * self.h { self.plan.end } else { next };
        self.poses.clear();
        self.poses.extend(self.simulation.moving.iter().map(|motion| motion.pose));
        let stepped = self.simulation.step(next - self.t, self.control);
        (self.before, self.t) = (self.t, next);
        self.steps += 1;
        self.write_states(next);
        for (lost, work) in self.lost.iter_mut().zip(self.simulation.report.work) {
            *lost -= work;
        }
        stepped.map_err(|failure| {
            let (code, message) = match failure {
                StepFailure::NotFinite { body } => {
                    let name = &self.scene.bodies[body].name;
                    ("not_finite", format!("the motion of `{name}` is not finite at t = {next}"))
                }
                StepFailure::Joints => ("joints", format!("the joints cannot all hold at t = {next}")),
            };
            Failure { code, message, time: next, state: Vec::new() }
        })
    }

    fn outputs(&mut self, t: f64, out: &mut [f64]) {
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
        let [impacts, friction] = self.lost;
        let values =
            [kinetic, potential, friction, impacts, report.closed as f64, report.penetration, report.normal_impulse];
        of_scene.copy_from_slice(&values);
    }

    fn take_events(&mut self, _events: &mut Vec<Event>) {}

    fn observe(&mut self, _switched: bool, diagnostics: &mut Diagnostics) {
        if let Some(vi) = &mut diagnostics.vi {
            vi.solves += self.simulation.report.islands as u64;
            vi.largest_residual = vi.largest_residual.max(self.simulation.report.residual);
        }
    }

    fn finish(&mut self, diagnostics: &mut Diagnostics) {
        diagnostics.steps.accepted = self.steps;
    }
}
