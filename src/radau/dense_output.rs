//! The collocation polynomial of one step, `y(t_n + theta h) = y_n + sum_i l_i(theta) Z_i`, of degree `s`, whose slope is
//! that of the rates at the stages; for the states one degree more, so that the slope is right at the beginning too.
//!
//! What the slope of the polynomial lacks there is `h E^-1` times what the embedded error estimate is made of, filtered
//! by the same factors; times a polynomial that changes neither the ends nor the slopes at the stages it raises the order
//! between the steps from `s + 1` to `s + 2`, at no cost.

use super::face::ActiveFace;
use super::screening::Between;
use super::tableau::Tableau;

/// The last accepted step.
#[derive(Clone, Debug, Default)]
pub(super) struct Step {
    /// Where it began.
    pub t: f64,
    /// Its size.
    pub h: f64,
    /// `y` at its beginning.
    pub y: Vec<f64>,
    /// The stage increments, `s` blocks.
    pub z: Vec<f64>,
    /// What the slope of the states lacks at the beginning, times `h`; empty where it is not known.
    pub slope: Vec<f64>,
    /// The slope of the states with which the next step is to begin: that at its end, or that of the rates where a run or a face
    /// begins; empty where neither is known.
    pub end_slope: Vec<f64>,
    /// The face that it kept.
    pub face: ActiveFace,
    /// Whether it kept one face.
    pub is_smooth: bool,
    /// What screening found between its stages; none where there was nothing to screen.
    pub screened: Option<Between>,
    /// By how many tolerances a switch within it that was not located may change a state.
    pub unlocated: Option<f64>,
    /// Whether it was made again, with derivatives of where it begins.
    pub is_remade: bool,
    basis: Vec<f64>,
}

impl Step {
    /// Takes over a step; no allocation once it has held one of the same size.
    pub fn set(&mut self, t: f64, h: f64, y: &[f64], z: &[f64], face: &ActiveFace) {
        (self.t, self.h, self.is_remade) = (t, h, false);
        self.y.clear();
        self.y.extend_from_slice(y);
        self.z.clear();
        self.z.extend_from_slice(z);
        self.face.clone_from(face);
    }

    /// Sets the slope at the end of a step with this tableau, for so many states.
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

    /// By how much the slope of the states jumps between this step and the next, of size `h`, which begins with the
    /// opposite of `slope`; times `h`, into `out`. Nothing where the next step need not begin with the slope of this one.
    pub fn jump(&self, h: f64, slope: &[f64], out: &mut Vec<f64>) {
        out.clear();
        out.extend(self.end_slope.iter().zip(slope).map(|(end, slope)| h * (end + slope)));
    }

    /// The increments from the beginning of the step at `theta`, into `out`.
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

    /// `y` at time `t`, into `out`.
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
