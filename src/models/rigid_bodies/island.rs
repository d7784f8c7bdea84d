//! One step of one island. With `v_free = v + h M^-1 f` and the contact law `r = L(W, J v_free, ..)`
//!
//! ```text
//! v+ = v_free + M^-1 (J^T r + G^T lambda),    c(q (+) h v+) = 0
//! ```
//!
//! The equations of the joints are asked to hold at the end of the step, as in SHAKE (Ryckaert, Ciccotti and Berendsen
//! 1977), which is symplectic: joints neither drift nor feed energy. Newton with the derivative `G` of the start finds
//! `G v+ = -b`, a few iterations in which `b` takes up the curvature of `c`.

use super::constraints::{Constraints, poses};
use super::contact::Contact;
use super::delassus;
use super::joint::{Joint, Row};
use super::motion::Motion;
use contact::ImpactLaw;
use contact::law::{Cone, Contacts, Law, Report, sequential};
use nalgebra::Vector3;
use problem::Control;
use vi::coulomb::BlockMatrix;

/// Iterations for the curvature of joints; each gains the digits of `h w`.
const ITERATIONS: usize = 8;

/// Errors of joints that are rounding, in parts of the lengths about.
const ROUNDING: f64 = 1e-14;

/// The bodies, contacts and joints of an island, copied out so that islands can be solved side by side.
#[derive(Debug)]
pub struct Island {
    /// Which of the moving bodies these are.
    pub bodies: Vec<u32>,
    /// The bodies, forces already in their velocities; after the solve with the velocities at the end of the step.
    pub moving: Vec<Motion>,
    /// The contacts, between places in `moving`.
    pub contacts: Vec<Contact>,
    /// Their places among all contacts.
    pub sources: Vec<u32>,
    /// The joints, as places among all.
    pub joints: Vec<u32>,
    /// The set that friction is taken from.
    pub cone: Cone,
    /// How simultaneous impacts come about.
    pub impact_law: ImpactLaw,
    /// How the contact law was solved, if there were contacts.
    pub report: Option<Report>,
    /// Whether the rows of the joints could not be solved.
    pub is_singular: bool,
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
            cone,
            impact_law,
            report: None,
            is_singular: false,
        }
    }

    /// Empties the island, keeping its memory.
    pub fn clear(&mut self) {
        self.bodies.clear();
        self.moving.clear();
        self.contacts.clear();
        self.sources.clear();
        self.joints.clear();
        (self.report, self.is_singular) = (None, false);
    }

    /// The joints, each with the places of its bodies here; `places` are those among all that move.
    fn joined<'j>(&self, joints: &'j [Joint], places: &[Option<u32>]) -> Vec<(&'j Joint, [Option<u32>; 2])> {
        let place = |body: usize| places[body].and_then(|body| self.bodies.binary_search(&body).ok()).map(|k| k as u32);
        let joint = |&k: &u32| (&joints[k as usize], joints[k as usize].places(&place));
        self.joints.iter().map(joint).collect()
    }

    /// Solves for the impulses and puts them into the velocities.
    pub fn solve(&mut self, h: f64, joints: &[Joint], places: &[Option<u32>], law: &mut Law, control: &Control) {
        let joined = self.joined(joints, places);
        let constraints = Constraints::new(&joined, &self.moving);
        match constraints {
            None => {
                // Who stops it throws away what the island was left with.
                let Some(matrix) = delassus::matrix(&self.contacts, &self.moving, control) else { return };
                self.impulses(&matrix, h, law, control);
                push_contacts(&self.contacts, &mut self.moving);
            }
            Some(constraints) => self.solve_joined(constraints, h, &joined, law, control),
        }
    }

    /// Takes out of the velocities what the joints do not let be, by impulses of theirs alone.
    pub fn obey_joints(&mut self, joints: &[Joint], places: &[Option<u32>]) {
        if let Some(mut constraints) = Constraints::new(&self.joined(joints, places), &self.moving) {
            let none = vec![0.0; constraints.values().count()];
            self.is_singular = !constraints.hold(&none, &mut self.moving);
        }
    }

    /// The contact law, from the velocities as they stand.
    fn impulses(&mut self, matrix: &BlockMatrix, h: f64, law: &mut Law, control: &Control) {
        if self.contacts.is_empty() {
            return;
        }
        let moving = &self.moving;
        let of = |body: u32| (moving[body as usize].velocity, moving[body as usize].omega);
        let free = self.contacts.iter().map(|contact| contact.velocity(of) + Vector3::x() * contact.bias);
        let mut free: Vec<Vector3<f64>> = free.collect();
        let mut before: Vec<Vector3<f64>> = self.contacts.iter().map(|contact| contact.before).collect();
        let gap: Vec<f64> = self.contacts.iter().map(|contact| contact.gap).collect();
        let mu: Vec<f64> = self.contacts.iter().map(|contact| contact.law.friction).collect();
        let restitution: Vec<f64> = self.contacts.iter().map(|contact| contact.law.restitution).collect();
        let cone = vec![self.cone; gap.len()];
        let mut struck = vec![Vector3::zeros(); gap.len()];
        let (mu, restitution, cone) = (&mu[..], &restitution[..], &cone[..]);
        if self.impact_law == ImpactLaw::Sequential {
            let contacts =
                Contacts { delassus: matrix, free: &free, before: &before, gap: &gap, mu, restitution, cone, h };
            struck = sequential(&contacts).0;
            for k in 0..gap.len() {
                let change = matrix.row_product(k, &struck);
                before[k] += change;
                free[k] += change;
            }
        }
        let contacts = Contacts { delassus: matrix, free: &free, before: &before, gap: &gap, mu, restitution, cone, h };
        let mut r: Vec<Vector3<f64>> = self.contacts.iter().map(|contact| contact.impulse).collect();
        self.report = Some(law.impulses(&contacts, &mut r, control));
        r.iter_mut().zip(&struck).for_each(|(r, struck)| *r += struck);
        for (contact, r) in self.contacts.iter_mut().zip(r) {
            contact.impulse = r;
        }
    }

    fn solve_joined(
        &mut self,
        mut constraints: Constraints,
        h: f64,
        joints: &[(&Joint, [Option<u32>; 2])],
        law: &mut Law,
        control: &Control,
    ) {
        let n = self.contacts.len();
        let Some(blocks) = delassus::blocks(&self.contacts, &self.moving, control) else { return };
        let coupling = constraints.coupling(&self.contacts, &self.moving, control);
        let matrix = coupling.and_then(|coupling| BlockMatrix::from_blocks(n, blocks.into_iter().chain(coupling)));
        let Some(matrix) = matrix else {
            self.is_singular = true;
            return;
        };
        let start = self.moving.clone();
        let mut b: Vec<f64> = constraints.values().map(|c| c / h).collect();
        let mut last = f64::INFINITY;
        for _ in 0..ITERATIONS {
            self.moving.copy_from_slice(&start);
            self.is_singular |= !constraints.hold(&b, &mut self.moving);
            self.impulses(&matrix, h, law, control);
            self.moving.copy_from_slice(&start);
            push_contacts(&self.contacts, &mut self.moving);
            self.is_singular |= !constraints.hold(&b, &mut self.moving);
            let (error, size) = self.errors(h, joints, &mut b);
            if self.is_singular || error <= ROUNDING * size || error >= 0.5 * last {
                return;
            }
            last = error;
        }
    }

    /// Adds the errors of the joints at the end of the step to `b`; the greatest of them, and the size of the coordinates.
    fn errors(&self, h: f64, joints: &[(&Joint, [Option<u32>; 2])], b: &mut [f64]) -> (f64, f64) {
        let mut end = self.moving.clone();
        end.iter_mut().for_each(|motion| motion.drift(h));
        let mut rows: Vec<Row> = Vec::with_capacity(b.len());
        for (joint, bodies) in joints {
            joint.rows(poses(*bodies, &end), &mut rows);
        }
        let mut greatest = 0.0_f64;
        for (b, row) in b.iter_mut().zip(&rows) {
            *b += row.value / h;
            greatest = greatest.max(row.value.abs());
        }
        let size = end.iter().map(|motion| motion.pose.translation.vector.amax()).fold(1e-3, f64::max);
        (greatest, size)
    }
}

fn push_contacts(contacts: &[Contact], moving: &mut [Motion]) {
    for contact in contacts {
        for side in [0, 1] {
            if let Some(body) = contact.bodies[side] {
                let (impulse, angular) = contact.wrench(side, &contact.impulse);
                moving[body as usize].push(&impulse, &angular);
            }
        }
    }
}
