//! Tests of projections onto blocks of `K`, and of their derivatives.

use super::super::{ConvexSet, Derivative, Polyhedron, Shape, Workspace};
use super::*;
use nalgebra::DMatrix;

fn derivative(shape: &Shape, x: &[f64]) -> DMatrix<f64> {
    let k = x.len();
    let mut matrix = DMatrix::zeros(k, k);
    shape.linearise(x, &mut vec![0.0; k], matrix.as_mut_slice(), &mut Default::default());
    matrix
}

proptest! {
    #![proptest_config(ProptestConfig { failure_persistence: None, ..Default::default() })]

    #[test]
    fn the_projection_lies_in_the_set_and_stays((shape, points) in shape_and_points(1)) {
        let p = project(&shape, &points[0]);
        prop_assert!(shape.violation(&p) <= 1e-12 * (1.0 + norm(&points[0])), "outside by {}", shape.violation(&p));
        prop_assert!(norm(&minus(&project(&shape, &p), &p)) <= 1e-12 * (1.0 + norm(&p)));
    }

    /// Tests that `<x - p, y - p> <= 0` for the projection `p` of `x` and all `y` of the set, which only the point of
    /// the set nearest to `x` satisfies.
    #[test]
    fn the_projection_is_the_nearest_point((shape, points) in shape_and_points(20)) {
        let x = &points[0];
        let p = project(&shape, x);
        for y in &points[1..] {
            let y = project(&shape, y);
            prop_assert!(dot(&minus(x, &p), &minus(&y, &p)) <= 1e-11 * (1.0 + norm(x) * norm(&y)));
        }
    }

    #[test]
    fn projections_do_not_expand((shape, points) in shape_and_points(2)) {
        let apart = norm(&minus(&project(&shape, &points[0]), &project(&shape, &points[1])));
        prop_assert!(apart <= norm(&minus(&points[0], &points[1])) + 1e-12);
    }

    #[test]
    fn the_derivative_is_symmetric_with_eigenvalues_between_zero_and_one((shape, points) in shape_and_points(1)) {
        let v = derivative(&shape, &points[0]);
        prop_assert!((&v - v.transpose()).amax() <= 1e-13);
        let eigenvalues = v.symmetric_eigenvalues();
        prop_assert!(eigenvalues.iter().all(|e| (-1e-12..=1.0 + 1e-12).contains(e)), "{eigenvalues}");
    }

    /// Tests that, where forward and backward differences agree so that the projection is smooth, its computed
    /// derivative is their limit.
    #[test]
    fn the_derivative_is_the_limit_of_differences((shape, points) in shape_and_points(1)) {
        let x = &points[0];
        let v = derivative(&shape, x);
        let h = 1e-6;
        let at = |j: usize, step: f64| {
            let mut moved = x.clone();
            moved[j] += step;
            project(&shape, &moved)
        };
        let p = project(&shape, x);
        let smooth = (0..x.len()).all(|j| {
            let (forward, backward) = (minus(&at(j, h), &p), minus(&p, &at(j, -h)));
            norm(&minus(&forward, &backward)) <= 1e-4 * h
        });
        if smooth {
            for j in 0..x.len() {
                let difference = minus(&at(j, h), &at(j, -h));
                for (i, d) in difference.iter().enumerate() {
                    prop_assert!((v[(i, j)] - d / (2.0 * h)).abs() <= 1e-4, "({i}, {j}): {v} {d}");
                }
            }
        }
    }

    /// Tests Moreau's decomposition `x = P_K(x) - P_K*(-x)` with orthogonal parts, for the self-dual second-order cone
    /// `K`.
    #[test]
    fn a_point_is_the_sum_of_its_parts_in_the_cone_and_its_polar(x in proptest::collection::vec(-9.0..9.0_f64, 1..7)) {
        let p = project(&Shape::SecondOrderCone, &x);
        let opposite: Vec<f64> = x.iter().map(|x| -x).collect();
        let q = project(&Shape::SecondOrderCone, &opposite);
        prop_assert!(norm(&minus(&minus(&p, &q), &x)) <= 1e-13 * norm(&x));
        prop_assert!(dot(&p, &q).abs() <= 1e-13 * norm(&x).powi(2));
    }

    /// Tests that a polyhedron with the inequalities of a simplex has the projection of the simplex.
    #[test]
    fn a_polyhedron_agrees_with_the_simplex_that_it_describes(x in proptest::collection::vec(-3.0..3.0_f64, 2..7)) {
        let n = x.len();
        let mut a = vec![1.0; n];
        a.extend(vec![-1.0; n]);
        a.extend((0..n * n).map(|k| if k / n == k % n { -1.0 } else { 0.0 }));
        let mut b = vec![1.0, -1.0];
        b.extend(vec![0.0; n]);
        let polyhedron = Shape::Polyhedron(Polyhedron::new(n, &a, &b).expect("not empty"));
        prop_assert!(norm(&minus(&project(&polyhedron, &x), &project(&Shape::Simplex, &x))) <= 1e-12);
    }

    /// Tests that the support function `sup <d, z>` is an upper bound of `<d, z>`, attained if the set is bounded.
    #[test]
    fn the_support_function_is_a_least_upper_bound((shape, points) in shape_and_points(20)) {
        let d = &points[0];
        let mut work = Default::default();
        let support = shape.support(d, &mut work);
        for y in &points[1..] {
            prop_assert!(dot(d, &project(&shape, y)) <= support + 1e-9 * (1.0 + norm(d) * norm(y)));
        }
        let reached = |scale: f64| dot(d, &project(&shape, &d.iter().map(|d| scale * d).collect::<Vec<f64>>()));
        if support.is_finite() {
            let attained = (2..9).map(|k| reached(10_f64.powi(k))).fold(f64::NEG_INFINITY, f64::max);
            prop_assert!(support - attained <= 1e-3 * (1.0 + norm(d) + support.abs()), "{support} {attained}");
            prop_assert!(!shape.recedes(d) || norm(d) == 0.0);
        } else {
            prop_assert!(reached(1e12) > 1.5 * reached(1e10));
        }
    }
}

#[test]
fn a_product_projects_each_factor_by_itself() {
    let mut set = ConvexSet::intervals(vec![0.0; 6], vec![1.0; 6]);
    set.bind(vec![4, 1], Shape::Ball { radius: 1.0 });
    set.bind(vec![0, 5], Shape::SecondOrderCone);
    let mut x = vec![0.0, 4.0, 7.0, -7.0, 3.0, 2.0];
    let mut v = vec![0.0; 6];
    let mut derivative = Derivative::default();
    derivative.linearise(&set, &mut x, &mut Workspace::default());
    let expected = [1.0, 0.8, 1.0, 0.0, 0.6, 1.0];
    assert!(norm(&minus(&x, &expected)) < 1e-15, "{x:?}");
    // The derivative of the projection onto a ball vanishes in the radial direction; that onto the cone halves a
    // vector along its axis.
    derivative.apply(&set, &[1.0, 4.0, 1.0, 1.0, 3.0, 0.0], &mut v);
    assert!(norm(&minus(&v, &[0.5, 0.0, 0.0, 0.0, 0.0, 0.5])) < 1e-15, "{v:?}");
}

#[test]
fn not_a_number_stays_in_its_block() {
    let mut set = ConvexSet::free(5);
    set.bind(vec![0, 1], Shape::Simplex);
    set.bind(vec![2, 3], Shape::Ball { radius: 1.0 });
    let mut x = [f64::NAN, 0.0, 0.5, 0.0, 1.0];
    set.project_all(&mut x, &mut Workspace::default());
    assert!(x[0].is_nan() && x[1].is_nan());
    assert_eq!(x[2..], [0.5, 0.0, 1.0]);
    assert!(set.natural_residual(&[0.0, 1.0, f64::NAN, 0.0, 0.0], &[0.0; 5]).is_nan());
}

#[test]
fn an_empty_polyhedron_is_refused() {
    assert!(Polyhedron::new(1, &[1.0, -1.0], &[0.0, -1.0]).is_none());
    assert!(Polyhedron::new(2, &[0.0, 0.0], &[-1.0]).is_none());
    assert!(Polyhedron::new(2, &[1.0, f64::NAN], &[1.0]).is_none());
    assert!(Polyhedron::new(2, &[0.0, 0.0], &[0.0]).is_some_and(|set| set.rows() == 0));
}
