//! Random linear complementarity systems: passive ones, with `D` zero, singular or regular; systems whose `D` is a
//! P-matrix; and reflections, in which `D` is zero and `C B` is an M-matrix.

use super::{LinearProblem, dissipative, faster, positive_definite, rescaled};
use crate::differential::linear::{Linear, Shape, transposed, zeros};
use crate::differential::random::Random;
use crate::differential::signal::Signal;

pub fn generate(random: &mut Random) -> LinearProblem {
    let (n, m) = (random.whole(1, 4), random.whole(1, 3));
    let omega = random.scale(0.5, 5.0);
    let form = random.whole(0, 2);
    let mut system = match form {
        0 => passive(random, n, m),
        1 => p_matrix(random, n, m),
        _ => reflection(random, n.max(m), m),
    };
    let n = system.a.len();
    system.drive = (0..n).map(|_| Signal::random(random, 1.0, omega, 2)).collect();
    system.gap = (0..m).map(|_| Signal::random(random, 0.5, omega, 1)).collect();
    system.set = vec![(Shape::Nonnegative, m)];
    system.initial = random.vector(n);
    // If `D` is singular, the initial states must satisfy `G >= 0`: a constant is added to ensure it.
    for i in 0..m {
        let at_start: f64 =
            system.c[i].iter().zip(&system.initial).map(|(c, x)| c * x).sum::<f64>() + system.gap[i].at(0.0);
        if at_start < 0.05 {
            system.gap[i].constant += 0.05 - at_start + random.uniform(0.0, 0.5);
        }
    }
    let factors: Vec<f64> = (0..n).map(|_| random.scale(0.1, 10.0)).collect();
    let speed = random.scale(1e-3, 1e3);
    let system = faster(rescaled(system, &factors), speed);
    let end = random.scale(5.0, 60.0) / (omega * speed) * std::f64::consts::TAU / 2.0;
    let energy = (form == 0).then(|| factors.iter().map(|factor| factor.powi(-2)).collect());
    LinearProblem { system, end, is_unique: true, as_matrices: random.chance(0.7), energy }
}

/// Returns a random passive system: `C = B^T`, `D` positive semidefinite and `A + A^T` negative semidefinite.
fn passive(random: &mut Random, n: usize, m: usize) -> Linear {
    let a = dissipative(random, n, 300.0);
    let b = random.matrix(n, m);
    let mut d = match random.whole(0, 2) {
        0 => zeros(m, m),
        1 => positive_definite(random, m),
        _ => {
            let mut d = zeros(m, m);
            d[0][0] = random.scale(0.01, 1.0);
            d
        }
    };
    // If there are more variables than states, `z` on the kernel of `B` is determined by `D` only, which is shifted
    // to be regular. The states do not depend on that part of `z`.
    if m > n {
        (0..m).for_each(|i| d[i][i] += 0.3);
    }
    Linear { a, c: transposed(&b), b, d, ..Linear::default() }
}

/// Returns a random system in which `D` is a diagonally dominant P-matrix and all other matrices are random, with
/// dissipation.
fn p_matrix(random: &mut Random, n: usize, m: usize) -> Linear {
    let mut a = dissipative(random, n, 100.0);
    (0..n).for_each(|i| a[i][i] -= 0.5);
    let mut d = random.matrix(m, m);
    for (i, row) in d.iter_mut().enumerate() {
        let others: f64 = row.iter().enumerate().filter(|(j, _)| *j != i).map(|(_, x)| x.abs()).sum();
        row[i] = others + random.scale(0.3, 3.0);
    }
    Linear { a, b: random.matrix(n, m), c: random.matrix(m, n), d, ..Linear::default() }
}

/// Returns a random reflection: each variable pushes one state away from zero, and may push other states towards zero
/// by less in total.
#[expect(clippy::needless_range_loop, reason = "columns of a matrix by rows")]
fn reflection(random: &mut Random, n: usize, m: usize) -> Linear {
    let a = dissipative(random, n, 30.0);
    let mut b = zeros(n, m);
    for j in 0..m {
        b[j][j] = 1.0;
        for i in (0..n).filter(|i| *i != j) {
            b[i][j] = -random.uniform(0.0, 0.9) / n as f64;
        }
    }
    let c = (0..m).map(|i| (0..n).map(|j| if i == j { 1.0 } else { 0.0 }).collect()).collect();
    Linear { a, b, c, d: zeros(m, m), ..Linear::default() }
}
