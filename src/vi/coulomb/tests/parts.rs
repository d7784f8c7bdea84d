//! Tests of the parts of the contact solvers: projection, generalised Jacobian, linear systems, scaling.

use super::super::alart_curnier;
use super::super::cone::FrictionCone;
use super::super::linear::BlockSystem;
use super::super::scaling::Scaling;
use super::super::{BlockMatrix, CoulombProblem, CoulombProblemError, Evidence};
use super::Random;
use nalgebra::{DMatrix, DVector, Matrix3, Vector3};

/// Returns a random point of the friction cone.
fn point(random: &mut Random, mu: f64) -> Vector3<f64> {
    let (normal, angle) = (random.number().abs() * 3.0, random.number() * std::f64::consts::PI);
    let slip = mu * normal * random.number().abs();
    Vector3::new(normal, slip * angle.cos(), slip * angle.sin())
}

#[test]
fn the_projection_makes_an_obtuse_angle_with_every_way_into_the_cone() {
    let mut random = Random(1);
    for case in 0..2_000 {
        let mu = [0.0, 0.3, 1.0, 4.0][case % 4];
        let v = random.vector() * 3.0;
        let p = FrictionCone { mu }.project(v);
        assert!(p.y.hypot(p.z) <= mu * p.x * (1.0 + 1e-14) + 1e-15);
        for _ in 0..50 {
            let other = point(&mut random, mu);
            assert!((v - p).dot(&(other - p)) <= 1e-13, "mu {mu}: {v} projects to {p}, nearer is {other}");
        }
    }
}

#[test]
fn the_generalised_jacobian_agrees_with_differences_in_every_state() {
    let mut random = Random(2);
    let mut states = [0; 3];
    for _ in 0..2_000 {
        let (r, u, mu, h) = (random.vector(), random.vector(), 0.8, 1e-7);
        let y = r - u;
        let slip = y.y.hypot(y.z);
        // Skip points near the kinks of the Alart-Curnier function, where it has no derivative.
        if y.x.abs() < 1e-3 || (slip - mu * y.x).abs() < 1e-3 {
            continue;
        }
        states[if y.x < 0.0 {
            0
        } else if slip < mu * y.x {
            1
        } else {
            2
        }] += 1;
        let linearised = alart_curnier::linearise(&r, &u, mu);
        for axis in 0..3 {
            let step = Vector3::ith(axis, h);
            let by_r = alart_curnier::value(&(r + step), &u, mu) - alart_curnier::value(&(r - step), &u, mu);
            let by_u = alart_curnier::value(&r, &(u + step), mu) - alart_curnier::value(&r, &(u - step), mu);
            assert!((by_r / (2.0 * h) - linearised.by_r.column(axis)).amax() < 1e-4);
            assert!((by_u / (2.0 * h) - linearised.by_u.column(axis)).amax() < 1e-4);
        }
    }
    assert!(states.iter().all(|&count| count > 100), "{states:?}");
}

#[test]
fn dense_and_sparse_systems_of_blocks_are_solved() {
    // The linear system of a ring of contacts is dense below thirty contacts, sparse above.
    for n in [5, 200] {
        let mut random = Random(3);
        let mut blocks = Vec::new();
        for i in 0..n {
            blocks.push((i, i, Matrix3::identity() * 5.0 + random.matrix()));
            blocks.push((i, (i + 1) % n, random.matrix()));
            blocks.push(((i + 3) % n, i, random.matrix()));
        }
        let matrix = BlockMatrix::from_blocks(n, blocks).expect("indices in range");
        let mut dense = DMatrix::zeros(3 * n, 3 * n);
        for i in 0..n {
            for (j, block) in matrix.row(i) {
                dense.fixed_view_mut::<3, 3>(3 * i, 3 * j).copy_from(block);
            }
        }
        let expected = DVector::from_fn(3 * n, |_, _| random.number());
        let mut x = &dense * &expected;
        let mut system = BlockSystem::new(&matrix).expect("memory");
        assert!(system.factorise(&matrix, |_, _, block| *block));
        assert!(system.solve(x.as_mut_slice()));
        assert!((x - expected).amax() < 1e-12);
        // Another matrix of this block pattern is singular.
        system.factorise(&matrix, |_, _, _| Matrix3::zeros());
        assert!(!system.solve(&mut vec![1.0; 3 * n]));
    }
}

#[test]
fn scaling_makes_unit_diagonals_and_keeps_the_users_residual() {
    let mut random = Random(4);
    let blocks = (0..4).map(|k| {
        let factor = random.matrix();
        (k, k, factor * factor.transpose() * 10_f64.powi(3 * k as i32 - 5))
    });
    let matrix = BlockMatrix::from_blocks(4, blocks.collect::<Vec<_>>()).expect("indices in range");
    let q = (0..4).map(|_| random.vector()).collect();
    let problem = CoulombProblem::new(matrix, q, vec![0.4; 4]).expect("a well-formed problem");
    let r: Vec<_> = (0..4).map(|_| random.vector()).collect();
    let mut scaling = Scaling::default();
    scaling.fit(&problem);
    for k in 0..4 {
        assert!((scaling.problem.matrix().diagonal(k).trace() - 3.0).abs() < 1e-12);
    }
    let scaled: Vec<_> = scaling.scale(&r).collect();
    let (inner, outer) = (Evidence::of(&scaling.problem, &scaled).relative, Evidence::of(&problem, &r).relative);
    assert!((scaling.residual(&scaled).relative - inner.max(outer)).abs() < 1e-14);
    for (back, r) in scaling.unscale(&scaled).zip(&r) {
        assert!((back - r).amax() < 1e-15);
    }
}

#[test]
fn malformed_data_are_refused_with_the_reason() {
    let one = || BlockMatrix::from_blocks(1, []).expect("no indices");
    let zero = vec![Vector3::zeros()];
    assert_eq!(BlockMatrix::from_blocks(1, [(0, 1, Matrix3::zeros())]), None);
    let refused = |q, mu| CoulombProblem::new(one(), q, mu).expect_err("malformed");
    assert_eq!(refused(vec![], vec![0.1]), CoulombProblemError::Shape { contacts: 1, q: 0, mu: 1 });
    assert_eq!(refused(zero.clone(), vec![-0.1]), CoulombProblemError::Coefficient { contact: 0, value: -0.1 });
    assert!(matches!(refused(zero, vec![f64::NAN]), CoulombProblemError::Coefficient { contact: 0, .. }));
    assert_eq!(refused(vec![Vector3::repeat(f64::NAN)], vec![0.1]), CoulombProblemError::NotFinite);
    let read = |offsets: &[usize], columns: &[usize]| {
        CoulombProblem::from_csr(offsets, columns, &vec![1.0; columns.len()], &[0.0; 3], vec![0.1])
    };
    assert!(read(&[0, 1, 2, 3], &[0, 1, 2]).is_ok());
    for (offsets, columns) in [
        (&[0, 1, 2][..], &[0, 1, 2][..]),
        (&[0, 1, 2, 9], &[0, 1, 2]),
        (&[0, 2, 1, 3], &[0, 1, 2]),
        (&[0, 1, 2, 3], &[0, 1, 3]),
    ] {
        assert_eq!(read(offsets, columns), Err(CoulombProblemError::Index { contacts: 1 }));
    }
}
