//! Monitors without what the equations of the variables inside tell:
//!
//! ```text
//! m - w G_I - v dG_I/dt,    dG/dt = G_t + G_x M^-1 F,    (w, v) d(G_I, dG_I/dt)/dz_I = dm/dz_I.
//! ```

use super::monitors::{OnFace, Point, Told, Watched, size};
use super::part::Part;
use crate::consistent::InverseMass;
use crate::face::Place;
use crate::system::System;
use nalgebra::{DMatrix, RowDVector};
use numerics::Interval;

/// The slopes of the rows of a problem over a part of a step.
#[derive(Debug, Default)]
pub(super) struct Rows {
    /// The derivatives by the unknowns over the box, at the places of the pattern.
    pub jacobian: Vec<Interval>,
    /// Those of `G` by time.
    pub by_time: Vec<Interval>,
    /// Those of `F` by time, and the second ones of `G`, where hidden constraints need them.
    pub time_slopes: (Vec<Interval>, Vec<Interval>),
}

/// One monitor, reduced.
#[derive(Debug, Default)]
pub(super) struct Reduced {
    /// Its own row of `G`, with its sign; none of a variable inside.
    own: Option<(usize, f64)>,
    /// The factors of the equations, by variable.
    equations: Vec<(usize, f64)>,
    /// Those of their derivatives by time.
    hidden: Vec<(usize, f64)>,
    /// Those of the rows of `F` in these.
    rates: Vec<(usize, f64)>,
    /// The derivatives by the unknowns over the box.
    gradient: Vec<(usize, Interval)>,
    /// Whether a bound of its variable moves in a way that is not known.
    is_moved: bool,
}

impl Reduced {
    /// The monitor with the derivatives over the box of `rows`, by what tells the variables inside.
    pub fn set(&mut self, on: &mut OnFace<'_, '_>, told: Told, rows: &Rows, monitor: &Watched) {
        let (n, k) = (on.system.states, monitor.variable);
        let is_inside = monitor.place() == Place::Inside;
        let by_variables = monitor.by_variables(on.system);
        self.own = (!is_inside).then_some((k, monitor.sign()));
        self.is_moved = is_inside && on.system.moves(k);
        self.hidden.clear();
        self.rates.clear();
        if told == Told::ByHiddenConstraints {
            self.follow_hidden(on, &by_variables);
        } else {
            on.inside.weights(on.system, |l| by_variables[l], &mut self.equations);
            self.equations.iter_mut().for_each(|(_, factor)| *factor = -*factor);
        }
        let system = &*on.system;
        let mut gradient = vec![Interval::point(0.0); system.unknowns];
        let mut sizes = vec![0.0; system.unknowns];
        if is_inside {
            gradient[n + k] = Interval::point(by_variables[k]);
        }
        let of_g = self.own.iter().chain(&self.equations).map(|&(l, factor)| (n + l, factor));
        for (row, factor) in of_g.chain(self.rates.iter().copied()) {
            for (at, j) in system.places_of_row(row) {
                let term = Interval::point(factor) * rows.jacobian[at];
                gradient[j] = gradient[j] + term;
                sizes[j] += size(term);
            }
        }
        if told == Told::ByHiddenConstraints {
            // Nothing is left of the variables inside, and of the others what rounding makes of the sums.
            let is_told = |l: usize| system.face.places[l] == Place::Inside;
            (0..system.unknowns - n).filter(|&l| is_told(l)).for_each(|l| gradient[n + l] = Interval::point(0.0));
            for (slope, size) in gradient.iter_mut().zip(&sizes).filter(|(slope, _)| **slope != Interval::point(0.0)) {
                let noise = f64::EPSILON * size;
                *slope = *slope + Interval::new(-noise, noise);
            }
        }
        self.gradient.clear();
        self.gradient.extend(gradient.into_iter().enumerate().filter(|(_, slope)| *slope != Interval::point(0.0)));
    }

    /// The factors of equations and hidden constraints that answer to a change of the variables inside as the monitor does.
    fn follow_hidden(&mut self, on: &mut OnFace<'_, '_>, by_variables: &[f64]) {
        let system = &*on.system;
        let n = system.states;
        self.equations.clear();
        let Some(consistent) = &mut on.consistent else { return };
        let Some(response) = consistent.response(system) else { return };
        let own = RowDVector::from_iterator(response.inside.len(), response.inside.iter().map(|&l| by_variables[l]));
        let factors = |to: &DMatrix<f64>| -> Vec<(usize, f64)> {
            let factors = &own * to;
            let pairs = response.inside.iter().zip(factors.iter()).map(|(&l, &factor)| (l, -factor));
            pairs.filter(|(_, factor)| *factor != 0.0).collect()
        };
        (self.equations, self.hidden) = (factors(&response.to_g), factors(&response.to_hidden));
        let mut along = RowDVector::<f64>::zeros(n);
        for &(l, factor) in &self.hidden {
            system.entries_of_variable(l).filter(|(j, _)| *j < n).for_each(|(j, value)| along[j] += factor * value);
        }
        if let Some(InverseMass::Entries(inverse)) = consistent.inverse_mass() {
            along *= inverse;
        }
        self.rates.extend(along.iter().copied().enumerate().filter(|(_, factor)| *factor != 0.0));
    }

    /// Its value at a point where the monitor is `value`, and what rounding leaves uncertain of it.
    pub fn value(&self, system: &System<'_>, value: f64, there: &Point) -> (f64, f64) {
        let n = system.states;
        let mut of = (value, 0.0);
        let of_rows = self.equations.iter().map(|&(l, factor)| (n + l, factor)).chain(self.rates.iter().copied());
        for (row, factor) in of_rows {
            of.0 += factor * there.values[row];
            of.1 += f64::EPSILON * factor.abs() * system.terms_of_row(row, |j| [there.y[j].abs()])[0];
        }
        for &(l, factor) in &self.hidden {
            of.0 += factor * there.drift[l];
            of.1 += f64::EPSILON * (factor * there.drift[l]).abs();
        }
        of
    }

    /// What errors of the unknowns make of it.
    pub fn error(&self, errors: &[f64]) -> f64 {
        self.gradient.iter().filter(|(j, _)| errors[*j] != 0.0).map(|&(j, slope)| size(slope) * errors[j]).sum()
    }

    /// Its slope over a part that takes `h`, in units of the part.
    pub fn slope(&self, rows: &Rows, part: &Part, h: f64) -> Interval {
        if self.is_moved {
            return Interval::LINE;
        }
        let (of_rates, of_g) = &rows.time_slopes;
        let of = |factors: &[(usize, f64)], slopes: &[Interval]| {
            factors.iter().fold(Interval::point(0.0), |sum, &(row, factor)| sum + Interval::point(factor) * slopes[row])
        };
        let own = of(self.own.as_slice(), &rows.by_time);
        let by_time = own + of(&self.equations, &rows.by_time) + of(&self.hidden, of_g) + of(&self.rates, of_rates);
        let slope = part.rate_of_sum(&self.gradient) + by_time * Interval::point(h);
        if slope.defined { slope } else { Interval::LINE }
    }
}
