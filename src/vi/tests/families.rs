//! Random families of variational inequalities of every size.

use super::super::Auto;
use super::*;

#[test]
fn every_size_to_a_few_dozen_is_solved() {
    let mut random = Random(6);
    let (mut lemke, mut newton) = (Lemke::new(0), SemismoothNewton::new(0));
    for m in 1..=40 {
        for matrix in [random.positive_definite(m), random.nonsymmetric_p(m)] {
            let q = random.vector(m);
            for set in [ConvexSet::nonnegative(m), random.intervals(m)] {
                let problem = Problem::new(matrix.clone(), q.clone(), set);
                let by_lemke = problem.solve_exactly(&mut lemke);
                let by_newton = problem.solve_exactly(&mut newton);
                assert!(largest_difference(&by_lemke, &by_newton) < 1e-7, "m = {m}");
            }
        }
    }
}

#[test]
fn large_problems_are_solved() {
    let mut random = Random(7);
    for m in [75, 150, 300, 500] {
        for matrix in [random.positive_definite(m), random.nonsymmetric_p(m)] {
            let problem = Problem::new(matrix, random.vector(m), random.intervals(m));
            let answers = problem.solve_by_all();
            assert!(largest_difference(&answers[0], &answers[1]) < 1e-6, "m = {m}");
        }
    }
}

#[test]
fn small_problems_agree_with_the_enumeration_of_faces() {
    let mut random = Random(8);
    for m in 1..=5 {
        for _ in 0..60 {
            let problem = Problem::new(random.nonsymmetric_p(m), random.vector(m), random.intervals(m));
            let exact = problem.solutions_by_enumeration();
            for z in problem.solve_by_all() {
                assert!(largest_difference(&z, &exact[0]) < 1e-8, "{z:?} instead of {exact:?}");
            }
        }
    }
}

#[test]
fn the_answer_is_its_own_warm_start() {
    let mut random = Random(9);
    let mut lemke = Lemke::new(30);
    for m in [1, 2, 3, 6, 12, 30] {
        let problem = Problem::new(random.nonsymmetric_p(m), random.vector(m), random.intervals(m));
        let mut z = problem.solve_exactly(&mut lemke);
        let cold = z.clone();
        let report = problem.solve(&mut lemke, &mut z);
        assert_eq!((report.outcome, report.iterations), (Outcome::Solved, 0));
        assert!(largest_difference(&z, &cold) < 1e-12);
    }
}

#[test]
fn a_wrong_start_does_not_change_the_answer() {
    let mut random = Random(10);
    for m in [2, 3, 6, 12, 30] {
        for _ in 0..20 {
            let problem = Problem::new(random.nonsymmetric_p(m), random.vector(m), random.intervals(m));
            for mut solver in solvers(m) {
                let cold = problem.solve_exactly(&mut *solver);
                let mut z = random.member(&problem.set);
                assert_eq!(problem.solve(&mut *solver, &mut z).outcome, Outcome::Solved);
                assert!(largest_difference(&z, &cold) < 1e-8);
            }
        }
    }
}

#[test]
fn no_monotone_problem_on_a_box_or_of_contact_is_left_unsolved() {
    for seed in 0..300 {
        let mut random = Random(seed);
        let m = 1 + (random.next() % 30) as usize;
        let j = random.matrix(m, m.div_ceil(2));
        let contact = &j * j.transpose();
        let along = (&j * DVector::from_vec(random.vector(j.ncols()))).as_slice().to_vec();
        Problem::complementarity(contact.clone(), along).solve_by_all();
        let s = random.matrix(m, m);
        for matrix in [contact.clone(), &contact + &s - s.transpose()] {
            let set = ConvexSet::intervals(vec![-1.0; m], vec![2.0; m]);
            Problem::new(matrix, random.vector(m), set).solve_by_all();
        }
    }
}

#[test]
fn degenerate_contacts_of_every_size_are_solved() {
    // The matrix has half the rank, and a third of the contacts just touch: their rows of q cancel the contribution
    // of the others.
    let mut random = Random(13);
    for m in [1, 2, 3, 10, 50, 200, 500] {
        let j = random.matrix(m, m.div_ceil(2));
        let z: Vec<f64> = (0..m).map(|i| if i % 3 == 0 { random.number().abs() } else { 0.0 }).collect();
        let w = &j * j.transpose() * DVector::from_vec(z);
        let q = (0..m).map(|i| if i % 3 == 2 { random.number().abs() - w[i] } else { -w[i] }).collect();
        let problem = Problem::complementarity(&j * j.transpose(), q);
        let answer = problem.solve_exactly(&mut Auto::new(m));
        assert!(answer.iter().all(|z| *z >= 0.0));
    }
}
