//! The derivatives of the states and variables at the stages of one step with respect to the directions.

use super::{NoDerivative, Tangents, Terms};
use crate::dense_output::Step;
use crate::face::{ActiveFace, Activity};
use crate::tableau::Tableau;
use nalgebra::DMatrix;
use problem::{FaceEquations, Side};

/// The derivatives of the rates `F`, of the inequality `G` and of the moving bounds, one row each, at one time and
/// state.
pub(super) struct Rows {
    /// Derivatives of `F`, `G` and the moving bounds with respect to the unknowns `y`, one row each.
    pub by_y: DMatrix<f64>,
    /// Derivatives of the rows with respect to the directions, one column each.
    pub by_directions: DMatrix<f64>,
    /// The values of the variables and of `G`, on which the equations of blocks depend; `None` without blocks.
    pub point: Option<(Vec<f64>, Vec<f64>)>,
}

impl Tangents {
    /// Returns the derivatives of the rows of the problem at `(t, y)`.
    pub(super) fn rows_at(&mut self, t: f64, y: &[f64]) -> Rows {
        let structure = self.problem.structure();
        let (n, rows, unknowns) = (structure.states, structure.rows(), structure.unknowns());
        let (pattern, has_blocks) = (structure.pattern.clone(), structure.set.has_blocks());
        let mut values = vec![0.0; pattern.len()];
        self.problem.jacobian(t, y, &mut values);
        let mut by_y = DMatrix::zeros(rows, unknowns);
        pattern.iter().zip(values).for_each(|(&place, value)| by_y[place] = value);
        let mut by_directions = DMatrix::zeros(rows, self.count());
        (self.directions.rows)(t, y, &mut by_directions);
        let point = has_blocks.then(|| {
            let mut values = vec![0.0; rows];
            self.problem.evaluate(t, y, &mut values);
            (y[n..].to_vec(), values[n..unknowns].to_vec())
        });
        Rows { by_y, by_directions, point }
    }

    /// Returns the derivatives of the equation of each variable on a face with respect to `y`, and to the directions
    /// of `rows`. Time may be the last direction.
    ///
    /// # Errors
    /// If a variable is prescribed from outside.
    pub(super) fn equations(&self, face: &ActiveFace, rows: &Rows) -> Result<[DMatrix<f64>; 2], NoDerivative> {
        let structure = self.problem.structure();
        let (n, m, unknowns) = (structure.states, structure.variables, structure.unknowns());
        let mut by_y = DMatrix::zeros(m, unknowns);
        let mut by_directions = DMatrix::zeros(m, rows.by_directions.ncols());
        let mut add = |k: usize, row: usize, factor: f64| {
            let mut own = by_y.row_mut(k);
            own += rows.by_y.row(row) * factor;
            let mut own = by_directions.row_mut(k);
            own += rows.by_directions.row(row) * factor;
        };
        let mut given: Vec<(usize, Side)> = Vec::new();
        for (k, place) in face.places.iter().enumerate().filter(|&(k, _)| structure.set.block_of(k).is_none()) {
            match place {
                Activity::Inactive => add(k, n + k, 1.0),
                Activity::AtLower => given.push((k, Side::Lower)),
                Activity::AtUpper => given.push((k, Side::Upper)),
                Activity::Fixed | Activity::Boundary(_) | Activity::Vertex => return Err(NoDerivative::Block),
            }
        }
        let moving = |k: usize, side: Side| {
            let bounds = structure.moving.iter().enumerate();
            bounds.filter(move |(_, bound)| bound.variable == k && bound.side == side).map(move |(p, _)| unknowns + p)
        };
        given.iter().for_each(|&(k, side)| moving(k, side).for_each(|row| add(k, row, -1.0)));
        let blocks = self.equations_of_blocks(face, rows)?;
        for (members, equations) in &blocks {
            for (i, &k) in members.iter().enumerate() {
                let combined = members.iter().zip(equations.combination_of(i));
                combined.filter(|(_, factor)| **factor != 0.0).for_each(|(l, factor)| add(k, n + l, *factor));
                let radii = members.iter().flat_map(|&l| moving(l, Side::Radius));
                radii.for_each(|row| add(k, row, equations.by_radius[i]));
            }
        }
        given.iter().for_each(|&(k, _)| by_y[(k, n + k)] += 1.0);
        for (members, equations) in &blocks {
            for (i, &k) in members.iter().enumerate() {
                let own = equations.own[i * members.len()..][..members.len()].iter();
                members.iter().zip(own).for_each(|(l, value)| by_y[(k, n + l)] += value);
            }
        }
        for &(bound, direction, value) in &self.directions.bounds {
            if given.contains(&(bound.variable, bound.side)) {
                by_directions[(bound.variable, direction)] -= value;
            }
            let of_radius = blocks.iter().filter(|(members, _)| members.contains(&bound.variable));
            for (members, equations) in of_radius.filter(|_| bound.side == Side::Radius) {
                let factors = members.iter().zip(&equations.by_radius);
                factors.for_each(|(&k, factor)| by_directions[(k, direction)] += factor * value);
            }
        }
        Ok([by_y, by_directions])
    }

    /// Returns the equations of the active faces of the sets of all blocks, with their members.
    fn equations_of_blocks(
        &self,
        face: &ActiveFace,
        rows: &Rows,
    ) -> Result<Vec<(Vec<usize>, FaceEquations)>, NoDerivative> {
        let Some((z, g)) = &rows.point else { return Ok(Vec::new()) };
        let blocks = self.problem.structure().set.blocks().iter().zip(&face.blocks);
        let equations = blocks.map(|(block, of_block)| {
            if face.holds(&block.members) {
                return Err(NoDerivative::Block);
            }
            let of_members = |values: &[f64]| block.members.iter().map(|&k| values[k]).collect::<Vec<f64>>();
            let mut equations = FaceEquations::default();
            equations.set(&block.shape, of_block, &of_members(z), &of_members(g));
            Ok((block.members.clone(), equations))
        });
        equations.collect()
    }

    /// Returns the equations of a face, linearised at `(t, y)`: the mass matrix, with zeros for the variables, and
    /// the derivatives of the right-hand sides with respect to `y`.
    ///
    /// # Errors
    /// If a variable is prescribed from outside.
    pub fn linearised(&mut self, face: &ActiveFace, t: f64, y: &[f64]) -> Result<[DMatrix<f64>; 2], NoDerivative> {
        let (n, unknowns) = (self.mass.nrows(), y.len());
        let rows = self.rows_at(t, y);
        let mut mass = DMatrix::zeros(unknowns, unknowns);
        mass.view_mut((0, 0), (n, n)).copy_from(&self.mass);
        let mut by_y = rows.by_y.rows(0, unknowns).into_owned();
        let [of_variables, _] = self.equations(face, &rows)?;
        by_y.rows_mut(n, unknowns - n).copy_from(&of_variables);
        Ok([mass, by_y])
    }

    /// Returns the derivatives of the equations of a face at `(t, y)`: of `F`, then of the equation of each variable,
    /// with respect to `y` and to the directions.
    ///
    /// # Errors
    /// If a variable is prescribed from outside.
    pub fn derivatives(&mut self, face: &ActiveFace, t: f64, y: &[f64]) -> Result<[DMatrix<f64>; 2], NoDerivative> {
        let (n, unknowns) = (self.mass.nrows(), y.len());
        let rows = self.rows_at(t, y);
        let mut by_y = rows.by_y.rows(0, unknowns).into_owned();
        let mut by_directions = rows.by_directions.rows(0, unknowns).into_owned();
        let [of_variables, of_variables_by_directions] = self.equations(face, &rows)?;
        by_y.rows_mut(n, unknowns - n).copy_from(&of_variables);
        by_directions.rows_mut(n, unknowns - n).copy_from(&of_variables_by_directions);
        Ok([by_y, by_directions])
    }

    /// Solves for the derivatives of the states at the stages of a step with respect to the directions.
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

    /// Returns the equations of the derivatives at the stages of a step, on the active face of the step.
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
            let [of_variables, by_directions] = self.equations(&step.face, &rows)?;
            let (first, m) = (j * unknowns + n, unknowns - n);
            matrix.view_mut((first, j * unknowns), (m, unknowns)).copy_from(&of_variables);
            right.rows_mut(first, m).copy_from(&-by_directions);
        }
        Ok(StageEquations { matrix, by_directions: right })
    }
}

/// The equations `K dX = (M dx_n, .., M dx_n) + C` of the derivatives `dX` of the unknowns at the stages of a step.
pub(super) struct StageEquations {
    /// The matrix `K` of the equations for the derivatives at the stages.
    pub matrix: DMatrix<f64>,
    /// The part `C` of the right-hand sides, one column per direction.
    pub by_directions: DMatrix<f64>,
}
