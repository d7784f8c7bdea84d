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
mod overlaps;

use super::collision::{BroadPhase, ContactPoint, contacts};
use super::contact::Contact;
use super::island::{Island, Mechanism, Unsolved};
use super::joint::{Joint, joined};
use super::load::Load;
use super::motion::Motion;
use super::scene::Scene;
use super::touches::Touches;
use contact::islands::{Islands, solve_apart, threads};
use contact::law::{self, Law};
use contact::{ImpactLaw, Settings};
use nalgebra::{Isometry3, Vector3, Vector6};
use problem::{Control, EventKind, Interrupted};
use rustc_hash::FxHashMap;
use std::collections::HashSet;
use vi::Outcome;

/// Points within this part of a body's size are contacts, however slow the body: where one contact pushes a body, another
/// that is near must know of it.
pub(super) const NEAR: f64 = 0.01;

/// Pairs of bodies between two looks at whether to stop.
const AT_ONCE: usize = 1 << 8;

/// Contacts of the islands but the largest that are worth another thread.
const WORTH_A_THREAD: usize = 200;

/// What became of a step.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum StepFailure {
    /// A body's motion is no longer finite.
    NotFinite {
        /// Its place in the scene.
        body: usize,
    },
    /// The joints contradict each other.
    Joints,
    /// The contact law was not solved.
    Unsolved {
        /// What was left of it.
        residual: f64,
    },
    /// The contacts take more memory than they may.
    TooMuchMemory {
        /// Those that were found until then.
        contacts: usize,
        /// The body with the most of them, as its place in the scene, and how many it has.
        most_touched: Option<(usize, u32)>,
        /// The bytes that they would take.
        bytes: usize,
    },
    /// It was stopped from outside.
    Interrupted,
}

impl From<Interrupted> for StepFailure {
    fn from(_: Interrupted) -> Self {
        Self::Interrupted
    }
}

/// Halvings of a step that is too long for the joints of a scene with contacts.
const HALVINGS: u32 = 16;

/// The overlap at the end of a step, in parts of the smaller body's size, that bodies with joints may come to: half of what
/// the verdict allows.
const UNSEEN: f64 = 5e-4;

/// A residual of the contact law above this is no answer.
const UNSOLVED: f64 = 0.1;

/// What is to be said of the contacts of a step.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct ContactReport {
    /// Contacts that carried an impulse.
    pub closed: usize,
    /// The deepest overlap at the start of the step, in metres.
    pub penetration: f64,
    /// The sum of the normal impulses, in newton seconds.
    pub normal_impulse: f64,
    /// The deepest overlap as a part of the smaller body's size.
    pub overlap: f64,
    /// Work done on normals and on tangents, `r . (u+ + u-) / 2`, in joules.
    pub work: [f64; 2],
    /// Work done on normals in a step in which every contact that carried an impulse gives all back: it should be zero.
    pub elastic_work: f64,
    /// The kinetic energy before contacts and joints act, in joules.
    pub kinetic: f64,
    /// How far the worst joint is off, as a part of the size of its bodies, or in radians.
    pub drift: f64,
    /// The place of that joint.
    pub drifted: usize,
    /// Islands with contacts or joints.
    pub islands: usize,
    /// The steps in which it was made: more than one where it was too long for the joints.
    pub parts: u64,
    /// Contact problems solved.
    pub solves: u64,
    /// Pivots or iterations in all.
    pub iterations: u64,
    /// The solver that answered last.
    pub solver: &'static str,
    /// The largest residual of the contact law.
    pub residual: f64,
    /// Whether a restitution would have added energy, and was cut.
    pub is_limited: bool,
}

impl ContactReport {
    /// Takes over how one island was solved.
    fn take(&mut self, law: &law::Report) {
        self.solves += law.solves;
        self.iterations += law.iterations;
        self.solver = law.solver;
        let residual = if law.outcome == Outcome::Breakdown { f64::INFINITY } else { law.residual };
        self.residual = self.residual.max(residual);
        self.is_limited |= law.restitution < 1.0;
    }
}

/// How far around a body contacts are looked for: as far as it comes in a step `h` in which forces make it faster by `fall`.
fn margin(motion: &Motion, reach: f64, fall: f64, h: f64) -> f64 {
    h * (motion.velocity.norm() + fall + motion.omega.norm() * reach) + NEAR * reach
}

/// A scene in motion.
#[derive(Debug)]
pub struct Simulation<'a> {
    scene: &'a Scene,
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
    /// Of each linkage the forces of its joints in the last step, and its largest kinetic energy so far.
    tensions: Vec<(Vec<Vector6<f64>>, f64)>,
    /// The places of the scene's bodies among them.
    places: Vec<Option<u32>>,
    /// The contacts of the step.
    pub contacts: Vec<Contact>,
    /// What happened in the last step between which bodies of the scene.
    pub happenings: Vec<(EventKind, [usize; 2])>,
    touches: Touches,
    /// What the last step said.
    pub report: ContactReport,
    joined: HashSet<(u32, u32)>,
    broad_phase: BroadPhase,
    pairs: Vec<(u32, u32)>,
    points: Vec<ContactPoint>,
    /// Impulses of the last step, in the world, by contact.
    kept: FxHashMap<(u32, u32, u32), Vector3<f64>>,
    islands: Islands,
    tasks: Vec<Island>,
    impact_law: ImpactLaw,
    laws: Vec<Law>,
    load: Load,
    /// The bytes that contacts may take.
    pub most_memory: usize,
}

impl<'a> Simulation<'a> {
    /// The scene at its start.
    pub fn new(scene: &'a Scene, settings: &Settings) -> Self {
        let mut moving = Vec::new();
        let mut places = Vec::with_capacity(scene.bodies.len());
        for body in &scene.bodies {
            let motion = if body.fixed { None } else { Motion::new(body) };
            places.push(motion.map(|motion| {
                moving.push(motion);
                moving.len() as u32 - 1
            }));
        }
        let mechanism = Mechanism::new(scene, &places, moving.len());
        Self {
            scene,
            ends: moving.clone(),
            held: vec![false; moving.len()],
            pushed: vec![false; moving.len()],
            has_begun: false,
            jointed: vec![false; moving.len()],
            tensions: mechanism.linkages.iter().map(|of| (vec![Vector6::zeros(); of.joints.len()], 0.0)).collect(),
            mechanism,
            moving,
            places,
            contacts: Vec::new(),
            happenings: Vec::new(),
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
        self.places[body].map_or(&self.scene.bodies[body].pose, |place| &self.moving[place as usize].pose)
    }

    /// The motion of a body of the scene; none if it is fixed.
    pub fn motion(&self, body: usize) -> Option<&Motion> {
        self.places[body].map(|place| &self.moving[place as usize])
    }

    /// Makes a step of length `h`.
    ///
    /// # Errors
    /// If the bodies cannot go on.
    pub fn step(&mut self, h: f64, control: &Control) -> Result<(), StepFailure> {
        self.report = ContactReport::default();
        self.happenings.clear();
        self.advance(h, HALVINGS, control)?;
        self.measure_joints();
        self.check()
    }

    /// Makes a step of length `h`, or halves of it where that is too long.
    fn advance(&mut self, h: f64, halvings: u32, control: &Control) -> Result<(), StepFailure> {
        self.detect(h, control)?;
        self.report.penetration = self.report.penetration.max(self.depth(0.0));
        self.report.overlap = self.report.overlap.max(self.overlap());
        self.part_overlaps(h, control)?;
        if !self.has_begun {
            self.foresee(h);
            self.hold(|_| true);
            self.has_begun = true;
        }
        let start = self.moving.clone();
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
        let is_too_long = solved == Err(Unsolved::TooLong) || self.meets_unseen(&start, h, control)?;
        if is_too_long && halvings > 0 {
            (self.moving, self.report) = (start, report);
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
        self.judge();
        self.hold(|contact| contact.impulse.x > 0.0);
        for ((motion, is_jointed), is_held) in self.moving.iter_mut().zip(&self.jointed).zip(&self.held) {
            if !is_jointed {
                motion.drift(h);
                motion.lag = if *is_held { 0.0 } else { 0.5 * h };
            }
        }
        self.arrive();
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

    /// Finds the contacts that may close within `h`.
    fn detect(&mut self, h: f64, control: &Control) -> Result<(), StepFailure> {
        let (scene, moving, places) = (self.scene, &self.moving, &self.places);
        let (load, most) = (&mut self.load, self.most_memory);
        load.begin(scene);
        let check = |load: &Load| {
            let bytes = load.bytes();
            if bytes <= most {
                return Ok(());
            }
            Err(StepFailure::TooMuchMemory { contacts: load.contacts, most_touched: load.most_touched(), bytes })
        };
        let margin = |body: usize| {
            let reach = scene.bodies[body].collider.shape.reach();
            places[body].map_or(0.0, |place| margin(&moving[place as usize], reach, h * scene.gravity.norm(), h))
        };
        let pose = |body: usize| places[body].map_or(&scene.bodies[body].pose, |place| &moving[place as usize].pose);
        let bounds = |body: usize| {
            let (lower, upper) = scene.bodies[body].collider.shape.bounds(pose(body));
            let margin = Vector3::repeat(margin(body));
            (lower - margin, upper + margin)
        };
        self.pairs.clear();
        self.contacts.clear();
        self.broad_phase.sweep(
            scene.bodies.len(),
            bounds,
            |body| places[body].is_some(),
            control,
            |a, b| {
                self.pairs.push((a, b));
                load.pairs += 1;
                check(load)
            },
        )?;
        self.pairs.sort_unstable();
        for (k, &(a, b)) in self.pairs.iter().enumerate() {
            if k % AT_ONCE == 0 {
                control.go_on()?;
            }
            if self.joined.contains(&(a, b)) {
                continue;
            }
            let [i, j] = [a as usize, b as usize];
            let [first, second] = [i, j].map(|body| (&scene.bodies[body].collider, pose(body)));
            self.points.clear();
            contacts(first, second, margin(i) + margin(j), &mut self.points);
            load.add([i, j].map(|body| places[body].map(|_| body)), self.points.len());
            check(load)?;
            let law = scene.laws.of(scene.bodies[i].material, scene.bodies[j].material);
            let new = |point| Contact::new(point, [places[i], places[j]], moving, law, (a, b));
            let room = overlaps::no_gap(scene, i, j);
            self.contacts.extend(self.points.iter().map(new).map(|contact| Contact { no_gap: room, ..contact }));
        }
        Ok(())
    }

    /// Whether bodies with joints overlap at the end of a step: by the curvature of their way, or as their joints moved them
    /// further than contacts were looked for.
    fn meets_unseen(&self, start: &[Motion], h: f64, control: &Control) -> Result<bool, StepFailure> {
        if !self.jointed.contains(&true) {
            return Ok(false);
        }
        let (scene, places) = (self.scene, &self.places);
        let is_jointed = |body: usize| places[body].is_some_and(|place| self.jointed[place as usize]);
        let reach = |body: usize| scene.bodies[body].collider.shape.reach();
        let strays = |body: usize| {
            places[body].is_some_and(|place| {
                let (from, to) = (&start[place as usize], &self.moving[place as usize]);
                let way = (to.pose.translation.vector - from.pose.translation.vector).norm()
                    + from.pose.rotation.angle_to(&to.pose.rotation) * reach(body);
                self.jointed[place as usize] && way > margin(from, reach(body), h * scene.gravity.norm(), h)
            })
        };
        let overlap = |a: u32, b: u32| {
            let [a, b] = [a as usize, b as usize];
            if !is_jointed(a) && !is_jointed(b) || self.joined.contains(&(a as u32, b as u32)) {
                return false;
            }
            let [first, second] = [a, b].map(|body| (&scene.bodies[body].collider, self.pose(body)));
            let mut points = Vec::new();
            contacts(first, second, 0.0, &mut points);
            points.iter().any(|point| -point.gap > UNSEEN * reach(a).min(reach(b)))
        };
        if !(0..scene.bodies.len()).any(strays) {
            return Ok(self.pairs.iter().any(|&(a, b)| overlap(a, b)));
        }
        let mut is_any = false;
        BroadPhase::default().sweep(
            scene.bodies.len(),
            |body| scene.bodies[body].collider.shape.bounds(self.pose(body)),
            |body| places[body].is_some(),
            control,
            |a, b| {
                is_any |= overlap(a, b);
                Ok::<(), StepFailure>(())
            },
        )?;
        Ok(is_any)
    }

    /// Gives each contact the impulse that it had in the last step.
    fn remember(&mut self) {
        for contact in &mut self.contacts {
            if let Some(impulse) = self.kept.get(&contact.key) {
                contact.impulse = contact.frame * impulse;
            }
        }
    }

    /// Gives every island to `solve`, with a solver of the contact law, and takes over what came of it.
    fn solve_each(&mut self, solve: impl Fn(&mut Island, &Mechanism<'_>, &mut Law) + Sync) -> Result<(), Unsolved> {
        let (mechanism, tasks) = (&self.mechanism, &mut self.tasks[..self.islands.len()]);
        let weight = |island: &Island| island.contacts.len() + 2 * island.joints.len();
        solve_apart(tasks, &mut self.laws, weight, WORTH_A_THREAD, |island, law| solve(island, mechanism, law));
        self.report.islands = tasks.len();
        if let Some(unsolved) = tasks.iter().find_map(|island| island.unsolved) {
            return Err(unsolved);
        }
        for island in tasks {
            if let Some(law) = &island.report {
                self.report.take(law);
            }
            for (&body, motion) in island.bodies.iter().zip(&island.moving) {
                self.moving[body as usize] = *motion;
            }
            for (&source, contact) in island.sources.iter().zip(&island.contacts) {
                self.contacts[source as usize] = Contact { bodies: self.contacts[source as usize].bodies, ..*contact };
            }
            for (&linkage, tensions) in island.linkages.iter().zip(&mut island.tensions) {
                self.tensions[linkage as usize] = (std::mem::take(tensions), island.largest_energy);
            }
        }
        Ok(())
    }

    /// Groups contacts and joints into islands, and notes which bodies are in one with joints.
    fn group(&mut self) {
        let (contacts, joints, places) = (&self.contacts, &self.scene.joints, &self.places);
        let of_contact = |contact: &Contact| match contact.bodies {
            [Some(a), b] => (a as usize, b.map(|b| b as usize)),
            [None, b] => (b.unwrap_or(0) as usize, None),
        };
        let of_joint = |joint: &Joint| {
            let [a, b] = joint.places(&|body| places[body]);
            (a.unwrap_or(0) as usize, b.map(|b| b as usize))
        };
        let links = contacts.iter().map(of_contact).chain(joints.iter().map(of_joint));
        self.islands.group(self.moving.len(), links);
        self.jointed.fill(false);
        for island in (0..self.islands.len()).map(|k| self.islands.links(k)) {
            // Joints come behind contacts.
            if island.last().is_some_and(|&link| link as usize >= contacts.len()) {
                for &link in island {
                    let link = link as usize;
                    let (a, b) =
                        contacts.get(link).map_or_else(|| of_joint(&joints[link - contacts.len()]), of_contact);
                    self.jointed[a] = true;
                    b.into_iter().for_each(|b| self.jointed[b] = true);
                }
            }
        }
    }

    /// Copies out what belongs to each island.
    fn part(&mut self) {
        let (contacts, joints, places) = (&self.contacts, &self.scene.joints, &self.places);
        let (cone, impact_law) = (self.scene.cone, self.impact_law);
        self.tasks.resize_with(self.tasks.len().max(self.islands.len()), || Island::new(cone, impact_law));
        for (k, island) in self.tasks.iter_mut().take(self.islands.len()).enumerate() {
            island.clear();
            for &link in self.islands.links(k) {
                let link = link as usize;
                let bodies = if let Some(contact) = contacts.get(link) {
                    island.contacts.push(*contact);
                    island.sources.push(link as u32);
                    contact.bodies
                } else {
                    let joint = link - contacts.len();
                    island.joints.push(joint as u32);
                    island.linkages.push(self.mechanism.of_joint[joint]);
                    joints[joint].places(&|body| places[body])
                };
                island.bodies.extend(bodies.into_iter().flatten());
            }
            island.linkages.sort_unstable();
            island.linkages.dedup();
            for &linkage in &island.linkages {
                let (tensions, largest) = &self.tensions[linkage as usize];
                island.tensions.push(tensions.clone());
                island.largest_energy = island.largest_energy.max(*largest);
            }
            island.bodies.sort_unstable();
            island.bodies.dedup();
            island.moving.extend(island.bodies.iter().map(|&body| self.moving[body as usize]));
            for contact in &mut island.contacts {
                contact.bodies = contact.bodies.map(|body| {
                    body.and_then(|body| island.bodies.binary_search(&body).ok()).map(|place| place as u32)
                });
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
            self.kept.insert(contact.key, contact.frame.tr_mul(&contact.impulse));
            contact.bodies.iter().flatten().for_each(|&body| self.pushed[body as usize] = true);
            report.closed += 1;
            report.normal_impulse += contact.impulse.x;
            report.work[0] += contact.work.x;
            report.work[1] += contact.work.y + contact.work.z;
            work += contact.work.x;
            is_elastic &= contact.law.restitution == 1.0;
        }
        if is_elastic {
            report.elastic_work += work;
        }
    }

    fn check(&self) -> Result<(), StepFailure> {
        let lost = |place: &Option<u32>| place.is_some_and(|place| !self.moving[place as usize].is_finite());
        match self.places.iter().position(lost) {
            Some(body) => Err(StepFailure::NotFinite { body }),
            None => Ok(()),
        }
    }

    /// Kinetic and potential energy, the latter zero at the origin.
    pub fn energies(&self) -> [f64; 2] {
        let kinetic = self.ends.iter().map(Motion::kinetic_energy).sum();
        let height = |motion: &Motion| motion.mass * self.scene.gravity.dot(&motion.pose.translation.vector);
        [kinetic, -self.ends.iter().map(height).sum::<f64>()]
    }
}
