//! The equations for the variables of a small system, eliminated to the variables alone.

use super::super::system::System;
use factorisation::Singular;
use nalgebra::{DMatrix, DVector, Dyn, LU};
use problem::Mass;

pub(super) struct Dense {
    /// `M`, factorised; none where it is the identity.
    mass: Option<LU<f64, Dyn, Dyn>>,
    /// The place of each variable among those inside.
    place: Vec<usize>,
}

impl Dense {
    /// `None` where `M` is singular.
    pub fn new(system: &System<'_>) -> Option<Self> {
        let n = system.states;
        let mass = match system.mass() {
            Mass::Identity => None,
            Mass::Constant(entries) => {
                let mut mass = DMatrix::zeros(n, n);
                entries.iter().for_each(|&(i, j, value)| mass[(i, j)] += value);
                if !mass.clone().full_piv_lu().is_invertible() {
                    return None;
                }
                Some(mass.lu())
            }
        };
        Some(Self { mass, place: vec![usize::MAX; system.unknowns - n] })
    }

    /// The Newton step at the last evaluation of `system`, to be subtracted. False if the equations are singular.
    pub fn solve(
        &mut self,
        system: &System<'_>,
        inside: &[usize],
        phi: &[f64],
        drift: &[f64],
        step: &mut [f64],
    ) -> bool {
        let Some(solution) = self.newton_step(system, inside, phi, drift) else { return false };
        step.copy_from_slice(solution.as_slice());
        true
    }

    fn newton_step(
        &mut self,
        system: &System<'_>,
        inside: &[usize],
        phi: &[f64],
        drift: &[f64],
    ) -> Option<DVector<f64>> {
        let n = system.states;
        let count = inside.len();
        let place = &mut self.place;
        place.fill(usize::MAX);
        for (a, &k) in inside.iter().enumerate() {
            place[k] = a;
        }
        let mut d = DMatrix::<f64>::zeros(count, count);
        let mut c = DMatrix::<f64>::zeros(count, n);
        let mut b = DMatrix::<f64>::zeros(n, count);
        system.visit_derivatives(&system.face, |i, j, _, value| {
            let column = if j >= n { place[j - n] } else { usize::MAX };
            if i < n {
                if column != usize::MAX {
                    b[(i, column)] += value;
                }
            } else if place[i - n] != usize::MAX {
                let row = place[i - n];
                if j < n {
                    c[(row, j)] += value;
                } else if column != usize::MAX {
                    d[(row, column)] += value;
                }
            }
        });
        let g = DVector::from_fn(count, |a, _| phi[n + inside[a]]);
        let mut rates = DVector::from_column_slice(&phi[..n]);
        if let Some(mass) = &self.mass
            && (!mass.solve_mut(&mut rates) || !mass.solve_mut(&mut b))
        {
            return None;
        }
        let hidden = DVector::from_fn(count, |a, _| drift[inside[a]]) + &c * rates;
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
    let range = Singular::of(d)?;
    let rank = range.rank(1e-10);
    let (mut matrix, mut right) = (d.clone(), g.clone());
    for (row, left) in range.u.column_iter().enumerate() {
        let (from, value) = if row < rank { (d, g) } else { (derivative, hidden) };
        matrix.set_row(row, &left.tr_mul(from).row(0));
        right[row] = left.dot(value);
    }
    Some((matrix, right))
}
