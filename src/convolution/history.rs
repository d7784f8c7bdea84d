//! The contribution of the past to a step, `sum_{k < n} W_{n-k} Z_k`, for values `Z_k` that become known one after the
//! other (Hairer, Lubich and Schlichte 1985, Fast numerical solution of nonlinear Volterra convolution equations).
//!
//! The pairs `k < n` are partitioned into squares of a binary tree: when `n` is an odd multiple of `L`, a power of two,
//! the last `L` values are known and contribute to the next `L` sums, all at once by transforms of length `2L`. Each
//! `L` costs `O(N log N)` over the run, so that `N` steps cost `O(N log^2 N)`, with `O(N)` numbers in memory. Within a
//! block of 32 steps sums are computed directly.

use super::weights::Weights;
use realfft::num_complex::Complex;
use realfft::{ComplexToReal, RealFftPlanner, RealToComplex};
use std::sync::Arc;

/// Number of steps in the smallest block of the past: the contributions of the steps since its end to the convolution
/// are summed directly, without Fourier transforms.
const BLOCK: usize = 32;

/// The convolution weights of a scalar kernel, and the matrix that the kernel multiplies.
pub struct Part {
    /// The convolution weights of the scalar kernel.
    pub weights: Weights,
    /// The matrix that the scalar kernel multiplies, as `(row, column, value)`.
    pub matrix: Vec<(usize, usize, f64)>,
}

/// The values `Z_k` of the steps so far and their contributions to the convolution at future steps.
pub struct History {
    stages: usize,
    variables: usize,
    length: usize,
    parts: Vec<Part>,
    /// Values `Z_k` of the variables at the stages, a sequence over all steps for each stage and variable.
    values: Vec<f64>,
    /// Contributions of complete blocks of steps to the convolution at each step, a sequence for each stage and
    /// variable.
    sums: Vec<f64>,
    steps: usize,
    planner: RealFftPlanner<f64>,
    levels: Vec<Level>,
}

/// Fourier transforms for blocks of one length, with the spectra of the weights.
struct Level {
    forward: Arc<dyn RealToComplex<f64>>,
    backward: Arc<dyn ComplexToReal<f64>>,
    /// Spectra of the convolution weights of each part of the kernel, for each pair of stages.
    weights: Vec<Vec<Complex<f64>>>,
    /// Spectra of the values of the variables in the last block of steps, for each stage and variable.
    values: Vec<Vec<Complex<f64>>>,
    sum: Vec<Complex<f64>>,
    signal: Vec<f64>,
    work: Vec<Complex<f64>>,
}

impl History {
    /// Allocates the history of a run of `length` steps; all parts of the kernel have `length` weights.
    pub fn new(stages: usize, variables: usize, length: usize, parts: Vec<Part>) -> Self {
        let size = stages * variables * length;
        Self {
            stages,
            variables,
            length,
            parts,
            values: vec![0.0; size],
            sums: vec![0.0; size],
            steps: 0,
            planner: RealFftPlanner::new(),
            levels: Vec::new(),
        }
    }

    /// Returns the number of steps that the history contains so far.
    pub fn steps(&self) -> usize {
        self.steps
    }

    /// Returns the number of steps of the whole run, past and future.
    pub fn length(&self) -> usize {
        self.length
    }

    /// Returns the values of one variable at one stage, for all steps; zero for future steps.
    pub fn sequence(&self, stage: usize, variable: usize) -> &[f64] {
        &self.values[(stage * self.variables + variable) * self.length..][..self.length]
    }

    /// Writes the contributions of all past steps to the convolution at the next step, stage by stage, to `sums`.
    pub fn contribution(&self, sums: &mut [f64]) {
        let (m, n) = (self.variables, self.steps);
        let first = n - n % BLOCK;
        for (sum, sequence) in sums.iter_mut().zip(self.sums.chunks_exact(self.length)) {
            *sum = sequence[n];
        }
        for part in &self.parts {
            for i in 0..self.stages {
                for &(row, column, value) in &part.matrix {
                    for j in 0..self.stages {
                        let weights = &part.weights.sequence(i, j)[1..=n - first];
                        let values = &self.sequence(j, column)[first..n];
                        let sum: f64 = weights.iter().rev().zip(values).map(|(w, z)| w * z).sum();
                        sums[i * m + row] += value * sum;
                    }
                }
            }
        }
    }

    /// Appends the values of `z` in a step, stage by stage, to the history.
    pub fn append(&mut self, values: &[f64]) {
        for (value, sequence) in values.iter().zip(self.values.chunks_exact_mut(self.length)) {
            sequence[self.steps] = *value;
        }
        self.steps += 1;
        if self.steps.is_multiple_of(BLOCK) && self.steps < self.length {
            self.sum_block((self.steps / BLOCK).trailing_zeros() as usize);
        }
    }

    /// Adds the contributions of the last `L = BLOCK 2^level` steps to the convolution sums of the next `L` steps.
    fn sum_block(&mut self, level: usize) {
        while self.levels.len() <= level {
            let length = BLOCK << self.levels.len();
            let signals = self.stages * self.variables;
            self.levels.push(Level::new(&mut self.planner, 2 * length, signals, self.stages, &self.parts));
        }
        let (s, m, n) = (self.stages, self.variables, self.steps);
        let transforms = &mut self.levels[level];
        let length = BLOCK << level;
        let count = length.min(self.length - n);
        for (sequence, spectrum) in self.values.chunks_exact(self.length).zip(&mut transforms.values) {
            transforms.signal[..length].copy_from_slice(&sequence[n - length..n]);
            transforms.signal[length..].fill(0.0);
            // The only possible error of the transform is a wrong length, and all lengths are those of the plan.
            let _ = transforms.forward.process_with_scratch(&mut transforms.signal, spectrum, &mut transforms.work);
        }
        for (place, sums) in self.sums.chunks_exact_mut(self.length).enumerate() {
            let (i, k) = (place / m, place % m);
            transforms.sum.fill(Complex::default());
            for (part, weights) in self.parts.iter().zip(transforms.weights.chunks_exact(s * s)) {
                for &(_, column, value) in part.matrix.iter().filter(|&&(row, _, _)| row == k) {
                    for j in 0..s {
                        let products = weights[i * s + j].iter().zip(&transforms.values[j * m + column]);
                        for (sum, (w, z)) in transforms.sum.iter_mut().zip(products) {
                            *sum += w * z * value;
                        }
                    }
                }
            }
            let _ = transforms.backward.process_with_scratch(
                &mut transforms.sum,
                &mut transforms.signal,
                &mut transforms.work,
            );
            let scale = 1.0 / (2 * length) as f64;
            for (sum, value) in sums[n..n + count].iter_mut().zip(&transforms.signal[length..]) {
                *sum += scale * value;
            }
        }
    }
}

impl Level {
    /// Plans Fourier transforms of `length` values, twice the length of a block of steps.
    fn new(planner: &mut RealFftPlanner<f64>, length: usize, signals: usize, stages: usize, parts: &[Part]) -> Self {
        let forward = planner.plan_fft_forward(length);
        let backward = planner.plan_fft_inverse(length);
        let mut signal = vec![0.0; length];
        let mut work = vec![Complex::default(); forward.get_scratch_len().max(backward.get_scratch_len())];
        let pairs = (0..stages * stages).map(|place| (place / stages, place % stages));
        let sequences = parts.iter().flat_map(|part| pairs.clone().map(|(i, j)| part.weights.sequence(i, j)));
        let weights = sequences
            .map(|sequence| {
                let known = length.min(sequence.len());
                signal[..known].copy_from_slice(&sequence[..known]);
                signal[known..].fill(0.0);
                let mut spectrum = forward.make_output_vec();
                let _ = forward.process_with_scratch(&mut signal, &mut spectrum, &mut work);
                spectrum
            })
            .collect();
        let values = vec![forward.make_output_vec(); signals];
        let sum = forward.make_output_vec();
        Self { forward, backward, weights, values, sum, signal, work }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn blocks_and_direct_sums_agree() {
        // Use two stages, two variables, two kernels that mix them, and a number of steps that is no power of two.
        let (s, m, length) = (2, 2, 333);
        let random = |seed: usize| (seed as f64 * 0.754_877_666).fract() - 0.3;
        let parts = || -> Vec<Part> {
            let matrices = [vec![(0, 0, 1.0), (0, 1, -2.0), (1, 1, 0.5)], vec![(1, 0, 3.0)]];
            let part = |(p, matrix): (usize, Vec<(usize, usize, f64)>)| {
                let mut weights = Weights::zeros(s, length);
                for (i, j) in [(0, 0), (0, 1), (1, 0), (1, 1)] {
                    let sequence = weights.sequence_mut(i, j).iter_mut().enumerate();
                    sequence.for_each(|(n, w)| *w = random(7 * n + 3 * i + 5 * j + p));
                }
                Part { weights, matrix }
            };
            matrices.into_iter().enumerate().map(part).collect()
        };
        let mut history = History::new(s, m, length, parts());
        let (direct, mut all) = (parts(), Vec::new());
        for n in 0..length {
            let mut found = vec![0.0; s * m];
            history.contribution(&mut found);
            let mut expected = vec![0.0; s * m];
            for part in &direct {
                for (k, values) in all.iter().enumerate() {
                    let values: &Vec<f64> = values;
                    for &(row, column, value) in &part.matrix {
                        for (i, j) in [(0, 0), (0, 1), (1, 0), (1, 1)] {
                            let weight = part.weights.sequence(i, j)[n - k];
                            expected[i * m + row] += value * weight * values[j * m + column];
                        }
                    }
                }
            }
            for (found, expected) in found.iter().zip(&expected) {
                assert!((found - expected).abs() < 1e-11, "step {n}: {found}, not {expected}");
            }
            let values: Vec<f64> = (0..s * m).map(|place| random(11 * n + place)).collect();
            history.append(&values);
            all.push(values);
        }
    }
}
