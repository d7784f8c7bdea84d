//! Symmetric positive definite systems whose right sides are forms.

use super::Fault;
use super::equations::MOST_TERMS;
use super::form::Form;
use factorisation::{Cholesky, SparseMatrix};
use faer::sparse::Triplet;
use std::collections::BTreeSet;

/// Solves `A v = right` for the forms `v`, with `A` by its entries, of which equal places add.
///
/// # Errors
/// If `A` is not positive definite to rounding, or the solution may have too many terms.
pub(super) fn solve(entries: &[(usize, usize, f64)], mut right: Vec<Form>) -> Result<Vec<Form>, Fault> {
    let n = right.len();
    if entries.iter().all(|&(i, j, _)| i == j) {
        let mut diagonal = vec![0.0; n];
        entries.iter().for_each(|&(i, _, value)| diagonal[i] += value);
        right.iter_mut().zip(diagonal).for_each(|(form, value)| form.divide(value));
        return Ok(right);
    }
    let triplets: Vec<_> = entries.iter().map(|&(i, j, value)| Triplet::new(i, j, value)).collect();
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
    for column in columns {
        column_values.iter_mut().zip(&right).for_each(|(value, form)| *value = form.coefficient(column));
        if !factor.solve(&mut column_values) {
            return Err(Fault::Singular);
        }
        solutions.iter_mut().zip(&column_values).for_each(|(form, &value)| form.add_term(column, value));
    }
    Ok(solutions)
}
