//! Time to solve one variational inequality, by solver and size: positive definite, nonsymmetric P, and degenerate
//! contact problems of rank `m / 2`; also over discs and cones. `cargo bench -p dvi-vi --bench vi`.

use divan::{Bencher, black_box};
use nalgebra::{DMatrix, DVector};
use problem::{Control, ConvexSet, Shape};
use vi::{AffineVi, BlockGaussSeidel, Conic, Lemke, SemismoothNewton, ViSolver};

const SIZES: [usize; 7] = [2, 3, 6, 10, 50, 200, 500];

const CONTACTS: [usize; 4] = [3, 9, 30, 150];

/// Number of problems of one size that a benchmark solves in turn, so that the branch predictor cannot learn a single
/// one.
const PROBLEMS: usize = 16;

fn main() {
    divan::main();
}

struct Problem {
    matrix: DMatrix<f64>,
    q: Vec<f64>,
    set: ConvexSet,
}

/// Returns a uniform random number in `[-1, 1)` (`SplitMix64`).
fn number(state: &mut u64) -> f64 {
    *state = state.wrapping_add(0x9E37_79B9_7F4A_7C15);
    let mut x = *state;
    x = (x ^ (x >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
    x = (x ^ (x >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
    ((x ^ (x >> 31)) >> 11) as f64 / (1_u64 << 52) as f64 - 1.0
}

fn positive_definite(m: usize, state: &mut u64) -> Problem {
    let b = DMatrix::from_fn(m, m, |_, _| number(state));
    let matrix = &b * b.transpose() / m as f64 + DMatrix::identity(m, m) * 0.1;
    Problem { matrix, q: (0..m).map(|_| number(state)).collect(), set: ConvexSet::nonnegative(m) }
}

fn nonsymmetric(m: usize, state: &mut u64) -> Problem {
    let mut problem = positive_definite(m, state);
    let s = DMatrix::from_fn(m, m, |_, _| number(state));
    problem.matrix += (&s - s.transpose()) / (m as f64).sqrt();
    problem
}

fn contact(m: usize, state: &mut u64) -> Problem {
    let j = DMatrix::from_fn(m, m.div_ceil(2), |_, _| number(state));
    let v = DVector::from_fn(j.ncols(), |_, _| number(state));
    Problem { matrix: &j * j.transpose(), q: (j * v).as_slice().to_vec(), set: ConvexSet::nonnegative(m) }
}

/// Solves the given problems in turn, starting from zero or, if `warm`, from their solutions.
fn run(bencher: Bencher, mut solver: impl ViSolver, family: fn(usize, &mut u64) -> Problem, m: usize, warm: bool) {
    let mut state = 1;
    let problems: Vec<_> = (0..PROBLEMS).map(|_| family(m, &mut state)).collect();
    let control = Control::new();
    let mut solve = |problem: &Problem, z: &mut [f64]| {
        solver.solve(&AffineVi { matrix: &problem.matrix, q: &problem.q, set: &problem.set }, z, &control)
    };
    let starts: Vec<_> = problems
        .iter()
        .map(|problem| {
            let mut z = vec![0.0; m];
            if warm {
                solve(problem, &mut z);
            }
            z
        })
        .collect();
    let mut turn = 0;
    let mut z = vec![0.0; m];
    bencher.bench_local(|| {
        turn = (turn + 1) % PROBLEMS;
        z.copy_from_slice(&starts[turn]);
        black_box(solve(black_box(&problems[turn]), &mut z))
    });
}

#[divan::bench(args = SIZES)]
fn lemke_positive_definite(bencher: Bencher, m: usize) {
    run(bencher, Lemke::new(m), positive_definite, m, false);
}

#[divan::bench(args = SIZES)]
fn lemke_nonsymmetric(bencher: Bencher, m: usize) {
    run(bencher, Lemke::new(m), nonsymmetric, m, false);
}

#[divan::bench(args = SIZES)]
fn lemke_contact(bencher: Bencher, m: usize) {
    run(bencher, Lemke::new(m), contact, m, false);
}

#[divan::bench(args = SIZES)]
fn lemke_warm(bencher: Bencher, m: usize) {
    run(bencher, Lemke::new(m), nonsymmetric, m, true);
}

#[divan::bench(args = [3, 10, 50, 200], max_time = 2)]
fn newton_contact(bencher: Bencher, m: usize) {
    run(bencher, SemismoothNewton::new(m), contact, m, false);
}

#[divan::bench(args = SIZES)]
fn newton_nonsymmetric(bencher: Bencher, m: usize) {
    run(bencher, SemismoothNewton::new(m), nonsymmetric, m, false);
}

/// A problem in which each group of three variables has a nonnegative one and two in a disc.
fn discs(m: usize, state: &mut u64) -> Problem {
    let mut problem = positive_definite(m, state);
    for contact in 0..m / 3 {
        problem.set.bind(vec![3 * contact + 1, 3 * contact + 2], Shape::Ball { radius: 0.3 });
    }
    problem
}

/// A problem over second-order cones of dimension three.
fn cones(m: usize, state: &mut u64) -> Problem {
    let mut problem = positive_definite(m, state);
    for contact in 0..m / 3 {
        problem.set.bind((3 * contact..3 * contact + 3).collect(), Shape::SecondOrderCone);
    }
    problem
}

#[divan::bench(args = CONTACTS)]
fn newton_discs(bencher: Bencher, m: usize) {
    run(bencher, SemismoothNewton::new(m), discs, m, false);
}

#[divan::bench(args = CONTACTS)]
fn newton_cones(bencher: Bencher, m: usize) {
    run(bencher, SemismoothNewton::new(m), cones, m, false);
}

#[divan::bench(args = CONTACTS)]
fn newton_cones_warm(bencher: Bencher, m: usize) {
    run(bencher, SemismoothNewton::new(m), cones, m, true);
}

#[divan::bench(args = CONTACTS)]
fn conic_cones(bencher: Bencher, m: usize) {
    run(bencher, Conic::new(), cones, m, false);
}

#[divan::bench(args = CONTACTS)]
fn block_gauss_seidel_cones(bencher: Bencher, m: usize) {
    run(bencher, BlockGaussSeidel::new(), cones, m, false);
}
