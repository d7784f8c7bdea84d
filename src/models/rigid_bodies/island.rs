//! One step of one island, whose bodies are solved together.
//!
//! Without joints, with `v_free = v + h M^-1 f` and the contact law `r = L(W, J v_free, ..)`,
//!
//! ```text
//! v+ = v_free + M^-1 J^T r,    q+ = q (+) h v+
//! ```
//!
//! With joints, or forces that depend on how bodies move, the motion is that of [`articulated`](self::articulated).

mod articulated;

use super::action::Action;
use super::contact::Contact;
use super::delassus;
use super::drive::DriveState;
use super::joint::{Joint, Reaction};
use super::linkage::Linkage;
use super::motion::Motion;
use super::scene::MultibodySystem;
use super::signals::Signals;
use contact::ImpactLaw;
use contact::law::{Cone, Contacts, Law, Report, sequential};
use nalgebra::{Vector3, Vector6};
use problem::Control;
use vi::coulomb::BlockMatrix;

/// What all islands of a scene share.
#[derive(Debug)]
pub struct Mechanism<'a> {
    /// All joints.
    pub joints: &'a [Joint],
    /// All linkages, and one for bodies without joints.
    pub linkages: Vec<Linkage>,
    pub alone: Linkage,
    /// Of each joint its linkage.
    pub of_joint: Vec<u32>,
    /// Metres a second squared.
    pub gravity: Vector3<f64>,
    /// Functions of time that drive joints.
    pub signals: &'a Signals,
}

impl<'a> Mechanism<'a> {
    /// That of a scene; `places` are those of its bodies among the `moving`.
    pub fn new(scene: &'a MultibodySystem, places: &[Option<u32>], moving: usize) -> Self {
        let linkages = Linkage::all(&scene.joints, places, moving);
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
        }
    }
}

/// What a linkage keeps from step to step.
#[derive(Clone, Debug, Default)]
pub struct Carried {
    /// The forces of its joints in the last step.
    pub tensions: Vec<Vector6<f64>>,
    /// The largest kinetic energy so far, in joules.
    pub largest_energy: f64,
    /// The halvings of a step that held in the last.
    pub halvings: u32,
    /// The drives of its joints.
    pub states: Vec<DriveState>,
    /// What its joints did in the last step.
    pub reactions: Vec<Reaction>,
}

impl Carried {
    /// That of a linkage at the start.
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

/// What was done in a step, in joules.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Work {
    /// By forces.
    pub forces: f64,
    /// By what moves by itself: motors and servos.
    pub drives: f64,
    /// Taken by dampers.
    pub damped: f64,
}

impl std::ops::AddAssign for Work {
    fn add_assign(&mut self, other: Self) {
        self.forces += other.forces;
        self.drives += other.drives;
        self.damped += other.damped;
    }
}

/// Why an island was not solved.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Unsolved {
    /// The equations of the joints have no solution.
    Joints,
    /// The step is too long for them.
    TooLong,
}

/// The bodies, contacts and joints of an island, copied out so that islands can be solved side by side.
#[derive(Debug)]
pub struct Island {
    /// Which of the moving bodies these are.
    pub bodies: Vec<u32>,
    /// The bodies: forces are in their velocities where there are no joints. After the solve with the velocities at the end of
    /// the step and, where there are joints, there.
    pub moving: Vec<Motion>,
    /// The contacts, between places in `moving`.
    pub contacts: Vec<Contact>,
    /// Their places among all contacts.
    pub sources: Vec<u32>,
    /// The joints, as places among all.
    pub joints: Vec<u32>,
    /// The linkages likewise, in ascending order.
    pub linkages: Vec<u32>,
    /// What its linkages keep.
    pub carried: Vec<Carried>,
    /// Forces on its bodies as programs, with the places of their bodies.
    pub actions: Vec<(Action, Vec<u32>)>,
    /// The time that its bodies have come to.
    pub t: f64,
    /// What drives and forces did.
    pub done: Work,
    /// The largest kinetic energy that they had, in joules.
    pub largest_energy: f64,
    /// The halvings of a step that held in the last.
    pub halvings: u32,
    /// The steps that it took, and Newton's iterations in them and in those that were too long.
    pub steps: u64,
    pub newton: u64,
    /// The set that friction is taken from.
    pub cone: Cone,
    /// How simultaneous impacts come about.
    pub impact_law: ImpactLaw,
    /// How the contact law was solved, if there were contacts.
    pub report: Option<Report>,
    /// Why it was not solved.
    pub unsolved: Option<Unsolved>,
}

impl Island {
    /// Room for an island.
    pub fn new(cone: Cone, impact_law: ImpactLaw) -> Self {
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
            halvings: 0,
            steps: 0,
            newton: 0,
            cone,
            impact_law,
            report: None,
            unsolved: None,
        }
    }

    /// Empties the island, keeping its memory.
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
        (self.largest_energy, self.halvings, self.steps, self.newton) = (0.0, 0, 0, 0);
        (self.report, self.unsolved) = (None, None);
    }

    /// Whether its bodies move by their mean velocities: they are joined, or forces depend on how they move.
    pub fn is_implicit(&self) -> bool {
        !(self.joints.is_empty() && self.actions.is_empty())
    }

    /// Solves for the impulses and puts them into the velocities; moves what joints hold together.
    pub fn solve(&mut self, h: f64, mechanism: &Mechanism<'_>, law: &mut Law, control: &Control) {
        if self.is_implicit() {
            self.solve_joined(h, mechanism, law, control);
            return;
        }
        self.steps = 1;
        // Who stops it throws away what the island was left with.
        let Some(matrix) = delassus::matrix(&self.contacts, &self.moving, control) else { return };
        let moving = &self.moving;
        let of = |body: u32| (moving[body as usize].velocity, moving[body as usize].omega);
        let free = self.contacts.iter().map(|contact| contact.velocity(of) + Vector3::x() * contact.bias).collect();
        let gaps: Vec<f64> = self.contacts.iter().map(|contact| contact.gap).collect();
        let impulses = self.contacts.iter().map(|contact| contact.impulse).collect();
        let impulses = self.impulses(&matrix, free, &gaps, true, h, impulses, law, control);
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
        }
    }

    /// The contact law with these velocities without impulses, from impulses that may be near.
    #[expect(clippy::too_many_arguments, reason = "the terms of the law")]
    fn impulses(
        &mut self,
        matrix: &BlockMatrix,
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
        let mu: Vec<f64> = self.contacts.iter().map(|contact| contact.law.friction).collect();
        let of = |contact: &Contact| if rebounds { contact.law.restitution } else { 0.0 };
        let restitution: Vec<f64> = self.contacts.iter().map(of).collect();
        let cone = vec![self.cone; gap.len()];
        let mut struck = vec![Vector3::zeros(); gap.len()];
        let (mu, restitution, cone) = (&mu[..], &restitution[..], &cone[..]);
        if rebounds && self.impact_law == ImpactLaw::Sequential {
            let contacts = Contacts { delassus: matrix, free: &free, before: &before, gap, mu, restitution, cone, h };
            struck = sequential(&contacts).0;
            for k in 0..gap.len() {
                let change = matrix.row_product(k, &struck);
                before[k] += change;
                free[k] += change;
            }
        }
        let contacts = Contacts { delassus: matrix, free: &free, before: &before, gap, mu, restitution, cone, h };
        let report = law.impulses(&contacts, &mut r, control);
        self.report = Some(self.report.map_or(report, |last| report.after(&last)));
        r.iter_mut().zip(&struck).for_each(|(r, struck)| *r += struck);
        r
    }
}
