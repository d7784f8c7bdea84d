//! Varying coefficients of friction. A step evaluates them at its end, as it does velocities; see [`Coefficients`].

use super::{State, VelocityStep};
use crate::active_contacts::ActiveContacts;
use crate::law::{Coefficients, Contacts, Report, admissible};
use crate::settings::ContactError;
use nalgebra::{Vector2, Vector3};
use problem::Control;
use vi::Outcome;

/// Data of the contacts for the contact law: the velocities `without` contact impulses at the end of a step, the
/// velocities `before` the step, gaps and restitution.
pub(super) struct Motion<'a> {
    pub without: &'a [Vector3<f64>],
    pub before: &'a [Vector3<f64>],
    pub gap: &'a [f64],
    pub restitution: &'a [f64],
    /// The generalised velocities that the step ends with if no contact impulse acts.
    pub free: &'a [f64],
    /// The step size that the contact law divides gaps by (`h`), and that of the motion (`duration`), which is zero for
    /// an impact.
    pub h: f64,
    pub duration: f64,
}

impl VelocityStep<'_> {
    /// Returns the coefficients of friction of contacts at a state; the contacts have the velocities `u`.
    ///
    /// # Errors
    /// Fails if a coefficient is negative or not finite.
    pub(super) fn coefficients(
        &mut self,
        State { t, q, v }: &State,
        contacts: &[usize],
        u: &[Vector3<f64>],
    ) -> Result<Vec<f64>, ContactError> {
        let coefficient = |(&k, u): (&usize, &Vector3<f64>)| {
            let contact = &self.structure.contacts[k];
            if !contact.varies {
                return Ok(contact.mu);
            }
            let mu = self.problem.friction(k, *t, q, v, contact.slip_speed(&Vector2::new(u.y, u.z)));
            admissible(mu).ok_or(ContactError::Friction { contact: k, mu, t: *t })
        };
        contacts.iter().zip(u).map(coefficient).collect()
    }

    /// Applies the contact law with the coefficients of friction at the end of the step, and stores these
    /// coefficients in `scene`, the active contacts.
    pub(super) fn law_of_contact(
        &mut self,
        state: &State,
        near: &[usize],
        scene: &mut ActiveContacts,
        motion: &Motion<'_>,
        r: &mut [Vector3<f64>],
        control: &Control,
    ) -> Result<Report, ContactError> {
        let Motion { without, before, gap, restitution, free, h, duration } = *motion;
        let mut report: Option<Report> = None;
        let varies = near.iter().any(|&k| self.structure.contacts[k].varies);
        let mut coefficients = Coefficients::default();
        loop {
            let contacts: Contacts<'_> = scene.contacts(without, before, gap, restitution, h);
            let solved = self.law.impulses(&contacts, r, control);
            let mut made = report.map_or(solved, |earlier| solved.after(&earlier));
            if !varies || solved.outcome != Outcome::Solved {
                return Ok(made);
            }
            let mut v = free.to_vec();
            scene.apply(&self.structure, &self.delassus, r, &mut v);
            let after = scene.velocities(&self.structure, &self.constraints, &v);
            let q = state.q.iter().zip(&v).map(|(q, v)| q + duration * v).collect();
            let ahead = State { t: state.t + duration, q, v };
            let due = self.coefficients(&ahead, near, &after)?;
            let mut mu = scene.friction().to_vec();
            if let Some(off) = coefficients.settle(&mut mu, due, r) {
                made.residual = made.residual.max(off);
                return Ok(made);
            }
            scene.set_friction(mu);
            report = Some(made);
        }
    }
}
