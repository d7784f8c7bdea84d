//! The convolution inequality
//!
//! ```text
//! z in K(t),    <(m * z)(t) + q(t), z~ - z> >= 0  for all z~ in K(t),    (m * z)(t) = int_0^t m(t - s) z(s) ds
//! ```
//!
//! with its names. Told are `z`, its integral, and `G = m * z + q`.

use super::DviModel;
use analysis::{Analysis, analyse_memory};
use convolution::Kernel;
use nalgebra::DMatrix;

/// A problem with memory.
#[derive(Clone, Debug)]
pub struct ConvolutionModel {
    /// `q` and `K`: a problem without states, whose inequality is `q(t)`.
    pub forcing: DviModel,
    /// `m`.
    pub kernel: Kernel,
    /// The exponent `a` of the kernel, above 0 and at most 2.
    pub index: f64,
    /// `M` with `m(t) ~ M t^(a-1)` at zero, but for a positive factor.
    pub at_zero: DMatrix<f64>,
    /// The names of `z`, of its integral, and of `G`.
    pub output_names: Vec<String>,
}

impl ConvolutionModel {
    /// Gives the outputs their names.
    pub fn new(forcing: DviModel, kernel: Kernel, index: f64, at_zero: DMatrix<f64>) -> Self {
        let mut output_names = forcing.variable_names.clone();
        for prefix in ["integral", "G"] {
            for variable in &forcing.variable_names {
                let mut name = format!("{prefix}_{variable}");
                while output_names.contains(&name) {
                    name.push('_');
                }
                output_names.push(name);
            }
        }
        Self { forcing, kernel, index, at_zero, output_names }
    }

    /// The number of variables.
    pub fn variables(&self) -> usize {
        self.forcing.variable_names.len()
    }

    /// What the theory says of it.
    pub fn analyse(&self) -> Analysis {
        analyse_memory(self.index, &self.at_zero)
    }
}
