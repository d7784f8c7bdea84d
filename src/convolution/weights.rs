//! The weights `W_0, W_1, ..` of a discrete convolution on `s` stages, and their integration: with the generating
//! function `W(zeta) = sum W_n zeta^n` of a kernel, that of its integral from zero is `W(zeta) Delta(zeta)^-1`, where
//! for Radau IIA `Delta(zeta)^-1 = A + (zeta + zeta^2 + ..) 1 b^T`.

use radau::Tableau;

/// Convolution weights of a scalar kernel, `s x s` matrices, stored as a sequence over `n` for each entry.
#[derive(Clone, Debug)]
pub struct Weights {
    stages: usize,
    length: usize,
    values: Vec<f64>,
}

impl Weights {
    /// Creates `length` convolution weights, all of them zero.
    pub fn zeros(stages: usize, length: usize) -> Self {
        Self { stages, length, values: vec![0.0; stages * stages * length] }
    }

    /// Creates the convolution weights of the identity: `W_0 = I`, and zero otherwise.
    pub fn identity(stages: usize, length: usize) -> Self {
        let mut weights = Self::zeros(stages, length);
        for i in 0..stages {
            weights.sequence_mut(i, i)[..1].fill(1.0);
        }
        weights
    }

    /// Returns the number of convolution weights.
    pub fn len(&self) -> usize {
        self.length
    }

    /// Whether there are no convolution weights.
    pub fn is_empty(&self) -> bool {
        self.length == 0
    }

    /// Returns the entries `(W_n)_ij` of the convolution weights for all `n`.
    pub fn sequence(&self, i: usize, j: usize) -> &[f64] {
        &self.values[(i * self.stages + j) * self.length..][..self.length]
    }

    /// Returns the entries `(W_n)_ij` of the convolution weights for all `n`, for modification.
    pub fn sequence_mut(&mut self, i: usize, j: usize) -> &mut [f64] {
        &mut self.values[(i * self.stages + j) * self.length..][..self.length]
    }

    /// Multiplies all convolution weights by a factor.
    pub fn scale(&mut self, factor: f64) {
        self.values.iter_mut().for_each(|value| *value *= factor);
    }

    /// Replaces the convolution weights of a kernel by those of the integral of the kernel, for unit steps.
    pub fn integrate(&mut self, tableau: &Tableau) {
        let s = self.stages;
        let (mut row, mut sums) = (vec![0.0; s], vec![0.0; s]);
        for n in 0..self.length {
            for (i, before) in sums.iter_mut().enumerate() {
                for (j, entry) in row.iter_mut().enumerate() {
                    *entry = self.sequence(i, j)[n];
                }
                for j in 0..s {
                    let now: f64 = (0..s).map(|k| row[k] * tableau.a[(k, j)]).sum();
                    self.sequence_mut(i, j)[n] = now + *before * tableau.b[j];
                }
                *before += row.iter().sum::<f64>();
            }
        }
    }
}
