//! The collocation polynomial of one step, `y(t_n + theta h) = y_n + sum_i l_i(theta) Z_i`, of degree `s`.

use super::face::Place;
use super::tableau::Tableau;

/// The last accepted step.
#[derive(Clone, Debug, Default)]
pub struct Step {
    /// Where it began.
    pub t: f64,
    /// Its size.
    pub h: f64,
    /// `y` at its beginning.
    pub y: Vec<f64>,
    /// The stage increments, `s` blocks.
    pub z: Vec<f64>,
    /// The face that it kept.
    pub face: Vec<Place>,
    /// Whether it kept one face.
    pub is_smooth: bool,
    basis: Vec<f64>,
}

impl Step {
    /// Takes over a step; no allocation once it has held one of the same size.
    pub fn set(&mut self, t: f64, h: f64, y: &[f64], z: &[f64], face: &[Place]) {
        (self.t, self.h) = (t, h);
        self.y.clear();
        self.y.extend_from_slice(y);
        self.z.clear();
        self.z.extend_from_slice(z);
        self.face.clear();
        self.face.extend_from_slice(face);
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
        self.increment_at(tableau, (t - self.t) / self.h, out);
        for (out, y) in out.iter_mut().zip(&self.y) {
            *out += y;
        }
    }
}
