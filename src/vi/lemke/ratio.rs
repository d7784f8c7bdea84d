//! The ratio test of complementary pivoting over intervals: the distance that the entering variable moves before a
//! basic variable reaches a bound of its interval, or the entering variable its own opposite bound.
//!
//! Ties are broken as if the basic variable of row `j` at the start had been moved into its interval by `epsilon^j`,
//! for every small `epsilon > 0`. The perturbation makes each basis nondegenerate, so that no basis recurs (Cottle,
//! Pang and Stone 1992, section 4.9). The perturbed value of a basic variable is linear in the perturbations: the
//! coefficient of `epsilon^j` is in the column of the variable that was basic in row `j`.

use super::tableau::{Tableau, Variable};
use std::cmp::Ordering;

/// Entries of the tableau below this fraction of the largest in their column are rounding: rows with such entries do
/// not block the entering variable.
const SMALLEST_RATE: f64 = 1e-11;

/// Lengths of the entering variable's motion up to two blocking rows are a tie if they differ by less than this
/// fraction.
const TIE: f64 = 1e-12;

/// Noise level of differences of perturbation coefficients, whose size is one in an equilibrated tableau.
const COEFFICIENT_NOISE: f64 = 1e-11;

/// A value below this fraction of the terms of its sum is zero.
pub(super) const NOISE: f64 = 1e-13;

/// The event that ends the motion of the entering variable.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Block {
    /// Nothing blocks the motion of the entering variable: the path ends on a ray.
    None,
    /// The entering variable reaches its own opposite bound.
    Own,
    /// The basic variable of this row reaches a bound.
    Row(usize),
}

/// The perturbations of the ratio test: for each row, the variable that was basic at the start and the direction into
/// its interval.
#[derive(Debug)]
pub(super) struct Perturbation {
    pub variable: Vec<Variable>,
    pub sense: Vec<f64>,
}

/// The motion of the variable that enters the basis.
#[derive(Clone, Copy, Debug)]
pub(super) struct Motion {
    /// The column of the tableau that belongs to the entering variable.
    pub column: usize,
    /// `+1` if the entering variable rises, `-1` if it falls.
    pub sense: f64,
    /// The length of the entering variable's own interval.
    pub range: f64,
}

/// Finds the first event that blocks the motion of the entering variable, and the length of the motion up to that
/// event.
pub(super) fn first_block(tableau: &Tableau, motion: Motion, perturbation: &Perturbation) -> (Block, f64) {
    let column = tableau.column(motion.column);
    let largest = column.iter().fold(0.0_f64, |largest, t| largest.max(t.abs()));
    let theta = tableau.row_of(2 * tableau.m);
    let (mut block, mut shortest) = (Block::None, f64::INFINITY);
    if motion.range < f64::INFINITY {
        (block, shortest) = (Block::Own, motion.range);
    }
    for (row, &t) in column.iter().enumerate() {
        let rate = motion.sense * t;
        if rate.abs() <= SMALLEST_RATE * largest {
            continue;
        }
        let value = tableau.value[row];
        let distance = if rate < 0.0 { value - tableau.lower[row] } else { tableau.upper[row] - value };
        let length = if distance <= NOISE * tableau.magnitude[row] { 0.0 } else { distance / rate.abs() };
        if length == f64::INFINITY || length > shortest + TIE * shortest {
            continue;
        }
        let first = length + TIE * length < shortest
            || theta == Some(row)
            || (theta.map(Block::Row) != Some(block)
                && compare(tableau, motion, perturbation, row, block) == Ordering::Less);
        if first {
            (block, shortest) = (Block::Row(row), length);
        }
    }
    (block, shortest)
}

/// Compares the perturbed lengths of the motion up to two blocking rows whose unperturbed lengths tie.
fn compare(tableau: &Tableau, motion: Motion, perturbation: &Perturbation, row: usize, other: Block) -> Ordering {
    let length = |row: usize, j: usize| {
        let variable = perturbation.variable[j];
        let coefficient = match tableau.column_of(variable) {
            Some(column) => -tableau.entry(row, column),
            None if tableau.basic[row] == variable => 1.0,
            None => 0.0,
        };
        -coefficient * perturbation.sense[j] / (motion.sense * tableau.entry(row, motion.column))
    };
    for j in 0..tableau.m {
        let a = length(row, j);
        let b = if let Block::Row(other) = other { length(other, j) } else { 0.0 };
        if (a - b).abs() > COEFFICIENT_NOISE * a.abs().max(b.abs()).max(1.0) {
            return a.total_cmp(&b);
        }
    }
    Ordering::Equal
}
