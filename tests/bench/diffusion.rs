//! Run time of a diffusion chain, `x_i' = c (x_{i-1} - 2 x_i + x_{i+1})`, with up to 1e5 states, and for comparison
//! the time of its factorisations and solves alone. `cargo bench -p dvi-models --bench diffusion`.

use divan::{Bencher, black_box};
use expression::Graph;
use factorisation::{Analysis, SparseLu, SparseMatrix};
use faer::sparse::Triplet;
use hybrid::OneStep;
use mimalloc::MiMalloc;
use models::{Linear, LinearRows};
use nalgebra::Complex;
use problem::{Control, ConvexSet, Mass};
use radau::{Radau, RejectionCause, Settings, StageChoice, Switches, Tableau, Work};
use std::f64::consts::PI;
use vi::SolverKind;

/// The memory allocator that the `dvi` program uses.
#[global_allocator]
static ALLOCATOR: MiMalloc = MiMalloc;

const END: f64 = 0.1;

fn main() {
    divan::main();
}

/// Returns the nonzeros of the matrix `A` of the diffusion chain, on an interval of unit length with zero values at its
/// ends.
fn entries(n: usize) -> Vec<(usize, usize, f64)> {
    let c = ((n + 1) as f64).powi(2);
    let row = |i: usize| [(i, i.wrapping_sub(1), c), (i, i, -2.0 * c), (i, i + 1, c)];
    (0..n).flat_map(row).filter(|&(_, j, _)| j < n).collect()
}

fn problem(n: usize) -> Linear {
    let mut graph = Graph::new();
    let zero = graph.constant(0.0);
    let rows = LinearRows {
        mass: Mass::Identity,
        matrix: entries(n),
        parametric: Vec::new(),
        state_forcing: vec![zero; n],
        inequality_forcing: Vec::new(),
        set: ConvexSet::free(0),
        moving: Vec::new(),
    };
    Linear::new(&mut graph, rows).unwrap_or_else(|error| panic!("{error:?}"))
}

fn settings(n: usize) -> Settings {
    Settings {
        stages: StageChoice::Fixed(3),
        rtol: 1e-6,
        atol: vec![1e-9; n],
        step: None,
        first_step: None,
        max_step: f64::INFINITY,
        min_step: 0.0,
        interpolated: false,
        switches: Switches::Locate,
        vi_solver: SolverKind::Auto,
        vi_tolerance: 1e-10,
    }
}

/// Returns initial values composed of two sine waves, the faster of which decays at once.
fn start(n: usize) -> Vec<f64> {
    let x = |i: usize| (i + 1) as f64 / (n + 1) as f64;
    (0..n).map(|i| (PI * x(i)).sin() + (20.0 * PI * x(i)).sin()).collect()
}

/// Integrates the chain to the end time; returns the work counters, and the number of solves with the real matrix for
/// the error estimate.
fn integrate(problem: &mut Linear, x: &[f64]) -> (Work, u64) {
    let control = Control::new();
    let mut radau = Radau::new(problem, settings(x.len()), 0.0, x, END, &control).expect("a start");
    while !radau.is_done() {
        radau.step().expect("a step");
    }
    let h = 1.0 / (x.len() + 1) as f64;
    let rate = (2.0 / h * (0.5 * PI * h).sin()).powi(2);
    let middle = x.len() / 2;
    let exact = (PI * (middle + 1) as f64 * h).sin() * (-rate * END).exp();
    assert!((radau.y()[middle] - exact).abs() < 1e-5, "{} instead of {exact}", radau.y()[middle]);
    (radau.work(), radau.counts.accepted + radau.counts.rejected(RejectionCause::Error))
}

/// Returns the real and the complex iteration matrix of Radau IIA for a step of size 1e-3.
fn matrices(n: usize) -> (SparseMatrix, SparseMatrix<Complex<f64>>) {
    let tableau = Tableau::of(3);
    let (gamma, pair) = (tableau.gamma.expect("three stages") * 1e3, tableau.pairs[0] * 1e3);
    let real = entries(n).into_iter().map(|(i, j, a)| Triplet::new(i, j, if i == j { gamma - a } else { -a }));
    let complex = real.clone().map(|entry| {
        let shift = if entry.row == entry.col { pair - gamma } else { Complex::new(0.0, 0.0) };
        Triplet::new(entry.row, entry.col, shift + entry.val)
    });
    let real = SparseMatrix::try_new_from_triplets(n, n, &real.collect::<Vec<_>>());
    let complex = SparseMatrix::try_new_from_triplets(n, n, &complex.collect::<Vec<_>>());
    (real.expect("places inside"), complex.expect("places inside"))
}

/// Performs as many factorisations and solves as a run with the given work counters, and nothing else.
fn factor_and_solve(
    (real, complex): &(SparseMatrix, SparseMatrix<Complex<f64>>),
    (work, estimates): (Work, u64),
) -> (Vec<f64>, Vec<Complex<f64>>) {
    let n = real.nrows();
    let analysis = Analysis::new(real.symbolic()).expect("memory");
    let mut lu = SparseLu::new(&analysis).expect("memory");
    let mut complex_lu = SparseLu::new(&analysis).expect("memory");
    let (mut right, mut complex_right) = (vec![1.0; n], vec![Complex::new(1.0, 0.0); n]);
    for _ in 0..work.factorisations {
        assert!(lu.factorise(real) && complex_lu.factorise(complex));
    }
    for _ in 0..work.newton + estimates {
        assert!(lu.solve(&mut right));
    }
    for _ in 0..work.newton {
        assert!(complex_lu.solve(&mut complex_right));
    }
    (right, complex_right)
}

const SIZES: [usize; 3] = [1_000, 10_000, 100_000];

#[divan::bench(args = SIZES, sample_count = 5, sample_size = 1)]
fn run(bencher: Bencher, n: usize) {
    let (problem, x) = (problem(n), start(n));
    bencher.with_inputs(|| problem.clone()).bench_local_values(|mut problem| integrate(&mut problem, &x));
}

#[divan::bench(args = SIZES, sample_count = 5, sample_size = 1)]
fn factors_and_solutions_alone(bencher: Bencher, n: usize) {
    let (matrices, counted) = (matrices(n), integrate(&mut problem(n), &start(n)));
    bencher.bench_local(|| black_box(factor_and_solve(black_box(&matrices), counted)));
}
