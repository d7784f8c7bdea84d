//! Monotone affine variational inequalities as conic programs, by the interior-point method Clarabel (Goulart and
//! Chen 2024, *Clarabel: an interior-point solver for conic programs with quadratic objectives*). With the set `K`
//! written as `B z + s = b`, `s in C` for a product `C` of `{0}`, `R+` and second-order cones, a symmetric `A` gives
//!
//! ```text
//! min 1/2 <z, A z> + <q, z>    over B z + s = b,  s in C
//! ```
//!
//! and any other `A` the complementarity gap `<s, y>` as a program, whose minimum is zero,
//!
//! ```text
//! min <z, A z> + <q, z> + <b, y>    over B z + s = b,  A z + B^T y + q = 0,  s in C,  y in C*
//! ```
//!
//! The program is built once for sets of one form; later problems overwrite its numbers in place, without allocations
//! on our side (Clarabel's linear solver allocates). An interior point lies near the active face of the solution, not
//! on it, so Newton's method on the natural map starts from it and measures its accuracy.

use super::{AffineVi, Outcome, Report, SemismoothNewton, ViSolver};
use clarabel::algebra::CscMatrix;
use clarabel::solver::{
    DefaultSettings, DefaultSolver, IPSolver, SolverStatus,
    SupportedConeT::{self, NonnegativeConeT, SecondOrderConeT, ZeroConeT},
};
use nalgebra::DMatrix;
use problem::{Block, Control, ConvexSet, Shape};

/// `A` counts as symmetric if its entries differ from their transposes by at most this fraction of the largest entry.
const SYMMETRIC: f64 = 1e-10;

/// Clarabel's tolerance on the duality gap and on feasibility; Newton's method improves the result.
const ACCURACY: f64 = 1e-10;

/// Solver of conic programs by Clarabel, with the program of the last problem.
#[derive(Default)]
pub struct Conic {
    built: Option<Built>,
    newton: Option<SemismoothNewton>,
    start: Vec<f64>,
}

/// A conic program, valid for all sets that differ in the right-hand sides of their constraints only.
struct Built {
    solver: DefaultSolver<f64>,
    /// The set that the program was built for, and the last matrix `A`.
    set: ConvexSet,
    matrix: DMatrix<f64>,
    is_symmetric: bool,
    constraints: Constraints,
    /// The data of the program: quadratic and linear objective, matrix and right-hand side of the constraints.
    objective: CscMatrix<f64>,
    linear: Vec<f64>,
    equations: CscMatrix<f64>,
    right: Vec<f64>,
}

impl Conic {
    /// Creates a solver; its conic program is built by the first problem.
    pub fn new() -> Self {
        Self::default()
    }
}

impl std::fmt::Debug for Conic {
    fn fmt(&self, formatter: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        formatter.debug_struct("Conic").field("set", &self.built.as_ref().map(|built| &built.set)).finish()
    }
}

impl ViSolver for Conic {
    fn name(&self) -> &'static str {
        "conic"
    }

    fn solve(&mut self, vi: &AffineVi<'_>, z: &mut [f64], control: &Control) -> Report {
        if !vi.is_sound() {
            return Report::BREAKDOWN;
        }
        if !self.built.as_mut().is_some_and(|built| built.update(vi)) {
            self.built = Built::new(vi);
        }
        let Some(Built { solver, .. }) = &mut self.built else { return Report::UNSUITABLE };
        solver.solve();
        let iterations = solver.solution.iterations as usize;
        let failure = match solver.solution.status {
            // If the program is infeasible or unbounded, the variational inequality has no solution: for a symmetric
            // `A` its program is unbounded below, for any other `A` there is no complementary pair.
            SolverStatus::DualInfeasible | SolverStatus::PrimalInfeasible => Outcome::Ray,
            SolverStatus::NumericalError => Outcome::Breakdown,
            _ => Outcome::Limit,
        };
        self.start.clear();
        self.start.extend_from_slice(&solver.solution.x[..z.len()]);
        let newton = self.newton.get_or_insert_with(|| SemismoothNewton::new(z.len()));
        let report = newton.solve(vi, &mut self.start, control);
        z.copy_from_slice(&self.start);
        let outcome = if report.outcome == Outcome::Solved { Outcome::Solved } else { failure };
        Report { outcome, iterations: iterations + report.iterations, ..report }
    }
}

impl Built {
    /// Builds the conic program of a variational inequality; returns `None` if `z` is unconstrained, or Clarabel
    /// rejects the data.
    fn new(vi: &AffineVi<'_>) -> Option<Self> {
        let constraints = Constraints::of(vi.set);
        if constraints.b.is_empty() {
            return None;
        }
        let is_symmetric = is_symmetric(vi);
        let settings = DefaultSettings {
            verbose: false,
            max_threads: 1,
            presolve_enable: false,
            input_sparse_dropzeros: false,
            tol_gap_abs: ACCURACY,
            tol_gap_rel: ACCURACY,
            tol_feas: ACCURACY,
            ..DefaultSettings::default()
        };
        let objective = objective(vi, is_symmetric, constraints.b.len());
        let equations = constraints.matrix(vi, is_symmetric);
        let (mut linear, mut right) = (Vec::new(), Vec::new());
        constraints.linear(vi, is_symmetric, &mut linear);
        constraints.right(vi, is_symmetric, &mut right);
        let cones = constraints.cones(vi, is_symmetric);
        let solver = DefaultSolver::new(&objective, &linear, &equations, &right, &cones, settings).ok()?;
        let (set, matrix) = (vi.set.clone(), vi.matrix.clone());
        Some(Self { solver, set, matrix, is_symmetric, constraints, objective, linear, equations, right })
    }

    /// Overwrites the data of the program. Returns false if the problem has another form, so that a new program is
    /// needed.
    fn update(&mut self, vi: &AffineVi<'_>) -> bool {
        let is_symmetric = self.is_symmetric;
        if !have_one_form(&self.set, vi.set) || is_symmetric != self::is_symmetric(vi) {
            return false;
        }
        self.constraints.fit(vi.set);
        if self.matrix != *vi.matrix {
            self.matrix.copy_from(vi.matrix);
            write_objective(vi, is_symmetric, &mut self.objective.nzval);
            if self.solver.update_P(&self.objective.nzval).is_err() {
                return false;
            }
            if !is_symmetric {
                let m = vi.q.len();
                // The entries of `A` come last in each column of the constraint matrix that belongs to a component of
                // `z`.
                for (j, column) in vi.matrix.as_slice().chunks_exact(m).enumerate() {
                    let end = self.equations.colptr[j + 1];
                    self.equations.nzval[end - m..end].copy_from_slice(column);
                }
                if self.solver.update_A(&self.equations.nzval).is_err() {
                    return false;
                }
            }
        }
        self.constraints.linear(vi, is_symmetric, &mut self.linear);
        self.constraints.right(vi, is_symmetric, &mut self.right);
        self.solver.update_q(&self.linear).is_ok() && self.solver.update_b(&self.right).is_ok()
    }
}

fn is_symmetric(vi: &AffineVi<'_>) -> bool {
    let noise = SYMMETRIC * vi.matrix.amax();
    let m = vi.q.len();
    (0..m).all(|j| (0..j).all(|i| (vi.matrix[(i, j)] - vi.matrix[(j, i)]).abs() <= noise))
}

/// Returns the upper triangle of the quadratic objective: `A` if symmetric, otherwise `A + A^T` followed by a zero
/// row and column for each component of the multipliers `y`.
fn objective(vi: &AffineVi<'_>, is_symmetric: bool, rows: usize) -> CscMatrix<f64> {
    let m = vi.q.len();
    let size = if is_symmetric { m } else { m + rows };
    let starts = (0..=size).map(|j| j.min(m) * (j.min(m) + 1) / 2).collect();
    let places = (0..m).flat_map(|j| 0..=j).collect();
    let mut values = vec![0.0; m * (m + 1) / 2];
    write_objective(vi, is_symmetric, &mut values);
    CscMatrix::new(size, size, starts, places, values)
}

fn write_objective(vi: &AffineVi<'_>, is_symmetric: bool, values: &mut [f64]) {
    let places = (0..vi.q.len()).flat_map(|j| (0..=j).map(move |i| (i, j)));
    for (value, (i, j)) in values.iter_mut().zip(places) {
        *value = vi.matrix[(i, j)] + if is_symmetric { 0.0 } else { vi.matrix[(j, i)] };
    }
}

/// Whether two sets with constraints of the form `B z + s = b` differ in the right-hand sides `b` only.
fn have_one_form(a: &ConvexSet, b: &ConvexSet) -> bool {
    let kind =
        |set: &ConvexSet, i: usize| (set.lower[i].is_finite(), set.upper[i].is_finite(), set.lower[i] == set.upper[i]);
    a.dimension() == b.dimension()
        && (0..a.dimension()).all(|i| kind(a, i) == kind(b, i))
        && a.blocks().len() == b.blocks().len()
        && a.blocks().iter().zip(b.blocks()).all(|(a, b)| {
            let balls = matches!((&a.shape, &b.shape), (Shape::Ball { .. }, Shape::Ball { .. }));
            a.members == b.members && (balls || a.shape == b.shape)
        })
}

/// The set `K` in the form `B z + s = b`, `s in C`.
#[derive(Default)]
struct Constraints {
    /// The entries of `B` as row, column and value.
    rows: Vec<(usize, usize, f64)>,
    b: Vec<f64>,
    cones: Vec<SupportedConeT<f64>>,
}

impl Constraints {
    fn of(set: &ConvexSet) -> Self {
        let mut constraints = Self::default();
        constraints.fit(set);
        constraints
    }

    fn fit(&mut self, set: &ConvexSet) {
        self.rows.clear();
        self.b.clear();
        self.cones.clear();
        for (i, (&lower, &upper)) in set.lower.iter().zip(&set.upper).enumerate() {
            if lower == upper {
                self.row([(i, 1.0)], upper);
                self.cones.push(ZeroConeT(1));
                continue;
            }
            for (end, sign) in [(lower, -1.0), (upper, 1.0)] {
                if end.is_finite() {
                    self.row([(i, sign)], sign * end);
                    self.cones.push(NonnegativeConeT(1));
                }
            }
        }
        for Block { members, shape } in set.blocks() {
            self.block(members, shape);
        }
    }

    fn block(&mut self, members: &[usize], shape: &Shape) {
        let k = members.len();
        if let Shape::Ball { radius } = shape {
            self.row([], *radius);
        }
        match shape {
            Shape::Polyhedron(polyhedron) => {
                for row in 0..polyhedron.rows() {
                    let entries = members.iter().copied().zip(polyhedron.normal(row).iter().copied());
                    self.row(entries, polyhedron.offset(row));
                }
                self.cones.push(NonnegativeConeT(polyhedron.rows()));
            }
            Shape::Simplex => {
                members.iter().for_each(|&i| self.row([(i, -1.0)], 0.0));
                self.row(members.iter().map(|&i| (i, 1.0)), 1.0);
                self.cones.extend([NonnegativeConeT(k), ZeroConeT(1)]);
            }
            Shape::Ball { .. } | Shape::SecondOrderCone => {
                members.iter().for_each(|&i| self.row([(i, -1.0)], 0.0));
                let axis = usize::from(matches!(shape, Shape::Ball { .. }));
                self.cones.push(SecondOrderConeT(k + axis));
            }
        }
    }

    fn row(&mut self, entries: impl IntoIterator<Item = (usize, f64)>, b: f64) {
        let row = self.b.len();
        self.rows.extend(entries.into_iter().map(|(column, value)| (row, column, value)));
        self.b.push(b);
    }

    /// Returns the matrix of the constraints: `B` for a symmetric `A`, otherwise `[B 0; A B^T; 0 -I]` with those rows
    /// of `-I` that belong to inequalities.
    fn matrix(&self, vi: &AffineVi<'_>, is_symmetric: bool) -> CscMatrix<f64> {
        let (m, r) = (vi.q.len(), self.b.len());
        let mut entries = self.rows.clone();
        let (mut height, mut width) = (r, m);
        if !is_symmetric {
            entries.extend((0..m * m).map(|at| (r + at / m, at % m, vi.matrix[(at / m, at % m)])));
            entries.extend(self.rows.iter().map(|&(row, column, value)| (r + column, m + row, value)));
            entries.extend(self.signed().enumerate().map(|(at, row)| (r + m + at, m + row, -1.0)));
            (height, width) = (r + m + self.signed().count(), m + r);
        }
        let rows = entries.iter().map(|entry| entry.0).collect();
        let columns = entries.iter().map(|entry| entry.1).collect();
        CscMatrix::new_from_triplets(height, width, rows, columns, entries.iter().map(|entry| entry.2).collect())
    }

    /// Returns the rows of `B z + s = b` that are not equations; the multiplier of an equation may have any sign.
    fn signed(&self) -> impl Iterator<Item = usize> {
        let mut start = 0;
        self.cones.iter().flat_map(move |cone| {
            let first = start;
            let (rows, skipped) = match cone {
                ZeroConeT(rows) => (*rows, *rows),
                NonnegativeConeT(rows) | SecondOrderConeT(rows) => (*rows, 0),
                _ => (0, 0),
            };
            start += rows;
            first + skipped..start
        })
    }

    /// Writes the linear objective of the conic program: `q` for a symmetric `A`, otherwise `(q, b)`.
    fn linear(&self, vi: &AffineVi<'_>, is_symmetric: bool, linear: &mut Vec<f64>) {
        linear.clear();
        linear.extend_from_slice(vi.q);
        if !is_symmetric {
            linear.extend_from_slice(&self.b);
        }
    }

    /// Writes the right-hand side of the constraints of the conic program: `b` for a symmetric `A`, otherwise `(b, -q,
    /// 0)`.
    fn right(&self, vi: &AffineVi<'_>, is_symmetric: bool, right: &mut Vec<f64>) {
        right.clear();
        right.extend_from_slice(&self.b);
        if !is_symmetric {
            right.extend(vi.q.iter().map(|q| -q));
            right.resize(right.len() + self.signed().count(), 0.0);
        }
    }

    /// Returns the cones of the slacks `s`: `C` for a symmetric `A`, otherwise `C x {0} x C*`.
    fn cones(&self, vi: &AffineVi<'_>, is_symmetric: bool) -> Vec<SupportedConeT<f64>> {
        let mut cones = self.cones.clone();
        if !is_symmetric {
            cones.push(ZeroConeT(vi.q.len()));
            cones.extend(self.cones.iter().filter(|cone| !matches!(cone, ZeroConeT(_))).cloned());
        }
        cones
    }
}
