//! Monitors reduced by the equations that determine the free variables:
//!
//! ```text
//! m - w G_I - v dG_I/dt,    dG/dt = G_t + G_x M^-1 F,    (w, v) d(G_I, dG_I/dt)/dz_I = dm/dz_I.
//! ```
//!
//! If these equations bind states as well, `w` is such that the monitor does not change when the states are brought
//! onto them.

use super::on_face::{OnFace, Told};
use super::part::Part;
use super::point::Point;
use super::watched::Combination;
use crate::consistent_variables::InverseMass;
use crate::system::System;
use nalgebra::{DMatrix, RowDVector};
use numerics::Interval;
use problem::{ForcingSlopes, Sums};

/// The slopes of the rows of a problem over a part of a step.
#[derive(Debug, Default)]
pub(super) struct Rows {
    /// Derivatives of the rows of the problem with respect to the unknowns over the box of the unknowns, in the order
    /// of the pattern.
    pub jacobian: Vec<Interval>,
    /// Derivatives of `G` with respect to time over the part of the step.
    pub by_time: Vec<Interval>,
    /// The shared terms of the time derivatives of all rows, if these derivatives are sums of shared terms.
    pub terms: Vec<Interval>,
}

/// A monitor (event function) reduced by the equations that determine the free variables.
#[derive(Debug, Default)]
pub(super) struct Reduced {
    /// Factors of the rows of `G` in the monitor before its reduction.
    own: Vec<(usize, f64)>,
    /// Factors of the equations of the free variables in the reduced monitor, by variable.
    equations: Vec<(usize, f64)>,
    /// Factors of the time derivatives of the equations of the free variables (hidden constraints) in the reduced
    /// monitor.
    hidden: Vec<(usize, f64)>,
    /// Factors of the rows of `F` in the hidden constraints of the reduced monitor.
    rates: Vec<(usize, f64)>,
    /// Derivatives of the reduced monitor with respect to the unknowns over the box of the unknowns.
    gradient: Vec<(usize, Interval)>,
    /// Time derivative of the reduced monitor as a sum of terms, if the time derivatives of the rows are sums of
    /// terms.
    by_terms: Option<Vec<(usize, Interval)>>,
}

impl Reduced {
    /// Reduces the monitor (event function) `own`, with the derivatives over the box of `rows`, by the equations that
    /// determine the free variables, near the unknowns `y`.
    pub fn set(&mut self, on: &mut OnFace<'_, '_>, told: Told, rows: &Rows, y: &[f64], own: &Combination) {
        let by_variables = own.by_variables(on.system);
        self.own.clone_from(&own.rows);
        self.hidden.clear();
        self.rates.clear();
        if told == Told::ByHiddenConstraints {
            self.follow_hidden(on, &by_variables);
            self.follow_constraints(on, rows, y);
        } else {
            on.inside.weights(on.system, |l| by_variables[l], &mut self.equations);
            self.equations.iter_mut().for_each(|(_, factor)| *factor = -*factor);
        }
        self.set_gradient(on.system, told, rows, &own.variables);
        self.by_terms = on.system.forcing_slopes().map(|slopes| self.sum_of_terms(slopes));
    }

    /// Sets the derivatives of the reduced monitor with respect to the unknowns; `variables` are those that the
    /// monitor contains itself.
    fn set_gradient(&mut self, system: &System<'_>, told: Told, rows: &Rows, variables: &[(usize, f64)]) {
        let n = system.states;
        let mut gradient = vec![Interval::point(0.0); system.unknowns];
        let mut sizes = vec![0.0; system.unknowns];
        variables.iter().for_each(|&(k, factor)| gradient[n + k] = Interval::point(factor));
        let of_g = self.own.iter().chain(&self.equations).map(|&(l, factor)| (n + l, factor));
        for (row, factor) in of_g.chain(self.rates.iter().copied()) {
            for (at, j) in system.places_of_row(row) {
                let term = Interval::point(factor) * rows.jacobian[at];
                gradient[j] = gradient[j] + term;
                sizes[j] += term.size();
            }
        }
        if told == Told::ByHiddenConstraints {
            // The derivatives with respect to free variables cancel; the derivatives with respect to other unknowns
            // contain the rounding errors of the sums.
            (0..system.unknowns - n)
                .filter(|&l| system.has_equation(l))
                .for_each(|l| gradient[n + l] = Interval::point(0.0));
            for (slope, size) in gradient.iter_mut().zip(&sizes).filter(|(slope, _)| **slope != Interval::point(0.0)) {
                let noise = f64::EPSILON * size;
                *slope = *slope + Interval::new(-noise, noise);
            }
        }
        self.gradient.clear();
        self.gradient.extend(gradient.into_iter().enumerate().filter(|(_, slope)| *slope != Interval::point(0.0)));
    }

    /// Adds the factors of equations that represent the correction of the states onto their constraints: the reduced
    /// monitor is then that of the corrected states.
    fn follow_constraints(&mut self, on: &mut OnFace<'_, '_>, rows: &Rows, y: &[f64]) {
        self.set_gradient(on.system, Told::ByHiddenConstraints, rows, &[]);
        let n = on.system.states;
        let mut of_states = vec![0.0; n];
        for &(j, slope) in self.gradient.iter().filter(|(j, _)| *j < n) {
            of_states[j] = 0.5 * (slope.lo + slope.hi);
        }
        let mut factors = Vec::new();
        on.constraints.change_of(on.system, on.control, y, |j| of_states[j], &mut factors);
        let is_equation = |row: usize| row >= n && on.system.has_equation(row - n);
        let equations = factors.into_iter().filter(|(row, _)| is_equation(*row));
        let of_g = rows_of(on.system, equations.map(|(row, factor)| (row - n, factor)));
        for (l, factor) in of_g {
            match self.equations.iter_mut().find(|(other, _)| *other == l) {
                Some((_, sum)) => *sum += factor,
                None => self.equations.push((l, factor)),
            }
        }
    }

    /// Returns the partial derivative of the reduced monitor with respect to time as a sum of terms, with the
    /// rounding errors of factors that cancel.
    fn sum_of_terms(&self, slopes: &ForcingSlopes) -> Vec<(usize, Interval)> {
        let mut factors = vec![(0.0, 0.0_f64); slopes.terms];
        let mut add = |rows: &[(usize, f64)], sums: &Sums| {
            for &(row, factor) in rows {
                for &(term, of_row) in &sums[row] {
                    factors[term].0 += factor * of_row;
                    factors[term].1 += (factor * of_row).abs();
                }
            }
        };
        add(&self.own, &slopes.inequality);
        add(&self.equations, &slopes.inequality);
        add(&self.hidden, &slopes.curvature);
        add(&self.rates, &slopes.rates);
        let noise = |size: f64| f64::EPSILON * size;
        let intervals = factors.into_iter().enumerate().filter(|(_, (_, size))| *size > 0.0);
        intervals.map(|(term, (sum, size))| (term, Interval::new(sum - noise(size), sum + noise(size)))).collect()
    }

    /// Sets the factors of the equations and hidden constraints whose combination depends on the free variables in
    /// the way that the monitor does.
    fn follow_hidden(&mut self, on: &mut OnFace<'_, '_>, by_variables: &[f64]) {
        let n = on.system.states;
        self.equations.clear();
        let Some(consistent) = &mut on.consistent else { return };
        let Some(response) = consistent.response(on.system) else { return };
        let system = &*on.system;
        let own = RowDVector::from_iterator(response.inside.len(), response.inside.iter().map(|&l| by_variables[l]));
        let factors = |to: &DMatrix<f64>| -> Vec<(usize, f64)> {
            let factors = &own * to;
            rows_of(system, response.inside.iter().zip(factors.iter()).map(|(&l, &factor)| (l, -factor)))
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

    /// Returns the value of the reduced monitor at a point where the monitor itself is `value`, and its rounding
    /// error.
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

    /// Bounds the effect of errors of the unknowns on the reduced monitor.
    pub fn error(&self, errors: &[f64]) -> f64 {
        self.gradient.iter().filter(|(j, _)| errors[*j] != 0.0).map(|&(j, slope)| slope.size() * errors[j]).sum()
    }

    /// Returns the effect of errors of the first unknowns on the reduced monitor, by the least magnitudes of its
    /// derivatives.
    pub fn least_error(&self, errors: &[f64]) -> f64 {
        let of = |&(j, slope): &(usize, Interval)| errors.get(j).map(|error| slope.magnitudes().0 * error);
        self.gradient.iter().filter_map(of).sum()
    }

    /// Returns the range of the derivative of the reduced monitor with respect to the position `u` in `[0, 1]` within
    /// a part that takes the time `h`, without the motion of bounds.
    pub fn slope(&self, rows: &Rows, part: &Part, h: f64) -> Interval {
        let sum = |sum: Interval, (factor, slope): (Interval, Interval)| sum + factor * slope;
        let by_time = match &self.by_terms {
            Some(terms) => {
                terms.iter().map(|&(term, factor)| (factor, rows.terms[term])).fold(Interval::point(0.0), sum)
            }
            None => {
                let of_g = self.own.iter().chain(&self.equations);
                of_g.map(|&(l, factor)| (Interval::point(factor), rows.by_time[l])).fold(Interval::point(0.0), sum)
            }
        };
        let slope = part.rate_of_sum(&self.gradient) + by_time * Interval::point(h);
        if slope.defined { slope } else { Interval::LINE }
    }
}

/// Rewrites a combination of the equations of the active face for variables as a combination of rows of `G`.
fn rows_of(system: &System<'_>, equations: impl Iterator<Item = (usize, f64)>) -> Vec<(usize, f64)> {
    let mut rows: Vec<(usize, f64)> = Vec::new();
    for (equation, factor) in equations.filter(|(_, factor)| *factor != 0.0) {
        for (l, of_row) in system.rows_of_equation(equation) {
            match rows.iter_mut().find(|(other, _)| *other == l) {
                Some((_, sum)) => *sum += factor * of_row,
                None => rows.push((l, factor * of_row)),
            }
        }
    }
    rows
}
