//! The variables inside their intervals between the stages, where the polynomial through their values need not be what
//! the states make of them. To first order they are off by
//!
//! ```text
//! dz_I    with    (dG_I / dz_I) dz_I = -G_I.
//! ```

use super::system::System;
use factorisation::DenseLu;

/// Up to so many variables that enter each other's equations are solved for; of more the polynomial is taken. It is done
/// several times a step, and up to here costs no more than evaluations of as many equations do.
const MOST: usize = 64;

/// A matrix with a larger condition is singular but for rounding.
const MOST_CONDITION: f64 = 1e10;

/// Their equations on one face, with one Jacobian.
pub(super) struct FreeVariables {
    jacobians: u64,
    inside: Vec<usize>,
    /// Those of them whose equations have variables inside, and none on the boundary of a block.
    variables: Vec<usize>,
    equations: Equations,
    /// The inverse of their matrix, column by column, where they enter each other's equations.
    inverse: Vec<f64>,
    change: Vec<f64>,
    /// The change of every variable.
    changes: Vec<f64>,
}

enum Equations {
    /// They do not tell the variables, or are too many.
    None,
    /// Each has one variable, and this factor of it.
    Apart(Vec<f64>),
    Together(DenseLu<f64>),
}

impl FreeVariables {
    pub(super) fn new(system: &System<'_>) -> Self {
        Self {
            jacobians: 0,
            inside: Vec::new(),
            variables: Vec::new(),
            equations: Equations::None,
            inverse: Vec::new(),
            change: Vec::new(),
            changes: vec![0.0; system.unknowns - system.states],
        }
    }

    /// Corrects the variables inside in `y`, where `system` was evaluated last, and all of `G` with them; whether that
    /// tells all of them. It does not where only the derivative of `G` has variables.
    pub(super) fn correct(&mut self, system: &mut System<'_>, y: &mut [f64]) -> bool {
        self.follow(system);
        let n = system.states;
        self.change.clear();
        self.change.extend(self.variables.iter().map(|k| -system.values[n + k]));
        let is_told = match &mut self.equations {
            Equations::None => false,
            Equations::Apart(factors) => {
                self.change.iter_mut().zip(factors).for_each(|(change, factor)| *change /= *factor);
                true
            }
            Equations::Together(factors) => factors.solve(&mut self.change),
        };
        if !is_told {
            return self.inside.is_empty() && !system.is_on_edge();
        }
        for (&k, change) in self.variables.iter().zip(&self.change) {
            self.changes[k] = *change;
            y[n + k] += change;
        }
        for k in 0..self.changes.len() {
            let change = system.slope(k, |j| j.checked_sub(n).map_or(0.0, |k| self.changes[k]));
            system.add_to_inequality(k, change);
        }
        self.variables.iter().for_each(|&k| self.changes[k] = 0.0);
        self.variables.len() == self.inside.len() && !system.is_on_edge()
    }

    /// Whether the equations tell all variables inside, and those of blocks.
    pub(super) fn tells_all(&mut self, system: &System<'_>) -> bool {
        self.follow(system);
        let are_told = !matches!(self.equations, Equations::None) && self.variables.len() == self.inside.len();
        (self.inside.is_empty() || are_told) && !system.is_on_edge()
    }

    /// How far each variable may be from the root of its equations where these are as large as `residuals`:
    /// `|dG_I/dz_I|^-1 |G_I|`, and zero of those that the equations do not tell.
    pub(super) fn errors(&mut self, system: &System<'_>, residuals: &[f64], out: &mut Vec<f64>) {
        self.follow(system);
        out.clear();
        out.resize(self.changes.len(), 0.0);
        match &mut self.equations {
            Equations::None => {}
            Equations::Apart(factors) => {
                let told = self.variables.iter().zip(factors);
                told.for_each(|(&k, factor)| out[k] = residuals[k] / factor.abs());
            }
            Equations::Together(_) => {
                for (column, &l) in self.inverse.chunks_exact(self.variables.len()).zip(&self.variables) {
                    let residual = residuals[l];
                    let told = self.variables.iter().zip(column);
                    told.filter(|(_, entry)| **entry != 0.0).for_each(|(&k, entry)| out[k] += entry.abs() * residual);
                }
            }
        }
    }

    /// The combination of the equations that answers to a change of the variables as `gradient` does, as pairs of an equation
    /// and its weight: `w dG_I/dz_I = gradient`. What is left of a function with this gradient without it does not depend on
    /// the variables that the equations tell.
    pub(super) fn weights(
        &mut self,
        system: &System<'_>,
        gradient: impl Fn(usize) -> f64,
        out: &mut Vec<(usize, f64)>,
    ) {
        self.follow(system);
        out.clear();
        match &self.equations {
            Equations::None => {}
            Equations::Apart(factors) => {
                let told = self.variables.iter().zip(factors);
                out.extend(told.map(|(&k, factor)| (k, gradient(k) / factor)));
            }
            Equations::Together(_) => {
                let columns = self.inverse.chunks_exact(self.variables.len()).zip(&self.variables);
                out.extend(columns.map(|(column, &l)| {
                    let told = self.variables.iter().zip(column);
                    (l, told.map(|(&k, entry)| gradient(k) * entry).sum())
                }));
            }
        }
        out.retain(|(_, weight)| *weight != 0.0);
    }

    /// Takes the equations of the face of `system`, with its last Jacobian.
    fn follow(&mut self, system: &System<'_>) {
        let inside = (0..self.changes.len()).filter(|&k| system.is_inside(k));
        if self.jacobians != system.work.jacobians || !inside.clone().eq(self.inside.iter().copied()) {
            self.jacobians = system.work.jacobians;
            self.inside.clear();
            self.inside.extend(inside);
            self.inverse.clear();
            self.set_equations(system);
        }
    }

    fn set_equations(&mut self, system: &System<'_>) {
        let n = system.states;
        let of_variables = |k: usize| {
            let entries = system.entries_of_variable(k).filter(|&(j, value)| j >= n && value != 0.0);
            entries.map(|(j, value)| (j - n, value))
        };
        self.variables.clear();
        self.variables.extend(self.inside.iter().filter(|&&k| {
            let is_told = of_variables(k).any(|(l, _)| self.inside.binary_search(&l).is_ok());
            is_told && of_variables(k).all(|(l, _)| system.set.block_of(l).is_none() || system.is_inside(l))
        }));
        let variables = &self.variables;
        let entries =
            |k: usize| of_variables(k).filter_map(|(l, value)| Some((variables.binary_search(&l).ok()?, value)));
        let are_apart = variables.iter().enumerate().all(|(row, &k)| entries(k).all(|(column, _)| column == row));
        self.equations = if are_apart {
            let factor = |&k: &usize| entries(k).next().map(|(_, value)| value);
            variables.iter().map(factor).collect::<Option<_>>().map_or(Equations::None, Equations::Apart)
        } else if variables.len() <= MOST {
            let count = variables.len();
            let mut matrix = vec![0.0; count * count];
            for (row, &k) in variables.iter().enumerate() {
                entries(k).for_each(|(column, value)| matrix[column * count + row] = value);
            }
            let mut factors = DenseLu::new(count);
            factors.entries().copy_from_slice(&matrix);
            factors.factorise();
            if invert(&mut factors, &matrix, &mut self.inverse) {
                Equations::Together(factors)
            } else {
                Equations::None
            }
        } else {
            Equations::None
        };
    }
}

/// Writes the inverse of a matrix with these factors to `inverse`, both column by column; false where the matrix is singular
/// but for rounding. The diagonal of `|A^-1| |A|` tells, whose size no unit of a row or a column changes.
fn invert(factors: &mut DenseLu<f64>, matrix: &[f64], inverse: &mut Vec<f64>) -> bool {
    let count = matrix.len().isqrt();
    inverse.clear();
    inverse.resize(matrix.len(), 0.0);
    let mut conditions = vec![0.0; count];
    for (l, column) in inverse.chunks_exact_mut(count).enumerate() {
        column[l] = 1.0;
        if !factors.solve(column) {
            return false;
        }
        let products = column.iter().enumerate().map(|(k, entry)| (entry * matrix[k * count + l]).abs());
        conditions.iter_mut().zip(products).for_each(|(condition, product)| *condition += product);
    }
    conditions.iter().all(|condition| *condition < MOST_CONDITION)
}
