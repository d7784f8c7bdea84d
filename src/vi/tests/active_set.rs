//! Tests of the active set method: obstacle problems with known solutions, agreement with Lemke's method, cycles and
//! singular matrices.

use super::super::{ActiveSet, Unsuitable};
use super::*;
use factorisation::SparseMatrix;
use faer::sparse::Triplet;
use problem::Shape;

fn sparse(n: usize, entries: impl Iterator<Item = (usize, usize, f64)>) -> SparseMatrix {
    let triplets: Vec<_> = entries.map(|(i, j, value)| Triplet::new(i, j, value)).collect();
    SparseMatrix::try_new_from_triplets(n, n, &triplets).expect("places inside the matrix")
}

fn from_dense(matrix: &DMatrix<f64>) -> SparseMatrix {
    let n = matrix.nrows();
    sparse(n, (0..n * n).map(|k| (k % n, k / n, matrix[k])).filter(|&(_, _, value)| value != 0.0))
}

/// Returns the matrix `shift I - c Laplacian` on a grid of unit spacing with zero values around it.
fn laplacian(shape: [usize; 2], c: f64, shift: f64) -> SparseMatrix {
    let [rows, columns] = shape;
    let mut entries = Vec::new();
    for node in 0..rows * columns {
        let (i, j) = (node / columns, node % columns);
        let directions = 2.0 * (f64::from(u8::from(rows > 1)) + f64::from(u8::from(columns > 1)));
        entries.push((node, node, shift + directions * c));
        for (there, other) in [
            (i > 0, node.wrapping_sub(columns)),
            (i + 1 < rows, node + columns),
            (j > 0, node.wrapping_sub(1)),
            (j + 1 < columns, node + 1),
        ] {
            if there {
                entries.push((node, other, -c));
            }
        }
    }
    sparse(rows * columns, entries.into_iter())
}

fn above(obstacle: Vec<f64>) -> ConvexSet {
    let upper = vec![INFINITY; obstacle.len()];
    ConvexSet::intervals(obstacle, upper)
}

fn solve(solver: &mut ActiveSet, q: &[f64], set: &ConvexSet) -> (Vec<f64>, Report) {
    let mut z = vec![0.0; q.len()];
    let report = solver.solve(q, set, &mut z, &Control::new());
    assert_eq!(report.outcome, Outcome::Solved, "{report:?}");
    (z, report)
}

#[test]
fn a_string_lies_on_a_parabola_between_its_tangents_from_the_ends() {
    // With the obstacle phi(x) = a - (x - 1/2)^2, the line from (0, 0) touches it at c with phi(c) = c phi'(c): c^2 =
    // 1/4 - a.
    let (a, n) = (0.1, 999);
    let h = 1.0 / (n + 1) as f64;
    let phi = |x: f64| a - (x - 0.5) * (x - 0.5);
    let c = (0.25_f64 - a).sqrt();
    let slope = phi(c) / c;
    let x = |i: usize| (i + 1) as f64 * h;
    let set = above((0..n).map(|i| phi(x(i))).collect());
    let mut solver = ActiveSet::new(&laplacian([1, n], 1.0 / (h * h), 0.0)).expect("an M-matrix");
    let (z, _) = solve(&mut solver, &vec![0.0; n], &set);
    for (i, z) in z.iter().enumerate() {
        let exact = if x(i).min(1.0 - x(i)) < c { slope * x(i).min(1.0 - x(i)) } else { phi(x(i)) };
        // The node of first contact is off by less than h, which is an error of second order along a tangent.
        assert!((z - exact).abs() < h * h, "{z} instead of {exact} at {}", x(i));
    }
}

#[test]
fn a_string_of_a_million_nodes_lies_flat_where_the_exact_one_does() {
    // The problem -u'' = -1, u >= -1/16, u = 0 at the ends, times h^2, has the solution u = x^2/2 - a x down to x =
    // a = sqrt(1/8), and is flat beyond.
    let n = 1_000_000;
    let h = 1.0 / (n + 1) as f64;
    let mut solver = ActiveSet::new(&laplacian([1, n], 1.0, 0.0)).expect("an M-matrix");
    let (u, report) = solve(&mut solver, &vec![h * h; n], &above(vec![-1.0 / 16.0; n]));
    assert_eq!(report.outcome, Outcome::Solved, "{report:?}");
    let a = 0.125_f64.sqrt();
    for (i, u) in u.iter().enumerate() {
        let x = ((i + 1) as f64 * h).min(1.0 - (i + 1) as f64 * h);
        let exact = if x < a { x * x / 2.0 - a * x } else { -1.0 / 16.0 };
        // A rounding error of 1e-17 in each of a n equations moves the string by at most (a n)^2 / 8 times this error:
        // 2e-7.
        assert!((u - exact).abs() < 1e-6, "{u} instead of {exact} at {x}");
    }
}

/// Solves for a membrane over a hemisphere, with the boundary values of the solution in the plane around the square
/// (-2, 2)^2; returns the largest error and the radius of contact (Bueler 2021, `PETSc` for partial differential
/// equations, section 12.3).
fn membrane(nodes: usize) -> (f64, f64) {
    const RADIUS: f64 = 0.697_965_148_223_374;
    const A: f64 = 0.680_259_411_891_719;
    const B: f64 = 0.471_519_893_402_112;
    let phi = |r: f64| if r < 0.9 { (1.0 - r * r).sqrt() } else { 0.19_f64.sqrt() - 0.9 / 0.19_f64.sqrt() * (r - 0.9) };
    let exact = |r: f64| if r < RADIUS { phi(r) } else { B - A * r.ln() };
    let h = 4.0 / (nodes + 1) as f64;
    let r = |i: usize, j: usize| (i as f64 * h - 2.0).hypot(j as f64 * h - 2.0);
    let n = nodes * nodes;
    let place = |k: usize| (k / nodes + 1, k % nodes + 1);
    let q: Vec<f64> = (0..n)
        .map(|k| {
            let (i, j) = place(k);
            let around = [(i - 1, j), (i + 1, j), (i, j - 1), (i, j + 1)];
            let outside = around.iter().filter(|(i, j)| [*i, *j].iter().any(|&p| p == 0 || p == nodes + 1));
            -outside.map(|&(i, j)| exact(r(i, j))).sum::<f64>()
        })
        .collect();
    let set = above((0..n).map(|k| phi(r(place(k).0, place(k).1))).collect());
    let mut solver = ActiveSet::on_grid(&laplacian([nodes, nodes], 1.0, 0.0), &[nodes, nodes], &Control::new())
        .expect("an M-matrix");
    let (z, _) = solve(&mut solver, &q, &set);
    let error = z.iter().enumerate().map(|(k, z)| (z - exact(r(place(k).0, place(k).1))).abs()).fold(0.0, f64::max);
    let touching = z.iter().zip(&set.lower).filter(|(z, phi)| z == phi).count();
    (error, (touching as f64 * h * h / std::f64::consts::PI).sqrt())
}

#[test]
fn a_membrane_over_a_hemisphere_touches_it_to_the_known_radius_with_order_two() {
    // The position of the free boundary between grid nodes determines the factor of h^2 in the error.
    for nodes in [15, 31, 57, 80, 127, 200] {
        let h = 4.0 / (nodes + 1) as f64;
        let (error, radius) = membrane(nodes);
        assert!(error < 0.45 * h * h, "{nodes} nodes: {} h^2", error / (h * h));
        assert!((radius - 0.697_965_148_223_373_5).abs() < 0.5 * h, "{nodes} nodes: {radius}");
    }
}

/// Returns a random M-matrix: nonpositive off the diagonal, and diagonally dominant by rows.
fn m_matrix(random: &mut Random, n: usize, symmetric: bool, tridiagonal: bool) -> DMatrix<f64> {
    let mut matrix = DMatrix::zeros(n, n);
    for i in 0..n {
        for j in 0..i {
            let is_near = if tridiagonal { i == j + 1 } else { random.number() > 0.7 };
            if is_near {
                matrix[(i, j)] = -random.number().abs();
                matrix[(j, i)] = if symmetric { matrix[(i, j)] } else { -random.number().abs() };
            }
        }
    }
    for i in 0..n {
        matrix[(i, i)] = 0.01 - matrix.row(i).sum();
    }
    matrix
}

#[test]
fn random_m_matrices_over_intervals_of_every_kind_agree_with_lemke() {
    let mut random = Random(7);
    for case in 0..200 {
        let n = 1 + case % 37;
        let matrix = m_matrix(&mut random, n, case % 2 == 0, case % 3 == 0);
        let set = if case % 5 == 0 { ConvexSet::nonnegative(n) } else { random.intervals(n) };
        let q = random.vector(n);
        let (z, _) = solve(&mut ActiveSet::new(&from_dense(&matrix)).expect("an M-matrix"), &q, &set);
        let exact = Problem::new(matrix, q, set).solve_exactly(&mut Lemke::new(n));
        let size = exact.iter().fold(1.0_f64, |size, z| size.max(z.abs()));
        assert!(largest_difference(&z, &exact) < 1e-9 * size, "case {case}: {z:?} instead of {exact:?}");
    }
}

#[test]
fn matrices_for_which_the_active_set_alone_is_no_method_agree_with_lemke() {
    let mut random = Random(11);
    for case in 0..60 {
        let n = 2 + case % 29;
        let matrix = if case % 2 == 0 { random.nonsymmetric_p(n) } else { random.positive_definite(n) };
        let set = if case % 3 == 0 { ConvexSet::nonnegative(n) } else { random.intervals(n) };
        let q = random.vector(n);
        let (z, _) = solve(&mut ActiveSet::new(&from_dense(&matrix)).expect("a P-matrix"), &q, &set);
        let exact = Problem::new(matrix, q, set).solve_exactly(&mut Lemke::new(n));
        let size = exact.iter().fold(1.0_f64, |size, z| size.max(z.abs()));
        assert!(largest_difference(&z, &exact) < 1e-7 * size, "case {case}");
    }
}

#[test]
fn the_shortest_cycle_is_left() {
    // In the example of Ben Gharbia and Gilbert 2012 for a > 1, the active sets return to the first after three
    // steps; the solution is z = 1 / (1 + a).
    let a = 3.0;
    let matrix = DMatrix::from_row_slice(3, 3, &[1.0, a, 0.0, 0.0, 1.0, a, a, 0.0, 1.0]);
    let mut solver = ActiveSet::new(&from_dense(&matrix)).expect("a P-matrix");
    let mut z = vec![1.0, 0.0, 0.0];
    let report = solver.solve(&[-1.0; 3], &ConvexSet::nonnegative(3), &mut z, &Control::new());
    assert_eq!(report.outcome, Outcome::Solved);
    assert!(largest_difference(&z, &[0.25; 3]) < 1e-12, "{z:?}");
    assert!(report.iterations > 3, "{report:?}: the first sets are a cycle");
}

#[test]
fn a_matrix_that_only_contact_makes_regular_is_solved() {
    // A string with free ends is supported by the obstacle only: one node carries the whole load.
    let n = 101;
    let mut random = Random(3);
    let edges = (0..n - 1).flat_map(|i| [(i, i, 1.0), (i + 1, i + 1, 1.0), (i, i + 1, -1.0), (i + 1, i, -1.0)]);
    let line = sparse(n, edges);
    let chord = sparse(
        n,
        line.triplet_iter().map(|e| (e.row, e.col, *e.val)).chain([
            (0, n - 1, -1.0),
            (n - 1, 0, -1.0),
            (0, 0, 1.0),
            (n - 1, n - 1, 1.0),
        ]),
    );
    for matrix in [line, chord] {
        let q = vec![1e-3; n];
        let set = above(random.vector(n));
        let (z, _) = solve(&mut ActiveSet::new(&matrix).expect("a positive diagonal"), &q, &set);
        let mut dense = DMatrix::zeros(n, n);
        matrix.triplet_iter().for_each(|entry| dense[(entry.row, entry.col)] = *entry.val);
        let exact = Problem::new(dense, q, set).solve_exactly(&mut Lemke::new(n));
        assert!(largest_difference(&z, &exact) < 1e-9);
    }
}

/// Returns a bump that has moved by `s` over a string or membrane of `shape`, and a load that presses the string
/// down.
fn moving_front(shape: [usize; 2], s: f64) -> (Vec<f64>, ConvexSet) {
    let [rows, columns] = shape;
    let lower = (0..rows * columns).map(|node| {
        let x = (node % columns + 1) as f64 / (columns + 1) as f64;
        let y = (node / columns + 1) as f64 / (rows + 1) as f64;
        0.2 - 4.0 * ((x - 0.4 - s).powi(2) + (y - 0.5).powi(2))
    });
    (vec![1e-5; rows * columns], above(lower.collect()))
}

#[test]
fn cold_warm_and_guessed_starts_end_at_the_same_point() {
    for shape in [[1, 400], [23, 30]] {
        let matrix = laplacian(shape, 40.0, 1.0);
        let mut warm = ActiveSet::new(&matrix).expect("an M-matrix");
        let mut guessed = ActiveSet::on_grid(&matrix, &shape, &Control::new()).expect("an M-matrix");
        for step in 0..6 {
            let (q, set) = moving_front(shape, 0.03 * f64::from(step));
            let cold = solve(&mut ActiveSet::new(&matrix).expect("an M-matrix"), &q, &set).0;
            assert!(largest_difference(&cold, &solve(&mut warm, &q, &set).0) < 1e-13);
            assert!(largest_difference(&cold, &solve(&mut guessed, &q, &set).0) < 1e-13);
        }
    }
}

#[test]
fn a_front_that_moves_far_costs_few_steps_at_any_size() {
    for (shape, jump) in [([1, 1_000], 0.1), ([1, 30_000], 0.1), ([60, 60], 0.2), ([120, 121], 0.2)] {
        let c = (shape[1] * shape[1]) as f64 * 1e-3;
        let mut solver = ActiveSet::on_grid(&laplacian(shape, c, 1.0), &shape, &Control::new()).expect("an M-matrix");
        for step in 0..4 {
            let (q, set) = moving_front(shape, jump * f64::from(step));
            let report = solve(&mut solver, &q, &set).1;
            assert!(report.iterations <= 10, "{shape:?}: {report:?}");
        }
    }
}

#[test]
fn an_unchanged_active_set_costs_one_step() {
    let shape = [40, 40];
    let mut solver = ActiveSet::on_grid(&laplacian(shape, 100.0, 1.0), &shape, &Control::new()).expect("an M-matrix");
    let (mut q, set) = moving_front(shape, 0.0);
    solve(&mut solver, &q, &set);
    q.iter_mut().for_each(|q| *q *= 1.0 + 1e-9);
    assert_eq!(solve(&mut solver, &q, &set).1.iterations, 1);
}

#[test]
fn the_scale_of_a_problem_changes_nothing() {
    let shape = [15, 15];
    let (q, set) = moving_front(shape, 0.1);
    let reference = solve(&mut ActiveSet::new(&laplacian(shape, 1.0, 1e-3)).expect("an M-matrix"), &q, &set).0;
    for scale in [1e-150, 1e-12, 1e12, 1e150] {
        let mut solver = ActiveSet::new(&laplacian(shape, scale, 1e-3 * scale)).expect("an M-matrix");
        let q: Vec<f64> = q.iter().map(|q| q * scale).collect();
        assert!(largest_difference(&solve(&mut solver, &q, &set).0, &reference) < 1e-12);
    }
}

#[test]
fn what_has_no_solution_or_no_meaning_is_refused() {
    let matrix = laplacian([1, 4], 1.0, 0.0);
    let mut solver = ActiveSet::new(&matrix).expect("an M-matrix");
    let mut refused = |q: &[f64], lower: f64, upper: f64| {
        let set = ConvexSet::intervals(vec![lower; q.len()], vec![upper; q.len()]);
        let report = solver.solve(q, &set, &mut vec![0.0; q.len()], &Control::new());
        report.outcome == Outcome::Breakdown && report.residual.is_nan()
    };
    assert!(refused(&[0.0; 4], 1.0, 0.0));
    assert!(refused(&[0.0; 4], f64::NAN, 0.0));
    assert!(refused(&[0.0; 4], INFINITY, INFINITY));
    assert!(refused(&[0.0, f64::NAN, 0.0, 0.0], 0.0, 1.0));
    assert!(refused(&[0.0; 3], 0.0, 1.0));
    assert!(!refused(&[0.0; 4], 0.0, 1.0));

    let mut disk = ConvexSet::free(4);
    disk.bind(vec![0, 1], Shape::Ball { radius: 1.0 });
    assert_eq!(solver.solve(&[0.0; 4], &disk, &mut [0.0; 4], &Control::new()).outcome, Outcome::Unsuitable);

    let zero = sparse(2, [(0, 0, 1.0), (1, 0, 1.0)].into_iter());
    assert_eq!(ActiveSet::new(&zero).err(), Some(Unsuitable::Diagonal { row: 1, value: 0.0 }));
    let wrong = ActiveSet::on_grid(&matrix, &[2, 3], &Control::new()).err();
    assert_eq!(wrong, Some(Unsuitable::Shape { rows: 4, columns: 4, expected: 6 }));
}

#[test]
fn a_problem_without_a_solution_ends_honestly() {
    // The values w_1 = z_1 - z_2 - 1 and w_2 = z_2 - z_1 + 1/2 have the sum -1/2, and are never both nonnegative.
    let matrix = sparse(2, [(0, 0, 1.0), (0, 1, -1.0), (1, 0, -1.0), (1, 1, 1.0)].into_iter());
    let mut solver = ActiveSet::new(&matrix).expect("a positive diagonal");
    let report = solver.solve(&[-1.0, 0.5], &ConvexSet::nonnegative(2), &mut [0.0; 2], &Control::new());
    assert_ne!(report.outcome, Outcome::Solved);
    assert!(report.residual > 0.0);
}
