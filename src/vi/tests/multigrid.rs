//! Tests of multigrid on grids of several dimensions, against prescribed solutions.

use super::super::{ActiveSet, Unsuitable};
use super::*;
use factorisation::SparseMatrix;
use faer::sparse::Triplet;

const SHAPES: [&[usize]; 2] = [&[160, 131], &[35, 31, 23]];

/// Returns the matrix `I - c Laplacian` on a grid, with zero differences across its sides.
fn matrix(shape: &[usize], c: f64) -> SparseMatrix {
    let nodes = shape.iter().product();
    let mut triplets: Vec<Triplet<usize, usize, f64>> = (0..nodes).map(|i| Triplet::new(i, i, 1.0)).collect();
    for (k, &length) in shape.iter().enumerate() {
        let stride: usize = shape[k + 1..].iter().product();
        for i in (0..nodes).filter(|i| i / stride % length + 1 < length) {
            let j = i + stride;
            triplets.extend([(i, i, c), (j, j, c), (i, j, -c), (j, i, -c)].map(|(i, j, c)| Triplet::new(i, j, c)));
        }
    }
    SparseMatrix::try_new_from_triplets(nodes, nodes, &triplets).expect("places inside the matrix")
}

/// Returns the distance of node `i` from the middle of the grid, relative to that of the sides.
fn radius(shape: &[usize], mut i: usize) -> f64 {
    let square = shape.iter().rev().map(|&length| {
        let at = i % length;
        i /= length;
        (2.0 * at as f64 / (length - 1) as f64 - 1.0).powi(2)
    });
    square.sum::<f64>().sqrt()
}

/// Returns a load `q` and the solution `z` of its obstacle problem: `z` is zero in a ball of contact, where the
/// pressure grows towards the centre.
fn problem(shape: &[usize], matrix: &SparseMatrix) -> (Vec<f64>, Vec<f64>) {
    let nodes = matrix.nrows();
    let z: Vec<f64> = (0..nodes).map(|i| (radius(shape, i) - 0.6).max(0.0).powi(2)).collect();
    let mut q: Vec<f64> = (0..nodes).map(|i| (0.6 - radius(shape, i)).max(0.0) * matrix[(i, i)]).collect();
    for entry in matrix.triplet_iter() {
        q[entry.row] -= entry.val * z[entry.col];
    }
    (q, z)
}

#[test]
fn an_answer_with_a_ball_of_contact_is_found_however_stiff_the_matrix() {
    for (shape, c) in SHAPES.into_iter().flat_map(|shape| [1e-3, 1.0, 1e4].map(|c| (shape, c))) {
        let matrix = matrix(shape, c);
        let (q, z) = problem(shape, &matrix);
        let mut solver = ActiveSet::on_grid(&matrix, shape, &Control::new()).expect("an M-matrix");
        let mut found = vec![1.0; z.len()];
        let report = solver.solve(&q, &ConvexSet::nonnegative(z.len()), &mut found, &Control::new());
        assert_eq!(report.outcome, Outcome::Solved, "{shape:?} {c}: {report:?}");
        let error = z.iter().zip(&found).fold(0.0_f64, |error, (z, found)| error.max((z - found).abs()));
        assert!(error < 1e-9, "{shape:?} {c}: off by {error:e}");
    }
}

#[test]
fn a_run_that_is_to_stop_is_not_solved() {
    let matrix = matrix(SHAPES[0], 1.0);
    let (q, z) = problem(SHAPES[0], &matrix);
    let mut solver = ActiveSet::on_grid(&matrix, SHAPES[0], &Control::new()).expect("an M-matrix");
    let control = Control::new();
    control.cancel();
    let report = solver.solve(&q, &ConvexSet::nonnegative(z.len()), &mut vec![1.0; z.len()], &control);
    assert_eq!(report.outcome, Outcome::Interrupted);
    assert!(!solver.solve_inside(&mut vec![1.0; z.len()], &control), "half an answer is none");
    assert_eq!(ActiveSet::on_grid(&matrix, SHAPES[0], &control).err(), Some(Unsuitable::Interrupted));
}
