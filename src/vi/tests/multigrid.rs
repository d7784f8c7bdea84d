//! Grids in space, whose rows inside are solved by multigrid: against answers that are put in.

use super::super::ActiveSet;
use super::*;
use crate::factorisation::SparseMatrix;
use faer::sparse::Triplet;

const SHAPE: [usize; 3] = [35, 31, 23];

/// `I - c Laplacian` on the grid, differences through its sides being zero.
fn matrix(c: f64) -> SparseMatrix {
    let nodes = SHAPE.iter().product();
    let mut triplets: Vec<Triplet<usize, usize, f64>> = (0..nodes).map(|i| Triplet::new(i, i, 1.0)).collect();
    for (k, stride) in [SHAPE[1] * SHAPE[2], SHAPE[2], 1].into_iter().enumerate() {
        for i in (0..nodes).filter(|i| i / stride % SHAPE[k] + 1 < SHAPE[k]) {
            let j = i + stride;
            triplets.extend([(i, i, c), (j, j, c), (i, j, -c), (j, i, -c)].map(|(i, j, c)| Triplet::new(i, j, c)));
        }
    }
    SparseMatrix::try_new_from_triplets(nodes, nodes, &triplets).expect("places inside the matrix")
}

/// The distance from the middle of the grid, in parts of the way to its sides.
fn radius(i: usize) -> f64 {
    let at = [i / (SHAPE[1] * SHAPE[2]), i / SHAPE[2] % SHAPE[1], i % SHAPE[2]];
    let square = at.iter().zip(SHAPE).map(|(&at, n)| (2.0 * at as f64 / (n - 1) as f64 - 1.0).powi(2));
    square.sum::<f64>().sqrt()
}

#[test]
fn an_answer_with_a_ball_of_contact_is_found_however_stiff_the_matrix() {
    let nodes: usize = SHAPE.iter().product();
    let z: Vec<f64> = (0..nodes).map(|i| (radius(i) - 0.6).max(0.0).powi(2)).collect();
    for c in [1e-3, 1.0, 1e4] {
        let matrix = matrix(c);
        let mut q: Vec<f64> = (0..nodes).map(|i| (0.6 - radius(i)).max(0.0) * matrix[(i, i)]).collect();
        for entry in matrix.triplet_iter() {
            q[entry.row] -= entry.val * z[entry.col];
        }
        let mut solver = ActiveSet::on_grid(&matrix, &SHAPE).expect("an M-matrix");
        let mut found = vec![1.0; nodes];
        let report = solver.solve(&q, &ConvexSet::nonnegative(nodes), &mut found, &Control::new());
        assert_eq!(report.outcome, Outcome::Solved, "{c}: {report:?}");
        let error = z.iter().zip(&found).fold(0.0_f64, |error, (z, found)| error.max((z - found).abs()));
        assert!(error < 1e-9, "{c}: off by {error:e}");
    }
}
