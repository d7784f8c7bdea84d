//! The primal-dual active set method for an affine variational inequality with a sparse matrix `A` over a product of
//! intervals, as in an obstacle problem. For a guess of the active set,
//!
//! ```text
//! z_i = l_i or z_i = u_i on it,    (A z + q)_i = 0 elsewhere
//! ```
//!
//! is a linear system; variables outside their interval join the active set, those whose `w_i` has the wrong sign
//! leave it. The method is Newton's method on the natural map, and ends after finitely many steps for an M-matrix and
//! one-sided bounds (Hintermueller, Ito and Kunisch 2003, *The primal-dual active set strategy as a semismooth Newton
//! method*, theorem 3.2). If an active set recurs, or the steps are too many, [`line_search`] takes over, which
//! cannot cycle.
//!
//! A step releases one layer of grid nodes, so that a free boundary that moves over `k` layers costs `k` steps. For a
//! matrix on a known grid the active set is therefore guessed on coarser grids, from the coarsest up ([`coarse`]): a
//! few steps at any size.

mod coarse;
mod cyclic_reduction;
mod dense;
mod grid;
mod line_search;
mod multigrid;
mod operator;
mod sparse;
mod tridiagonal;

pub use dense::DenseActiveSet;

use super::{Outcome, Report, TOLERANCE};
use coarse::Coarse;
use factorisation::SparseMatrix;
use line_search::LineSearch;
use operator::Operator;
use problem::{Control, ConvexSet, Interrupted};

/// Largest number of active set steps on the finest grid before the line search takes over.
const PASSES: usize = 300;

/// Number of active set steps from the active set of the previous problem before a new guess on coarser grids.
const WARM_PASSES: usize = 2;

/// Largest number of active set steps on a coarser grid, which only gives a guess for the next finer grid.
const COARSE_PASSES: usize = 8;

/// Largest number of successive problems that start from coarser grids because a start from the active set of the
/// previous problem has failed.
const LONGEST_PAUSE: u32 = 15;

/// Relative zero tolerance of `w_i`: a component is treated as zero if it is below this fraction of the sum of the
/// magnitudes of its terms, `|A| |z| + |q|`. It lies far above the rounding error of a single operation, since errors
/// add up over a system.
const ROUNDING: f64 = 1e-13;

/// The activity of a variable: inside its interval, or at its lower or upper bound.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Face {
    Inside,
    Lower,
    Upper,
}

/// The reason why a matrix is unsuitable for the active set method.
#[derive(Clone, Copy, Debug, PartialEq, thiserror::Error)]
pub enum Unsuitable {
    /// The matrix is not square, or its size differs from the number of grid nodes.
    #[error("the matrix is {rows} by {columns}, not {expected} by {expected}")]
    Shape {
        /// The number of rows of the matrix.
        rows: usize,
        /// The number of columns of the matrix.
        columns: usize,
        /// The required number of rows and of columns.
        expected: usize,
    },
    /// A diagonal entry is not positive and finite. A matrix for which every problem has exactly one solution has
    /// positive principal minors.
    #[error("the diagonal entry of row {row} (counted from 0) is {value}, not positive and finite")]
    Diagonal {
        /// The row of the inadmissible diagonal entry, counted from 0.
        row: usize,
        /// The inadmissible diagonal entry; zero if it is absent.
        value: f64,
    },
    /// The factors of the matrix do not fit into memory.
    #[error("the factors of the matrix do not fit into memory")]
    Memory,
    /// [`Control`] asked to stop during the preparation of the matrix.
    #[error("stopped from outside")]
    Interrupted,
}

impl From<Interrupted> for Unsuitable {
    fn from(_: Interrupted) -> Self {
        Self::Interrupted
    }
}

/// Solves `z in K, <A z + q, z~ - z> >= 0` for one matrix `A` and many `q` and `K`, each from the active set of the
/// last problem.
pub struct ActiveSet {
    finest: Level,
    /// Problems on coarser grids, from fine to coarse.
    coarser: Vec<Coarse>,
    line_search: Option<LineSearch>,
    started: bool,
    /// Number of coming problems that do not start from the active set of the previous problem (`pause`), and the
    /// length of the last such pause (`next_pause`), which the next failure doubles.
    pause: u32,
    next_pause: u32,
}

impl ActiveSet {
    /// Prepares a matrix without a known grid; a tridiagonal matrix defines its own grid.
    ///
    /// # Errors
    /// If the matrix is not square, has a diagonal entry that is not positive, or its factors do not fit into memory.
    pub fn new(matrix: &SparseMatrix) -> Result<Self, Unsuitable> {
        let finest = match Operator::tridiagonal(matrix)? {
            Some(finest) => finest,
            None => Operator::sparse(matrix, &[], &Control::new())?,
        };
        let coarser = coarse::by_elimination(&finest);
        Ok(Self::from_operators(finest, coarser))
    }

    /// Prepares a matrix whose rows are the nodes of a grid of `shape[0] x shape[1] x ..` nodes, the last index
    /// fastest.
    ///
    /// # Errors
    /// As for [`ActiveSet::new`], if the matrix has another number of rows than the grid has nodes, or if `control`
    /// asks to stop.
    pub fn on_grid(matrix: &SparseMatrix, shape: &[usize], control: &Control) -> Result<Self, Unsuitable> {
        let expected = shape.iter().product();
        if matrix.nrows() != expected {
            return Err(Unsuitable::Shape { rows: matrix.nrows(), columns: matrix.ncols(), expected });
        }
        if let Some(finest) = Operator::tridiagonal(matrix)? {
            let coarser = coarse::by_elimination(&finest);
            return Ok(Self::from_operators(finest, coarser));
        }
        let below = grid::hierarchy(matrix, shape, control)?;
        let finest = Operator::sparse(matrix, &below, control)?;
        Ok(Self::from_operators(finest, coarse::by_interpolation(&below, control)?))
    }

    /// Solves `(A z)_i = r_i` in place of `r` for the variables that were inside their intervals in the last
    /// solution, with the others set to zero. Returns false if the system is singular, or if `control` asks to stop.
    pub fn solve_inside(&mut self, r: &mut [f64], control: &Control) -> bool {
        let Level { operator, face, .. } = &mut self.finest;
        for (r, face) in r.iter_mut().zip(face.iter()) {
            if *face != Face::Inside {
                *r = 0.0;
            }
        }
        operator.solve(face, None, r, control)
    }

    fn from_operators(finest: Operator, coarser: Vec<Coarse>) -> Self {
        Self { finest: Level::new(finest), coarser, line_search: None, started: false, pause: 0, next_pause: 1 }
    }

    /// Solves from the active set of the last problem or, the first time, from that of `z`; writes the solution to
    /// `z`.
    /// Returns [`Outcome::Breakdown`] for vectors of wrong length, empty intervals and values that are not finite, and
    /// [`Outcome::Unsuitable`] for sets that are not products of intervals.
    pub fn solve(&mut self, q: &[f64], set: &ConvexSet, z: &mut [f64], control: &Control) -> Report {
        if set.has_blocks() {
            return Report::UNSUITABLE;
        }
        let n = self.finest.face.len();
        let fits = q.len() == n && z.len() == n && set.dimension() == n;
        if !fits || !set.is_nonempty() || q.iter().any(|q| !q.is_finite()) {
            return Report::BREAKDOWN;
        }
        let is_warm = std::mem::replace(&mut self.started, true);
        if !is_warm {
            self.finest.guess(set, z);
        }
        let (mut settled, mut iterations) = (false, 0);
        let is_last_resort = self.coarser.is_empty();
        if is_last_resort || (is_warm && self.pause == 0) {
            let most = if is_last_resort { PASSES } else { WARM_PASSES };
            settled = self.finest.iterate(q, set, z, most, &mut iterations, control);
            self.next_pause = if settled { 1 } else { (2 * self.next_pause).min(LONGEST_PAUSE) };
            self.pause = if settled { 0 } else { self.next_pause };
        } else {
            self.pause = self.pause.saturating_sub(1);
        }
        if !settled && !is_last_resort {
            coarse::guess(&mut self.coarser, &mut self.finest, q, set, z, control);
            self.finest.iterate(q, set, z, PASSES, &mut iterations, control);
        }
        let (mut is_solved, mut residual) = self.finest.measure(q, set, z);
        if !is_solved {
            let search = self.line_search.get_or_insert_with(|| LineSearch::new(n));
            iterations += search.run(&mut self.finest, q, set, z, control);
            (is_solved, residual) = self.finest.measure(q, set, z);
        }
        let outcome = match (is_solved, residual.is_nan()) {
            (true, _) => Outcome::Solved,
            (false, _) if control.poll().is_some() => Outcome::Interrupted,
            (false, true) => Outcome::Breakdown,
            (false, false) => Outcome::Limit,
        };
        Report { outcome, residual, iterations }
    }
}

/// The matrix of one grid with the current active set of its variables.
struct Level {
    operator: Operator,
    face: Vec<Face>,
    w: Vec<f64>,
    /// `|A| |z| + |q|`, the scale of rounding errors of `w = A z + q`.
    terms: Vec<f64>,
    /// Hash signatures of the active sets since the beginning of the iteration, to detect cycles.
    seen: Vec<u64>,
}

impl Level {
    fn new(operator: Operator) -> Self {
        let n = operator.len();
        let face = vec![Face::Inside; n];
        Self { operator, face, w: vec![0.0; n], terms: vec![0.0; n], seen: Vec::with_capacity(PASSES) }
    }

    /// Sets the active set to that of a point `z`: variables at or beyond a bound are active.
    fn guess(&mut self, set: &ConvexSet, z: &[f64]) {
        for (i, (face, &z)) in self.face.iter_mut().zip(z).enumerate() {
            *face = resting_place(z, set.lower[i], set.upper[i]);
        }
    }

    /// Makes the active set admissible: variables at an infinite bound become inactive, those with equal bounds
    /// active; returns the hash signature of the set.
    fn fit(&mut self, set: &ConvexSet) -> u64 {
        let mut signature = 0;
        for (i, (face, (&lower, &upper))) in self.face.iter_mut().zip(set.lower.iter().zip(&set.upper)).enumerate() {
            *face = match *face {
                _ if lower == upper => Face::Lower,
                Face::Lower if lower == f64::NEG_INFINITY => Face::Inside,
                Face::Upper if upper == f64::INFINITY => Face::Inside,
                other => other,
            };
            signature ^= mixed(i, *face);
        }
        signature
    }

    /// Takes steps of the active set method until the active set does not change. Returns false if an active set
    /// recurs, a system is singular, or `most` steps do not suffice.
    fn iterate(
        &mut self,
        q: &[f64],
        set: &ConvexSet,
        z: &mut [f64],
        most: usize,
        passes: &mut usize,
        control: &Control,
    ) -> bool {
        let mut signature = self.fit(set);
        self.seen.clear();
        for _ in 0..most {
            if control.poll().is_some() {
                return false;
            }
            self.seen.push(signature);
            *passes += 1;
            if !self.solve_on_face(q, set, z, control) {
                return false;
            }
            self.operator.inequality(q, z, &self.face, &mut self.w, &mut self.terms);
            let changes = self.update(set, z);
            if changes == 0 {
                return true;
            }
            signature ^= changes;
            if self.seen.contains(&signature) {
                return false;
            }
        }
        false
    }

    /// Solves the linear system of the current active set for `z`. Returns false if the system is singular.
    fn solve_on_face(&mut self, q: &[f64], set: &ConvexSet, z: &mut [f64], control: &Control) -> bool {
        for (i, ((z, &face), &q)) in z.iter_mut().zip(&self.face).zip(q).enumerate() {
            *z = match face {
                Face::Inside => -q,
                Face::Lower => set.lower[i],
                Face::Upper => set.upper[i],
            };
        }
        self.operator.solve(&self.face, None, z, control)
    }

    /// Updates the active set by the bounds that `z` violates and the signs of `w = A z + q`; returns the change of the
    /// hash signature.
    fn update(&mut self, set: &ConvexSet, z: &[f64]) -> u64 {
        let mut changes = 0;
        for (i, (face, &z)) in self.face.iter_mut().zip(z).enumerate() {
            let new = match *face {
                Face::Inside if z < set.lower[i] => Face::Lower,
                Face::Inside if z > set.upper[i] => Face::Upper,
                Face::Lower if self.w[i] < -ROUNDING * self.terms[i] && set.lower[i] < set.upper[i] => Face::Inside,
                Face::Upper if self.w[i] > ROUNDING * self.terms[i] => Face::Inside,
                _ => continue,
            };
            changes ^= mixed(i, *face) ^ mixed(i, new);
            *face = new;
        }
        changes
    }

    /// Returns whether `z` solves the problem, and the natural-map residual of `z`, which is NaN if a value is not
    /// finite. The first is judged by the residual with rows divided by the diagonal, relative to the largest terms
    /// of these rows.
    fn measure(&mut self, q: &[f64], set: &ConvexSet, z: &[f64]) -> (bool, f64) {
        self.operator.apply(q, z, &mut self.w, &mut self.terms);
        let (mut residual, mut scaled, mut magnitude) = (0.0_f64, 0.0_f64, 0.0_f64);
        for (i, ((&z, &w), &scale)) in z.iter().zip(&self.w).zip(self.operator.inverse_diagonal()).enumerate() {
            let r = (z - set.project(i, z - scale * w)).abs();
            if r.is_nan() {
                return (false, r);
            }
            scaled = scaled.max(r);
            magnitude = magnitude.max(scale * self.terms[i]);
            residual = residual.max((z - set.project(i, z - w)).abs());
        }
        (scaled <= TOLERANCE * magnitude, residual)
    }
}

/// Returns the activity of a variable with the value `z` and the interval `[lower, upper]`.
fn resting_place(z: f64, lower: f64, upper: f64) -> Face {
    if z <= lower {
        Face::Lower
    } else if z >= upper {
        Face::Upper
    } else {
        Face::Inside
    }
}

/// Hash bits of variable `i` with activity `face`; the exclusive or over all variables identifies an active set
/// (Zobrist 1970; the bit mixing is `SplitMix64`).
fn mixed(i: usize, face: Face) -> u64 {
    let mut x = (4 * i as u64 + face as u64).wrapping_mul(0x9E37_79B9_7F4A_7C15);
    x = (x ^ (x >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
    x = (x ^ (x >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
    x ^ (x >> 31)
}
