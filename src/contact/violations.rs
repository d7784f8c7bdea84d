//! How far joints and gaps were off in a run, at the ends of steps and between them, beside the lengths that they met.
//!
//! A joint or a gap has a unit of its own. What it met is measured in that unit: `sum_j |J_ij (q_j - q_j(0))|`, how far
//! the coordinates in it have moved, and the gap itself. Neither depends on where the origin of the coordinates is.

use problem::{Constraints, MechanicalStructure};

/// Violations of joints and gaps so far.
#[derive(Clone, Debug)]
pub struct Violations {
    joints: usize,
    start: Vec<f64>,
    rows: Vec<Violation>,
}

/// The largest violation of one joint or gap.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Violation {
    /// By how much it was off, in its own unit.
    pub by: f64,
    /// When.
    pub t: f64,
    /// The largest length met.
    pub length: f64,
    /// The largest size of its terms, whose rounding it has.
    pub terms: f64,
    /// The most that tolerances on the coordinates leave open of it; zero where steps have one size.
    pub tolerance: f64,
}

impl Violations {
    /// None so far, of a run that starts at `q`.
    pub fn new(structure: &MechanicalStructure, q: &[f64]) -> Self {
        let rows = vec![Violation::default(); structure.joints + structure.contacts.len()];
        Self { joints: structure.joints, start: q.to_vec(), rows }
    }

    /// Takes a place into account, with the size of the terms of each row and the tolerances on `q` there; `is_held` tells
    /// which contacts must stay closed.
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

    /// Takes values of joints and gaps at a place between two steps into account.
    pub fn note_values(&mut self, t: f64, values: &[f64], is_held: impl Fn(usize) -> bool) {
        let joints = self.joints;
        for (row, (seen, value)) in self.rows.iter_mut().zip(values).enumerate() {
            seen.see(t, *value, row < joints || is_held(row - joints));
        }
    }

    /// The same by a clock that is ahead by so much.
    #[must_use]
    pub fn ahead(mut self, by: f64) -> Self {
        self.rows.iter_mut().for_each(|row| row.t += by);
        self
    }

    /// Of each joint.
    pub fn joints(&self) -> &[Violation] {
        &self.rows[..self.joints]
    }

    /// Of each gap.
    pub fn gaps(&self) -> &[Violation] {
        &self.rows[self.joints..]
    }
}

impl Violation {
    fn see(&mut self, t: f64, value: f64, is_held: bool) {
        let off = if is_held { value.abs() } else { -value };
        // What is not a number is off by more than anything.
        if off > self.by || off.is_nan() {
            (self.by, self.t) = (if off.is_nan() { f64::INFINITY } else { off }, t);
        }
    }
}
