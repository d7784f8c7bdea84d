//! Linkages: sets of bodies connected by joints, and the linear systems of their motion.
//!
//! The mean velocities `w` and the joint impulses `lambda` of a step solve, with `q+ = q (+) h w` (see
//! [`midpoint`](super::midpoint)) and contact impulses `r`,
//!
//! ```text
//! 2 M (w - v) = h f + J^T r + G(mean)^T lambda,    c(q+) = 0
//! ```
//!
//! Joint forces do no work over the step, because `G` at the mean frames is the discrete gradient of `c`. Newton's
//! method uses the exact derivative, including that of `G^T lambda`, the geometric stiffness: tension is implicit, and
//! a light link between heavy links does not require small steps. At the end of the step, velocities are projected onto
//! `G(q+) v+ = 0` in the mass norm, which never adds energy.

mod dense;
mod elimination;
mod tangent;

pub use elimination::{Blocks, JointSlots, Plan};

use super::drive::{Done, DriveState, Driving};
use super::frame::Frame;
use super::joint::{Joint, Reaction, Row};
use super::midpoint::{Midpoint, apart as apart_of};
use super::motion::Motion;
use super::prescribed::Grounding;
use super::signals::SignalStep;
use contact::islands::Islands;
use nalgebra::{Matrix3, Matrix6, Vector3, Vector6};

/// Regularising diagonal of a joint, relative to the mobility of its bodies, so that redundant joints of a loop give
/// a regular matrix. The relative error of redundant joint forces is the rounding unit divided by this value, `2e-5`.
/// Two refinements reduce the error of the regularisation to the third power of this value times the mass ratio: to
/// rounding, for mass ratios up to a million.
const REDUNDANT: f64 = 1e-11;

/// Number of repetitions of the projection of velocities onto the joint constraints; the second and the third reduce
/// rounding errors.
const PASSES: usize = 3;

/// The instant of a step at which the frames of a joint's bodies are evaluated.
#[derive(Clone, Copy, Debug)]
enum Instant {
    Start,
    /// The middle of the step, with the mean of the bodies' frames at both ends.
    Mean,
    End,
}

/// A set of bodies connected by joints, with the elimination plan of its linear equations.
#[derive(Clone, Debug, Default)]
pub struct Linkage {
    /// The indices of the linkage's bodies among the moving bodies, in ascending order.
    pub bodies: Vec<u32>,
    /// The indices of the linkage's joints in the multibody system, in ascending order.
    pub joints: Vec<u32>,
    /// The bodies of each joint, as indices into `bodies`; `None` for the world and for bodies that do not move freely.
    pairs: Vec<[Option<u32>; 2]>,
    /// For each joint, the index of its second body among the bodies with prescribed motion; `None` if that body has no
    /// prescribed motion.
    grounds: Vec<Option<u32>>,
    plan: Plan,
    /// For each joint, the slots of the matrix blocks to which it contributes.
    slots: Vec<JointSlots>,
    /// Whether joints of the linkage form a loop and may be redundant.
    has_loops: bool,
}

impl Linkage {
    /// Returns all linkages that the joints form; `places` are the indices of the system's bodies among the `moving`
    /// bodies, `given` are their indices among the bodies with prescribed motion.
    pub fn all(joints: &[Joint], places: &[Option<u32>], given: &[Option<u32>], moving: usize) -> Vec<Self> {
        let of = |joint: &Joint| {
            let [a, b] = joint.places(&|body| places[body]);
            (a.unwrap_or(0) as usize, b.map(|b| b as usize))
        };
        let mut islands = Islands::default();
        islands.group(moving, joints.iter().map(of));
        let linkage = |k: usize| {
            let joints_of = islands.links(k).to_vec();
            let ends = |joint: &u32| joints[*joint as usize].places(&|body| places[body]);
            let mut bodies: Vec<u32> = joints_of.iter().flat_map(ends).flatten().collect();
            bodies.sort_unstable();
            bodies.dedup();
            let place = |body: u32| bodies.binary_search(&body).ok().map(|place| place as u32);
            let pairs: Vec<_> = joints_of.iter().map(|joint| ends(joint).map(|body| body.and_then(place))).collect();
            let nodes = bodies.len() + usize::from(pairs.iter().any(|pair| pair.contains(&None)));
            let has_loops = pairs.len() >= nodes;
            let equations: Vec<usize> = joints_of.iter().map(|joint| joints[*joint as usize].rank()).collect();
            let ground = |joint: &u32| joints[*joint as usize].bodies.1.and_then(|body| given[body]);
            let grounds = joints_of.iter().map(ground).collect();
            let plan = Plan::new(bodies.len(), &pairs, &equations);
            let nodes = (bodies.len() as u32..).zip(&pairs);
            let slots = nodes.map(|(node, pair)| plan.slots_of_joint(node, *pair)).collect();
            Self { plan, bodies, joints: joints_of, pairs, grounds, slots, has_loops }
        };
        (0..islands.len()).map(linkage).collect()
    }

    /// Returns the memory of the linear system of the linkage, in bytes.
    pub fn bytes(&self) -> usize {
        self.plan.bytes()
    }

    /// Returns the linkage that represents a single body without joints.
    pub fn alone() -> Self {
        Self { bodies: vec![0], plan: Plan::new(1, &[], &[]), ..Self::default() }
    }
}

/// A linkage within an island, with its linear system in the current step.
#[derive(Debug)]
pub struct Linked<'a> {
    linkage: &'a Linkage,
    joints: Vec<&'a Joint>,
    /// The indices of the linkage's bodies in the island.
    pub bodies: Vec<u32>,
    /// The joint forces of the last step, one vector per joint of the linkage.
    pub forces: Vec<Vector6<f64>>,
    /// The joint impulses `lambda` of the current step, one vector per joint.
    impulses: Vec<Vector6<f64>>,
    /// The joint impulses of the projection of velocities onto the joint constraints at the end of the current step.
    corrections: Vec<Vector6<f64>>,
    /// The states of the drives of the linkage's joints.
    pub states: Vec<DriveState>,
    /// For each joint, the data of its drive that are fixed within the current step.
    driving: Vec<Driving>,
    /// The energy exchanged by the drives of the linkage in the last step.
    pub done: Done,
    /// The reactions of the linkage's joints in the last step.
    pub reactions: Vec<Reaction>,
    /// Whether the linear system of the linkage that was solved last had a solution.
    pub is_solved: bool,
    matrix: Blocks,
    /// For each joint, the motion of its second body in the current step if that body has prescribed motion;
    /// otherwise that of the world.
    groundings: Vec<Grounding>,
    /// For each joint, the prescribed rates of its equations at the end of the step: those of motors, and those due
    /// to bodies with prescribed motion.
    rates: Vec<Vector6<f64>>,
    /// The regularising diagonals of redundant joints, see [`REDUNDANT`].
    diagonals: Vec<Vector6<f64>>,
    /// The right-hand side of the linear system of the linkage, which a solve replaces by the solution.
    pub x: Vec<Vector6<f64>>,
}

impl<'a> Linked<'a> {
    /// Creates the linkage's part of an island's equations; `bodies` are the indices of the linkage's bodies in the
    /// island, `forces` are the joint forces of the last step.
    pub fn new(
        linkage: &'a Linkage,
        joints: &'a [Joint],
        bodies: Vec<u32>,
        forces: Vec<Vector6<f64>>,
        states: Vec<DriveState>,
    ) -> Self {
        let joints: Vec<&Joint> = linkage.joints.iter().map(|&joint| &joints[joint as usize]).collect();
        let x = vec![Vector6::zeros(); bodies.len() + joints.len()];
        let impulses = forces.clone();
        let diagonals = vec![Vector6::zeros(); joints.len()];
        let driving = vec![Driving::default(); joints.len()];
        let reactions = vec![Reaction::default(); joints.len()];
        Self {
            corrections: impulses.clone(),
            reactions,
            groundings: vec![Grounding::WORLD; joints.len()],
            rates: vec![Vector6::zeros(); joints.len()],
            diagonals,
            states,
            driving,
            done: Done::default(),
            linkage,
            joints,
            bodies,
            forces,
            impulses,
            is_solved: true,
            matrix: Blocks::default(),
            x,
        }
    }

    /// Begins a step of the linkage, with the joint forces of the last step as initial guess; `ground` returns the
    /// motion over the step of a body with prescribed motion, given its index.
    pub fn begin(&mut self, starts: &[Frame], course: &SignalStep, ground: impl Fn(u32) -> Grounding) {
        for (grounding, of) in self.groundings.iter_mut().zip(&self.linkage.grounds) {
            *grounding = of.map_or(Grounding::WORLD, &ground);
        }
        let h = course.h;
        self.impulses.iter_mut().zip(&self.forces).for_each(|(impulse, force)| *impulse = force * h);
        self.corrections.fill(Vector6::zeros());
        self.is_solved = true;
        self.done = Done::default();
        for k in 0..self.joints.len() {
            if let Some(drive) = &self.joints[k].drive {
                let frames = self.frames(starts, Instant::Start, k);
                let (_, apart) = self.joints[k].arms(frames);
                let start = drive.value(frames, &apart, self.states[k].coordinate);
                self.driving[k] = drive.begin(start, &self.states[k], course);
            }
        }
    }

    /// Returns the value of the drive equation of joint `k` for given frames of the bodies; `None` without a drive.
    fn deviation(&self, k: usize, frames: &[Frame], at: Instant) -> Option<f64> {
        let (joint, driving) = (self.joints[k], &self.driving[k]);
        let drive = joint.drive.as_ref()?;
        let frames = self.frames(frames, at, k);
        let (arms, apart) = joint.arms(frames);
        Some(match drive.equation(driving.reference) {
            Some(equation) => equation.row(frames, arms, apart).value - drive.offset(driving.reference),
            None => apart.norm() - driving.reference,
        })
    }

    /// Returns the reaction of joint `k` of the linkage on its first body, averaged over a step.
    fn reaction(&self, k: usize, midpoint: &Midpoint) -> Reaction {
        let (joint, frames) = (self.joints[k], self.frames(&midpoint.means, Instant::Mean, k));
        let (arms, apart) = joint.arms(frames);
        let drive = joint.drive.as_ref();
        let of_drive = drive.and_then(|drive| drive.equation(self.driving[k].reference));
        let mut reaction = Reaction::default();
        let impulses = self.impulses[k] + self.corrections[k];
        for (equation, impulse) in joint.equations.iter().chain(&of_drive).zip(&impulses) {
            let row = equation.row(frames, arms, apart);
            reaction.force += row.force * (impulse / midpoint.h);
            reaction.torque += (row.torques[0] - arms[0].cross(&row.force)) * (impulse / midpoint.h);
        }
        reaction
    }

    /// Ends a step of the linkage: updates joint forces, drives and reactions, and records the energy exchanged by
    /// drives.
    pub fn end(&mut self, midpoint: &Midpoint) {
        let h = midpoint.h;
        self.forces.iter_mut().zip(&self.impulses).for_each(|(force, impulse)| *force = impulse / h);
        for k in 0..self.joints.len() {
            self.reactions[k] = self.reaction(k, midpoint);
            self.done.drives += self.work_of_ground(k, midpoint);
            let (Some(drive), Some(from), Some(to)) = (
                &self.joints[k].drive,
                self.deviation(k, &midpoint.starts, Instant::Start),
                self.deviation(k, &midpoint.ends, Instant::End),
            ) else {
                continue;
            };
            let work = self.impulses[k][self.joints[k].equations.len()] * (to - from) / h;
            let (state, done) = drive.end(&self.driving[k], to, work, h);
            self.states[k] = state;
            self.reactions[k].coordinate = state.coordinate;
            let row = self.joints[k].equations.len();
            self.reactions[k].effort = drive.force(to, self.impulses[k][row] + self.corrections[k][row], h);
            self.done.drives += done.drives;
            self.done.damped += done.damped;
        }
    }

    /// Returns the work over the step of the second body of joint `k` if it has prescribed motion, otherwise zero. By
    /// the discrete gradient, it is the work of the joint impulses on the first body less the impulses times the
    /// changes of the constraint values.
    fn work_of_ground(&self, k: usize, midpoint: &Midpoint) -> f64 {
        let (Some(_), [Some(body), None]) = (self.linkage.grounds[k], self.linkage.pairs[k]) else { return 0.0 };
        let joint = self.joints[k];
        let mean = self.frames(&midpoint.means, Instant::Mean, k);
        let (arms, apart) = joint.arms(mean);
        let [from, to] = [(&midpoint.starts, Instant::Start), (&midpoint.ends, Instant::End)].map(|(frames, at)| {
            let frames = self.frames(frames, at, k);
            (frames, joint.arms(frames))
        });
        let of = [apart_of(&midpoint.mean[self.bodies[body as usize] as usize]), Default::default()];
        let drive = joint.drive.as_ref();
        let of_drive = drive.and_then(|drive| drive.equation(self.driving[k].reference));
        let mut work = 0.0;
        for (equation, impulse) in joint.equations.iter().chain(&of_drive).zip(&self.impulses[k]) {
            let [before, after] = [from, to].map(|(frames, (arms, apart))| equation.row(frames, arms, apart).value);
            let rate = equation.row(mean, arms, apart).velocity(of);
            work += impulse * (rate - (after - before) / midpoint.h);
        }
        if drive.is_some() && of_drive.is_none() {
            let [before, after] = [from, to].map(|(_, (_, apart))| apart.norm());
            if before + after > 0.0 {
                let along = apart * (2.0 / (before + after));
                let rate = along.dot(&(of[0].0 + of[0].1.cross(&arms[0])));
                work += self.impulses[k][joint.equations.len()] * (rate - (after - before) / midpoint.h);
            }
        }
        work
    }

    /// Returns the joint impulses `lambda` of the current step.
    pub fn impulses(&self) -> &[Vector6<f64>] {
        &self.impulses
    }

    /// Sets the initial guess of the joint impulses in the current step.
    pub fn guess(&mut self, impulses: &[Vector6<f64>]) {
        self.impulses.copy_from_slice(impulses);
    }

    /// Returns whether a joint of the linkage is attached to the world or to a body with prescribed motion.
    pub fn is_grounded(&self) -> bool {
        self.linkage.pairs.iter().any(|pair| pair.contains(&None))
    }

    /// Returns whether motors or bodies with prescribed motion give a joint of the linkage a nonzero rate at the end of
    /// the step.
    pub fn is_driven(&self) -> bool {
        self.rates.iter().any(|rates| rates.iter().any(|rate| *rate != 0.0))
    }

    /// Returns whether the linkage has joints.
    pub fn has_joints(&self) -> bool {
        !self.joints.is_empty()
    }

    /// Returns the frames of both bodies of a joint at an instant of the step, where `frames` are those of the moving
    /// bodies.
    fn frames<'f>(&'f self, frames: &'f [Frame], at: Instant, joint: usize) -> [&'f Frame; 2] {
        let Grounding { start, mean, end, .. } = &self.groundings[joint];
        let ground = match at {
            Instant::Start => start,
            Instant::Mean => mean,
            Instant::End => end,
        };
        self.linkage.pairs[joint].map(|body| body.map_or(ground, |body| &frames[self.bodies[body as usize] as usize]))
    }

    /// Solves the equations of the step linearised at the current mean velocities; the changes of velocities and joint
    /// impulses are stored in `x`. Returns false if the equations have no solution.
    pub fn linearise(&mut self, midpoint: &Midpoint) -> bool {
        let plan = &self.linkage.plan;
        self.matrix.clear(plan);
        for (k, &body) in self.bodies.iter().enumerate() {
            let (rest, matrix) = midpoint.balance(body as usize);
            self.x[k] = -rest;
            self.matrix.add(plan, k as u32, &matrix);
        }
        self.is_solved = tangent::assemble(self, midpoint)
            && self.matrix.factorise(&self.linkage.plan, &self.diagonals, self.linkage.has_loops);
        if self.is_solved {
            self.respond();
            self.is_solved = self.x.iter().all(|x| x.iter().all(|x| x.is_finite()));
        }
        self.is_solved
    }

    /// Assembles and factorises the matrix of the velocity constraints at the end of a step, from masses and
    /// constraint gradients at the given frames; returns false if the matrix is singular.
    pub fn hold(&mut self, frames: &[Frame], moving: &[Motion]) -> bool {
        let plan = &self.linkage.plan;
        self.matrix.clear(plan);
        let inertia = |motion: &Motion| (motion.mass, motion.inertia_in_world());
        for (k, &body) in self.bodies.iter().enumerate() {
            let (mass, inertia) = inertia(&moving[body as usize]);
            let mut block = Matrix6::zeros();
            block.fixed_view_mut::<3, 3>(0, 0).copy_from(&Matrix3::from_diagonal_element(mass));
            block.fixed_view_mut::<3, 3>(3, 3).copy_from(&inertia);
            self.matrix.add(plan, k as u32, &block);
        }
        for k in 0..self.joints.len() {
            let joint = (self.bodies.len() + k) as u32;
            let mut gradients = [Matrix6::zeros(); 2];
            let (this, rank) = (self.joints[k], self.joints[k].rank());
            let of = self.frames(frames, Instant::End, k);
            let ground = [Default::default(), self.groundings[k].at_end];
            let rows: Vec<Row> = this.rows(of).chain(this.driven(of, self.driving[k].reference)).collect();
            let mut rates = Vector6::zeros();
            for (i, row) in rows.iter().enumerate() {
                rates[i] = if i < this.equations.len() { 0.0 } else { self.driving[k].rate } - row.velocity(ground);
                for (side, sign) in [(0, 1.0), (1, -1.0)] {
                    gradients[side].fixed_view_mut::<1, 3>(i, 0).copy_from(&(row.force * sign).transpose());
                    gradients[side].fixed_view_mut::<1, 3>(i, 3).copy_from(&row.torques[side].transpose());
                }
            }
            self.rates[k] = rates;
            let mut diagonal = Vector6::zeros();
            for (side, body) in self.linkage.pairs[k].into_iter().enumerate() {
                let Some(body) = body else { continue };
                let motion = &moving[self.bodies[body as usize] as usize];
                diagonal += tangent::mobilities(&gradients[side], motion);
                let slots = &self.linkage.slots[k];
                self.matrix.add(plan, slots.rows[side], &gradients[side]);
                self.matrix.add(plan, slots.columns[side], &gradients[side].transpose());
            }
            self.diagonals[k] = diagonal * -REDUNDANT;
            if self.joints[k].drive.is_some_and(|drive| !drive.prescribes()) {
                // A drive with a force law does not constrain velocities: its row of the matrix of velocity constraints
                // is that of the identity.
                let mut none = Matrix6::zeros();
                none[(rank - 1, rank - 1)] = -1.0;
                self.matrix.add(plan, joint, &none);
            }
        }
        self.matrix.factorise(plan, &self.diagonals, self.linkage.has_loops)
    }

    /// Projects velocities onto the joint constraints; if `closes`, constraint violations are closed within a unit of
    /// time. [`Linked::hold`] must have factorised the matrix. Returns the work of the drives in the projection.
    pub fn project(&mut self, frames: &[Frame], velocities: &mut [Vector6<f64>], closes: bool) -> f64 {
        let mut work = 0.0;
        for _ in 0..if self.has_joints() { PASSES } else { 0 } {
            self.x.iter_mut().for_each(|x| *x = Vector6::zeros());
            for k in 0..self.joints.len() {
                let of = self.linkage.pairs[k].map(|body| {
                    body.map_or_else(Default::default, |body| {
                        let v = &velocities[self.bodies[body as usize] as usize];
                        (v.fixed_rows::<3>(0).into_owned(), v.fixed_rows::<3>(3).into_owned())
                    })
                });
                let joint = self.joints[k];
                let frames = self.frames(frames, Instant::End, k);
                let rows = joint.rows(frames).chain(joint.driven(frames, self.driving[k].reference));
                let mut right = Vector6::zeros();
                for ((right, rate), row) in right.iter_mut().zip(&self.rates[k]).zip(rows) {
                    *right = if closes { -row.value } else { *rate } - row.velocity(of);
                }
                self.x[self.bodies.len() + k] = right;
            }
            self.respond();
            self.add(velocities);
            work += self.correct();
        }
        work
    }

    /// Adds the joint impulses in the solution `x` to those of the velocity projection at the end of the step; returns
    /// the work of drives and bodies that prescribe a rate.
    pub fn correct(&mut self) -> f64 {
        for (correction, x) in self.corrections.iter_mut().zip(&self.x[self.bodies.len()..]) {
            *correction -= x;
        }
        self.x[self.bodies.len()..].iter().zip(&self.rates).map(|(x, rates)| -x.dot(rates)).sum()
    }

    /// Returns the energy of the change of damper impulses between the mean velocities and `velocities`, those at the
    /// end of the step.
    pub fn stiffness_of_dampers(&self, midpoint: &Midpoint, velocities: &[Vector6<f64>]) -> f64 {
        let energy = |k: usize| {
            let joint = self.joints[k];
            let drive = joint.drive.as_ref().filter(|drive| drive.damping() > 0.0)?;
            let frames = self.frames(&midpoint.ends, Instant::End, k);
            let (_, apart) = joint.arms(frames);
            let value = self.states[k].coordinate + self.deviation(k, &midpoint.ends, Instant::End)?;
            let row = joint.along(drive, frames, value, &apart)?;
            let rate = |of: &[Vector6<f64>], ground: (Vector3<f64>, Vector3<f64>)| {
                row.velocity(
                    self.linkage.pairs[k]
                        .map(|body| body.map_or(ground, |body| apart_of(&of[self.bodies[body as usize] as usize]))),
                )
            };
            let Grounding { velocities: of_ground, at_end, .. } = self.groundings[k];
            let change = rate(velocities, at_end) - rate(&midpoint.mean, of_ground);
            let mobility: f64 = (0..2)
                .filter_map(|side| {
                    let motion = &midpoint.start[self.bodies[self.linkage.pairs[k][side]? as usize] as usize];
                    Some(
                        row.force.norm_squared() / motion.mass
                            + row.torques[side].dot(&(motion.mobility * row.torques[side])),
                    )
                })
                .sum();
            Some(0.5 * (drive.damping() * midpoint.h * change).powi(2) * mobility)
        };
        (0..self.joints.len()).filter_map(energy).sum()
    }

    /// Solves the factorised linear system of the linkage for the right-hand side in `x`, in place.
    pub fn respond(&mut self) {
        let plan = &self.linkage.plan;
        if self.linkage.has_loops {
            self.matrix.solve_without_diagonals(plan, &mut self.x);
        } else {
            self.matrix.solve(plan, &mut self.x);
        }
    }

    /// Adds the velocity changes in the solution `x` of the linear system to `velocities`.
    pub fn add(&self, velocities: &mut [Vector6<f64>]) {
        for (&body, x) in self.bodies.iter().zip(&self.x) {
            velocities[body as usize] += x;
        }
    }

    /// Subtracts the joint unknowns in the solution `x` from the joint impulses, since their signs are opposite.
    pub fn add_impulses(&mut self) {
        for (impulse, x) in self.impulses.iter_mut().zip(&self.x[self.bodies.len()..]) {
            *impulse -= x;
        }
    }
}
