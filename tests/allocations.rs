//! A solver allocates at the first problem of a size and set, and not at later ones, whatever their numbers.

use allocation_counter::measure;
use dvi::problem::{Control, ConvexSet, Shape};
use dvi::vi::{AffineVi, Outcome, SolverKind};
use nalgebra::DMatrix;

/// Coupled blocks, with numbers of the `k`-th problem: disks whose radius moves, and intervals between them.
fn problem(k: usize, with_disks: bool) -> (DMatrix<f64>, Vec<f64>, ConvexSet) {
    let m = 12;
    let wave = |i: usize| (1.7 * i as f64 + 0.3 * k as f64).sin();
    let matrix = DMatrix::from_fn(m, m, |i, j| if i == j { 4.0 + 0.1 * wave(i) } else { 0.2 * wave(i + j) });
    let mut set = ConvexSet::intervals(vec![-0.5; m], vec![0.25 + 0.01 * k as f64; m]);
    if with_disks {
        (0..4).for_each(|b| set.bind(vec![3 * b, 3 * b + 1], Shape::Ball { radius: 0.2 + 0.01 * k as f64 }));
    }
    (matrix, (0..m).map(|i| 3.0 * wave(2 * i)).collect(), set)
}

/// How often a solver allocates at the problems that follow its first two.
fn allocations(kind: SolverKind, with_disks: bool) -> u64 {
    let problems: Vec<_> = (0..10).map(|k| problem(k, with_disks)).collect();
    let mut solver = kind.build(problems[0].1.len());
    let control = Control::new();
    let mut z = vec![0.0; problems[0].1.len()];
    let mut solve = |(matrix, q, set): &(DMatrix<f64>, Vec<f64>, ConvexSet)| {
        let report = solver.solve(&AffineVi { matrix, q, set }, &mut z, &control);
        assert_eq!(report.outcome, Outcome::Solved, "{}", kind.name());
    };
    problems[..2].iter().for_each(&mut solve);
    measure(|| problems[2..].iter().for_each(&mut solve)).count_total
}

#[test]
fn solvers_over_intervals_allocate_at_the_first_problem_only() {
    use SolverKind::{Auto, BlockGaussSeidel, Lemke, SemismoothNewton};
    for kind in [Auto, Lemke, SemismoothNewton, BlockGaussSeidel] {
        assert_eq!(allocations(kind, false), 0, "{}", kind.name());
    }
}

#[test]
fn solvers_over_blocks_allocate_at_the_first_problem_only() {
    use SolverKind::{Auto, BlockGaussSeidel, SemismoothNewton};
    for kind in [Auto, SemismoothNewton, BlockGaussSeidel] {
        assert_eq!(allocations(kind, true), 0, "{}", kind.name());
    }
}
