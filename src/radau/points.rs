//! The rows of a problem at all stages, evaluated side by side and taken one after the other: what is taken is as if it were
//! evaluated then, and counts as one evaluation.

use super::system::System;

/// Points and the rows there.
#[derive(Debug, Default)]
pub(super) struct Points {
    times: Vec<f64>,
    /// `y` of one point after the other.
    y: Vec<f64>,
    values: Vec<f64>,
}

impl System<'_> {
    /// Evaluates the rows at the points `(t + c_i h, y0 + Z_i)`, of which [`System::take`] takes one.
    pub(super) fn evaluate_stages(&mut self, nodes: &[f64], (t, h): (f64, f64), y0: &[f64], z: &[f64]) {
        let Points { times, y, values } = &mut self.points;
        times.clear();
        times.extend(nodes.iter().map(|c| t + c * h));
        y.clear();
        y.extend(z.chunks_exact(y0.len()).take(nodes.len()).flat_map(|z| y0.iter().zip(z).map(|(y0, z)| y0 + z)));
        values.resize(nodes.len() * self.values.len(), 0.0);
        self.problem.evaluate_points(times, y, values);
    }

    /// What [`System::evaluate`] does at point `i`.
    pub(super) fn take(&mut self, i: usize) -> bool {
        let points = std::mem::take(&mut self.points);
        let (y, rows) = (&points.y[self.unknowns * i..][..self.unknowns], self.values.len());
        let finite = self.evaluated(points.times[i], y, |_, values| {
            values.copy_from_slice(&points.values[rows * i..][..rows]);
        });
        self.points = points;
        finite
    }

    /// What [`System::phi`] does at point `i`.
    pub(super) fn take_phi(&mut self, i: usize, phi: &mut [f64]) -> bool {
        let finite = self.take(i);
        let points = std::mem::take(&mut self.points);
        let finite = self.on_face(finite, &points.y[self.unknowns * i..][..self.unknowns], phi);
        self.points = points;
        finite
    }
}
