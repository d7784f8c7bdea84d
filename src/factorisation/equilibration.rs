//! Scaling of small dense matrices whose rows and columns have different units, before their ranks are determined.

use nalgebra::DMatrix;

/// Returns the matrix with rows and columns scaled to entries of at most one, and the scales of rows and of columns.
pub fn equilibrated(mut matrix: DMatrix<f64>) -> (DMatrix<f64>, Vec<f64>, Vec<f64>) {
    let of_rows: Vec<f64> = matrix.row_iter().map(|row| scale_of(row.amax())).collect();
    matrix.row_iter_mut().zip(&of_rows).for_each(|(mut row, scale)| row.scale_mut(*scale));
    let of_columns: Vec<f64> = matrix.column_iter().map(|column| scale_of(column.amax())).collect();
    matrix.column_iter_mut().zip(&of_columns).for_each(|(mut column, scale)| column.scale_mut(*scale));
    (matrix, of_rows, of_columns)
}

/// Returns the factor that scales a size to one; returns one for the size zero.
pub fn scale_of(size: f64) -> f64 {
    if size > 0.0 { 1.0 / size } else { 1.0 }
}
