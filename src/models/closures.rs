//! Equations of a differential variational inequality given as Rust functions. Only their values are available: the
//! equations have no interval enclosures, and derivatives that the user does not supply are central differences.

use expression::cube_root;
use problem::{Dvi, Structure};
use std::fmt;
use std::sync::Arc;

/// A user's function that writes `F` (`n` rates) and `G` (`m` inequality functions) at `(t, x, z)`; arguments
/// `(t, x, z, F, G)`.
pub type RowFunction = dyn Fn(f64, &[f64], &[f64], &mut [f64], &mut [f64]) + Send + Sync;

/// A user's function that writes the derivatives of `F`, then `G`, with respect to `x`, then `z`, row by row; arguments
/// `(t, x, z, derivatives)`.
pub type DerivativeFunction = dyn Fn(f64, &[f64], &[f64], &mut [f64]) + Send + Sync;

/// The equations of a differential variational inequality as Rust functions, with a workspace.
#[derive(Clone)]
pub struct Closures {
    structure: Structure,
    rows: Arc<RowFunction>,
    derivatives: Option<Arc<DerivativeFunction>>,
    /// The length of the time interval of the solve, which scales the increment of finite differences in time.
    span: f64,
    /// The largest magnitude of each unknown of `(x, z)` so far, which scales the increment of a finite difference
    /// where the unknown is zero.
    met: Vec<f64>,
    y: Vec<f64>,
    /// The values of `F` and `G` at both evaluation points of a central difference.
    ends: [Vec<f64>; 2],
}

impl fmt::Debug for Closures {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("Closures").field("structure", &self.structure).finish_non_exhaustive()
    }
}

/// Returns the increment of a central difference, relative to the size of the unknown, at which truncation and rounding
/// errors balance: the cube root of the rounding unit.
fn change() -> f64 {
    cube_root(f64::EPSILON)
}

impl Closures {
    /// Creates equations given as Rust functions, with the given structure, over a time interval of length `span`. The
    /// bounds of the structure must be constant; its sparsity pattern is replaced by a full one.
    pub fn new(
        mut structure: Structure,
        rows: Arc<RowFunction>,
        derivatives: Option<Arc<DerivativeFunction>>,
        span: f64,
    ) -> Self {
        let unknowns = structure.unknowns();
        structure.pattern = (0..unknowns * unknowns).map(|k| (k / unknowns, k % unknowns)).collect();
        structure.constant_jacobian = false;
        let zeros = vec![0.0; unknowns];
        Self { structure, rows, derivatives, span, met: zeros.clone(), y: zeros.clone(), ends: [zeros.clone(), zeros] }
    }

    pub(super) fn structure_mut(&mut self) -> &mut Structure {
        &mut self.structure
    }

    /// Calls the user's function at time `t` and the unknowns `y` of the workspace, and stores `F` and `G` as the
    /// values at evaluation point `end` (0 or 1) of a central difference.
    fn at_end(&mut self, end: usize, t: f64) {
        let n = self.structure.states;
        let (rates, inequality) = self.ends[end].split_at_mut(n);
        (self.rows)(t, &self.y[..n], &self.y[n..], rates, inequality);
    }

    /// Returns the scale of unknown `j` for differences: its magnitude, but at least a small fraction of the largest
    /// magnitude it has had, so that near a zero crossing rounding costs at most half of the digits; for an unknown
    /// that has always been zero, the largest magnitude of all unknowns.
    fn size(&self, j: usize, value: f64) -> f64 {
        let own = value.abs().max(change() * self.met[j]);
        let largest = self.met.iter().copied().fold(0.0, f64::max);
        [own, largest].into_iter().find(|size| *size > 0.0).unwrap_or(1.0)
    }
}

impl Dvi for Closures {
    fn structure(&self) -> &Structure {
        &self.structure
    }

    fn evaluate(&mut self, t: f64, y: &[f64], values: &mut [f64]) {
        let n = self.structure.states;
        for (met, y) in self.met.iter_mut().zip(y).filter(|(_, y)| y.is_finite()) {
            *met = met.max(y.abs());
        }
        let (rates, inequality) = values.split_at_mut(n);
        (self.rows)(t, &y[..n], &y[n..], rates, inequality);
    }

    fn jacobian(&mut self, t: f64, y: &[f64], values: &mut [f64]) {
        let (n, unknowns) = (self.structure.states, self.structure.unknowns());
        if let Some(derivatives) = &self.derivatives {
            derivatives(t, &y[..n], &y[n..], values);
            return;
        }
        self.y.copy_from_slice(y);
        for j in 0..unknowns {
            let change = change() * self.size(j, y[j]);
            let ends = [y[j] - change, y[j] + change];
            for (end, value) in ends.into_iter().enumerate() {
                self.y[j] = value;
                self.at_end(end, t);
            }
            self.y[j] = y[j];
            let [low, high] = &self.ends;
            for (row, (low, high)) in low.iter().zip(high).enumerate() {
                values[row * unknowns + j] = (high - low) / (ends[1] - ends[0]);
            }
        }
    }

    fn time_derivative(&mut self, t: f64, y: &[f64], values: &mut [f64]) {
        self.y.copy_from_slice(y);
        let change = change() * self.span;
        let ends = [t - change, t + change];
        for (end, t) in ends.into_iter().enumerate() {
            self.at_end(end, t);
        }
        let [low, high] = &self.ends;
        let n = self.structure.states;
        for (value, (low, high)) in values.iter_mut().zip(low[n..].iter().zip(&high[n..])) {
            *value = (high - low) / (ends[1] - ends[0]);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use problem::{ConvexSet, Mass};

    /// Compares central differences with the known derivatives of a function, for unknowns whose magnitudes are far
    /// from one, and for an unknown that is zero.
    #[test]
    fn differences_have_two_thirds_of_the_digits() {
        let structure = Structure {
            states: 2,
            variables: 1,
            mass: Mass::Identity,
            set: ConvexSet::nonnegative(1),
            moving: Vec::new(),
            pattern: Vec::new(),
            constant_jacobian: false,
        };
        let rows = |t: f64, x: &[f64], z: &[f64], rates: &mut [f64], inequality: &mut [f64]| {
            rates[0] = x[1] * x[1] / 1e6;
            rates[1] = -(x[0] * 1e3).sin() * 1e6 + z[0];
            inequality[0] = (2.0 * t).sin() + x[0] + 3.0 * z[0];
        };
        let mut closures = Closures::new(structure, Arc::new(rows), None, 10.0);
        let y = [1e-3, 1e6, 0.0];
        let mut values = [0.0; 3];
        closures.evaluate(0.3, &y, &mut values);
        let mut derivatives = [0.0; 9];
        closures.jacobian(0.3, &y, &mut derivatives);
        let exact = [0.0, 2.0, 0.0, -(1.0_f64.cos()) * 1e9, 0.0, 1.0, 1.0, 0.0, 3.0];
        // Rounding error of the terms of a row of `F` or `G`, divided by the increment of the unknown in a central
        // difference.
        let rounding = [1e6 * 1e-16 / 6e-9, 0.0, 0.0];
        for (k, (found, exact)) in derivatives.iter().zip(exact).enumerate() {
            let allowed = 1e-9 * f64::abs(exact) + rounding[k % 3];
            assert!((found - exact).abs() <= allowed, "{k}: {found} instead of {exact}");
        }
        let mut by_time = [0.0];
        closures.time_derivative(0.3, &y, &mut by_time);
        assert!((by_time[0] - 2.0 * 0.6_f64.cos()).abs() < 1e-8, "{by_time:?}");
    }
}
