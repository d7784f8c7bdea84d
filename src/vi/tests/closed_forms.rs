//! Variational inequalities whose solutions are known in closed form.

use super::super::{Auto, SolverKind};
use super::*;

#[test]
fn a_problem_without_variables_is_solved() {
    let problem = Problem::complementarity(DMatrix::zeros(0, 0), vec![]);
    problem.solve_by_all();
    assert_eq!(problem.solve(&mut Auto::new(0), &mut []).outcome, Outcome::Solved);
}

#[test]
fn one_variable_stops_at_the_right_end() {
    // The solution of a z + q = 0 is z = -q/a, clamped to the interval.
    for (a, q, lower, upper, z) in [
        (2.0, -3.0, 0.0, INFINITY, 1.5),
        (2.0, 3.0, 0.0, INFINITY, 0.0),
        (2.0, -3.0, -INFINITY, 1.0, 1.0),
        (2.0, 3.0, -INFINITY, 1.0, -1.5),
        (2.0, -3.0, -1.0, 1.0, 1.0),
        (2.0, 3.0, -1.0, 1.0, -1.0),
        (2.0, 1.0, -1.0, 1.0, -0.5),
        (2.0, 1.0, 0.25, 0.25, 0.25),
        (2.0, 1.0, -INFINITY, INFINITY, -0.5),
        (0.0, 1.0, -1.0, 1.0, -1.0),
        (0.0, -1.0, -1.0, 1.0, 1.0),
    ] {
        let problem =
            Problem::new(DMatrix::from_element(1, 1, a), vec![q], ConvexSet::intervals(vec![lower], vec![upper]));
        for answer in problem.solve_by_all() {
            assert!((answer[0] - z).abs() < 1e-12, "{answer:?} instead of {z}");
        }
    }
}

#[test]
fn all_free_is_a_linear_system() {
    let mut random = Random(1);
    for m in [1, 2, 3, 7, 30, 100] {
        let matrix = random.matrix(m, m);
        let q = random.vector(m);
        let exact = matrix.clone().lu().solve(&-DVector::from_column_slice(&q)).expect("regular");
        for z in Problem::new(matrix, q, ConvexSet::free(m)).solve_by_all() {
            assert!(largest_difference(&z, exact.as_slice()) < 1e-8 * exact.amax());
        }
    }
}

#[test]
fn a_free_block_with_a_zero_diagonal_is_pivoted_off_it() {
    // For a cyclic permutation, every one by one and two by two principal minor is zero.
    let matrix = DMatrix::from_row_slice(3, 3, &[0.0, 1.0, 0.0, 0.0, 0.0, 1.0, 1.0, 0.0, 0.0]);
    for z in Problem::new(matrix, vec![1.0, 2.0, 3.0], ConvexSet::free(3)).solve_by_all() {
        assert!(largest_difference(&z, &[-3.0, -1.0, -2.0]) < 1e-14);
    }
}

#[test]
fn all_points_leave_nothing_to_choose() {
    let mut random = Random(2);
    let points = random.vector(4);
    let set = ConvexSet::intervals(points.clone(), points.clone());
    for z in Problem::new(random.matrix(4, 4), random.vector(4), set).solve_by_all() {
        assert_eq!(z, points);
    }
}

#[test]
fn the_four_diode_bridge_conducts_through_one_pair() {
    // The unknowns are the currents of D1, D3 and the voltages over the other diodes; G = 1 mS across. With v > 0 at
    // the input the rows say w3 = z1 - v and w4 = z2 + v, so z1 = v, and by row 1, z3 = v / 1000; with v < 0 the
    // other pair conducts.
    #[rustfmt::skip]
    let matrix = DMatrix::from_row_slice(4, 4, &[
        0.001, 0.001, -1.0, 0.0,
        0.001, 0.001, 0.0, -1.0,
        1.0, 0.0, 0.0, 0.0,
        0.0, 1.0, 0.0, 0.0,
    ]);
    let bridge = |v: f64| Problem::complementarity(matrix.clone(), vec![0.0, 0.0, -v, v]);
    for (v, exact) in [(5.0, [5.0, 0.0, 0.005, 0.0]), (-5.0, [0.0, 5.0, 0.0, 0.005]), (0.0, [0.0; 4])] {
        let problem = bridge(v);
        let mut z = vec![0.0; 4];
        assert_eq!(problem.solve(&mut Lemke::new(4), &mut z).outcome, Outcome::Solved);
        // The matrix is not a P-matrix: for v = 0 only the voltage across the bridge is determined.
        assert!(largest_difference(&z[..2], &exact[..2]) < 1e-12, "{z:?} at {v}");
        assert!(problem.scaled_residual(&z) < 1e-14);
        if v > 0.0 {
            assert!((z[2] - exact[2]).abs() < 1e-12 && z[3] >= -1e-15, "{z:?}");
        }
    }
}

#[test]
fn a_saddle_point_finds_the_point_of_the_simplex_nearest_to_another() {
    // The problem min |z - p|^2 / 2 on z >= 0, sum z = 1, has the solution z = max(p - s, 0) with s such that the sum
    // is one (Held, Wolfe and Crowder 1974). The multiplier of the sum is free, and its diagonal entry is zero.
    let p = [0.9, 0.6, -0.4, 0.2];
    let mut matrix = DMatrix::identity(5, 5);
    matrix[(4, 4)] = 0.0;
    for i in 0..4 {
        (matrix[(i, 4)], matrix[(4, i)]) = (-1.0, 1.0);
    }
    let mut set = ConvexSet::nonnegative(5);
    set.lower[4] = -INFINITY;
    let q = p.iter().map(|p| -p).chain([-1.0]).collect();
    for z in Problem::new(matrix, q, set).solve_by_all() {
        assert!(largest_difference(&z, &[0.65, 0.35, 0.0, 0.0, -0.25]) < 1e-12, "{z:?}");
    }
}

#[test]
fn a_transport_plan_with_a_redundant_equation_is_the_cheapest() {
    // With two mines of 3 and 4 tons, two mills of 5 and 2, and costs ((1, 4), (3, 2)), the cheapest plan ships 3
    // along the first row and 2 and 2 along the second row, at cost 3 + 6 + 4. The four balances sum to zero, so
    // their block has rank three.
    let mut matrix = DMatrix::zeros(8, 8);
    let balances: [[f64; 4]; 4] =
        [[1.0, 1.0, 0.0, 0.0], [0.0, 0.0, 1.0, 1.0], [-1.0, 0.0, -1.0, 0.0], [0.0, -1.0, 0.0, -1.0]];
    for (k, row) in balances.iter().enumerate() {
        for (i, &b) in row.iter().enumerate() {
            (matrix[(4 + k, i)], matrix[(i, 4 + k)]) = (b, -b);
        }
    }
    let mut set = ConvexSet::nonnegative(8);
    set.lower[4..].fill(-INFINITY);
    let q = vec![1.0, 4.0, 3.0, 2.0, -3.0, -4.0, 5.0, 2.0];
    let z = Problem::new(matrix, q, set).solve_exactly(&mut Lemke::new(8));
    assert!(largest_difference(&z[..4], &[3.0, 0.0, 2.0, 2.0]) < 1e-12, "{z:?}");
}

#[test]
fn an_equation_that_nothing_satisfies_is_a_breakdown() {
    let problem = Problem::new(DMatrix::zeros(1, 1), vec![1.0], ConvexSet::free(1));
    assert_eq!(problem.solve(&mut Lemke::new(1), &mut [0.0]).outcome, Outcome::Breakdown);
}

#[test]
fn an_infeasible_copositive_plus_problem_ends_on_a_ray() {
    // w = z1 - z2 - 1 >= 0 and w = -z1 + z2 - 1 >= 0 contradict each other; the matrix is positive semidefinite.
    let matrix = DMatrix::from_row_slice(2, 2, &[1.0, -1.0, -1.0, 1.0]);
    let problem = Problem::complementarity(matrix, vec![-1.0, -1.0]);
    for start in [[0.0, 0.0], [1.0, 0.0], [1.0, 1.0]] {
        assert_eq!(problem.solve(&mut Lemke::new(2), &mut start.clone()).outcome, Outcome::Ray);
        assert_eq!(problem.solve(&mut Auto::new(2), &mut start.clone()).outcome, Outcome::Ray);
        assert_eq!(problem.solve(&mut SemismoothNewton::new(2), &mut start.clone()).outcome, Outcome::Limit);
    }
}

#[test]
fn data_that_are_not_numbers_break_down() {
    let sound = Problem::complementarity(DMatrix::identity(2, 2), vec![-1.0, 1.0]);
    let mut cases = vec![sound.clone(); 5];
    cases[0].matrix[(1, 0)] = f64::NAN;
    cases[1].matrix[(0, 1)] = INFINITY;
    cases[2].q[1] = f64::NAN;
    cases[3].set.lower[0] = f64::NAN;
    (cases[4].set.lower[0], cases[4].set.upper[0]) = (1.0, 0.0);
    for problem in cases {
        for kind in SolverKind::ALL {
            let report = problem.solve(&mut *kind.build(2), &mut [0.0, 0.0]);
            assert_eq!(report.outcome, Outcome::Breakdown, "{problem:?}");
        }
    }
}

#[test]
fn a_start_that_is_not_a_number_does_no_harm() {
    let problem = Problem::complementarity(DMatrix::identity(2, 2), vec![-1.0, 1.0]);
    for mut solver in solvers(2) {
        let mut z = [f64::NAN, INFINITY];
        assert_eq!(problem.solve(&mut *solver, &mut z).outcome, Outcome::Solved);
        assert_eq!(z, [1.0, 0.0]);
    }
}
