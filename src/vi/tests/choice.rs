//! Tests of the choice of the solver, and of the attempts it reports.

use super::super::{Attempt, Auto, SolverKind};
use super::*;

#[test]
fn auto_names_the_solver_that_answered() {
    let mut random = Random(11);
    let mut auto = Auto::new(3);
    assert_eq!(auto.name(), "auto");
    for (m, name) in [(3, "lemke"), (501, "semismooth_newton"), (5, "lemke")] {
        let matrix = DMatrix::identity(m, m) + DMatrix::from_element(m, m, 1.0 / m as f64);
        Problem::complementarity(matrix, random.vector(m)).solve_exactly(&mut auto);
        assert_eq!(auto.name(), name);
    }
}

#[test]
fn kinds_are_known_by_their_names() {
    for kind in SolverKind::ALL {
        assert_eq!(SolverKind::by_name(kind.name()), Some(kind));
    }
    assert_eq!(SolverKind::by_name("interior_point"), None);
}

#[test]
fn pivoting_refuses_what_is_no_product_of_intervals() {
    let mut set = ConvexSet::free(2);
    set.bind(vec![0, 1], Shape::SecondOrderCone);
    let problem = Problem::new(DMatrix::identity(2, 2), vec![1.0, 0.0], set);
    let mut z = vec![0.0; 2];
    assert_eq!(problem.solve(&mut Lemke::new(2), &mut z).outcome, Outcome::Unsuitable);
}

#[test]
fn the_story_names_every_solver_that_was_tried() {
    // No point of the half plane z1 >= 1 minimises -z2: no solution exists, and every solver reports so. Sweeps are
    // not tried for a single block.
    for (blocks, expected) in [
        (1, &[SolverKind::SemismoothNewton, SolverKind::Conic][..]),
        (2, &[SolverKind::SemismoothNewton, SolverKind::Conic, SolverKind::BlockGaussSeidel]),
    ] {
        let m = 2 * blocks;
        let mut set = ConvexSet::free(m);
        for block in 0..blocks {
            let half_plane = Polyhedron::new(2, &[-1.0, 0.0], &[-1.0]).expect("not empty");
            set.bind(vec![2 * block, 2 * block + 1], Shape::Polyhedron(half_plane));
        }
        let mut q = vec![0.0; m];
        q[1] = -1.0;
        let problem = Problem::new(DMatrix::zeros(m, m), q, set);
        let mut auto = Auto::new(m);
        let mut z = vec![0.0; m];
        let report = problem.solve(&mut auto, &mut z);
        assert_eq!(report.outcome, Outcome::Ray);
        let tried: Vec<SolverKind> = auto.attempts().iter().map(|attempt| attempt.solver).collect();
        assert_eq!(tried, expected);
        assert_eq!(auto.attempts()[1], Attempt { solver: SolverKind::Conic, outcome: Outcome::Ray });
        assert_eq!(auto.name(), "conic");
    }
}

#[test]
fn a_large_string_over_an_obstacle_is_solved_by_its_active_set() {
    // The string of -u'' = -1, u >= -1/16, in 600 differences, with a known exact solution.
    let m = 600;
    let h = 1.0 / (m + 1) as f64;
    let matrix = DMatrix::from_fn(m, m, |i, j| match i.abs_diff(j) {
        0 => 2.0 / (h * h),
        1 => -1.0 / (h * h),
        _ => 0.0,
    });
    let set = ConvexSet::intervals(vec![-1.0 / 16.0; m], vec![INFINITY; m]);
    let problem = Problem::new(matrix, vec![1.0; m], set);
    let mut auto = Auto::new(m);
    let u = problem.solve_exactly(&mut auto);
    assert_eq!(auto.name(), "active_set");
    let touching = u.iter().filter(|&&u| u == -1.0 / 16.0).count() as f64 * h;
    assert!((touching - (1.0 - 2.0 * 0.125_f64.sqrt())).abs() < 3.0 * h, "touches over {touching}");
    // With another load the analysis of the matrix is reused, and the active set moves.
    let lighter = Problem::new(problem.matrix.clone(), vec![0.6; m], problem.set.clone());
    let u = lighter.solve_exactly(&mut auto);
    let touching = u.iter().filter(|&&u| u == -1.0 / 16.0).count() as f64 * h;
    assert!((touching - (1.0 - 2.0 * (0.125_f64 / 0.6).sqrt())).abs() < 3.0 * h, "touches over {touching}");
}

#[test]
fn long_work_is_given_up_where_nobody_waits_for_it() {
    // Murty's family takes Lemke's method 2^12 pivots; the problem on disks takes more than a few sweeps and Newton
    // steps.
    let m = 12;
    let murty = DMatrix::from_fn(m, m, |i, j| if i == j { 1.0 } else { f64::from(u8::from(i < j)) * 2.0 });
    let q = (0..m).map(|i| 2.0_f64.powi(i as i32) - 2.0_f64.powi(m as i32)).collect();
    let pivots = Problem::complementarity(murty, q);
    let mut random = Random(14);
    let j = random.matrix(40, 20);
    let mut set = ConvexSet::free(40);
    (0..20).for_each(|k| set.bind(vec![2 * k, 2 * k + 1], Shape::Ball { radius: 0.3 }));
    let discs = Problem::new(&j * j.transpose(), random.vector(40), set);
    let control = Control::new();
    control.cancel();
    for (problem, solver) in [
        (&pivots, SolverKind::Lemke),
        (&pivots, SolverKind::ActiveSet),
        (&pivots, SolverKind::Auto),
        (&discs, SolverKind::BlockGaussSeidel),
    ] {
        let vi = AffineVi { matrix: &problem.matrix, q: &problem.q, set: &problem.set };
        let report = solver.build(problem.q.len()).solve(&vi, &mut vec![0.0; problem.q.len()], &control);
        assert_eq!(report.outcome, Outcome::Interrupted, "{}: {report:?}", solver.name());
    }
}
