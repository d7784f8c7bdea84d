//! The derivatives along a smooth arc, one column per direction: those of the stages of Radau IIA, with the exact
//! derivatives of the accelerations at each stage,
//!
//! ```text
//! dX_i = dx_n + h sum_j a_ij (F_x dX_j + F_p),    F = (v, a(t, q, v; p)),    dx_{n+1} = dX_s
//! ```
//!
//! and between the stages the collocation polynomial, corrected by the slope at its beginning as for the states.

use super::linearised::{Columns, Linearised};
use super::{Directions, NoDerivative};
use crate::locate::ModeEquations;
use nalgebra::DMatrix;
use radau::{LastStep, Tableau};

/// Tolerance for a time at the end of a step, relative to the step size: rounding of the clock.
const AT_END: f64 = 1e-9;

/// The derivatives of the states along the last step, with respect to the directions.
pub(super) struct Arc {
    begin: f64,
    h: f64,
    tableau: &'static Tableau,
    before: DMatrix<f64>,
    stages: Vec<DMatrix<f64>>,
    /// The derivative of the difference between the slope of the motion and that of the collocation polynomial at the
    /// beginning of the step, times the step size.
    pub lacking: DMatrix<f64>,
    /// The absolute values of the terms that add up to the derivatives in the step: a scale for their rounding
    /// errors.
    pub terms: DMatrix<f64>,
}

/// Returns the derivatives of the rates `x' = (v, a)` by `x`, and by the parameters and initial values
/// that are differentiated (the directions).
fn rates(linearised: &Linearised, columns: Columns) -> (DMatrix<f64>, DMatrix<f64>) {
    let (n, p) = (columns.coordinates, columns.directions);
    let mut by_x = DMatrix::zeros(2 * n, 2 * n);
    by_x.view_mut((0, n), (n, n)).fill_with_identity();
    by_x.view_mut((n, 0), (n, 2 * n)).copy_from(&linearised.a.columns(0, 2 * n));
    let mut by_directions = DMatrix::zeros(2 * n, p);
    by_directions.rows_mut(n, n).copy_from(&linearised.a.columns(2 * n, p));
    (by_x, by_directions)
}

/// Returns the time slopes of the derivatives `now` of a state with respect to the directions; `None` if the mode
/// equations are singular.
pub(super) fn slopes_at(
    equations: &mut ModeEquations,
    (t, x): (f64, &[f64]),
    directions: &mut Directions,
    now: &DMatrix<f64>,
) -> Option<DMatrix<f64>> {
    let columns = Columns { coordinates: x.len() / 2, directions: directions.count() };
    let (by_x, by_directions) = rates(&Linearised::at(equations, t, x, directions)?, columns);
    Some(by_x * now + by_directions)
}

impl Arc {
    /// Differentiates a step of Radau IIA, given the derivatives `before` of the states at its beginning.
    pub fn new(
        step: LastStep<'_>,
        before: &DMatrix<f64>,
        equations: &mut ModeEquations,
        directions: &mut Directions,
    ) -> Result<Self, NoDerivative> {
        let LastStep { t, h, y, tableau, .. } = step;
        let (size, s) = (y.len(), tableau.stages());
        let singular = NoDerivative::Smooth(radau::NoDerivative::Singular);
        let ArcEquations { matrix, by_directions: mut right, at_begin: (by_x, by_directions), terms: of_stages } =
            ArcEquations::new(step, equations, directions).ok_or(singular)?;
        for i in 0..s {
            let mut own = right.rows_mut(i * size, size);
            own += before;
        }
        if !matrix.lu().solve_mut(&mut right) || right.iter().any(|value| !value.is_finite()) {
            return Err(singular);
        }
        let stages: Vec<DMatrix<f64>> = (0..s).map(|i| right.rows(i * size, size).into_owned()).collect();
        let mut lacking = (by_x * before + by_directions) * h;
        for (slope, stage) in tableau.begin_weights().iter().zip(&stages) {
            lacking -= (stage - before) * *slope;
        }
        let (n, p) = (size / 2, before.ncols());
        let mut gained: DMatrix<f64> = DMatrix::zeros(n, p);
        for (stage, terms) in stages.iter().zip(of_stages) {
            let of_stage = (terms.columns(0, size) * stage.abs() + terms.columns(size, p)) * h;
            gained.zip_apply(&of_stage, |most, terms| *most = most.max(terms));
        }
        let mut terms = before.abs();
        for (first, part) in [(0, &gained * h), (n, gained)] {
            let mut own = terms.rows_mut(first, n);
            own += part;
        }
        Ok(Self { begin: t, h, tableau, before: before.clone(), stages, lacking, terms })
    }

    /// Returns the derivatives of the states at a time within the step, one direction per column.
    pub fn at(&self, t: f64) -> DMatrix<f64> {
        let (weights, of_slope) = weights_at(self.tableau, (t - self.begin) / self.h);
        if of_slope.is_none()
            && let Some(last) = self.stages.last()
        {
            return last.clone();
        }
        let mut value = &self.before + &self.lacking * of_slope.unwrap_or(0.0);
        weights.iter().zip(&self.stages).for_each(|(weight, stage)| value += (stage - &self.before) * *weight);
        value
    }
}

/// Returns the weights of the stages in the increment of the collocation polynomial at the fraction `theta` of the
/// step, and the weight of the slope that the polynomial lacks at the beginning. At the end of the step the last
/// stage has weight one, and the slope has no weight (`None`).
pub(super) fn weights_at(tableau: &Tableau, theta: f64) -> (Vec<f64>, Option<f64>) {
    let mut weights = vec![0.0; tableau.stages()];
    if theta >= 1.0 - AT_END {
        if let Some(last) = weights.last_mut() {
            *last = 1.0;
        }
        return (weights, None);
    }
    tableau.increments_at(theta, &mut weights);
    (weights, Some(tableau.bubble_at(theta)))
}

/// The equations `K dX = (dx_n, .., dx_n) + C` of the derivatives `dX` of the stages of a step.
pub(super) struct ArcEquations {
    /// The matrix `K` of the equations for the derivatives of the stages.
    pub matrix: DMatrix<f64>,
    /// The right-hand side `C` of the equations for the derivatives of the stages, one column per direction.
    pub by_directions: DMatrix<f64>,
    /// The derivatives of the rates `(v, a)` at the beginning of the step, with respect to the states and to the
    /// directions.
    pub at_begin: (DMatrix<f64>, DMatrix<f64>),
    /// At each stage, the absolute values of the terms of the derivatives of the accelerations, in [`Columns`].
    pub terms: Vec<DMatrix<f64>>,
}

impl ArcEquations {
    /// Builds the equations of the derivatives of the stages in the contact mode of `equations`; returns `None` if the
    /// mode equations are singular.
    pub fn new(step: LastStep<'_>, equations: &mut ModeEquations, directions: &mut Directions) -> Option<Self> {
        let LastStep { t, h, y, z, tableau } = step;
        let columns = Columns { coordinates: y.len() / 2, directions: directions.count() };
        let (size, s) = (y.len(), tableau.stages());
        let mut matrix = DMatrix::identity(s * size, s * size);
        let mut right = DMatrix::zeros(s * size, columns.directions);
        let mut terms = Vec::with_capacity(s);
        for (j, z) in z.chunks_exact(size).enumerate() {
            let x: Vec<f64> = y.iter().zip(z).map(|(y, z)| y + z).collect();
            let linearised = Linearised::at(equations, t + tableau.c[j] * h, &x, directions)?;
            let (by_x, by_directions) = rates(&linearised, columns);
            for i in 0..s {
                let weight = h * tableau.a[(i, j)];
                let mut block = matrix.view_mut((i * size, j * size), (size, size));
                block -= &by_x * weight;
                let mut block = right.rows_mut(i * size, size);
                block += &by_directions * weight;
            }
            terms.push(linearised.terms);
        }
        let at_begin = rates(&Linearised::at(equations, t, y, directions)?, columns);
        Some(Self { matrix, by_directions: right, at_begin, terms })
    }
}
