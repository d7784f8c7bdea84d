//! Comparison of each factorisation with nalgebra's, on matrices with off-diagonal entries that force pivoting.

use super::{Analysis, Cholesky, DenseLu, SparseLu, SparseMatrix};
use faer::sparse::Triplet;
use nalgebra::{Complex, DMatrix, DVector};

/// Returns the entries of an `n x n` matrix on five diagonals, with a zero diagonal entry.
fn band(n: usize) -> Vec<(usize, usize, f64)> {
    let mut entries = Vec::new();
    for i in 0..n {
        for j in i.saturating_sub(2)..(i + 3).min(n) {
            let value = ((3 * i + 7 * j) % 11) as f64 - 4.0 + if i == j { 0.5 } else { 0.0 };
            entries.push((i, j, if (i, j) == (0, 0) { 0.0 } else { value }));
        }
    }
    entries
}

fn sparse(n: usize, entries: &[(usize, usize, f64)]) -> SparseMatrix {
    let triplets: Vec<_> = entries.iter().map(|&(i, j, value)| Triplet::new(i, j, value)).collect();
    SparseMatrix::try_new_from_triplets(n, n, &triplets).expect("places inside the matrix")
}

fn dense(n: usize, entries: &[(usize, usize, f64)]) -> DMatrix<f64> {
    let mut matrix = DMatrix::zeros(n, n);
    entries.iter().for_each(|&(i, j, value)| matrix[(i, j)] += value);
    matrix
}

#[test]
fn sparse_factors_of_one_analysis_solve_real_and_complex_systems() {
    let n = 60;
    let entries = band(n);
    let matrix = sparse(n, &entries);
    let analysis = Analysis::new(matrix.symbolic()).expect("a small pattern");
    let exact = DVector::from_fn(n, |i, _| 1.0 + i as f64);
    let mut right = (dense(n, &entries) * &exact).as_slice().to_vec();
    let mut real = SparseLu::new(&analysis).expect("little memory");
    assert!(real.factorise(&matrix) && real.solve(&mut right));
    assert!((DVector::from_vec(right) - &exact).amax() < 1e-9 * exact.amax());

    let shift = Complex::new(0.3, 2.0);
    let values = entries.iter().map(|&(i, j, v)| Triplet::new(i, j, Complex::new(v, 0.0) * shift));
    let matrix = SparseMatrix::try_new_from_triplets(n, n, &values.collect::<Vec<_>>()).expect("places inside");
    let exact = exact.map(|x| Complex::new(x, -x));
    let mut right = (dense(n, &entries).map(|v| shift * v) * &exact).as_slice().to_vec();
    let mut complex = SparseLu::new(&analysis).expect("little memory");
    assert!(complex.factorise(&matrix) && complex.solve(&mut right));
    assert!(right.iter().zip(exact.iter()).all(|(x, e)| (x - e).norm() < 1e-9 * e.norm()));
}

#[test]
fn a_singular_matrix_is_noticed_by_every_factorisation() {
    let zero_row: Vec<_> = band(8).into_iter().map(|(i, j, v)| (i, j, if i == 3 { 0.0 } else { v })).collect();
    let matrix = sparse(8, &zero_row);
    let analysis = Analysis::new(matrix.symbolic()).expect("a small pattern");
    let mut lu = SparseLu::new(&analysis).expect("little memory");
    assert!(!(lu.factorise(&matrix) && lu.solve(&mut [1.0; 8])));

    let mut lu = DenseLu::new(8);
    lu.entries().copy_from_slice(dense(8, &zero_row).as_slice());
    lu.factorise();
    assert!(!lu.solve(&mut [1.0; 8]));

    let indefinite = sparse(2, &[(0, 0, 1.0), (0, 1, 2.0), (1, 0, 2.0), (1, 1, 1.0)]);
    let mut cholesky = Cholesky::new(&indefinite).expect("little memory");
    assert!(!cholesky.factorise(&indefinite) && !cholesky.solve(&mut [1.0; 2]));
}

#[test]
fn a_matrix_that_is_not_finite_is_refused() {
    let entries: Vec<_> = band(8).into_iter().map(|(i, j, v)| (i, j, if i == j { f64::NAN } else { v })).collect();
    let matrix = sparse(8, &entries);
    let analysis = Analysis::new(matrix.symbolic()).expect("a small pattern");
    assert!(!SparseLu::new(&analysis).expect("little memory").factorise(&matrix));
}

#[test]
fn dense_factors_solve_what_needs_pivoting() {
    for n in [1, 2, 11, 70] {
        let matrix = DMatrix::from_fn(n, n, |i, j| ((7 * i * i + 3 * j * j + i * j + 1) as f64).sin());
        let exact = matrix.clone().lu().solve(&DVector::repeat(n, 1.0)).expect("regular");
        let mut lu = DenseLu::new(n);
        lu.entries().copy_from_slice(matrix.as_slice());
        lu.factorise();
        let mut right = vec![1.0; n];
        assert!(lu.solve(&mut right));
        assert!((DVector::from_vec(right) - &exact).amax() < 1e-8 * exact.amax(), "n = {n}");

        // The system (1 + 2i) A x = (1 + 2i) b has the real solution of A x = b.
        let shift = Complex::new(1.0, 2.0);
        let mut lu = DenseLu::new(n);
        lu.entries().iter_mut().zip(&matrix).for_each(|(entry, &value)| *entry = shift * value);
        lu.factorise();
        let mut right = vec![shift; n];
        assert!(lu.solve(&mut right));
        assert!(right.iter().zip(&exact).all(|(x, e)| (x - e).norm() < 1e-8 * exact.amax()), "complex, n = {n}");
    }
}

#[test]
fn cholesky_solves_a_positive_definite_system() {
    let n = 50;
    let laplacian: Vec<_> = (0..n)
        .flat_map(|i| {
            [
                (i, i, 2.1),
                (i, (i + 7) % n, -0.5),
                ((i + 7) % n, i, -0.5),
                (i, (i + 1) % n, -0.5),
                ((i + 1) % n, i, -0.5),
            ]
        })
        .collect();
    let matrix = sparse(n, &laplacian);
    let exact = DVector::from_fn(n, |i, _| (i as f64).sin());
    let mut right = (dense(n, &laplacian) * &exact).as_slice().to_vec();
    let mut cholesky = Cholesky::new(&matrix).expect("little memory");
    assert!(cholesky.factorise(&matrix) && cholesky.solve(&mut right));
    assert!((DVector::from_vec(right) - exact).amax() < 1e-12);
}

#[test]
fn an_analysis_and_factors_that_take_long_can_be_given_up() {
    let n = 200_000;
    // A dominant diagonal gives solutions to many digits whatever the size.
    let dominant = |(i, j, value)| (i, j, if i == j { 40.0 } else { value });
    let entries: Vec<_> = band(n).into_iter().map(dominant).collect();
    let matrix = sparse(n, &entries);
    assert!(Analysis::new_unless(matrix.symbolic(), || true).is_none());
    let analysis = Analysis::new_unless(matrix.symbolic(), || false).expect("a narrow band");
    let mut lu = SparseLu::new(&analysis).expect("enough memory");
    assert!(lu.factorise_unless(&matrix, || false));
    let mut right = vec![0.0; n];
    entries.iter().for_each(|&(i, _, value)| right[i] += value);
    assert!(lu.solve(&mut right) && right.iter().all(|x| (x - 1.0).abs() < 1e-12));
    // After a stopped factorisation the factors are unusable.
    assert!(!lu.factorise_unless(&matrix, || true) && !lu.solve(&mut right));
    assert!(!lu.factorise_unless(&matrix, || false));
}
