//! A differential variational inequality linearised at a point and multiplied by the inverse of its mass matrix:
//!
//! ```text
//! x' = A x + B z,    G = C x + D z
//! ```
//!
//! If the mass matrix `M = U S V^T` is singular, the states in its null space become free variables, and the
//! equations that `U^T` maps to rows with zero singular values become their inequalities: then every algebraic
//! unknown is a variable.

use factorisation::Singular;
use nalgebra::DMatrix;
use problem::{Dvi, FaceEquations, Mass, Shape, Structure};

/// The matrices of the linearised problem `x' = A x + B z`, `G = C x + D z`, and the properties of its convex set `K`.
#[derive(Clone, Debug)]
pub struct Linearisation {
    /// The derivative `A` of the rates `x'` with respect to the states `x`, `n x n`.
    pub a: DMatrix<f64>,
    /// The derivative `B` of the rates `x'` with respect to the variables `z`, `n x m`.
    pub b: DMatrix<f64>,
    /// The derivative `C` of the inequality functions `G` with respect to the states `x`, `m x n`.
    pub c: DMatrix<f64>,
    /// The derivative `D` of the inequality functions `G` with respect to the variables `z`, `m x m`.
    pub d: DMatrix<f64>,
    /// For each variable, whether it is free (unconstrained in `K`), so that its inequality is the equation `G = 0`.
    pub free: Vec<bool>,
    /// Whether `K` is a shifted orthant: every variable that is not free has exactly one finite bound, which does not
    /// move with time or state.
    pub is_orthant: bool,
    /// Whether `K` is a product of intervals, without blocks that couple several variables.
    pub is_box: bool,
    /// Whether a bound of the convex set `K` varies with the states.
    pub set_moves_with_states: bool,
    /// Whether the Jacobian of the problem, and with it `A`, `B`, `C` and `D`, is constant in `(t, y)`.
    pub is_constant: bool,
}

/// Relative tolerance for the rank of a matrix: singular values below this fraction of the largest are treated as zero.
pub(super) const RANK: f64 = 1e-11;

impl Linearisation {
    /// Linearises the problem at `(t, y)` for the variables for which `kept` is true, with the other variables known;
    /// `None` if a derivative is not finite. The first member of each simplex is eliminated, since the sum of the
    /// members is fixed.
    pub fn at(problem: &mut dyn Dvi, t: f64, y: &[f64], kept: impl Fn(usize) -> bool) -> Option<Self> {
        let structure = problem.structure().clone();
        let simplices = || structure.set.blocks().iter().filter(|block| block.shape == Shape::Simplex);
        let firsts: Vec<usize> = simplices().map(|block| block.members[0]).collect();
        let variables: Vec<usize> = (0..structure.variables).filter(|&k| kept(k) && !firsts.contains(&k)).collect();
        let mut basis = selection(&structure, &variables);
        for block in simplices() {
            for (column, _) in (structure.states..).zip(&variables).filter(|(_, k)| block.members.contains(k)) {
                basis[(structure.states + block.members[0], column)] = -1.0;
            }
        }
        let jacobian = basis.tr_mul(&jacobian_of(problem, t, y)?) * basis;
        let moves = |k: usize| structure.moving.iter().any(|moving| moving.variable == k);
        let set = &structure.set;
        let one_sided = |k: usize| set.lower[k].is_finite() != set.upper[k].is_finite() && !moves(k);
        let is_orthant = variables.iter().all(|&k| one_sided(k) || (set.is_free(k) && !moves(k)));
        let free = variables.iter().map(|&k| set.is_free(k) && !moves(k)).collect();
        let is_box = variables.iter().all(|&k| set.block_of(k).is_none());
        Self::of(&structure, jacobian, free, (is_orthant, is_box))
    }

    /// Linearises the problem at `(t, y)` on an active face of `K`, where `blocks` are the equations of the faces of
    /// blocks: for the variables in intervals for which `inside` is true, and for the coordinates `u` of the tangent
    /// spaces of the faces,
    ///
    /// ```text
    /// dz = T u,    T^T dG = T^T C dx + (T^T D + K) T u,    K = (dT/dz)^T G
    /// ```
    ///
    /// with the tangent basis `T` and the curvature term `K` of the face. Returns `None` if a derivative is not
    /// finite.
    pub fn on_face(
        problem: &mut dyn Dvi,
        t: f64,
        y: &[f64],
        blocks: &[FaceEquations],
        inside: impl Fn(usize) -> bool,
    ) -> Option<Self> {
        let structure = problem.structure().clone();
        let (n, set) = (structure.states, &structure.set);
        let intervals: Vec<usize> =
            (0..structure.variables).filter(|&k| set.block_of(k).is_none() && inside(k)).collect();
        let tangents = set.blocks().iter().zip(blocks).flat_map(|(block, equations)| {
            (0..equations.members).filter(|&i| !equations.is_of_z[i]).map(move |i| (block, equations, i))
        });
        let tangents: Vec<_> = tangents.collect();
        let mut basis =
            selection(&structure, &intervals).resize_horizontally(n + intervals.len() + tangents.len(), 0.0);
        let jacobian = jacobian_of(problem, t, y)?;
        let mut curvature = DMatrix::<f64>::zeros(basis.ncols(), structure.unknowns());
        for (column, (block, equations, i)) in (n + intervals.len()..).zip(&tangents) {
            for (j, &k) in block.members.iter().enumerate() {
                basis[(n + k, column)] = equations.combination_of(*i)[j];
                curvature[(column, n + k)] = equations.own[i * equations.members + j];
            }
        }
        let jacobian = basis.tr_mul(&jacobian) + curvature;
        let mut free: Vec<bool> = intervals.iter().map(|&k| set.is_free(k)).collect();
        free.resize(basis.ncols() - n, false);
        let is_box = tangents.is_empty();
        Self::of(&structure, jacobian * basis, free, (false, is_box))
    }

    /// Multiplies the Jacobian of `(F, G)` by the inverse mass matrix and splits it into `A`, `B`, `C` and `D`;
    /// `None` for a mass matrix that is not finite.
    fn of(
        structure: &Structure,
        jacobian: DMatrix<f64>,
        free: Vec<bool>,
        (is_orthant, is_box): (bool, bool),
    ) -> Option<Self> {
        let (jacobian, n, free) = match &structure.mass {
            Mass::Identity => (jacobian, structure.states, free),
            Mass::Constant(entries) => without_mass(jacobian, structure.states, entries, free)?,
        };
        let m = jacobian.nrows() - n;
        Some(Self {
            a: jacobian.view((0, 0), (n, n)).into_owned(),
            b: jacobian.view((0, n), (n, m)).into_owned(),
            c: jacobian.view((n, 0), (m, n)).into_owned(),
            d: jacobian.view((n, n), (m, m)).into_owned(),
            set_moves_with_states: structure.pattern.iter().any(|&(i, _)| i >= structure.unknowns()),
            is_orthant,
            is_box,
            free,
            is_constant: structure.constant_jacobian,
        })
    }

    /// Returns the number of differential states `x` of the linearised problem.
    pub fn states(&self) -> usize {
        self.a.nrows()
    }

    /// Returns the number of variables `z` of the linearised problem, algebraic states included.
    pub fn variables(&self) -> usize {
        self.d.nrows()
    }
}

/// Returns the dense Jacobian of `(F, G)` with respect to `(x, z)`; `None` if an entry is not finite.
fn jacobian_of(problem: &mut dyn Dvi, t: f64, y: &[f64]) -> Option<DMatrix<f64>> {
    let structure = problem.structure().clone();
    let unknowns = structure.unknowns();
    let mut values = vec![0.0; structure.pattern.len()];
    problem.jacobian(t, y, &mut values);
    let mut jacobian = DMatrix::zeros(unknowns, unknowns);
    for (&(i, j), &value) in structure.pattern.iter().zip(&values).filter(|((i, _), _)| *i < unknowns) {
        jacobian[(i, j)] += value;
    }
    values.iter().all(|value| value.is_finite()).then_some(jacobian)
}

/// Returns the unit vectors of the states and of the given variables in the space of unknowns `(x, z)`, as columns.
fn selection(structure: &Structure, variables: &[usize]) -> DMatrix<f64> {
    let n = structure.states;
    let kept: Vec<usize> = (0..n).chain(variables.iter().map(|k| n + k)).collect();
    DMatrix::from_fn(structure.unknowns(), kept.len(), |i, j| f64::from(kept[j] == i))
}

/// Returns the Jacobian of `M^-1 (F, G)`, the number of differential states, and which variables are free, where
/// states in the null space of `M` become free variables; `None` for a mass matrix that is not finite.
fn without_mass(
    jacobian: DMatrix<f64>,
    n: usize,
    entries: &[(usize, usize, f64)],
    free: Vec<bool>,
) -> Option<(DMatrix<f64>, usize, Vec<bool>)> {
    let m = free.len();
    let mut mass = DMatrix::<f64>::zeros(n, n);
    entries.iter().for_each(|&(i, j, value)| mass[(i, j)] += value);
    // Of the singular vectors of the mass matrix `M`, those of its range (the differential directions) come first, then
    // those of its null space.
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
