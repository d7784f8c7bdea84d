//! Reference solutions of linear complementarity systems and relays, mode by mode.
//!
//! In a mode, each variable is at its lower bound, at its upper bound, or inactive with `G = 0`. If `D` does not
//! determine the inactive variables, the derivative of the remaining constraints does: with `W` a basis of the left
//! null space of `D_JJ`, the states satisfy `W (C_J x + g_J + ..) = 0`, and `W C_J x' = ..` holds in addition. At the
//! start and at each event the modes are enumerated, and the mode is chosen in which every monitor is positive
//! immediately afterwards, judged by its first derivative that does not vanish. If two modes give different rates of
//! the states, the solution is not unique, and none is returned.
//!
//! Decisions at events depend on zero tolerances, which also end an accumulation of events. Two runs, one with much
//! smaller tolerances, show the effect of the tolerances on the solution.

use super::Values;
use super::flow::{Driven, Flow, Monitor, ZERO, lexicographic_sign, terms};
use crate::differential::linear::{Linear, Shape};
use nalgebra::{DMatrix, DVector, RowDVector};

/// Largest numbers of steps and of events: more steps take too long, and more events are likely to accumulate.
const MOST_STEPS: f64 = 3e6;
const MOST_EVENTS: usize = 20_000;
/// Largest number of variables: the number of modes grows exponentially with it.
const MOST_VARIABLES: usize = 4;
/// Relative rounding error of a constraint that is satisfied.
const HOLDS: f64 = 1e-8;
/// Zero tolerances of the finer of two runs, relative to those of the coarser.
const FINER: f64 = 1e-2;
/// Smallest singular value of a system of full rank, relative to the largest.
const RANK: f64 = 1e-10;

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Place {
    Lower,
    Upper,
    Inside,
}

/// A mode in which the current states can continue.
struct Mode {
    flow: DMatrix<f64>,
    /// Linear functions that must not become negative in the mode.
    monitors: Vec<RowDVector<f64>>,
    /// Linear functions that the states keep at zero in the mode.
    kept: Vec<RowDVector<f64>>,
}

/// A linear system with its bounds, written in all unknowns of the autonomous system.
struct Modes<'a> {
    system: &'a Linear,
    /// Rows of the rates `A x + a` and of the inequalities `C x + g`.
    rates: Vec<RowDVector<f64>>,
    gaps: Vec<RowDVector<f64>>,
    bounds: Vec<(f64, f64)>,
    driven: Driven,
    /// The zero tolerances, as a multiple of the constants `HOLDS` (constraints) and `ZERO` (monitors).
    part: f64,
}

/// Returns the states at `times`; `None` if the set is not given by bounds, there are too many modes, or the solution
/// is not unique.
pub fn solve(system: &Linear, initial: &[f64], times: &[f64]) -> Option<Values> {
    let mut bounds = Vec::new();
    for (shape, size) in &system.set {
        let pair = match shape {
            Shape::Free => (f64::NEG_INFINITY, f64::INFINITY),
            Shape::Nonnegative => (0.0, f64::INFINITY),
            Shape::Box(lower, upper) => (*lower, *upper),
            _ => return None,
        };
        bounds.extend(std::iter::repeat_n(pair, *size));
    }
    if bounds.len() > MOST_VARIABLES {
        return None;
    }
    let driven = Driven::new(system.states(), system.drive.iter().chain(&system.gap));
    let rows = |matrix: &[Vec<f64>], signals: &[_]| -> Vec<RowDVector<f64>> {
        matrix.iter().zip(signals).map(|(row, signal)| driven.row(row, signal)).collect()
    };
    let (rates, gaps) = (rows(&system.a, &system.drive), rows(&system.c, &system.gap));
    let coarse = Modes { system, rates, gaps, bounds, driven, part: 1.0 };
    let values = coarse.run(initial, times)?;
    // If the finer tolerances are below rounding, the finer run fails, and the error estimate of the coarser run is
    // used.
    let Some(mut finer) = (Modes { part: FINER, ..coarse }).run(initial, times) else { return Some(values) };
    for (k, accuracy) in finer.accuracy.iter_mut().enumerate() {
        let apart = finer.columns[k].iter().zip(&values.columns[k]).map(|(a, b)| (a - b).abs());
        *accuracy = apart.fold(*accuracy, f64::max);
    }
    Some(finer)
}

impl Modes<'_> {
    fn run(&self, initial: &[f64], times: &[f64]) -> Option<Values> {
        let (n, end) = (self.system.states(), *times.last()?);
        let (mut t, mut y) = (0.0, self.driven.start(initial));
        let mut sizes = self.sizes(&y);
        let mut columns = vec![Vec::with_capacity(times.len()); n];
        let (mut next, mut steps) = (0, 0.0);
        for events in 0..MOST_EVENTS {
            let mode = self.choose(&y, &sizes)?;
            mode.project(&mut y, &sizes, n);
            let flow = Flow::new(mode.flow, end / 200.0);
            let monitors: Vec<Monitor> = mode.monitors.into_iter().map(|row| Monitor::new(row, &flow.m)).collect();
            steps += 1.0;
            if steps + (end - t) / flow.h > MOST_STEPS {
                return None;
            }
            loop {
                let after = flow.step(&y);
                let event = monitors.iter().filter_map(|monitor| monitor.leaves(&flow, &y, &after, &sizes, 1.0));
                let event = event.fold(f64::INFINITY, f64::min);
                let reached = flow.h.min(event);
                while let Some(time) = times.get(next).filter(|time| **time <= t + reached) {
                    let x = flow.advance(&y, time - t);
                    columns.iter_mut().zip(x.iter()).for_each(|(column, x)| column.push(*x));
                    next += 1;
                }
                if next == times.len() {
                    // At each event the zero tolerances may select a wrong mode, which is then followed until the
                    // next event: the error estimate grows with each event.
                    let part = 1e-9 + self.part * HOLDS * events as f64;
                    let accuracy = sizes.iter().take(n).map(|size| part * size).collect();
                    return Some(Values { columns, accuracy });
                }
                t += reached;
                steps += 1.0;
                if event < f64::INFINITY {
                    y = flow.advance(&y, event);
                    break;
                }
                y = after;
                if !y.iter().all(|x| x.is_finite()) {
                    return None;
                }
                sizes.iter_mut().zip(y.iter()).for_each(|(size, x)| *size = size.max(x.abs()));
            }
        }
        None
    }

    /// Returns the scales of the unknowns, which are their magnitudes in `y`.
    fn sizes(&self, y: &DVector<f64>) -> DVector<f64> {
        y.map(|x| x.abs().max(f64::MIN_POSITIVE))
    }

    /// Returns the mode in which the solution continues from the unknowns `y`; `None` if there is none, or if several
    /// modes continue differently.
    fn choose(&self, y: &DVector<f64>, sizes: &DVector<f64>) -> Option<Mode> {
        let m = self.bounds.len();
        let mut found: Option<(Mode, DVector<f64>)> = None;
        for k in 0..3_usize.pow(m as u32) {
            let places: Vec<Place> =
                (0..m as u32).map(|i| [Place::Inside, Place::Lower, Place::Upper][k / 3_usize.pow(i) % 3]).collect();
            let Some(mode) = self.mode(&places, y, sizes) else { continue };
            if mode.monitors.iter().any(|row| lexicographic_sign(row, &mode.flow, y, sizes, self.part * ZERO) < 0.0) {
                continue;
            }
            let direction = &mode.flow * y;
            match &found {
                None => found = Some((mode, direction)),
                Some((first, other)) => {
                    // Modes that give equal rates of the states, and differ only in undetermined variables, are
                    // equivalent.
                    let scale = |i: usize| {
                        terms(&mode.flow.row(i).clone_owned(), sizes)
                            .max(terms(&first.flow.row(i).clone_owned(), sizes))
                    };
                    if (0..self.system.states()).any(|i| (direction[i] - other[i]).abs() > 1e-6 * scale(i)) {
                        return None;
                    }
                }
            }
        }
        found.map(|(mode, _)| mode)
    }

    /// Returns the mode with the given active bounds, if the current states admit the mode and it determines the
    /// variables as far as they act on the states.
    fn mode(&self, places: &[Place], y: &DVector<f64>, sizes: &DVector<f64>) -> Option<Mode> {
        let (n, unknowns, one) = (self.system.states(), self.driven.unknowns(), self.system.states());
        let inside: Vec<usize> = (0..places.len()).filter(|&i| places[i] == Place::Inside).collect();
        // Write the variables as linear functions of the unknowns, beginning with those at a bound.
        let mut z = DMatrix::zeros(places.len(), unknowns);
        for (i, place) in places.iter().enumerate() {
            let (lower, upper) = self.bounds[i];
            let bound = match place {
                Place::Lower => lower,
                Place::Upper => upper,
                Place::Inside => 0.0,
            };
            if !bound.is_finite() {
                return None;
            }
            z[(i, one)] = bound;
        }
        let entries = |matrix: &[Vec<f64>], rows: &[usize], columns: &[usize]| {
            DMatrix::from_fn(rows.len(), columns.len(), |i, j| matrix[rows[i]][columns[j]])
        };
        let (all, states): (Vec<usize>, Vec<usize>) = ((0..places.len()).collect(), (0..n).collect());
        let (b, d) = (entries(&self.system.b, &states, &all), entries(&self.system.d, &all, &all));
        let mut at_zero = Vec::new();
        if !inside.is_empty() {
            let d_inside = entries(&self.system.d, &inside, &inside);
            let rows: Vec<RowDVector<f64>> = inside.iter().map(|&i| &self.gaps[i] + d.row(i) * &z).collect();
            let r = DMatrix::from_rows(&rows);
            let left = left_null_space(&d_inside);
            // Constraints that do not depend on the inactive variables, so that the states must satisfy them; then
            // the rates of these constraints.
            let kept = left.transpose() * &r;
            for row in kept.row_iter() {
                let row = row.clone_owned();
                at_zero.push(row.clone());
                if (&row * y)[0].abs() > self.part * HOLDS * terms(&row, sizes) {
                    return None;
                }
            }
            let rates = self.flow(&z);
            let b_inside = {
                let mut full = DMatrix::zeros(unknowns, inside.len());
                full.view_mut((0, 0), (n, inside.len())).copy_from(&entries(&self.system.b, &states, &inside));
                full
            };
            let stack = stacked(&d_inside, &(&kept * &b_inside));
            let known = stacked(&r, &(&kept * &rates));
            let (solved, null) = least_squares(&stack, &known)?;
            let felt = entries(&self.system.b, &states, &inside) * &null;
            if felt.amax() > 1e-8 * b.amax() {
                return None;
            }
            let left_over = (&stack * &solved + &known) * y;
            let sizes_of_terms = (stack.abs() * solved.abs() + known.abs()) * sizes;
            if left_over.iter().zip(sizes_of_terms.iter()).any(|(value, terms)| value.abs() > self.part * HOLDS * terms)
            {
                return None;
            }
            inside.iter().enumerate().for_each(|(k, &i)| z.set_row(i, &solved.row(k)));
        }
        let mut monitors = Vec::new();
        for (i, place) in places.iter().enumerate() {
            let gap = &self.gaps[i] + d.row(i) * &z;
            let (lower, upper) = self.bounds[i];
            let mut one_row = RowDVector::zeros(unknowns);
            one_row[one] = 1.0;
            match place {
                Place::Lower => monitors.push(gap),
                Place::Upper => monitors.push(-gap),
                Place::Inside => {
                    if lower.is_finite() {
                        monitors.push(z.row(i) - &one_row * lower);
                    }
                    if upper.is_finite() {
                        monitors.push(&one_row * upper - z.row(i));
                    }
                }
            }
        }
        Some(Mode { flow: self.flow(&z), monitors, kept: at_zero })
    }

    /// Returns the matrix of the rates of all unknowns, with the variables as linear functions `z` of the unknowns.
    fn flow(&self, z: &DMatrix<f64>) -> DMatrix<f64> {
        let row = |(i, rate): (usize, &RowDVector<f64>)| {
            self.system.b[i].iter().enumerate().fold(rate.clone(), |sum, (j, b)| sum + z.row(j) * *b)
        };
        self.driven.rates(&self.rates.iter().enumerate().map(row).collect::<Vec<_>>())
    }
}

impl Mode {
    /// Projects the states onto the constraints of the mode, by the least change relative to their scales: an error
    /// of event location would otherwise persist throughout the mode.
    fn project(&self, y: &mut DVector<f64>, sizes: &DVector<f64>, n: usize) {
        if self.kept.is_empty() {
            return;
        }
        let weights = DVector::from_fn(n, |j, _| sizes[j]);
        let scaled = DMatrix::from_fn(self.kept.len(), n, |i, j| self.kept[i][j] * weights[j]);
        let left = DVector::from_fn(self.kept.len(), |i, _| (&self.kept[i] * &*y)[0]);
        let svd = scaled.svd(true, true);
        let cut = RANK * svd.singular_values.amax().max(f64::MIN_POSITIVE);
        if let Ok(change) = svd.solve(&left, cut) {
            (0..n).for_each(|j| y[j] -= weights[j] * change[j]);
        }
    }
}

fn stacked(above: &DMatrix<f64>, below: &DMatrix<f64>) -> DMatrix<f64> {
    let mut all = DMatrix::zeros(above.nrows() + below.nrows(), above.ncols());
    all.rows_mut(0, above.nrows()).copy_from(above);
    all.rows_mut(above.nrows(), below.nrows()).copy_from(below);
    all
}

/// Returns a basis of the vectors `w` with `w^T a = 0`, as columns.
fn left_null_space(a: &DMatrix<f64>) -> DMatrix<f64> {
    let n = a.nrows();
    let (values, vectors) = {
        let eigen = (a * a.transpose()).symmetric_eigen();
        (eigen.eigenvalues, eigen.eigenvectors)
    };
    let largest = values.amax();
    let null: Vec<DVector<f64>> = (0..n)
        .filter(|&k| largest == 0.0 || values[k] <= RANK * RANK.sqrt() * largest)
        .map(|k| vectors.column(k).clone_owned())
        .collect();
    if null.is_empty() { DMatrix::zeros(n, 0) } else { DMatrix::from_columns(&null) }
}

/// Returns the least-squares solution `z` of least norm of `stack z + known = 0`, and a basis of the null space of
/// `stack`. Rows are scaled to a largest entry of one, so that rows of `D` and rows of rates have equal weight.
fn least_squares(stack: &DMatrix<f64>, known: &DMatrix<f64>) -> Option<(DMatrix<f64>, DMatrix<f64>)> {
    let (mut stack, mut known) = (stack.clone(), known.clone());
    for i in 0..stack.nrows() {
        let size = stack.row(i).amax();
        if size > 0.0 {
            stack.row_mut(i).unscale_mut(size);
            known.row_mut(i).unscale_mut(size);
        }
    }
    let columns = stack.ncols();
    let normal = (stack.transpose() * &stack).symmetric_eigen();
    let largest = normal.eigenvalues.amax();
    let open: Vec<DVector<f64>> = (0..columns)
        .filter(|&k| normal.eigenvalues[k] <= RANK * largest)
        .map(|k| normal.eigenvectors.column(k).clone_owned())
        .collect();
    let svd = stack.svd(true, true);
    let solved = -svd.solve(&known, RANK.sqrt() * svd.singular_values.amax().max(f64::MIN_POSITIVE)).ok()?;
    Some((solved, if open.is_empty() { DMatrix::zeros(columns, 0) } else { DMatrix::from_columns(&open) }))
}
