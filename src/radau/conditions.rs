//! The conditions under which a Runge-Kutta method `(A, b, c)` converges with a variational inequality at every stage,
//! checked on its coefficients:
//!
//! ```text
//! b > 0,  Q = B A + A^T B - b b^T >= 0               algebraic stability (Hairer and Wanner 1996, definition IV.12.5)
//! B(p): b^T c^{q-1} = 1/q,  q <= p                   order of quadrature
//! C(q): A c^{k-1} = c^k / k,  k <= q                 stage order (both IV.5)
//! D > 0 diagonal,  D A + A^T D > 0                   existence and uniqueness of the stages (IV.14)
//! e_s^T A = b^T                                      stiff accuracy: the step ends in K
//! R(infinity) = 1 - b^T A^-1 1 = 0                   L-stability, with the first (IV.3)
//! ```
//!
//! with `B = diag(b)`. The diagonal is that of the tableau, by which the stage inequalities are scaled. Since
//! `D A + A^T D = A^T (D A^-1 + A^-T D) A`, it serves `A^-1` as well.

use super::tableau::Tableau;
use nalgebra::{DMatrix, DVector};
use serde::Serialize;

/// Results of checking the convergence conditions of a Runge-Kutta method. Each number is reported with the bound on
/// its rounding error, against which it is judged.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Conditions {
    /// Algebraic stability: positive weights `b`, and a positive semidefinite `Q = B A + A^T B - b b^T`.
    pub algebraic_stability: AlgebraicStability,
    /// Order of quadrature: the largest `p` for which `B(p)` holds.
    pub quadrature_order: Order,
    /// Stage order: the largest `q` for which `C(q)` holds.
    pub stage_order: Order,
    /// Positive definiteness of `D A + A^T D`; `None` if no positive and finite diagonal `D` is known.
    pub positive_diagonal: Option<PositiveDiagonal>,
    /// Stiff accuracy: the difference of the last row of `A` and the weights `b`.
    pub stiff_accuracy: Vanishing,
    /// Damping of stiff components: the stability function at infinity, `|R(infinity)|`; `None` if `A` is singular.
    pub damping: Option<Vanishing>,
}

/// Algebraic stability, with its matrix `Q = B A + A^T B - b b^T`.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct AlgebraicStability {
    /// Whether the weights are positive, and no eigenvalue of `Q` is negative beyond rounding.
    pub holds: bool,
    /// The least of the weights `b` of the method.
    pub least_weight: f64,
    /// The least eigenvalue of the matrix `Q` of algebraic stability.
    pub least_eigenvalue: f64,
    /// Bound on the rounding error of the least eigenvalue of `Q`.
    pub rounding: f64,
    /// The rows of the matrix `Q` of algebraic stability.
    pub matrix: Vec<Vec<f64>>,
}

/// How far a sequence of order conditions, `B(p)` or `C(q)`, holds.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Order {
    /// The largest order up to which all conditions of the sequence hold.
    pub order: usize,
    /// The largest residual of the order conditions of the sequence that hold.
    pub residual: f64,
    /// The residual of the order condition of the next order.
    pub next_residual: f64,
    /// The bound on the rounding error of the residual of an order condition.
    pub rounding: f64,
}

/// A diagonal matrix `D > 0`, and the definiteness of `D A + A^T D`.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct PositiveDiagonal {
    /// Whether `D A + A^T D` is positive definite beyond rounding.
    pub holds: bool,
    /// The entries of the diagonal matrix `D` of the method.
    pub diagonal: Vec<f64>,
    /// The least eigenvalue of `D A + A^T D`.
    pub least_eigenvalue: f64,
    /// Bound on the rounding error of the least eigenvalue of `D A + A^T D`.
    pub rounding: f64,
    /// Coercivity of `A^-1`: the largest `alpha` with `u^T D A^-1 u >= alpha u^T D u` for all `u`; `None` if `A` is
    /// singular.
    pub coercivity: Option<f64>,
}

/// The value of a number that is zero if a condition on the coefficients of a method holds.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Vanishing {
    /// Whether the condition holds: its number is zero up to rounding.
    pub holds: bool,
    /// Absolute value of the number that is zero if the condition holds.
    pub value: f64,
    /// Bound on the rounding error of the number that should be zero.
    pub rounding: f64,
}

impl Vanishing {
    fn new(value: f64, rounding: f64) -> Self {
        Self { holds: value.abs() <= rounding, value: value.abs(), rounding }
    }
}

impl Conditions {
    /// Checks the convergence conditions for one of the tableaux of Radau IIA.
    pub fn of(tableau: &Tableau) -> Self {
        Self::check(&tableau.a, &tableau.b, &tableau.c, &tableau.d)
    }

    /// Checks the convergence conditions for the Runge-Kutta method with the coefficients `a` (`s x s`), `b` and `c`
    /// (of length `s >= 1`), and with the diagonal `d`.
    fn check(a: &DMatrix<f64>, b: &[f64], c: &[f64], d: &[f64]) -> Self {
        let s = b.len();
        // Coefficients are accurate to a few units of rounding of the largest one; a sum of s of them loses s times
        // as much.
        let unit = 4.0 * s as f64 * f64::EPSILON;
        let rounding = unit * a.amax().max(1.0);
        let inverse = a.clone().try_inverse();

        let weight = DVector::from_column_slice(b);
        let nodes = DVector::from_column_slice(c);
        let power = |k: usize| nodes.map(|c| c.powi(k as i32));
        let quadrature_order = Order::count(rounding, |q| (weight.dot(&power(q - 1)) - 1.0 / q as f64).abs());
        let stage_order = Order::count(rounding, |q| (a * power(q - 1) - power(q) / q as f64).amax());

        let difference = (0..s).map(|j| (a[(s - 1, j)] - b[j]).abs()).fold(0.0, f64::max);
        let damping = inverse.as_ref().map(|inverse| {
            let sums = inverse.column_sum();
            let terms = 1.0 + weight.abs().dot(&inverse.abs().column_sum());
            Vanishing::new(1.0 - weight.dot(&sums), unit * terms)
        });
        Self {
            algebraic_stability: AlgebraicStability::check(a, b, unit),
            quadrature_order,
            stage_order,
            positive_diagonal: PositiveDiagonal::check(a, inverse.as_ref(), d, unit),
            stiff_accuracy: Vanishing::new(difference, rounding),
            damping,
        }
    }
}

impl Order {
    fn count(rounding: f64, residual: impl Fn(usize) -> f64) -> Self {
        let (mut order, mut largest) = (0, 0.0_f64);
        loop {
            let next = residual(order + 1);
            // No method satisfies the conditions of every order, and in doubles none satisfies those of order 64.
            if next > rounding || next.is_nan() || order == 64 {
                return Self { order, residual: largest, next_residual: next, rounding };
            }
            (order, largest) = (order + 1, largest.max(next));
        }
    }
}

impl AlgebraicStability {
    fn check(a: &DMatrix<f64>, b: &[f64], unit: f64) -> Self {
        let s = b.len();
        let q = DMatrix::from_fn(s, s, |i, j| b[i] * a[(i, j)] + b[j] * a[(j, i)] - b[i] * b[j]);
        let terms =
            DMatrix::from_fn(s, s, |i, j| (b[i] * a[(i, j)]).abs() + (b[j] * a[(j, i)]).abs() + (b[i] * b[j]).abs());
        let (least_eigenvalue, rounding) = (least_eigenvalue(&q), unit * terms.norm());
        let least_weight = b.iter().copied().fold(f64::INFINITY, f64::min);
        let matrix = q.row_iter().map(|row| row.iter().copied().collect()).collect();
        let holds = least_weight > 0.0 && least_eigenvalue >= -rounding;
        Self { holds, least_weight, least_eigenvalue, rounding, matrix }
    }
}

impl PositiveDiagonal {
    fn check(a: &DMatrix<f64>, inverse: Option<&DMatrix<f64>>, d: &[f64], unit: f64) -> Option<Self> {
        if !d.iter().all(|d| d.is_finite() && *d > 0.0) {
            return None;
        }
        let d = DVector::from_column_slice(d);
        let product = DMatrix::from_diagonal(&d) * a;
        let least = least_eigenvalue(&(&product + product.transpose()));
        let rounding = unit * 2.0 * product.norm();
        let coercivity = inverse.map(|inverse| {
            let root = d.map(f64::sqrt);
            let scaled = DMatrix::from_diagonal(&root) * inverse * DMatrix::from_diagonal(&root.map(f64::recip));
            0.5 * least_eigenvalue(&(&scaled + scaled.transpose()))
        });
        let diagonal = d.iter().copied().collect();
        Some(Self { holds: least > rounding, diagonal, least_eigenvalue: least, rounding, coercivity })
    }
}

fn least_eigenvalue(symmetric: &DMatrix<f64>) -> f64 {
    symmetric.symmetric_eigenvalues().min()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::tableau::MOST_STAGES;

    fn check(a: &[f64], b: &[f64], c: &[f64]) -> Conditions {
        let d: Vec<f64> = b.iter().zip(c).map(|(b, c)| b / c).collect();
        Conditions::check(&DMatrix::from_row_slice(b.len(), b.len(), a), b, c, &d)
    }

    #[test]
    fn radau_iia_meets_all_conditions_with_every_number_of_stages() {
        for s in 1..=MOST_STAGES {
            let conditions = Conditions::of(Tableau::of(s));
            assert!(conditions.algebraic_stability.holds, "{s}: {:?}", conditions.algebraic_stability);
            // The expected orders: Table IV.5.13 of Hairer and Wanner 1996.
            assert_eq!(conditions.quadrature_order.order, 2 * s - 1, "{:?}", conditions.quadrature_order);
            assert_eq!(conditions.stage_order.order, s, "{:?}", conditions.stage_order);
            assert!(conditions.stiff_accuracy.holds, "{s}: {:?}", conditions.stiff_accuracy);
            assert!(conditions.damping.is_some_and(|damping| damping.holds), "{s}: {:?}", conditions.damping);
            let diagonal = conditions.positive_diagonal.unwrap();
            assert!(diagonal.holds && diagonal.diagonal.iter().all(|d| *d > 0.0), "{s}: {diagonal:?}");
        }
    }

    #[test]
    fn the_coercivity_is_that_of_the_theorem() {
        // Theorem IV.14.5 of Hairer and Wanner 1996: 1 for one stage, else 1 / (2 c_{s-1}).
        for s in 1..=MOST_STAGES {
            let tableau = Tableau::of(s);
            let exact = if s == 1 { 1.0 } else { 0.5 / tableau.c[s - 2] };
            let found = Conditions::of(tableau).positive_diagonal.unwrap().coercivity.unwrap();
            assert!((found - exact).abs() < 1e-11, "s = {s}: {found}, not {exact}");
        }
    }

    #[test]
    fn the_matrix_of_algebraic_stability_has_rank_one() {
        // By the W-transformation (IV.5) the matrix Q is B p p^T B / (2s - 1), where p is the orthonormal Legendre
        // polynomial of degree s - 1.
        let two = Conditions::of(Tableau::of(2)).algebraic_stability.matrix;
        for (row, exact) in two.iter().zip([[0.0625, -0.0625], [-0.0625, 0.0625]]) {
            assert!(row.iter().zip(exact).all(|(q, exact)| (q - exact).abs() < 1e-15), "{two:?}");
        }
        let legendre = |u: f64| 5.0_f64.sqrt() * 0.5 * (3.0 * u * u - 1.0);
        let tableau = Tableau::of(3);
        let three = Conditions::of(tableau).algebraic_stability.matrix;
        let p: Vec<f64> = (0..3).map(|i| tableau.b[i] * legendre(2.0 * tableau.c[i] - 1.0)).collect();
        for (i, row) in three.iter().enumerate() {
            assert!(row.iter().zip(&p).all(|(q, p_j)| (q - p[i] * p_j / 5.0).abs() < 1e-15), "{three:?}");
        }
    }

    #[test]
    fn gauss_is_algebraically_stable_but_neither_stiffly_accurate_nor_damping() {
        let r3 = 3.0_f64.sqrt();
        let a = [0.25, 0.25 - r3 / 6.0, 0.25 + r3 / 6.0, 0.25];
        let found = check(&a, &[0.5, 0.5], &[0.5 - r3 / 6.0, 0.5 + r3 / 6.0]);
        assert!(found.algebraic_stability.holds, "{:?}", found.algebraic_stability);
        assert_eq!((found.quadrature_order.order, found.stage_order.order), (4, 2));
        assert!(!found.stiff_accuracy.holds && (found.stiff_accuracy.value - 0.25).abs() < 1e-15);
        let damping = found.damping.unwrap();
        assert!(!damping.holds && (damping.value - 1.0).abs() < 1e-14, "{damping:?}");
    }

    #[test]
    fn the_trapezoidal_rule_is_stiffly_accurate_but_not_algebraically_stable() {
        let found = check(&[0.0, 0.0, 0.5, 0.5], &[0.5, 0.5], &[0.0, 1.0]);
        assert!(found.stiff_accuracy.holds);
        // The matrix of algebraic stability of the trapezoidal rule is Q = diag(-1/4, 1/4).
        let stability = found.algebraic_stability;
        assert!(!stability.holds && (stability.least_eigenvalue + 0.25).abs() < 1e-15, "{stability:?}");
        assert_eq!((found.quadrature_order.order, found.stage_order.order), (2, 2));
        assert_eq!((found.positive_diagonal, found.damping), (None, None));
    }

    #[test]
    fn radau_ia_has_a_low_stage_order_and_ends_outside_its_stages() {
        let found = check(&[0.25, -0.25, 0.25, 5.0 / 12.0], &[0.25, 0.75], &[0.0, 2.0 / 3.0]);
        assert!(found.algebraic_stability.holds && found.damping.unwrap().holds);
        assert_eq!((found.quadrature_order.order, found.stage_order.order), (3, 1));
        assert!(!found.stiff_accuracy.holds);
    }

    #[test]
    fn an_explicit_method_fails_all_but_the_order() {
        let a = [0.0, 0.0, 0.0, 0.0, 0.5, 0.0, 0.0, 0.0, 0.0, 0.5, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0];
        let found = check(&a, &[1.0 / 6.0, 1.0 / 3.0, 1.0 / 3.0, 1.0 / 6.0], &[0.0, 0.5, 0.5, 1.0]);
        assert_eq!((found.quadrature_order.order, found.stage_order.order), (4, 1));
        assert!(!found.algebraic_stability.holds && !found.stiff_accuracy.holds);
        assert_eq!((found.positive_diagonal, found.damping), (None, None));
    }

    #[test]
    fn a_method_without_monotone_stages_is_found_out() {
        // The diagonal of A is zero, so that D A + A^T D has the trace zero for every D.
        let found = check(&[0.0, 1.0, -1.0, 0.0], &[0.5, 0.5], &[1.0, 1.0]);
        let diagonal = found.positive_diagonal.unwrap();
        assert!(!diagonal.holds && diagonal.least_eigenvalue.abs() < 1e-15, "{diagonal:?}");
    }
}
