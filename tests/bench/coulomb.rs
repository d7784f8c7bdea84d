//! Time to solve frictional contact problems: one contact in closed form, three coupled contacts with cold and warm
//! starts, and problems of the FCLIB collection from zero. `cargo bench -p dvi-vi --bench coulomb`.

#[path = "../fclib/collection.rs"]
mod collection;

use divan::{Bencher, black_box};
use dvi::problem::Control;
use dvi::vi::coulomb::{BlockMatrix, Coulomb, CoulombProblem, solve_contact};
use nalgebra::{Matrix3, SMatrix, Vector3};

/// Number of problems that a benchmark solves in turn, so that the branch predictor cannot learn a single one.
const PROBLEMS: usize = 64;

/// Relative change of `q` from one problem to the next, which imitates successive time steps.
const CHANGE: f64 = 0.01;

fn main() {
    divan::main();
}

/// Returns a uniform random number in `[-1, 1)` (`SplitMix64`).
fn number(state: &mut u64) -> f64 {
    *state = state.wrapping_add(0x9E37_79B9_7F4A_7C15);
    let mut x = *state;
    x = (x ^ (x >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
    x = (x ^ (x >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
    ((x ^ (x >> 31)) >> 11) as f64 / (1_u64 << 52) as f64 - 1.0
}

/// Returns a free velocity that closes a contact; at the solution the contact sticks or slips.
fn closing(state: &mut u64) -> Vector3<f64> {
    Vector3::new(-1.0 - number(state).abs(), 2.0 * number(state), 2.0 * number(state))
}

#[divan::bench]
fn one_contact(bencher: Bencher) {
    let mut state = 1;
    let problems: Vec<_> = (0..PROBLEMS)
        .map(|_| {
            let factor = Matrix3::from_fn(|_, _| number(&mut state));
            (factor * factor.transpose() + Matrix3::identity() * 0.5, closing(&mut state))
        })
        .collect();
    let mut turn = 0;
    bencher.bench_local(|| {
        turn = (turn + 1) % PROBLEMS;
        let (matrix, q) = &problems[turn];
        black_box(solve_contact(black_box(matrix), q, 0.5))
    });
}

/// Contact problems of one body with six degrees of freedom on three contacts, a tripod: their Delassus operator is
/// singular.
fn tripods() -> Vec<CoulombProblem> {
    let mut state = 2;
    let jacobian = SMatrix::<f64, 9, 6>::from_fn(|_, _| number(&mut state));
    let dense = jacobian * jacobian.transpose();
    let base: Vec<_> = (0..3).map(|_| closing(&mut state)).collect();
    (0..PROBLEMS)
        .map(|_| {
            let block = |e: usize| (e / 3, e % 3, dense.fixed_view::<3, 3>(3 * (e / 3), 3 * (e % 3)).into_owned());
            let matrix = BlockMatrix::from_blocks(3, (0..9).map(block)).expect("indices in range");
            let q = base.iter().map(|q| q + Vector3::from_fn(|_, _| CHANGE * number(&mut state))).collect();
            CoulombProblem::new(matrix, q, vec![0.5; 3]).expect("a well-formed problem")
        })
        .collect()
}

#[divan::bench(args = [false, true])]
fn three_contacts(bencher: Bencher, warm: bool) {
    let (problems, control) = (tripods(), Control::new());
    let mut solver = Coulomb::default();
    let mut r = [Vector3::zeros(); 3];
    let mut turn = 0;
    bencher.bench_local(|| {
        turn = (turn + 1) % PROBLEMS;
        if !warm {
            r.fill(Vector3::zeros());
        }
        black_box(solver.solve(&problems[turn], &mut r, &control))
    });
}

#[divan::bench(args = ["nespheres_10_1", "oneobject_316", "boxesstack_48", "periobox_60", "capsules_286"])]
fn collection_from_rest(bencher: Bencher, name: &str) {
    let problem = collection::problem(name);
    let mut solver = Coulomb::default();
    bencher.bench_local(|| {
        let mut r = vec![Vector3::zeros(); problem.contacts()];
        black_box(solver.solve(&problem, &mut r, &Control::new()))
    });
}
