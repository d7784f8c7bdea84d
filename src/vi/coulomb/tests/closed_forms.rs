//! Contact problems with Coulomb's law whose solutions are known.

use super::super::{Coulomb, CoulombProblem, Limits, Method};
use super::{Random, problem};
use crate::{AffineVi, Lemke, Outcome, ViSolver};
use nalgebra::{DMatrix, DVector, Vector3};
use problem::{Control, ConvexSet};

fn solve(problem: &CoulombProblem) -> Vec<Vector3<f64>> {
    let mut r = vec![Vector3::zeros(); problem.contacts()];
    let report = Coulomb::default().solve(problem, &mut r, &Control::new());
    assert_eq!(report.outcome, Outcome::Solved, "{report:?}");
    r
}

#[test]
fn what_slides_does_not_lift_off() {
    // Two separate spheres slide at 10 m/s; the convex relaxation would lift them at mu times that speed.
    let q = vec![Vector3::new(-0.01, 10.0, 0.0), Vector3::new(-0.01, 0.0, -10.0)];
    let problem = problem(&DMatrix::identity(6, 6), q, vec![0.5; 2]);
    let r = solve(&problem);
    for k in 0..2 {
        assert!(problem.velocity(k, &r).x.abs() < 1e-12);
        assert!((r[k].x - 0.01).abs() < 1e-12);
    }
}

#[test]
fn without_friction_velocities_are_those_of_the_complementarity_problem() {
    let mut random = Random(5);
    for n in [2, 8, 30] {
        // Take more contacts than degrees of freedom: the impulses are not unique, whereas the velocities are.
        let jacobian = DMatrix::from_fn(3 * n, n / 2 + 1, |_, _| random.number());
        let free = DVector::from_fn(jacobian.ncols(), |_, _| random.number());
        let dense = &jacobian * jacobian.transpose();
        let q = &jacobian * free;
        let vectors = q.as_slice().chunks_exact(3).map(Vector3::from_column_slice).collect();
        let problem = problem(&dense, vectors, vec![0.0; n]);
        let r = solve(&problem);

        let normal = DMatrix::from_fn(n, n, |i, j| dense[(3 * i, 3 * j)]);
        let q_n: Vec<_> = (0..n).map(|k| q[3 * k]).collect();
        let mut z = vec![0.0; n];
        let vi = AffineVi { matrix: &normal, q: &q_n, set: &ConvexSet::nonnegative(n) };
        assert_eq!(Lemke::new(n).solve(&vi, &mut z, &Control::new()).outcome, Outcome::Solved);
        let w = normal * DVector::from_vec(z);
        for k in 0..n {
            let u_n = problem.velocity(k, &r).x;
            assert!((u_n - w[k] - q_n[k]).abs() < 1e-8, "contact {k} of {n}: {u_n}");
        }
    }
}

#[test]
fn an_answer_handed_back_costs_nothing() {
    let mut random = Random(6);
    let jacobian = DMatrix::from_fn(12, 6, |_, _| random.number());
    let q: Vec<_> = (0..4).map(|_| Vector3::new(-1.0, random.number(), random.number())).collect();
    let problem = problem(&(&jacobian * jacobian.transpose() + DMatrix::identity(12, 12)), q, vec![0.3; 4]);
    let mut r = solve(&problem);
    let before = r.clone();
    let report = Coulomb::default().solve(&problem, &mut r, &Control::new());
    assert_eq!((report.outcome, report.attempts.len()), (Outcome::Solved, 0));
    assert!(r.iter().zip(&before).all(|(r, before)| (r - before).amax() <= 1e-15 * before.amax()));
}

#[test]
fn a_problem_without_a_solution_ends_at_the_limit_and_tells_what_was_tried() {
    // A body is squeezed by two walls that approach each other: no solution exists.
    let jacobian =
        DMatrix::from_row_slice(6, 3, &[1., 0., 0., 0., 1., 0., 0., 0., 1., -1., 0., 0., 0., 1., 0., 0., 0., 1.]);
    let q = vec![Vector3::new(-1.0, 0.0, 0.0); 2];
    let problem = problem(&(&jacobian * jacobian.transpose()), q, vec![0.5; 2]);
    let mut r = vec![Vector3::zeros(); 2];
    let limits = Limits { iterations: 2_000, ..Limits::default() };
    let report = Coulomb::new(limits).solve(&problem, &mut r, &Control::new());
    assert_eq!(report.outcome, Outcome::Limit, "{r:?} {report:?}");
    // The impulses may have grown until the residual relative to them is small, whereas the violation of Signorini's
    // condition shows that there is no solution.
    assert!(report.evidence.signorini > 0.1, "{report:?}");
    for method in [Method::GaussSeidel, Method::ProximalNewton, Method::Admm] {
        assert!(report.attempts.iter().any(|attempt| attempt.method == method), "{report:?}");
    }
    let run: usize = report.attempts.iter().filter(|a| a.method == Method::Admm).map(|a| a.iterations).sum();
    assert!((2_000..2_025).contains(&run), "{run}");
}

#[test]
fn a_cancelled_solve_returns_at_once() {
    let problem = problem(&DMatrix::identity(6, 6), vec![Vector3::new(-1.0, 2.0, 0.0); 2], vec![0.5; 2]);
    let control = Control::new();
    control.cancel();
    let mut r = vec![Vector3::zeros(); 2];
    let report = Coulomb::default().solve(&problem, &mut r, &control);
    assert_eq!((report.outcome, report.attempts.len()), (Outcome::Limit, 0));
}
