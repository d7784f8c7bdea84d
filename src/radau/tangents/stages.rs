//! The derivatives of the stages of one step.

use super::{NoDerivative, Tangents, Terms};
use crate::dense_output::Step;
use crate::face::{ActiveFace, Activity};
use crate::tableau::Tableau;
use nalgebra::DMatrix;
use problem::{Face, Side};

/// The derivatives of the rows at one point.
pub(super) struct Rows {
    /// With respect to `y`: rows of `F`, `G` and the moving bounds.
    pub by_y: DMatrix<f64>,
    /// With respect to the directions.
    pub by_directions: DMatrix<f64>,
}

impl Tangents {
    /// The derivatives of the rows at `(t, y)`.
    pub(super) fn rows_at(&mut self, t: f64, y: &[f64]) -> Rows {
        let structure = self.problem.structure();
        let (rows, unknowns) = (structure.rows(), structure.unknowns());
        let pattern = structure.pattern.clone();
        let mut values = vec![0.0; pattern.len()];
        self.problem.jacobian(t, y, &mut values);
        let mut by_y = DMatrix::zeros(rows, unknowns);
        pattern.iter().zip(values).for_each(|(&place, value)| by_y[place] = value);
        let mut by_directions = DMatrix::zeros(rows, self.count());
        (self.directions.rows)(t, y, &mut by_directions);
        Rows { by_y, by_directions }
    }

    /// The derivatives of the equation of variable `k` on a face, with respect to `y` and with respect to the
    /// directions.
    pub(super) fn equation(
        &self,
        face: &ActiveFace,
        k: usize,
        rows: &Rows,
    ) -> Result<(Vec<f64>, Vec<f64>), NoDerivative> {
        let structure = self.problem.structure();
        let (n, unknowns) = (structure.states, structure.unknowns());
        if let Some(b) = structure.set.block_of(k)
            && face.blocks[b] != Face::Interior
        {
            return Err(NoDerivative::Block);
        }
        let side = match face.places[k] {
            Activity::Inactive => {
                let row = |matrix: &DMatrix<f64>| matrix.row(n + k).iter().copied().collect();
                return Ok((row(&rows.by_y), row(&rows.by_directions)));
            }
            Activity::AtLower => Side::Lower,
            Activity::AtUpper => Side::Upper,
            Activity::Fixed | Activity::Boundary(_) | Activity::Vertex => return Err(NoDerivative::Block),
        };
        let (mut by_y, mut by_directions) = (vec![0.0; unknowns], vec![0.0; self.count()]);
        by_y[n + k] = 1.0;
        for (p, _) in
            structure.moving.iter().enumerate().filter(|(_, moving)| moving.variable == k && moving.side == side)
        {
            let row = unknowns + p;
            by_y.iter_mut().zip(rows.by_y.row(row).iter()).for_each(|(sum, value)| *sum -= value);
            by_directions.iter_mut().zip(rows.by_directions.row(row).iter()).for_each(|(sum, value)| *sum -= value);
        }
        for &(bound, direction, value) in &self.directions.bounds {
            if bound.variable == k && bound.side == side {
                by_directions[direction] -= value;
            }
        }
        Ok((by_y, by_directions))
    }

    /// The equations of a face, linearised at `(t, y)`: the mass matrix, with zeros for the variables, and the
    /// derivatives of the right-hand sides with respect to `y`.
    ///
    /// # Errors
    /// Variables on the boundary of a block.
    pub fn linearised(&mut self, face: &ActiveFace, t: f64, y: &[f64]) -> Result<[DMatrix<f64>; 2], NoDerivative> {
        let (n, unknowns) = (self.mass.nrows(), y.len());
        let rows = self.rows_at(t, y);
        let mut mass = DMatrix::zeros(unknowns, unknowns);
        mass.view_mut((0, 0), (n, n)).copy_from(&self.mass);
        let mut by_y = rows.by_y.rows(0, unknowns).into_owned();
        for k in 0..unknowns - n {
            let (own, _) = self.equation(face, k, &rows)?;
            by_y.row_mut(n + k).iter_mut().zip(&own).for_each(|(out, value)| *out = *value);
        }
        Ok([mass, by_y])
    }

    /// The derivatives of the equations of a face at `(t, y)`: of `F`, then of the equation of each variable, with respect
    /// to `y` and to the directions.
    ///
    /// # Errors
    /// Variables on the boundary of a block.
    pub fn derivatives(&mut self, face: &ActiveFace, t: f64, y: &[f64]) -> Result<[DMatrix<f64>; 2], NoDerivative> {
        let (n, unknowns) = (self.mass.nrows(), y.len());
        let rows = self.rows_at(t, y);
        let mut by_y = rows.by_y.rows(0, unknowns).into_owned();
        let mut by_directions = rows.by_directions.rows(0, unknowns).into_owned();
        for k in 0..unknowns - n {
            let (own, own_by_directions) = self.equation(face, k, &rows)?;
            by_y.row_mut(n + k).copy_from_slice(&own);
            by_directions.row_mut(n + k).copy_from_slice(&own_by_directions);
        }
        Ok([by_y, by_directions])
    }

    /// Solves for the derivatives of the states at the stages of a step.
    pub(super) fn solve_stages(&mut self, step: &Step, tableau: &Tableau) -> Result<(), NoDerivative> {
        let (n, unknowns, s) = (self.mass.nrows(), step.y.len(), tableau.stages());
        let StageEquations { matrix, by_directions: mut right } = self.stage_equations(step, tableau)?;
        let first = &self.mass * &self.before;
        let mut terms = self.terms.is_some().then(|| right.abs());
        let absolute = terms.is_some().then(|| matrix.abs());
        for i in 0..s {
            let mut own = right.rows_mut(i * unknowns, n);
            own += &first;
        }
        if !matrix.lu().solve_mut(&mut right) || right.iter().any(|value| !value.is_finite()) {
            return Err(NoDerivative::Singular);
        }
        if let (Some(terms), Some(absolute)) = (&mut terms, absolute) {
            *terms += absolute * right.abs();
        }
        if let (Some(of_step), Some(Terms { inverse_mass, now })) = (&terms, &mut self.terms) {
            let mut of_rows = first.abs();
            for i in 0..s {
                of_rows.zip_apply(&of_step.rows(i * unknowns, n), |most, terms| *most = most.max(terms));
            }
            now.copy_from(&(&*inverse_mass * of_rows));
        }
        self.stages.clear();
        self.stages.extend((0..s).map(|i| right.rows(i * unknowns, n).into_owned()));
        Ok(())
    }

    /// The equations of the derivatives at the stages of a step, on its face.
    pub(super) fn stage_equations(&mut self, step: &Step, tableau: &Tableau) -> Result<StageEquations, NoDerivative> {
        let (n, unknowns, s, h) = (self.mass.nrows(), step.y.len(), tableau.stages(), step.h);
        let mut matrix = DMatrix::zeros(s * unknowns, s * unknowns);
        let mut right = DMatrix::zeros(s * unknowns, self.count());
        for (j, z) in step.z.chunks_exact(unknowns).enumerate() {
            let y: Vec<f64> = step.y.iter().zip(z).map(|(y, z)| y + z).collect();
            let rows = self.rows_at(step.t + tableau.c[j] * h, &y);
            let (of_rates, by_directions) = (rows.by_y.rows(0, n), rows.by_directions.rows(0, n));
            for i in 0..s {
                let weight = h * tableau.a[(i, j)];
                let mut block = matrix.view_mut((i * unknowns, j * unknowns), (n, unknowns));
                block -= of_rates * weight;
                let mut block = right.rows_mut(i * unknowns, n);
                block += by_directions * weight;
            }
            let mut own = matrix.view_mut((j * unknowns, j * unknowns), (n, n));
            own += &self.mass;
            for &((row, column), direction, value) in &self.directions.mass {
                right[(j * unknowns + row, direction)] -= value * z[column];
            }
            for k in 0..unknowns - n {
                let (by_y, by_directions) = self.equation(&step.face, k, &rows)?;
                let row = j * unknowns + n + k;
                by_y.iter().enumerate().for_each(|(column, value)| matrix[(row, j * unknowns + column)] = *value);
                by_directions.iter().enumerate().for_each(|(column, value)| right[(row, column)] = -value);
            }
        }
        Ok(StageEquations { matrix, by_directions: right })
    }
}

/// The equations `K dX = (M dx_n, .., M dx_n) + C` of the derivatives `dX` of the unknowns at the stages of a step.
pub(super) struct StageEquations {
    /// `K`
    pub matrix: DMatrix<f64>,
    /// `C`, one column per direction.
    pub by_directions: DMatrix<f64>,
}
