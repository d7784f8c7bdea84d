//! Solution of symmetric positive definite systems whose right-hand sides are linear forms of a circuit.

use super::Fault;
use super::equations::MOST_TERMS;
use super::form::{Coefficient, Form};
use factorisation::{Cholesky, SparseMatrix};
use faer::sparse::Triplet;
use std::collections::BTreeSet;

/// Solves `A v = right` for the forms `v`, and `A v' = right' - A' v` for their directional derivatives `v'`. `A` is
/// given by its entries; duplicate entries are summed.
///
/// # Errors
/// If `A` is not numerically positive definite, or if the solution may have too many terms.
pub(super) fn solve(entries: &[(usize, usize, Coefficient)], mut right: Vec<Form>) -> Result<Vec<Form>, Fault> {
    let n = right.len();
    if entries.iter().all(|&(i, j, _)| i == j) {
        let mut diagonal = vec![Coefficient::default(); n];
        entries.iter().for_each(|&(i, _, value)| diagonal[i] = diagonal[i] + value);
        right.iter_mut().zip(diagonal).for_each(|(form, value)| form.divide(value));
        return Ok(right);
    }
    let triplets: Vec<_> = entries.iter().map(|&(i, j, value)| Triplet::new(i, j, value.value)).collect();
    let matrix = SparseMatrix::try_new_from_triplets(n, n, &triplets).map_err(|_| Fault::Singular)?;
    let mut factor = Cholesky::new(&matrix).ok_or(Fault::Singular)?;
    if !factor.factorise(&matrix) {
        return Err(Fault::Singular);
    }
    let columns: BTreeSet<usize> = right.iter().flat_map(|form| form.terms().map(|(k, _)| k)).collect();
    if n * columns.len() > MOST_TERMS {
        return Err(Fault::TooIntertwined(MOST_TERMS));
    }
    let mut solutions = vec![Form::default(); n];
    let mut column_values = vec![0.0; n];
    let mut slopes = vec![0.0; n];
    for column in columns {
        column_values.iter_mut().zip(&right).for_each(|(value, form)| *value = form.coefficient(column));
        if !factor.solve(&mut column_values) {
            return Err(Fault::Singular);
        }
        slopes.iter_mut().zip(&right).for_each(|(slope, form)| *slope = form.with_slope(column).slope);
        entries.iter().for_each(|&(i, j, entry)| slopes[i] -= entry.slope * column_values[j]);
        if slopes.iter().any(|slope| *slope != 0.0) && !factor.solve(&mut slopes) {
            return Err(Fault::Singular);
        }
        for ((form, &value), &slope) in solutions.iter_mut().zip(&column_values).zip(&slopes) {
            form.add_term(column, Coefficient { value, slope });
        }
    }
    Ok(solutions)
}
