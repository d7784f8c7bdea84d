//! Problems on which pivoting could cycle, take exponentially long or lose digits.

use super::*;

#[test]
fn murtys_family_is_solved_though_its_paths_grow_exponentially() {
    // Murty 1978, Computational complexity of complementary pivot methods: M is upper triangular with 1 on the
    // diagonal and 2 above. With q_i = 2^i - 2^m only the last variable is nonzero: z_m = 2^(m-1), and w_i = 2^i for
    // the others.
    for m in 1..=12_u8 {
        let power = |k: u8| 2.0_f64.powi(i32::from(k));
        let size = usize::from(m);
        let matrix = DMatrix::from_fn(size, size, |i, j| match i.cmp(&j) {
            std::cmp::Ordering::Equal => 1.0,
            std::cmp::Ordering::Less => 2.0,
            std::cmp::Ordering::Greater => 0.0,
        });
        let problem = Problem::complementarity(matrix, (0..m).map(|i| power(i) - power(m)).collect());
        let mut exact = vec![0.0; size];
        exact[size - 1] = power(m - 1);
        for z in problem.solve_by_all() {
            assert!(largest_difference(&z, &exact) < 1e-9, "{z:?}");
        }
        let report = problem.solve(&mut Lemke::new(size), &mut vec![0.0; size]);
        assert_eq!(report.iterations, 1 << m);
    }
}

#[test]
fn kostrevas_example_does_not_cycle() {
    // Kostreva 1979, Cycling in linear complementarity problems: all ratios tie, and plain pivoting rules cycle. The
    // row sums are three, so z = (1, 1, 1) / 3.
    let matrix = DMatrix::from_row_slice(3, 3, &[1.0, 2.0, 0.0, 0.0, 1.0, 2.0, 2.0, 0.0, 1.0]);
    for z in Problem::complementarity(matrix, vec![-1.0; 3]).solve_by_all() {
        assert!(largest_difference(&z, &[1.0 / 3.0; 3]) < 1e-14, "{z:?}");
    }
}

#[test]
fn a_row_in_a_small_unit_is_solved_beside_one_in_a_large_unit() {
    // Two rows in very different units: for z = 0 the residual of the first row is 1e-15 of the terms of the second
    // row.
    let matrix = DMatrix::from_row_slice(2, 2, &[1e-14, 8.0, 0.0, 1.0]);
    for z in Problem::complementarity(matrix, vec![-2.5e-11, 4775.0]).solve_by_all() {
        assert!(largest_difference(&z, &[2500.0, 0.0]) < 1e-9, "{z:?}");
    }
}

#[test]
fn contacts_that_share_a_body_have_one_motion() {
    // For w = J (J^T z + v) the impulses z are not unique, whereas the velocity J^T z + v is (strict convexity in the
    // velocity).
    let mut random = Random(3);
    for m in [2, 3, 4, 6, 10, 20, 50, 100] {
        for _ in 0..if m > 20 { 3 } else { 40 } {
            let j = random.matrix(m, m.div_ceil(2));
            let v = DVector::from_vec(random.vector(j.ncols()));
            let q = (&j * &v).as_slice().to_vec();
            let problem = Problem::complementarity(&j * j.transpose(), q);
            let velocities: Vec<_> =
                problem.solve_by_all().iter().map(|z| j.tr_mul(&DVector::from_column_slice(z)) + &v).collect();
            assert!((&velocities[0] - &velocities[1]).amax() < 1e-5, "m = {m}");
        }
    }
}

#[test]
fn ties_in_every_ratio_do_not_cycle() {
    // In a problem of identical copies of one contact, the ratios tie at every pivot.
    for m in [2, 5, 20, 80] {
        let problem = Problem::complementarity(DMatrix::from_element(m, m, 1.0), vec![-1.0; m]);
        for z in problem.solve_by_all() {
            assert!((z.iter().sum::<f64>() - 1.0).abs() < 1e-10);
        }
    }
}

#[test]
fn a_right_hand_side_of_zeros_ties_at_zero() {
    let mut random = Random(4);
    for m in [3, 10, 30] {
        let mut q = vec![0.0; m];
        q[m / 2] = -1.0;
        let problem = Problem::complementarity(random.positive_definite(m), q);
        let answers = problem.solve_by_all();
        assert!(largest_difference(&answers[0], &answers[1]) < 1e-8);
    }
}

#[test]
fn an_obstacle_is_touched_where_the_exact_string_touches_it() {
    // The string of -u'' = -1, u >= -1/16 on (0, 1), u = 0 at the ends, is u = x^2/2 - a x with a^2 / 2 = 1/16 down
    // to x = a, and flat between a and 1 - a (a = sqrt(1/8)). Differences of second order are exact on parabolas, so
    // only the position a has an error, of up to a mesh width.
    for m in [63, 255] {
        let h = 1.0 / (m + 1) as f64;
        let matrix = DMatrix::from_fn(m, m, |i, j| match i.abs_diff(j) {
            0 => 2.0 / (h * h),
            1 => -1.0 / (h * h),
            _ => 0.0,
        });
        let set = ConvexSet::intervals(vec![-1.0 / 16.0; m], vec![INFINITY; m]);
        let a = 0.125_f64.sqrt();
        let exact: Vec<f64> = (1..=m)
            .map(|i| (i as f64 * h).min(1.0 - i as f64 * h))
            .map(|x| if x < a { x * x / 2.0 - a * x } else { -1.0 / 16.0 })
            .collect();
        for u in Problem::new(matrix, vec![1.0; m], set).solve_by_all() {
            assert!(largest_difference(&u, &exact) < h * h, "m = {m}");
        }
    }
}

#[test]
fn rows_and_columns_of_any_size_are_solved_each_to_its_own_digits() {
    let mut random = Random(5);
    for m in [2, 5, 20, 60] {
        for _ in 0..10 {
            let (tame, set) = (random.nonsymmetric_p(m), random.intervals(m));
            let well_scaled = Problem::new(tame, random.vector(m), set);
            let exact = well_scaled.solve_exactly(&mut Lemke::new(m));
            let rows: Vec<f64> = random.vector(m).iter().map(|x| 10.0_f64.powf(4.5 * x)).collect();
            let columns: Vec<f64> = random.vector(m).iter().map(|x| 10.0_f64.powf(4.5 * x)).collect();
            let mut wild = well_scaled.clone();
            for i in 0..m {
                wild.q[i] *= rows[i];
                wild.set.lower[i] /= columns[i];
                wild.set.upper[i] /= columns[i];
            }
            wild.matrix = DMatrix::from_fn(m, m, |i, j| wild.matrix[(i, j)] * rows[i] * columns[j]);
            for z in wild.solve_by_all() {
                let z: Vec<f64> = z.iter().zip(&columns).map(|(z, c)| z * c).collect();
                assert!(largest_difference(&z, &exact) < 1e-7 * (1.0 + largest_difference(&exact, &vec![0.0; m])));
            }
        }
    }
}

#[test]
fn a_small_force_is_not_lost_beside_a_large_one() {
    // Two decoupled problems, one with |q| = 1e9, the other with 1e-5; the second row contains a tenth of the third
    // variable.
    let mut matrix = DMatrix::identity(4, 4);
    matrix[(1, 2)] = 0.1;
    for z in Problem::complementarity(matrix, vec![1e9, -1e-5, -1e-6, -1e9]).solve_by_all() {
        for (z, exact) in z.iter().zip([0.0, 0.99e-5, 1e-6, 1e9]) {
            assert!((z - exact).abs() <= 1e-12 * exact, "{z} instead of {exact}");
        }
    }
}
