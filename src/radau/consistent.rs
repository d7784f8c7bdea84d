//! The variables that belong to given states on a face.
//!
//! The stage values of `z` have order `s` only. Given `x`, of order `2s - 1`, the variables inside their interval follow
//! to the same order from `G = 0` where `D = G_z` is regular, and from the hidden constraint `dG/dt = G_t + G_x M^-1 F = 0`
//! where `D` vanishes. Where `D` is neither, with `U` a basis of its left null space and `V` of the complement,
//!
//! ```text
//! V^T G = 0,    U^T (G_t + G_x M^-1 F) = 0
//! ```
//!
//! (in the second `D z'` drops out). Hairer and Wanner 1996, VII.1; Ascher and Petzold 1998, 9.2.

use super::face::Place;
use super::system::System;
use nalgebra::{DMatrix, DVector, Dyn, LU};

/// Newton's method on the equations above, with its workspace.
pub struct Consistent {
    /// `M`, factorised; none where it is the identity.
    mass: Option<LU<f64, Dyn, Dyn>>,
    inside: Vec<usize>,
    drift: Vec<f64>,
}

/// The most iterations; problems affine in `z` need one.
const ITERATIONS: usize = 6;

impl Consistent {
    /// `None` where `M` is singular: then `z` is not determined by `x` alone.
    pub fn new(system: &System<'_>) -> Option<Self> {
        let n = system.states;
        let variables = system.unknowns - n;
        let mass = if system.identity_mass {
            None
        } else {
            let lu = system.mass.view((0, 0), (n, n)).into_owned().full_piv_lu();
            if !lu.is_invertible() {
                return None;
            }
            Some(system.mass.view((0, 0), (n, n)).into_owned().lu())
        };
        (variables > 0).then(|| Self { mass, inside: Vec::with_capacity(variables), drift: vec![0.0; variables] })
    }

    /// Replaces the variables inside their interval in `y = (x, z)` at `t`, and puts those on a bound onto it. Leaves
    /// `y` as it is and returns false if the equations are singular or the iteration fails.
    pub fn solve(&mut self, system: &mut System<'_>, t: f64, y: &mut [f64]) -> bool {
        let n = system.states;
        if !system.evaluate(t, y) {
            return false;
        }
        for &k in &system.bounded {
            match system.face[k] {
                Place::Lower => y[n + k] = system.set.lower[k],
                Place::Upper => y[n + k] = system.set.upper[k],
                Place::Inside | Place::Held | Place::Boundary | Place::Vertex => {}
            }
        }
        self.inside.clear();
        self.inside.extend((0..system.unknowns - n).filter(|&k| system.face[k] == Place::Inside));
        if self.inside.is_empty() {
            return true;
        }
        let start = y[n..].to_vec();
        let mut last = f64::INFINITY;
        for _ in 0..ITERATIONS {
            let Some(step) = self.newton_step(system, t, y) else { break };
            let size = step.amax();
            if !size.is_finite() || size > last {
                break;
            }
            for (a, &k) in self.inside.iter().enumerate() {
                y[n + k] -= step[a];
            }
            last = size;
            let scale = self.inside.iter().fold(0.0_f64, |scale, &k| scale.max(y[n + k].abs()));
            if size <= 1e-14 * scale {
                return true;
            }
        }
        let scale = self.inside.iter().fold(0.0_f64, |scale, &k| scale.max(y[n + k].abs()));
        if last <= 1e-8 * scale {
            return true;
        }
        y[n..].copy_from_slice(&start);
        false
    }

    /// One Newton step for the variables inside.
    fn newton_step(&mut self, system: &mut System<'_>, t: f64, y: &[f64]) -> Option<DVector<f64>> {
        let n = system.states;
        let count = self.inside.len();
        if !system.evaluate(t, y) || !system.differentiate(t, y) {
            return None;
        }
        system.time_derivative(t, y, &mut self.drift);
        let mut place = vec![usize::MAX; system.unknowns - n];
        for (a, &k) in self.inside.iter().enumerate() {
            place[k] = a;
        }
        let mut d = DMatrix::<f64>::zeros(count, count);
        let mut c = DMatrix::<f64>::zeros(count, n);
        let mut b = DMatrix::<f64>::zeros(n, count);
        for (i, j, value) in system.entries() {
            let column = if j >= n { place[j - n] } else { usize::MAX };
            if i < n {
                if column != usize::MAX {
                    b[(i, column)] += value;
                }
            } else if i < system.unknowns && place[i - n] != usize::MAX {
                let row = place[i - n];
                if j < n {
                    c[(row, j)] += value;
                } else if column != usize::MAX {
                    d[(row, column)] += value;
                }
            }
        }
        let g = DVector::from_fn(count, |a, _| system.values[n + self.inside[a]]);
        let mut rates = DVector::from_column_slice(&system.values[..n]);
        if let Some(mass) = &self.mass
            && !(mass.solve_mut(&mut rates) && mass.solve_mut(&mut b))
        {
            return None;
        }
        let hidden = DVector::from_fn(count, |a, _| self.drift[self.inside[a]]) + &c * rates;
        let derivative = c * b;
        let (matrix, right) =
            if d.amax() == 0.0 { (derivative, hidden) } else { combine(&d, &g, &derivative, &hidden)? };
        matrix.lu().solve(&right)
    }
}

/// The rows `V^T (D | G)` and `U^T (derivative | hidden)`.
fn combine(
    d: &DMatrix<f64>,
    g: &DVector<f64>,
    derivative: &DMatrix<f64>,
    hidden: &DVector<f64>,
) -> Option<(DMatrix<f64>, DVector<f64>)> {
    let svd = d.clone().svd(true, false);
    let u = svd.u?;
    let largest = svd.singular_values.amax();
    let (mut matrix, mut right) = (d.clone(), g.clone());
    for (row, singular) in svd.singular_values.iter().enumerate() {
        let left = u.column(row);
        let (from, value) = if *singular > 1e-10 * largest { (d, g) } else { (derivative, hidden) };
        matrix.set_row(row, &left.tr_mul(from).row(0));
        right[row] = left.dot(value);
    }
    Some((matrix, right))
}
