//! Projection onto the constraints with the least change in the metric of `M`, without a velocity that would add
//! energy.

use super::{State, VelocityStep};
use crate::active_contacts::ActiveContacts;
use crate::delassus::dot;
use crate::settings::ContactError;
use nalgebra::Vector3;
use problem::Control;
use vi::Outcome;

/// Largest number of Newton iterations that project the coordinates `q` onto the constraints.
const CORRECTIONS: usize = 6;

/// A violation below this fraction of the constraint's terms is accepted as zero in the projection of coordinates.
const OFF: f64 = 1e-13;

/// A violation below this fraction of the constraint's terms is rounding if an iteration does not halve it.
const ROUNDING: f64 = 1e-10;

impl VelocityStep<'_> {
    /// Projects `q` onto the joints and gaps among the given rows, and `v` onto all given rows, with the least change
    /// in the metric of `M`; dependent rows share the correction.
    ///
    /// # Errors
    /// See [`VelocityStep::advance`].
    pub fn project(&mut self, state: &mut State, rows: &[usize]) -> Result<(), ContactError> {
        let lost = ContactError::Singular { t: state.t };
        let holonomic: Vec<usize> =
            rows.iter().copied().filter(|&row| row < self.structure.joints + self.structure.contacts.len()).collect();
        for pass in 0..CORRECTIONS {
            self.problem.constraints(state.t, &state.q, &mut self.constraints);
            self.check_constraints(state.t)?;
            self.survey(&state.q, &state.v, 0.0);
            self.factorised = None;
            self.factorise(state, 0.0)?;
            let off: Vec<f64> = holonomic.iter().map(|&row| self.constraints.values[row]).collect();
            let is_left = |(off, &row): (&f64, &usize)| off.abs() <= OFF * self.sizes[row];
            if pass + 1 == CORRECTIONS || off.iter().zip(&holonomic).all(is_left) {
                break;
            }
            if !self.delassus.remove(&self.constraints, &holonomic, &off, &mut state.q) {
                return Err(lost);
            }
        }
        let off: Vec<f64> = rows.iter().map(|&row| self.constraints.velocity(row, &state.v)).collect();
        if self.delassus.remove(&self.constraints, rows, &off, &mut state.v) { Ok(()) } else { Err(lost) }
    }

    /// Projects `q` so that no gap is negative and every joint holds, and `v` onto the joints; returns whether the
    /// projection succeeded.
    ///
    /// # Errors
    /// Fails if a quantity is not finite, or `M` is singular.
    pub fn resolve(&mut self, state: &mut State, control: &Control) -> Result<bool, ContactError> {
        self.problem.constraints(state.t, &state.q, &mut self.constraints);
        self.check_constraints(state.t)?;
        self.factorise(state, 0.0)?;
        self.survey(&state.q, &state.v, 0.0);
        self.correct(state, control)?;
        self.problem.constraints(state.t, &state.q, &mut self.constraints);
        self.check_constraints(state.t)?;
        if !self.delassus.hold_joints(&self.constraints) {
            return Err(ContactError::Singular { t: state.t });
        }
        let violation: Vec<f64> = (0..self.structure.joints).map(|i| self.constraints.velocity(i, &state.v)).collect();
        self.delassus.obey_joints(&violation, &mut state.v);
        Ok(self.farthest() <= ROUNDING)
    }

    /// Returns the largest violation of a joint or a gap, relative to its terms.
    fn farthest(&self) -> f64 {
        let off =
            |(row, value): (usize, &f64)| if row < self.structure.joints { value.abs() } else { (-value).max(0.0) };
        let relative = |(off, size): (f64, &f64)| if off > 0.0 { off / size } else { 0.0 };
        self.constraints.values.iter().enumerate().map(off).zip(&self.sizes).map(relative).fold(0.0, f64::max)
    }

    /// Projects the remaining violations of joints and negative gaps out of `q`. The contact law, with gaps in place
    /// of velocities, allows one gap to open while another closes.
    pub(super) fn correct(&mut self, state: &mut State, control: &Control) -> Result<(), ContactError> {
        let (joints, contacts) = (self.structure.joints, self.structure.contacts.len());
        if joints + contacts == 0 {
            return Ok(());
        }
        let mut low: Vec<usize> = Vec::new();
        let mut farthest = f64::INFINITY;
        for pass in 0..CORRECTIONS {
            self.problem.constraints(state.t, &state.q, &mut self.constraints);
            self.check_constraints(state.t)?;
            let off = self.farthest();
            if off <= OFF || (off <= ROUNDING && off > 0.5 * farthest) {
                return Ok(());
            }
            farthest = off;
            let (phi, gaps) = self.constraints.values.split_at(joints);
            let is_low = |k: usize| gaps[k] < -OFF * self.sizes[joints + k];
            low.extend((0..contacts).filter(|&k| is_low(k) && !low.contains(&k)).collect::<Vec<_>>());
            // Give up the projection after a few iterations if the state seems to admit none; the next step starts
            // from this state.
            let lost = ContactError::Singular { t: state.t };
            if pass + 1 == CORRECTIONS || !self.delassus.hold_joints(&self.constraints) {
                return Ok(());
            }
            let before = state.q.clone();
            self.delassus.obey_joints(phi, &mut state.q);
            if low.is_empty() {
                continue;
            }
            low.sort_unstable();
            let moved: Vec<f64> = state.q.iter().zip(&before).map(|(q, before)| q - before).collect();
            let gap = |k: usize| gaps[k] + dot(self.constraints.row(joints + k), &moved);
            let gaps: Vec<_> = low.iter().map(|&k| Vector3::new(gap(k), 0.0, 0.0)).collect();
            let near = ActiveContacts::new(&self.structure, &self.constraints, &mut self.delassus, &low).ok_or(lost)?;
            let mut p = vec![Vector3::zeros(); low.len()];
            let report = self.law.impulses(&near.without_friction(&gaps), &mut p, control);
            if report.outcome == Outcome::Solved {
                near.apply(&self.structure, &self.delassus, &p, &mut state.q);
            }
        }
        Ok(())
    }
}
