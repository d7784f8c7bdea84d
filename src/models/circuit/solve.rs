//! Symmetric positive definite systems whose right sides are forms.

use super::form::Form;
use crate::factorisation::{Cholesky, SparseMatrix};
use faer::sparse::Triplet;
use std::collections::BTreeSet;

/// Solves `A v = right` for the forms `v`, with `A` by its entries, of which equal places add. `None` if it is not
/// positive definite to rounding.
pub(super) fn solve(entries: &[(usize, usize, f64)], mut right: Vec<Form>) -> Option<Vec<Form>> {
    let n = right.len();
    if entries.iter().all(|&(i, j, _)| i == j) {
        let mut diagonal = vec![0.0; n];
        entries.iter().for_each(|&(i, _, value)| diagonal[i] += value);
        right.iter_mut().zip(diagonal).for_each(|(form, value)| form.divide(value));
        return Some(right);
    }
    let triplets: Vec<_> = entries.iter().map(|&(i, j, value)| Triplet::new(i, j, value)).collect();
    let matrix = SparseMatrix::try_new_from_triplets(n, n, &triplets).ok()?;
    let mut factor = Cholesky::new(&matrix)?;
    if !factor.factorise(&matrix) {
        return None;
    }
    let columns: BTreeSet<usize> = right.iter().flat_map(|form| form.terms().map(|(k, _)| k)).collect();
    let mut solutions = vec![Form::default(); n];
    let mut column_values = vec![0.0; n];
    for column in columns {
        column_values.iter_mut().zip(&right).for_each(|(value, form)| *value = form.coefficient(column));
        if !factor.solve(&mut column_values) {
            return None;
        }
        solutions.iter_mut().zip(&column_values).for_each(|(form, &value)| form.add_term(column, value));
    }
    Some(solutions)
}
