//! Tests of solvers of nonlinear variational inequalities.

use super::super::{JosephyNewton, NonlinearVi, SolverKind};
use super::*;

/// The cubic function `F(z)_i = sum_j A_ij z_j + c z_i^3 + q_i`.
struct Cubic {
    affine: Problem,
    c: f64,
}

impl NonlinearVi for Cubic {
    fn set(&self) -> &ConvexSet {
        &self.affine.set
    }

    fn evaluate(&mut self, z: &[f64], f: &mut [f64]) {
        f.copy_from_slice(&self.affine.w(z));
        f.iter_mut().zip(z).for_each(|(f, z)| *f += self.c * z.powi(3));
    }

    fn jacobian(&mut self, z: &[f64], derivative: &mut DMatrix<f64>) {
        derivative.copy_from(&self.affine.matrix);
        (0..z.len()).for_each(|i| derivative[(i, i)] += 3.0 * self.c * z[i] * z[i]);
    }
}

/// Kojima and Shindoh's problem (Facchinei and Pang 2003, page 42): a complementarity problem with two solutions, one
/// of them degenerate.
struct KojimaShindoh(ConvexSet);

impl NonlinearVi for KojimaShindoh {
    fn set(&self) -> &ConvexSet {
        &self.0
    }

    fn evaluate(&mut self, z: &[f64], f: &mut [f64]) {
        let [a, b, c, d] = [z[0], z[1], z[2], z[3]];
        f[0] = 3.0 * a * a + 2.0 * a * b + 2.0 * b * b + c + 3.0 * d - 6.0;
        f[1] = 2.0 * a * a + a + b * b + 10.0 * c + 2.0 * d - 2.0;
        f[2] = 3.0 * a * a + a * b + 2.0 * b * b + 2.0 * c + 9.0 * d - 9.0;
        f[3] = a * a + 3.0 * b * b + 2.0 * c + 3.0 * d - 3.0;
    }

    fn jacobian(&mut self, z: &[f64], derivative: &mut DMatrix<f64>) {
        let (a, b) = (z[0], z[1]);
        let rows = [
            [6.0 * a + 2.0 * b, 2.0 * a + 4.0 * b, 1.0, 3.0],
            [4.0 * a + 1.0, 2.0 * b, 10.0, 2.0],
            [6.0 * a + b, a + 4.0 * b, 2.0, 9.0],
            [2.0 * a, 6.0 * b, 2.0, 3.0],
        ];
        for (i, row) in rows.iter().enumerate() {
            row.iter().enumerate().for_each(|(j, value)| derivative[(i, j)] = *value);
        }
    }
}

#[test]
fn cubic_problems_over_any_set_converge_from_far_away() {
    let mut random = Random(30);
    for m in 1..=20 {
        let set = random.blocks(m);
        let s = random.matrix(m, m);
        let matrix = random.positive_definite(m) + (&s - s.transpose()) / (m as f64).sqrt();
        let mut vi = Cubic { affine: Problem::new(matrix, random.vector(m), set), c: 10.0 };
        let mut method = JosephyNewton::new(m, SolverKind::Auto);
        let mut answers = Vec::new();
        for size in [0.0, 100.0] {
            let mut z: Vec<f64> = random.vector(m).iter().map(|z| size * z).collect();
            let report = method.solve(&mut vi, 1e-10, &mut z, &Control::new());
            assert_eq!(report.outcome, Outcome::Solved, "{report:?} at {m} from {size}");
            let mut f = vec![0.0; m];
            vi.evaluate(&z, &mut f);
            assert!(vi.set().natural_residual(&z, &f) <= 1e-10 * 1.01);
            answers.push(z);
        }
        assert!(largest_difference(&answers[0], &answers[1]) < 1e-8);
    }
}

#[test]
fn a_problem_that_is_not_monotone_is_solved_at_one_of_its_two_solutions() {
    let root = 6.0_f64.sqrt() / 2.0;
    let solutions = [[root, 0.0, 0.0, 0.5], [1.0, 0.0, 3.0, 0.0]];
    let mut solved = 0;
    for start in [[1.0, 1.0, 1.0, 1.0], [0.0, 0.0, 0.0, 0.0], [1.0, 0.0, 1.0, 0.0], [2.0, 0.1, 3.0, 0.5]] {
        let mut z = start.to_vec();
        let mut method = JosephyNewton::new(4, SolverKind::Auto);
        let report = method.solve(&mut KojimaShindoh(ConvexSet::nonnegative(4)), 1e-10, &mut z, &Control::new());
        if report.outcome == Outcome::Solved {
            solved += 1;
            assert!(solutions.iter().any(|exact| largest_difference(&z, exact) < 1e-5), "{z:?}");
        }
    }
    assert!(solved >= 3, "{solved}");
}

#[test]
fn a_function_that_is_not_defined_is_an_honest_breakdown() {
    let affine = Problem::complementarity(DMatrix::identity(1, 1), vec![f64::NAN]);
    let report = JosephyNewton::new(1, SolverKind::Auto).solve(
        &mut Cubic { affine, c: 0.0 },
        1e-10,
        &mut [1.0],
        &Control::new(),
    );
    assert_eq!(report.outcome, Outcome::Breakdown);
}
