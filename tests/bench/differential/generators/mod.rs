//! Random problems of each kind. Most are well-posed by construction, and each knows whether it is.

mod bodies;
mod circuits;
mod complementarity;
mod filippov;
mod mechanical;
mod memory;
mod network;
mod obstacle;
mod sets;

use super::linear::{Linear, Shape, product, transposed};
use super::problem::{Field, Kind, Problem, View, Way};
use super::random::Random;
use super::reference::{Values, by_modes, by_projection};
use serde_json::Value;

/// Returns a random problem of the given kind.
pub fn generate(kind: Kind, random: &mut Random) -> Box<dyn Problem> {
    match kind {
        Kind::Complementarity => Box::new(complementarity::generate(random)),
        Kind::Circuit => Box::new(circuits::generate(random)),
        Kind::Filippov => filippov::generate(random),
        Kind::Sets => Box::new(sets::generate(random)),
        Kind::Mechanical => mechanical::generate(random, false),
        Kind::TimeStepping => mechanical::generate(random, true),
        Kind::Bodies => Box::new(bodies::generate(random)),
        Kind::Obstacle => Box::new(obstacle::generate(random)),
        Kind::Memory => Box::new(memory::generate(random)),
    }
}

/// A random linear system with the known properties of its solution.
#[derive(Clone, Debug)]
pub struct LinearProblem {
    pub system: Linear,
    pub end: f64,
    pub is_unique: bool,
    /// Whether the problem is written as matrices (`lcs`); otherwise it is written as expressions (`dvi`).
    pub as_matrices: bool,
    /// Weights of the squared states in an energy that does not grow for the difference of two solutions; `None` if
    /// no such energy is known.
    pub energy: Option<Vec<f64>>,
}

/// Number of steps of the coarsest run of the reference method that uses projections.
const COARSE: usize = 2_000;

impl Problem for LinearProblem {
    fn document(&self, view: &View) -> Value {
        if self.as_matrices { self.system.as_matrices(view) } else { self.system.as_expressions(view) }
    }

    fn fields(&self) -> Vec<Field> {
        (1..=self.system.states()).map(|i| Field::sized(format!("x{i}"))).collect()
    }

    fn end(&self) -> f64 {
        self.end
    }

    fn way(&self) -> Way {
        Way::Stages
    }

    fn smallest(&self) -> f64 {
        self.system.initial.iter().fold(f64::INFINITY, |least, x| least.min(x.abs())).clamp(1e-3, 1e3)
    }

    fn is_unique(&self) -> bool {
        self.is_unique
    }

    fn most_growth(&self, sizes: &[f64]) -> f64 {
        self.energy.as_ref().map_or(f64::INFINITY, |weights| growth_by_energy(weights, sizes))
    }

    fn reference(&self, change: &[f64], times: &[f64]) -> Option<Values> {
        let start: Vec<f64> =
            self.system.initial.iter().enumerate().map(|(i, x)| x + change.get(i).copied().unwrap_or(0.0)).collect();
        by_modes(&self.system, &start, times).or_else(|| by_projection(&self.system, &start, times, COARSE))
    }
}

/// Returns a random matrix `A` with `A + A^T` negative semidefinite: oscillation and decay, with time scales up to a
/// ratio of `stiffness`.
fn dissipative(random: &mut Random, n: usize, stiffness: f64) -> Vec<Vec<f64>> {
    let root = random.matrix(n, n);
    let square = product(&root, &transposed(&root));
    let skew = random.matrix(n, n);
    let turn = random.scale(0.1, 10.0);
    let rates: Vec<f64> = (0..n).map(|_| random.scale(0.03, stiffness)).collect();
    let loss = if random.chance(0.2) { 0.0 } else { random.scale(0.01, 1.0) };
    let entry = |i: usize, j: usize| {
        let damping = -loss * square[i][j] * (rates[i] * rates[j]).sqrt();
        damping + turn * (skew[i][j] - skew[j][i])
    };
    (0..n).map(|i| (0..n).map(|j| entry(i, j)).collect()).collect()
}

/// Returns a random matrix with a positive definite symmetric part of order one, and possibly a skew-symmetric part.
fn positive_definite(random: &mut Random, n: usize) -> Vec<Vec<f64>> {
    let root = random.matrix(n, n);
    let square = product(&root, &transposed(&root));
    let (skew, amount) = (random.matrix(n, n), if random.chance(0.5) { 0.0 } else { 0.5 });
    let entry = |i: usize, j: usize| {
        square[i][j] + amount * (skew[i][j] - skew[j][i]) + if i == j { random_free(n) } else { 0.0 }
    };
    (0..n).map(|i| (0..n).map(|j| entry(i, j)).collect()).collect()
}

/// Returns a shift of the diagonal that keeps a random Gram matrix of order `n` away from singularity.
fn random_free(n: usize) -> f64 {
    0.1 * n as f64
}

/// Returns a bound on the growth of a perturbation, in the norm in which each state is divided by its size, given
/// weights of the squared states in an energy that does not grow.
fn growth_by_energy(weights: &[f64], sizes: &[f64]) -> f64 {
    let energies = || weights.iter().zip(sizes).map(|(weight, size)| weight * size * size);
    (energies().sum::<f64>() / energies().fold(f64::INFINITY, f64::min)).sqrt()
}

/// Rewrites a passive system in other units for each state, so that its energy is not the square of the Euclidean
/// norm.
fn rescaled(mut system: Linear, factors: &[f64]) -> Linear {
    for (i, factor) in factors.iter().enumerate() {
        system.initial[i] *= factor;
        system.b[i].iter_mut().for_each(|b| *b *= factor);
        system.drive[i] = {
            let mut scaled = super::signal::Signal::default();
            scaled.add(*factor, &system.drive[i]);
            scaled
        };
        for (j, other) in factors.iter().enumerate() {
            system.a[i][j] *= factor / other;
        }
        system.c.iter_mut().for_each(|row| row[i] /= factor);
    }
    system
}

/// Scales the rates of a system, and the frequencies of its signals, by a factor.
fn faster(mut system: Linear, factor: f64) -> Linear {
    for matrix in [&mut system.a, &mut system.b] {
        matrix.iter_mut().flatten().for_each(|entry| *entry *= factor);
    }
    for signal in system.drive.iter_mut() {
        signal.constant *= factor;
        signal.waves.iter_mut().for_each(|wave| wave.amplitude *= factor);
    }
    for signal in system.drive.iter_mut().chain(&mut system.gap) {
        signal.waves.iter_mut().for_each(|wave| wave.omega *= factor);
    }
    system
}

/// Returns the number of variables of a set, the sum over its factors.
fn variables(set: &[(Shape, usize)]) -> usize {
    set.iter().map(|(_, size)| size).sum()
}
