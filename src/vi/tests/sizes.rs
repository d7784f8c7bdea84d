//! Degenerate and unsolvable problems, from one variable to hundreds.

use super::super::Auto;
use super::*;

const SIZES: [usize; 7] = [1, 2, 3, 10, 50, 200, 500];

/// Returns the matrix `[H -H; -H H]`, with a row and column of zeros if `m` is odd: its columns sum to zero, without
/// rounding.
fn balanced(half: &DMatrix<f64>, m: usize) -> DMatrix<f64> {
    let k = half.nrows();
    let mut matrix = DMatrix::zeros(m, m);
    for (i, j, sign) in [(0, 0, 1.0), (0, k, -1.0), (k, 0, -1.0), (k, k, 1.0)] {
        matrix.view_mut((i, j), (k, k)).copy_from(&(half * sign));
    }
    matrix
}

#[test]
fn contacts_of_half_the_rank_are_solved_at_every_size() {
    let mut random = Random(40);
    for m in SIZES {
        let j = random.matrix(m, m.div_ceil(2));
        let q = (&j * DVector::from_vec(random.vector(j.ncols()))).as_slice().to_vec();
        Problem::complementarity(&j * j.transpose(), q).solve_exactly(&mut Auto::new(m));
    }
}

#[test]
fn a_monotone_problem_with_a_certificate_that_it_is_infeasible_ends_on_a_ray() {
    // For w = A z + q with ones^T A = 0, the sum of w is that of q, which is negative: no z has w >= 0.
    let mut random = Random(41);
    for m in SIZES {
        let k = m / 2;
        let (j, s) = (random.matrix(k, k.div_ceil(2)), random.matrix(k, k));
        let gram = &j * j.transpose();
        for half in [gram.clone(), gram + &s - s.transpose()] {
            let mut q = random.vector(m);
            let excess = q.iter().sum::<f64>() + 1.0;
            q.iter_mut().for_each(|q| *q -= excess / m as f64);
            let problem = Problem::complementarity(balanced(&half, m), q);
            let report = problem.solve(&mut Lemke::new(m), &mut vec![0.0; m]);
            assert_eq!(report.outcome, Outcome::Ray, "m = {m}: {report:?}");
            if m <= 50 {
                let report = problem.solve(&mut Auto::new(m), &mut vec![0.0; m]);
                assert_eq!(report.outcome, Outcome::Ray, "m = {m}: {report:?}");
            }
        }
    }
}
