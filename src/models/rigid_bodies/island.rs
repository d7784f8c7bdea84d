//! One time step of one island: a set of bodies coupled by contacts and joints, solved together.
//!
//! Without joints, with the velocities `v_free = v + h M^-1 f` before contact and the contact law `r = L(W, J v_free,
//! ..)`,
//!
//! ```text
//! v+ = v_free + M^-1 J^T r,    q+ = q (+) h v+
//! ```
//!
//! Islands with joints, or with forces that depend on the motion of bodies, are solved by
//! [`articulated`](self::articulated).

mod articulated;

use super::action::Action;
use super::contact::Contact;
use super::delassus;
use super::drive::DriveState;
use super::friction::Coefficient;
use super::joint::{Joint, Reaction};
use super::linkage::Linkage;
use super::made_parts::MadeParts;
use super::motion::Motion;
use super::prescribed::{Ground, Grounding};
use super::scene::MultibodySystem;
use super::signals::Signals;
use contact::ImpactLaw;
use contact::law::{Coefficients, Cone, Contacts, Delassus, Law, Report, is_factored, sequential};
use nalgebra::{Vector3, Vector6};
use problem::Control;
use vi::Outcome;
use vi::coulomb::{Role, mean_speed};

/// Data of a multibody system that all its islands share.
#[derive(Debug)]
pub struct Mechanism<'a> {
    /// The joints of the multibody system.
    pub joints: &'a [Joint],
    /// The linkages of the multibody system: sets of bodies connected by joints.
    pub linkages: Vec<Linkage>,
    /// The linkage that stands for a single body without joints.
    pub alone: Linkage,
    /// For each joint of the multibody system, the index of its linkage.
    pub of_joint: Vec<u32>,
    /// The gravitational acceleration of the multibody system, in metres per second squared.
    pub gravity: Vector3<f64>,
    /// The functions of time that drive joints and bodies of the multibody system.
    pub signals: &'a Signals,
    /// The bodies with prescribed motion, with their poses at the beginning of the step.
    pub grounds: Vec<Ground>,
    /// In a comparison run, whose steps are to be divided into parts at least twice as long as those of the first run,
    /// the parts of the first run; otherwise `None`.
    pub exceeded: Option<MadeParts>,
}

impl<'a> Mechanism<'a> {
    /// Collects joints, linkages, signals and prescribed motions of a multibody system; `places` are the indices of
    /// its bodies among the `moving` bodies, `given` are their indices among the bodies with prescribed motion.
    pub fn new(scene: &'a MultibodySystem, places: &[Option<u32>], given: &[Option<u32>], moving: usize) -> Self {
        let linkages = Linkage::all(&scene.joints, places, given, moving);
        let mut of_joint = vec![0; scene.joints.len()];
        for (k, linkage) in linkages.iter().enumerate() {
            linkage.joints.iter().for_each(|&joint| of_joint[joint as usize] = k as u32);
        }
        Self {
            joints: &scene.joints,
            linkages,
            alone: Linkage::alone(),
            of_joint,
            gravity: scene.gravity,
            signals: &scene.signals,
            grounds: Vec::new(),
            exceeded: None,
        }
    }

    /// Returns the motion of the body with index `k` among those with prescribed motion, over a part of the step, of
    /// length `h` from time `t`.
    pub fn grounding(&self, k: u32, t: f64, h: f64) -> Grounding {
        self.grounds.get(k as usize).map_or(Grounding::WORLD, |ground| ground.over(t, h, self.signals))
    }
}

/// The state of a linkage that is carried from step to step.
#[derive(Clone, Debug, Default)]
pub struct Carried {
    /// The constraint forces of the linkage's joints in the last step.
    pub tensions: Vec<Vector6<f64>>,
    /// The largest kinetic energy of the linkage so far in the run, in joules.
    pub largest_energy: f64,
    /// The longest step sizes to try for the linkage without and with contacts, according to the parts into which the
    /// last steps were divided.
    pub parts: Parts,
    /// The accelerations of the linkage's bodies in the last step if it had no contacts; otherwise empty.
    pub accelerations: Vec<Vector6<f64>>,
    /// The states of the drives of the linkage's joints.
    pub states: Vec<DriveState>,
    /// The reactions of the linkage's joints in the last step.
    pub reactions: Vec<Reaction>,
}

impl Carried {
    /// Returns the state of a linkage at the beginning of a run.
    pub fn of(linkage: &Linkage, scene: &MultibodySystem) -> Self {
        let coordinate = |&joint: &u32| scene.joints[joint as usize].coordinate_at_start(&scene.bodies);
        let state = |joint| DriveState { coordinate: coordinate(joint), target: 0.0 };
        Self {
            tensions: vec![Vector6::zeros(); linkage.joints.len()],
            states: linkage.joints.iter().map(state).collect(),
            reactions: linkage
                .joints
                .iter()
                .map(|joint| Reaction { coordinate: coordinate(joint), ..Reaction::default() })
                .collect(),
            ..Self::default()
        }
    }
}

/// The longest step sizes to try for an island with joints, in seconds. Lengths, unlike numbers of halvings, keep their
/// meaning if a whole step is divided into parts.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Parts {
    /// The longest step size to try for an island without closed contacts.
    pub free: f64,
    /// The longest step size to try for an island with closed contacts.
    pub pushed: f64,
}

impl Default for Parts {
    fn default() -> Self {
        Self { free: f64::INFINITY, pushed: f64::INFINITY }
    }
}

impl Parts {
    /// Returns the smaller of both step sizes to try without contacts, and the smaller of both with contacts.
    pub fn shortest(self, other: Self) -> Self {
        Self { free: self.free.min(other.free), pushed: self.pushed.min(other.pushed) }
    }
}

/// An initial guess for a step, from an attempt at it: the mean velocities of bodies, and the joint impulses by
/// linkage.
#[derive(Debug)]
struct Guess {
    mean: Vec<Vector6<f64>>,
    impulses: Vec<Vec<Vector6<f64>>>,
}

/// The work of forces and drives on an island in a step, and the energy dissipated by its dampers, in joules.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Work {
    /// The work of applied forces on the island in the step.
    pub forces: f64,
    /// The work of motors, servos and additional forces along joint coordinates in the step.
    pub drives: f64,
    /// The energy dissipated by dampers of the island in the step.
    pub damped: f64,
}

impl std::ops::AddAssign for Work {
    fn add_assign(&mut self, other: Self) {
        self.forces += other.forces;
        self.drives += other.drives;
        self.damped += other.damped;
    }
}

/// Why the equations of an island were not solved.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Unsolved {
    /// The constraint equations of the island's joints have no solution.
    Joints,
    /// The time step is too long for the constraint equations of the joints.
    TooLong,
    /// A coefficient of friction of a contact is negative or not finite.
    Friction {
        /// The indices of the two bodies in contact among all bodies of the multibody system.
        bodies: [usize; 2],
        /// The value of the coefficient of friction, negative or not finite.
        mu: f64,
        /// The position of the contact at which the coefficient of friction was evaluated.
        place: [f64; 3],
    },
}

/// The bodies, contacts and joints of an island, copied so that islands can be solved in parallel.
#[derive(Debug)]
pub struct Island {
    /// The indices of the island's bodies among all moving bodies.
    pub bodies: Vec<u32>,
    /// The motions of the island's bodies. Before the solve, velocities include the forces if the island is explicit
    /// (no joints or motion-dependent forces). After the solve, velocities are those at the end of the step and, for
    /// an implicit island, poses as well.
    pub moving: Vec<Motion>,
    /// The island's contacts, whose bodies are indices into `moving`.
    pub contacts: Vec<Contact>,
    /// The indices of the island's contacts among all contacts of the step.
    pub sources: Vec<u32>,
    /// The indices of the island's joints among all joints of the multibody system.
    pub joints: Vec<u32>,
    /// The indices of the island's linkages among all linkages, in ascending order.
    pub linkages: Vec<u32>,
    /// The states of the island's linkages that are carried from step to step.
    pub carried: Vec<Carried>,
    /// The motion-dependent forces on the island's bodies, with the indices of the bodies on which each depends.
    pub actions: Vec<(Action, Vec<u32>)>,
    /// The time that the island's bodies have reached.
    pub t: f64,
    /// The work of drives and forces on the island in the step.
    pub done: Work,
    /// The largest kinetic energy of the island's bodies so far in the run, in joules.
    pub largest_energy: f64,
    /// The longest step sizes to try for the island without and with closed contacts.
    pub parts: Parts,
    /// Whether the island belongs to a comparison run, in which impacts within one step that happen at different times
    /// follow the sequential impact law; the first run treats them as simultaneous.
    pub is_beside: bool,
    /// The velocity change by gravity within the step: a contact that closes more slowly is not an impact, but a
    /// sustained contact.
    kick: f64,
    /// Whether the step of the island must not be divided further, and is attempted whatever its length.
    pub is_shortest: bool,
    /// The accelerations of the island's bodies in the last step; `None` where they are not known.
    accelerations: Vec<Option<Vector6<f64>>>,
    /// The result of the last attempt at the step of the island, as initial guess of the next attempt.
    guess: Option<Guess>,
    /// The number of parts into which the step of the island was divided.
    pub steps: u64,
    /// The begin and end times of the parts into which the step was divided, if the island is implicit (has joints or
    /// motion-dependent forces).
    pub made: Vec<[f64; 2]>,
    /// In a comparison run with longer steps, the total time in parts that are not at least twice as long as those of
    /// the first run.
    pub repeated: f64,
    /// The number of Newton iterations for the island, in accepted and rejected steps.
    pub newton: u64,
    /// The friction cone of the contact law, or its polyhedral approximation.
    pub cone: Cone,
    /// The impact law for several impacts of the island in one step.
    pub impact_law: ImpactLaw,
    /// The coefficients of friction of the multibody system that vary.
    pub coefficients: Vec<Coefficient>,
    /// The report of the contact solver for the island; `None` if there were no contacts.
    pub report: Option<Report>,
    /// Why the equations of the island were not solved; `None` if they were solved.
    pub unsolved: Option<Unsolved>,
}

impl Island {
    /// Creates an island without bodies, with the given friction cone, impact law and varying coefficients of friction.
    pub fn new(cone: Cone, impact_law: ImpactLaw, coefficients: &[Coefficient]) -> Self {
        Self {
            bodies: Vec::new(),
            moving: Vec::new(),
            contacts: Vec::new(),
            sources: Vec::new(),
            joints: Vec::new(),
            linkages: Vec::new(),
            carried: Vec::new(),
            actions: Vec::new(),
            t: 0.0,
            done: Work::default(),
            largest_energy: 0.0,
            parts: Parts::default(),
            is_beside: false,
            kick: 0.0,
            is_shortest: false,
            accelerations: Vec::new(),
            guess: None,
            steps: 0,
            made: Vec::new(),
            repeated: 0.0,
            newton: 0,
            cone,
            impact_law,
            coefficients: coefficients.to_vec(),
            report: None,
            unsolved: None,
        }
    }

    /// Clears the island for the next set of bodies, keeping its allocations.
    pub fn clear(&mut self) {
        self.bodies.clear();
        self.moving.clear();
        self.contacts.clear();
        self.sources.clear();
        self.joints.clear();
        self.linkages.clear();
        self.carried.clear();
        self.actions.clear();
        self.done = Work::default();
        (self.largest_energy, self.steps, self.newton) = (0.0, 0, 0);
        self.made.clear();
        self.repeated = 0.0;
        (self.parts, self.guess) = (Parts::default(), None);
        self.accelerations.clear();
        (self.report, self.unsolved) = (None, None);
    }

    /// Returns whether the island is integrated by the implicit midpoint rule: it has joints, or forces that depend
    /// on the motion.
    pub fn is_implicit(&self) -> bool {
        !(self.joints.is_empty() && self.actions.is_empty())
    }

    /// Solves for the contact and joint impulses of the step and applies them to the velocities of the island's bodies;
    /// for an implicit island, also moves its bodies.
    pub fn solve(&mut self, h: f64, mechanism: &Mechanism<'_>, law: &mut Law, control: &Control) {
        (self.is_beside, self.kick) = (mechanism.exceeded.is_some(), h * mechanism.gravity.norm());
        if self.is_implicit() {
            self.solve_joined(h, mechanism, law, control);
            return;
        }
        self.steps = 1;
        // If the solve is interrupted through `control`, the caller discards the island.
        let is_rough = self.contacts.iter().any(|contact| contact.law.is_rough());
        // Do not use the factored Delassus operator for contact patches: its solver treats contacts one by one, but
        // force and torque of a contact patch share one friction set.
        let has_patches = self.contacts.iter().any(Contact::is_torque);
        let (blocks, factors);
        let matrix = if !has_patches && is_factored(self.contacts.len(), is_rough.then_some(self.cone)) {
            factors = delassus::factors(&self.contacts, &self.moving);
            Delassus::Factors(&factors)
        } else {
            let Some(assembled) = delassus::matrix(&self.contacts, &self.moving, control) else { return };
            blocks = assembled;
            Delassus::Blocks(&blocks)
        };
        let moving = &self.moving;
        let of = |body: u32| (moving[body as usize].velocity, moving[body as usize].omega);
        let free = self.contacts.iter().map(|contact| contact.velocity(of) + Vector3::x() * contact.bias).collect();
        let gaps: Vec<f64> = self.contacts.iter().map(|contact| contact.gap).collect();
        let impulses = self.contacts.iter().map(|contact| contact.impulse).collect();
        let impulses = self.impulses(matrix, free, &gaps, true, h, impulses, law, control);
        for (contact, impulse) in self.contacts.iter_mut().zip(impulses) {
            contact.impulse = impulse;
            for side in [0, 1] {
                if let Some(body) = contact.bodies[side] {
                    let (impulse, angular) = contact.wrench(side, &contact.impulse);
                    self.moving[body as usize].push(&impulse, &angular);
                }
            }
        }
        let moving = &self.moving;
        let of = |body: u32| (moving[body as usize].velocity, moving[body as usize].omega);
        for contact in &mut self.contacts {
            let after = contact.velocity(of);
            contact.foresee(h, of);
            contact.work = contact.impulse.component_mul(&(0.5 * (after + contact.before)));
            contact.lacks = (-contact.law.restitution * contact.before.x - after.x).max(0.0);
        }
    }

    /// Returns the roles of the island's contacts in the contact law (point contact, or force or torque of a contact
    /// patch); empty if all are contacts at points.
    fn roles(&self) -> Vec<Role> {
        if self.contacts.iter().any(Contact::is_torque) {
            self.contacts.iter().map(|contact| contact.role).collect()
        } else {
            Vec::new()
        }
    }

    /// Evaluates the varying coefficients of friction at the end of the step, for contacts with the relative velocities
    /// `u`; returns false if one is negative or not finite.
    fn take_coefficients(&mut self, u: &[Vector3<f64>], h: f64, mu: &mut [f64]) -> bool {
        for (k, (contact, mu)) in self.contacts.iter().zip(mu).enumerate() {
            let Some(place) = contact.law.varying else { continue };
            let t = self.t + h;
            let slip = contact.slip_speed(&u[k]);
            // On a contact patch, evaluate the coefficient of friction at the mean of the slip speeds over the patch.
            let slip =
                if let Role::Force(reach) = contact.role { mean_speed(slip, reach.drill * u[k + 1].x) } else { slip };
            match self.coefficients[place as usize].at(t, &contact.position, slip) {
                Ok(value) => *mu = value,
                Err(mu) => {
                    let bodies = [contact.key.0 as usize, contact.key.1 as usize];
                    let place = contact.position.into();
                    self.unsolved = Some(Unsolved::Friction { bodies, mu, place });
                    return false;
                }
            }
        }
        true
    }

    /// Solves the contact law for the relative velocities `free` before contact, from the initial guess `r`, by the
    /// selected impact law. In a comparison run, impacts within one step that happen one after the other follow the
    /// sequential impact law, so that the runs differ by the effect of the order of impacts.
    #[expect(clippy::too_many_arguments, reason = "the terms of the law")]
    fn impulses(
        &mut self,
        delassus: Delassus<'_>,
        free: Vec<Vector3<f64>>,
        gap: &[f64],
        rebounds: bool,
        h: f64,
        r: Vec<Vector3<f64>>,
        law: &mut Law,
        control: &Control,
    ) -> Vec<Vector3<f64>> {
        if !(self.is_beside && rebounds && self.impact_law == ImpactLaw::Simultaneous) {
            return self.impulses_by(self.impact_law, delassus, free, gap, rebounds, h, r, law, control);
        }
        let solved =
            self.impulses_by(self.impact_law, delassus, free.clone(), gap, rebounds, h, r.clone(), law, control);
        if !self.strikes_in_turn(&solved) {
            return solved;
        }
        self.impulses_by(ImpactLaw::Sequential, delassus, free, gap, rebounds, h, r, law, control)
    }

    /// Returns whether contacts that are open at the beginning of the step, and have the impulses `r`, close at
    /// different times, with an approach velocity above the velocity change by gravity within a step. A contact
    /// without initial approach closes after another contact has been struck.
    fn strikes_in_turn(&self, r: &[Vector3<f64>]) -> bool {
        let is_struck =
            |contact: &Contact, r: &Vector3<f64>| !contact.is_torque() && r.x > 0.0 && contact.gap > contact.no_gap;
        let struck = self.contacts.iter().zip(r).filter(|(contact, r)| is_struck(contact, r));
        let mut first: Option<(f64, f64)> = None;
        for (contact, _) in struck {
            let approach = (-contact.before.x).max(0.0);
            let time = contact.gap / approach;
            let Some((other, speed)) = first else {
                first = Some((time, approach));
                continue;
            };
            // Two contacts whose gaps differ by less than the gap tolerance count as closing at the same time.
            let apart = (time - other).abs() * approach.max(speed);
            if (apart > contact.no_gap || apart.is_nan()) && approach.max(speed) > self.kick {
                return true;
            }
        }
        false
    }

    /// Solves the contact law of the island with the given impact law.
    #[expect(clippy::too_many_arguments, reason = "the terms of the law")]
    fn impulses_by(
        &mut self,
        impact_law: ImpactLaw,
        delassus: Delassus<'_>,
        mut free: Vec<Vector3<f64>>,
        gap: &[f64],
        rebounds: bool,
        h: f64,
        mut r: Vec<Vector3<f64>>,
        law: &mut Law,
        control: &Control,
    ) -> Vec<Vector3<f64>> {
        if self.contacts.is_empty() {
            return r;
        }
        let mut before: Vec<Vector3<f64>> = self.contacts.iter().map(|contact| contact.before).collect();
        let mut mu: Vec<f64> = self.contacts.iter().map(|contact| contact.law.friction).collect();
        let varies = self.contacts.iter().any(|contact| contact.law.varying.is_some());
        if varies && !self.take_coefficients(&before, h, &mut mu) {
            return r;
        }
        let of = |contact: &Contact| if rebounds { contact.law.restitution } else { 0.0 };
        let restitution: Vec<f64> = self.contacts.iter().map(of).collect();
        let cone = vec![self.cone; gap.len()];
        let roles = self.roles();
        let roles = &roles[..];
        let mut struck = vec![Vector3::zeros(); gap.len()];
        let (restitution, cone) = (&restitution[..], &cone[..]);
        if rebounds && impact_law == ImpactLaw::Sequential {
            let contacts =
                Contacts { delassus, free: &free, before: &before, gap, mu: &mu, restitution, cone, roles, h };
            sequential(&contacts).into_iter().for_each(|(k, strike)| struck[k] += strike);
            for (k, change) in delassus.product(&struck).iter().enumerate() {
                before[k] += change;
                free[k] += change;
            }
        }
        let mut coefficients = Coefficients::default();
        loop {
            let contacts =
                Contacts { delassus, free: &free, before: &before, gap, mu: &mu, restitution, cone, roles, h };
            let mut report = law.impulses(&contacts, &mut r, control);
            let mut is_over = !varies || report.outcome != Outcome::Solved;
            if !is_over {
                let after = contacts.after(&r);
                let mut due = mu.clone();
                if !self.take_coefficients(&after, h, &mut due) {
                    report.outcome = Outcome::Breakdown;
                    is_over = true;
                } else if let Some(off) = coefficients.settle(&mut mu, due, &r) {
                    report.residual = report.residual.max(off);
                    is_over = true;
                }
            }
            self.report = Some(self.report.map_or(report, |last| report.after(&last)));
            if is_over {
                break;
            }
        }
        r.iter_mut().zip(&struck).for_each(|(r, struck)| *r += struck);
        r
    }
}
