//! Properties of every variational inequality that has a solution.

use super::super::SolverKind;
use super::*;
use proptest::prelude::*;

proptest! {
    #![proptest_config(ProptestConfig { cases: 64, failure_persistence: None, ..Default::default() })]

    /// The solution satisfies `<w, y - z> >= 0` for 1,000 points `y` of `K`.
    #[test]
    fn the_answer_satisfies_the_inequality_in_every_direction(seed in any::<u64>(), m in 1_usize..25) {
        let mut random = Random(seed);
        let problem = Problem::new(random.nonsymmetric_p(m), random.vector(m), random.intervals(m));
        for z in problem.solve_by_all() {
            let w = problem.w(&z);
            for _ in 0..1_000 {
                let y = random.member(&problem.set);
                let along: f64 = (0..m).map(|i| w[i] * (y[i] - z[i])).sum();
                prop_assert!(along > -1e-9 * m as f64, "{along}");
            }
        }
    }

    /// Monotone problems on boxes have solutions, and all solvers find one; `w = A z + q` of the symmetric ones is
    /// unique.
    #[test]
    fn a_semidefinite_matrix_on_a_box_has_one_w(seed in any::<u64>(), m in 1_usize..12) {
        let mut random = Random(seed);
        let j = random.matrix(m, m.div_ceil(2));
        let set = ConvexSet::intervals(vec![-1.0; m], vec![2.0; m]);
        let problem = Problem::new(&j * j.transpose(), random.vector(m), set);
        let answers = problem.solve_by_all();
        prop_assert!(largest_difference(&problem.w(&answers[0]), &problem.w(&answers[1])) < 1e-5);
    }

    /// For arbitrary matrices, solvable or not: an outcome of `Solved` is equivalent to a small residual, and the
    /// reported residual is correct.
    #[test]
    fn what_is_called_solved_is_solved(seed in any::<u64>(), m in 1_usize..8) {
        let mut random = Random(seed);
        let problem = Problem::new(random.matrix(m, m), random.vector(m), random.intervals(m));
        for kind in SolverKind::ALL {
            let mut z = random.member(&problem.set);
            let report = problem.solve(&mut *kind.build(m), &mut z);
            if report.outcome == Outcome::Unsuitable {
                continue;
            }
            let residual = problem.set.natural_residual(&z, &problem.w(&z));
            prop_assert!((residual - report.residual).abs() <= 1e-12 * (1.0 + residual));
            let scaled = problem.scaled_residual(&z);
            let solved = report.outcome == Outcome::Solved;
            prop_assert!(if solved { scaled <= 1e-10 } else { scaled > 1e-12 }, "{scaled} in {report:?}");
        }
    }
}
