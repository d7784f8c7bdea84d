//! A problem linearised at a point, its mass matrix taken to the other side:
//!
//! ```text
//! x' = A x + B z,    G = C x + D z
//! ```
//!
//! Where `M = U S V^T` is singular, the states in its null space become free variables and the equations that `U` maps
//! to zero their inequalities: then every algebraic unknown is a variable.

use crate::factorisation::Singular;
use crate::problem::{Dvi, Mass};
use nalgebra::DMatrix;

/// The matrices at a point, and which variables are free.
#[derive(Clone, Debug)]
pub struct Linearisation {
    /// `A`, `n x n`.
    pub a: DMatrix<f64>,
    /// `B`, `n x m`.
    pub b: DMatrix<f64>,
    /// `C`, `m x n`.
    pub c: DMatrix<f64>,
    /// `D`, `m x m`.
    pub d: DMatrix<f64>,
    /// Whether each variable is free, so that its `G` is an equation.
    pub free: Vec<bool>,
    /// Whether every variable has just one bound, and that does not move: `K` is an orthant, shifted.
    pub is_orthant: bool,
    /// Whether a bound of `K` varies with the states.
    pub set_moves_with_states: bool,
    /// Whether the matrices are the same everywhere.
    pub is_constant: bool,
}

/// Singular values below this fraction of the largest count as zero.
pub(super) const RANK: f64 = 1e-11;

impl Linearisation {
    /// The matrices at `(t, y)` for the variables that are `kept`, the others being known; `None` if a derivative is not
    /// finite.
    pub fn at(problem: &mut dyn Dvi, t: f64, y: &[f64], kept: impl Fn(usize) -> bool) -> Option<Self> {
        let structure = problem.structure().clone();
        let (n, unknowns) = (structure.states, structure.unknowns());
        let mut values = vec![0.0; structure.pattern.len()];
        problem.jacobian(t, y, &mut values);
        if !values.iter().all(|value| value.is_finite()) {
            return None;
        }
        let moves = |k: usize| structure.moving.iter().any(|moving| moving.variable == k);
        let set = &structure.set;
        let kept: Vec<usize> = (0..structure.variables).filter(|&k| kept(k)).collect();
        let mut column = vec![usize::MAX; unknowns];
        (0..n).for_each(|j| column[j] = j);
        kept.iter().enumerate().for_each(|(place, &k)| column[n + k] = n + place);
        let mut jacobian = DMatrix::zeros(n + kept.len(), n + kept.len());
        for (&(i, j), &value) in structure.pattern.iter().zip(&values) {
            if i < unknowns && column[i] != usize::MAX && column[j] != usize::MAX {
                jacobian[(column[i], column[j])] += value;
            }
        }
        let one_sided = |k: usize| set.lower[k].is_finite() != set.upper[k].is_finite() && !moves(k);
        let is_orthant = kept.iter().all(|&k| one_sided(k));
        let free = kept.iter().map(|&k| set.is_free(k) && !moves(k)).collect();
        let is_constant = structure.constant_jacobian;
        let (jacobian, n, free) = match &structure.mass {
            Mass::Identity => (jacobian, n, free),
            Mass::Constant(entries) => without_mass(jacobian, n, entries, free)?,
        };
        let m = jacobian.nrows() - n;
        Some(Self {
            a: jacobian.view((0, 0), (n, n)).into_owned(),
            b: jacobian.view((0, n), (n, m)).into_owned(),
            c: jacobian.view((n, 0), (m, n)).into_owned(),
            d: jacobian.view((n, n), (m, m)).into_owned(),
            set_moves_with_states: structure.pattern.iter().any(|&(i, _)| i >= unknowns),
            is_orthant: is_orthant && free.len() == kept.len(),
            free,
            is_constant,
        })
    }

    /// The number of states.
    pub fn states(&self) -> usize {
        self.a.nrows()
    }

    /// The number of variables.
    pub fn variables(&self) -> usize {
        self.d.nrows()
    }
}

/// The Jacobian of `M^-1 (F, G)`, with the number of states that are left and which variables are free; `None` for a mass
/// that is not finite.
fn without_mass(
    jacobian: DMatrix<f64>,
    n: usize,
    entries: &[(usize, usize, f64)],
    free: Vec<bool>,
) -> Option<(DMatrix<f64>, usize, Vec<bool>)> {
    let m = free.len();
    let mut mass = DMatrix::<f64>::zeros(n, n);
    entries.iter().for_each(|&(i, j, value)| mass[(i, j)] += value);
    // Differential directions first, then those in the null space.
    let singular = Singular::of(&mass)?;
    let rank = singular.rank(RANK);
    let mut left = DMatrix::<f64>::identity(n + m, n + m);
    let mut right = DMatrix::<f64>::identity(n + m, n + m);
    for place in 0..n {
        let scale = if place < rank { 1.0 / singular.values[place] } else { 1.0 };
        for j in 0..n {
            left[(place, j)] = scale * singular.u[(j, place)];
            right[(j, place)] = singular.v_t[(place, j)];
        }
    }
    let mut all_free = vec![true; n - rank];
    all_free.extend(free);
    Some((left * jacobian * right, rank, all_free))
}
