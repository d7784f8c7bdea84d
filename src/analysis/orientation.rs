//! Orientation: a necessary condition for the variables `z` on an active face of a bounded set `K` to be the only
//! solution of their variational inequality.
//!
//! The natural map of a variational inequality over a compact convex set has degree one: the signs of the
//! determinants of its derivative at all solutions, if none is degenerate, add up to one (Facchinei and Pang 2003,
//! *Finite-Dimensional Variational Inequalities and Complementarity Problems*, sections 2.2 and 3.3). At a solution
//! on an active face, this sign is that of the determinant of `D` restricted to the face; if `D` vanishes, the
//! variational inequality holds for the rates `G'`, and the determinant is that of `C B`. A negative determinant
//! therefore proves that there are other solutions, as on a repulsive switching surface, which a solution may leave
//! at any time and to either side.

use super::linearisation::Linearisation;
use nalgebra::DMatrix;
use problem::{Dvi, FaceEquations};

/// The orientation of a solution on an active face of intervals: the determinant of `D`, or of `C B` if `D` vanishes,
/// with each row of the matrix divided by the sum of the absolute values of its terms.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Orientation {
    /// The relative determinant of `D` or `C B` on the active face, at most one in absolute value.
    pub determinant: f64,
    /// The determinant of the matrix itself, in its units.
    pub of_matrix: f64,
    /// The number of variables on the face, free variables excluded.
    pub variables: usize,
    /// Bound on the rounding error of the relative determinant.
    rounding: f64,
}

/// Rounding error of each product of two entries of the derivatives, relative to its size: those that the inverse of the
/// mass matrix multiplies err by a few units.
const ROUNDING: f64 = 4.0 * f64::EPSILON;

impl Orientation {
    /// Returns the orientation of the active face of `K` at `(t, y)`, of the variables inside their intervals, by
    /// `inside`. `None` without such variables, where one of them is bounded on one side only, on the face of a block, or
    /// where the determinant vanishes.
    pub fn at(
        problem: &mut dyn Dvi,
        t: f64,
        y: &[f64],
        blocks: &[FaceEquations],
        inside: impl Fn(usize) -> bool,
    ) -> Option<Self> {
        let structure = problem.structure();
        let is_closed = |k: usize| structure.set.is_free(k) || structure.is_bounded(k);
        if !(0..structure.variables).all(|k| !inside(k) || is_closed(k)) {
            return None;
        }
        Self::of(&Linearisation::on_face(problem, t, y, blocks, inside)?)
    }

    /// Returns the orientation of the active face of a linearised problem; `None` if `K` is not a product of intervals,
    /// a bound moves with the states, or no variables remain after elimination of the free ones.
    fn of(problem: &Linearisation) -> Option<Self> {
        let eliminated = problem.without_free();
        let problem = eliminated.as_ref().unwrap_or(problem);
        let variables = problem.variables();
        if variables == 0 || problem.free.contains(&true) || !problem.is_box || problem.set_moves_with_states {
            return None;
        }
        let (matrix, terms): (DMatrix<f64>, DMatrix<f64>) = if problem.d.amax() > 0.0 {
            (problem.d.clone(), problem.d.abs())
        } else {
            (&problem.c * &problem.b, problem.c.abs() * problem.b.abs())
        };
        let sums: Vec<f64> = terms.row_iter().map(|row| row.sum()).collect();
        let scaled = DMatrix::from_fn(variables, variables, |i, j| matrix[(i, j)] / sums[i]);
        let rounding = ROUNDING * ((problem.states() + variables) * variables) as f64;
        let found = Self { determinant: scaled.determinant(), of_matrix: matrix.determinant(), variables, rounding };
        // Where the determinant vanishes, further differentiations of `G` determine the variables.
        let is_regular = found.determinant.abs() > rounding && found.of_matrix.is_finite();
        is_regular.then_some(found)
    }

    /// Whether the determinant is negative beyond rounding errors, which proves that there are other solutions.
    pub fn has_other_solutions(self) -> bool {
        self.determinant < -self.rounding
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Returns the linearised problem `x' = z`, `G = C x` (`B = I`, `D = 0`) on a face of bounded intervals, for the
    /// matrix `C` by rows.
    fn face(c: &[f64]) -> Linearisation {
        let m = c.len().isqrt();
        Linearisation {
            a: DMatrix::zeros(m, m),
            b: DMatrix::identity(m, m),
            c: DMatrix::from_row_slice(m, m, c),
            d: DMatrix::zeros(m, m),
            free: vec![false; m],
            set_moves_with_states: false,
            is_orthant: false,
            is_box: true,
            is_constant: true,
        }
    }

    /// Returns the number of solutions `z` of `0 in C z + q + N(z)`, with the normal cone `N` of the square
    /// `[-1, 1]^2`, by enumeration of the nine faces of the square.
    fn solutions(c: &[f64], q: [f64; 2]) -> usize {
        let ends = [-1.0, 0.0, 1.0];
        let all = ends.iter().flat_map(|&first| ends.iter().map(move |&second| [first, second]));
        let is_solution = |ends: &[f64; 2]| {
            let inside: Vec<usize> = (0..2).filter(|&i| ends[i] == 0.0).collect();
            let of = |i: usize, j: usize| c[2 * i + j];
            let matrix = DMatrix::from_fn(inside.len(), inside.len(), |i, j| of(inside[i], inside[j]));
            let known = |i: usize| q[i] + (0..2).map(|j| of(i, j) * ends[j]).sum::<f64>();
            let right = nalgebra::DVector::from_iterator(inside.len(), inside.iter().map(|&i| -known(i)));
            let found = if inside.is_empty() { Some(right) } else { matrix.lu().solve(&right) };
            let Some(found) = found else { return false };
            let mut z = *ends;
            inside.iter().zip(&found).for_each(|(&i, &value)| z[i] = value);
            let g = |i: usize| q[i] + (0..2).map(|j| of(i, j) * z[j]).sum::<f64>();
            (0..2).all(|i| match ends[i] {
                -1.0 => g(i) >= 0.0,
                1.0 => g(i) <= 0.0,
                _ => z[i].abs() < 1.0,
            })
        };
        all.filter(is_solution).count()
    }

    #[test]
    fn a_negative_determinant_on_a_face_is_never_alone() {
        // The orientations of all solutions for one matrix sum to one; in these examples one solution is inside the
        // square, and the others are on its boundary.
        for (c, q, count) in [
            ([1.0, 0.5, 0.5, 1.0], [0.1, 0.2], 1),
            ([0.5, 1.0, 1.0, 0.5], [0.1, 0.2], 3),
            ([-1.0, 0.0, 0.0, 1.0], [0.1, 0.2], 3),
            ([-1.0, 0.1, 0.1, -1.0], [0.1, 0.2], 9),
        ] {
            assert_eq!(solutions(&c, q), count, "{c:?}");
            let negative = Orientation::of(&face(&c)).expect("a face").has_other_solutions();
            assert!(!negative || count > 1, "{c:?}");
            assert_eq!(negative, c[0] * c[3] < c[1] * c[2], "{c:?}");
        }
    }

    #[test]
    fn the_determinant_has_no_units() {
        for unit in [1e-9, 1.0, 1e9] {
            let found = Orientation::of(&face(&[-unit])).expect("a face");
            assert_eq!((found.determinant, found.variables), (-1.0, 1));
        }
        let mut cone = face(&[1.0]);
        cone.is_box = false;
        assert_eq!(Orientation::of(&cone), None);
    }
}
