//! The kernel `m(t)` of a convolution: a sum of scalar functions of time, each times a constant matrix.

use super::product_integration::product_integration;
use super::quadrature::fractional;
use super::weights::Weights;
use expression::Tape;
use problem::Control;
use radau::Tableau;

/// A scalar function of time, integrated `integrations` times: the power `t^(a-1) / Gamma(a)`, or `t^(a-1) g(t)` with a
/// smooth factor `g`.
#[derive(Clone, Debug)]
pub struct Function {
    /// The exponent `a` of the power: in `[0, 1)` without the smooth factor `g`, where 0 denotes the identity, and in
    /// `(0, 1]` with it.
    pub exponent: f64,
    /// The smooth factor `g`, a compiled expression in the one input `t`.
    pub factor: Option<Tape>,
    /// The derivative `g'` of the smooth factor, if there is one.
    pub slope: Option<Tape>,
    /// The number of times that the function is integrated from zero.
    pub integrations: usize,
}

/// A term of a kernel: a function times a matrix.
#[derive(Clone, Debug)]
pub struct Term {
    /// The scalar function of time of the term.
    pub function: Function,
    /// The nonzero entries of the matrix of the term as `(row, column, value)`, each entry at most once.
    pub matrix: Vec<(usize, usize, f64)>,
}

/// The kernel of a convolution, the sum of its terms.
#[derive(Clone, Debug)]
pub struct Kernel {
    /// The terms of the kernel, whose sum it is.
    pub terms: Vec<Term>,
}

/// The reason why the weights of a convolution cannot be computed.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum NoWeights {
    /// The kernel is not finite at this lag (time since its beginning).
    NotFinite(f64),
    /// The caller asked, through [`Control`], to stop the computation of the weights.
    Interrupted,
}

impl Function {
    /// Returns the kernel `t^(alpha-1) / Gamma(alpha)` of the integral of order `alpha > 0`.
    pub fn power(alpha: f64) -> Self {
        Self { exponent: alpha.fract(), factor: None, slope: None, integrations: alpha.trunc() as usize }
    }

    /// Returns the exponent `a` of the repeatedly integrated function near zero, if the factor is not zero at zero.
    pub fn index(&self) -> f64 {
        self.exponent + self.integrations as f64
    }

    /// Returns the first `length` convolution weights for a step size `h`.
    ///
    /// # Errors
    /// If the kernel is not finite, or on interruption.
    pub fn weights(&self, tableau: &Tableau, h: f64, length: usize, control: &Control) -> Result<Weights, NoWeights> {
        let mut weights = match &self.factor {
            Some(factor) => product_integration(tableau, self.exponent, &mut factor.clone(), h, length, control)?,
            None if self.exponent == 0.0 => Weights::identity(tableau.stages(), length),
            None => {
                let unit = fractional(tableau, self.exponent, length, control);
                let mut weights = unit.ok_or(NoWeights::Interrupted)?;
                weights.scale(h.powf(self.exponent));
                weights
            }
        };
        for _ in 0..self.integrations {
            weights.integrate(tableau);
            weights.scale(h);
        }
        Ok(weights)
    }
}
