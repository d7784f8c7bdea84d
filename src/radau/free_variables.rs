//! The free variables, those inside their intervals, at times between the stages: the polynomial through their stage
//! values need not satisfy their equations `G_I = 0`. To first order the correction is
//!
//! ```text
//! dz_I    with    (dG_I / dz_I) dz_I = -G_I.
//! ```

use super::screening::contraction::Enclosed;
use super::system::System;
use factorisation::DenseLu;
use nalgebra::DVector;
use numerics::Interval;

/// Maximum number of coupled free variables that are solved for between the stages; with more, the values of the
/// polynomial through the stages are used. The solve is repeated several times per step, and up to this size costs no
/// more than evaluations of as many equations.
const MOST: usize = 64;

/// Bound on the condition number of the matrix of the equations of free variables (those not on a bound); with a larger
/// one, the matrix counts as singular.
const MOST_CONDITION: f64 = 1e10;

/// The equations of the free variables (those not on a bound) on one active face of `K`, with one Jacobian.
pub(super) struct FreeVariables {
    jacobians: u64,
    inside: Vec<usize>,
    /// The free variables whose equations contain free variables, and no variable on the boundary of a block.
    variables: Vec<usize>,
    equations: Equations,
    /// Inverse of the matrix of the equations of the free variables, column by column, if the equations are coupled.
    inverse: Vec<f64>,
    change: Vec<f64>,
    /// Workspace for the correction of every variable; zero between uses.
    changes: Vec<f64>,
}

enum Equations {
    /// The equations do not determine the free variables, or are too many to be solved.
    None,
    /// Decoupled equations: each contains one free variable, with this factor.
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

    /// Corrects the free variables in `y`, the point of the last evaluation of `system`, and updates all of `G` to
    /// first order. Returns false if `G` does not determine every free variable (index 2: `G_z = 0`).
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

    /// Whether the equations `G_I = 0` determine all free variables, including those of blocks.
    pub(super) fn tells_all(&mut self, system: &System<'_>) -> bool {
        self.follow(system);
        let are_told = !matches!(self.equations, Equations::None) && self.variables.len() == self.inside.len();
        (self.inside.is_empty() || are_told) && !system.is_on_edge()
    }

    /// Bounds the distance of each free variable from the root of its equations, for residuals of magnitude
    /// `residuals`: `|dG_I/dz_I|^-1 |G_I|`, and zero for variables that the equations do not determine.
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

    /// Bounds the distance of each free variable from the root of its equations, as [`Self::errors`] does, for
    /// derivatives that vary within the enclosures `jacobian`, in the order of the pattern. Returns whether the
    /// derivatives vary too much for a bound.
    pub(super) fn errors_over(
        &mut self,
        system: &System<'_>,
        jacobian: &[Interval],
        residuals: &[f64],
        out: &mut Vec<f64>,
    ) -> bool {
        self.follow(system);
        out.clear();
        out.resize(self.changes.len(), 0.0);
        if matches!(self.equations, Equations::None) {
            return false;
        }
        let (n, count) = (system.states, self.variables.len());
        let mut matrix = Enclosed::zeros(count, count);
        for (row, &k) in self.variables.iter().enumerate() {
            for (at, j) in system.places_of_row(n + k).filter(|(_, j)| *j >= n) {
                if let Ok(column) = self.variables.binary_search(&(j - n)) {
                    matrix.add((row, column), jacobian[at]);
                }
            }
        }
        let residuals = DVector::from_iterator(count, self.variables.iter().map(|&k| residuals[k]));
        matrix.errors(&residuals).write(&self.variables, out)
    }

    /// Writes the combination of the equations of the free variables whose gradient with respect to the variables is
    /// `gradient` to `out`, as pairs of an equation and its weight: `w dG_I/dz_I = gradient`. A function with this
    /// gradient, minus the combination, does not depend on the variables that the equations determine.
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

    /// Updates the equations of the free variables to the active face of `system` and its last Jacobian.
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

/// Writes the inverse of a matrix with the LU factors `factors` to `inverse`, both column by column; returns false if
/// the matrix is singular up to rounding. The criterion is the diagonal of `|A^-1| |A|`, which does not depend on the
/// units of rows and columns.
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
