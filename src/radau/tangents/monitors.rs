//! Derivatives of the time of a switch, or of a breakpoint of the rows, with respect to the directions.

use super::independent::{Jump, TimesOfVariables, agree};
use super::stages::Rows;
use super::{NoDerivative, Saltation, Tangents, changed};
use crate::face::{ActiveFace, Activity};
use crate::settings::Settings;
use crate::stepper::Radau;
use factorisation::Singular;
use hybrid::{OneStep, Shift, break_slopes};
use nalgebra::DMatrix;
use numerics::CENTRAL_DIFFERENCE;
use problem::{Dvi, Shape, Side, Structure};

/// A monitor (event function) whose rate is below this fraction of its terms touches zero (grazing).
const TOUCHES: f64 = 1e-9;
/// Derivatives of the times of simultaneous switches that agree to this fraction belong to one switch, seen in several
/// variables.
pub(super) const AGREE: f64 = 1e-6;
/// Singular values below this fraction of the largest singular value count as zero.
const SINGULAR: f64 = 1e-10;

impl Tangents {
    /// Returns the changes of the derivatives by the switches at the end of a step, at which the rates jump.
    pub(super) fn switches(
        &mut self,
        radau: &mut Radau<'_>,
        ends: [f64; 2],
        jump: Jump<'_>,
    ) -> Result<Vec<Saltation>, NoDerivative> {
        let face = radau.last.face.clone();
        let whole = |times: Vec<f64>| vec![Saltation { jump: jump.by.to_vec(), times }];
        // At a breakpoint the rows jump, and variables with them: the monitors of variables do not determine its time.
        if let Some(times) = self.break_times(ends) {
            return times.map(whole);
        }
        let variables = changed(&face.places, &radau.face().places);
        if variables.is_empty() {
            return Ok(Vec::new());
        }
        let (t, before) = (ends[0], jump.ends[0]);
        let (rows, states) = self.rows_with_time(t, before);
        let sizes = sizes(radau, before);
        let span = t.abs().max(radau.last.h);
        let slopes = self.variables_along((t, span, before), &face, &rows, &states, &sizes)?;
        let of_variable = |k: usize| Ok((k, self.times_of(k, (&face, radau.face()), &rows, (&states, &slopes))?));
        let times: TimesOfVariables = variables.into_iter().map(of_variable).collect::<Result<_, NoDerivative>>()?;
        let is_one = times.iter().all(|(_, other)| agree(&times[0].1, other));
        // A basis of the states has directions that lead off the constraints: along these, the monitors of one switch
        // need not agree on the derivatives of its time.
        let apart = (!is_one).then(|| self.independent(t, &rows, &times, jump)).flatten();
        match apart {
            Some(saltations) => Ok(saltations),
            None if is_one || self.is_basis => {
                Ok(times.into_iter().next().map_or(Vec::new(), |(_, times)| whole(times)))
            }
            None => Err(NoDerivative::Several),
        }
    }

    /// Returns the derivatives of the rows of the problem, and those of the states, with time as a further direction.
    fn rows_with_time(&mut self, t: f64, y: &[f64]) -> (Rows, DMatrix<f64>) {
        let (rates, _) = self.rates(t, y);
        let by_time = self.rows_by_time(t, y);
        let with = |matrix: DMatrix<f64>, column: &[f64]| {
            let last = matrix.ncols();
            let mut matrix = matrix.insert_column(last, 0.0);
            matrix.column_mut(last).copy_from_slice(column);
            matrix
        };
        let rows = self.rows_at(t, y);
        let states = with(self.now.clone(), &rates);
        (Rows { by_directions: with(rows.by_directions, &by_time), ..rows }, states)
    }

    /// Returns the derivatives of the time at which the monitor (event function) of variable `k` vanishes with respect
    /// to the directions.
    fn times_of(
        &self,
        k: usize,
        (face, next): (&ActiveFace, &ActiveFace),
        rows: &Rows,
        (states, variables): (&DMatrix<f64>, &DMatrix<f64>),
    ) -> Result<Vec<f64>, NoDerivative> {
        let (n, count) = (states.nrows(), self.count());
        let structure = self.problem.structure();
        let side = match (face.places[k], next.places[k]) {
            (Activity::Inactive, Activity::AtLower) => Some(Side::Lower),
            (Activity::Inactive, Activity::AtUpper) => Some(Side::Upper),
            (Activity::AtLower | Activity::AtUpper | Activity::Boundary(_), _) => None,
            _ => return Err(NoDerivative::Block),
        };
        // The multiplier of a bound is a row of `G`, up to its sign; that of a sphere is the component of `G` along
        // the ray.
        let multiplier = match face.places[k] {
            Activity::Boundary(_) => ray(structure, k, rows).ok_or(NoDerivative::Block)?,
            _ => vec![(k, 1.0)],
        };
        // Returns the derivative of a row of the problem along a column of derivatives of the unknowns, and the
        // largest of its terms.
        let along = |row: usize, column: usize| -> (f64, f64) {
            let unknowns =
                states.column(column).iter().chain(variables.column(column).iter()).copied().collect::<Vec<_>>();
            let products =
                rows.by_y.row(row).iter().zip(&unknowns).map(|(slope, change)| slope * change).collect::<Vec<_>>();
            let own = rows.by_directions[(row, column)];
            let largest = products.iter().fold(own.abs(), |most, product| most.max(product.abs()));
            (products.iter().sum::<f64>() + own, largest)
        };
        let of_monitor = |column: usize| -> (f64, f64) {
            let Some(side) = side else {
                let parts = multiplier.iter().map(|&(l, weight)| {
                    let (value, terms) = along(n + l, column);
                    (weight * value, weight.abs() * terms)
                });
                return parts.fold((0.0, 0.0), |(sum, most), (value, terms)| (sum + value, terms.max(most)));
            };
            let own = variables[(k, column)];
            let moving = structure.moving.iter().position(|moving| moving.variable == k && moving.side == side);
            let moved = moving.map_or((0.0, 0.0), |p| along(structure.unknowns() + p, column));
            let constant: f64 = self
                .directions
                .bounds
                .iter()
                .filter(|(bound, direction, _)| bound.variable == k && bound.side == side && *direction == column)
                .map(|(.., value)| value)
                .sum();
            (own - moved.0 - constant, own.abs().max(moved.1))
        };
        let (rate, terms) = of_monitor(count);
        if rate.abs() <= TOUCHES * terms || rate == 0.0 {
            return Err(NoDerivative::Grazing);
        }
        Ok((0..count).map(|direction| -of_monitor(direction).0 / rate).collect())
    }

    /// Returns the derivatives of the variables of a face along the states, the directions and time, one column each
    /// as in `states`: from `G` as far as its derivative with respect to the variables is regular, otherwise from the
    /// time derivative of `G`.
    fn variables_along(
        &mut self,
        (t, span, y): (f64, f64, &[f64]),
        face: &ActiveFace,
        rows: &Rows,
        states: &DMatrix<f64>,
        sizes: &[f64],
    ) -> Result<DMatrix<f64>, NoDerivative> {
        let (n, columns) = (states.nrows(), states.ncols());
        let m = y.len() - n;
        let [by_y, by_directions] = self.equations(face, rows)?;
        let mut matrix = by_y.columns(n, m).into_owned();
        let mut right = -(by_directions + by_y.columns(0, n) * states);
        let inside: Vec<usize> = (0..m).filter(|&k| face.places[k] == Activity::Inactive).collect();
        if let Some(hidden) = hidden_combinations(&matrix, &inside) {
            // Solve for the derivatives of variables on bounds first: those of the other variables depend on them.
            let mut fixed = DMatrix::zeros(m, columns);
            (0..m).filter(|k| !inside.contains(k)).for_each(|k| fixed.set_row(k, &right.row(k)));
            let by_variables = self.inverse_mass.solve(&rows.by_y.view((0, n), (n, m)).into_owned());
            let by_variables = by_variables.ok_or(NoDerivative::Singular)?;
            let slopes = self.hidden_slopes((t, span, y), states, &fixed, sizes);
            let own = matrix.clone();
            let own_right = right.clone();
            for (row, Combination { weights, is_hidden }) in inside.iter().copied().zip(hidden) {
                let sum = |of: &dyn Fn(usize) -> f64| weights.iter().zip(&inside).map(|(w, &k)| w * of(k)).sum::<f64>();
                for l in 0..m {
                    let of_hidden = |k: usize| (rows.by_y.view((n + k, 0), (1, n)) * by_variables.column(l))[(0, 0)];
                    matrix[(row, l)] = match is_hidden {
                        true if inside.contains(&l) => sum(&of_hidden),
                        true => 0.0,
                        false => sum(&|k| own[(k, l)]),
                    };
                }
                for column in 0..columns {
                    right[(row, column)] = match is_hidden {
                        true => -sum(&|k| slopes[(k, column)]),
                        false => sum(&|k| own_right[(k, column)]),
                    };
                }
            }
        }
        let factors = matrix.full_piv_lu();
        if !factors.solve_mut(&mut right) || right.iter().any(|value| !value.is_finite()) {
            return Err(NoDerivative::Singular);
        }
        Ok(right)
    }

    /// Returns the slopes (time derivatives) of the derivatives on the face on which a run goes on; `None` if the
    /// equations do not determine them.
    pub(super) fn slopes_on_face(&mut self, radau: &Radau<'_>) -> Option<DMatrix<f64>> {
        let (t, y, face) = (radau.t(), radau.y().to_vec(), radau.face().clone());
        let (n, count) = (self.mass.nrows(), self.count());
        let (rows, states) = self.rows_with_time(t, &y);
        let sizes = sizes(radau, &y);
        let span = t.abs().max(radau.last.h);
        let variables = self.variables_along((t, span, &y), &face, &rows, &states, &sizes).ok()?;
        let mut right = rows.by_y.view((0, 0), (n, n)) * &self.now
            + rows.by_y.view((0, n), (n, y.len() - n)) * variables.columns(0, count)
            + rows.by_directions.view((0, 0), (n, count));
        for &((row, column), direction, value) in &self.directions.mass {
            right[(row, direction)] -= value * states[(column, count)];
        }
        self.inverse_mass.solve(&right)
    }

    /// Returns the derivatives of `dG/dt = G_t + G_x M^-1 F` along columns of states with variables and along the
    /// directions, and with respect to time for the last column, by central differences, which go no further than a
    /// part of the time `span`.
    fn hidden_slopes(
        &mut self,
        (t, span, y): (f64, f64, &[f64]),
        states: &DMatrix<f64>,
        variables: &DMatrix<f64>,
        sizes: &[f64],
    ) -> DMatrix<f64> {
        let (m, columns) = (variables.nrows(), states.ncols());
        let mut slopes = DMatrix::zeros(m, columns);
        self.differences += columns as u64;
        for column in 0..columns {
            let way: Vec<f64> = states.column(column).iter().chain(variables.column(column).iter()).copied().collect();
            let parts = way.iter().zip(sizes).filter(|(way, _)| **way != 0.0).map(|(way, size)| size / way.abs());
            let mut by = CENTRAL_DIFFERENCE * parts.fold(f64::INFINITY, f64::min);
            let in_time = if column + 1 == columns { 1.0 } else { 0.0 };
            // The shift in time of the difference is limited by the motion of the states, unless they are at rest.
            if in_time > 0.0 || !by.is_finite() {
                by = by.min(CENTRAL_DIFFERENCE * span);
            }
            let [above, below] = [by, -by].map(|by| {
                let moved: Vec<f64> = y.iter().zip(&way).map(|(y, way)| y + by * way).collect();
                hidden(&mut *self.problem, &self.inverse_mass, t + in_time * by, &moved)
            });
            for k in 0..m {
                slopes[(k, column)] = (above[k] - below[k]) / (2.0 * by);
            }
            if let Some(Some(shifted)) = self.directions.shifted.get_mut(column) {
                let [above, below] =
                    shifted.problems.each_mut().map(|problem| hidden(&mut **problem, &self.inverse_mass, t, y));
                for k in 0..m {
                    slopes[(k, column)] += (above[k] - below[k]) / (2.0 * shifted.by);
                }
            }
        }
        slopes
    }

    /// Returns the derivatives of the rows of the problem with respect to time alone: of `G` exactly, of bounds by
    /// central differences.
    fn rows_by_time(&mut self, t: f64, y: &[f64]) -> Vec<f64> {
        let structure = self.problem.structure();
        let (n, unknowns, rows) = (structure.states, structure.unknowns(), structure.rows());
        let mut by_time = vec![0.0; rows];
        self.problem.time_derivative(t, y, &mut by_time[n..unknowns]);
        if rows > unknowns {
            let by = CENTRAL_DIFFERENCE * t.abs().max(f64::MIN_POSITIVE.sqrt());
            let mut at = |t: f64| {
                let mut values = vec![0.0; rows];
                self.problem.evaluate(t, y, &mut values);
                values
            };
            let (above, below) = (at(t + by), at(t - by));
            (unknowns..rows).for_each(|row| by_time[row] = (above[row] - below[row]) / (2.0 * by));
        }
        by_time
    }

    /// Returns the derivatives of the time of a breakpoint with respect to the directions; `None` if no function of
    /// time changes its sign there.
    fn break_times(&mut self, ends: [f64; 2]) -> Option<Result<Vec<f64>, NoDerivative>> {
        let shifts = self.directions.shifted.iter_mut().map(|shifted| {
            let shifted = shifted.as_mut()?;
            self.differences += 1;
            Some((shifted.by, shifted.problems.each_mut().map(|problem| problem.break_courses(ends[0]).to_vec())))
        });
        let shifts: Vec<Option<Shift>> = shifts.collect();
        let at = |t: f64| [self.problem.breaks(t).to_vec(), self.problem.break_courses(t).to_vec()];
        let slopes = break_slopes(ends, at, &shifts)?;
        Some(slopes.map_err(NoDerivative::from))
    }
}

/// Returns the magnitudes of the unknowns of a run, as scales for differences: a state below its absolute tolerance
/// counts as zero, and has the magnitude at which the relative tolerance begins to matter.
fn sizes(radau: &Radau<'_>, y: &[f64]) -> Vec<f64> {
    let Settings { rtol, atol, .. } = &radau.settings;
    let met = y.iter().zip(radau.largest()).map(|(y, largest)| y.abs().max(*largest));
    let size = |(k, size): (usize, f64)| match atol.get(k) {
        Some(atol) if size <= *atol => atol / rtol,
        _ => size,
    };
    met.enumerate().map(size).collect()
}

/// Returns the ray through the point of a block on a sphere that contains variable `k`, as pairs of a variable and
/// its component; `None` on other boundaries.
fn ray(structure: &Structure, k: usize, rows: &Rows) -> Option<Vec<(usize, f64)>> {
    let block = &structure.set.blocks()[structure.set.block_of(k)?];
    let (z, _) = rows.point.as_ref()?;
    let is_sphere = matches!(block.shape, Shape::Ball { .. });
    is_sphere.then(|| block.members.iter().map(|&l| (l, z[l])).collect())
}

/// A combination of the equations of the free variables (those not on a bound).
struct Combination {
    /// Weight of the equation of each free variable in the combination.
    weights: Vec<f64>,
    /// Whether the combination contains no free variable, so that its time derivative must determine the free
    /// variables.
    is_hidden: bool,
}

/// Returns combinations of the equations of the variables `inside`, as many as there are equations, by the singular
/// value decomposition of their matrix; `None` if the matrix is regular.
fn hidden_combinations(matrix: &DMatrix<f64>, inside: &[usize]) -> Option<Vec<Combination>> {
    let count = inside.len();
    if count == 0 {
        return None;
    }
    let scale = |i: usize| inside.iter().fold(0.0_f64, |most, &l| most.max(matrix[(inside[i], l)].abs()));
    let scales: Vec<f64> = (0..count).map(|i| if scale(i) > 0.0 { scale(i).recip() } else { 1.0 }).collect();
    let scaled = DMatrix::from_fn(count, count, |i, j| scales[i] * matrix[(inside[i], inside[j])]);
    let Singular { u, values, .. } = Singular::of(&scaled)?;
    let largest = values.first().copied().unwrap_or(0.0);
    let vanishes = |value: f64| value <= SINGULAR * largest;
    values.iter().any(|value| vanishes(*value)).then(|| {
        let combination = |(k, value): (usize, &f64)| Combination {
            weights: u.column(k).iter().zip(&scales).map(|(weight, scale)| weight * scale).collect(),
            is_hidden: vanishes(*value),
        };
        values.iter().enumerate().map(combination).collect()
    })
}

/// Evaluates the hidden constraints of the variables, `dG/dt = G_t + G_x M^-1 F`.
fn hidden(
    problem: &mut dyn Dvi,
    inverse_mass: &nalgebra::LU<f64, nalgebra::Dyn, nalgebra::Dyn>,
    t: f64,
    y: &[f64],
) -> Vec<f64> {
    let structure = problem.structure();
    let (n, m, rows) = (structure.states, structure.variables, structure.rows());
    let pattern = structure.pattern.clone();
    let mut values = vec![0.0; rows];
    problem.evaluate(t, y, &mut values);
    let mut rates = DMatrix::from_column_slice(n, 1, &values[..n]);
    inverse_mass.solve_mut(&mut rates);
    let mut derivatives = vec![0.0; pattern.len()];
    problem.jacobian(t, y, &mut derivatives);
    let mut slopes = vec![0.0; m];
    problem.time_derivative(t, y, &mut slopes);
    for (&(row, column), value) in pattern.iter().zip(&derivatives) {
        if (n..n + m).contains(&row) && column < n {
            slopes[row - n] += value * rates[column];
        }
    }
    slopes
}
