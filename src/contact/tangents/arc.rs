//! The derivatives along a smooth arc: those of the stages of Radau IIA, with the exact derivatives of the accelerations at
//! each stage,
//!
//! ```text
//! dX_i = dx_n + h sum_j a_ij (F_x dX_j + F_p),    F = (v, a(t, q, v; p)),    dx_{n+1} = dX_s
//! ```
//!
//! and between the stages the polynomial through them, corrected by the slope at its beginning as the states are.

use super::linearised::{Columns, Linearised};
use super::{Directions, NoDerivative};
use crate::locate::ModeEquations;
use nalgebra::DMatrix;
use radau::{LastStep, Tableau};

/// The part of a step by which its end may be missed: rounding of the clock.
const AT_END: f64 = 1e-9;

/// The derivatives along the last step.
pub(super) struct Arc {
    begin: f64,
    h: f64,
    tableau: &'static Tableau,
    before: DMatrix<f64>,
    stages: Vec<DMatrix<f64>>,
    /// The slope that the polynomial lacks at the beginning, times the step size.
    lacking: DMatrix<f64>,
}

/// The derivatives of `x' = (v, a)` with respect to `x` and to the directions.
fn rates(linearised: &Linearised, columns: Columns) -> (DMatrix<f64>, DMatrix<f64>) {
    let (n, p) = (columns.coordinates, columns.directions);
    let mut by_x = DMatrix::zeros(2 * n, 2 * n);
    by_x.view_mut((0, n), (n, n)).fill_with_identity();
    by_x.view_mut((n, 0), (n, 2 * n)).copy_from(&linearised.a.columns(0, 2 * n));
    let mut by_directions = DMatrix::zeros(2 * n, p);
    by_directions.rows_mut(n, n).copy_from(&linearised.a.columns(2 * n, p));
    (by_x, by_directions)
}

impl Arc {
    /// Differentiates a step, from the derivatives `before` at its beginning.
    pub fn new(
        step: LastStep<'_>,
        before: &DMatrix<f64>,
        equations: &mut ModeEquations,
        directions: &mut Directions,
    ) -> Result<Self, NoDerivative> {
        let LastStep { t, h, y, z, tableau } = step;
        let columns = Columns { coordinates: y.len() / 2, directions: directions.count() };
        let (size, s) = (y.len(), tableau.stages());
        let singular = NoDerivative::Smooth(radau::NoDerivative::Singular);
        let mut matrix = DMatrix::identity(s * size, s * size);
        let mut right = DMatrix::zeros(s * size, columns.directions);
        for i in 0..s {
            right.rows_mut(i * size, size).copy_from(before);
        }
        for (j, z) in z.chunks_exact(size).enumerate() {
            let x: Vec<f64> = y.iter().zip(z).map(|(y, z)| y + z).collect();
            let linearised = Linearised::at(equations, t + tableau.c[j] * h, &x, directions).ok_or(singular)?;
            let (by_x, by_directions) = rates(&linearised, columns);
            for i in 0..s {
                let weight = h * tableau.a[(i, j)];
                let mut block = matrix.view_mut((i * size, j * size), (size, size));
                block -= &by_x * weight;
                let mut block = right.rows_mut(i * size, size);
                block += &by_directions * weight;
            }
        }
        if !matrix.lu().solve_mut(&mut right) || right.iter().any(|value| !value.is_finite()) {
            return Err(singular);
        }
        let stages: Vec<DMatrix<f64>> = (0..s).map(|i| right.rows(i * size, size).into_owned()).collect();
        let at_begin = Linearised::at(equations, t, y, directions).ok_or(singular)?;
        let (by_x, by_directions) = rates(&at_begin, columns);
        let mut lacking = (by_x * before + by_directions) * h;
        for (j, stage) in stages.iter().enumerate() {
            let others = (0..s).filter(|i| *i != j);
            let slope = others.map(|i| -tableau.c[i] / (tableau.c[j] - tableau.c[i])).product::<f64>() / tableau.c[j];
            lacking -= (stage - before) * slope;
        }
        Ok(Self { begin: t, h, tableau, before: before.clone(), stages, lacking })
    }

    /// The derivatives at a time within the step, one direction per column.
    pub fn at(&self, t: f64) -> DMatrix<f64> {
        let theta = (t - self.begin) / self.h;
        if let Some(last) = self.stages.last().filter(|_| theta >= 1.0 - AT_END) {
            return last.clone();
        }
        let mut weights = vec![0.0; self.stages.len()];
        self.tableau.increments_at(theta, &mut weights);
        let mut value = &self.before + &self.lacking * self.tableau.bubble_at(theta);
        weights.iter().zip(&self.stages).for_each(|(weight, stage)| value += (stage - &self.before) * *weight);
        value
    }
}
