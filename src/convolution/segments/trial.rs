//! One element with a fixed active set: the inactive variables solve `w = 0` at the nodes, the others are at their
//! bounds. The element is solved twice, the second time with one more function and node, to estimate the error of the
//! first.

use super::shape::Shape;
use super::{Activity, Segments};
use crate::stepper::StepError;
use nalgebra::DMatrix;

/// Rounding error of a sum, relative to its largest term: it grows with the square root of the number of terms, and a
/// factor of sixteen allows for some hundreds of terms.
const ROUNDING: f64 = 16.0 * f64::EPSILON;
/// Data of the equations of an element at its nodes: rows for the nodes, columns for the variables.
struct Known {
    lower: DMatrix<f64>,
    upper: DMatrix<f64>,
    /// At the nodes, the function `q` of time in the inequality plus the convolution with the variables on earlier
    /// elements, and the magnitudes of the terms of this sum.
    source: DMatrix<f64>,
    size: DMatrix<f64>,
    /// The function `q` of time in the inequality alone, at the nodes.
    forcing: DMatrix<f64>,
    /// The integrals of each term of the kernel against the basis functions of the element.
    weights: Vec<DMatrix<f64>>,
}

/// A solved element that is not yet part of the solution.
pub struct Trial {
    /// The length of the element.
    pub h: f64,
    /// The index of the shape (the space of functions) of the element.
    pub shape: usize,
    /// The coefficients of the variables and of their repeated integrals, as many as the kernel takes: a row for each
    /// basis function, a column for each variable.
    pub levels: Vec<DMatrix<f64>>,
    /// The forcing `q` at the nodes of the element, and its rounding error.
    pub sources: DMatrix<f64>,
    pub source_noise: Vec<f64>,
    /// The rounding error of the monitors of each variable, and the uncertainty of its inequality `w` at the end of
    /// the element from errors of the variables within the tolerance.
    pub noise: Vec<f64>,
    pub slack: Vec<f64>,
    /// The estimated error of the variables on the element, in units of the tolerance.
    pub error: f64,
    /// The largest absolute value of each variable at the nodes.
    pub size: Vec<f64>,
    /// The first violation of the active set at a node, if any.
    pub violation: Option<Violation>,
    /// The monitors of each variable (positive while the active set holds) at the end of the element.
    pub ends: Vec<Monitor>,
}

/// A violation of the active set: a negative monitor.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Violation {
    /// The position within the element, from 0 to 1, at which the monitor is negative.
    pub theta: f64,
    /// Index of the variable whose monitor is negative.
    pub variable: usize,
    /// The activity of the variable after the switch that the violation shows.
    pub to: Activity,
    /// The negative value of the monitor that violates the active set.
    pub value: f64,
}

/// The monitors of a variable, positive while the active set holds: its distances from the bounds if it is inactive,
/// otherwise `w` with the sign of its bound.
#[derive(Clone, Copy, Debug)]
pub struct Monitor {
    /// The monitors whose sign change leads to the lower bound, to inactivity, and to the upper bound; infinite if
    /// not monitored.
    values: [f64; 3],
    /// The rounding error of the monitors of the variable.
    pub noise: f64,
}

impl Monitor {
    /// Returns the monitor whose sign change leads to the activity `place`.
    pub fn towards(&self, place: Activity) -> f64 {
        match place {
            Activity::AtLower => self.values[0],
            Activity::Inactive => self.values[1],
            Activity::AtUpper => self.values[2],
            Activity::Fixed => f64::INFINITY,
        }
    }
}

impl Segments<'_> {
    /// Solves for the element of length `h` from the current time.
    ///
    /// # Errors
    /// If values are not finite, a set is empty, or the equations have no solution.
    pub(super) fn trial(&mut self, h: f64) -> Result<Trial, StepError> {
        let index = usize::from(self.is_first);
        let known = self.known(index, h)?;
        let n = self.shapes[index].len();
        let unsolved = || StepError::Unsolved {
            t: self.t + h,
            outcome: "its equations on a face are singular",
            residual: f64::NAN,
        };
        let narrow = self.solve(index, h, n, &known).ok_or_else(unsolved)?;
        let wide = self.solve(index, h, n + 1, &known).ok_or_else(unsolved)?;
        let shape = &self.shapes[index];
        let m = self.places.len();
        let at_nodes = shape.values.columns(0, n) * &narrow.coefficients;
        let found = shape.samples.columns(0, n) * &narrow.coefficients;
        let better = &shape.samples * &wide.coefficients;
        let column_size = |matrix: &DMatrix<f64>, k: usize| matrix.column(k).amax();
        let size: Vec<f64> = (0..m).map(|k| column_size(&at_nodes, k)).collect();
        let mut error = 0.0_f64;
        for (k, size) in size.iter().enumerate() {
            let allowed = self.allowed(k, size.max(self.size[k]));
            let apart = (found.column(k) - better.column(k)).amax();
            // Differences within the rounding errors of the variables do not count: shorter elements do not help
            // against rounding errors, which grow as elements shrink.
            error = error.max(if apart <= wide.rounding[k].max(narrow.rounding[k]) { 0.0 } else { apart / allowed });
        }
        let range = |k: usize| known.forcing.column(k).max() - known.forcing.column(k).min();
        let source_noise = |k: usize| ROUNDING * (known.forcing.column(k).amax() + self.rounding_of_time(h) * range(k));
        let mut trial = Trial {
            h,
            shape: index,
            levels: self.integrated(index, h, narrow.coefficients.clone()),
            source_noise: (0..m).map(source_noise).collect(),
            sources: known.forcing.clone(),
            noise: narrow.noise.clone(),
            slack: (0..m).map(|k| narrow.slack[(n - 1, k)]).collect(),
            error,
            size,
            violation: None,
            ends: Vec::new(),
        };
        self.find_violation(&mut trial, &known, &at_nodes, &narrow);
        Ok(trial)
    }

    /// Returns the coefficients of the variables on an element and of their repeated integrals, as many as the kernel
    /// takes.
    fn integrated(&self, index: usize, h: f64, coefficients: DMatrix<f64>) -> Vec<DMatrix<f64>> {
        let integral = self.shapes[index].antiderivative(coefficients.nrows()) * h;
        let mut levels = vec![coefficients];
        for before in &self.integrals {
            let mut integrated = &integral * &levels[levels.len() - 1];
            // The integral up to the beginning of the element is added to the coefficient of the first basis
            // function, which is constant.
            before.iter().enumerate().for_each(|(k, value)| integrated[(0, k)] += value);
            levels.push(integrated);
        }
        levels
    }

    /// Returns the change of a force by the rounding of time, in units of the rounding error of the force, for a
    /// force that varies by its own magnitude on an element of length `h`.
    fn rounding_of_time(&self, h: f64) -> f64 {
        (self.t.abs() + h) / h
    }

    /// Returns the admissible error, on an element, of a variable of magnitude `size`.
    pub(super) fn allowed(&self, variable: usize, size: f64) -> f64 {
        self.tolerance * (self.atol[variable] + self.rtol * size)
    }

    /// Computes the bounds, the forcing and the contribution of the past at the nodes of an element of length `h`.
    fn known(&mut self, index: usize, h: f64) -> Result<Known, StepError> {
        let shape = &self.shapes[index];
        let (nodes, m) = (shape.nodes.len(), self.places.len());
        let zeros = || DMatrix::zeros(nodes, m);
        let (lower, upper, source, size, forcing) = (zeros(), zeros(), zeros(), zeros(), zeros());
        let mut known = Known { lower, upper, source, size, forcing, weights: Vec::new() };
        let (mut sum, mut size) = (vec![0.0; m], vec![0.0; m]);
        for (i, &c) in shape.nodes.iter().enumerate() {
            let t = self.t + c * h;
            let q = self.forcing.at(t, 0, &mut self.set)?;
            for (k, &q) in q.iter().enumerate() {
                (known.source[(i, k)], known.size[(i, k)], known.forcing[(i, k)]) = (q, q.abs(), q);
                (known.lower[(i, k)], known.upper[(i, k)]) = (self.set.lower[k], self.set.upper[k]);
            }
            let count = self.past.elements.len();
            for term in &mut self.terms {
                let Some(lag) = &mut term.lag else { continue };
                sum.fill(0.0);
                size.fill(0.0);
                self.past.convolve(lag, &self.shapes, term.level, count, (self.t, c * h), &mut sum, &mut size)?;
                for &(row, column, value) in &term.matrix {
                    known.source[(i, row)] += value * sum[column];
                    known.size[(i, row)] += (value * size[column]).abs();
                }
            }
        }
        let mut row = vec![0.0; nodes];
        for term in &mut self.terms {
            let weights = match &mut term.lag {
                None => shape.values.clone(),
                Some(lag) => {
                    let mut weights = DMatrix::zeros(nodes, nodes);
                    for (i, &c) in shape.nodes.iter().enumerate() {
                        lag.within(shape, h, c, &mut row)?;
                        row.iter().enumerate().for_each(|(j, weight)| weights[(i, j)] = *weight);
                    }
                    weights
                }
            };
            known.weights.push(weights);
        }
        Ok(known)
    }

    /// Solves the equations of the element with the first `size` basis functions and nodes; returns `None` if they are
    /// singular.
    fn solve(&self, index: usize, h: f64, size: usize, known: &Known) -> Option<Solved> {
        let shape = &self.shapes[index];
        let (nodes, m) = (shape.nodes.len(), self.places.len());
        let inverse = shape.inverse(size);
        let integral = shape.antiderivative(size) * h;
        let mut w = known.source.clone();
        let mut terms = known.size.clone();
        // The convolution with the kernel as an operator from coefficients to values at the nodes, with a block for
        // each row and column of the matrix of the kernel.
        let mut blocks: Vec<Option<DMatrix<f64>>> = vec![None; m * m];
        for (term, weights) in self.terms.iter().zip(&known.weights) {
            let weights = weights.columns(0, size);
            let mut power = DMatrix::identity(size, size);
            // The integrals of the variables up to the beginning of the element are constants on the element, that
            // is, multiples of the first basis function.
            let mut constants = DMatrix::zeros(size, m);
            for level in 1..=term.level {
                constants = &integral * constants;
                (0..m).for_each(|k| constants[(0, k)] += self.integrals[level - 1][k]);
                power = &integral * power;
            }
            let (constant, operator) = (weights * constants, weights * power);
            for &(row, column, value) in &term.matrix {
                for i in 0..nodes {
                    w[(i, row)] += value * constant[(i, column)];
                    terms[(i, row)] += (value * constant[(i, column)]).abs();
                }
                let block = blocks[row * m + column].get_or_insert_with(|| DMatrix::zeros(nodes, size));
                *block += &operator * value;
            }
        }
        let mut coefficients = DMatrix::zeros(size, m);
        let mut rounding = vec![0.0; m];
        for (k, place) in self.places.iter().enumerate() {
            let bound = match place {
                Activity::Inactive => continue,
                Activity::AtLower | Activity::Fixed => &known.lower,
                Activity::AtUpper => &known.upper,
            };
            // A constant bound is represented without rounding errors, as a multiple of the first basis function,
            // which is constant.
            let last = bound[(shape.len() - 1, k)];
            let moved = bound.view((0, k), (size, 1)).add_scalar(-last);
            coefficients.set_column(k, &(inverse * &moved).column(0));
            coefficients[(0, k)] += last;
            rounding[k] = ROUNDING * shape.transform_condition(size) * moved.amax();
        }
        let apply = |w: &mut DMatrix<f64>, terms: &mut DMatrix<f64>, coefficients: &DMatrix<f64>, inside: bool| {
            for (place, block) in blocks.iter().enumerate() {
                let (row, column, Some(block)) = (place / m, place % m, block) else { continue };
                if (self.places[column] == Activity::Inactive) != inside {
                    continue;
                }
                let product = block * coefficients.column(column);
                for i in 0..nodes {
                    w[(i, row)] += product[i];
                    terms[(i, row)] += product[i].abs();
                }
            }
        };
        apply(&mut w, &mut terms, &coefficients, false);
        let inside: Vec<usize> = (0..m).filter(|&k| self.places[k] == Activity::Inactive).collect();
        // Rounding of the time adds to the rounding error of a force that varies.
        let range = |k: usize| known.source.column(k).max() - known.source.column(k).min();
        let of_time = |k: usize| self.rounding_of_time(h) * range(k);
        let noise_of = |terms: &DMatrix<f64>, k: usize| ROUNDING * (terms.column(k).max() + of_time(k));
        let mut noise: Vec<f64> = (0..m).map(|k| noise_of(&terms, k)).collect();
        if !inside.is_empty() {
            let total = inside.len() * size;
            let mut matrix = DMatrix::zeros(total, total);
            let mut right = DMatrix::zeros(total, 1);
            for (r, &row) in inside.iter().enumerate() {
                for i in 0..size {
                    right[(r * size + i, 0)] = -w[(i, row)];
                }
                for (c, &column) in inside.iter().enumerate() {
                    if let Some(block) = &blocks[row * m + column] {
                        matrix.view_mut((r * size, c * size), (size, size)).copy_from(&block.rows(0, size));
                    }
                }
            }
            let inverted = matrix.clone().try_inverse()?;
            let mut solution = &inverted * &right;
            // Take one step of iterative refinement of the solution of the linear system.
            let left = &right - &matrix * &solution;
            solution += &inverted * left;
            if solution.iter().any(|value| !value.is_finite()) {
                return None;
            }
            for (c, &column) in inside.iter().enumerate() {
                coefficients.set_column(column, &solution.view((c * size, 0), (size, 1)).column(0));
            }
            apply(&mut w, &mut terms, &coefficients, true);
            let values = shape.values.view((0, 0), (size, size));
            for (c, &column) in inside.iter().enumerate() {
                let rows = values * inverted.rows(c * size, size);
                let of_row = |i: usize| -> f64 {
                    (0..total).map(|j| rows[(i, j)].abs() * noise_of(&terms, inside[j / size])).sum()
                };
                noise[column] = (0..size).map(of_row).fold(0.0, f64::max);
                rounding[column] = noise[column];
            }
        }
        for k in (0..m).filter(|&k| self.places[k] != Activity::Inactive) {
            noise[k] = noise_of(&terms, k);
        }
        // The first basis function is constant, so the first column of a block contains the integrals of the kernel
        // itself.
        let slack = DMatrix::from_fn(nodes, m, |i, row| {
            let blocks = (0..m).filter_map(|column| Some((column, blocks[row * m + column].as_ref()?)));
            blocks.map(|(column, block)| block[(i, 0)].abs() * self.allowed(column, self.size[column])).sum()
        });
        Some(Solved { coefficients, w, rounding, noise, slack })
    }

    /// Finds the first node at which the active set does not hold: a monitor is negative by more than tolerance and
    /// rounding explain, as may happen next to a switch.
    fn find_violation(&self, trial: &mut Trial, known: &Known, z: &DMatrix<f64>, solved: &Solved) {
        let Solved { coefficients, w, noise, slack, .. } = solved;
        let shape = &self.shapes[trial.shape];
        let mut nodes: Vec<(usize, f64)> = shape.nodes.iter().copied().enumerate().collect();
        nodes.sort_by(|a, b| a.1.total_cmp(&b.1));
        for (i, theta) in nodes {
            for k in 0..self.places.len() {
                let mut values = [f64::INFINITY; 3];
                match self.places[k] {
                    Activity::Inactive => {
                        let value = if i < shape.len() { z[(i, k)] } else { at_node(shape, i, coefficients, k) };
                        (values[0], values[2]) = (value - known.lower[(i, k)], known.upper[(i, k)] - value);
                    }
                    Activity::AtLower => values[1] = w[(i, k)],
                    Activity::AtUpper => values[1] = -w[(i, k)],
                    Activity::Fixed => {}
                }
                if theta == 1.0 {
                    trial.ends.push(Monitor { values, noise: noise[k] });
                }
                for (value, to) in values.into_iter().zip([Activity::AtLower, Activity::Inactive, Activity::AtUpper]) {
                    let slack = if to == Activity::Inactive { slack[(i, k)] } else { self.allowed(k, self.size[k]) };
                    if value < -noise[k] - slack
                        && trial.violation.is_none_or(|first| first.theta == theta && value < first.value)
                    {
                        trial.violation = Some(Violation { theta, variable: k, to, value });
                    }
                }
            }
        }
    }
}

/// Returns the value of a variable at a node of the element.
fn at_node(shape: &Shape, node: usize, coefficients: &DMatrix<f64>, variable: usize) -> f64 {
    let n = coefficients.nrows();
    shape.values.row(node).columns(0, n).iter().zip(&coefficients.column(variable)).map(|(f, c)| f * c).sum()
}

/// The solution of the equations of an element: coefficients of the variables, `w` at all nodes, and the rounding
/// errors of each variable and of its monitors.
struct Solved {
    coefficients: DMatrix<f64>,
    w: DMatrix<f64>,
    rounding: Vec<f64>,
    noise: Vec<f64>,
    /// The uncertainty of the inequality `w` at each node from errors of the variables within the tolerance.
    slack: DMatrix<f64>,
}
