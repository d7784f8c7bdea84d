//! The collocation polynomial of one step, `y(t_n + theta h) = y_n + sum_i l_i(theta) Z_i`, of degree `s`, whose slope
//! is that of the rates at the stages. For the states one more degree corrects the slope at the beginning of the step.
//!
//! The slope that the polynomial lacks at the beginning of the step, times `h`, is `h E^-1` applied to the terms of
//! the embedded error estimate, so that it is filtered by the same factors. Multiplied by the bubble, a polynomial
//! that changes neither the ends nor the slopes at the stages, it raises the order between the ends of steps from
//! `s + 1` to `s + 2` at no cost.

use super::face::ActiveFace;
use super::screening::Between;
use super::stages::combine;
use super::tableau::{MOST_STAGES, Tableau};

/// Estimated errors of the states over a step whose size is prescribed; all fields are empty if the step size is
/// adaptive.
#[derive(Clone, Debug, Default)]
pub struct GivenStep {
    /// Errors at the end of the step, raised to the power [`Radau::error_power`].
    ///
    /// [`Radau::error_power`]: super::stepper::Radau::error_power
    pub at_end: Vec<f64>,
    /// Error of each state between the ends of the step, including those of transients that have decayed at its end.
    pub within: Vec<f64>,
    /// Error of each state at the end of the step from variations of the rates between the stages; empty if the stages
    /// show these variations.
    pub missed: Vec<f64>,
    /// Whether the rows of the problem, in a step with the variational inequality coupled over its stages, vary with
    /// time by more than their values at both ends and the middle of the step show.
    pub is_blind: bool,
}

/// The last accepted step of a run, with the data of its dense output.
#[derive(Clone, Debug, Default)]
pub(super) struct Step {
    /// Time at the beginning of the last accepted step.
    pub t: f64,
    /// Size of the last accepted step.
    pub h: f64,
    /// Unknowns `y` at the beginning of the step.
    pub y: Vec<f64>,
    /// The stage increments, in `s` blocks of the length of `y`.
    pub z: Vec<f64>,
    /// Correction of the slope of the states at the beginning of the step, times the step size `h`; empty if it is
    /// not known.
    pub slope: Vec<f64>,
    /// The slope of the states with which the next step should begin: that at the end of this step, or that of the
    /// rates at the beginning of a run or a face; empty if neither is known.
    pub end_slope: Vec<f64>,
    /// The active face of `K` on which the step was made.
    pub face: ActiveFace,
    /// Whether the step kept one active face of `K`.
    pub is_smooth: bool,
    /// Result of the screening for events between the stages of the step; `None` if there was nothing to screen.
    pub screened: Option<Between>,
    /// Largest change of a state, in tolerances, by a switch within the step that was not located.
    pub unlocated: Option<f64>,
    /// Error estimates of a step whose size is prescribed.
    pub given: GivenStep,
    /// Whether the step was repeated with derivatives evaluated at its beginning.
    pub is_remade: bool,
    basis: Vec<f64>,
}

impl Step {
    /// Stores a step; allocates nothing once a step with as many unknowns and stages has been stored.
    pub fn set(&mut self, t: f64, h: f64, y: &[f64], z: &[f64], face: &ActiveFace) {
        (self.t, self.h, self.is_remade) = (t, h, false);
        self.y.clear();
        self.y.extend_from_slice(y);
        self.z.clear();
        self.z.extend_from_slice(z);
        self.face.clone_from(face);
    }

    /// Sets the slope of the states at the end of the step, which was made with `tableau`, for `states` states.
    pub fn set_end_slope(&mut self, tableau: &Tableau, states: usize) {
        let s = tableau.stages();
        self.end_slope.clear();
        self.end_slope.resize(states, 0.0);
        for (j, z) in self.z.chunks_exact(self.y.len()).enumerate() {
            let weight = tableau.a_inverse[(s - 1, j)] / self.h;
            for (slope, z) in self.end_slope.iter_mut().zip(z) {
                *slope += weight * z;
            }
        }
    }

    /// Writes the jump of the slope of the states between this step and the next, of size `h`, times `h`, to `out`;
    /// `slope` is minus the slope at the beginning of the next step. Leaves `out` empty if the next step need not
    /// begin with the slope of this step.
    pub fn jump(&self, h: f64, slope: &[f64], out: &mut Vec<f64>) {
        out.clear();
        out.extend(self.end_slope.iter().zip(slope).map(|(end, slope)| h * (end + slope)));
    }

    /// Writes the increments of the unknowns from the beginning of the step to the fraction `theta` of the step to
    /// `out`.
    pub fn increment_at(&mut self, tableau: &Tableau, theta: f64, out: &mut [f64]) {
        self.basis.resize(tableau.stages(), 0.0);
        tableau.increments_at(theta, &mut self.basis);
        out.fill(0.0);
        for (factor, z) in self.basis.iter().zip(self.z.chunks_exact(self.y.len())) {
            for (out, z) in out.iter_mut().zip(z) {
                *out += factor * z;
            }
        }
    }

    /// Writes the increments of the unknowns from the beginning of the step to the stages of the next step, of size
    /// `h`, to `out`, stage by stage.
    pub fn increments_beyond(&self, tableau: &Tableau, h: f64, out: &mut [f64]) {
        let s = tableau.stages();
        let (mut basis, mut matrix) = ([0.0; MOST_STAGES], [0.0; MOST_STAGES * MOST_STAGES]);
        for (i, c) in tableau.c.iter().enumerate() {
            tableau.increments_at(1.0 + c * h / self.h, &mut basis[..s]);
            basis[..s].iter().enumerate().for_each(|(j, factor)| matrix[i + j * s] = *factor);
        }
        combine(&matrix[..s * s], &self.z, out, self.y.len());
    }

    /// Evaluates the polynomials of the unknowns `y` at time `t` into `out`.
    pub fn at(&mut self, tableau: &Tableau, t: f64, out: &mut [f64]) {
        let theta = (t - self.t) / self.h;
        self.increment_at(tableau, theta, out);
        for (out, y) in out.iter_mut().zip(&self.y) {
            *out += y;
        }
        let bubble = tableau.bubble_at(theta);
        for (out, slope) in out.iter_mut().zip(&self.slope) {
            *out += bubble * slope;
        }
    }
}
