//! The rows of a problem (rates, `G` and moving bounds) at all stages, evaluated together and used one after the
//! other. Using the rows at a point has the effect of evaluating them there, and counts as one evaluation.

use super::system::System;
use factorisation::of_size;

/// The stages of a step as points `(t_i, y_i)`, with the rows of the problem evaluated at these points.
#[derive(Clone, Debug, Default)]
pub struct Points {
    times: Vec<f64>,
    /// The unknowns `y` at the stages, stage by stage.
    y: Vec<f64>,
    values: Vec<f64>,
    /// Whether the rows at all stages were found among earlier evaluations.
    are_known: bool,
}

impl Points {
    /// Evaluates the rows of the problem at the stages `(t + c_i h, y0 + Z_i)`.
    pub fn evaluate(&mut self, system: &mut System<'_>, nodes: &[f64], (t, h): (f64, f64), y0: &[f64], z: &[f64]) {
        self.place(nodes, (t, h), y0, z);
        let Self { times, y, values, are_known } = self;
        let (n, rows) = (y0.len(), system.values.len());
        values.resize(nodes.len() * rows, 0.0);
        let mut points = times.iter().zip(y.chunks_exact(n)).zip(values.chunks_exact_mut(rows));
        *are_known = points.all(|((&t, y), values)| system.recall(t, y, values));
        if !*are_known {
            system.problem().evaluate_points(times, y, values);
        }
    }

    /// Evaluates the rates of a system without variables at the stages `(t + c_i h, y0 + Z_i)` into `rates`, point by
    /// point: such a system has no other rows, no bounds and no stored points. Has the effect of evaluations one
    /// after the other; returns false if a number is not finite.
    pub fn evaluate_rates(
        &mut self,
        system: &mut System<'_>,
        nodes: &[f64],
        (t, h): (f64, f64),
        y0: &[f64],
        z: &[f64],
        rates: &mut [f64],
    ) -> bool {
        self.place(nodes, (t, h), y0, z);
        let (n, last) = (y0.len(), nodes.len() - 1);
        let rates = &mut rates[..nodes.len() * n];
        system.problem().evaluate_points(&self.times, &self.y, rates);
        system.work.rates += nodes.len() as u64;
        system.values.copy_from_slice(&rates[n * last..]);
        system.set_last(self.times[last], self.y(last, n));
        // Read all rates, even behind one that is not finite, so that the loop is vectorised.
        rates.iter().fold(true, |finite, rate| finite & rate.is_finite())
    }

    /// Sets the times and the unknowns of the points to the stages `(t + c_i h, y0 + Z_i)`.
    fn place(&mut self, nodes: &[f64], (t, h): (f64, f64), y0: &[f64], z: &[f64]) {
        let (Self { times, y, .. }, n) = (self, y0.len());
        times.clear();
        times.extend(nodes.iter().map(|c| t + c * h));
        y.resize(nodes.len() * n, 0.0);
        of_size!(n, |n| for (y, z) in y.chunks_exact_mut(n).zip(z.chunks_exact(n)) {
            y.iter_mut().zip(&y0[..n]).zip(z).for_each(|((y, y0), z)| *y = y0 + z);
        });
    }

    /// Returns the unknowns `y` at point `i` of a system of `n` unknowns.
    fn y(&self, i: usize, n: usize) -> &[f64] {
        &self.y[n * i..][..n]
    }
}

impl System<'_> {
    /// Uses the rows at point `i` of `points`, with the effect of [`System::evaluate`] at that point.
    pub fn take(&mut self, points: &Points, i: usize) -> bool {
        let (t, y) = (points.times[i], points.y(i, self.unknowns));
        if let Some(finite) = self.is_last(t, y) {
            return finite;
        }
        let rows = self.values.len();
        self.values.copy_from_slice(&points.values[rows * i..][..rows]);
        if !points.are_known {
            self.record(t, y);
        }
        self.set_last(t, y)
    }

    /// Uses the rows at point `i` of `points`, with the effect of [`System::phi`] at that point.
    pub fn take_phi(&mut self, points: &Points, i: usize, phi: &mut [f64]) -> bool {
        let finite = self.take(points, i);
        self.on_face(finite, points.y(i, self.unknowns), phi)
    }
}
