//! Analysis of a differential variational inequality by its derivatives: index, existence and uniqueness, and
//! certificates on the computed solution. Each verdict states the figures on which it rests and claims no more.

mod certificates;
mod index;
mod linearisation;
mod orientation;
mod passivity;
mod reduction;
mod reversal;
mod uniqueness;
mod volterra;

pub use certificates::Certificates;
pub use index::{Index, index};
pub use linearisation::Linearisation;
pub use orientation::Orientation;
pub use reversal::Reversal;
pub use uniqueness::{Uniqueness, uniqueness};
pub use volterra::analyse_memory;

use problem::{Dvi, FaceEquations, Mass};
use reversal::reversal;
use serde::{Serialize, Serializer};

/// Maximum number of states and variables of a problem that is analysed; the analysis uses dense matrices.
const MOST_UNKNOWNS: usize = 300;

/// Number of dense square matrices, of the order of the number of states and variables, that an analysis has in memory
/// at once (measured): the matrices of the problem, and singular values and vectors.
const MATRICES: usize = 8;

/// Returns the memory that the analysis of a problem needs, as a count of `f64`; `unknowns` is the number of its states
/// and variables.
pub fn analysis_numbers(unknowns: usize) -> usize {
    if unknowns <= MOST_UNKNOWNS { MATRICES * unknowns * unknowns } else { 0 }
}

/// The analysis of a differential variational inequality, linearised at one point: index, existence and uniqueness.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct Analysis {
    /// The number of differentiations of `G` until it determines `z`: 0, 1, 2, ..; for a mixed index the largest.
    /// Absent if no number suffices, or if the problem is too large for an analysis. For a problem with memory (a
    /// Volterra inequality), the exponent of the kernel, which need not be an integer.
    #[serde(skip_serializing_if = "Option::is_none", serialize_with = "whole_where_it_is")]
    pub index: Option<f64>,
    /// The number of variables that each time derivative of `G` determines, `G` itself first; the index is mixed if
    /// more than one number is above zero.
    pub levels: Vec<usize>,
    /// The verdict on existence and uniqueness of the solution of the problem.
    pub uniqueness: Uniqueness,
    /// The reason for the verdict on existence and uniqueness, with the figures on which it rests.
    pub because: String,
    /// The index of the part of the problem whose variables are in unbounded sets: the other variables are bounded and
    /// have no impulses, whatever their index.
    #[serde(skip)]
    pub unbounded_index: Option<f64>,
    /// The part of the problem (the inequality functions, or the terms of their variables in the rates) whose sign
    /// appears to be reversed, if any.
    #[serde(skip)]
    pub reversed: Option<Reversal>,
}

fn whole_where_it_is<S: Serializer>(index: &Option<f64>, serializer: S) -> Result<S::Ok, S::Error> {
    match index {
        Some(index) if index.fract() == 0.0 => serializer.serialize_u64(*index as u64),
        index => index.serialize(serializer),
    }
}

/// Analyses the problem at `(t, y)`, `y = (x, z)`, for the variables that are not fixed by equal bounds.
pub fn analyse(problem: &mut dyn Dvi, t: f64, y: &[f64]) -> Analysis {
    let structure = problem.structure().clone();
    let set = &structure.set;
    let moves = |k: usize| structure.moving.iter().any(|bound| bound.variable == k);
    let kept = |k: usize| set.lower[k] != set.upper[k] || moves(k);
    let mut analysis = of(problem, t, |problem| Linearisation::at(problem, t, y, kept));
    analysis.unbounded_index = match (0..structure.variables).any(|k| kept(k) && structure.is_bounded(k)) {
        true if analysis.index.is_some() || !analysis.levels.is_empty() => {
            let unbounded = Linearisation::at(problem, t, y, |k| kept(k) && !structure.is_bounded(k));
            unbounded.and_then(|unbounded| index(&unbounded)).and_then(|index| index.value()).map(|value| value as f64)
        }
        _ => analysis.index,
    };
    analysis
}

/// Analyses the problem at `(t, y)` on an active face of `K`: for the variables for which `inside` is true, which are
/// inside their intervals, and for the tangent coordinates of the faces of blocks, whose equations are `blocks`. All
/// other components of `z` are known on the face.
pub fn analyse_face(
    problem: &mut dyn Dvi,
    t: f64,
    y: &[f64],
    blocks: &[FaceEquations],
    inside: impl Fn(usize) -> bool,
) -> Analysis {
    of(problem, t, |problem| Linearisation::on_face(problem, t, y, blocks, inside))
}

fn of(problem: &mut dyn Dvi, t: f64, linearise: impl FnOnce(&mut dyn Dvi) -> Option<Linearisation>) -> Analysis {
    let structure = problem.structure();
    let unknowns = structure.unknowns();
    let refuse = |because| Analysis { because, ..Analysis::default() };
    if structure.variables == 0 && structure.mass == Mass::Identity {
        let because = "there are no variables: an ordinary differential equation".to_owned();
        return Analysis { index: Some(0.0), uniqueness: Uniqueness::Unique, because, ..Analysis::default() };
    }
    if unknowns > MOST_UNKNOWNS {
        return refuse(format!(
            "the problem has {unknowns} states and variables, and at most {MOST_UNKNOWNS} are analysed"
        ));
    }
    let Some(linearisation) = linearise(problem) else {
        return refuse(format!("the derivatives at t = {t} are not finite"));
    };
    let overflow = || format!("products of the derivatives at t = {t} overflow: their units are too far apart");
    let Some(index) = index(&linearisation) else { return refuse(overflow()) };
    let (uniqueness, because) =
        uniqueness(&linearisation, &index).unwrap_or_else(|| (Uniqueness::NotAnalysed, overflow()));
    let reversed = reversal(&linearisation).filter(|_| uniqueness == Uniqueness::NotCertified);
    let value = index.value().map(|value| value as f64);
    Analysis { index: value, levels: index.levels, uniqueness, because, unbounded_index: value, reversed }
}

#[cfg(test)]
mod tests {
    use super::{Index, Linearisation, Uniqueness, index, uniqueness};
    use nalgebra::DMatrix;

    /// Returns the linearised problem `x' = A x + B z`, `G = C x + D z` with constant matrices and nonnegative `z`.
    fn orthant(a: &[f64], b: &[f64], c: &[f64], d: &[f64]) -> Linearisation {
        let m = d.len().isqrt();
        let n = a.len().isqrt();
        Linearisation {
            a: DMatrix::from_row_slice(n, n, a),
            b: DMatrix::from_row_slice(n, m, b),
            c: DMatrix::from_row_slice(m, n, c),
            d: DMatrix::from_row_slice(m, m, d),
            free: vec![false; m],
            set_moves_with_states: false,
            is_orthant: true,
            is_box: true,
            is_constant: true,
        }
    }

    fn verdict(problem: &Linearisation) -> (Index, Uniqueness, String) {
        let index = index(problem).expect("finite");
        let (uniqueness, because) = uniqueness(problem, &index).expect("finite");
        (index, uniqueness, because)
    }

    #[test]
    fn the_index_counts_differentiations() {
        // In a chain of integrators, `D`, `C B`, `C A B` or `C A A B` is the first nonzero matrix, according to the
        // number of integrators between `z` and `G`.
        let a = [0.0, 1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0];
        let b = [0.0, 0.0, 1.0];
        for (expected, c, d) in [
            (0, [0.0, 0.0, 1.0], 2.0),
            (1, [0.0, 0.0, 3.0], 0.0),
            (2, [0.0, 1e-6, 0.0], 0.0),
            (3, [1e6, 0.0, 0.0], 0.0),
        ] {
            let found = index(&orthant(&a, &b, &c, &[d])).expect("finite");
            assert_eq!(found.value(), Some(expected), "{found:?}");
        }
    }

    #[test]
    fn a_mixed_index_is_found_by_blocks() {
        // The function `G` determines `z1`, `G'` determines `z2` and `G''` determines `z3`, in units that differ by
        // twelve decades; then the system is rotated, so that no single entry shows the index.
        let a = [0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0];
        let b = [0.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0, 1e6, 0.0];
        let c = [0.0, 0.0, 0.0, 0.0, 0.0, 1.0, 1.0, 0.0, 0.0];
        let d = [1e-6, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0];
        let plain = orthant(&a, &b, &c, &d);
        assert_eq!(index(&plain).expect("finite"), Index { levels: vec![1, 1, 1], undetermined: 0 });
        let q = DMatrix::from_row_slice(3, 3, &[0.6, 0.8, 0.0, -0.48, 0.36, 0.8, 0.64, -0.48, 0.6]);
        let rotated = Linearisation {
            b: &plain.b * q.transpose(),
            c: &q * &plain.c,
            d: &q * &plain.d * q.transpose(),
            ..plain.clone()
        };
        assert_eq!(index(&rotated).expect("finite").levels, [1, 1, 1]);
    }

    #[test]
    fn variables_that_nothing_determines_are_counted() {
        let found = index(&orthant(&[0.0], &[1.0, 1.0], &[1.0, 1.0], &[0.0; 4])).expect("finite");
        assert_eq!((found.value(), found.undetermined), (None, 1));
    }

    #[test]
    fn symmetric_and_positive_definite_is_unique() {
        let (index, uniqueness, _) = verdict(&orthant(&[0.0], &[2.0], &[0.5], &[0.0]));
        assert_eq!((index.value(), uniqueness), (Some(1), Uniqueness::Unique));
    }

    #[test]
    fn the_cyclic_matrix_is_a_p_matrix_and_no_more() {
        // The matrix `M = [[1,3,0],[0,1,3],[3,0,1]]` is a P-matrix, with the leading minors 1, 1, 28, but is not
        // positive definite: its symmetric part has the eigenvalues 4, -1/2, -1/2.
        let m = [1.0, 3.0, 0.0, 0.0, 1.0, 3.0, 3.0, 0.0, 1.0];
        let identity = [1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0];
        let (index, uniqueness, because) = verdict(&orthant(&[0.0; 9], &m, &identity, &[0.0; 9]));
        assert_eq!((index.value(), uniqueness), (Some(1), Uniqueness::ExistsNotCertified));
        assert!(because.contains("a P-matrix") && because.contains("-5.000e-1"), "{because}");
        // With a P-matrix as `D` in `G = C x + D z` (index zero), the variable `z` is unique.
        let (index, uniqueness, _) = verdict(&orthant(&[0.0; 9], &identity, &identity, &m));
        assert_eq!((index.value(), uniqueness), (Some(0), Uniqueness::Unique));
    }

    #[test]
    fn friction_with_the_wrong_sign_is_not_certified() {
        let (_, uniqueness, because) = verdict(&orthant(&[0.0], &[-1.0], &[1.0], &[0.0]));
        assert_eq!(uniqueness, Uniqueness::NotCertified);
        assert!(because.contains("not a P-matrix"), "{because}");
    }

    #[test]
    fn a_passive_circuit_is_unique_though_d_is_singular_in_its_symmetric_part() {
        // The circuit equations of a bridge rectifier of four diodes.
        let b = [0.0, 0.0, -1e6, 1e6, 0.0, 0.0, 0.0, 0.0];
        let c = [0.0, 0.0, 0.0, 0.0, -1.0, 0.0, 1.0, 0.0];
        let d = [1e-3, 1e-3, -1.0, 0.0, 1e-3, 1e-3, 0.0, -1.0, 1.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0];
        let (index, uniqueness, because) = verdict(&orthant(&[0.0, -1e6, 100.0, 0.0], &b, &c, &d));
        assert_eq!((index.value(), uniqueness), (Some(0), Uniqueness::Unique), "{because}");
        assert!(because.contains("passive"));
    }

    #[test]
    fn reflection_by_an_m_matrix_is_unique_without_symmetry() {
        let identity = [1.0, 0.0, 0.0, 1.0];
        let (_, uniqueness, because) = verdict(&orthant(&[0.0; 4], &[1.0, 0.0, -1.0, 1.0], &identity, &[0.0; 4]));
        assert_eq!(uniqueness, Uniqueness::Unique, "{because}");
        assert!(because.contains("reflection map"));
    }
    #[test]
    fn no_verdict_rests_on_what_overflows() {
        let problem = orthant(&[0.0], &[1e200], &[1e200], &[0.0]);
        let index = index(&problem).expect("finite");
        assert_eq!((index.value(), uniqueness(&problem, &index)), (Some(1), None));
    }
}
