//! Steps of a scene: find the contacts, let forces act, solve each island, move.
//!
//! ```text
//! v_free = v + (h_last + h)/2 g,    v+ = v_free + M^-1 J^T r,    q+ = q (+) h v+
//! ```
//!
//! Velocities are those of the middles of steps, the first step after `h_last = 0`: this is the leapfrog, exact in free
//! fall, and at the end of a step bodies have the other half of the kick. A body that a contact holds has its velocity to
//! the end of the step, as friction and the contact left it, and `h_last = h`: of first order, as impacts are.
//!
//! Bodies that joints hold together, and those that touch them, move by the midpoint rule with the forces of the joints at
//! their means, of second order, and have the velocities of the ends of steps. Where the step is too long for them it is
//! halved.
//!
//! The contacts are those of the start of the step, with their gaps: an open one closes no further than to touch
//! (Stewart and Trinkle 1996). What curvature makes bodies overlap at the end is moved apart at the start of the next
//! step, without a velocity.

mod arrival;
mod detection;
mod forces;
mod overlaps;
mod partition;
mod report;
mod stops;

pub(super) use detection::NEAR;
pub use report::{ContactReport, StepFailure};

use super::collision::{BroadPhase, ContactPoint};
use super::contact::Contact;
use super::drive::{Drive, DriveState};
use super::island::{Carried, Island, Mechanism, Unsolved};
use super::joint::joined;
use super::load::Load;
use super::motion::Motion;
use super::prescribed::Prescribed;
use super::scene::MultibodySystem;
use super::touches::Touches;
use contact::islands::{Islands, threads};
use contact::law::Law;
use contact::{ImpactLaw, Settings};
use nalgebra::{Isometry3, Vector3};
use problem::{Control, EventKind};
use rustc_hash::FxHashMap;
use std::collections::HashSet;

/// Halvings of a step that is too long for the joints of a scene with contacts.
const HALVINGS: u32 = 16;

/// A residual of the contact law above this is no answer.
const UNSOLVED: f64 = 0.1;

/// A scene in motion.
#[derive(Debug)]
pub struct MoreauStepping<'a> {
    scene: &'a MultibodySystem,
    /// The bodies that move, with the velocities that the last step went with.
    moving: Vec<Motion>,
    /// The same with the velocities at its end.
    pub ends: Vec<Motion>,
    /// Whether a contact holds them there.
    held: Vec<bool>,
    /// Whether a contact pushed them in the last step, or what they are joined to.
    pub pushed: Vec<bool>,
    /// Whether a step was made.
    has_begun: bool,
    /// Which of them are in an island with joints.
    jointed: Vec<bool>,
    mechanism: Mechanism<'a>,
    /// What each linkage keeps.
    carried: Vec<Carried>,
    /// The places of the scene's bodies among them.
    places: Vec<Option<u32>>,
    /// Pairs of moving bodies that a force brings together, or the one that it acts on, with its place among all; in its order.
    acting: Vec<(u32, Option<u32>, u32)>,
    /// The time that the bodies have come to.
    t: f64,
    /// What contacts did in the last step to the bodies for which that is asked for: force and torque.
    contact_forces: Vec<(Vector3<f64>, Vector3<f64>)>,
    /// The bodies whose motion is given, and of each body of the scene its place among them.
    prescribed: Vec<Prescribed>,
    given: Vec<Option<u32>>,
    /// The contacts of the step.
    pub contacts: Vec<Contact>,
    /// What happened in the last step between which bodies of the scene.
    pub new_events: Vec<(EventKind, [usize; 2])>,
    touches: Touches,
    /// What the last step said.
    pub report: ContactReport,
    joined: HashSet<(u32, u32)>,
    broad_phase: BroadPhase,
    pairs: Vec<(u32, u32)>,
    points: Vec<ContactPoint>,
    /// Impulses of the last step, in the world, by contact.
    kept: FxHashMap<(u32, u32, u64), Vector3<f64>>,
    islands: Islands,
    tasks: Vec<Island>,
    impact_law: ImpactLaw,
    laws: Vec<Law>,
    load: Load,
    /// The bytes that contacts may take.
    pub most_memory: usize,
}

impl<'a> MoreauStepping<'a> {
    /// The scene at its start, the time `t`.
    pub fn new(scene: &'a MultibodySystem, t: f64, settings: &Settings) -> Self {
        let mut moving = Vec::new();
        let mut places = Vec::with_capacity(scene.bodies.len());
        for body in &scene.bodies {
            let motion = if body.fixed { None } else { Motion::new(body) };
            places.push(motion.map(|motion| {
                moving.push(motion);
                moving.len() as u32 - 1
            }));
        }
        let mut prescribed = Vec::new();
        let mut given = vec![None; scene.bodies.len()];
        for (k, body) in scene.bodies.iter().enumerate().filter(|(_, body)| body.motion.is_some()) {
            given[k] = Some(prescribed.len() as u32);
            prescribed.push(Prescribed::new(k, body.pose));
        }
        let mechanism = Mechanism::new(scene, &places, moving.len());
        let mut acting = Vec::new();
        for (k, action) in scene.actions.iter().enumerate() {
            let mut of = action.bodies.iter().filter_map(|(body, _)| places[*body]);
            let Some(own) = of.next() else { continue };
            acting.push((own, None, k as u32));
            acting.extend(of.map(|other| (own, Some(other), k as u32)));
        }
        Self {
            scene,
            ends: moving.clone(),
            held: vec![false; moving.len()],
            pushed: vec![false; moving.len()],
            has_begun: false,
            jointed: vec![false; moving.len()],
            carried: mechanism.linkages.iter().map(|of| Carried::of(of, scene)).collect(),
            mechanism,
            moving,
            places,
            acting,
            t,
            contact_forces: vec![Default::default(); scene.bodies.iter().filter(|body| body.tells_contacts).count()],
            prescribed,
            given,
            contacts: Vec::new(),
            new_events: Vec::new(),
            touches: Touches::default(),
            report: ContactReport::default(),
            joined: joined(&scene.joints),
            broad_phase: BroadPhase::default(),
            pairs: Vec::new(),
            points: Vec::new(),
            kept: FxHashMap::default(),
            islands: Islands::default(),
            tasks: Vec::new(),
            impact_law: settings.impact_law,
            laws: (0..threads()).map(|_| Law::new(settings.tolerance)).collect(),
            load: Load::of(scene),
            most_memory: usize::MAX,
        }
    }

    /// The pose of a body of the scene.
    pub fn pose(&self, body: usize) -> &Isometry3<f64> {
        match (self.places[body], self.given[body]) {
            (Some(place), _) => &self.moving[place as usize].pose,
            (None, Some(place)) => &self.prescribed[place as usize].pose,
            (None, None) => &self.scene.bodies[body].pose,
        }
    }

    /// The motion of a body of the scene; none if it is fixed.
    pub fn motion(&self, body: usize) -> Option<&Motion> {
        self.places[body].map(|place| &self.moving[place as usize])
    }

    /// Makes a step of length `h` from the time `t`.
    ///
    /// # Errors
    /// If the bodies cannot go on.
    pub fn step(&mut self, t: f64, h: f64, control: &Control) -> Result<(), StepFailure> {
        self.t = t;
        self.report = ContactReport::default();
        self.new_events.clear();
        self.contact_forces.fill(Default::default());
        self.advance(h, HALVINGS, control)?;
        self.contact_forces.iter_mut().for_each(|(force, torque)| (*force, *torque) = (*force / h, *torque / h));
        self.measure_joints();
        self.check()
    }

    /// Makes a step of length `h`, or halves of it where that is too long.
    fn advance(&mut self, h: f64, halvings: u32, control: &Control) -> Result<(), StepFailure> {
        for prescribed in &mut self.prescribed {
            if let Some(by) = &self.scene.bodies[prescribed.body].motion {
                prescribed.begin(by, &self.scene.signals, self.t, h);
            }
        }
        self.detect(h, control)?;
        self.report.penetration = self.report.penetration.max(self.depth(0.0));
        self.report.overlap = self.report.overlap.max(self.overlap());
        self.part_overlaps(h, control)?;
        if !self.has_begun {
            self.foresee(h);
            self.hold(|_| true);
            self.has_begun = true;
        }
        let (start, carried) = (self.moving.clone(), self.carried.clone());
        self.group();
        self.kick(h);
        let kinetic: f64 = self.moving.iter().map(Motion::kinetic_energy).sum();
        self.report.kinetic = self.report.kinetic.max(kinetic);
        self.remember();
        self.close();
        self.part();
        let report = self.report;
        let solved = self.solve_each(|island, mechanism, law| island.solve(h, mechanism, law, control));
        // Who stops it throws away what was left half-way.
        control.go_on()?;
        let poses: Vec<_> = self.prescribed.iter().map(|prescribed| prescribed.pose).collect();
        self.prescribed.iter_mut().for_each(|prescribed| prescribed.pose = prescribed.end);
        let is_too_long = solved == Err(Unsolved::TooLong) || self.meets_unseen(&start, h, control)?;
        if is_too_long && halvings > 0 {
            (self.moving, self.carried, self.report) = (start, carried, report);
            self.prescribed.iter_mut().zip(poses).for_each(|(prescribed, pose)| prescribed.pose = pose);
            self.advance(0.5 * h, halvings - 1, control)?;
            return self.advance(0.5 * h, halvings - 1, control);
        }
        solved.map_err(|_| StepFailure::Joints)?;
        let parts = self.tasks[..self.islands.len()].iter().map(|island| island.steps).max();
        self.report.parts += parts.unwrap_or(1).max(1);
        if self.report.residual > UNSOLVED {
            return Err(StepFailure::Unsolved { residual: self.report.residual });
        }
        self.follow(h);
        self.add_contact_forces();
        self.judge();
        self.hold(|contact| contact.impulse.x > 0.0);
        for ((motion, is_jointed), is_held) in self.moving.iter_mut().zip(&self.jointed).zip(&self.held) {
            if !is_jointed {
                motion.drift(h);
                motion.lag = if *is_held { 0.0 } else { 0.5 * h };
            }
        }
        self.arrive();
        self.t += h;
        Ok(())
    }

    /// Lets forces act on the velocities of bodies without joints.
    fn kick(&mut self, h: f64) {
        let gravity = self.scene.gravity;
        for ((motion, is_jointed), is_held) in self.moving.iter_mut().zip(&self.jointed).zip(&self.held) {
            if !is_jointed {
                motion.velocity += gravity * if *is_held { h } else { motion.lag + 0.5 * h };
            }
        }
    }

    /// Gives each contact the impulse that it had in the last step.
    fn remember(&mut self) {
        for contact in &mut self.contacts {
            if let Some(impulse) = self.kept.get(&contact.key) {
                contact.impulse = contact.frame * impulse;
            }
        }
    }

    /// Keeps the impulses, and says what the contacts did.
    fn judge(&mut self) {
        self.kept.clear();
        self.pushed.fill(false);
        let report = &mut self.report;
        let mut is_elastic = !report.is_limited;
        let mut work = 0.0;
        report.closed = 0;
        for contact in self.contacts.iter().filter(|contact| contact.impulse.x > 0.0) {
            let is_stop = contact.is_stop();
            self.kept.insert(contact.key, contact.frame.tr_mul(&contact.impulse));
            contact.bodies.iter().flatten().for_each(|&body| self.pushed[body as usize] = true);
            report.closed += usize::from(!is_stop);
            report.normal_impulse += if is_stop { 0.0 } else { contact.impulse.x };
            report.work[0] += contact.work.x;
            report.work[1] += contact.work.y + contact.work.z;
            work += contact.work.x;
            report.done.drives -= contact.impulse.dot(&contact.surface);
            is_elastic &= contact.law.restitution == 1.0;
        }
        if is_elastic {
            report.elastic_work += work;
        }
    }

    fn check(&self) -> Result<(), StepFailure> {
        let lost = |body: usize| match (self.places[body], self.given[body]) {
            (Some(place), _) => !self.moving[place as usize].is_finite(),
            (None, Some(place)) => {
                let pose = &self.prescribed[place as usize].pose;
                !(pose.translation.vector.sum() + pose.rotation.coords.sum()).is_finite()
            }
            (None, None) => false,
        };
        (0..self.places.len()).find(|&body| lost(body)).map_or(Ok(()), |body| Err(StepFailure::NotFinite { body }))
    }

    /// Kinetic and potential energy, the latter zero at the origin.
    pub fn energies(&self) -> [f64; 2] {
        let kinetic = self.ends.iter().map(Motion::kinetic_energy).sum();
        let height = |motion: &Motion| motion.mass * self.scene.gravity.dot(&motion.pose.translation.vector);
        let springs: f64 = self.drives().map(|(drive, state)| drive.potential(state.coordinate)).sum();
        [kinetic, springs - self.ends.iter().map(height).sum::<f64>()]
    }

    /// The drives of all joints and springs, with their states.
    fn drives(&self) -> impl Iterator<Item = (&Drive, &DriveState)> {
        self.mechanism.linkages.iter().zip(&self.carried).flat_map(|(linkage, carried)| {
            let drive = |(&joint, state)| Some((self.scene.joints[joint as usize].drive.as_ref()?, state));
            linkage.joints.iter().zip(&carried.states).filter_map(drive)
        })
    }
}
