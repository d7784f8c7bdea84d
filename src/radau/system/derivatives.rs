//! The derivatives of a system: the nonzeros of the Jacobian of the problem, its rows and sums over them, and `dPhi/dy`
//! on a face of `K` in the storage layout of the matrices of the stage equations.

use super::System;
use crate::face::{ActiveFace, Activity};
use crate::layout::Layout;
use problem::{MovingBound, Side};

impl System<'_> {
    /// Evaluates the derivatives of the rows of the problem at `(t, y)`; returns false if a number is not finite. If a
    /// slope is infinite at `y`, as that of a square root at zero, the derivatives are evaluated at states that are
    /// shifted by their tolerances.
    pub fn differentiate(&mut self, t: f64, y: &[f64]) -> bool {
        if self.structure.constant_jacobian && self.work.jacobians > 0 {
            return true;
        }
        self.work.jacobians += 1;
        self.problem.jacobian(t, y, &mut self.derivatives);
        self.derivatives.iter().all(|value| value.is_finite()) || self.differentiate_beside(t, y)
    }

    /// Exchanges the derivatives of the last differentiation for those at `(t, y)`, until
    /// [`Self::restore_derivatives`]; returns false, and changes nothing, if derivatives are constant or not finite
    /// at `(t, y)`.
    pub fn exchange_derivatives(&mut self, t: f64, y: &[f64]) -> bool {
        if self.structure.constant_jacobian {
            return false;
        }
        self.exchanged.resize(self.derivatives.len(), 0.0);
        self.problem.jacobian(t, y, &mut self.exchanged);
        let are_finite = self.exchanged.iter().all(|value| value.is_finite());
        if are_finite {
            std::mem::swap(&mut self.derivatives, &mut self.exchanged);
        }
        are_finite
    }

    /// Restores the derivatives that [`Self::exchange_derivatives`] has set aside.
    pub fn restore_derivatives(&mut self) {
        std::mem::swap(&mut self.derivatives, &mut self.exchanged);
    }

    fn differentiate_beside(&mut self, t: f64, y: &[f64]) -> bool {
        [1.0, -1.0].into_iter().any(|side| {
            let mut beside = y.to_vec();
            beside.iter_mut().zip(&self.tolerances).for_each(|(y, tolerance)| *y += side * tolerance);
            self.problem.jacobian(t, &beside, &mut self.derivatives);
            self.derivatives.iter().all(|value| value.is_finite())
        })
    }

    /// Evaluates the partial derivatives of `G` with respect to time at `(t, y)` into `values`, of length `m`.
    pub fn time_derivative(&mut self, t: f64, y: &[f64], values: &mut [f64]) {
        self.problem.time_derivative(t, y, values);
    }

    /// Returns the nonzeros of the Jacobian as of the last differentiation, as `(row, column, value)`.
    pub fn entries(&self) -> impl Iterator<Item = (usize, usize, f64)> {
        self.structure.pattern.iter().zip(&self.derivatives).map(|(&(i, j), &value)| (i, j, value))
    }

    /// Returns the nonzeros of one row of the Jacobian as of the last differentiation, as `(column, value)`.
    pub fn entries_of_row(&self, row: usize) -> impl Iterator<Item = (usize, f64)> {
        let (first, last) = (self.row_starts[row], self.row_starts[row + 1]);
        let pattern = &self.structure.pattern[first..last];
        pattern.iter().zip(&self.derivatives[first..last]).map(|(&(_, j), &value)| (j, value))
    }

    /// Returns the nonzeros of one row of the Jacobian, as `(index among all nonzeros, column)`.
    pub fn places_of_row(&self, row: usize) -> impl Iterator<Item = (usize, usize)> {
        let (first, last) = (self.row_starts[row], self.row_starts[row + 1]);
        (first..last).zip(&self.structure.pattern[first..last]).map(|(at, &(_, j))| (at, j))
    }

    /// Returns the index, among all nonzeros of the Jacobian, of the derivative of `G_k` with respect to variable `k`
    /// itself.
    pub fn place_of_own(&self, k: usize) -> Option<usize> {
        let own = self.states + k;
        self.places_of_row(own).find(|&(_, j)| j == own).map(|(at, _)| at)
    }

    /// Returns the number of moving bounds of the problem.
    pub fn bounds(&self) -> usize {
        self.structure.moving.len()
    }

    /// Returns the index of the variable that moving bound `p` limits.
    pub fn variable_of_bound(&self, p: usize) -> usize {
        self.structure.moving[p].variable
    }

    /// Returns the equations of the active face of `K` in which moving bound `p` occurs, as pairs of an equation and
    /// the factor of the bound.
    pub fn equations_of_bound(&self, p: usize) -> Vec<(usize, f64)> {
        let MovingBound { variable, side, .. } = self.structure.moving[p];
        let place = self.face.places[variable];
        match (self.set.block_of(variable), side) {
            (Some(b), _) if !self.face.holds(&self.set.blocks()[b].members) => {
                let rows = self.set.blocks()[b].members.iter().zip(&self.linearised[b].by_radius);
                rows.filter(|(_, factor)| **factor != 0.0).map(|(k, factor)| (self.states + k, *factor)).collect()
            }
            (None, Side::Lower) if place == Activity::AtLower => vec![(self.states + variable, 1.0)],
            (None, Side::Upper) if place == Activity::AtUpper => vec![(self.states + variable, 1.0)],
            _ => Vec::new(),
        }
    }

    /// Returns the nonzeros of `dG_k/dy` as of the last differentiation, as `(column, value)`.
    pub fn entries_of_variable(&self, k: usize) -> impl Iterator<Item = (usize, f64)> {
        self.entries_of_row(self.states + k)
    }

    /// Whether `G_k` depends on variables, by the derivatives as of the last differentiation.
    pub fn has_variables(&self, k: usize) -> bool {
        self.entries_of_variable(k).any(|(j, value)| j >= self.states && value != 0.0)
    }

    /// Returns the directional derivative `dG_k/dy . direction` of `G_k`.
    pub fn slope(&self, k: usize, direction: impl Fn(usize) -> f64) -> f64 {
        self.entries_of_variable(k).map(|(j, value)| value * direction(j)).sum()
    }

    /// Returns `sum_j |dG_k/dy_j| size_j` for several sizes of the unknowns: the magnitude of the terms of `G_k`,
    /// relative to which its rounding errors are measured.
    pub fn terms<const N: usize>(&self, k: usize, sizes: impl Fn(usize) -> [f64; N]) -> [f64; N] {
        self.terms_of_row(self.states + k, sizes)
    }

    /// Returns `sum_j |dr/dy_j| size_j` for several sizes of the unknowns, where `r` is a row of `F`, `G` or the moving
    /// bounds.
    pub fn terms_of_row<const N: usize>(&self, row: usize, sizes: impl Fn(usize) -> [f64; N]) -> [f64; N] {
        self.terms_by(row, |at| self.derivatives[at].abs(), sizes)
    }

    /// Returns the sums of [`Self::terms_of_row`], where `slope` returns the magnitude of the derivative at an index
    /// among all nonzeros of the Jacobian.
    pub fn terms_by<const N: usize>(
        &self,
        row: usize,
        slope: impl Fn(usize) -> f64,
        sizes: impl Fn(usize) -> [f64; N],
    ) -> [f64; N] {
        let mut sums = [0.0; N];
        for (at, j) in self.places_of_row(row) {
            let slope = slope(at);
            for (sum, size) in sums.iter_mut().zip(sizes(j)) {
                *sum += slope * size;
            }
        }
        sums
    }

    /// Returns the indices of the rows of the moving bounds of variable `k`.
    pub fn rows_of_bounds(&self, k: usize) -> impl Iterator<Item = usize> {
        let moving = self.structure.moving.iter().enumerate().filter(move |(_, moving)| moving.variable == k);
        moving.map(|(p, _)| self.unknowns + p)
    }

    /// Returns `sum_j |dl_k/dy_j| size_j` of a moving lower bound `l_k` of variable `k`, plus the corresponding sum
    /// of its moving upper bound.
    pub fn terms_of_bounds(&self, k: usize, size: impl Fn(usize) -> f64) -> f64 {
        self.rows_of_bounds(k).map(|row| self.terms_of_row(row, |j| [size(j)])[0]).sum()
    }

    /// Writes `-dPhi/dy`, the negative Jacobian of the equations of the face `face` of `K`, in the storage layout, from
    /// the current derivatives.
    pub fn negative_jacobian(&self, face: &ActiveFace, places: &mut [f64]) {
        places.fill(0.0);
        if self.unknowns == self.states {
            let entries = self.layout.jacobian.iter().zip(&self.derivatives);
            return entries.for_each(|(&place, value)| places[place] -= value);
        }
        self.visit_derivatives(face, |_, _, place, value| places[place] -= value);
    }

    /// Visits the terms of `dPhi/dy`, the Jacobian of the equations of the face `face` of `K`, from the current
    /// derivatives, as `(row, column, place, value)`, where `place` is the storage index.
    pub fn visit_derivatives(&self, face: &ActiveFace, mut visit: impl FnMut(usize, usize, usize, f64)) {
        let n = self.states;
        let structure = &self.structure;
        let Layout { jacobian, spread, own, diagonal, .. } = &*self.layout;
        for (at, (&(i, j), &value)) in structure.pattern.iter().zip(&self.derivatives).enumerate() {
            let (variable, side) = match i.checked_sub(self.unknowns) {
                _ if i < n => (None, None),
                None => (Some(i - n), None),
                Some(p) => (Some(structure.moving[p].variable), Some(structure.moving[p].side)),
            };
            let block = variable.and_then(|k| Some((self.set.block_of(k)?, k)));
            if let Some((b, k)) = block {
                let (members, equations) = (&self.set.blocks()[b].members, &self.linearised[b]);
                if face.holds(members) {
                    continue;
                }
                let column = members.iter().position(|member| *member == k).unwrap_or(0);
                for (row, (member, &place)) in members.iter().zip(&spread[at]).enumerate() {
                    let factor = match side {
                        Some(_) => equations.by_radius[row],
                        None => equations.combination_of(row)[column],
                    };
                    if factor != 0.0 {
                        visit(n + member, j, place, factor * value);
                    }
                }
                continue;
            }
            let is_on_face = match (variable, side) {
                (None, _) => true,
                (Some(k), None) => face.places[k] == Activity::Inactive,
                (Some(k), Some(Side::Lower)) => face.places[k] == Activity::AtLower,
                (Some(k), Some(Side::Upper)) => face.places[k] == Activity::AtUpper,
                (Some(_), Some(Side::Radius)) => false,
            };
            if is_on_face {
                visit(variable.map_or(i, |k| n + k), j, jacobian[at], value);
            }
        }
        for (&k, &place) in self.bounded.iter().zip(diagonal) {
            let is_given = match self.set.block_of(k) {
                Some(_) => face.places[k] == Activity::Fixed,
                None => face.places[k] != Activity::Inactive,
            };
            if is_given {
                visit(n + k, n + k, place, -1.0);
            }
        }
        for ((block, equations), places) in self.set.blocks().iter().zip(&self.linearised).zip(own) {
            if face.holds(&block.members) {
                continue;
            }
            let pairs = block.members.iter().flat_map(|k| block.members.iter().map(move |l| (k, l)));
            for (((k, l), &place), &value) in pairs.zip(places).zip(&equations.own) {
                if value != 0.0 {
                    visit(n + k, n + l, place, value);
                }
            }
        }
    }
}
