//! The convolution inequality
//!
//! ```text
//! z in K(t),    <(m * z)(t) + q(t), z~ - z> >= 0  for all z~ in K(t),    (m * z)(t) = int_0^t m(t - s) z(s) ds
//! ```
//!
//! with the names of its outputs: `z`, the integral of `z`, and `G = m * z + q`.

use super::DviModel;
use analysis::{Analysis, analyse_memory};
use convolution::Kernel;
use nalgebra::DMatrix;

/// A convolution inequality (a problem with memory): the forcing, the kernel and the names of the outputs.
#[derive(Clone, Debug)]
pub struct ConvolutionModel {
    /// The forcing `q` and the set `K` of the convolution inequality, as a problem without states whose inequality
    /// function is `q(t)`.
    pub forcing: DviModel,
    /// The kernel `m` of the convolution in the inequality function.
    pub kernel: Kernel,
    /// The exponent `a` of the kernel `m(t) ~ t^(a-1)` at time zero, with `0 < a <= 2`.
    pub index: f64,
    /// The leading matrix `M` of the kernel `m(t) ~ M t^(a-1)` at time zero, up to a positive factor.
    pub at_zero: DMatrix<f64>,
    /// The names of the outputs: the variables `z`, the integrals of `z`, and `G`, in this order.
    pub output_names: Vec<String>,
}

impl ConvolutionModel {
    /// Builds the model and names its outputs `z`, `integral_z` and `G_z` after each variable `z`; appends `_` to avoid
    /// duplicates.
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

    /// Returns the number of variables `z` of the convolution inequality.
    pub fn variables(&self) -> usize {
        self.forcing.variable_names.len()
    }

    /// Analyses existence and uniqueness of the solution according to the theory of convolution inequalities.
    pub fn analyse(&self) -> Analysis {
        analyse_memory(self.index, &self.at_zero)
    }
}
