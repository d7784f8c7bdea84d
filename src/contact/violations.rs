//! The largest violations of joints and gaps in a run, at the ends of steps and between them, with length scales for
//! comparison.
//!
//! Each joint or gap has its own unit. Its length scale in this unit is the largest value of `sum_j |J_ij (q_j -
//! q_j(0))|`, the displacement of the coordinates in it, and of the gap itself. Neither depends on the origin of the
//! coordinates.

use problem::{Constraints, MechanicalStructure};

/// The largest violation of each joint and gap in a run so far.
#[derive(Clone, Debug)]
pub struct Violations {
    joints: usize,
    start: Vec<f64>,
    rows: Vec<Violation>,
}

/// The largest violation of one joint or gap.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Violation {
    /// The largest violation, in the unit of the joint or gap.
    pub by: f64,
    /// The time of the largest violation of the joint or gap.
    pub t: f64,
    /// The largest length scale of the joint or gap so far.
    pub length: f64,
    /// The largest size of the terms of the joint or gap, relative to which its value has rounding errors.
    pub terms: f64,
    /// The largest tolerance that the joint or gap inherits from the coordinates; zero for a constant step size.
    pub tolerance: f64,
}

impl Violations {
    /// Starts the record of a run with initial coordinates `q`.
    pub fn new(structure: &MechanicalStructure, q: &[f64]) -> Self {
        let rows = vec![Violation::default(); structure.joints + structure.contacts.len()];
        Self { joints: structure.joints, start: q.to_vec(), rows }
    }

    /// Records the violations of joints and gaps at the coordinates `q`, given the sizes of the terms of each row and
    /// the tolerances of `q`; `is_held` returns whether a contact must stay closed.
    pub fn note(
        &mut self,
        t: f64,
        q: &[f64],
        constraints: &Constraints,
        (sizes, tolerances): (&[f64], &[f64]),
        is_held: impl Fn(usize) -> bool,
    ) {
        let joints = self.joints;
        for (row, seen) in self.rows.iter_mut().enumerate() {
            let (j, value) = (constraints.row(row), constraints.values[row]);
            let moved: f64 =
                j.iter().zip(q.iter().zip(&self.start)).map(|(j, (q, start))| (j * (q - start)).abs()).sum();
            let is_joint = row < joints;
            seen.length = seen.length.max(moved).max(if is_joint { 0.0 } else { value.abs() });
            seen.terms = seen.terms.max(constraints.size(row, q)).max(sizes.get(row).copied().unwrap_or(0.0));
            seen.tolerance = seen.tolerance.max(constraints.size(row, tolerances));
            seen.see(t, value, is_joint || is_held(row - joints));
        }
    }

    /// Records violations by the values of joints and gaps at a time between the ends of a step.
    pub fn note_values(&mut self, t: f64, values: &[f64], is_held: impl Fn(usize) -> bool) {
        let joints = self.joints;
        for (row, (seen, value)) in self.rows.iter_mut().zip(values).enumerate() {
            seen.see(t, *value, row < joints || is_held(row - joints));
        }
    }

    /// Returns the record with its times shifted by `by`, the start time of a run whose clock starts at zero.
    #[must_use]
    pub fn ahead(mut self, by: f64) -> Self {
        self.rows.iter_mut().for_each(|row| row.t += by);
        self
    }

    /// Returns the largest violation of each joint.
    pub fn joints(&self) -> &[Violation] {
        &self.rows[..self.joints]
    }

    /// Returns the largest violation of each gap.
    pub fn gaps(&self) -> &[Violation] {
        &self.rows[self.joints..]
    }
}

impl Violation {
    fn see(&mut self, t: f64, value: f64, is_held: bool) {
        let off = if is_held { value.abs() } else { -value };
        // A value of a joint or gap that is NaN counts as an infinite violation.
        if off > self.by || off.is_nan() {
            (self.by, self.t) = (if off.is_nan() { f64::INFINITY } else { off }, t);
        }
    }
}
