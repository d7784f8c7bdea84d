//! Independent switches at one time. If no state that the variables of one switch drive enters the monitors of the
//! others, the order of the switches does not matter, and each changes the derivatives at its own time,
//!
//! ```text
//! dx+ = dx- + sum_c j_c dtau_c,    j_c = M^-1 F_z (z_c- - z_c+)
//! ```
//!
//! for the variables `z_c` that equations of variables couple, if these jumps add up to the whole jump of the rates,
//! and do not change the monitors of the other switches.

use super::monitors::AGREE;
use super::stages::Rows;
use super::{Saltation, Tangents};
use nalgebra::DMatrix;

/// The derivatives of the times at which the monitors (event functions) of variables vanish, as pairs of a variable and
/// one derivative per direction.
pub(super) type TimesOfVariables = Vec<(usize, Vec<f64>)>;

/// A jump of the rates at a switch or at several simultaneous ones.
#[derive(Clone, Copy)]
pub(super) struct Jump<'a> {
    /// The unknowns before and after the jump of the rates.
    pub ends: [&'a [f64]; 2],
    /// The rates before the jump minus those after it.
    pub by: &'a [f64],
    /// The magnitude below which the jump of the rate of each state counts as zero.
    pub none: &'a [f64],
}

/// Whether the derivatives of the times of two simultaneous switches agree, so that both times belong to one switch.
pub(super) fn agree(a: &[f64], b: &[f64]) -> bool {
    a.iter().zip(b).all(|(a, b)| (a - b).abs() <= AGREE * a.abs().max(b.abs()))
}

impl Tangents {
    /// Returns the changes of the derivatives by several simultaneous switches, with the derivatives `times` of the
    /// times at which their monitors vanish; `None` if the switches depend on each other.
    pub(super) fn independent(
        &mut self,
        t: f64,
        rows: &Rows,
        times: &TimesOfVariables,
        jump: Jump<'_>,
    ) -> Option<Vec<Saltation>> {
        let (n, m) = (self.mass.nrows(), jump.ends[0].len() - self.mass.nrows());
        let [before, after] = jump.ends;
        // The part of the jump of the rates that the jump of the variables alone causes.
        let beside = [&before[..n], &after[n..]].concat();
        let [(left, _), (right, _)] = [before, &beside].map(|y| self.rates(t, y));
        let coupled = self.coupled(rows, m);
        let mut saltations: Vec<(usize, Saltation)> = Vec::new();
        for (k, times) in times {
            let island = coupled[*k];
            if let Some((_, own)) = saltations.iter().find(|(other, _)| *other == island) {
                if !self.is_basis && !agree(&own.times, times) {
                    return None;
                }
                continue;
            }
            let mut pushed = DMatrix::zeros(n, 1);
            for l in (0..m).filter(|&l| coupled[l] == island) {
                pushed += rows.by_y.view((0, n + l), (n, 1)) * (before[n + l] - after[n + l]);
            }
            let pushed = self.inverse_mass.solve(&pushed)?;
            saltations.push((island, Saltation { jump: pushed.as_slice().to_vec(), times: times.clone() }));
        }
        let is_whole = (0..n).all(|i| {
            let sum: f64 = saltations.iter().map(|(_, own)| own.jump[i]).sum();
            (sum - (left[i] - right[i])).abs() <= jump.none[i]
        });
        let meets = |island: usize, other: &Saltation| {
            let mut own = self.rows_of_variables().filter(|(_, k)| coupled[*k] == island);
            let moved = |i: &usize| other.jump[*i].abs() > jump.none[*i];
            own.any(|(row, _)| (0..n).filter(moved).any(|i| rows.by_y[(row, i)] != 0.0))
        };
        let are_apart = saltations.iter().all(|(island, _)| {
            saltations.iter().filter(|(other, _)| other != island).all(|(_, other)| !meets(*island, other))
        });
        (is_whole && are_apart).then(|| saltations.into_iter().map(|(_, own)| own).collect())
    }

    /// Returns, for each variable, a number that it shares with all variables coupled with it: by an equation of
    /// variables (a row of `G` or a moving bound) or by a block. The number is the least index among these variables.
    fn coupled(&self, rows: &Rows, m: usize) -> Vec<usize> {
        let structure = self.problem.structure();
        let n = self.mass.nrows();
        let mut coupled: Vec<usize> = (0..m).collect();
        let mut join = |a: usize, b: usize| {
            let (a, b) = (coupled[a], coupled[b]);
            coupled.iter_mut().filter(|island| **island == a.max(b)).for_each(|island| *island = a.min(b));
        };
        for block in structure.set.blocks() {
            block.members.iter().for_each(|&k| join(block.members[0], k));
        }
        for (row, k) in self.rows_of_variables() {
            (0..m).filter(|l| rows.by_y[(row, n + l)] != 0.0).for_each(|l| join(k, l));
        }
        coupled
    }

    /// Returns the rows of `G` and of the moving bounds, each with its variable.
    fn rows_of_variables(&self) -> impl Iterator<Item = (usize, usize)> {
        let structure = self.problem.structure();
        let (n, unknowns) = (structure.states, structure.unknowns());
        let of_bounds = structure.moving.iter().enumerate().map(move |(p, bound)| (unknowns + p, bound.variable));
        (0..structure.variables).map(move |k| (n + k, k)).chain(of_bounds)
    }
}
