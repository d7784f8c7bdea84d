//! Moreau-Jean time stepping of a multibody system: detect contacts, apply forces, solve each island, move bodies.
//!
//! ```text
//! v_free = v + (h_last + h)/2 g,    v+ = v_free + M^-1 J^T r,    q+ = q (+) h v+
//! ```
//!
//! The velocities `v` are those at the midpoints of steps, with `h_last = 0` before the first step: the scheme is the
//! leapfrog method, exact in free fall; at the end of a step bodies receive the other half of the velocity change by
//! gravity. A body in sustained contact keeps the velocity of the contact solve until the end of the step, and its
//! next velocity change by gravity has `h_last = h`: first order, as for impacts.
//!
//! Bodies with joints, and bodies in contact with them, move by the second-order midpoint rule with mean joint
//! forces, and have the velocities at the ends of steps. A step that is too long for the joint equations is halved.
//!
//! The contacts are those at the beginning of the step, with their gaps: an open contact closes at most to gap zero
//! (Stewart and Trinkle 1996). Overlaps at the end of a step due to curvature are resolved at the beginning of the
//! next step by displacements that do not change velocities.

mod arrival;
mod detection;
mod forces;
mod located;
mod misdirected;
mod overlaps;
mod partition;
mod report;
mod rubbing;
mod stops;

pub(super) use detection::NEAR;
pub use located::{Arc, Impact};
pub use report::{ContactReport, StepFailure};
pub use rubbing::Rubbing;

use super::collision::{BroadPhase, ContactPoint};
use super::contact::Contact;
use super::drive::{Drive, DriveState};
use super::island::{Carried, Island, Mechanism, Unsolved};
use super::joint::joined;
use super::load::Load;
use super::made_parts::{MadeParts, is_twice, may_try};
use super::motion::Motion;
use super::prescribed::{Ground, Prescribed};
use super::scene::MultibodySystem;
use super::touches::{NewEvent, Touches};
use contact::islands::{Islands, threads};
use contact::law::Law;
use contact::{ImpactLaw, Settings};
use located::Located;
use nalgebra::{Isometry3, Vector3};
use problem::Control;
use rustc_hash::FxHashMap;
use std::collections::HashSet;

/// Maximum number of halvings of a step that is too long for the equations of joints, in a system with contacts.
const HALVINGS: u32 = 16;

/// The residual of the contact law above which a time step fails.
const UNSOLVED: f64 = 0.1;

/// The Moreau-Jean time-stepping scheme for a multibody system, and its state.
#[derive(Debug)]
pub struct MoreauStepping<'a> {
    scene: &'a MultibodySystem,
    /// The moving bodies, with the velocities that have moved their positions in the last step.
    moving: Vec<Motion>,
    /// The moving bodies, with positions and velocities at the end of the last step.
    pub ends: Vec<Motion>,
    /// For each moving body, whether it is in sustained contact.
    held: Vec<bool>,
    /// For each moving body, whether a contact impulse acted on it, or on a body of its island with joints, in the last
    /// step.
    pub pushed: Vec<bool>,
    /// Whether the first step of the simulation has begun.
    has_begun: bool,
    /// For each moving body, whether it is in an implicit island (with joints or motion-dependent forces).
    jointed: Vec<bool>,
    mechanism: Mechanism<'a>,
    /// The states of the linkages (bodies connected by joints) that are carried from step to step.
    carried: Vec<Carried>,
    /// For each body of the system, its index among the moving bodies.
    places: Vec<Option<u32>>,
    /// For each motion-dependent force, the moving body on which it acts, alone or paired with another body on which
    /// the force depends, and the index of the force; sorted by force.
    acting: Vec<(u32, Option<u32>, u32)>,
    /// The time that the simulation has reached.
    t: f64,
    /// Whether the current part of a step must not be halved further, and is attempted whatever its length.
    is_shortest: bool,
    /// For each body with contact outputs, the contact force and the contact torque on it in the last step.
    contact_forces: Vec<(Vector3<f64>, Vector3<f64>)>,
    /// The states of the bodies with prescribed motion in the current step.
    prescribed: Vec<Prescribed>,
    /// For each body of the system, its index among the bodies with prescribed motion.
    given: Vec<Option<u32>>,
    /// The contacts of the current step that are closed or may close.
    pub contacts: Vec<Contact>,
    /// The contacts that had an impulse when the contact law was last solved; empty unless coefficients of friction
    /// vary.
    rubbing: Vec<Contact>,
    /// The contact events (impact, stick, slip, lift-off) of the last step.
    pub new_events: Vec<NewEvent>,
    /// The state of the event-driven integration, which locates impacts; `None` for time stepping.
    located: Option<Box<Located>>,
    touches: Touches,
    /// The contact statistics of the last step.
    pub report: ContactReport,
    joined: HashSet<(u32, u32)>,
    broad_phase: BroadPhase,
    pairs: Vec<(u32, u32)>,
    points: Vec<ContactPoint>,
    /// The contact impulses of the last step in world axes, by contact identity, for the warm start.
    kept: FxHashMap<(u32, u32, u64), Vector3<f64>>,
    islands: Islands,
    tasks: Vec<Island>,
    impact_law: ImpactLaw,
    laws: Vec<Law>,
    load: Load,
    /// The limit on the memory for contacts and their matrices in a step, in bytes.
    pub most_memory: usize,
    /// The record of the parts into which steps were divided, if a comparison run is to use longer parts; otherwise
    /// `None`.
    pub made: Option<MadeParts>,
}

impl<'a> MoreauStepping<'a> {
    /// Initialises the time-stepping scheme at the initial time `t`.
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
        let mechanism = Mechanism::new(scene, &places, &given, moving.len());
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
            is_shortest: false,
            contact_forces: vec![Default::default(); scene.bodies.iter().filter(|body| body.tells_contacts).count()],
            prescribed,
            given,
            contacts: Vec::new(),
            rubbing: Vec::new(),
            new_events: Vec::new(),
            located: None,
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
            made: None,
        }
    }

    /// Returns the current pose of a body, given its index in the system.
    pub fn pose(&self, body: usize) -> &Isometry3<f64> {
        match (self.places[body], self.given[body]) {
            (Some(place), _) => &self.moving[place as usize].pose,
            (None, Some(place)) => &self.prescribed[place as usize].pose,
            (None, None) => &self.scene.bodies[body].pose,
        }
    }

    /// Returns the motion of a body, given its index in the system; `None` if the body is fixed or has prescribed
    /// motion.
    pub fn motion(&self, body: usize) -> Option<&Motion> {
        self.places[body].map(|place| &self.moving[place as usize])
    }

    /// Makes a step of length `h` from the time `t`, by time stepping or event-driven.
    ///
    /// # Errors
    /// If the step fails.
    pub fn step(&mut self, t: f64, h: f64, control: &Control) -> Result<(), StepFailure> {
        self.t = t;
        self.forget_last_step();
        if let Some(mut located) = self.located.take() {
            let advanced = self.advance_located(&mut located, h, control);
            self.located = Some(located);
            advanced?;
        } else {
            self.advance(h, HALVINGS, control)?;
        }
        self.contact_forces.iter_mut().for_each(|(force, torque)| (*force, *torque) = (*force / h, *torque / h));
        self.measure_joints();
        self.check()
    }

    /// Clears the report, the events and the contact forces of the last step.
    fn forget_last_step(&mut self) {
        self.report = ContactReport::default();
        self.new_events.clear();
        self.contact_forces.fill(Default::default());
    }

    /// Detects the contacts of a step of length `h`, and resolves the overlaps of bodies at its beginning.
    fn detect_and_part(&mut self, h: f64, control: &Control) -> Result<(), StepFailure> {
        self.detect(h, control)?;
        self.report.penetration = self.report.penetration.max(self.depth(0.0));
        self.report.overlap = self.report.overlap.max(self.overlap());
        self.part_overlaps(h, control)
    }

    /// Records the kinetic energy of all bodies in the step's report if it is the largest so far.
    fn note_kinetic_energy(&mut self) {
        let kinetic: f64 = self.moving.iter().map(Motion::kinetic_energy).sum();
        self.report.kinetic = self.report.kinetic.max(kinetic);
    }

    /// Starts to record the parts into which steps are divided, for a comparison run.
    pub fn record_parts(&mut self) {
        self.made = Some(MadeParts::new(self.moving.len()));
    }

    /// Makes the run a comparison run, and returns the parts of the first run's steps up to the end of the next step,
    /// for the caller to set: steps are divided into parts at least twice as long as these, whatever their error, if
    /// their equations can be solved.
    pub fn exceeded(&mut self) -> &mut MadeParts {
        let moving = self.moving.len();
        self.mechanism.exceeded.get_or_insert_with(|| MadeParts::new(moving))
    }

    /// Makes a step of length `h`, in two halves if it is too long for the equations of joints or for contacts.
    fn advance(&mut self, h: f64, halvings: u32, control: &Control) -> Result<(), StepFailure> {
        let part = [self.t, self.t + h];
        let longest = self.mechanism.exceeded.as_ref().map(|parts| parts.longest(part));
        if longest.is_some_and(|longest| !may_try(h, longest)) && halvings > 0 {
            self.advance(0.5 * h, halvings - 1, control)?;
            return self.advance(0.5 * h, halvings - 1, control);
        }
        for prescribed in &mut self.prescribed {
            if let Some(by) = &self.scene.bodies[prescribed.body].motion {
                prescribed.begin(by, &self.scene.signals, self.t, h);
            }
        }
        self.ground();
        self.detect_and_part(h, control)?;
        if !self.has_begun {
            self.foresee(h);
            self.hold(|_| true);
            self.has_begun = true;
        }
        let (start, carried) = (self.moving.clone(), self.carried.clone());
        self.group();
        self.kick(h);
        self.note_kinetic_energy();
        self.remember();
        self.close();
        self.is_shortest = halvings == 0;
        self.partition_into_islands();
        let report = self.report;
        let solved = self.solve_each(|island, mechanism, law| island.solve(h, mechanism, law, control));
        // If the solve is interrupted, the caller discards the incomplete step.
        control.go_on()?;
        let poses: Vec<_> = self.prescribed.iter().map(|prescribed| prescribed.pose).collect();
        self.prescribed.iter_mut().for_each(|prescribed| prescribed.pose = prescribed.end);
        let is_too_long =
            solved == Err(Unsolved::TooLong) || longest.is_none() && self.meets_unseen(&start, h, control)?;
        if is_too_long && halvings > 0 {
            (self.moving, self.carried, self.report) = (start, carried, report);
            self.prescribed.iter_mut().zip(poses).for_each(|(prescribed, pose)| prescribed.pose = pose);
            // Of the rejected attempt at a step, keep only the longest step sizes that linkages should try next.
            for island in &self.tasks[..self.islands.len()] {
                island.linkages.iter().for_each(|&linkage| self.carried[linkage as usize].parts = island.parts);
            }
            self.advance(0.5 * h, halvings - 1, control)?;
            return self.advance(0.5 * h, halvings - 1, control);
        }
        solved?;
        let parts = self.tasks[..self.islands.len()].iter().map(|island| island.steps).max();
        self.report.parts += parts.unwrap_or(1).max(1);
        self.note_parts(part, longest);
        self.check_law()?;
        self.follow(h);
        self.add_contact_forces();
        self.record();
        self.hold(|contact| contact.impulse.x > 0.0);
        for ((motion, is_jointed), is_held) in self.moving.iter_mut().zip(&self.jointed).zip(&self.held) {
            if !is_jointed {
                motion.drift(h);
                motion.lag = if *is_held { 0.0 } else { 0.5 * h };
            }
        }
        self.end_velocities();
        self.t += h;
        Ok(())
    }

    /// Records the parts of a step and, in a comparison run with longer steps, the time in which the parts are not at
    /// least twice as long as those of the first run; `longest` is the length of the longest of the latter.
    fn note_parts(&mut self, part: [f64; 2], longest: Option<f64>) {
        let tasks = &self.tasks[..self.islands.len()];
        if let Some(made) = &mut self.made {
            made.add_whole(part);
            tasks.iter().for_each(|island| made.add(&island.bodies, &island.made));
        }
        if let Some(longest) = longest {
            let h = part[1] - part[0];
            let of_islands = tasks.iter().map(|island| island.repeated).fold(0.0, f64::max);
            self.report.repeated += if is_twice(h, longest) { of_islands } else { h };
        }
    }

    /// Passes the poses of the bodies with prescribed motion at the beginning of the step to the joints attached to
    /// these bodies.
    pub(super) fn ground(&mut self) {
        let of = |prescribed: &Prescribed| {
            let by = self.scene.bodies[prescribed.body].motion?;
            Some(Ground { t: self.t, pose: prescribed.pose, by })
        };
        self.mechanism.grounds.clear();
        self.mechanism.grounds.extend(self.prescribed.iter().filter_map(of));
    }

    /// Applies gravity for a time `h` to the velocities of bodies in explicit islands (without joints and
    /// motion-dependent forces).
    fn kick(&mut self, h: f64) {
        let gravity = self.scene.gravity;
        for ((motion, is_jointed), is_held) in self.moving.iter_mut().zip(&self.jointed).zip(&self.held) {
            if !is_jointed {
                motion.velocity += gravity * if *is_held { h } else { motion.lag + 0.5 * h };
            }
        }
    }

    /// Initialises each contact impulse with that of the last step (warm start).
    fn remember(&mut self) {
        for contact in &mut self.contacts {
            if let Some(impulse) = self.kept.get(&contact.key) {
                contact.impulse = contact.components(impulse);
            }
        }
    }

    /// Stores the contact impulses for the warm start of the next step, and records impulses and work of contacts in
    /// the report.
    fn record(&mut self) {
        self.kept.clear();
        self.pushed.fill(false);
        let report = &mut self.report;
        let mut is_elastic = !report.is_limited;
        let mut work = 0.0;
        report.closed = 0;
        for contact in self.contacts.iter().filter(|contact| contact.is_torque() || contact.impulse.x > 0.0) {
            self.kept.insert(contact.key, contact.frame.tr_mul(&contact.impulse));
            report.done.drives -= contact.impulse.dot(&contact.surface);
            if contact.is_torque() {
                report.work[1] += contact.work.sum();
                continue;
            }
            let is_stop = contact.is_stop();
            contact.bodies.iter().flatten().for_each(|&body| self.pushed[body as usize] = true);
            report.closed += usize::from(!is_stop);
            report.normal_impulse += if is_stop { 0.0 } else { contact.impulse.x };
            report.work[0] += contact.work.x;
            report.work[1] += contact.work.y + contact.work.z;
            work += contact.work.x;
            is_elastic &= contact.law.restitution == 1.0;
        }
        if is_elastic {
            report.elastic_work += work;
        }
    }

    /// Checks that the contact law was solved in the step: that its residual is not above `UNSOLVED`.
    fn check_law(&self) -> Result<(), StepFailure> {
        match self.report.residual {
            residual if residual > UNSOLVED => Err(StepFailure::Unsolved { residual }),
            _ => Ok(()),
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

    /// Returns the kinetic and the potential energy of the system; the gravitational potential is zero at the origin.
    pub fn energies(&self) -> [f64; 2] {
        self.energies_of(&self.ends)
    }

    /// Returns the kinetic and the potential energy of the system for given states of the moving bodies; springs have
    /// the energy of the end of the step.
    pub fn energies_of(&self, moving: &[Motion]) -> [f64; 2] {
        let kinetic = moving.iter().map(Motion::kinetic_energy).sum();
        let height = |motion: &Motion| motion.mass * self.scene.gravity.dot(&motion.pose.translation.vector);
        let springs: f64 = self.drives().map(|(drive, state)| drive.potential(state.coordinate)).sum();
        [kinetic, springs - moving.iter().map(height).sum::<f64>()]
    }

    /// Returns the drives of all joints and springs, with their states.
    fn drives(&self) -> impl Iterator<Item = (&Drive, &DriveState)> {
        self.mechanism.linkages.iter().zip(&self.carried).flat_map(|(linkage, carried)| {
            let drive = |(&joint, state)| Some((self.scene.joints[joint as usize].drive.as_ref()?, state));
            linkage.joints.iter().zip(&carried.states).filter_map(drive)
        })
    }
}
