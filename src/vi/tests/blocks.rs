//! Variational inequalities over sets other than products of intervals: closed forms, agreement of solvers,
//! degenerate problems.

use super::super::{Auto, SolverKind};
use super::*;
use proptest::prelude::*;

fn block(k: usize, shape: Shape) -> ConvexSet {
    let mut set = ConvexSet::free(k);
    set.bind((0..k).collect(), shape);
    set
}

/// Asserts a small `|z - P(z - w)|` relative to `max(1, |z|, |q|, |A||z|)`, for blocks of about unit size.
fn assert_solved(problem: &Problem, z: &[f64], by: &str) {
    let size = z.iter().fold(1.0_f64, |most, z| most.max(z.abs()));
    let residual = problem.scaled_residual(z) / size;
    assert!(residual <= 1e-10, "{by} left {residual}");
}

fn solve(problem: &Problem, solver: &mut dyn ViSolver) -> Vec<f64> {
    let mut z = vec![0.0; problem.q.len()];
    let report = problem.solve(solver, &mut z);
    assert_eq!(report.outcome, Outcome::Solved, "{} left {report:?}", solver.name());
    assert_solved(problem, &z, solver.name());
    z
}

#[test]
fn forces_that_a_matrix_hardly_opposes_push_to_a_vertex() {
    // Maximises z1 + z2/2 over a triangle with the vertices (1.36, 0.32), (0.2, 0.9) and (-0.1625, -0.1875).
    let rows = [1.0, 2.0, -3.0, 1.0, 1.0, -3.0];
    let triangle = Polyhedron::new(2, &rows, &[2.0, 0.3, 0.4]).expect("a triangle");
    for scale in [1e-2, 1e-5, 1e-8, 1e-11, 1e-14, 1e-17, 0.0] {
        let matrix = DMatrix::from_row_slice(2, 2, &[2.0, 1.0, -1.0, 1.0]) * scale;
        let problem = Problem::new(matrix, vec![-1.0, -0.5], block(2, Shape::Polyhedron(triangle.clone())));
        let z = solve(&problem, &mut SemismoothNewton::new(2));
        assert!(largest_difference(&z, &[1.36, 0.32]) < 1e-13, "{scale:e}: {z:?}");
    }
}

#[test]
fn a_projection_is_the_answer_where_the_matrix_is_the_identity() {
    let mut random = Random(20);
    for m in 1..30 {
        let set = random.blocks(m);
        let q = random.vector(m);
        let mut exact: Vec<f64> = q.iter().map(|q| -q).collect();
        set.project_all(&mut exact, &mut Workspace::default());
        let problem = Problem::new(DMatrix::identity(m, m), q, set);
        let solvers: [Box<dyn ViSolver>; 4] = [
            Box::new(SemismoothNewton::new(m)),
            Box::new(BlockGaussSeidel::new()),
            Box::new(Conic::new()),
            Box::new(Auto::new(m)),
        ];
        for mut solver in solvers {
            assert!(largest_difference(&solve(&problem, &mut *solver), &exact) < 1e-9, "{} at {m}", solver.name());
        }
    }
}

#[test]
fn a_force_on_a_disk_opposes_the_slip() {
    // With A = 0 the solution is the point of the disk farthest along -q, whatever the sizes of disk and q.
    for (radius, size) in [(1.0, 1.0), (1e-6, 1e3), (1e6, 1e-5)] {
        let q = vec![0.6 * size, -0.8 * size];
        let problem = Problem::new(DMatrix::zeros(2, 2), q, block(2, Shape::Ball { radius }));
        let mut z = vec![0.0; 2];
        assert_eq!(problem.solve(&mut SemismoothNewton::new(2), &mut z).outcome, Outcome::Solved);
        assert!(largest_difference(&z, &[-0.6 * radius, 0.8 * radius]) < 1e-9 * radius, "{z:?}");
    }
}

#[test]
fn units_of_a_block_do_not_matter() {
    let mut random = Random(21);
    for factor in [1e-9, 1e-4, 1e5, 1e10] {
        for _ in 0..20 {
            let problem = Problem::new(random.positive_definite(4), random.vector(4), block(4, Shape::SecondOrderCone));
            let exact = solve(&problem, &mut SemismoothNewton::new(4));
            let scaled = Problem::new(problem.matrix * factor, problem.q, problem.set);
            let mut z = vec![0.0; 4];
            assert_eq!(scaled.solve(&mut SemismoothNewton::new(4), &mut z).outcome, Outcome::Solved);
            z.iter_mut().for_each(|z| *z *= factor);
            assert!(largest_difference(&z, &exact) < 1e-8, "{z:?} {exact:?} at {factor}");
        }
    }
}

#[test]
fn strongly_monotone_problems_over_any_set_have_one_answer_for_all_solvers() {
    let mut random = Random(22);
    for m in (1..=20).chain([40, 80]) {
        let set = random.blocks(m);
        let s = random.matrix(m, m);
        let symmetric = random.positive_definite(m);
        let skew = (&s - s.transpose()) / (m as f64).sqrt();
        let q = random.vector(m);
        let problem = Problem::new(symmetric.clone(), q.clone(), set.clone());
        let exact = solve(&problem, &mut SemismoothNewton::new(m));
        for mut solver in [SolverKind::Conic, SolverKind::BlockGaussSeidel, SolverKind::Auto].map(|kind| kind.build(m))
        {
            let difference = largest_difference(&solve(&problem, &mut *solver), &exact);
            assert!(difference < 1e-7, "{} is off by {difference} at {m}", solver.name());
        }
        let problem = Problem::new(symmetric + skew, q, set);
        let z = solve(&problem, &mut SemismoothNewton::new(m));
        for mut solver in [SolverKind::Conic, SolverKind::Auto].map(|kind| kind.build(m)) {
            assert!(largest_difference(&solve(&problem, &mut *solver), &z) < 1e-7, "{} at {m}", solver.name());
        }
    }
}

#[test]
fn semidefinite_problems_on_bounded_blocks_are_solved() {
    for seed in 0..200 {
        let mut random = Random(1000 + seed);
        let m = 2 + (random.next() % 20) as usize;
        let mut set = ConvexSet::intervals(vec![-1.0; m], vec![2.0; m]);
        let mut at = 0;
        while at < m {
            let k = (1 + random.next() % 4).min((m - at) as u64) as usize;
            let shape = if random.next().is_multiple_of(2) { Shape::Simplex } else { Shape::Ball { radius: 1.0 } };
            set.bind((at..at + k).collect(), shape);
            at += k;
        }
        let j = random.matrix(m, m.div_ceil(2));
        let s = random.matrix(m, m);
        let gram = &j * j.transpose();
        for matrix in [gram.clone(), gram + &s - s.transpose(), &s - s.transpose()] {
            solve(&Problem::new(matrix, random.vector(m), set.clone()), &mut Auto::new(m));
        }
    }
}

#[test]
fn a_matrix_game_has_its_known_value() {
    // The game of rock, paper, scissors with a payoff of 2 for paper is a skew problem on two simplices.
    let payoff = DMatrix::from_row_slice(3, 3, &[0.0, -2.0, 1.0, 2.0, 0.0, -1.0, -1.0, 1.0, 0.0]);
    let mut matrix = DMatrix::zeros(6, 6);
    matrix.view_mut((0, 3), (3, 3)).copy_from(&-&payoff);
    matrix.view_mut((3, 0), (3, 3)).copy_from(&payoff.transpose());
    let mut set = ConvexSet::free(6);
    set.bind(vec![0, 1, 2], Shape::Simplex);
    set.bind(vec![3, 4, 5], Shape::Simplex);
    let problem = Problem::new(matrix, vec![0.0; 6], set);
    let z = solve(&problem, &mut Auto::new(6));
    // The optimal strategy weights each option in proportion to the payoff between the other two.
    let exact = [0.25, 0.25, 0.5, 0.25, 0.25, 0.5];
    assert!(largest_difference(&z, &exact) < 1e-9, "{z:?}");
}

#[test]
fn data_are_updated_in_place_between_conic_solves() {
    let mut random = Random(23);
    let mut conic = Conic::new();
    let mut set = block(3, Shape::Ball { radius: 1.0 });
    for k in 1..20 {
        set.set_radius(0, f64::from(k) * 0.1);
        let problem = Problem::new(random.positive_definite(3), random.vector(3), set.clone());
        let z = solve(&problem, &mut conic);
        assert!(largest_difference(&z, &solve(&problem, &mut SemismoothNewton::new(3))) < 1e-8);
    }
}

/// Returns the matrix `A (x) I` with the coefficients `A` of Radau IIA with three stages (Hairer and Wanner 1996,
/// table IV.5.6), and a product of disks, one for each stage.
fn stages(radius: f64) -> (DMatrix<f64>, ConvexSet) {
    let r = 6.0_f64.sqrt();
    let a = [
        [(88.0 - 7.0 * r) / 360.0, (296.0 - 169.0 * r) / 1800.0, (-2.0 + 3.0 * r) / 225.0],
        [(296.0 + 169.0 * r) / 1800.0, (88.0 + 7.0 * r) / 360.0, (-2.0 - 3.0 * r) / 225.0],
        [(16.0 - r) / 36.0, (16.0 + r) / 36.0, 1.0 / 9.0],
    ];
    let mut set = ConvexSet::free(6);
    (0..3).for_each(|i| set.bind(vec![2 * i, 2 * i + 1], Shape::Ball { radius }));
    (DMatrix::from_fn(6, 6, |i, j| if i % 2 == j % 2 { a[i / 2][j / 2] } else { 0.0 }), set)
}

#[test]
fn sweeps_converge_on_coupled_stages_where_unrelaxed_ones_diverge() {
    // Two solutions: w = 0 inside the disks, where a sweep multiplies the error by 1.33; and w = -z on one of the
    // disks.
    let inside = [0.5, -0.25, -0.125, 0.5, 0.25, 0.75];
    let on_one = [0.5, -0.25, -0.125, 0.5, 0.6, 0.8];
    for (exact, slope) in [(inside, 0.0), (on_one, 1.0)] {
        let (matrix, set) = stages(1.0);
        let w = DVector::from_fn(6, |i, _| if i >= 4 { -slope * exact[i] } else { 0.0 });
        let q = w - &matrix * DVector::from_column_slice(&exact);
        let problem = Problem::new(matrix, q.as_slice().to_vec(), set);
        let mut z = vec![0.0; 6];
        let report = problem.solve(&mut BlockGaussSeidel::new(), &mut z);
        assert_eq!(report.outcome, Outcome::Solved, "{report:?}");
        assert!(largest_difference(&z, &exact) < 1e-9, "{z:?}");
        assert!(report.iterations <= 100, "{report:?}");
    }
}

#[test]
fn sweeps_without_prospect_end_early_and_say_so() {
    // The forces point along the recession directions of the cones: no solution exists, whatever the coupling of the
    // blocks.
    let mut set = ConvexSet::free(6);
    (0..2).for_each(|i| set.bind((3 * i..3 * i + 3).collect(), Shape::SecondOrderCone));
    let matrix = DMatrix::from_diagonal(&DVector::from_column_slice(&[0.0, 1.0, 1.0, 0.0, 1.0, 1.0]));
    let problem = Problem::new(matrix, vec![-1.0, 0.0, 0.0, -1.0, 0.0, 0.0], set);
    let report = problem.solve(&mut BlockGaussSeidel::new(), &mut [0.0; 6]);
    assert_eq!(report.outcome, Outcome::Limit, "{report:?}");
    assert!(report.iterations <= 400, "{report:?}");
}

#[test]
fn numbers_are_overwritten_in_a_nonsymmetric_conic_program() {
    let mut random = Random(24);
    let mut conic = Conic::new();
    let set = random.blocks(12);
    for _ in 0..10 {
        let s = random.matrix(12, 12);
        let problem = Problem::new(random.positive_definite(12) + &s - s.transpose(), random.vector(12), set.clone());
        let z = solve(&problem, &mut conic);
        assert!(largest_difference(&z, &solve(&problem, &mut Conic::new())) < 1e-8);
    }
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 64, failure_persistence: None, ..Default::default() })]

    /// The solution satisfies `<w, y - z> >= 0` for 1,000 points `y` of `K`.
    #[test]
    fn the_answer_satisfies_the_inequality_in_every_direction(seed in any::<u64>(), m in 1_usize..25) {
        let mut random = Random(seed);
        let set = random.blocks(m);
        let s = random.matrix(m, m);
        let matrix = random.positive_definite(m) + (&s - s.transpose()) / (m as f64).sqrt();
        let problem = Problem::new(matrix, random.vector(m), set);
        let z = solve(&problem, &mut SemismoothNewton::new(m));
        let w = problem.w(&z);
        for _ in 0..1_000 {
            let y = random.member(&problem.set);
            let along: f64 = (0..m).map(|i| w[i] * (y[i] - z[i])).sum();
            prop_assert!(along > -1e-8 * m as f64, "{along}");
        }
    }

    /// For arbitrary matrices, an outcome of `Solved` implies a small residual.
    #[test]
    fn what_is_called_solved_over_blocks_is_solved(seed in any::<u64>(), m in 1_usize..8) {
        let mut random = Random(seed);
        let problem = Problem::new(random.matrix(m, m), random.vector(m), random.blocks(m));
        for kind in SolverKind::ALL {
            let mut z = random.member(&problem.set);
            let report = problem.solve(&mut *kind.build(m), &mut z);
            if report.outcome == Outcome::Solved {
                assert_solved(&problem, &z, kind.name());
            }
        }
    }
}
