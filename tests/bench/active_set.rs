//! Time per implicit Euler step of a parabolic obstacle problem in one and two dimensions: `(I - dt Laplacian) u >=
//! u_old` above an obstacle that moves at each step. `cargo bench -p dvi-vi --bench active_set`.

use divan::{Bencher, black_box};
use factorisation::SparseMatrix;
use faer::sparse::Triplet;
use problem::{Control, ConvexSet};
use vi::ActiveSet;

const DT: f64 = 1e-3;

fn main() {
    divan::main();
}

/// Returns the matrix `I - dt Laplacian` on the unit interval or square, with zero boundary values.
fn matrix(rows: usize, columns: usize) -> SparseMatrix {
    let c = DT * ((columns + 1) as f64).powi(2);
    let n = rows * columns;
    let directions = if rows > 1 { 4.0 } else { 2.0 };
    let mut triplets = Vec::with_capacity(5 * n);
    for node in 0..n {
        triplets.push(Triplet::new(node, node, 1.0 + directions * c));
        let mut join = |other: usize| {
            triplets.push(Triplet::new(node, other, -c));
            triplets.push(Triplet::new(other, node, -c));
        };
        if node % columns + 1 < columns {
            join(node + 1);
        }
        if node + columns < n {
            join(node + columns);
        }
    }
    SparseMatrix::try_new_from_triplets(n, n, &triplets).expect("places inside the matrix")
}

/// Sets the obstacle at the time `t`: a paraboloid whose top oscillates through the domain.
fn obstacle(rows: usize, columns: usize, t: f64, lower: &mut [f64]) {
    let top = 0.5 + 0.2 * (20.0 * t).sin();
    for (node, lower) in lower.iter_mut().enumerate() {
        let x = (node % columns + 1) as f64 / (columns + 1) as f64 - top;
        let y = (node / columns + 1) as f64 / (rows + 1) as f64 - 0.5;
        *lower = 0.3 - 4.0 * (x * x + y * y);
    }
}

/// Solves one time step after another, with the obstacle evaluated outside the measured time.
fn run(bencher: Bencher, rows: usize, columns: usize) {
    let n = rows * columns;
    let mut solver =
        ActiveSet::on_grid(&matrix(rows, columns), &[rows, columns], &Control::new()).expect("an M-matrix");
    let mut u = vec![0.0; n];
    let mut q = vec![0.0; n];
    let mut set = ConvexSet::nonnegative(n);
    let mut t = 0.0;
    let mut steps = Vec::new();
    for _ in 0..24 {
        t += DT;
        let mut lower = vec![0.0; n];
        obstacle(rows, columns, t, &mut lower);
        steps.push(lower);
    }
    let mut turn = 0;
    let (mut most, mut sum, mut solves) = (0, 0, 0);
    bencher.bench_local(|| {
        // The obstacles of successive times are taken forwards and then backwards, so that every step starts from the
        // solution at a neighbouring time.
        turn = (turn + 1) % (2 * steps.len());
        set.lower.copy_from_slice(&steps[turn.min(2 * steps.len() - 1 - turn)]);
        q.iter_mut().zip(&u).for_each(|(q, u)| *q = -u);
        let report = black_box(solver.solve(&q, &set, &mut u, &Control::new()));
        (most, sum, solves) = (most.max(report.iterations), sum + report.iterations, solves + 1);
    });
    println!("{:.1} steps of the active set a solve, at most {most}", sum as f64 / f64::from(solves));
}

#[divan::bench(args = [10_000, 100_000, 1_000_000], sample_count = 20)]
fn string(bencher: Bencher, n: usize) {
    run(bencher, 1, n);
}

#[divan::bench(args = [100, 316], sample_count = 10)]
fn membrane(bencher: Bencher, nodes: usize) {
    run(bencher, nodes, nodes);
}
